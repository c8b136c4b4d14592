"""What stands in for Slurm: `sbatch` and `scancel` that speak as the programs of those names do, and keep jobs on this machine.

A job gets SIGTERM at its walltime, and SIGKILL a little later.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from app.batch.slurm import seconds_of

KILL_WAIT_S = 3
HOME = "SLURM_DOUBLE"  # variable that names its folder


def install(folder: Path) -> Path:
    """Programs in `folder`, for the front of PATH."""
    folder.mkdir()
    for name in ("sbatch", "scancel"):
        program = folder / name
        program.write_text(
            f"#!{sys.executable}\nfrom tests.app.batch import slurm_double\nslurm_double.{name}()\n"
        )
        program.chmod(0o755)
    return folder


def scripts(folder: Path) -> list[str]:
    """Of all jobs that were ever submitted."""
    return [path.read_text() for path in sorted(folder.glob("*.sh"))]


def end_time(home: Path, number: int) -> None:
    """What Slurm does to a job at its walltime."""
    group = int((home / f"{number}.pid").read_text())
    os.killpg(group, signal.SIGTERM)
    time.sleep(KILL_WAIT_S)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def sbatch() -> None:
    home, words = Path(os.environ[HOME]), sys.argv[1:]
    script = sys.stdin.read() if words == ["--test-only"] else Path(words[0]).read_text()
    asked = dict(re.findall(r"^#SBATCH (-\w|--[\w-]+)[ =](\S+)", script, re.MULTILINE))
    if asked.get("-p") == "nowhere":
        sys.exit("sbatch: error: invalid partition specified: nowhere")
    if words == ["--test-only"]:
        return
    number = len(list(home.glob("*.sh"))) + 1
    path = home / f"{number}.sh"
    path.write_text(script)
    limit = ["timeout", f"--kill-after={KILL_WAIT_S}", str(seconds_of(asked["-t"]))]
    with (home / f"{number}.log").open("wb") as log:
        job = subprocess.Popen(
            [*limit, "bash", str(path)], stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
            env={**os.environ, "SLURM_JOB_ID": str(number)},
        )  # fmt: skip
    (home / f"{number}.pid").write_text(str(job.pid))
    print(f"Submitted batch job {number}")


def scancel() -> None:
    pid = int((Path(os.environ[HOME]) / f"{sys.argv[1]}.pid").read_text())
    try:
        os.killpg(pid, signal.SIGTERM)
    except ProcessLookupError:
        sys.exit(f"scancel: error: Kill job error on job id {sys.argv[1]}: Invalid job id specified")
