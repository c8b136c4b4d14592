"""The maps page: a finished run's maps side by side, photograph against re-rendering, one run against another.

Pictures are read and drawn in a thread of the page's own, re-renderings by a child; nothing here computes.
"""

from pathlib import Path

from PySide6.QtGui import QGuiApplication, QUndoStack
from PySide6.QtWidgets import (
    QFileDialog,
    QInputDialog,
    QWidget,
)

from app.inspect import maps, runs
from app.inspect.maps import Maps
from app.inspect.readings import under
from app.inspect.runs import Run
from app.state import Trouble, called, place_of
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.empty import Empty
from app.views.head import Head
from app.views.maps.bar import MapsBar
from app.views.maps.compare import MapsCompare
from app.views.maps.grid import MapsGrid
from app.views.maps.panel import Showing
from app.views.maps.swipe import MapsSwipe
from app.views.page_actions import page_action
from app.views.page_column import Either, lay_out
from app.views.pages import Shell, tell
from app.views.pictures.view import ImageView
from app.views.pictures.viewport import Viewport
from app.views.readout import Readout
from app.views.scale import ScaleRow
from app.views.verdict import Verdict
from engine.io import scale_edit
from engine.io.scale_edit import ScaleBar


class MapsPage(QWidget):
    """Three ways to look at a run: `maps`, `swipe`, `compare`."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = self.tr("Maps")
        self.setAccessibleName(self.title)
        self._shell: Shell | None = None
        self._session: Path | None = None
        self._runs: tuple[Run, ...] = ()
        self._others: list[Run] = []  # of other sessions, to compare with
        self._maps: Maps | None = None
        self._picked: int | None = None  # a view to turn to once its run is there
        self.undo_stack = QUndoStack(self)
        self._background = Background(self, "maps")
        self.viewport = Viewport(self)

        self.grid = MapsGrid(self, self.viewport, self._background)
        self.swipe = MapsSwipe(self, self.viewport, self._background)
        self.compare = MapsCompare(self, self.viewport, self._background)
        self.stack = Either(self.grid, self.swipe, self.compare)
        self.bar = MapsBar(self, self.viewport)
        self.readout = Readout(self)
        self.scale = ScaleRow(self, self.undo_stack, self._background, self.bar.mark)
        self.empty = Empty("maps")
        self.export = page_action(self, self.tr("E&xport…"), "Ctrl+Return", lambda: self._wish_page("export"))
        self.head = Head(self, self.export)
        self.head.add(self.bar.run_box)
        self.body, self.verdict = QWidget(), Verdict()
        lay_out(self.body, self.bar, self.verdict, self.scale, self.stack, self.readout, spacing=2)
        lay_out(self, self.head, self.body, self.empty, spacing=2)

        self.viewport.pointed.connect(self._read)
        self.swipe.rendered.connect(self._arrived)
        self.swipe.failed.connect(self._tell)
        self.compare.picked.connect(self._compare_with)
        self.compare.other_session.connect(self._ask_other)
        self.bar.mode_picked.connect(self.set_mode)
        self.bar.run_picked.connect(self._pick_run)
        self.bar.changed.connect(self._changed)
        self.bar.arranged.connect(self.grid.arrange)
        self.grid.arranged.connect(self.bar.show_arrangement)
        self.bar.save_wanted.connect(self.save_picture)
        self.bar.copy_wanted.connect(self.copy_picture)
        self.bar.refresh_wanted.connect(self.refresh)
        self.bar.name_wanted.connect(self._ask_name)
        self.bar.scale_wanted.connect(self.scale.open)
        self.bar.mark_wanted.connect(self._mark)
        for view in self.findChildren(ImageView):
            view.clicked.connect(self._mark)
        self.scale.marked.connect(lambda: self.viewport.mark(self.scale.marks))
        self.scale.written.connect(self._scale_written)
        self.scale.failed.connect(self._tell)
        self._show_nothing()

    # The contract with the window

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.empty.use(shell)
        self._show_nothing()
        self.swipe.errand.board = shell.board
        shell.state.view.listen(self._turn_to)
        shell.board.listen(Bridge(self).latest(self._look_again))
        self._turn_to(shell.state.view.value)

    def show_session(self, folder: Path | None) -> None:
        """Show a session's results; returns at once."""
        if folder != self._session:
            self._session = folder
            self.head.show_session(folder)
            self._runs, self._others, self._maps = (), [], None
            self._show_maps(None)
            self._show_nothing()
            if folder is not None:
                self.empty.say_reading()
            self.compare.show_other(None)
            self.undo_stack.clear()
            self.scale.show_session(folder)
        self.refresh()

    def refresh(self) -> None:
        """Look whether there are new results."""
        folder = self._session
        if folder is None:
            self._background.drop("runs")
            self._show_nothing()
            return
        self._background.ask(
            "runs", lambda: (runs.runs_of(folder), scale_edit.read(folder)), self._show_runs, self._tell
        )

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self._look_again()

    def _look_again(self) -> None:
        if self._session is not None and self.isVisible():
            self.refresh()

    # Choices

    def set_mode(self, mode: int) -> None:
        """0 maps, 1 swipe, 2 compare."""
        self.bar.show_mode(mode)
        self.stack.setCurrentIndex(mode)
        self._show_all()
        if self.pane is self.swipe:
            self.swipe.view.setFocus()  # its arrows move the cursor; those of the buttons would leave the swipe

    @property
    def pane(self) -> MapsGrid | MapsSwipe | MapsCompare:
        """What is shown of the three."""
        return (self.grid, self.swipe, self.compare)[self.stack.currentIndex()]

    @property
    def showing(self) -> Showing | None:
        """What the page shows; None while there is nothing."""
        return self.bar.showing(self._maps)

    def save_picture(self) -> None:
        """The chosen picture as PNG, at the photographs' size."""
        name, image = self.pane.image()
        if image is None or self._session is None:
            return
        to, _ = QFileDialog.getSaveFileName(
            self, self.tr("Save picture"), str(self._session.parent / f"{name}.png"), "PNG (*.png)"
        )
        if to and not image.save(to):
            self._tell(
                Trouble(f"{to}: could not be written", self.tr("check the disk, or choose another folder"))
            )

    def copy_picture(self) -> None:
        """The chosen picture to the clipboard."""
        name, image = self.pane.image()
        if image is not None:
            QGuiApplication.clipboard().setImage(image.copy())

    def _ask_name(self) -> None:
        if self._maps is None:
            return
        run = self._maps.run
        name, agreed = QInputDialog.getText(
            self,
            self.tr("Name this run"),
            self.tr("Name; empty: told by preset and what changed"),
            text=run.name,
        )
        if agreed:
            self._background.ask(
                "name", lambda: runs.rename(run, name), lambda answer: self.refresh(), self._tell
            )

    # What arrives

    def _show_runs(self, answer: tuple[tuple[Run, ...], ScaleBar | None]) -> None:
        found, bar = answer
        if not found:
            self._runs, self._maps = (), None
            self._show_nothing()
            return
        now = self._maps.run.fingerprint if self._maps is not None else None
        same = self._maps is not None and self._maps.scale_bar == bar
        if same and [_parts(run) for run in found] == [_parts(run) for run in self._runs]:
            self._runs = found
            return
        known = {run.fingerprint for run in self._runs}
        fresh = [run for run in found if run.fingerprint not in known]
        self._runs = found
        chosen = next((run for run in found if run.fingerprint == now), None)
        if chosen is None or fresh:
            chosen = runs.current(found) or found[0]
        self.bar.offer_runs(runs.names(found), found.index(chosen))
        self._load(chosen)

    def _pick_run(self, index: int) -> None:
        self._load(self._runs[index])

    def _load(self, run: Run) -> None:
        self._background.ask("load", lambda: maps.load(run), self._show_maps, self._fail_load)

    def _show_maps(self, loaded: Maps | None) -> None:
        self._maps = loaded
        self.verdict.show_quality(None if loaded is None else loaded.quality)
        if loaded is not None:
            mask = loaded.surface.mask
            self.viewport.show(mask.shape[1], mask.shape[0], maps.object_box(loaded))
        self.scale.show_run(loaded)
        if loaded is not None:
            self.bar.offer_views(loaded)
            self._turn_to(self._picked)
            self._offer(None)
            self.empty.hide()
            self.body.show()
            self.export.setEnabled(True)
            self.bar.run_box.setEnabled(True)
        self._show_all()
        self._read()

    def _turn_to(self, view: int | None) -> None:
        """Show the view that was picked on another page."""
        self._picked = view
        if view is not None and self._maps is not None:
            self._picked = None
            self.bar.choose_view(view)

    def _changed(self) -> None:
        if self._shell is not None and self._maps is not None:
            self._shell.state.view.set(self.bar.view)
        self._show_all()

    def _show_all(self) -> None:
        """Panes that are hidden remember it and draw when shown."""
        showing = self.showing
        for pane in (self.grid, self.swipe, self.compare):
            pane.show_run(showing)
        self._read()

    def _read(self) -> None:
        pixel = self.viewport.pixel()
        showing = self.showing
        if pixel is None or showing is None or not showing.maps.names:
            self.readout.show_readings(None, ())
            return
        found = under(showing.maps, *pixel, showing.view, showing.normal_frame)
        self.readout.show_readings(pixel, found)

    def _arrived(self, view: int) -> None:
        showing = self.showing
        if showing is not None and view == showing.view:
            self.grid.redraw(("rerendered", "difference"))

    # The scale

    def _mark(self) -> None:
        """The pixel under the cursor."""
        if self.viewport.cursor is not None and self.viewport.pixel() is not None:
            self.scale.mark(self.viewport.cursor)

    def _scale_written(self, said: str) -> None:
        self.refresh()
        if self._shell is not None:
            self._shell.wishes.say.emit(said)

    # Comparing

    def _offer(self, chosen: Run | None) -> None:
        """The runs that may stand beside the present one."""
        names = [*runs.names(self._runs)]
        if chosen is None and len(self._runs) > 1 and self._maps is not None:
            chosen = next(run for run in self._runs if run != self._maps.run)
        names += [f"{called(run.session)}: {run.finished:%d %b %H:%M}" for run in self._others]
        every = [*self._runs, *self._others]
        self.compare.offer(names, every.index(chosen) if chosen in every else None)
        self._load_other(chosen)

    def _compare_with(self, index: int) -> None:
        self._load_other([*self._runs, *self._others][index])

    def _load_other(self, run: Run | None) -> None:
        if run is None:
            self._background.drop("other")
            self.compare.show_other(None)
        else:
            self._background.ask("other", lambda: maps.load(run), self.compare.show_other, self._tell)

    def _ask_other(self) -> None:
        chosen = QFileDialog.getExistingDirectory(
            self, self.tr("Another session"), str(self._session or Path.home())
        )
        if chosen:
            self.compare_with_session(Path(chosen))
        else:
            self._offer(None)

    def compare_with_session(self, folder: Path) -> None:
        """Put another session's present run beside this one."""
        place = place_of(folder)
        if place.kind != "session":
            self._tell(Trouble(f"{folder}: not a session", self.tr("choose a folder that Roomlight made")))
            return
        self._background.ask("others", lambda: runs.runs_of(place.folder), self._add_others, self._tell)

    def _add_others(self, found: tuple[Run, ...]) -> None:
        chosen = runs.current(found)
        if chosen is None:
            self._tell(Trouble(self.tr("That session has no finished surface"), self.tr("process it first")))
            return
        self._others = [run for run in self._others if run.session != chosen.session] + [chosen]
        self._offer(chosen)

    # Troubles

    def _show_nothing(self, fault: Trouble | None = None) -> None:
        self.body.hide()
        self.empty.show()
        self.export.setEnabled(False)
        self.bar.run_box.setEnabled(False)
        self.empty.say_nothing_yet(self._session, fault)

    def _wish_page(self, key: str) -> None:
        if self._shell is not None:
            self._shell.wishes.show_page.emit(key)

    def _fail_load(self, fault: Trouble) -> None:
        self._maps = None
        self._show_all()
        self._show_nothing(fault)

    def _tell(self, fault: Trouble) -> None:
        tell(self._shell, self, fault)


def _parts(run: Run) -> tuple[str, frozenset[str], str]:
    """A run, what of it is there, and its name."""
    return run.fingerprint, frozenset(run.records), run.name
