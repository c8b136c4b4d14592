"""One real batch on two workers, with whatever goes wrong in one: a child killed, a worker killed, bad data, a held session."""

import contextlib
import functools
import io
import json
import os
import shutil
import signal
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from app.batch import cluster, command, runner
from app.cli import main
from app.exit_codes import ExitCode
from engine.io import session as sessions
from tests.app.calls import refused
from tests.app.sessions import small
from tests.bench.killed import differing, results

UNTIL = ("--until", "segment", "--device", "cpu")


def strike(session: Path, over: threading.Event, how: Callable[[psutil.Process], None]) -> None:
    """Do something to the child that works on a session, as soon as there is one."""
    while not over.wait(0.01):
        for child in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                if str(session) in " ".join(child.cmdline()):
                    how(child)
                    return


def kill_worker(child: psutil.Process) -> None:
    """Its child must go with it, or the second try would find the session held."""
    os.kill(child.ppid(), signal.SIGKILL)


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a batch of five sessions told; `struck` and `orphaned` lost their child and their worker once."""
    folder = tmp_path_factory.mktemp("runner")
    first = small(folder, "alone.session")
    shelf = folder / "shelf"
    for name in ("struck", "orphaned", "spoilt", "held", "plain"):
        shutil.copytree(first, shelf / f"{name}.session")
    spoilt = next((shelf / "spoilt.session" / "shots").glob("0003/*.exr"))
    content = spoilt.read_bytes()
    spoilt.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert main(["process", str(first), *UNTIL]) == 0

    over = threading.Event()
    threads = [
        threading.Thread(target=strike, args=(shelf / f"{name}.session", over, how))
        for name, how in (("struck", psutil.Process.kill), ("orphaned", kill_worker))
    ]
    for thread in threads:
        thread.start()
    out = io.StringIO()
    with sessions.lock(sessions.open_session(shelf / "held.session")), contextlib.redirect_stdout(out):
        code = main(["batch", str(shelf), *UNTIL, "--json", "--workers", "2", "--memory", "8"])
    spared = [thread.is_alive() for thread in threads]
    over.set()
    assert not any(spared)
    told = json.loads(out.getvalue())
    return {
        "code": code,
        "told": {one["name"]: one for one in told["sessions"]},
        "alone": first,
        "shelf": shelf,
    }


def test_every_session_ends_whatever_becomes_of_one(ran: dict[str, Any]) -> None:
    codes = {name: told["code"] for name, told in ran["told"].items()}
    assert codes == {
        "struck": 0, "orphaned": 0, "plain": 0, "spoilt": ExitCode.REFUSED, "held": ExitCode.BUSY,
    }  # fmt: skip
    assert "0003/radiance.exr: its bytes changed" in ran["told"]["spoilt"]["message"]
    assert f"process {os.getpid()} is working on this session" in ran["told"]["held"]["message"]
    assert ran["code"] == ExitCode.REFUSED  # the worst that happened


@pytest.mark.parametrize("name", ["plain", "struck", "orphaned"])
def test_a_batch_gives_the_bytes_of_process(ran: dict[str, Any], name: str) -> None:
    alone = results(ran["alone"])
    assert alone
    assert differing(alone, results(ran["shelf"] / f"{name}.session")) == []


def test_the_same_command_goes_on_with_what_is_left(
    ran: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    main(["batch", str(ran["shelf"]), *UNTIL, "--plan", "--json"])
    told = json.loads(capsys.readouterr().out)["sessions"]
    left = [Path(one["session"]).stem for one in told if one["standing"] != "done"]
    assert left == ["held", "spoilt"]


def test_a_session_that_fits_no_worker_is_named_before_it_is_begun(
    ran: dict[str, Any], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    crew = cluster.Crew(None, "a", 0.2, {}, {}, "this machine", 1)
    monkeypatch.setattr(cluster, "open_crew", lambda *asked: contextlib.nullcontext(crew))
    assert main(["batch", str(ran["shelf"] / "held.session"), "--memory", "0.2"]) == ExitCode.REFUSED
    assert "held: needs about 1.3 GB, a worker has 0.2 GB; take fewer --workers" in capsys.readouterr().err


@pytest.mark.parametrize("impatient", [False, True])
def test_a_scheduler_that_does_not_come_back_is_told_in_one_line(
    ran: dict[str, Any],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    impatient: bool,
) -> None:
    def lose(*asked: object) -> None:
        if impatient:
            signal.raise_signal(signal.SIGINT)
        raise cluster.SchedulerGone("tcp://a: the scheduler went away")

    def hire(*asked: object) -> contextlib.AbstractContextManager[Any]:
        if not crews:
            raise cluster.BatchError("no scheduler answers")
        return contextlib.nullcontext(crews.pop())

    crews = [cluster.Crew(None, "a", None, {}, {}, "tcp://a", 1)]
    monkeypatch.setattr(command, "Wanted", functools.partial(cluster.Wanted, wait_s=0.0))
    monkeypatch.setattr(cluster, "open_crew", hire)
    monkeypatch.setattr(runner, "run", lose)
    code = main(["batch", str(ran["shelf"] / "held.session"), "--json"])
    told = capsys.readouterr()
    assert "1 session(s) are left; it is waited for" in told.err
    if impatient:
        assert code == ExitCode.STOPPED
        assert [one["code"] for one in json.loads(told.out)["sessions"]] == [ExitCode.STOPPED]
    else:
        assert code == ExitCode.REFUSED
        (line,) = json.loads(told.out)["complaints"]
        assert "nobody was back after" in line
        assert "start it again with its workers and give the same command" in line


def test_a_scheduler_that_does_not_answer_is_named(
    ran: dict[str, Any], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "ANSWER_S", 1)
    told = refused(capsys, "batch", ran["shelf"] / "held.session", "--scheduler", "tcp://127.0.0.1:9")
    assert "tcp://127.0.0.1:9: no scheduler of dask.distributed answers there" in told
    told = refused(capsys, "batch", ran["shelf"] / "held.session", "--scheduler", "nonsense://x")
    assert "nonsense://x: no scheduler" in told


@pytest.mark.parametrize(
    ("answer", "told"),
    [(b"HTTP/1.1 400 Bad Request\r\n\r\n", "another program is there"), (b"", "silent for 1 s")],
)
def test_what_is_no_scheduler_is_named(
    ran: dict[str, Any],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    answer: bytes,
    told: str,
) -> None:
    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                held.append(door.accept()[0])
                held[-1].sendall(answer)

    monkeypatch.setattr(cluster, "ANSWER_S", 1)
    held: list[socket.socket] = []
    with socket.create_server(("127.0.0.1", 0)) as door:
        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{door.getsockname()[1]}"
        line = refused(capsys, "batch", ran["shelf"] / "held.session", "--scheduler", address)
        door.shutdown(socket.SHUT_RDWR)
    assert f"{address}: no scheduler of dask.distributed answers there ({told})" in line


def test_several_exports_go_to_folders_of_their_names_and_never_over_one_another(
    ran: dict[str, Any], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    for year in ("2024", "2025"):
        shutil.copytree(ran["shelf"] / "plain.session", tmp_path / year / "plain.session")
    assert main(["export", str(tmp_path), "--to", str(tmp_path / "to")]) == ExitCode.REFUSED
    assert "stage export never ran; run `roomlight process" in capsys.readouterr().err
    assert main(["report", str(tmp_path), "--to", str(tmp_path / "to")]) == ExitCode.REFUSED
    assert "are all called plain; rename them" in capsys.readouterr().err
    assert not (tmp_path / "to").exists()


def test_left_to_us_there_are_as_many_workers_as_cores_and_memory_allow(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(cluster, "cores", lambda: list(range(16)))
    memory = cluster.Wanted(memory_gb=32.0)
    assert cluster.count_workers(memory, 4.0, 100) == (8, 4.0)
    assert cluster.count_workers(memory, 1.0, 100) == (16, 2.0)
    assert cluster.count_workers(memory, 1.0, 3) == (3, 32 / 3)
    assert cluster.count_workers(memory, 64.0, 9) == (1, 32.0)
    assert cluster.count_workers(cluster.Wanted(2, 32.0), 64.0, 9) == (2, 16.0)
