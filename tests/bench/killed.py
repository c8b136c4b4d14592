"""Kill `roomlight process` at random moments; does the next run finish with an undisturbed run's results?

    python -m tests.bench.killed SESSION --times 20 --views 24 --preset draft --set surface.directions=256

SESSION is only read; options not known here go to `roomlight process`. One line a kill, and a verdict.
"""

import argparse
import hashlib
import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tests.end_to_end import bundled

OF_THE_RUN = ("seconds", "cpu_seconds", "peak_memory_bytes", "finished")  # in a record; all else is result


def results(folder: Path) -> dict[str, str]:
    """Hash of every file of every finished stage; of records without what belongs to the run alone."""
    found = {}
    for path in sorted((folder / "stages").rglob("*")):
        if not path.is_file():
            continue
        content = path.read_bytes()
        if path.name == "record.json":
            record = {key: value for key, value in json.loads(content).items() if key not in OF_THE_RUN}
            content = json.dumps(record, sort_keys=True).encode()
        found[str(path.relative_to(folder))] = hashlib.sha256(content).hexdigest()
    return found


def begin(folder: Path, options: Sequence[str]) -> subprocess.Popen[bytes]:
    words = [sys.executable, "-m", "app.cli", "process", str(folder), "--device", "cpu", *options]
    return subprocess.Popen(words, cwd=bundled.ROOT, stdout=subprocess.DEVNULL)


def finish(folder: Path, options: Sequence[str]) -> float:
    """Run to the end; seconds it took."""
    start = time.monotonic()
    code = begin(folder, options).wait()
    if code:
        raise RuntimeError(f"{folder}: process ended with exit code {code}")
    return time.monotonic() - start


def kill(folder: Path, options: Sequence[str], after_s: float, stage: str = "") -> str:
    """Start a run and kill it so long after its start, or after that of a stage; the stage it was in, "between stages", or
    "nothing" when it was done before.
    """
    child = begin(folder, options)
    while stage and not under_way(folder, stage) and child.poll() is None:
        time.sleep(0.01)
    try:
        child.wait(after_s)
    except subprocess.TimeoutExpired:
        child.kill()
    if child.wait() != -signal.SIGKILL:
        return "nothing"
    return under_way(folder) or "between stages"


def under_way(folder: Path, stage: str = "*") -> str:
    """The stage that is at work, of all or of this one; else nothing."""
    return next((path.parent.name for path in (folder / "stages").glob(f"{stage}/*.partial")), "")


def differing(one: dict[str, str], other: dict[str, str]) -> list[str]:
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("session", type=Path)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--views", type=int, default=None, help="take the first so many")
    parser.add_argument("--seed", type=int, default=0)
    args, options = parser.parse_known_args()
    moments, failures, kills = random.Random(args.seed), 0, 0
    with tempfile.TemporaryDirectory() as scratch:
        whole = bundled.copy(args.session, Path(scratch) / "whole", args.views)
        seconds = finish(whole, options)
        wanted = results(whole)
        print(f"undisturbed: {seconds:.1f} s, {len(wanted)} files", flush=True)
        while kills < args.times:
            folder = bundled.copy(args.session, Path(scratch) / "struck", args.views)
            after_s = moments.uniform(0, seconds)
            where = kill(folder, options, after_s)
            if where != "nothing":
                kills += 1
                finish(folder, options)
                other = differing(wanted, results(folder))
                failures += bool(other)
                verdict = f"{len(other)} files differ: {', '.join(other[:4])}" if other else "identical"
                print(f"kill {kills:2} after {after_s:5.1f} s in {where:14}: {verdict}", flush=True)
            shutil.rmtree(folder)
    print(f"{kills - failures} of {kills} killed runs finished with the undisturbed results")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
