"""A fault nobody caught is kept and told, and the window lives on; the command opens a window."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot

from app import crash
from app.views.application import Faults
from app.views.trouble import TroubleDialog
from tests.app.calls import ROOT
from tests.app.views.conftest import make_session, until


def fail(faults: Faults, what: str = "half a bear") -> None:
    try:
        raise ZeroDivisionError(what)
    except ZeroDivisionError as error:
        faults.take(type(error), error, error.__traceback__)


@pytest.fixture
def window(qtbot: QtBot) -> QWidget:
    made = QWidget()
    qtbot.addWidget(made)
    made.show()
    return made


def test_a_fault_is_kept_and_told_with_its_details(window: QWidget, qtbot: QtBot, capsys) -> None:
    fail(Faults(window))
    until(qtbot, lambda: window.findChildren(TroubleDialog))
    (dialog,) = window.findChildren(TroubleDialog)
    (report,) = crash.folder().glob("crash-*.txt")
    assert "half a bear" in dialog.trouble.what
    assert str(report) in dialog.trouble.remedy
    assert "Traceback" in dialog.trouble.details
    assert "half a bear" in report.read_text()
    assert "half a bear" in capsys.readouterr().err
    dialog.close()


def test_a_fault_in_another_thread_is_told_in_the_windows(window: QWidget, qtbot: QtBot) -> None:
    thread = threading.Thread(target=fail, args=(Faults(window),))
    thread.start()
    thread.join()
    until(qtbot, lambda: window.findChildren(TroubleDialog))
    window.findChildren(TroubleDialog)[0].close()


def test_faults_that_come_in_a_row_open_one_dialog(window: QWidget, qtbot: QtBot) -> None:
    faults = Faults(window, keep=lambda text: None)
    for number in range(50):
        fail(faults, str(number))
    until(qtbot, lambda: window.findChildren(TroubleDialog))
    qtbot.wait(20)
    (dialog,) = window.findChildren(TroubleDialog)
    dialog.close()
    qtbot.wait(20)
    fail(faults, "later")
    until(qtbot, lambda: any("later" in dialog.trouble.what for dialog in window.findChildren(TroubleDialog)))


def test_ctrl_c_is_no_fault(window: QWidget, qtbot: QtBot) -> None:
    faults = Faults(window)
    faults.take(KeyboardInterrupt, KeyboardInterrupt(), None)
    qtbot.wait(20)
    assert window.findChildren(TroubleDialog) == []


def test_the_command_opens_the_session_and_ctrl_c_closes_it_in_order(tmp_path: Path) -> None:
    import signal

    session = make_session(tmp_path / "lion.session")
    settings = tmp_path / "xdg" / "config" / "roomlight" / "settings.toml"
    child = subprocess.Popen(
        [sys.executable, "-m", "app.cli", "gui", str(session)], cwd=ROOT, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen"}, start_new_session=True,
        # Begun in the background, tests ignore Ctrl-C, and what they begin would inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    end = time.monotonic() + 60
    while not (settings.is_file() and str(session) in settings.read_text()):
        assert child.poll() is None, child.communicate()
        assert time.monotonic() < end
        time.sleep(0.05)
    child.send_signal(signal.SIGINT)
    _, errors = child.communicate(timeout=60)
    assert child.returncode == 0, errors
    assert "Traceback" not in errors
    assert "window = " in settings.read_text()
