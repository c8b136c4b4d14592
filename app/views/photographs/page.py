"""The photographs page: a contact sheet and one photograph large, before anything is computed, and what to leave out.

A child of the page's own looks at the photographs, one after the other while the page is shown, the chosen one first; what it
saw is kept in this person's cache. Reading and writing happen in a thread.
"""

import contextlib
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QCloseEvent, QImage, QKeySequence, QShowEvent, QUndoStack
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from app import photographs
from app.photographs import Listing, Look, Photograph
from app.state import Trouble
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.empty import Empty
from app.views.head import Head
from app.views.page_actions import page_action
from app.views.page_column import Either, lay_out
from app.views.pages import Shell, tell
from app.views.photographs.facts import Facts
from app.views.photographs.large import LargePhotograph
from app.views.photographs.looks import Looks
from app.views.photographs.sheet import CELL, LOOK, ContactSheet
from app.views.value_edit import ValueEdit
from app.work.enquiries import Enquiries
from engine.errors import RoomlightError

ORDERS = ("taken", "blur", "clipped")


class PhotographsPage(QWidget):
    """One session's photographs."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = self.tr("Photographs")
        self.setAccessibleName(self.title)
        self.undo_stack = QUndoStack(self)
        self._shell: Shell | None = None
        self._session: Path | None = None
        self._listing: Listing | None = None
        self._out: frozenset[str] = frozenset()  # as shown; the session follows in a moment
        self._unsaved = False
        self._looker = Enquiries()
        self._bridge = Bridge(self)
        self._background = Background(self, "photographs")
        self._build()
        self._show_state()

    # The contract with the window

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.empty.use(shell)
        self._show_state()
        shell.board.listen(self._bridge.latest(self._read))  # what runs may place photographs, or take some

    def show_session(self, folder: Path | None) -> None:
        """Show a session's photographs; returns at once."""
        if folder != self._session:
            self._session, self._listing = folder, None
            self.head.show_session(folder)
            self.undo_stack.clear()
            self.looks.want(None, ())
            self._take_out(frozenset())
            self.sheet.fill(())
            self._show_state()
        self._read()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._read()

    def closeEvent(self, event: QCloseEvent) -> None:
        """What was left out is written, whatever the thread is at."""
        if self._unsaved and self._listing is not None:
            with contextlib.suppress(RoomlightError):
                photographs.leave_out(self._listing, self._out)
        self._looker.close()
        self.view.close_files()
        super().closeEvent(event)

    # Building

    def _build(self) -> None:
        self.order = QComboBox()
        self.order.setAccessibleName(self.tr("Order"))
        names = {"taken": self.tr("As taken"), "blur": self.tr("Blurriest first"), "clipped": self.tr("Most clipped first")}  # fmt: skip
        for key in ORDERS:
            self.order.addItem(names[key], key)
        self.order.activated.connect(lambda index: self._fill())
        self.clipping = QCheckBox(self.tr("Show &clipping"))
        self.clipping.setAccessibleName(self.tr("Show clipping"))
        self.clipping.setToolTip(self.tr("Red: clipped in all exposures; amber: in the one shown (C)"))
        self.process = page_action(
            self, self.tr("To &processing"), "Ctrl+Return", lambda: self._wish_page("process")
        )
        self.head = Head(self, self.process)
        self.head.add(self.clipping, self.order)
        self.told = self.head.state
        self.sheet = ContactSheet()
        self.sheet.setMinimumWidth(CELL.width() + 24)
        self.sheet.currentItemChanged.connect(lambda now, before: self._show_current())
        self.sheet.marked.connect(lambda name: self._turn({name}))
        self.view = LargePhotograph(self._looker, self._background)
        self.clipping.toggled.connect(self.view.show_clipping)
        self.looks = Looks(self._looker, self._background, self)
        self.looks.seen.connect(self._seen)
        self.looks.failed.connect(self._unseen)
        self.looks.changed.connect(self._go_on)
        self.facts = Facts()
        self.facts.out_wanted.connect(self._tick)
        self.facts.exposure_picked.connect(self._show_exposure)
        self.facts.again_wanted.connect(self._take_again)
        large = QWidget()
        column = QVBoxLayout(large)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.view, 1)
        column.addWidget(self.facts)
        self.split = QSplitter(Qt.Orientation.Horizontal)
        self.split.addWidget(self.sheet)
        self.split.addWidget(large)
        self.split.setStretchFactor(0, 0)
        self.split.setStretchFactor(1, 1)
        self.split.setSizes([2 * CELL.width() + 28, 10000])
        self.split.setChildrenCollapsible(False)
        self.empty = Empty("photographs")
        self.stack = Either(self.empty, self.split)
        lay_out(self, self.head, self.stack, spacing=2)
        self._actions()

    def _actions(self) -> None:
        turn = QAction(self.tr("Leave out, or put back"), self)
        turn.setShortcuts([QKeySequence("Space"), QKeySequence("Del")])
        # Elsewhere the space bar presses the button that has the focus.
        turn.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        turn.triggered.connect(lambda checked: self._turn({one.name for one in self.sheet.chosen()}))
        self.sheet.setContextMenuPolicy(Qt.ContextMenuPolicy.ActionsContextMenu)
        for widget in (self.sheet, self.view):
            widget.addAction(turn)
        for text, keys, call in (
            (self.tr("Show clipping"), "C", self.clipping.toggle),
            (self.tr("Previous photograph"), "PgUp", lambda: self._step(-1)),
            (self.tr("Next photograph"), "PgDown", lambda: self._step(1)),
            (self.tr("To the contact sheet"), "Ctrl+L", self.sheet.setFocus),
        ):
            page_action(self, text, keys, call)

    # What arrives

    def _read(self) -> None:
        session = self._session
        if session is not None and not self._unsaved and self.isVisible():
            self._background.ask("list", lambda: photographs.read(session), self._take, self._refuse)

    def _take(self, listing: Listing) -> None:
        if listing.session != self._session or self._unsaved:
            return
        same, self._listing = listing == self._listing, listing
        if not same:
            self._fill()
            self.looks.want(listing.session, listing.photographs)
        self._take_out(listing.left_out)
        self._go_on()

    def _refuse(self, fault: Trouble) -> None:
        self._listing = None
        self._show_state()
        self.empty.say(fault)

    def _seen(self, photograph: Photograph, look: Look, picture: QImage) -> None:
        self.sheet.show_look(photograph, look, picture)
        if photograph == self._current():
            self.facts.show_look(look)
            self.view.show_small(photograph)

    def _unseen(self, photograph: Photograph, fault: Trouble) -> None:
        item = self.sheet.item_of(photograph)
        if item is not None:
            item.setToolTip(f"{fault.what}\n{fault.remedy}")

    def _go_on(self) -> None:
        """While the page is shown only: what is processed meanwhile has the other core."""
        if self.isVisible():
            self.looks.go_on(self._current())
        self._show_state()

    # What is shown

    def _current(self) -> Photograph | None:
        row = self.sheet.currentRow()
        return self.sheet.photograph(row) if row >= 0 else None

    def _fill(self) -> None:
        if self._listing is None:
            return
        looks = {photograph.name: self._look_of(photograph) for photograph in self._listing.photographs}
        order = self.order.currentData()

        def worst(photograph: Photograph) -> float:
            look = looks[photograph.name]
            return -1.0 if look is None else -((look.blur_px or 0.0) if order == "blur" else look.clipped)

        listed = self._listing.photographs
        self.sheet.fill(listed if order == "taken" else tuple(sorted(listed, key=worst)))
        self.sheet.show_left_out(self._out)

    def _look_of(self, photograph: Photograph) -> Look | None:
        item = self.sheet.item_of(photograph)
        return None if item is None else item.data(LOOK)

    def _step(self, by: int) -> None:
        if self.sheet.count():
            self.sheet.setCurrentRow(min(max(self.sheet.currentRow() + by, 0), self.sheet.count() - 1))

    def _show_current(self) -> None:
        photograph = self._current()
        count = len(self._listing.photographs) if self._listing is not None else 0
        self.facts.show_photograph(photograph, count)
        self.facts.show_look(self._look_of(photograph) if photograph is not None else None)
        self.facts.show_use(photograph, photograph is not None and photograph.name in self._out)
        self._show_exposure()

    def _show_exposure(self) -> None:
        self.view.show_photograph(self._session, self._current(), self.facts.chosen_exposure)

    def _show_state(self) -> None:
        listing = self._listing
        views = () if listing is None else listing.photographs
        self.stack.setCurrentIndex(1 if views else 0)
        for widget in (self.clipping, self.order, self.process):
            widget.setEnabled(bool(views))
        self.facts.again.setVisible(listing is not None and listing.captured)
        if listing is None:
            self.told.setText("")
            if self._session is None:
                self.empty.say_nothing_yet(None)
            else:
                self.empty.say_reading()
            return
        self.empty.say(
            Trouble(
                self.tr("There are no photographs yet"), self.tr("they appear here as they are captured")
            ),
            (self.tr("Go to &Capture"), lambda: self._wish_page("capture")),
        )
        told = [self.tr("1 photograph") if len(views) == 1 else self.tr("{0} photographs").format(len(views))]
        counts = {len(photograph.exposures) for photograph in views}
        if counts and max(counts) > 1:
            told.append(self.tr("{0} exposures each").format("/".join(map(str, sorted(counts)))))
        told += [listing.camera] if listing.camera else []
        if self._out:
            told.append(self.tr("{0} left out").format(len(self._out)))
        if self.looks.left:
            told.append(self.tr("{0} still to be looked at").format(self.looks.left))
        self.told.setText("  ·  ".join(told))

    # Leaving out

    def _tick(self, out: bool) -> None:
        photograph = self._current()
        if photograph is not None:
            self._change(self._out | {photograph.name} if out else self._out - {photograph.name})

    def _turn(self, names: set[str]) -> None:
        """Put these back if all are left out, else leave all of them out."""
        if names:
            self._change(self._out - names if names <= self._out else self._out | names)

    def _change(self, names: frozenset[str]) -> None:
        text = self.tr("leaving out") if len(names) > len(self._out) else self.tr("putting back")
        self.undo_stack.push(ValueEdit(text, self._out, names, self._apply))

    def _apply(self, names: frozenset[str]) -> None:
        listing = self._listing
        if listing is None:
            return
        self._take_out(names)
        self._unsaved = True
        self._background.ask(
            "write", lambda: photographs.leave_out(listing, names), lambda answer: self._saved(), self._not_saved
        )  # fmt: skip
        self._show_state()

    def _saved(self) -> None:
        self._unsaved = False
        self._read()

    def _not_saved(self, fault: Trouble) -> None:
        """What the session holds is shown again."""
        self._unsaved = False
        self.undo_stack.clear()
        self._read()
        self._tell(fault)

    def _take_out(self, names: frozenset[str]) -> None:
        self._out = names
        self.sheet.show_left_out(names)
        photograph = self._current()
        self.facts.show_use(photograph, photograph is not None and photograph.name in names)

    def _take_again(self) -> None:
        photograph, listing = self._current(), self._listing
        if photograph is None or listing is None:
            return
        kept: list[Path] = []  # where it is while it is put aside

        def apply(away: bool) -> None:
            self._background.ask("again", lambda: move(away), moved, self._not_saved)

        def move(away: bool) -> bool:
            if away:
                kept.append(photographs.take_again(listing, photograph))
            elif kept:
                photographs.bring_back(listing, photograph, kept.pop())
            return away

        def moved(away: bool) -> None:
            self._read()
            if away and self._shell is not None:
                told = self.tr("{0} is put aside; resume on the Capture page to take it again")
                self._shell.wishes.say.emit(told.format(photograph.name))

        self.undo_stack.push(
            ValueEdit(self.tr("taking {0} again").format(photograph.name), False, True, apply)
        )

    # The window

    def _wish_page(self, key: str) -> None:
        if self._shell is not None:
            self._shell.wishes.show_page.emit(key)

    def _tell(self, fault: Trouble) -> None:
        tell(self._shell, self, fault)
