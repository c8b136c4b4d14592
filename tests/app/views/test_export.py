"""The Export page offers what there is, says frames and units, and asks for exactly what was chosen."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QFileDialog
from pytestqt.qtbot import QtBot

from app.exports import TARGETS
from app.views.export.page import ExportPage
from app.views.pages import Shell
from app.views.trouble import TroubleDialog
from app.work import exported as drawn
from app.work.enquiries import Answer
from app.work.jobs import Job
from engine.results.quality import GOOD, Quality
from tests.app.plans import Questions, content
from tests.app.views.conftest import active, until
from tests.app.work.children import WILLING, job
from tests.engine.results.test_export import write as write_export


class Finished(Questions):
    """Answers that the export lies in `folder`."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder, self.stages_done = folder, 6

    def answer(self, place: int = 0) -> None:
        asked, then = self.open.pop(place)
        if asked["question"] == "exported":
            then(Answer(drawn.show(asked)))
            return
        answer = content(None, self.stages_done, asked["session"])
        answer["stages"][-1]["folder"] = str(self.folder)
        then(Answer(answer))


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    to = tmp_path_factory.mktemp("export") / "out"
    write_export(to)
    return to


@pytest.fixture
def questions(exported: Path) -> Finished:
    return Finished(exported)


@pytest.fixture
def requests() -> list[Mapping[str, Any]]:
    """What jobs were asked."""
    return []


@pytest.fixture
def page(shell: Shell, session: Path, qtbot: QtBot, requests: list[Mapping[str, Any]]) -> ExportPage:
    shell.state.session.set(session)
    made = ExportPage()
    qtbot.addWidget(made)
    made.use(shell)

    def make(name: str, task: str, request: Mapping[str, Any]) -> Job:
        requests.append({"task": task, **request})
        result = {"page": request["to"]} if task == "report" else {"to": request["to"]}
        return job(f'emit("done", result={result!r})', name, task, request)

    made.errand._make_job = make
    made.resize(1100, 700)
    made.show()
    until(qtbot, lambda: made.go.isEnabled() or made.empty.isVisible())
    return made


def test_every_format_is_offered_with_frame_units_and_size(page: ExportPage) -> None:
    lines = [page.table.topLevelItem(row) for row in range(page.table.topLevelItemCount())]
    assert len(lines) == len(page.keys()) + 1 == 17
    # This object is all of paint: its export has no maps of materials.
    (absent,) = [line for line in lines if line.isDisabled()]
    assert absent.checkState(0) == Qt.CheckState.Unchecked
    assert "metalness" in absent.text(0).lower() + absent.text(1).lower() + absent.toolTip(0)
    for line in lines:
        assert all(line.text(column) for column in range(4 if line is absent else 5)), line.text(0)
        assert "{" not in line.text(3)
    assert lines[0].text(2) == "camera: x right, y down, z forward"
    assert "metre" in lines[0].text(3)
    assert page.state.text() == "up to date"
    assert not page.grab().isNull()


def test_all_formats_and_the_flip_are_asked_for(
    page: ExportPage,
    requests: list[Mapping[str, Any]],
    session: Path,
    shell: Shell,
    qtbot: QtBot,
    tmp_path: Path,
) -> None:
    said: list[str] = []
    shell.wishes.say.connect(said.append)
    page.to.setText(str(tmp_path / "out"))
    page.greens["down"].click()
    page.go.click()
    until(qtbot, lambda: said)
    assert requests == [
        {
            "task": "export",
            "session": str(session),
            "to": str(tmp_path / "out"),
            "green": "down",
            "files": None,
        }
    ]
    assert str(tmp_path / "out") in said[0]
    until(qtbot, lambda: page.go.isEnabled())


def test_a_format_that_is_not_ticked_is_left_out(
    page: ExportPage, requests: list[Mapping[str, Any]], qtbot: QtBot
) -> None:
    for row in range(page.table.topLevelItemCount()):
        line = page.table.topLevelItem(row)
        if line.text(0) != "surface.glb":
            line.setCheckState(0, Qt.CheckState.Unchecked)
    page.action.trigger()
    until(qtbot, lambda: requests)
    assert requests[0]["files"] == ["surface.glb"]
    assert requests[0]["green"] == "up"


