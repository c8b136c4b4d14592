"""The window's menus: every action that is not a page's own, with its shortcut."""

from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Qt, QUrl
from PySide6.QtGui import QAction, QActionGroup, QDesktopServices, QKeySequence
from PySide6.QtWidgets import QMenu, QMessageBox

from app import crash
from app.views import rail, theme
from app.views.pages import PAGES
from app.views.preferences import PreferencesDialog

if TYPE_CHECKING:
    from app.views.main_window import MainWindow

MOST_RECENT = 10
Keys = QKeySequence.StandardKey


class Menus(QObject):
    """Fills a window's menu bar."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._window = window
        bar = window.menuBar()
        self._file(bar.addMenu(self.tr("&File")))
        self._edit(bar.addMenu(self.tr("&Edit")))
        self._view(bar.addMenu(self.tr("&View")))
        self._help(bar.addMenu(self.tr("&Help")))

    def _file(self, menu: QMenu) -> None:
        window = self._window
        self._add(menu, self.tr("&New capture"), Keys.New, window.shell.wishes.new_capture.emit)
        self._add(menu, self.tr("&Open session…"), Keys.Open, window.ask_session)
        self.recent = menu.addMenu(self.tr("&Recent sessions"))
        self.recent.aboutToShow.connect(self._fill_recent)
        self._add(menu, self.tr("&Import photographs…"), "Ctrl+I", lambda: window.add_photographs(None))
        self._add(menu, self.tr("&Simulate photographs…"), None, window.simulate)
        menu.addSeparator()
        self._add(menu, self.tr("&Export…"), "Ctrl+E", lambda: window.show_page("export"))
        menu.addSeparator()
        self.close_session = self._add(menu, self.tr("&Close session"), Keys.Close, window.close_session)
        self.close_session.setEnabled(False)
        self._add(menu, self.tr("&Quit"), Keys.Quit, window.close)

    def _edit(self, menu: QMenu) -> None:
        undo = self._window.undo.createUndoAction(self._window, self.tr("Undo"))
        redo = self._window.undo.createRedoAction(self._window, self.tr("Redo"))
        undo.setShortcut(Keys.Undo)
        # Their texts name the edit there is to undo; the sheet of shortcuts does not.
        undo.setWhatsThis(self.tr("Undo"))
        redo.setWhatsThis(self.tr("Redo"))
        redo.setShortcut(Keys.Redo)
        menu.addActions([undo, redo])
        menu.addSeparator()
        self._add(menu, self.tr("&Preferences…"), "Ctrl+,", self._preferences)

    def _view(self, menu: QMenu) -> None:
        for row in PAGES:
            self._add(menu, rail.title(row), row.shortcut, lambda key=row.key: self._window.show_page(key))
        menu.addSeparator()
        themes, group = menu.addMenu(self.tr("&Theme")), QActionGroup(self)
        chosen = self._window.shell.settings.preferences
        for name, text in theme.TITLES.items():
            action = self._add(themes, theme.title(text), None, partial(self._choose_theme, name))
            action.setCheckable(True)
            action.setChecked(chosen.value.theme == name)
            group.addAction(action)
            # It can be chosen among the preferences too.
            chosen.listen(lambda now, action=action, name=name: action.setChecked(now.theme == name))
        self._add(menu, self.tr("&Full screen"), "F11", self._full_screen)

    def _help(self, menu: QMenu) -> None:
        self._add(menu, self.tr("&Manual"), Keys.HelpContents, self._window.show_manual)
        self._add(menu, self.tr("&Keyboard shortcuts"), "?", self._window.show_shortcuts)
        self._add(menu, self.tr("&Crash reports"), None, self._show_crashes)
        self._add(menu, self.tr("&About Roomlight"), None, self._about)

    def _add(self, menu: QMenu, text: str, keys: Keys | str | None, do: Callable[[], object]) -> QAction:
        action = QAction(text, self._window)
        if keys is not None:
            action.setShortcut(keys)
        action.triggered.connect(lambda checked=False: do())
        menu.addAction(action)
        return action

    def _preferences(self) -> None:
        PreferencesDialog(self._window, self._window.shell, self._window.show_shortcuts).open()

    def _choose_theme(self, name: theme.Theme) -> None:
        self._window.shell.settings.change(theme=name)
        theme.choose(name)

    def _fill_recent(self) -> None:
        self.recent.clear()
        for text in self._window.shell.settings.value.recent[:MOST_RECENT]:
            action = self.recent.addAction(text.replace("&", "&&"))
            action.triggered.connect(lambda checked=False, text=text: self._window.go_to_session(Path(text)))

    def _full_screen(self) -> None:
        # The state beside it is kept: a maximised window is one again afterwards.
        self._window.setWindowState(self._window.windowState() ^ Qt.WindowState.WindowFullScreen)

    def _show_crashes(self) -> None:
        if crash.folder().is_dir():
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(crash.folder())))
        else:
            self._window.shell.wishes.say.emit(self.tr("There are no crash reports"))

    def _about(self) -> None:
        box = QMessageBox(
            QMessageBox.Icon.Information,
            self.tr("About Roomlight"),
            self.tr("Roomlight {0}").format(version("roomlight")),
            parent=self._window,
        )
        box.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        box.setInformativeText(
            self.tr(
                "Shape and reflectance of an object, from the light of the room it stands in. Apache-2.0."
            )
        )
        box.setDetailedText(crash.facts())
        box.open()
