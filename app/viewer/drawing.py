"""From what the window asks to see to pictures: quickly while the eye moves, better and better once it rests.

A resting picture is the mean of several, each seen from a fraction of a pixel further aside: smooth edges from a
renderer that has none. Between any two of them a new wish may come in. World frame; see canvas.Eye.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, UInt8

from app.viewer import orbit as orbits
from app.viewer import splats, sprites
from app.viewer.canvas import Canvas, Eye, Picture
from app.viewer.pace import Effort, Pace
from app.viewer.parts import LEVELS, Parts
from app.viewer.protocol import Look
from app.viewer.scene import Scene
from app.viewer.splats import Haze, Splats
from engine.geometry import inverse, transform

ASIDE = (  # pixels; an even spread over one pixel, its middle first (eight queens)
    (0.0, 0.0), (0.31, -0.19), (-0.31, 0.19), (-0.19, -0.31), (0.19, 0.31), (0.44, 0.06), (-0.44, -0.06),
    (0.06, 0.44), (-0.06, -0.44),
)  # fmt: skip
TOLD = (1, 3, 5, len(ASIDE))
"""After how many of them the window gets to see the mean."""
USUAL_PX = 1.05  # usual radius of a dot, pixels in a picture USUAL_HEIGHT high
USUAL_HEIGHT = 620
LEAST_GLOW_PX = 9.0


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A picture to be shown."""

    pixels: UInt8[np.ndarray, "h w 4"]
    samples: int
    last: bool
    milliseconds: float