def test_the_format_that_is_chosen_is_shown(page: ExportPage, qtbot: QtBot) -> None:
    line = {page.table.topLevelItem(row).text(0): page.table.topLevelItem(row) for row in range(17)}
    assert page.preview.isHidden()
    page.table.setCurrentItem(line["surface.glb"])
    until(qtbot, page.preview.isVisible)
    assert page.preview.said.text() == "surface.glb"
    page.table.setCurrentItem(line["transforms.json"])
    until(qtbot, page.preview.isHidden)
    page.table.setCurrentItem(line["light.ply"])
    until(qtbot, page.preview.isVisible)
    page.resize(900, 560)
    until(qtbot, page.preview.isHidden)  # what can be chosen comes first


def test_a_program_ticks_what_it_reads_and_turns_green(page: ExportPage) -> None:
    everything = page.keys()
    page.target.setCurrentIndex(page.target.findData("unreal"))
    page.target.activated.emit(page.target.currentIndex())
    # The map of materials is not there, and stays unticked.
    assert page.keys() == set(TARGETS["unreal"].formats) - {"materials"}
    assert page.green() == "down"
    page.target.activated.emit(page.target.findData("all"))
    assert page.keys() == everything
    assert page.green() == "up"


def test_nothing_ticked_or_no_folder_is_nothing_to_export(page: ExportPage) -> None:
    page.to.setText(" ")
    assert not page.go.isEnabled()
    page.to.setText("/s/out")
    assert page.go.isEnabled()
    for row in range(page.table.topLevelItemCount()):
        page.table.topLevelItem(row).setCheckState(0, Qt.CheckState.Unchecked)
    assert not page.go.isEnabled()


def test_results_older_than_the_settings_send_to_the_process_page(
    page: ExportPage, questions: Finished, session: Path, shell: Shell, qtbot: QtBot
) -> None:
    questions.stages_done = 5
    page.show_session(session)
    until(qtbot, lambda: page.empty.isVisible())
    assert not page.go.isEnabled()
    assert page.empty.remedy.text() == "Process first"
    with qtbot.waitSignal(shell.wishes.show_page) as asked:
        page.empty.buttons[0].click()
    assert asked.args == ["process"]


def test_a_refused_export_is_told(page: ExportPage, qtbot: QtBot) -> None:
    failing = 'emit("failed", message="/s/out: holds 3 files that no export wrote; name a new folder")'
    page.errand._make_job = lambda name, task, request: job(failing, name, task, request)
    page.go.click()
    until(qtbot, lambda: page.findChildren(TroubleDialog))
    (dialog,) = page.findChildren(TroubleDialog)
    assert dialog.trouble.remedy == "name a new folder"
    dialog.close()


def test_the_report_is_written_and_opened(
    page: ExportPage, requests: list[Mapping[str, Any]], monkeypatch: pytest.MonkeyPatch, qtbot: QtBot
) -> None:
    opened = []
    monkeypatch.setattr(QDesktopServices, "openUrl", opened.append)
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *asked: ("", ""))
    page.report.click()
    assert requests == []  # asked where to, and declined
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *asked: ("/s/report.html", ""))
    page.report.click()
    until(qtbot, lambda: opened)
    assert opened[0].toLocalFile() == "/s/report.html"
    assert "/s/report.html" in page.state.text()


def test_an_export_under_way_is_stopped_from_its_page_which_stays_as_it_is(
    page: ExportPage, shell: Shell, qtbot: QtBot
) -> None:
    page.errand._make_job = lambda name, task, request: job(WILLING, name, task, request)
    active(page, qtbot)
    page.go.setFocus()
    foot = page.to.mapTo(page, page.to.rect().center()).y()
    page.go.click()
    until(qtbot, lambda: shell.board.active and page.errand.cancel.isVisible())
    assert page.errand.cancel.hasFocus()
    assert abs(page.to.mapTo(page, page.to.rect().center()).y() - foot) <= 1
    page.errand.cancel.click()
    until(qtbot, lambda: not shell.board.active)
    assert page.go.hasFocus()


def test_the_verdict_of_what_would_be_exported_is_told(page: ExportPage) -> None:
    page._take(page._newest, None, "", Quality(GOOD, 0.4, "nothing speaks against it.", ""))
    assert page.verdict.text() == "<b>Quality: good.</b> Nothing speaks against it."
    page.show_session(None)
    assert page.verdict.isHidden()


def test_files_that_a_run_makes_meanwhile_are_offered_without_leaving_the_page(
    page: ExportPage, questions: Finished, session: Path, shell: Shell, qtbot: QtBot
) -> None:
    questions.stages_done = 5
    page.show_session(session)
    until(qtbot, page.empty.isVisible)
    questions.stages_done = 6
    shell.board.enqueue(job('emit("done", result={})', "lion", "process", {"session": str(session)}))
    until(qtbot, page.go.isEnabled)
