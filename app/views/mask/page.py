"""The mask page: what was found to be the object over any photograph, and strokes that correct it.

Strokes are saved soon after each of them; finding again is a run of the pipeline up to its stage `segment`, on the
board that all pages share. Reading, drawing and saving happen in a thread of the page's own.
"""

from pathlib import Path

import numpy as np
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut, QShowEvent, QUndoStack
from PySide6.QtWidgets import QWidget

from app import mask_files
from app.mask_files import Developed
from app.masking import Editor, Painting, Patch
from app.plan import Row
from app.processing import Processing
from app.state import Trouble, trouble
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.empty import Empty
from app.views.head import Head
from app.views.mask.bar import ToolBar, ViewBar, grown
from app.views.mask.canvas import MaskCanvas
from app.views.mask.edit import MaskEdit
from app.views.mask.saving import Saving
from app.views.mask.status import Standing, StatusLine, why_nothing
from app.views.page_actions import action_button, page_action
from app.views.page_column import Either, lay_out
from app.views.pages import Shell
from app.views.trouble import show_trouble
from app.work.jobs import JobState


class MaskPage(QWidget):
    """One session's mask."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = self.tr("Mask")
        self.setAccessibleName(self.title)
        self.undo_stack = QUndoStack(self)
        self.editor = Editor()
        self.model: Processing | None = None
        self._shell: Shell | None = None
        self._session: Path | None = None
        self._developed: Developed | None = None
        self._planned = True  # the plan knows the newest strokes
        self._find_wanted = False  # as soon as the strokes are in their place
        self._failed: str | None = None  # the failure that was told, so that it is told once
        self._bridge = Bridge(self)
        self._background = Background(self, "mask")
        self.saving = Saving(self, self._background)
        self._build()
        self._show_tool()
        self._show_state()

    # The contract with the window

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.empty.use(shell)
        self._show_state()
        self.model = Processing(shell.enquiries, shell.board, self._bridge.queued)
        self.model.answered.listen(lambda number: self._load())
        self.model.trouble.listen(lambda trouble: self._show_state())
        self.model.job.listen(lambda status: self._show_job())
        shell.board.listen(self._bridge.latest(self._show_state))

    def show_session(self, folder: Path | None) -> None:
        """Show a session's mask; returns at once."""
        if self.model is None:
            return
        if folder == self._session:
            self.model.refresh()
            return
        self._session, self._failed, self._find_wanted, self._planned = folder, None, False, True
        self.head.show_session(folder)
        for key in ("load", "labels", "picture"):
            self._background.drop(key)
        self._take_labels(None)
        self._show_developed(None)
        self.model.open(folder)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        if self.model is not None and self._session is not None:
            self.model.refresh()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Nothing painted is lost: what is not on disk yet is written before the window goes."""
        self.saving.finish()
        super().closeEvent(event)

    # Building

    def _build(self) -> None:
        self.run = page_action(self, self.tr("Find the object again"), "F5", self.find_again)
        self.run.setIconText(self.tr("&Update mask"))
        self.stop = page_action(self, self.tr("&Cancel"), "Ctrl+.", self._cancel)
        self.clear = page_action(self, self.tr("Clear all strokes"), "Ctrl+Del", self._clear)
        self.clear.setIconText(self.tr("C&lear strokes"))
        self.head = Head(self, self.run)
        self.head.add(action_button(self.stop))
        self.tools = ToolBar(self, self.clear)
        self.views = ViewBar(self)
        self.canvas = MaskCanvas(self, self.editor)
        self.empty = Empty("mask")
        self.line = StatusLine(self)
        self.stack = Either(self.empty, self.canvas)
        lay_out(self, self.head, self.tools, self.stack, self.views, self.line, spacing=2)
        self.saving.changed.connect(self._show_state)
        self.saving.arrived.connect(self._arrived)
        self.saving.refused.connect(self._refused)
        self.saving.failed.connect(self._fail_saving)
        self.canvas.painted.connect(self._painted)
        self.canvas.pointed.connect(self._read)
        self.tools.tool_picked.connect(self._pick_tool)
        self.tools.side_picked.connect(self._pick_side)
        self.tools.exact_picked.connect(self._pick_exact)
        self.tools.size_picked.connect(self._resize)
        self.views.view_picked.connect(lambda view: self._draw())
        self.views.exposed.connect(self._draw)
        self.views.opacity_picked.connect(self.canvas.set_opacity)
        self.views.overlay_wanted.connect(self.canvas.show_overlay)
        self.views.outline_wanted.connect(self.canvas.show_outline)
        port, views = self.canvas.viewport, self.views
        for text, keys, call in (
            (self.tr("Brush"), "B", lambda: self._pick_tool("brush")),
            (self.tr("Eraser"), "E", lambda: self._pick_tool("eraser")),
            (self.tr("Polygon"), "P", lambda: self._pick_tool("polygon")),
            (self.tr("Add to the object"), "A", lambda: self._pick_side(True)),
            (self.tr("Take from the object"), "R", lambda: self._pick_side(False)),
            (self.tr("Swap adding and taking"), "X", lambda: self._pick_side(not self.editor.adds)),
            (self.tr("Exact strokes, or hints"), "T", lambda: self._pick_exact(not self.editor.exact)),
            (self.tr("Smaller brush"), "[", lambda: self._resize(grown(self.editor.size, -1))),
            (self.tr("Larger brush"), "]", lambda: self._resize(grown(self.editor.size, 1))),
            (self.tr("Previous view"), "PgUp", lambda: views.step(-1)),
            (self.tr("Next view"), "PgDown", lambda: views.step(1)),
            (self.tr("Mean over the views"), "M", lambda: views.view.setValue(-1)),
            (self.tr("More opaque"), "O", lambda: views.opacity.setValue(views.opacity.value() + 1)),
            (self.tr("Less opaque"), "Shift+O", lambda: views.opacity.setValue(views.opacity.value() - 1)),
            (self.tr("Show or hide the overlay"), "V", views.overlay.toggle),
            (self.tr("Show or hide the outline"), "L", views.outline.toggle),
            (self.tr("Fit the object"), "F", lambda: port.fit("object")),
            (self.tr("Fit the photograph"), "Shift+F", lambda: port.fit("all")),
            (self.tr("Zoom to 100 %"), "1", lambda: port.natural(self.devicePixelRatioF())),
            (self.tr("Zoom in"), "+", lambda: port.zoom(1.25, port.cursor)),
            (self.tr("Zoom out"), "-", lambda: port.zoom(0.8, port.cursor)),
            (self.tr("To the photograph"), "Ctrl+L", self.canvas.setFocus),
        ):
            page_action(self, text, keys, call)
        for keys, what in (
            ("Space", self.tr("Paint at the cursor, or set a corner")),
            ("Return", self.tr("Set a corner; twice in one place closes the polygon")),
            ("Backspace", self.tr("Take the polygon's last corner back")),
            ("Esc", self.tr("Forget the polygon")),
        ):
            # The photograph hears these itself, for they may be held; here they stand for the sheet of shortcuts.
            shortcut = QShortcut(QKeySequence(keys), self)
            shortcut.setWhatsThis(what)
            shortcut.setEnabled(False)

    # Tools

    def _pick_tool(self, tool: str) -> None:
        self.editor.choose(tool)
        self._show_tool()

    def _pick_side(self, adds: bool) -> None:
        self.editor.adds = adds
        self._show_tool()

    def _pick_exact(self, exact: bool) -> None:
        self.editor.exact = exact
        self._show_tool()

    def _resize(self, size: int) -> None:
        self.editor.resize(size)
        self._show_tool()

    def _show_tool(self) -> None:
        editor = self.editor
        self.tools.show_tool(editor.tool, editor.adds, editor.exact, editor.size)
        self.canvas.update()

    # Strokes

    def _painted(self, patch: Patch) -> None:
        words = {"brush": self.tr("stroke"), "eraser": self.tr("rubbing out"), "polygon": self.tr("polygon")}
        self._push(patch, words[self.editor.tool])

    def _clear(self) -> None:
        patch = self.editor.clear()
        if patch is not None:
            self._push(patch, self.tr("clearing of all strokes"))

    def _push(self, patch: Patch, text: str) -> None:
        self.undo_stack.push(MaskEdit(text, patch, self._apply))
        self._edited()

    def _apply(self, patch: Patch, back: bool) -> None:
        if self.editor.painting is not None:
            self.editor.painting.apply(patch, back)
            self._edited()

    def _edited(self) -> None:
        self._planned = False
        self.saving.edited()
        self.canvas.update()

    def _arrived(self) -> None:
        """All strokes are where a run finds them."""
        if self._find_wanted:
            self._process()
        elif self.model is not None:
            self.model.refresh()

    def _refused(self, why: str) -> None:
        if self._find_wanted and self._shell is not None:
            self._shell.wishes.say.emit(why)
        self._find_wanted = False

    # Finding

    def find_again(self) -> None:
        """Find the object with the strokes as hints; the first time, develop the photographs too."""
        self._find_wanted = True
        if self.saving.placed:
            self._process()
        else:
            self.saving.hasten()

    def _fail_saving(self, fault: Trouble) -> None:
        self._find_wanted = False
        self._tell(fault)

    def _process(self) -> None:
        self._find_wanted = False
        if self.model is not None and self._shell is not None:
            self._failed = None
            self.model.process(self._shell.settings.value.device, "segment")

    def _cancel(self) -> None:
        if self.model is not None:
            self.model.cancel()

    def _show_job(self) -> None:
        status = self.model.job.value if self.model is not None else None
        if status is not None and status.ended and self.saving.waits:
            self.saving.settle()
        if status is not None and status.state is JobState.FAILED and status.message != self._failed:
            self._failed = status.message
            if self.isVisible():
                self._tell(trouble(status.message, status.details))
        self._show_state()

    # What arrives

    def _row(self, stage: str) -> Row | None:
        plan = self.model.plan.value if self.model is not None else None
        return next((row for row in plan.rows if row.name == stage), None) if plan is not None else None

    def _load(self) -> None:
        """After a plan: the results it names."""
        self._planned = self.saving.placed
        session, hdr, segment, known = self._session, self._row("hdr"), self._row("segment"), self._developed
        if session is None or hdr is None or segment is None:
            return
        self._background.ask(
            "load",
            lambda: mask_files.load(session, Path(hdr.folder), Path(segment.folder), known),
            self._show_developed,
            self._tell,
        )

    def _show_developed(self, developed: Developed | None) -> None:
        before, self._developed = self._developed, developed
        if developed is None:
            self.views.offer_views(())
        elif developed is not before:
            port, painting, shape = self.canvas.viewport, self.editor.painting, developed.shape
            fresh = before is None or before.shape != shape
            self.views.offer_views(developed.names)
            box = None if developed.object is None else mask_files.object_box(developed.object)
            if fresh:
                port.show(shape[1], shape[0], box)
                port.fit("all")
            else:
                port.aim(box)
            self.canvas.show_found(developed.object, developed.border)
            self._draw()
            if painting is None or painting.labels.shape != shape:
                self.saving.save()
                session = developed.session
                self._background.ask(
                    "labels", lambda: mask_files.read_labels(session, shape), self._take_labels, self._tell
                )
        self._show_state()

    def _take_labels(self, labels: np.ndarray | None) -> None:
        """The session's strokes, or none while there is nothing to paint on."""
        self.undo_stack.clear()
        self.editor.show(None if labels is None else Painting(labels))
        self.saving.show(self._session, self.editor.painting)
        self.canvas.show_painting()
        if self._session is not None and labels is not None and mask_files.waiting(self._session):
            self.saving.settle()
        self._show_state()

    def _draw(self) -> None:
        developed, view, ev = self._developed, self.views.chosen, self.views.exposure_ev
        if developed is not None:
            self._background.ask(
                "picture",
                lambda: mask_files.picture(developed, view, ev),
                self.canvas.show_picture,
                self._tell,
            )

    # Showing

    def _standing(self) -> Standing:
        model, developed = self.model, self._developed
        busy = model is not None and self._session is not None and model.busy(self._session)
        fault = model.trouble.value if model is not None else None
        return Standing(
            self._session, self._row("hdr"), self._row("segment"), fault, developed, model.job.value if busy and model is not None else None,
            self.editor.painting is not None and not self.editor.painting.empty, self.saving.saved, self._planned, self.saving.waits,
        )  # fmt: skip

    def _show_state(self) -> None:
        standing = self._standing()
        self.stack.setCurrentIndex(1 if standing.developed is not None else 0)
        for bar in (self.tools, self.views):
            bar.setVisible(standing.developed is not None)
        self._say_nothing(standing)
        self.line.show_standing(standing)
        self.run.setEnabled(standing.may_find)
        self.stop.setEnabled(standing.job is not None)
        self.stop.setVisible(standing.job is not None)
        painting = self.editor.painting
        self.clear.setEnabled(painting is not None and not painting.empty)

    def _say_nothing(self, now: Standing) -> None:
        if now.session is None:
            self.empty.say_nothing_yet(None)
        elif now.fault is None and now.hdr is not None and not now.hdr.done and now.job is None:
            self.empty.say(why_nothing(now), (self.tr("&Develop photographs"), self.run.trigger))
        else:
            self.empty.say(why_nothing(now))

    def _read(self) -> None:
        self.line.show_pixel(self.canvas.viewport.pixel() if self._developed is not None else None)

    def _tell(self, fault: Trouble) -> None:
        if self._shell is not None:
            self._shell.wishes.trouble.emit(fault)
        else:
            show_trouble(self.window(), fault)
