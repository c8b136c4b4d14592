"""Workers are jobs of Slurm's: a batch goes on when a job's time is over, and what Slurm refuses is told."""

import json
import shutil
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.batch import slurm
from app.batch.orders import BatchError
from app.cli import main
from tests.app.batch import slurm_double
from tests.app.batch.site import LONG_S, ROOT, wait_until
from tests.app.calls import refused
from tests.app.sessions import small


@pytest.mark.parametrize(
    ("told", "seconds"),
    [
        ("30", 1800),
        ("1:30", 90),
        ("4:00:00", 14400),
        ("1-12", 129600),
        ("2-0:30", 174600),
        ("1-0:0:5", 86405),
    ],
)
def test_a_walltime_is_read_as_slurm_reads_it(told: str, seconds: float) -> None:
    assert slurm.seconds_of(told) == seconds


def test_a_worker_ends_before_its_job() -> None:
    assert slurm.lifetime_s("0:40") == 36
    assert slurm.lifetime_s("1-0") == 86400 - slurm.MOST_MARGIN_S
    with pytest.raises(BatchError, match="give it as 4:00:00"):
        slurm.lifetime_s("4h")


@pytest.fixture
def jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Slurm's programs on PATH; the folder of its jobs."""
    import dask.config
    import dask_jobqueue  # noqa: F401  its defaults

    home = tmp_path / "slurm"
    monkeypatch.setenv("PATH", str(slurm_double.install(home)), prepend=":")
    monkeypatch.setenv(slurm_double.HOME, str(home))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.chdir(tmp_path)
    lost = "distributed.deploy.lost-worker-timeout"
    with dask.config.set({"jobqueue.slurm.interface": "lo", lost: "1s"}):
        yield home


def test_a_batch_goes_on_when_a_jobs_time_is_over(
    jobs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, shelf = small(tmp_path / "made"), tmp_path / "shelf"
    for name in "abc":
        shutil.copytree(first, shelf / f"{name}.session")

    def strike() -> None:
        wait_until(lambda: list(shelf.glob("*/stages/hdr/*/record.json")))
        slurm_double.end_time(jobs, 1)

    clock = threading.Thread(target=strike)
    clock.start()
    words = [
        "batch",
        str(shelf),
        "--until",
        "segment",
        "--device",
        "cpu",
        "--json",
        "--slurm",
        "--workers",
        "1",
    ]
    code = main(
        [*words, "--partition", "cpu", "--account", "museum", "--walltime", "0:20:00", "--cores", "2"]
    )
    clock.join(LONG_S)
    told = capsys.readouterr()
    assert code == 0, told.err
    assert {one["name"]: one["code"] for one in json.loads(told.out)["sessions"]} == dict.fromkeys("abc", 0)
    scripts = slurm_double.scripts(jobs)
    assert len(scripts) == 2, told.err
    for line in ("-p cpu", "-A museum", "-t 0:20:00", "--cpus-per-task=2", "--mem=954M"):
        assert f"#SBATCH {line}" in scripts[0]
    assert "--lifetime 1080s" in scripts[0]
    assert sys.executable in scripts[0]


def test_what_slurm_refuses_is_told_in_a_line(
    jobs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["batch", small(tmp_path / "made"), "--slurm"]
    assert "say with --workers N how many jobs" in refused(capsys, *words)
    words += ["--workers", "2"]
    assert "say with --cores N" in refused(capsys, *words)
    words += ["--cores", "1"]
    assert "invalid partition specified: nowhere" in refused(capsys, *words, "--partition", "nowhere")
    assert "--walltime 4h: is no time" in refused(capsys, *words, "--walltime", "4h")
    assert "--account: is of a job of Slurm's" in refused(capsys, *words[:2], "--account", "museum")
    monkeypatch.setenv("PATH", "/nowhere")
    assert "there is no sbatch here" in refused(capsys, *words)
