"""A batch on a cluster of processes that share nothing but the sessions' folder, whatever becomes of them."""

import contextlib
import io
import json
import shutil
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.cli import main
from app.exit_codes import ExitCode
from app.work.jobs import Job, JobState
from tests.app.batch.site import LONG_S, Site, wait_until
from tests.app.sessions import small
from tests.app.work.children import Heard
from tests.bench.killed import differing, results

NAMES = ("a", "b", "c", "full")
UNTIL = ("--until", "segment", "--device", "cpu")
STRANGERS = {
    "older": "import app.sources; app.sources.program = lambda: '0' * 16",
    "bare": "import sys; sys.modules['app.sources'] = None",
}
# The disk is full where a file `full` stands: no file grows over 2 kB for the session of that name.
QUOTA = """
from pathlib import Path
def dask_setup(worker):
    from app.batch import child
    real = child.command
    def command(task, request):
        full = Path(request["session"]).stem == "full" and Path("full").exists()
        return [*(["sh", "-c", 'ulimit -f 4; exec "$0" "$@"'] if full else []), *real(task, request)]
    child.command = command
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    made = Site(tmp_path_factory.mktemp("site"))
    (made.folder / "full").touch()
    for name, text in {**STRANGERS, "quota": QUOTA}.items():
        (made.folder / f"{name}.py").write_text(text)
    yield made
    made.close()


def finished(shelf: Path) -> dict[Path, int]:
    """The stages that are done, and when they were."""
    return {
        path: path.stat().st_mtime_ns
        for path in shelf.glob("*/stages/*/*/record.json")
        if ".partial" not in str(path)
    }


@pytest.fixture(scope="module")
def ran(site: Site, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A batch whose scheduler is killed when a first stage is done, and once again a worker when it goes on."""
    folder = tmp_path_factory.mktemp("cluster")
    alone = small(folder, "alone.session")
    shelf = folder / "shelf"
    for name in NAMES:
        shutil.copytree(alone, shelf / f"{name}.session")
    assert main(["process", str(alone), *UNTIL]) == 0
    before: dict[Path, int] = {}

    def strike() -> None:
        wait_until(lambda: finished(shelf))
        scheduler.kill()
        scheduler.wait()
        before.update(finished(shelf))
        site.schedule()
        site.work(*quota)
        late = site.work(*quota)
        wait_until(lambda: len(finished(shelf)) > len(before) + 1)
        late.kill()  # its worker follows

    quota = ("--preload", "quota")
    scheduler = site.schedule()
    for options in (quota, quota, *(("--no-nanny", "--preload", name) for name in STRANGERS)):
        site.work(*options)
    site.settle(4)
    out, err, killer = io.StringIO(), io.StringIO(), threading.Thread(target=strike)
    killer.start()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["batch", str(shelf), *UNTIL, "--json", "--scheduler", site.address])
    killer.join(LONG_S)
    return {
        "code": code,
        "out": out.getvalue(),
        "err": err.getvalue(),
        "alone": alone,
        "shelf": shelf,
        "before": before,
    }


def test_a_batch_outlives_its_scheduler_and_does_nothing_twice(ran: dict[str, Any]) -> None:
    told = {one["name"]: one for one in json.loads(ran["out"])["sessions"]}
    codes = {name: one["code"] for name, one in told.items()}
    assert codes == {"a": 0, "b": 0, "c": 0, "full": ExitCode.REFUSED}, ran["err"]
    assert "the scheduler went away, " in ran["err"]
    assert "Traceback" not in ran["err"]
    alone = results(ran["alone"])
    for name in "abc":
        assert differing(alone, results(ran["shelf"] / f"{name}.session")) == []
    assert ran["before"]
    after = finished(ran["shelf"])
    assert {path: after[path] for path in ran["before"]} == ran["before"]


def test_a_full_disk_costs_one_line_and_the_session_is_gone_on_with(
    ran: dict[str, Any], site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    (line,) = (one["message"] for one in json.loads(ran["out"])["sessions"] if one["name"] == "full")
    assert "full.session" in line
    assert "; " in line
    (site.folder / "full").unlink()
    assert main(["batch", str(ran["shelf"]), *UNTIL, "--scheduler", site.address]) == 0, capsys.readouterr()
    assert "1 of 4 sessions done; 3 were done before" in capsys.readouterr().out
    assert differing(results(ran["alone"]), results(ran["shelf"] / "full.session")) == []


def test_the_windows_queue_hears_where_a_session_is(ran: dict[str, Any], site: Site) -> None:
    session = ran["shelf"].parent / "windows.session"
    shutil.copytree(ran["alone"], session)
    shutil.rmtree(session / "stages")
    job = Job(
        "a",
        "process",
        {"session": str(session), "until": "segment", "device": "cpu", "scheduler": site.address},
    )
    heard = Heard(job)
    job.start()
    assert job.wait(LONG_S).state is JobState.DONE, job.status
    assert job.status.result["ran"] == ["hdr", "segment"]
    assert [status.stage for status in heard.statuses if status.stage][-1] == "segment"
    places = list(dict.fromkeys(status.place for status in heard.statuses))
    assert places[-1] == f"on {socket.gethostname()}"
    assert any("waits for one of" in place for place in places)
    assert differing(results(ran["alone"]), results(session)) == []


def test_the_windows_queue_is_told_why_a_cluster_does_nothing(ran: dict[str, Any]) -> None:
    request = {"session": str(ran["alone"]), "device": "cpu", "scheduler": "nonsense://x"}
    job = Job("a", "process", request)
    job.start()
    assert job.wait(LONG_S).state is JobState.FAILED
    assert "nonsense://x: no scheduler of dask.distributed answers there" in job.status.message


def test_workers_without_this_program_are_named_and_asked_nothing(ran: dict[str, Any]) -> None:
    complaints = json.loads(ran["out"])["complaints"]
    assert len(complaints) == 2
    assert all("it is asked nothing" in line for line in complaints)
    assert any("has another version of Roomlight (0000000000000000" in line for line in complaints)
    assert any("has no Roomlight that can be used" in line for line in complaints)
