"""The relight page: the recovered surface under its own light turned, its lamps dimmed, or a panorama, in real time.

A child prepares the surface once (its result is kept with the session), whatever page is shown; frames are drawn in a thread of the page's
own, and only the newest wish is drawn.
"""

import dataclasses
import functools
import itertools
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QTimer
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QMenu,
    QPushButton,
    QWidget,
)

from app.inspect import maps
from app.inspect.maps import Maps
from app.inspect.runs import Run
from app.relight import files as relighting_files
from app.relight import panoramas
from app.relight import relit as relighting
from app.relight.relit import Light, Setting, Transfer
from app.state import Trouble, called
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.empty import Empty
from app.views.errand import Errand
from app.views.head import Head
from app.views.page_actions import page_action
from app.views.page_column import Either, lay_out
from app.views.pages import Shell, tell
from app.views.relight.canvas import RelightCanvas
from app.views.relight.controls import RelightControls

PLAY_MS = 33
PLAY_DEGREES_S = 24.0
FRAMES = 24  # whose pace is told


class RelightPage(QWidget):
    """The object in another light."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = self.tr("Relight")
        self.setAccessibleName(self.title)
        self._shell: Shell | None = None
        self._session: Path | None = None
        self._run: Run | None = None
        self._transfer: Transfer | None = None
        self._light: Light | None = None
        self._grid = (0, 0)  # rows and columns of the maps
        self._numbers = itertools.count(1)
        self._white = 1.0
        self._panorama: Path | None = None  # in place of the recovered light
        self._drawing = self._stale = False
        self._ends: deque[float] = deque(maxlen=FRAMES)
        self._lit: list[QAction] = []  # what needs a surface and its light
        self._scratch: tempfile.TemporaryDirectory[str] | None = None
        self._background = Background(self, "relight")

        self.canvas = RelightCanvas(self)
        self.controls = RelightControls(self)
        self.save_button = QPushButton(self.tr("&Save"))
        self.save_button.setAccessibleName(self.tr("Save"))
        self.head, self.empty = Head(self, self.save_button), Empty("relight")
        self.said = self.head.state
        self.errand = Errand(self)
        self.errand.noted.connect(self.said.setText)
        self.errand.done.connect(self._take)
        self.errand.failed.connect(self._fail)
        self.errand.changed.connect(self._show_state)
        self.head.add(self.errand)
        self.stack = Either(self.empty, self.canvas)
        across = QHBoxLayout()
        across.setSpacing(0)
        across.addWidget(self.stack, 1)
        across.addWidget(self.controls)
        lay_out(self, self.head, across)

        self.canvas.turned.connect(self.controls.turn_by)
        self.canvas.lamp_moved.connect(self.controls.move_lamp)
        self.controls.lamp_changed.connect(self._show_lamp)
        self.controls.ready_picked.connect(self._pick_ready)
        self.canvas.exposed.connect(lambda by: self.controls.ev.setValue(self.controls.ev.value() + by))
        self.controls.changed.connect(self.draw)
        self.controls.view_picked.connect(self._pick_view)
        self.controls.panorama_wanted.connect(self._ask_panorama)
        self.controls.playing.connect(self._play)
        self.controls.in_space.connect(self.show_in_space)
        self._timer = QTimer(self)
        self._timer.setInterval(PLAY_MS)
        self._timer.timeout.connect(lambda: self.controls.turn_by(PLAY_DEGREES_S * PLAY_MS / 1000, 0.0))
        self._make_actions()
        self._say_nothing()

    # The contract with the window

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.empty.use(shell)
        self._say_nothing()
        self.errand.board = shell.board
        shell.board.listen(Bridge(self).latest(self._look_again))

    def show_session(self, folder: Path | None) -> None:
        """Show a session's surface; returns at once."""
        if folder != self._session:
            self._forget()
            self._session = folder
            self.head.show_session(folder)
            self.controls.as_photographed()
            self.controls.ev.setValue(0)
        self.refresh()

    def refresh(self) -> None:
        """Look whether there is a new result."""
        folder = self._session
        if folder is None:
            self._background.drop("runs")
            self._say_nothing()
        else:
            self._background.ask("runs", lambda: _found(folder), self._show_run, self._tell)

    def _look_again(self) -> None:
        """A surface that could not be prepared for want of merged brackets is, once they are there."""
        folder = self._session
        if folder is not None and self._transfer is None and self.isVisible() and not self.errand.busy:
            self._background.ask("runs", lambda: _found(folder), self._show_grown, self._tell)

    def _show_grown(self, answer: tuple[Run | None, Maps | None]) -> None:
        run = answer[0]
        if run is not None and (self._run is None or run.records.keys() != self._run.records.keys()):
            self._show_run(answer)

    def showEvent(self, event) -> None:
        super().showEvent(event)
        if self._session is not None:
            self.refresh()
        if self._stale and not self._drawing:
            self.draw()

    def hideEvent(self, event) -> None:
        self.controls.play.setChecked(False)
        super().hideEvent(event)

    # Drawing

    def draw(self) -> None:
        """Draw the newest wish; while one is being drawn, the next waits for it."""
        transfer, light = self._transfer, self._light
        if transfer is None or light is None:
            return
        if self._drawing or not self.isVisible():
            self._stale = True
            return
        self._drawing, self._stale = True, False
        setting, white, tone = self._setting(), self._white, self.controls.tone
        ev, room = self.controls.exposure_ev, self.controls.behind.isChecked()

        def work():
            pixels = relighting.drawn(transfer, light, setting, white, ev, tone, room)
            return pixels, relighting.overview(light, transfer.middle, setting, 4 * white)

        self._background.ask("frame", work, self._show_frame, self._tell)

    def _setting(self) -> Setting:
        """As the controls have it; the person's own lamp lights white paint white."""
        power = np.pi * self._white * self.controls.lamp_power
        return dataclasses.replace(self.controls.setting(), spot_energy=float(power))

    def _show_frame(self, made) -> None:
        self._drawing = False
        self.canvas.show_pixels(made[0])
        self.stack.setCurrentWidget(self.canvas)
        self.controls.show_light(made[1])
        now = time.monotonic()
        if self._ends and now - self._ends[-1] > 0.5:
            self._ends.clear()
        self._ends.append(now)
        if len(self._ends) > 4:
            pace = (len(self._ends) - 1) / max(self._ends[-1] - self._ends[0], 1e-6)
            self.canvas.say(self.tr("{pace:.0f} frames/s").format(pace=pace))
        if self._stale:
            self.draw()

    def _play(self, on: bool) -> None:
        if on and self._transfer is not None:
            self._timer.start()
        else:
            self._timer.stop()

    # Preparing

    def _show_run(self, answer: tuple[Run | None, Maps | None]) -> None:
        run, shown = answer
        if run is None or shown is None:
            self._forget()
            self._say_nothing()
            return
        ours = self._run is not None and run.fingerprint == self._run.fingerprint
        if ours and (self._transfer is not None or self.errand.busy):
            return
        self._forget()
        self._run, self._grid = run, shown.surface.mask.shape
        views = [(name, i) for i, name in enumerate(shown.names) if shown.registered[i]]
        self.controls.offer(views, None)
        there = relighting_files.lights_of(run)
        if relighting_files.transfer_file(run).is_file() and there:
            self._load(run, there[0])
        elif self.isVisible():
            self._prepare(None)

    def _pick_view(self, index: int) -> None:
        view = int(self.controls.view.itemData(index))
        if self._run is None:
            return
        if relighting_files.transfer_file(self._run).is_file() and view in relighting_files.lights_of(
            self._run
        ):
            self._load(self._run, view)
        else:
            self._prepare(view)

    def _prepare(self, view: int | None) -> None:
        """Let the child work out the surface's answer and the light of a view (None: one in the middle)."""
        if self._run is None:
            return
        request = {"session": str(self._run.session), "fingerprint": self._run.fingerprint, "view": view}
        if self._transfer is None:
            self._say(
                Trouble(
                    self.tr("Preparing the surface for relighting…"),
                    self.tr("this is done once for each result"),
                )
            )
        self.errand.begin(self.tr("Prepare relighting"), "relight", request)

    def _show_lamp(self) -> None:
        self.canvas.show_lamp(self.controls.lamp)
        self._show_state()

    def _pick_ready(self, name: str) -> None:
        if name:
            self.load_panorama(panoramas.file(name))
        elif self._run is not None:
            known = relighting_files.lights_of(self._run)
            if known:
                self._load(self._run, known[0])

    def load_panorama(self, path: Path) -> None:
        """Light the object with a picture."""
        if self._transfer is None:
            return
        self._panorama = path
        request = {"file": str(path), "to": str(self._scrap("panorama.npz"))}
        self.errand.begin(self.tr("Read panorama"), "panorama", request)

    def _take(self, task: str, result: dict) -> None:
        if task == "relit":
            if self._shell is not None:
                self._shell.wishes.say.emit(self.tr("Saved {0}").format(result["to"]))
        elif task == "panorama":
            self._load_panorama(Path(result["light"]))
        elif self._run is not None:
            self._load(self._run, int(result["view"]))
            if self._shell is not None and not self.isVisible():
                self._shell.wishes.say.emit(self.tr("Relighting is prepared"))

    def _fail(self, fault: Trouble) -> None:
        if self._transfer is None:
            self._say(fault, (self.tr("&Prepare again"), lambda: self._prepare(None)))
        else:
            self._tell(fault)

    def _show_state(self) -> None:
        """What can be done now."""
        ready = self._transfer is not None
        self._enable(ready)
        if not self.errand.busy:
            self.said.setText(self._told())
            if self._run is not None and not ready:
                self._say(
                    Trouble(self.tr("The surface is not prepared for relighting yet")),
                    (self.tr("&Prepare"), lambda: self._prepare(None)),
                )

    def _load(self, run: Run, view: int) -> None:
        kept = self._transfer

        def work() -> tuple[Transfer, Light, float]:
            surface = kept or relighting_files.load_transfer(relighting_files.transfer_file(run))
            loaded = relighting_files.load_light(relighting_files.light_file(run, view))
            return surface, loaded, relighting.white_of(relighting.relit(surface, loaded, Setting()))

        self._background.ask("light", work, lambda made: self._use(*made, view), self._tell)

    def _use(self, transfer: Transfer, light: Light, white: float, view: int) -> None:
        self._transfer, self._white, self._panorama = transfer, white, None
        self.controls.ready.setCurrentIndex(0)
        self.controls.view.setCurrentIndex(self.controls.view.findData(view))
        self._show_light(
            light, self.tr("Recovered from the photographs, as in view {name}.").format(name=light.name)
        )

    def _load_panorama(self, path: Path) -> None:
        transfer = self._transfer
        if transfer is None:
            return

        def work() -> tuple[Light, float]:
            light = relighting_files.load_light(path)
            return light, relighting.white_of(relighting.relit(transfer, light, Setting()))

        self._background.ask("light", work, lambda made: self._use_panorama(*made), self._tell)

    def _use_panorama(self, light: Light, white: float) -> None:
        self.controls.view.setCurrentIndex(-1)
        names = [panoramas.file(name) for name in panoramas.NAMES]
        row = names.index(self._panorama) + 1 if self._panorama in names else -1
        self.controls.ready.setCurrentIndex(row)
        self._white = white
        self._show_light(light, self.tr("Panorama {name}, exposed for the object.").format(name=light.name))

    def _show_light(self, light: Light, said: str) -> None:
        self._light = light
        self._drawing = False
        clipped = [bool(light.lamp_clipped[light.lamp_group == i].any()) for i in range(light.lamps)]
        names = [
            self.tr("Lamp {n}").format(n=i + 1) + (" *" if bare else "") for i, bare in enumerate(clipped)
        ]
        self.controls.show_lamps(names, clipped)
        self.controls.source.setText(said)
        self._show_state()
        self.draw()

    def _told(self) -> str:
        if self._transfer is None:
            return ""
        rows, columns = self._transfer.size
        told = (
            self.tr("Preview of {w} x {h} pixels. Drag, or use the arrow keys, to turn the light.")
            if self.controls.lamp is None
            else self.tr("Preview of {w} x {h} pixels. Drag, or use the arrow keys, to move the lamp.")
        )
        return told.format(w=columns, h=rows)

    def _forget(self) -> None:
        self.controls.play.setChecked(False)
        self._background.drop("light")
        self._background.drop("frame")
        self._drawing = self._stale = False
        self._run = self._transfer = self._light = None
        self.errand.stop()
        self._enable(False)
        self.controls.offer([], None)
        self.canvas.show_pixels(None)
        self._say(Trouble(""))

    def _say(self, why: Trouble, *leads: tuple[str, Callable[[], object]]) -> None:
        """In place of the picture."""
        self.empty.say(why, *leads)
        self.stack.setCurrentWidget(self.empty)

    def _say_nothing(self) -> None:
        self.empty.say_nothing_yet(self._session)
        self.stack.setCurrentWidget(self.empty)
        self.said.setText("")

    def show_in_space(self) -> None:
        """Let the 3D page show the surface as it is lit now."""
        transfer, light, maps_grid = self._transfer, self._light, self._grid
        if transfer is None or light is None or self._shell is None:
            return
        shell, setting = self._shell, self._setting()
        bright = 2.0**self.controls.exposure_ev / self._white
        # A name of its own each time: the 3D page reads it when it comes to it.
        to = self._scrap(f"relit-{next(self._numbers)}.npy")

        def work() -> Path:
            lit = relighting.relit(transfer, light, setting) * np.float32(bright)
            np.save(to, relighting.on_maps(transfer, lit, maps_grid))
            return to

        def done(path: Path) -> None:
            shell.state.relit.set(path)
            shell.wishes.show_page.emit("view3d")

        self._background.ask("space", work, done, self._tell)

    # Files

    def _scrap(self, name: str) -> Path:
        """A file that lasts as long as the page."""
        self._scratch = self._scratch or tempfile.TemporaryDirectory(prefix="roomlight-")
        return Path(self._scratch.name) / name

    def _ask_panorama(self) -> None:
        start = str(self._session.parent if self._session else Path.home())
        chosen, _ = QFileDialog.getOpenFileName(
            self, self.tr("Panorama"), start, self.tr("Panoramas (*.exr *.hdr *.pic *.png *.jpg *.jpeg)")
        )
        if chosen:
            self.load_panorama(Path(chosen))

    def _ask_save(self, kind: str) -> None:
        if self._transfer is None or self._session is None:
            return
        start = str(self._session.parent / f"{called(self._session)}-relit.{kind}")
        to, _ = QFileDialog.getSaveFileName(self, self.tr("Save"), start, f"{kind.upper()} (*.{kind})")
        if to:
            self.save(Path(to))

    def save(self, to: Path) -> None:
        """Write a picture: PNG at the photographs' own size, EXR as linear radiance, both with the object's mask as alpha; a
        video of the light going round, or a page to give away. What takes long a child does."""
        transfer, light = self._transfer, self._light
        if transfer is None or light is None:
            return
        setting, room, kind = self._setting(), self.controls.behind.isChecked(), to.suffix.lower()
        reduced = transfer.mask.shape != self._grid
        if kind in (".mp4", ".html") or (kind == ".png" and reduced):
            self.errand.begin(self.tr("Save {0}").format(to.name), "relit", self._wish(to, setting))
            return
        if kind != ".exr":
            image = self.canvas.image
            if image is not None and not image.save(str(to)):
                self._tell(
                    Trouble(
                        f"{to}: could not be written", self.tr("choose another folder, or check the disk")
                    )
                )
            return

        def work() -> None:
            ground = relighting.behind(transfer, light, setting) if room else None
            picture, inside = relighting.framed(transfer, relighting.relit(transfer, light, setting), ground)
            relighting_files.save_exr(to, picture, inside, f"{light.name}, {setting}")

        self._background.ask("save", work, lambda done: None, self._tell)

    def _wish(self, to: Path, setting: Setting) -> dict[str, Any]:
        """What the child draws."""
        view = self.controls.view.currentData()
        return {
            "session": str(self._session), "to": str(to), "light": "" if self._panorama is None else str(self._panorama),
            "view": view, "setting": dataclasses.asdict(setting), "spot": self.controls.lamp_power,
            "exposure_ev": self.controls.exposure_ev, "tone": self.controls.tone, "room": self.controls.behind.isChecked(),
        }  # fmt: skip

    def _make_actions(self) -> None:
        for text, keys, call in (
            (self.tr("Light as photographed"), "R", self.controls.as_photographed),
            (self.tr("Turn the light slowly"), "P", self.controls.play.toggle),
            (self.tr("Drag a lamp on the picture"), "L", self.controls.lamp_on.toggle),
            (self.tr("Show the light behind the object"), "B", self.controls.behind.toggle),
            (self.tr("Load a panorama"), "Ctrl+L", self._ask_panorama),
            (self.tr("Show the surface in this light on the 3D page"), "Ctrl+Shift+D", self.show_in_space),
            (self.tr("Brighter"), "E", lambda: self.controls.ev.setValue(self.controls.ev.value() + 1)),
            (self.tr("Darker"), "Shift+E", lambda: self.controls.ev.setValue(self.controls.ev.value() - 1)),
        ):
            self._lit.append(page_action(self, text, keys, call))
        menu = QMenu(self.save_button)
        for text, keys, kind, tip in (
            (self.tr("Picture (PNG)…"), "Ctrl+Shift+S", "png", self.tr("At the photographs' own size; clear around the object, or with its light")),
            (self.tr("Radiance (EXR)…"), "", "exr", self.tr("Linear radiance, with the object's mask as alpha")),
            (self.tr("Video (MP4)…"), "", "mp4", self.tr("The light, and the lamp, once round the object")),
            (self.tr("Web page (HTML)…"), "", "html", self.tr("One file to give away: turned and relit in any browser")),
        ):  # fmt: skip
            action = page_action(self, text, keys, functools.partial(self._ask_save, kind))
            action.setToolTip(tip)
            menu.addAction(action)
            self._lit.append(action)
        menu.setToolTipsVisible(True)
        self.save_button.setMenu(menu)
        page_action(self, self.tr("Look for new results"), "F5", self.refresh)
        self._enable(False)

    def _enable(self, ready: bool) -> None:
        """The controls, and the keys that do as they do."""
        self.controls.setEnabled(ready)
        self.save_button.setEnabled(ready)
        for action in self._lit:
            action.setEnabled(ready)

    def _tell(self, fault: Trouble) -> None:
        tell(self._shell, self, fault)


def _found(session: Path) -> tuple[Run | None, Maps | None]:
    shown = maps.load_current(session)
    return None if shown is None else shown.run, shown
