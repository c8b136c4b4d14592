"""The simulate dialog asks for all that the command line takes, runs it as a job, and says what was simplified."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog
from pytestqt.qtbot import QtBot

from app import simulating
from app.cli import _parser
from app.views import forms
from app.views.main_window import MainWindow
from app.views.pages import Shell
from app.views.simulating import SimulateDialog
from app.views.trouble import TroubleDialog
from app.work.jobs import Job, JobState, JobStatus
from hardware.virtual.studio import order
from tests.app.views.conftest import until
from tests.app.work.children import WILLING, job

NOTES = ["box.xml: simplified: mirrors, made diffuse (3 % of the area)", "the rig stands at --place 1 2 3"]


@pytest.fixture
def dialog(shell: Shell, qtbot: QtBot, tmp_path: Path) -> SimulateDialog:
    shell.settings.change(last_folder=str(tmp_path))
    made = SimulateDialog(None, shell)
    made.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)  # qtbot closes it once more
    qtbot.addWidget(made)
    made.show()
    return made


def answers(monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    def make(name: str, task: str, request: Mapping[str, Any]) -> Job:
        return job(script, name, task, request)

    monkeypatch.setattr(forms, "Job", make)


def test_what_is_left_alone_is_what_the_command_line_leaves_alone(dialog: SimulateDialog) -> None:
    words = [
        "simulate",
        dialog.out.text(),
        "--room",
        dialog.room.currentText(),
        "--object",
        dialog.thing.currentText(),
    ]
    assert dialog.request() == simulating.asked(_parser().parse_args(words))


def test_every_option_of_the_command_line_can_be_said(dialog: SimulateDialog) -> None:
    dialog.room.setCurrentText("a/scene.xml")
    dialog.thing.setCurrentText("bust.ply")
    for field, value in (
        (dialog.object_size, 0.31), (dialog.turn, -90), (dialog.views, 8), (dialog.wide, 64), (dialog.high, 48),
        (dialog.seed, 7), (dialog.vignetting, 0.25), (dialog.noise, 4),
    ):  # fmt: skip
        field.setValue(value)
    for box, value in ((dialog.material, "clay"), (dialog.motion, "random"), (dialog.device, "cpu")):
        box.setCurrentText(value)
    dialog.place.setText("0.5, -1 2")
    dialog.out.setText("/o")  # room and object would name another
    words = (
        "simulate /o --room a/scene.xml --object bust.ply --object-size 0.31 --turn -90 --views 8 --size 64 48 --seed 7"
        " --vignetting 0.25 --noise 0.04 --material clay --motion random --device cpu --place 0.5 -1 2"
    )
    said = dialog.request()
    assert said == simulating.asked(_parser().parse_args(words.split()))
    assert simulating.request_of(said.content()) == said


def test_every_name_of_the_studio_is_offered(dialog: SimulateDialog) -> None:
    for box, names in (
        (dialog.room, order.ROOMS), (dialog.thing, order.OBJECTS), (dialog.material, order.MATERIALS),
        (dialog.motion, order.MOTIONS),
    ):  # fmt: skip
        assert {box.itemText(row) for row in range(box.count())} >= set(names)


def test_files_are_browsed_for_and_name_the_folder(
    dialog: SimulateDialog, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    kinds: list[str] = []

    def ask(parent: object, title: str, folder: str, patterns: str) -> tuple[str, str]:
        kinds.append(patterns)
        return ("/rooms/attic/scene.xml" if "xml" in patterns else "/things/bust.glb"), ""

    monkeypatch.setattr(QFileDialog, "getOpenFileName", ask)
    (tmp_path / "attic-bust").mkdir()
    for name, field in (("Browse for Room", dialog.room), ("Browse for Object", dialog.thing)):
        (button,) = [b for b in dialog.findChildren(forms.QPushButton) if b.accessibleName() == name]
        button.click()
        field.setEnabled(False)  # as while it runs
        assert not button.isEnabled()
    assert kinds == ["Mitsuba scenes (*.xml)", "Meshes (*.obj *.ply *.glb)"]
    assert dialog.out.text() == str(tmp_path / "attic-bust-2")


def test_what_was_simplified_is_shown_before_the_session_is_opened(
    dialog: SimulateDialog, shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    opened: list[Path] = []
    shell.wishes.open_session.connect(opened.append)
    answers(
        monkeypatch, f'emit("done", result={{"session": request["out"] + "/session", "notes": {NOTES!r}}})'
    )
    dialog.foot.go.click()
    until(qtbot, dialog.notes.isVisible)
    assert all(note in dialog.notes.toPlainText() for note in NOTES)
    assert not opened
    dialog.foot.go.click()
    assert opened == [tmp_path / "study-sphere" / "session"]
    assert not dialog.isVisible()


def test_a_simulation_that_was_stopped_says_so(dialog: SimulateDialog) -> None:
    dialog.foot._show(JobStatus("room", JobState.CANCELLED))
    assert dialog.foot.note.text() == "Stopped"


def test_where_nothing_was_simplified_the_session_opens_at_once(
    dialog: SimulateDialog, shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []
    shell.wishes.open_session.connect(opened.append)
    answers(monkeypatch, 'emit("done", result={"session": request["out"] + "/session", "notes": []})')
    dialog.foot.go.click()
    until(qtbot, lambda: opened)


def test_a_fault_of_the_studio_is_told_and_can_be_put_right(
    dialog: SimulateDialog, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(
        monkeypatch,
        'emit("failed", message="gone.xml: there is no such scene file; give another", expected=True)',
    )
    dialog.foot.go.click()
    until(qtbot, lambda: dialog.findChildren(TroubleDialog))
    told = dialog.findChildren(TroubleDialog)[0].trouble
    assert (told.what, told.remedy) == ("gone.xml: there is no such scene file", "give another")
    dialog.findChildren(TroubleDialog)[0].close()
    assert dialog.foot.go.isEnabled()


def test_a_place_that_is_not_three_numbers_starts_nothing(
    dialog: SimulateDialog, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers(monkeypatch, WILLING)
    for text in ("1 2", "1 2 three", "1 2 3 4"):
        dialog.place.setText(text)
        dialog.foot.go.click()
        assert f"place {text!r}: is not three numbers" in dialog.findChildren(TroubleDialog)[-1].trouble.what
    assert not shell.board.active


def test_the_menu_and_the_start_page_open_it(window: MainWindow, qtbot: QtBot) -> None:
    window.shell.wishes.simulate.emit()
    until(qtbot, lambda: window.findChildren(SimulateDialog))
