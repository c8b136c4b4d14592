"""The start page: a new capture, a session, photographs to import, and the sessions of late as pictures."""

import threading
from pathlib import Path

from PySide6.QtCore import QSize, Qt, QTimer, QUrl
from PySide6.QtGui import QAction, QDesktopServices, QImage, QPixmap, QUndoStack
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app import recent
from app.recent import Glance
from app.views import icons, theme
from app.views.bridge import Bridge
from app.views.pages import Shell
from app.views.start.cards import CELL, GLANCE, PHOTO, SessionCard, picture, told_state
from app.views.value_edit import ValueEdit
from app.work.enquiries import Answer

THUMBNAIL_EDGE_PX = 272
# A picture for a session that has none yet takes a child: not while the window is opening.
LATER_MS = 1500


class StartPage(QWidget):
    """Where everything begins."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._shell: Shell | None = None
        self._bridge = Bridge(self)
        self._asked: set[Path] = set()
        self.title = self.tr("Start")
        self.undo_stack = QUndoStack(self)
        self.new_capture = _tile(
            self.tr("&New capture"), self.tr("Turn the rig and photograph. The virtual studio needs no hardware."),
            "capture", True,
        )  # fmt: skip
        self.demo = _tile(
            self.tr("Open &demo"), self.tr("Finished results of a virtual object, to look around in."), "maps"
        )
        self.open = _tile(self.tr("&Open session…"), self.tr("A folder that Roomlight made."), "open")
        self.add = _tile(
            self.tr("&Import photographs…"), self.tr("RAW brackets, or linear EXR and HDR images."), "import"
        )
        self.simulate = _tile(
            self.tr("&Simulate photographs…"),
            self.tr(
                "Of a virtual object in a virtual room, built in or out of your own files; with the truth."
            ),
            "view3d",
        )
        self.new_capture.clicked.connect(self._new_capture)
        self.demo.clicked.connect(self._open_demo)
        self.open.clicked.connect(self._ask_session)
        self.add.clicked.connect(self._add_photographs)
        self.simulate.clicked.connect(self._simulate)

        name = QLabel("Roomlight")
        name.setObjectName("title")
        about = QLabel(
            self.tr("Shape and reflectance of an object, from the light of the room it stands in.")
        )
        about.setObjectName("dim")
        about.setWordWrap(True)
        drop = QLabel(self.tr("A session or a folder of photographs may be dropped anywhere on this window."))
        drop.setObjectName("dim")
        drop.setWordWrap(True)
        left = QVBoxLayout()
        left.setSpacing(10)
        left.addWidget(name)
        left.addWidget(about)
        left.addSpacing(14)
        for tile in (self.new_capture, self.demo, self.open, self.add, self.simulate):
            left.addWidget(tile)
        left.addStretch()
        left.addWidget(drop)
        side = QWidget()
        side.setLayout(left)
        side.setFixedWidth(300)

        heading = QLabel(self.tr("Recent sessions"))
        heading.setObjectName("heading")
        heading.setIndent(7)  # as far in as the cards
        self.list = QListWidget()
        self.list.setAccessibleName(self.tr("Recent sessions"))
        self.list.setViewMode(QListWidget.ViewMode.IconMode)
        self.list.setResizeMode(QListWidget.ResizeMode.Adjust)
        self.list.setMovement(QListWidget.Movement.Static)
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        self.list.setSpacing(6)
        self.list.setUniformItemSizes(True)
        self.list.setVerticalScrollMode(QListWidget.ScrollMode.ScrollPerPixel)
        self.list.setItemDelegate(SessionCard(self.list))
        self.list.viewport().setAutoFillBackground(False)
        self.list.setContextMenuPolicy(Qt.ContextMenuPolicy.ActionsContextMenu)
        self.list.itemActivated.connect(self._open_item)
        for text, keys, call in (
            (self.tr("Open"), "Return", lambda: self._open_item(self.list.currentItem())),
            (self.tr("Show folder"), "Ctrl+Return", self._show_folder),
            (self.tr("Remove from this list"), "Del", self._forget),
        ):
            action = QAction(text, self.list)
            action.setShortcut(keys)
            action.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
            action.triggered.connect(lambda checked=False, call=call: self.list.currentItem() and call())
            self.list.addAction(action)
        self.empty = QLabel(
            self.tr(
                "Nothing here yet. Open the demo to see results; a new capture in the virtual studio needs no hardware."
            )
        )
        self.empty.setObjectName("dim")
        self.empty.setIndent(7)
        self.empty.setWordWrap(True)
        self.empty.setAlignment(Qt.AlignmentFlag.AlignTop)
        right = QVBoxLayout()
        right.setSpacing(10)
        right.addWidget(heading)
        right.addWidget(self.empty, 1)
        right.addWidget(self.list, 1)

        layout = QHBoxLayout(self)
        layout.setContentsMargins(32, 28, 24, 20)
        layout.setSpacing(36)
        layout.addWidget(side)
        layout.addLayout(right, 1)
        self._dress()

    def use(self, shell: Shell) -> None:
        self._shell = shell
        shell.settings.preferences.listen(lambda preferences: self.refresh())
        shell.board.listen(self._bridge.latest(self.refresh))
        self.refresh()

    def show_session(self, folder: Path | None) -> None:
        self.refresh()

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self.refresh()

    def refresh(self) -> None:
        """Look at the recent sessions again, in a thread."""
        if self._shell is None:
            return
        folders = [Path(text) for text in self._shell.settings.value.recent]
        known = [self.list.item(row).data(GLANCE).folder for row in range(self.list.count())]
        if folders != known:
            self._fill(folders)
        self.empty.setVisible(not folders)
        self.list.setVisible(bool(folders))
        tell = self._bridge.queued(self._take)

        def look() -> None:
            for folder in folders:
                glance = recent.look(folder)
                tell(glance, picture(glance.picture))

        threading.Thread(target=look, name="recent sessions", daemon=True).start()

    def _fill(self, folders: list[Path]) -> None:
        before = {
            self.list.item(row).data(GLANCE).folder: self.list.item(row) for row in range(self.list.count())
        }
        kept = {folder: (item.data(GLANCE), item.data(PHOTO)) for folder, item in before.items()}
        current = self.list.currentRow()
        self.list.clear()
        for folder in folders:
            item = QListWidgetItem()
            item.setSizeHint(CELL)
            glance, photo = kept.get(folder, (Glance(folder, there=True), None))
            item.setData(GLANCE, glance)
            item.setData(PHOTO, photo)
            self._describe(item, glance)
            self.list.addItem(item)
        self.list.setCurrentRow(max(current, 0) if folders else -1)

    def _take(self, glance: Glance, picture: QImage | None) -> None:
        for row in range(self.list.count()):
            item = self.list.item(row)
            if item.data(GLANCE).folder == glance.folder:
                item.setData(GLANCE, glance)
                if picture is not None:
                    item.setData(PHOTO, QPixmap.fromImage(picture))
                elif glance.there and glance.views and glance.folder not in self._asked:
                    self._asked.add(glance.folder)
                    QTimer.singleShot(LATER_MS, self, lambda: self._askpicture(glance.folder))
                self._describe(item, glance)

    def _askpicture(self, folder: Path) -> None:
        if self._shell is None:
            return
        tell = self._bridge.queued(self._take)
        to = recent.thumbnail_file(folder)

        def then(answer: Answer) -> None:
            # A session that cannot be pictured says why when it is opened.
            if answer.content is not None:
                tell(recent.look(folder), picture(to))

        self._shell.enquiries.ask(
            "thumbnail", then, session=str(folder), to=str(to), edge_px=THUMBNAIL_EDGE_PX
        )

    def _describe(self, item: QListWidgetItem, glance: Glance) -> None:
        item.setText(glance.name)
        item.setToolTip(str(glance.folder))
        said = f"{glance.name}, {told_state(glance)}"
        item.setData(Qt.ItemDataRole.AccessibleTextRole, said)

    def _new_capture(self) -> None:
        if self._shell is not None:
            self._shell.wishes.new_capture.emit()

    def _open_demo(self) -> None:
        if self._shell is not None:
            self._shell.wishes.open_demo.emit()

    def _ask_session(self) -> None:
        if self._shell is not None:
            self._shell.wishes.ask_session.emit()

    def _add_photographs(self) -> None:
        if self._shell is not None:
            self._shell.wishes.add_photographs.emit(None)

    def _simulate(self) -> None:
        if self._shell is not None:
            self._shell.wishes.simulate.emit()

    def _open_item(self, item: QListWidgetItem) -> None:
        glance: Glance = item.data(GLANCE)
        if self._shell is not None:
            self._shell.wishes.open_session.emit(glance.folder)

    def _show_folder(self) -> None:
        folder: Path = self.list.currentItem().data(GLANCE).folder
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))

    def _forget(self) -> None:
        if self._shell is None:
            return
        settings, glance = self._shell.settings, self.list.currentItem().data(GLANCE)
        this, row = str(glance.folder), self.list.currentRow()

        def apply(listed: bool) -> None:
            settings.forget(glance.folder)
            if listed:
                recent = settings.value.recent
                settings.change(recent=(*recent[:row], this, *recent[row:]))

        self.undo_stack.push(ValueEdit(self.tr("removing {0}").format(glance.name), True, False, apply))

    def changeEvent(self, event) -> None:
        super().changeEvent(event)
        if event.type() == event.Type.PaletteChange and hasattr(self, "simulate"):
            self._dress()

    def _dress(self) -> None:
        ours = theme.colours(self)
        names = {
            self.new_capture: "capture", self.demo: "maps", self.open: "open", self.add: "import",
            self.simulate: "view3d",
        }  # fmt: skip
        for tile, name in names.items():
            main = tile is self.new_capture
            tile.setIcon(icons.icon(name, ours.on_accent if main else ours.text, 28))


def _tile(title: str, about: str, name: str, primary: bool = False) -> QPushButton:
    tile = QPushButton(f"  {title}")  # a little air between icon and words
    tile.setObjectName("primary" if primary else "tile")
    tile.setIconSize(QSize(26, 26))
    tile.setMinimumHeight(54)
    tile.setToolTip(about)
    tile.setAccessibleName(title.replace("&", "").rstrip("…"))
    tile.setAccessibleDescription(about)
    tile.setStyleSheet("QPushButton { text-align: left; padding-left: 16px; }")
    return tile
