"""A stage is finished or absent, whatever happens to the process, the disk or the person's patience."""

import contextlib
import errno
import hashlib
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from engine.errors import Cancelled, SessionError
from engine.io import session as sessions
from engine.pipeline import run, stages
from engine.pipeline.settings import Settings
from tests.engine.pipeline import tiny

ROOT = Path(__file__).parents[3]


def results(session: sessions.Session) -> dict[str, str]:
    """Hash of every file of every finished stage, without the records' times."""
    found = {}
    for path in sorted((session.folder / "stages").rglob("*")):
        if path.is_file() and path.name != "record.json":
            found[str(path.relative_to(session.folder))] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


@pytest.fixture
def session(tmp_path: Path) -> sessions.Session:
    return tiny.make_session(tmp_path / "tiny.session")


def test_a_run_leaves_results_records_and_a_pointer_to_the_export(session: sessions.Session) -> None:
    steps = run.process(session, tiny.table(), Settings(), "cpu")
    assert all((step.folder / "record.json").is_file() for step in steps)
    assert (session.folder / "exports" / "latest" / "shown" / "sum.txt").is_file()
    assert not list(session.folder.rglob("*.partial"))


def test_every_file_of_a_stage_is_on_the_disk_before_it_counts_as_done(
    session: sessions.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: set[int] = set()
    fsync = os.fsync

    def noted(handle: int) -> None:
        synced.add(os.fstat(handle).st_ino)
        fsync(handle)

    monkeypatch.setattr(os, "fsync", noted)
    steps = run.process(session, tiny.table(), Settings(), "cpu")
    for step in steps:
        assert {path.stat().st_ino for path in (step.folder, *step.folder.rglob("*"))} <= synced


def test_a_second_run_does_nothing(session: sessions.Session) -> None:
    run.process(session, tiny.table(), Settings(), "cpu")
    begun: list[str] = []
    watcher = run.Watcher(begins=lambda step: begun.append(step.stage.name))
    run.process(session, tiny.table(), Settings(), "cpu", watcher=watcher)
    assert begun == []


def test_until_stops_after_the_stage_named(session: sessions.Session) -> None:
    run.process(session, tiny.table(), Settings(), "cpu", until="add")
    assert [step.done for step in stages.plan(session, tiny.table(), Settings())] == [True, True, False]
    with pytest.raises(SessionError, match="no stage 'surface'"):
        run.process(session, tiny.table(), Settings(), "cpu", until="surface")


def test_what_was_asked_is_kept_for_the_next_run(session: sessions.Session) -> None:
    run.process(session, tiny.table(), Settings(seed=4), "cpu")
    assert sessions.read_params(session) == {"preset": "standard", "seed": 4}


def test_cancelling_keeps_finished_stages_and_the_rest_resumes_to_the_same_bytes(
    session: sessions.Session, tmp_path: Path
) -> None:
    seen: list[str] = []
    watcher = run.Watcher(
        moves=lambda step, fraction, note: seen.append(step.stage.name),
        cancelled=lambda: seen.count("add") >= 2,
    )
    with pytest.raises(Cancelled):
        run.process(session, tiny.table(), Settings(), "cpu", watcher=watcher)
    assert [step.done for step in stages.plan(session, tiny.table(), Settings())] == [True, False, False]
    run.process(session, tiny.table(), Settings(), "cpu")
    (tmp_path / "other").mkdir()
    undisturbed = tiny.make_session(tmp_path / "other" / "tiny.session")
    run.process(undisturbed, tiny.table(), Settings(), "cpu")
    assert results(session) == results(undisturbed)


def test_a_failing_stage_leaves_no_trace_of_itself(session: sessions.Session) -> None:
    def fails(work: stages.Work) -> dict:
        (work.folder / "half").write_text("half")
        raise SessionError("no such luck; try again")

    count, add, export = tiny.table()
    with pytest.raises(SessionError, match="no such luck"):
        run.process(session, (count, replace(add, produce=fails), export), Settings(), "cpu")
    assert not list((session.folder / "stages").rglob("half"))
    assert [step.done for step in stages.plan(session, tiny.table(), Settings())] == [True, False, False]


def test_kill_at_random_moments_then_resume_gives_the_undisturbed_results(
    session: sessions.Session, tmp_path: Path
) -> None:
    (tmp_path / "other").mkdir()
    undisturbed = tiny.make_session(tmp_path / "other" / "tiny.session")
    command = [sys.executable, "-m", "tests.engine.pipeline.tiny"]
    subprocess.run([*command, str(undisturbed.folder)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    moments = random.Random(5)
    for _ in range(6):
        child = subprocess.Popen([*command, str(session.folder)], cwd=ROOT, stdout=subprocess.PIPE)
        assert child.stdout is not None
        for _ in range(moments.randint(0, 6)):
            child.stdout.readline()
        time.sleep(moments.uniform(0, 0.02))
        child.kill()
        child.wait()
        child.stdout.close()
        for step in stages.plan(session, tiny.table(), Settings()):
            if step.done:
                assert (step.folder / "record.json").is_file()
    subprocess.run([*command, str(session.folder)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    assert results(session) == results(undisturbed)


def test_a_second_process_is_told_who_holds_the_session(session: sessions.Session) -> None:
    with sessions.lock(session):
        command = [sys.executable, "-m", "tests.engine.pipeline.tiny", str(session.folder)]
        second = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert second.returncode != 0
    assert f"process {os.getpid()} is working on this session" in second.stderr


def test_the_lock_ends_with_its_process_even_when_killed(session: sessions.Session) -> None:
    code = (
        "import sys, time; from pathlib import Path; from engine.io import session as s\n"
        f"with s.lock(s.open_session(Path({str(session.folder)!r}))):\n"
        "    print('held', flush=True); time.sleep(60)"
    )
    child = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE)
    assert child.stdout is not None
    assert child.stdout.readline() == b"held\n"
    with pytest.raises(SessionError, match=str(child.pid)), sessions.lock(session):
        pass
    child.kill()
    child.wait()
    child.stdout.close()
    with sessions.lock(session):
        pass


def test_a_full_disk_is_told_and_leaves_the_session_as_it_was(
    session: sessions.Session, small_disk: Path
) -> None:
    moved = small_disk / "tiny.session"
    os.system(f"cp -r {session.folder} {moved}")
    session = sessions.open_session(moved)
    settings = Settings(overrides={"count": {"size": 20000}})
    small = Settings(overrides={"count": {"size": 100}})
    run.process(session, tiny.table(), small, "cpu")
    before = results(session)
    with pytest.raises(SessionError, match="disk is full; free some space"):
        run.process(session, tiny.table(), settings, "cpu")
    assert results(session) == before
    assert not list(session.folder.rglob("*.partial"))
    run.process(session, tiny.table(), small, "cpu")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 300 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=300k", "none", place], capture_output=True
    ).returncode:
        pytest.skip("mounting a small file system needs root")
    yield place
    subprocess.run(["umount", place], check=True)


def refuse_writes(patch: pytest.MonkeyPatch, first: int, number: int) -> list[str]:
    """From the `first` write on the disk refuses: files opened, folders and links made, renamed, synced. What was refused."""
    calls, refused = iter(range(10_000)), []

    def guarded(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            reads = name == "open" and (args[1:] or ("r",))[0][0] == "r"
            if not reads and next(calls) >= first:
                refused.append(f"{name} {args[0]}")
                raise OSError(number, os.strerror(number), str(args[0]))
            return real(*args, **kwargs)

        return call

    for name in ("open", "mkdir", "rename", "replace", "symlink_to"):
        patch.setattr(Path, name, guarded(name, getattr(Path, name)))
    patch.setattr(os, "fsync", guarded("sync", lambda handle: None))
    return refused


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES])
def test_whatever_write_is_refused_the_session_opens_and_goes_on(
    session: sessions.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    monkeypatch.setattr(os, "fsync", lambda handle: None)
    undisturbed = tmp_path / "undisturbed.session"
    shutil.copytree(session.folder, undisturbed)
    run.process(sessions.open_session(undisturbed), tiny.table(), Settings(), "cpu")
    struck: set[str] = set()
    for first in range(1000):
        folder = tmp_path / f"{first}.session"
        shutil.copytree(session.folder, folder)
        tried = sessions.open_session(folder)
        with monkeypatch.context() as patch:
            refused = refuse_writes(patch, first, number)
            with contextlib.suppress(SessionError):  # it says what the disk said, and nothing else comes out
                run.process(tried, tiny.table(), Settings(), "cpu")
        if not refused:
            break
        struck.add(refused[0].split()[0])
        assert not list((folder / "stages").rglob("*.partial"))
        steps = run.process(sessions.open_session(folder), tiny.table(), Settings(), "cpu")
        assert not list(folder.rglob("*.partial"))
        assert all((step.folder / "record.json").is_file() for step in steps)
        assert results(tried) == results(sessions.open_session(undisturbed))
        shutil.rmtree(folder)
    assert struck == {"open", "mkdir", "rename", "replace", "symlink_to", "sync"}
    assert first > 30  # of three stages, all


def test_cuda_without_cuda_is_refused_before_anything_runs(session: sessions.Session) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has CUDA")
    with pytest.raises(SessionError, match="--device cpu"):
        run.process(session, tiny.table(), Settings(), "cuda")
    assert not list((session.folder / "stages").iterdir())
