"""Waiting for the window: by what its children have computed, not by the clock."""

import subprocess
import sys

import pytest
from PySide6.QtWidgets import QApplication

from tests.end_to_end import windowed

WORKS = """
import time
for turn in range(15):
    begun = time.process_time()
    while time.process_time() < begun + 0.02:
        pass
    time.sleep(0.1)  # others have the core
"""


def test_a_child_that_has_a_core_now_and_then_is_waited_for_longer_than_its_work_takes(
    qapp: QApplication, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(windowed, "WATCHED_S", 0.4)
    monkeypatch.setattr(windowed, "AT_WORK", 0.02)
    with subprocess.Popen([sys.executable, "-c", WORKS]) as child:
        windowed.until(lambda: child.poll() is not None, "it works", timeout_s=1.2)
    assert child.returncode == 0


def test_who_does_nothing_is_not_waited_for(qapp: QApplication, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windowed, "WATCHED_S", 0.05)
    monkeypatch.setattr(windowed, "AT_WORK", 2.0)  # more than one thread can do
    with pytest.raises(TimeoutError, match="in vain: never"):
        windowed.until(lambda: False, "never", 0.1)