class Drawing:
    """Draws one wish after the other on a canvas; lives in the canvas's thread."""

    def __init__(
        self,
        canvas: Canvas,
        clock: Callable[[], float] = time.perf_counter,
        note: Callable[[str], None] = lambda text: None,
    ) -> None:
        """`note` hears of work that takes longer than pictures do."""
        self._canvas, self._clock, self._note = canvas, clock, note
        self.parts: Parts | None = None
        self._splats: Splats | None = None
        self._pace = Pace()
        self._look: Look | None = None
        self._seen: tuple[Eye, np.ndarray] | None = None  # the last picture's eye and depth
        self._begin()

    def load(self, scene: Scene) -> None:
        """Show this from now on; the wish that is there begins anew."""
        self.parts, self._splats = Parts(scene), None
        self._pace.forget()
        self.restart()

    def look(self, look: Look) -> None:
        """The wish from now on."""
        before = self._look
        if before is None or (before.width, before.height, before.style) != (
            look.width, look.height, look.style,
        ):  # fmt: skip
            self._pace.forget()
        self._look = look
        self._begin()

    def restart(self) -> None:
        """Draw the present wish again."""
        self._begin()

    @property
    def number(self) -> int:
        """The wish's."""
        return -1 if self._look is None else self._look.number

    @property
    def pending(self) -> bool:
        """Whether `step` would do something."""
        if self._look is None:
            return False
        return self._samples < (1 if self._look.moving else len(ASIDE))

    def step(self) -> Drawn | None:
        """One more part of the present wish; a picture when one is worth showing."""
        look = self._look
        if look is None or not self.pending:
            return None
        if look.moving:
            return self._quick(look)
        if self._samples and self._hazy and not self._fine:
            self._band(look)
            return None
        start = self._clock()
        eye = self._eye(look, Effort(0, 1))
        pixels, depth = self._sample(look, eye, 0, ASIDE[self._samples])
        spent = 1e3 * (self._clock() - start)
        if self._samples == 0:
            self._seen = (eye, depth)
        if not self._hazy:
            self._pace.still(spent)
        if self._samples == 0 or (self._hazy and self._samples == 1):
            self._sum = np.zeros(pixels.shape, np.float32)  # the first haze was a coarse one
            self._counted = 0
        self._sum += pixels
        self._counted += 1
        self._samples += 1
        last = self._samples == len(ASIDE)
        if self._samples not in TOLD and not (self._hazy and self._samples == 2):
            return None
        mean = (self._sum / self._counted + 0.5).astype(np.uint8)
        return Drawn(mean, self._samples, last, spent)

    def probe(self, x: float, y: float) -> tuple[float, ...]:
        """The point under a place of the last picture (shares of its size); empty where there is nothing."""
        if self._seen is None:
            return ()
        eye, depth = self._seen
        row = min(max(int(y * depth.shape[0]), 0), depth.shape[0] - 1)
        column = min(max(int(x * depth.shape[1]), 0), depth.shape[1] - 1)
        reach = max(depth.shape[0] // 150, 2)
        around = depth[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        if not (around > 0).any():
            return ()
        z = float(depth[row, column]) or float(np.min(around[around > 0]))
        cam = z * np.array([(x - 0.5) * eye.width / eye.focal, (y - 0.5) * eye.height / eye.focal, 1.0])
        return tuple(float(value) for value in transform(inverse(eye.cam_from_world), cam))

    def _begin(self) -> None:
        self._samples, self._counted = 0, 0
        self._haze: Haze | None = None
        self._fine = False
        self._bands: list[np.ndarray] = []

    @property
    def _hazy(self) -> bool:
        if self._look is None or self.parts is None:
            return False
        return self._look.style.emitters == "splats" and self.parts.shines(self._look.style)

    def _quick(self, look: Look) -> Drawn:
        start = self._clock()
        effort = self._pace.effort
        eye = self._eye(look, effort)
        pixels, depth = self._sample(look, eye, effort.level, ASIDE[0])
        self._seen = (eye, depth)
        self._samples = 1
        spent = 1e3 * (self._clock() - start)
        self._pace.moved(spent)
        return Drawn(pixels, 1, True, spent)

    def _sample(
        self, look: Look, eye: Eye, level: int, aside: tuple[float, float]
    ) -> tuple[UInt8[np.ndarray, "h w 4"], Float[np.ndarray, "h w"]]:
        style, parts = look.style, self.parts
        eye = replace(eye, cam_from_world=_turned(eye, *aside))
        self._canvas.show(level, {} if parts is None else parts.solid(style, level))
        colour, depth = self._canvas.draw(level, eye)
        if parts is None:
            return sprites.grounded(colour, depth, style.top, style.bottom), depth
        open_eye = self._opened(look, eye)
        bodies = parts.ellipsoids(style, level)
        if bodies:
            self._canvas.show(LEVELS + level, bodies)
            colour, depth = _nearer((colour, depth), self._canvas.draw(LEVELS + level, open_eye))
        image = sprites.grounded(colour, depth, style.top, style.bottom)
        if self._hazy:
            image = splats.veil(image, depth, self._haze_for(look, open_eye))
        centre = eye.width / 2, eye.height / 2
        usual = USUAL_PX * max(eye.height / USUAL_HEIGHT, 0.8)
        for dots, near in (
            (parts.emitters(style, level), open_eye.near),
            (parts.points(style, level), eye.near),
        ):
            if dots is not None:
                sprites.dot(image, depth, dots, eye.cam_from_world, eye.focal, centre, usual, near)
        glows = parts.glows(style)
        if glows is not None:
            sprites.glow(image, depth, glows, eye.cam_from_world, eye.focal, centre, LEAST_GLOW_PX * usual)
        return image, depth

    def _eye(self, look: Look, effort: Effort) -> Eye:
        orbit, radius, room = look.orbit, 1.0, np.zeros(3)
        if self.parts is not None:
            contents = self.parts.scene.contents
            radius, room = contents.room_radius, np.array(contents.room)
        away = float(np.linalg.norm(orbits.eye(orbit) - room))
        height = max(look.height // effort.divisor, 1)
        return Eye(
            orbits.cam_from_world(orbit), orbits.focal_px(orbit, height), max(look.width // effort.divisor, 1),
            height, max(0.02 * orbit.distance, 1e-4 * radius), away + 8 * radius + orbit.distance,
        )  # fmt: skip

    def _haze_for(self, look: Look, eye: Eye) -> Haze:
        """The finished haze of a resting eye, else a coarse one."""
        if self._haze is None:
            divisor = 6 if look.moving else 4
            self._haze = self._compositor().coarse(eye, divisor, self._white(look))
        return self._haze

    def _band(self, look: Look) -> None:
        """The next rows of the fine haze."""
        eye = self._eye(look, Effort(0, 1))
        first = sum(len(band) for band in self._bands)
        last = min(first + splats.BAND, eye.height)
        self._bands.append(self._compositor().rows(self._opened(look, eye), 1, first, last))
        if last == eye.height:
            self._haze, self._fine = splats.haze(np.concatenate(self._bands), self._white(look)), True
            self._bands = []

    def _opened(self, look: Look, eye: Eye) -> Eye:
        """With the room cut open, as a doll's house, in front of the cameras if the eye is outside of them."""
        assert self.parts is not None
        contents = self.parts.scene.contents
        centre = np.array(contents.centre)
        depth = float((eye.cam_from_world[:, :3] @ centre + eye.cam_from_world[:, 3])[2])
        away = float(np.linalg.norm(orbits.eye(look.orbit) - centre))
        if not look.style.open_front or away < 1.5 * contents.radius:
            return eye
        return replace(eye, near=max(eye.near, depth - 1.1 * contents.radius))

    def _compositor(self) -> Splats:
        assert self.parts is not None
        assert self.parts.scene.emitters is not None
        if self._splats is None:
            if not splats.compiled():
                self._note("Preparing splats")
            self._splats = Splats(self.parts.scene.emitters)
        return self._splats

    def _white(self, look: Look) -> float:
        assert self.parts is not None
        return self.parts.white(look.style)


def _nearer(one: Picture, other: Picture) -> Picture:
    """Of two pictures of the same place what is in front."""
    (colour, depth), (colour2, depth2) = one, other
    front = (depth2 > 0) & ((depth <= 0) | (depth2 < depth))
    return np.where(front[..., None], colour2, colour), np.where(front, depth2, depth)


def _turned(eye: Eye, right_px: float, down_px: float) -> Float[np.ndarray, "3 4"]:
    """cam_from_world of an eye turned so far that the picture's middle moves by a fraction of a pixel."""
    a, b = right_px / eye.focal, down_px / eye.focal
    ca, sa, cb, sb = math.cos(a), math.sin(a), math.cos(b), math.sin(b)
    across = np.array([[ca, 0, sa], [0, 1, 0], [-sa, 0, ca]])
    along = np.array([[1, 0, 0], [0, cb, sb], [0, -sb, cb]])
    return along @ across @ eye.cam_from_world
