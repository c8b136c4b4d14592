"""The manual: one page for each item of the rail, beside this module as Markdown, and the keys as the window has them."""

from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QEvent, Qt, QUrl
from PySide6.QtGui import QTextBlockFormat, QTextCursor
from PySide6.QtWidgets import QDialog, QHBoxLayout, QListWidget, QListWidgetItem, QTextBrowser, QWidget

from app.views import rail, theme
from app.views.pages import PAGES
from app.views.shortcuts import Shortcut, table

PAGES_AT = Path(__file__).parent
KEY = Qt.ItemDataRole.UserRole
LIST_WIDTH = 150


class ManualWindow(QDialog):
    """A window of its own, which may stay open beside the other; `keys` tells those of a page."""

    def __init__(self, parent: QWidget, keys: Callable[[str], Sequence[Shortcut]]) -> None:
        super().__init__(parent, Qt.WindowType.Window)
        self._keys = keys
        self.setWindowTitle(self.tr("Manual"))
        self.resize(780, 620)
        self.contents = QListWidget()
        self.contents.setAccessibleName(self.tr("Pages of the manual"))
        self.contents.setFixedWidth(LIST_WIDTH)
        self.contents.setSpacing(3)
        for row in PAGES:
            item = QListWidgetItem(rail.title(row), self.contents)
            item.setData(KEY, row.key)
        self.contents.currentRowChanged.connect(self._open)
        self.browser = QTextBrowser()
        self.browser.setAccessibleName(self.windowTitle())
        self.browser.setOpenLinks(False)
        self.browser.document().setDocumentMargin(18)
        self.browser.anchorClicked.connect(lambda link: self.show_key(QUrl(link).path().removesuffix(".md")))
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.contents)
        layout.addWidget(self.browser, 1)
        self.browser.setFocus()  # its keys turn the page

    def show_key(self, key: str) -> None:
        """The page of this item of the rail."""
        self.contents.setCurrentRow([row.key for row in PAGES].index(key))

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "browser"):
            self._open(self.contents.currentRow())

    def _open(self, row: int) -> None:
        if row < 0:
            return
        key = PAGES[row].key
        self.browser.setMarkdown((PAGES_AT / f"{key}.md").read_text(encoding="utf-8"))
        end = self.browser.textCursor()
        end.movePosition(QTextCursor.MoveOperation.End)
        end.insertBlock(QTextBlockFormat())  # out of the list that the text may end with
        end.insertHtml(table(self._keys(key), theme.colours(self)))
        self.browser.moveCursor(QTextCursor.MoveOperation.Start)
