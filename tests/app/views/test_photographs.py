"""The photographs page: looked at before anything is computed, left out by tick, key and undo, told where it cannot be."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from app import photographs
from app.photographs import Look, Photograph
from app.settings import Settings
from app.state import State, Trouble, trouble
from app.views.pages import Shell, Wishes
from app.views.photographs import page as pages
from app.views.photographs.page import PhotographsPage
from app.views.photographs.sheet import LOOK, PIXMAP, mark
from app.work import answers
from app.work.enquiries import Answer
from app.work.queue import Board
from engine.errors import RoomlightError
from engine.io import left_out
from engine.io import session as sessions
from tests.app import sessions as small
from tests.app.views.conftest import active, until
from tests.app.views.test_habits import keyless, nameless, unreachable

Key = Qt.Key


class Looker:
    """Stands in for the child: looks at once, in the window's thread."""

    last: "Looker"

    def __init__(self) -> None:
        self.asked: list[tuple[str, str]] = []
        self.closed = False
        Looker.last = self

    def ask(self, question: str, then: Any, **facts: Any) -> int:
        self.asked.append((question, facts["shot"]))
        try:
            then(
                Answer(
                    {"look": answers.photograph.look, "photograph": answers.photograph.show}[question](facts)
                )
            )
        except RoomlightError as error:
            then(Answer(None, trouble(str(error))))
        return 0

    def close(self) -> None:
        self.closed = True


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small.small(tmp_path_factory.mktemp("photographs"))


@pytest.fixture
def session(imported: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(imported, tmp_path / "lion.session"))


@pytest.fixture
def page(qtbot: QtBot, session: Path, monkeypatch: pytest.MonkeyPatch) -> PhotographsPage:
    monkeypatch.setattr(pages, "Enquiries", Looker)
    shell = Shell(State(), Board(), Settings(), Looker(), Wishes())  # type: ignore[arg-type]
    made = PhotographsPage(None)
    qtbot.addWidget(made)
    made.use(shell)
    made.resize(900, 600)
    made.show()
    made.show_session(session)
    until(qtbot, lambda: made.sheet.count() == small.VIEWS)
    return made


def out(session: Path) -> set[str]:
    return set(left_out.read(sessions.open_session(session)))


def test_photographs_are_looked_at_before_anything_is_computed(
    page: PhotographsPage, session: Path, qtbot: QtBot
) -> None:
    assert not list((session / "stages").iterdir())
    until(qtbot, lambda: all(page.sheet.item(row).data(PIXMAP) is not None for row in range(small.VIEWS)))
    until(qtbot, lambda: page.view.full is not None and page.view.full.width() == small.WIDTH)
    assert page.told.text() == "8 photographs"
    assert page.facts.values["pose"].text() == "not looked for yet"
    assert page.facts.name.text() == "0000  (1 of 8)"
    assert nameless(page) == unreachable(page) == keyless(page) == []
    # Another page, another day: nothing is looked at again.
    again = PhotographsPage(None)
    qtbot.addWidget(again)
    again.show()
    again.show_session(session)
    until(
        qtbot,
        lambda: again.sheet.count() and all(again.sheet.item(row).data(LOOK) for row in range(small.VIEWS)),
    )
    assert {question for question, _ in Looker.last.asked} == {"photograph"}


def test_keys_leave_out_and_undo_puts_back(page: PhotographsPage, session: Path, qtbot: QtBot) -> None:
    active(page, qtbot)
    page.sheet.setFocus()
    qtbot.keyClick(page.sheet, Key.Key_Right)
    qtbot.keyClick(page.sheet, Key.Key_Space)
    until(qtbot, lambda: out(session) == {"0001"})
    assert page.facts.out.isChecked()
    assert "1 left out" in page.told.text()
    qtbot.keyClick(page, Key.Key_PageDown)
    assert not page.facts.out.isChecked()
    page.facts.out.click()
    until(qtbot, lambda: out(session) == {"0001", "0002"})
    page.undo_stack.undo()
    page.undo_stack.undo()
    until(qtbot, lambda: not (session / "edits" / left_out.FILE).exists())
    cell = page.sheet.visualItemRect(page.sheet.item(0))
    qtbot.mouseClick(page.sheet.viewport(), Qt.MouseButton.LeftButton, pos=mark(cell).center())
    until(qtbot, lambda: out(session) == {"0000"})


