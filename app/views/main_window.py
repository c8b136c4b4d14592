"""The window: a rail of pages, each loaded when first shown, menus, a status bar; opening, dropping, closing.

Importing this module loads PySide6 and light modules alone; `tests/app/views/test_main_window.py` holds it to that.
"""

from collections.abc import Iterable
from pathlib import Path

from PySide6.QtCore import QByteArray, Qt, QTimer
from PySide6.QtGui import (
    QAction,
    QCloseEvent,
    QDragEnterEvent,
    QDragLeaveEvent,
    QDropEvent,
    QUndoGroup,
    QUndoStack,
)
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QMainWindow, QStackedWidget, QWidget

from app.settings import Settings
from app.state import State, Trouble, called, place_of, trouble
from app.views import pages, rail, shortcuts
from app.views.bridge import Bridge
from app.views.closing import Closing
from app.views.demo import Demo
from app.views.drop_mark import DropMark
from app.views.manual.window import ManualWindow
from app.views.menus import Menus
from app.views.notice import Notice
from app.views.pages import PAGES, Shell, UsesShell, Wishes
from app.views.shortcuts import Shortcut, ShortcutsDialog
from app.views.status import StatusBar
from app.views.trouble import show_trouble
from app.work import queue_file
from app.work.enquiries import Enquiries
from app.work.queue import Board
from engine.errors import RoomlightError
from engine.io.session import open_session

SHOWS = {
    "desk": "capture", "relight": "relight", "relit": "relight", "panorama": "relight", "rerender": "maps", "coverage": "charts",
    "export": "export", "report": "export",
}  # fmt: skip
"""Task -> the page that shows it; the others are shown by the Process page."""


