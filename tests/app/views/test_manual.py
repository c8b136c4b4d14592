"""F1 opens the page of what is shown; every page is there, leads on, and tells the keys that there are."""

import re

import pytest
from PySide6.QtCore import Qt, QUrl
from pytestqt.qtbot import QtBot

from app.views import rail
from app.views.main_window import MainWindow
from app.views.manual.window import PAGES_AT, ManualWindow
from app.views.pages import PAGES, PageRow
from tests.app.views.conftest import active, until


def opened(window: MainWindow, qtbot: QtBot) -> ManualWindow:
    active(window, qtbot)
    qtbot.keyClick(window, Qt.Key.Key_F1)
    until(qtbot, lambda: window.findChildren(ManualWindow))
    (manual,) = window.findChildren(ManualWindow)
    return manual


def heading(manual: ManualWindow) -> str:
    return manual.browser.toPlainText().splitlines()[0]


def test_f1_opens_the_page_of_what_is_shown_in_one_window(window: MainWindow, qtbot: QtBot) -> None:
    window.show_page("mask")
    manual = opened(window, qtbot)
    assert manual.isVisible()
    assert manual.isWindow()
    assert heading(manual) == "Mask"
    assert "Smaller brush" in manual.browser.toPlainText()  # a key, as the page has it
    window.show_page("view3d")
    assert opened(window, qtbot) is manual
    assert heading(manual) == "3D"
    manual.browser.anchorClicked.emit(QUrl("relight.md"))
    assert heading(manual) == "Relight"
    assert manual.contents.currentItem().text() == "Relight"
    qtbot.keyClick(manual, Qt.Key.Key_Escape)
    assert not manual.isVisible()


@pytest.mark.parametrize("row", PAGES, ids=lambda row: row.key)
def test_every_item_of_the_rail_has_a_page_whose_links_lead_to_pages(row: PageRow) -> None:
    text = (PAGES_AT / f"{row.key}.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {rail.title(row)}\n")
    assert {"## What to do", "## What the marks mean"} <= set(text.splitlines()) or row.key == "maps"
    for link in re.findall(r"\]\(([^)]*)\)", text):
        assert link.removesuffix(".md") in {other.key for other in PAGES}
