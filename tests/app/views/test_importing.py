"""The import dialog asks for what an import needs, runs it as a job, and opens what it made."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from app.views import forms
from app.views.importing import ImportDialog
from app.views.pages import Shell
from app.views.trouble import TroubleDialog
from app.work.jobs import Job, JobState
from tests.app.plans import Questions
from tests.app.views.conftest import until
from tests.app.work.children import WILLING, job


def dialog(
    shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, script: str, folder: Path | None
) -> ImportDialog:
    def make(name: str, task: str, request: Mapping[str, Any]) -> Job:
        return job(script, name, task, request)

    monkeypatch.setattr(forms, "Job", make)
    made = ImportDialog(None, shell, folder)
    made.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)  # qtbot closes it once more
    qtbot.addWidget(made)
    made.show()
    if folder is not None:
        until(qtbot, made.foot.go.isEnabled)
    return made


def test_a_dropped_folder_fills_in_a_session_beside_it(
    shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "lion").mkdir()
    (tmp_path / "lion" / "transforms.json").write_text("{}")
    made = dialog(shell, qtbot, monkeypatch, WILLING, tmp_path / "lion")
    assert made.session.text() == str(tmp_path / "lion.session")
    assert made.poses.text() == str(tmp_path / "lion" / "transforms.json")
    assert made.foot.go.isEnabled()
    made.folder.setText("")
    assert not made.foot.go.isEnabled()


def test_a_folder_is_looked_at_before_an_import_is_offered(
    shell: Shell, questions: Questions, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("lion/images", "text"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("transforms.json", "mask.png"):
        (tmp_path / "lion" / name).write_text("{}")
    made = dialog(shell, qtbot, monkeypatch, WILLING, tmp_path / "lion" / "images")
    assert made.session.text() == str(tmp_path / "lion" / "lion.session")
    assert made.poses.text() == str(tmp_path / "lion" / "transforms.json")
    assert made.object_mask.text() == str(tmp_path / "lion" / "mask.png")
    assert (
        made.found.told.text()
        == "24 RAW files  ·  8 brackets of 3 exposures  ·  Canon EOS R5  ·  8192 x 5464"
    )
    assert [asked["file"] for asked in questions.asked if asked["question"] == "preview"] == [
        "/p/a.cr3",
        "/p/b.cr3",
    ]
    questions.at_once = False
    made.folder.setText(str(tmp_path / "text"))
    assert not made.foot.go.isEnabled()
    assert made.poses.text() == made.object_mask.text() == ""  # they were of the other folder
    until(qtbot, lambda: questions.open)
    questions.fail("/text: no photographs in it (only .txt); it must hold RAW files")
    until(qtbot, lambda: "Looking" not in made.found.told.text())
    assert made.found.told.text() == "/text: no photographs in it (only .txt). It must hold RAW files"
    assert not made.foot.go.isEnabled()


def test_a_name_the_person_chose_stays(
    shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = dialog(shell, qtbot, monkeypatch, WILLING, None)
    made.session.setFocus()
    qtbot.keyClicks(made.session, "/s/mine")
    made.folder.setText(str(tmp_path))
    assert made.session.text() == "/s/mine"


def test_a_finished_import_opens_its_session_among_the_photographs_and_says_so(
    shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    opened: list[Path] = []
    shown: list[str] = []
    shell.wishes.open_session.connect(opened.append)
    shell.wishes.show_page.connect(shown.append)
    shell.wishes.say.connect(shown.append)
    script = 'emit("done", result={"session": request["session"], "views": 8})'
    made = dialog(shell, qtbot, monkeypatch, script, tmp_path)
    made.bracket.setCurrentIndex(3)
    made.foot.go.click()
    until(qtbot, lambda: opened)
    assert opened == [tmp_path.parent / f"{tmp_path.name}.session"]
    assert shown == ["photographs", f"{tmp_path.name}: 8 photographs imported"]


def test_cancelling_stops_the_import_and_keeps_the_dialog(
    shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = dialog(shell, qtbot, monkeypatch, WILLING, tmp_path)
    made.foot.go.click()
    (run,) = shell.board.active
    assert run.request["folder"] == str(tmp_path)
    assert not made.folder.isEnabled()
    made.foot.stop.click()
    until(qtbot, lambda: run.status.state is JobState.CANCELLED)
    until(qtbot, lambda: made.foot.go.isEnabled())
    assert made.isVisible()
    made.foot.stop.click()
    assert not made.isVisible()


def test_a_fault_is_told_and_can_be_put_right(
    shell: Shell, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    script = 'emit("failed", message="no photographs in it; it must hold RAW files", expected=True)'
    made = dialog(shell, qtbot, monkeypatch, script, tmp_path)
    made.foot.go.click()
    until(qtbot, lambda: made.findChildren(TroubleDialog))
    assert made.findChildren(TroubleDialog)[0].trouble.what == "no photographs in it"
    made.findChildren(TroubleDialog)[0].close()
    assert made.foot.go.isEnabled()
