"""Compiled kernels are kept by the text of all of them; who stands back does so for the window alone."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app import cores

KERNEL = "import numba\n\n\n@numba.njit\ndef twice(x):\n    return {} * x\n"


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    room = tmp_path / "source" / "engine"
    room.mkdir(parents=True)
    (room / "kernel.py").write_text(KERNEL.format(2))
    return room.parent


def kept(source: Path) -> str | None:
    os.environ.pop("NUMBA_CACHE_DIR", None)
    cores.keep_kernels(source)
    return os.environ.get("NUMBA_CACHE_DIR")


def test_another_text_of_any_kernel_is_another_place(source: Path) -> None:
    before = kept(source)
    assert before is not None
    assert kept(source) == before
    (source / "engine" / "kernel.py").write_text(KERNEL.format(3))
    assert kept(source) != before


def test_what_is_no_kernel_changes_nothing(source: Path) -> None:
    before = kept(source)
    (source / "engine" / "words.py").write_text("GREETING = 'hello'\n")
    assert kept(source) == before


def test_kernels_go_when_nobody_asked_for_them_in_a_month(source: Path) -> None:
    texts = []
    for factor, days in ((3, 40), (4, 20)):
        (source / "engine" / "kernel.py").write_text(KERNEL.format(factor))
        text = Path(kept(source) or "")
        (text / "kernel.nbi").write_bytes(b"compiled")
        os.utime(text, (time.time() - days * 24 * 3600,) * 2)
        texts.append(text)
    (source / "engine" / "kernel.py").write_text(KERNEL.format(5))
    kept(source)
    assert [text.exists() for text in texts] == [False, True]
    # Asked for again they are as new.
    (source / "engine" / "kernel.py").write_text(KERNEL.format(4))
    kept(source)
    assert time.time() - texts[1].stat().st_mtime < 3600


def test_what_was_said_before_stands(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/elsewhere")
    cores.keep_kernels(source)
    assert os.environ["NUMBA_CACHE_DIR"] == "/elsewhere"


def test_where_the_cache_cannot_be_written_kernels_are_kept_elsewhere(source: Path) -> None:
    blocked = source.parent / "cache"
    blocked.write_text("a file where the folder should be")
    elsewhere = kept(source)
    assert elsewhere is not None
    assert not Path(elsewhere).is_relative_to(blocked)
    assert os.access(elsewhere, os.W_OK)


def test_a_product_of_matrices_is_one_thread_s_unless_a_person_says_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    cores.share()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    cores.share()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "2"


STANDS_BACK = """
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from app import cores
def place():
    cores.stand_back()
    return os.getpriority(os.PRIO_PROCESS, 0), os.sched_getscheduler(0)
before = os.getpriority(os.PRIO_PROCESS, 0)
with ThreadPoolExecutor(1) as pool:
    after, policy = pool.submit(place).result()
session = Path("/proc/self/autogroup")
print(before, after, os.sched_getscheduler(0), policy, *session.read_text().split()[1:] if session.exists() else ())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="how Linux divides its cores")
def test_who_stands_back_yields_to_the_window_and_keeps_its_share_beside_other_programs() -> None:
    # In a session of its own, as every child of the window.
    told = subprocess.run(
        [sys.executable, "-c", STANDS_BACK],
        start_new_session=True,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    before, after = map(int, told[:2])
    assert after == min(before + cores.NICE, 19)
    assert told[2:4] == [
        str(int(os.SCHED_OTHER)),
        str(int(os.SCHED_BATCH)),
    ]  # its first thread, and the one that works
    assert len(told) == 4 or told[5] == str(cores.NICE)  # "nice 5", where the kernel has sessions' niceness


def test_open3d_comes_without_its_plots_in_a_browser() -> None:
    import open3d

    assert open3d.t.geometry.RaycastingScene
    assert "dash" not in sys.modules
