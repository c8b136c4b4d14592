"""The 3D page: emitters, lamps, cameras and the recovered surface in space, drawn by a process of its own.

The window never waits for that process: what it should draw is left with the supervisor, and pictures arrive when they
are there. If it hangs or dies it is started again with the same session and the same eye.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float
from PySide6.QtCore import QPointF, QTimer, Signal
from PySide6.QtGui import QAction, QCloseEvent, QColor, QHideEvent, QShowEvent, QUndoStack
from PySide6.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QMenu,
    QPushButton,
    QWidget,
)

from app.frame_writer import VIDEO
from app.inspect import maps
from app.inspect.maps import Maps
from app.state import Trouble, trouble
from app.viewer import film, marks, orbit, showing
from app.viewer.events import Event, Picture, Status
from app.viewer.film import Film
from app.viewer.orbit import Orbit
from app.viewer.protocol import Colour, Contents, Probed
from app.viewer.reading import stages_of
from app.viewer.showing import Showing
from app.viewer.supervisor import Supervisor
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.empty import Empty
from app.views.head import Head
from app.views.page_actions import action_button
from app.views.page_column import Either, lay_out
from app.views.pages import Shell, tell
from app.views.scale import ScaleRow
from app.views.theme import DARK
from app.views.trouble import show_trouble
from app.views.view3d import actions as view3d_actions
from app.views.view3d.canvas import ViewCanvas
from app.views.view3d.cover import Banner, Cover, Photograph
from app.views.view3d.film import FilmDialog
from app.views.view3d.panel import ViewPanel
from app.views.view3d.turn import Turn
from engine.errors import ExportError
from engine.io import scale_edit
from engine.io.scale_edit import ScaleBar

Loaded = tuple[dict[str, Path], ScaleBar | None]  # the stages and what fixes their scale

RELIT = "relit"
SETTLE_MS = 130  # without a move until the picture is drawn as well as possible
TURN_MS = 240  # from one standard view to the next
BANNER_MS = 7000
UNSEEN_MS = 300_000  # the drawing process holds half a gigabyte; a page that nobody looks at gives it back


class View3dPage(QWidget):
    """A picture, a panel beside it; see showing.Showing for what it knows."""

    view_picked = Signal(int)  # this view's photograph is asked for; other pages turn to it too

    def __init__(
        self,
        parent: QWidget | None = None,
        supervise: Callable[[Callable[[Event], None]], Supervisor] = Supervisor,
    ) -> None:
        super().__init__(parent)
        self.title = self.tr("3D")
        self.setAccessibleName(self.tr("3D view"))
        self.state = Showing()
        self.status = Status()
        self.turn = Turn(self, TURN_MS)
        self._supervise = supervise
        self._supervisor: Supervisor | None = None
        self._session: Path | None = None
        self._loaded: Loaded | None = None  # what is shown
        self._relit: Path | None = None
        self._to_relit = False  # the surface is to be shown relit once it can be
        self._shell: Shell | None = None
        self._background = Background(self, "view3d")
        self.undo_stack = QUndoStack(self)
        self._bridge = Bridge(self)
        self._filming: FilmDialog | None = None
        self._probe = self._marking = -1  # numbers of the newest questions what is under a pixel
        self._maps: Maps | None = None  # of the run that is measured in
        self._homing = False  # the turn that is under way ends at home
        self._actions = self._make_actions()
        self.canvas = ViewCanvas(self)
        self.panel = ViewPanel(self, self._actions)
        self.cover, self.banner = Cover(self.canvas), Banner(self.canvas)
        self.photograph = Photograph(self.canvas)
        self.head, self.empty, body = Head(self, self._actions["screenshot"]), Empty("view3d"), QWidget()
        self.video = self._film_button()
        self.head.add(action_button(self._actions["measure"]), self.video)
        across = QHBoxLayout(body)
        across.setContentsMargins(0, 0, 0, 0)
        across.setSpacing(0)
        across.addWidget(self.canvas, 1)
        across.addWidget(self.panel)
        self.scale = ScaleRow(self, self.undo_stack, self._background, self._actions["mark"])
        self.stack = Either(self.empty, body)
        lay_out(self, self.head, self.scale, self.stack)
        self._settle = self._timer(SETTLE_MS, lambda: self._ask(moving=False))
        self._quiet = self._timer(BANNER_MS, self._say_missing)
        self._unseen = self._timer(UNSEEN_MS, self.end)
        self._connect()
        # The ground is dark in either theme: what shines is judged on dark ground.
        ground = {"top": _rgb(DARK.panel), "bottom": _rgb(DARK.picture), "line": _rgb(DARK.dim)}
        self._show(showing.styled(self.state, **ground))
        self._cover()

    # The contract with the window

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.empty.use(shell)
        self._cover()
        self.view_picked.connect(shell.state.view.set)
        shell.state.relit.listen(self._paint_relit)
        shell.board.listen(self._bridge.latest(self.refresh))
        self._paint_relit(shell.state.relit.value)

    def show_session(self, folder: Path | None) -> None:
        """Show a session; returns at once. While the page is hidden, nothing is started."""
        if folder != self._session:
            self._session, self._loaded = folder, None
            self.head.show_session(folder)
            self.undo_stack.clear()
            self._background.drop("maps")
            self.scale.show_session(folder)
            self.photograph.hide()
            self._actions["close"].setEnabled(False)
            self.canvas.show_picture(None)
            self.banner.say("")
            self.panel.show_renderer("")
            if self.status.state == "refused":
                self.status = replace(self.status, state="starting")  # that was the other session
            self._show(Showing(style=self.state.style))
            self._cover()
        self.refresh()

    def refresh(self) -> None:
        """Look whether there are other results than those shown, and show them."""
        folder = self._session
        if folder is not None and self.isVisible():
            self._background.ask(
                "stages", lambda: (stages_of(folder), scale_edit.read(folder)), self._found,
                lambda fault: tell(self._shell, self, fault),
            )  # fmt: skip

    def _paint_relit(self, path: Path | None) -> None:
        """Give the surface a layer "relit", and turn to it: a .npy file on the maps' grid, linear, 1 is white."""
        self._relit, self._to_relit = path, path is not None
        if path is not None and self._supervisor is not None and self._loaded is not None:
            self._supervisor.paint(RELIT, path)

    def take_screenshot(self, path: Path) -> Trouble | None:
        """Write what is seen as PNG; the trouble where that fails."""
        shot = self.canvas.screenshot()
        if shot is None:
            return Trouble(self.tr("There is no picture yet"), self.tr("wait until the view shows one"))
        if not shot.save(str(path)):
            return Trouble(
                self.tr("{0} cannot be written").format(path),
                self.tr("choose another folder or free some space"),
            )
        return None

    def save_film(self, kind: str, path: Path) -> Trouble | None:
        """Begin to write one of `film.PICTURES`, as the view shows things now: a video, or without `.mp4` a folder of PNG
        files; the trouble where that cannot begin."""
        supervisor = self._supervisor
        if supervisor is None or self.canvas.picture is None or self.status.stuck:
            return Trouble(self.tr("There is no picture yet"), self.tr("wait until the view shows one"))
        try:
            begun = Film(path)
        except (ExportError, OSError) as error:
            return trouble(str(error))
        self.turn.stop()
        self._settle.stop()
        size = self.canvas.device_size()
        filming = self._filming = FilmDialog(
            self,
            begun,
            film.looks(kind, self.state),
            lambda eye, style: supervisor.look(eye, *size, False, style),
        )
        filming.saved.connect(lambda: self._say_saved(path))
        filming.ended.connect(self._film_ended)
        filming.begin()
        return None

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._unseen.stop()
        self.refresh()

    def hideEvent(self, event: QHideEvent) -> None:
        super().hideEvent(event)
        self.turn.stop()
        self._unseen.start()

    def closeEvent(self, event: QCloseEvent) -> None:
        self.end()
        super().closeEvent(event)

    def end(self) -> None:
        """Let the drawing process go; showing a session starts another one."""
        if self._filming is not None:
            self._filming.end()
        if self._supervisor is not None:
            self._supervisor.close()
            self._supervisor, self._loaded = None, None

    # What arrives

    def _found(self, found: Loaded) -> None:
        if found != self._loaded and self._session is not None:
            self._loaded = found
            supervisor = self._begin()
            supervisor.show(self._session)
            if self._relit is not None:
                supervisor.paint(RELIT, self._relit)
            self._ask(moving=False)

    def _begin(self) -> Supervisor:
        if self._supervisor is None:
            pictures, events = self._bridge.latest(self._take_picture), self._bridge.queued(self._take)

            def hear(event: Event) -> None:
                (pictures if isinstance(event, Picture) else events)(event)

            made = self._supervisor = self._supervise(hear)
            self.destroyed.connect(lambda: made.close())
        return self._supervisor

    def _take_picture(self, picture: Picture) -> None:
        if self._session is None or self.state.contents.folder != str(self._session):
            return
        first = self.canvas.picture is None
        self.canvas.show_picture(picture)
        if self._filming is not None:
            self._filming.take(picture)
        if first:
            self._cover()
        self.panel.show_renderer(
            self.tr("{0}, {1} ms a picture").format(self.status.renderer, round(picture.milliseconds))
        )

    def _take(self, event: Status | Contents | Probed) -> None:
        if isinstance(event, Status):
            self._take_status(event)
        elif isinstance(event, Contents):
            if event.folder == str(self._session):
                state = showing.opened(self.state, event, self._aspect)
                if self._to_relit and RELIT in event.surfaces:
                    self._to_relit, state = False, showing.styled(state, surface=RELIT)
                self._show(state)
                self._ask(moving=False)
                if not self._quiet.isActive():
                    self._say_missing()
        elif event.number == self._marking and event.point:
            self._mark(np.array(event.point))
        elif event.number == self._probe and event.point:
            self._turn_to(orbit.aimed(self.state.eye, np.array(event.point)))

    def _take_status(self, status: Status) -> None:
        before, self.status = self.status, status
        if status.state == "restarting" and status.restarts != before.restarts:
            self.banner.say_restart(status.message)
            self._quiet.start()
        elif status.state == "showing" and status.message and status.message != before.message:
            self.banner.say(status.message)
            self._quiet.start()
        if status.state != "showing":
            self.panel.show_renderer("")
        if status.stuck and self._filming is not None:
            self._filming.end(Trouble(status.message, status.remedy, status.details))
        self._cover()

    def _cover(self) -> None:
        there = self._session is not None
        self.stack.setCurrentIndex(there)
        if not there:
            self.empty.say_nothing_yet(None)
        self.cover.show_status(self.status, self.canvas.picture is not None)
        seen = there and self.canvas.picture is not None
        for part in (self._actions["screenshot"], self._actions["turntable"], self.video):
            part.setEnabled(seen)
        self._actions["path"].setEnabled(seen and bool(showing.registered(self.state.contents)))

    def _say_missing(self) -> None:
        self.banner.say_missing(self.state.contents.missing)

    # What the person wants

    def _connect(self) -> None:
        canvas, panel = self.canvas, self.panel
        canvas.eye_moved.connect(self._moved)
        canvas.picked.connect(self._picked)
        canvas.probed.connect(self._ask_point)
        canvas.clicked.connect(self._ask_mark)
        self.scale.marked.connect(self._show_marks)
        self.scale.written.connect(self._scale_written)
        self.scale.failed.connect(lambda fault: tell(self._shell, self, fault))
        canvas.resized.connect(self._resized)
        panel.layer_toggled.connect(
            lambda name, shown: self._restyle(showing.with_layer(self.state, name, shown))
        )
        panel.surface_chosen.connect(lambda name: self._restyle(showing.styled(self.state, surface=name)))
        panel.emitters_chosen.connect(lambda way: self._restyle(showing.styled(self.state, emitters=way)))
        panel.exposure_changed.connect(lambda ev: self._restyle(showing.styled(self.state, exposure_ev=ev)))
        panel.frusta_changed.connect(lambda size: self._restyle(showing.styled(self.state, frusta=size)))
        panel.front_opened.connect(lambda on: self._restyle(showing.styled(self.state, open_front=on)))
        panel.view_chosen.connect(lambda view: self._restyle(showing.chose(self.state, view)))
        self.turn.passed.connect(self._pass)
        self.turn.arrived.connect(self._arrive)
        self.cover.retry.connect(lambda: self._begin().retry())
        self.photograph.closed.connect(self._close_photograph)
        self.photograph.in_maps.connect(self._go_to_maps)
        self._actions["close"].setEnabled(False)

    def _make_actions(self) -> dict[str, QAction]:
        return view3d_actions.make(
            self,
            {
                "reset": self._go_home,
                **{view: partial(self._turn_to_view, view) for view in orbit.VIEWS},
                "object": lambda: self._fit(showing.OBJECT),
                "everything": lambda: self._fit(showing.EVERYTHING),
                "previous": lambda: self._step(-1),
                "next": lambda: self._step(1),
                "photograph": self._show_photograph,
                "maps": self._go_to_maps,
                "through": lambda: self._turn_to(showing.looking_through(self.state).eye),
                "measure": self._measure,
                "mark": lambda: self._ask_mark(0.5, 0.5),
                "screenshot": self._ask_screenshot,
                "turntable": partial(self._ask_film, "turntable", self.tr("Save a turntable")),
                "path": partial(self._ask_film, "path", self.tr("Save the cameras' way")),
                "close": self._close_photograph,
            },
        )

    def _moved(self, eye: Orbit, moving: bool) -> None:
        self.turn.stop()
        self._show(showing.moved(self.state, eye))
        self._ask(moving)
        if moving:
            self._settle.start()

    def _picked(self, view: int) -> None:
        if view >= 0 and not self.scale.isVisible():
            self._restyle(showing.chose(self.state, view))
            self._show_photograph()

    def _step(self, by: int) -> None:
        self._restyle(showing.stepped(self.state, by))
        if self.photograph.isVisible():
            self._show_photograph()

    def _show_photograph(self) -> None:
        view, contents, folder = showing.standing(self.state), self.state.contents, self._session
        if view < 0 or folder is None:
            return
        self._restyle(showing.chose(self.state, view))
        self.photograph.open(folder, view, contents.names[view] if view < len(contents.names) else str(view))
        self._actions["close"].setEnabled(True)
        self.view_picked.emit(view)

    def _go_to_maps(self) -> None:
        """To the view's photograph and re-rendering, at full size."""
        view = showing.standing(self.state)
        if view >= 0 and self._shell is not None:
            self.view_picked.emit(view)
            self._shell.wishes.show_page.emit("maps")

    def _close_photograph(self) -> None:
        self.photograph.hide()
        self._actions["close"].setEnabled(False)
        self.canvas.setFocus()

    def _go_home(self) -> None:
        self._turn_to(showing.at_home(self.state, self._aspect).eye, home=True)

    def _turn_to_view(self, view: str) -> None:
        self._turn_to(showing.turned_to(self.state, view).eye)

    def _fit(self, what: str) -> None:
        self._turn_to(showing.framed(self.state, what, self._aspect).eye)

    def _ask_point(self, x: float, y: float) -> None:
        if self._supervisor is not None:
            self._probe = self._supervisor.probe(x, y)

    def _ask_screenshot(self) -> None:
        said, _ = QFileDialog.getSaveFileName(
            self, self.tr("Save a screenshot"), self._beside("3d.png"), self.tr("Pictures (*.png)")
        )
        if not said:
            return
        path = self._ended(Path(said), ".png")
        failed = None if path is None else self.take_screenshot(path)
        if failed is not None:
            show_trouble(self, failed)
        elif path is not None and self._shell is not None:
            self._shell.wishes.say.emit(self.tr("Screenshot saved: {0}").format(path))

    def _film_button(self) -> QPushButton:
        button = QPushButton(self.tr("&Video"))
        button.setAccessibleName(self.tr("Video"))
        menu = QMenu(button)
        menu.addActions([self._actions[kind] for kind in film.PICTURES])
        button.setMenu(menu)
        return button

    def _ask_film(self, kind: str, title: str) -> None:
        video, pictures = self.tr("Video (*.mp4)"), self.tr("PNG files in a new folder (*)")
        said, chosen = QFileDialog.getSaveFileName(
            self, title, self._beside(f"{kind}{VIDEO}"), f"{video};;{pictures}"
        )
        if not said:
            return
        path: Path | None = Path(said)
        if chosen == video:
            path = self._ended(Path(said), VIDEO)
        elif Path(said).suffix == VIDEO:
            path = Path(said).with_suffix("")
        failed = None if path is None else self.save_film(kind, path)
        if failed is not None:
            show_trouble(self, failed)

    def _ended(self, said: Path, ending: str) -> Path | None:
        """The name with its ending; None, and told, where that is another file, which nobody agreed to lose."""
        path = said if said.suffix.lower() == ending else said.with_name(said.name + ending)
        if path != said and path.exists():
            there = Trouble(self.tr("{0} is there already").format(path), self.tr("choose another name"))
            show_trouble(self, there)
            return None
        return path

    def _film_ended(self, failed: Trouble | None) -> None:
        self._filming = None
        self._ask(moving=False)
        if failed is not None:
            show_trouble(self, failed)

    def _say_saved(self, path: Path) -> None:
        if self._shell is not None:
            self._shell.wishes.say.emit(self.tr("Video saved: {0}").format(path))

    def _beside(self, ending: str) -> str:
        """A file's name to begin with, where the last one went."""
        folder = self._shell.settings.value.last_folder if self._shell is not None else ""
        name = self._session.stem if self._session is not None else "roomlight"
        return str(Path(folder) / f"{name}-{ending}")

    # Measuring

    def _measure(self) -> None:
        """Load what is measured in, and open the row."""
        folder = self._session
        if folder is not None:
            self._background.ask(
                "maps", lambda: maps.load_current(folder), self._open_scale, lambda fault: tell(self._shell, self, fault)
            )  # fmt: skip

    def _open_scale(self, loaded: Maps | None) -> None:
        self._maps = loaded
        self.scale.show_run(loaded)
        if loaded is not None:
            self.scale.open()

    def _ask_mark(self, x: float, y: float) -> None:
        if self._supervisor is not None and self.scale.isVisible():
            self._marking = self._supervisor.probe(x, y)

    def _mark(self, point: Float[np.ndarray, " 3"]) -> None:
        """Mark a point of the world."""
        pose = self._pose
        at = None if self._maps is None or pose is None else marks.in_picture(self._maps, pose, point)
        if at is not None:
            self.scale.mark(QPointF(*at))

    def _show_marks(self) -> None:
        pose, points = self._pose, np.empty((0, 3))
        if self._maps is not None and pose is not None:
            points = marks.in_space(self._maps, pose, [mark.toTuple() for mark in self.scale.marks])
        self.canvas.show_marks(points)

    @property
    def _pose(self) -> Float[np.ndarray, "3 4"] | None:
        """Of the view in which the surface stands."""
        return showing.pose_of(self.state.contents, showing.standing(self.state))

    def _scale_written(self, said: str) -> None:
        self.refresh()
        self._measure()
        if self._shell is not None:
            self._shell.wishes.say.emit(said)

    # Moving the eye

    def _turn_to(self, eye: Orbit, home: bool = False) -> None:
        self._homing = home
        self.turn.go(self.state.eye, eye)

    def _pass(self, eye: Orbit) -> None:
        self._show(showing.moved(self.state, eye))
        self._ask(moving=True)

    def _arrive(self, eye: Orbit) -> None:
        self._show(replace(showing.moved(self.state, eye), home=self._homing))
        self._ask(moving=False)

    def _resized(self) -> None:
        for part in (self.cover, self.banner, self.photograph):
            if not part.isHidden():
                part.place()
        if self.state.home and self.state.contents.folder:
            self._show(showing.at_home(self.state, self._aspect))
        self._settle.start()

    def _restyle(self, state: Showing) -> None:
        self._show(state)
        self._ask(moving=False)

    def _show(self, state: Showing) -> None:
        panel_too = (state.contents, state.style, state.chosen) != (
            self.state.contents, self.state.style, self.state.chosen,
        )  # fmt: skip
        self.state = state
        self.canvas.show_state(state)
        if panel_too:
            self.panel.show_state(state)
            for name in ("measure", "mark"):
                self._actions[name].setEnabled(state.contents.triangles > 0)
            self._show_marks()

    def _ask(self, moving: bool) -> None:
        """Leave with the supervisor what should be drawn."""
        if self._supervisor is not None and self._session is not None and self._filming is None:
            self._supervisor.look(self.state.eye, *self.canvas.device_size(), moving, self.state.style)

    @property
    def _aspect(self) -> float:
        return max(self.canvas.width(), 1) / max(self.canvas.height(), 1)

    def _timer(self, milliseconds: int, call: Callable[[], None]) -> QTimer:
        timer = QTimer(self)
        timer.setInterval(milliseconds)
        timer.setSingleShot(True)
        timer.timeout.connect(call)
        return timer


def _rgb(name: str) -> Colour:
    colour = QColor(name)
    return colour.red(), colour.green(), colour.blue()