class MainWindow(QMainWindow):
    """Owns the shell: state, jobs, settings, questions."""

    def __init__(self, settings: Settings, enquiries: Enquiries | None = None) -> None:
        super().__init__()
        self.shell = Shell(State(), Board(), settings, enquiries or Enquiries(), Wishes(self))
        self._bridge = Bridge(self)
        self._pages: dict[str, QWidget] = {}
        self._manual: ManualWindow | None = None
        self._kept = False  # the queue file is final
        self.closing = Closing(self, self.shell.board)
        self.demo = Demo(self)
        self.undo = QUndoGroup(self)
        self._no_edits = QUndoStack(self)  # of pages that edit nothing
        self.rail = rail.Rail(self, PAGES)
        self.stack = QStackedWidget()
        middle = QWidget()
        row = QHBoxLayout(middle)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        row.addWidget(self.rail)
        row.addWidget(self.stack, 1)
        self.setCentralWidget(middle)
        self.status = StatusBar(self, self.shell.state, self.shell.board)
        self.setStatusBar(self.status)
        self.setAcceptDrops(True)
        self.drop_mark = DropMark(self)
        self.notice = Notice(self)
        self.setMinimumSize(900, 560)
        self.resize(1240, 780)
        self.menus = Menus(self)
        self._connect()
        self._title()
        self._choose_keys(shortcuts.collect([(self.tr("Everywhere"), self)]), self.rail)
        self.restoreGeometry(QByteArray.fromHex(settings.value.window.encode()))
        self.show_page("start")
        if settings.notice is not None:
            self.status.say(settings.notice.what)
        self._bring_back_queue()

    # --- pages

    def page(self, key: str) -> QWidget:
        """The page, loaded if it is not yet."""
        if key not in self._pages:
            row = next(row for row in PAGES if row.key == key)
            page = pages.load(row)(self)
            self._pages[key] = page
            self.stack.addWidget(page)
            stack = getattr(page, "undo_stack", None)
            if isinstance(stack, QUndoStack):
                self.undo.addStack(stack)
            if isinstance(page, UsesShell):
                page.use(self.shell)
            self._show_session_on(page)
            self._choose_keys(self._keys_of(key), page)
        return self._pages[key]

    def show_page(self, key: str) -> None:
        page = self.page(key)
        self.stack.setCurrentWidget(page)
        self.rail.show_key(key)
        stack = getattr(page, "undo_stack", None)
        self.undo.setActiveStack(stack if isinstance(stack, QUndoStack) else self._no_edits)
        self._title()

    # --- sessions

    def open_session(self, folder: Path) -> bool:
        """Make a session the open one; tells why where it cannot be."""
        place = place_of(folder)
        try:
            open_session(place.folder)
        except RoomlightError as error:
            self.tell(trouble(str(error)))
            return False
        self.shell.settings.opened(place.folder)
        self.shell.state.session.set(place.folder)
        self.status.say(self.tr("{0} is open").format(called(place.folder)))
        return True

    def go_to_session(self, folder: Path) -> None:
        """Open a session and turn to where its work goes on."""
        if self.open_session(folder) and self.stack.currentWidget() is self._pages.get("start"):
            self.show_page("process")

    def new_capture(self) -> None:
        """Turn to the capture page, for a new session."""
        page = self.page("capture")
        self.show_page("capture")
        begin = getattr(page, "new_capture", None)
        if begin is not None:
            begin()

    def ask_session(self) -> None:
        """Ask for a session's folder and open it."""
        said = QFileDialog.getExistingDirectory(
            self, self.tr("Open a session"), self.shell.settings.value.last_folder
        )
        if said:
            self.shell.settings.change(last_folder=str(Path(said).parent))
            self.go_to_session(Path(said))

    def close_session(self) -> None:
        self.shell.state.session.set(None)
        self.show_page("start")

    def add_photographs(self, folder: Path | None) -> None:
        """Ask for what an import needs."""
        from app.views.importing import ImportDialog

        ImportDialog(self, self.shell, folder).open()

    def simulate(self) -> None:
        """Ask for what a simulation needs."""
        from app.views.simulating import SimulateDialog

        SimulateDialog(self, self.shell).open()

    def tell(self, trouble: Trouble) -> None:
        show_trouble(self, trouble)

    def _session_changed(self, folder: Path | None) -> None:
        for page in self._pages.values():
            self._show_session_on(page)
        self.menus.close_session.setEnabled(folder is not None)
        self._title()

    def _show_session_on(self, page: QWidget) -> None:
        show = getattr(page, "show_session", None)
        if show is not None:
            show(self.shell.state.session.value)

    def _title(self) -> None:
        folder = self.shell.state.session.value
        self.setWindowFilePath(str(folder) if folder is not None else "")
        name = "" if folder is None else f"{folder} - "
        self.setWindowTitle(f"{name}Roomlight")

    # --- building

    def _connect(self) -> None:
        wishes = self.shell.wishes
        wishes.ask_session.connect(self.ask_session)
        wishes.open_session.connect(self.go_to_session)
        wishes.show_page.connect(self.show_page)
        wishes.say.connect(self.status.say)
        wishes.trouble.connect(self.tell)
        wishes.new_capture.connect(self.new_capture)
        wishes.open_demo.connect(self.demo.open)
        wishes.add_photographs.connect(self.add_photographs)
        wishes.simulate.connect(self.simulate)
        self.rail.chosen.connect(self.show_page)
        self.status.show_job.connect(self._show_job)
        self.shell.state.session.listen(self._session_changed)
        self.shell.board.listen(self._bridge.latest(self._keep_queue))
        self.closing.stopping.connect(self._stopping)
        self.closing.stopped.connect(self.close)

    def _show_job(self) -> None:
        active = self.shell.board.active
        self.show_page(SHOWS.get(active[0].task, "process") if active else "process")

    def show_shortcuts(self) -> None:
        """The sheet of every shortcut of the window and its pages, and of what the mouse does."""
        everywhere = self.tr("Everywhere")
        groups: list[tuple[str, QWidget]] = [(rail.title(row), self.page(row.key)) for row in PAGES]
        # Pages are children of the window too: what is theirs is listed under their names first.
        found = shortcuts.collect([*groups, (everywhere, self)])
        keys = sorted(found, key=lambda shortcut: shortcut.group != everywhere)

        def change(name: str | None, chosen: str) -> None:
            settings = self.shell.settings
            settings.change(shortcuts={} if name is None else {**settings.value.shortcuts, name: chosen})
            self._choose_keys(keys, self.rail, *self._pages.values())

        ShortcutsDialog(self, [*keys, *shortcuts.mouse()], change).open()

    def show_manual(self) -> None:
        """The manual's page on the page that is shown."""
        if self._manual is None:
            self._manual = ManualWindow(self, self._keys_of)
        shown = self.stack.currentWidget()
        self._manual.show_key(next(key for key, page in self._pages.items() if page is shown))
        self._manual.show()
        self._manual.raise_()
        self._manual.activateWindow()

    def _choose_keys(self, found: Iterable[Shortcut], *parts: QWidget) -> None:
        """Give these the keys that the person chose; `parts` name them."""
        shortcuts.choose(found, self.shell.settings.value.shortcuts)
        everywhere = shortcuts.replaced(
            self.findChildren(QAction, options=Qt.FindChildOption.FindDirectChildrenOnly)
        )
        for part in parts:
            shortcuts.retell(part, everywhere | shortcuts.replaced(part.findChildren(QAction)))

    def _keys_of(self, key: str) -> tuple[Shortcut, ...]:
        row = next(row for row in PAGES if row.key == key)
        return shortcuts.collect([(rail.title(row), self.page(key))])

    # --- drag and drop

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        paths = (Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile())
        place = next((place for place in map(place_of, paths) if place.kind != "nothing"), None)
        if place is not None:
            event.acceptProposedAction()
            self.drop_mark.show_place(place)

    def dragLeaveEvent(self, event: QDragLeaveEvent) -> None:
        self.drop_mark.hide()

    def dropEvent(self, event: QDropEvent) -> None:
        event.acceptProposedAction()
        self.drop_mark.hide()
        # Dialogs open when the drop is over: the other program waits for its end.
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        QTimer.singleShot(0, self, lambda: self.take_dropped(paths))

    def take_dropped(self, paths: list[Path]) -> None:
        """A session is opened, anything else is photographs to import; of several, the first."""
        for path in paths:
            place = place_of(path)
            if place.kind == "session":
                self.go_to_session(place.folder)
                return
            if place.kind == "photographs":
                self.add_photographs(place.folder)
                return

    # --- the end

    def closeEvent(self, event: QCloseEvent) -> None:
        if not self.closing.may_close():
            event.ignore()
            return
        self._keep_queue()
        self.shell.settings.change(window=bytes(self.saveGeometry().toHex().data()).decode())
        self.shell.enquiries.close()
        for page in self._pages.values():
            page.close()
        event.accept()

    def _stopping(self) -> None:
        self._keep_queue()
        self.status.showMessage(self.tr("Stopping what runs…"))
        for part in (self.rail, self.stack, self.menuBar()):
            part.setEnabled(False)

    # --- the queue survives the window

    def _keep_queue(self) -> None:
        # Once all is being stopped, the file keeps what ran and waited before.
        if not self._kept:
            queue_file.write(self.shell.board)
        self._kept = self.closing.agreed

    def _bring_back_queue(self) -> None:
        jobs = queue_file.read()
        if not jobs:
            return
        self.shell.board.hold(True)
        for job in jobs:
            self.shell.board.enqueue(job)
        self.status.say(self.tr("The queue of last time is paused on the Process page; resume it there"))