def test_while_a_run_is_under_way_nothing_changes_and_it_is_told_why(
    page: PhotographsPage, session: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Trouble] = []
    monkeypatch.setattr(page, "_tell", told.append)
    with sessions.lock(sessions.open_session(session)):
        page.facts.out.click()
        until(qtbot, lambda: told and not page.facts.out.isChecked())
    assert "is working on this session" in told[0].what
    assert out(session) == set()
    assert not page.undo_stack.canUndo()


def test_what_was_left_out_last_is_written_when_the_window_goes(
    page: PhotographsPage, session: Path, qtbot: QtBot
) -> None:
    page._background._pool.shutdown()  # the thread is at something else
    page._background.ask = lambda *rest: None  # type: ignore[method-assign]
    page.facts.out.click()
    page.close()
    assert out(session) == {"0000"}
    assert Looker.last.closed


def test_blurred_and_clipped_ones_can_come_first(page: PhotographsPage, qtbot: QtBot) -> None:
    until(qtbot, lambda: all(page.sheet.item(row).data(LOOK) for row in range(small.VIEWS)))
    for row, blur in ((3, 2.5), (6, 3.5)):
        page.sheet.item(row).setData(LOOK, Look(blur, 0.5 if row == 3 else 0.0, 0.0))
    for row in set(range(small.VIEWS)) - {3, 6}:
        page.sheet.item(row).setData(LOOK, Look(1.0, 0.0, 0.0))
    for key, expected in (
        ("blur", ["0006", "0003", "0000"]),
        ("clipped", ["0003", "0000", "0001"]),
        ("taken", ["0000", "0001", "0002"]),
    ):
        page.order.setCurrentIndex(page.order.findData(key))
        page.order.activated.emit(page.order.currentIndex())
        assert [page.sheet.photograph(row).name for row in range(3)] == expected


def test_a_file_that_cannot_be_read_is_told_and_the_others_are_shown(
    page: PhotographsPage, session: Path, qtbot: QtBot
) -> None:
    file = session / "shots" / "0002" / "radiance.exr"
    file.write_bytes(b"x" * file.stat().st_size)
    page.sheet.setCurrentRow(2)
    until(qtbot, lambda: "0002/radiance.exr" in page.view.message)
    page.view.show_small(page.sheet.photograph(1))  # a small picture that comes late does not hide it
    until(qtbot, lambda: not page._background.busy)
    assert "0002/radiance.exr" in page.view.message


def test_a_captured_photograph_can_be_taken_again(page: PhotographsPage, session: Path, qtbot: QtBot) -> None:
    assert page.facts.again.isHidden()  # imported
    (session / "capture").mkdir()
    (session / "capture" / "order.json").write_text("{}")
    page.show_session(session)
    until(qtbot, lambda: not page.facts.again.isHidden())
    page.sheet.setCurrentRow(4)
    page.facts.again.click()
    until(qtbot, lambda: page.sheet.count() == small.VIEWS - 1)
    assert not (session / "shots" / "0004").exists()
    page.undo_stack.undo()
    until(qtbot, lambda: page.sheet.count() == small.VIEWS)
    assert (session / "shots" / "0004" / "shot.json").exists()


def test_camera_and_time_are_told_by_the_cameras_own_clock() -> None:
    facts = [
        {"shutter_s": shutter, "iso": 100, "aperture": 8.0, "time_s": 1.7e9 + shutter}
        for shutter in (0.01, 0.1)
    ]
    photograph = Photograph("a", 1, "0000", tuple(facts), None, None, Path("a"))
    assert photographs.told_camera(photograph) == "ISO 100  f/8"
    assert photographs.told_time(photograph) == "2023-11-14  22:13:20"
    nothing = Photograph("a", 1, "0000", ({},), None, None, Path("a"))
    assert photographs.told_camera(nothing) == photographs.told_time(nothing) == ""
