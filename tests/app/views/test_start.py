"""The start page shows the sessions of late and passes on what a person wants."""

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage
from pytestqt.qtbot import QtBot

from app.recent import Glance
from app.views.pages import Shell
from app.views.start.cards import GLANCE, PHOTO, told_state
from app.views.start.page import StartPage
from tests.app.plans import Questions
from tests.app.views.conftest import make_session, until


@pytest.fixture
def page(shell: Shell, qtbot: QtBot, tmp_path: Path) -> StartPage:
    for name in ("bear", "lion"):
        shell.settings.opened(make_session(tmp_path / f"{name}.session"))
    made = StartPage()
    qtbot.addWidget(made)
    made.use(shell)
    made.show()
    return made


def glance(page: StartPage, row: int) -> Glance:
    return page.list.item(row).data(GLANCE)


def test_the_latest_session_comes_first_with_its_state(page: StartPage, qtbot: QtBot) -> None:
    until(qtbot, lambda: all(glance(page, row).changed for row in range(2)))
    assert [page.list.item(row).text() for row in range(2)] == ["lion", "bear"]
    said = page.list.item(0).data(Qt.ItemDataRole.AccessibleTextRole)
    assert said == "lion, 0 views, not processed"
    assert not page.empty.isVisible()


def test_a_picture_that_is_there_is_shown(page: StartPage, qtbot: QtBot, tmp_path: Path) -> None:
    latest = tmp_path / "lion.session" / "exports" / "latest"
    latest.mkdir(parents=True)
    picture = QImage(40, 30, QImage.Format.Format_RGB32)
    picture.fill(Qt.GlobalColor.red)
    assert picture.save(str(latest / "photograph.png"))
    page.refresh()
    until(qtbot, lambda: page.list.item(0).data(PHOTO) is not None)
    assert page.list.item(0).data(PHOTO).toImage().pixelColor(10, 10) == Qt.GlobalColor.red
    assert not page.grab().isNull()


def test_a_session_without_a_picture_asks_for_one_once(
    page: StartPage, qtbot: QtBot, tmp_path: Path, questions: Questions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.views.start.page.LATER_MS", 0)
    (tmp_path / "lion.session" / "shots" / "0000").mkdir()
    (tmp_path / "lion.session" / "shots" / "0000" / "shot.json").write_text("{}")
    page.refresh()
    until(qtbot, lambda: questions.asked)
    page.refresh()
    until(qtbot, lambda: glance(page, 0).views == 1)
    qtbot.wait(50)
    asked = [question for question in questions.asked if question["question"] == "thumbnail"]
    assert [question["session"] for question in asked] == [str(tmp_path / "lion.session")]


def test_a_session_that_is_gone_is_said_to_be(page: StartPage, qtbot: QtBot, tmp_path: Path) -> None:
    (tmp_path / "bear.session" / "session.json").unlink()
    page.refresh()
    until(qtbot, lambda: not glance(page, 1).there)
    assert "not there now" in page.list.item(1).data(Qt.ItemDataRole.AccessibleTextRole)


def test_return_opens_a_session_and_del_forgets_it_until_that_is_undone(
    page: StartPage, shell: Shell, qtbot: QtBot, tmp_path: Path
) -> None:
    opened: list[Path] = []
    shell.wishes.open_session.connect(opened.append)
    page.list.setFocus()
    page.list.setCurrentRow(1)
    qtbot.keyClick(page.list, Qt.Key.Key_Return)
    assert opened == [tmp_path / "bear.session"]
    before = shell.settings.value.recent
    page.list.actions()[-1].trigger()
    assert shell.settings.value.recent == (str(tmp_path / "lion.session"),)
    assert page.list.count() == 1
    assert (tmp_path / "bear.session").is_dir()
    page.undo_stack.undo()
    assert shell.settings.value.recent == before
    assert page.list.count() == 2


def test_the_tiles_say_what_is_wanted(page: StartPage, shell: Shell, qtbot: QtBot) -> None:
    with qtbot.waitSignal(shell.wishes.new_capture):
        page.new_capture.click()
    with qtbot.waitSignal(shell.wishes.ask_session):
        page.open.click()
    with qtbot.waitSignal(shell.wishes.add_photographs):
        page.add.click()


def test_without_sessions_the_page_says_how_to_begin(shell: Shell, qtbot: QtBot) -> None:
    page = StartPage()
    qtbot.addWidget(page)
    page.use(shell)
    page.show()
    assert page.empty.isVisible()
    assert not page.list.isVisible()


@pytest.mark.parametrize(
    ("facts", "told"),
    [
        ({"views": 1}, "1 view, not processed"),
        ({"views": 48, "finished": ("hdr", "segment")}, "48 views, Mask done, 4 stages left"),
        ({"views": 48, "finished": ("hdr", "export")}, "48 views, processed"),
        ({"views": 5, "planned": 12}, "capture: 5 of 12 poses"),
    ],
)
def test_states_are_told_in_a_few_words(qtbot: QtBot, facts: dict, told: str) -> None:
    assert told_state(Glance(Path("/s/lion.session"), True, **facts)) == told
