"""From a scene and a style to what a renderer draws: triangles, lines and dots. World frame, colours 0 to 255.

A part is made once and handed out again until something it depends on changes, so a renderer need only compare
identities to know what to send to the graphics card.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from app.viewer import frusta, shades
from app.viewer.protocol import AXES, Style
from app.viewer.scene import MOVING_EMITTERS, Scene
from app.viewer.solids import ball, ellipsoids, grid
from engine.geometry import inverse, transform

ELLIPSOIDS, MOVING_ELLIPSOIDS = 1500, 400
SPARSE = (142, 150, 162)
LEVELS = 2  # still, moving
FLOOR = 72  # of what shines least; the ground is darker
FAINT = 0.5  # of the ink against the background: lines of the cameras beside a surface


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """A mesh; shaded by a light at the eye where it has normals."""

    points: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    colours: UInt8[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """One colour a line."""

    points: Float[np.ndarray, "v 3"]
    pairs: Int[np.ndarray, "l 2"]
    colours: UInt8[np.ndarray, "l 3"]


@dataclass(frozen=True, slots=True, eq=False)
class Dots:
    """Round points; a radius is `size` scene units, but not outside of `least` to `most` (1 is usual)."""

    points: Float[np.ndarray, "n 3"]
    colours: UInt8[np.ndarray, "n 3"]
    size: Float[np.ndarray, " n"]
    least: Float[np.ndarray, " n"]
    most: Float[np.ndarray, " n"]


@dataclass(frozen=True, slots=True, eq=False)
class Glows:
    """Soft light around lamps; `reach` in scene units."""

    points: Float[np.ndarray, "n 3"]
    colours: UInt8[np.ndarray, "n 3"]
    reach: Float[np.ndarray, " n"]


Part = Triangles | Lines


class Parts:
    """The parts of one scene, made when they are asked for."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._kept: dict[Hashable, tuple[Hashable, Any]] = {}
        self._painted: dict[str, shades.Layer] = {}

    def paint(self, name: str, layer: shades.Layer) -> None:
        """Add or replace a surface layer; its colours may be those of a coarser or finer grid than the maps'."""
        self._painted[name] = layer
        for level in range(LEVELS):
            self._kept.pop(("surface", level), None)

    def solid(self, style: Style, level: int) -> dict[str, Part]:
        """Meshes and lines by name; `level` 0 in full, 1 for while the eye moves."""
        scene, found = self.scene, {}
        shown = set(style.visible)
        if "surface" in shown and scene.sheets:
            key = (style.surface, style.view, style.pose)
            found["surface"] = self._once(("surface", level), key, lambda: self._surface(style, level))
        if "lamps" in shown and scene.lamps is not None and len(scene.lamps.radii):
            found["lamps"] = self._once("lamps", style.exposure_ev, lambda: self._lamps(style))
        if "cameras" in shown and scene.contents.poses:
            found["cameras"] = self._once(
                "cameras", (style.line, style.bottom, style.frusta), lambda: self._cameras(style)
            )
        if "axes" in shown:
            found["axes"] = self._once("axes", None, self._axes)
        if "grid" in shown:
            found["grid"] = self._once("grid", (style.line, style.bottom), lambda: self._grid(style))
        return found

    def ellipsoids(self, style: Style, level: int) -> dict[str, Part]:
        """The brightest emitters, apart from the rest because they may be cut away."""
        if not self.shines(style) or style.emitters != "ellipsoids":
            return {}
        key = style.exposure_ev
        return {"ellipsoids": self._once(("ellipsoids", level), key, lambda: self._ellipsoids(style, level))}

    def emitters(self, style: Style, level: int) -> Dots | None:
        """Those that are drawn as dots."""
        if not self.shines(style) or style.emitters == "splats":
            return None
        key = (style.exposure_ev, style.emitters)
        return self._once(("emitters", level), key, lambda: self._emitters(style, level))

    def points(self, style: Style, level: int) -> Dots | None:
        """The sparse points that the cameras were placed by."""
        poses = self.scene.poses
        if "points" not in style.visible or poses is None or len(poses.points) == 0:
            return None
        return self._once(("points", level), None, lambda: self._points(level))

    def shines(self, style: Style) -> bool:
        """Whether any emitters are to be seen."""
        emitters = self.scene.emitters
        return "emitters" in style.visible and emitters is not None and len(emitters) > 0

    def glows(self, style: Style) -> Glows | None:
        lamps = self.scene.lamps
        if "lamps" not in style.visible or lamps is None or len(lamps.radii) == 0:
            return None
        return self._once("glows", style.exposure_ev, lambda: self._glows(style))

    def _once(self, name: Hashable, key: Hashable, make: Callable[[], Any]) -> Any:
        kept = self._kept.get(name)
        if kept is None or kept[0] != key:
            kept = self._kept[name] = (key, make())
        return kept[1]

    def white(self, style: Style) -> float:
        """The radiance that is shown as bright."""
        return self.scene.white / 2.0**style.exposure_ev

    def _surface(self, style: Style, level: int) -> Triangles:
        sheet = self.scene.sheets[min(level, len(self.scene.sheets) - 1)]
        known = {**(self.scene.layers or {}), **self._painted}
        layer = known.get(style.surface) or known["shaded"]
        stands = inverse(np.array(style.pose).reshape(3, 4)) if style.pose else None
        pose = self.scene.world_from_cam(style.view) if stands is None else stands
        row, column = sheet.pixels.T
        return Triangles(
            transform(pose, sheet.points),
            sheet.triangles,
            layer.colours[row, column],
            sheet.normals @ pose[:, :3].T if layer.lit else None,
        )

    def _ellipsoids(self, style: Style, level: int) -> Triangles:
        emitters = self.scene.emitters
        assert emitters is not None
        count = min(MOVING_ELLIPSOIDS if level else ELLIPSOIDS, len(emitters))
        colours = _on_dark(shades.toned(emitters.radiance[:count], self.white(style)))
        # The shell where exp(-q) is 0.8: that of one half would hide the neighbours.
        halves = emitters.axes[:count] * (-np.log(0.8)) ** 0.5
        up = np.array(self.scene.contents.up)
        points, triangles, painted = ellipsoids(emitters.gaussians.means[:count], halves, colours, up)
        return Triangles(points, triangles, painted)

    def _lamps(self, style: Style) -> Triangles:
        lamps = self.scene.lamps
        assert lamps is not None
        ball_points, ball_triangles = ball(3)
        points = lamps.centres[:, None] + lamps.radii[:, None, None] * ball_points
        count = np.arange(len(lamps.radii))[:, None, None] * len(ball_points)
        colours = np.repeat(shades.toned(lamps.radiance, self.white(style)), len(ball_points), 0)
        return Triangles(points.reshape(-1, 3), (ball_triangles + count).reshape(-1, 3), colours)

    def _glows(self, style: Style) -> Glows:
        lamps = self.scene.lamps
        assert lamps is not None
        share = shades.bright(lamps.radiance, self.white(style))
        return Glows(
            np.asarray(lamps.centres, np.float64),
            shades.toned(lamps.radiance, self.white(style)),
            np.asarray(lamps.radii * (2 + 5 * share), np.float64),
        )

    def _cameras(self, style: Style) -> Lines:
        contents = self.scene.contents
        poses = np.array([pose for pose in contents.poses if pose]).reshape(-1, 3, 4)
        points = frusta.corners(poses, contents.aspect, contents.fov, contents.frustum * style.frusta)
        pairs = (np.array(frusta.EDGES) + 5 * np.arange(len(points))[:, None, None]).reshape(-1, 2)
        # Dozens of cameras around an object must not hide it.
        share = FAINT if self.scene.sheets else 1.0
        colour = share * np.array(style.line) + (1 - share) * np.array(style.bottom)
        return Lines(points.reshape(-1, 3), pairs, np.tile(colour.astype(np.uint8), (len(pairs), 1)))

    def _axes(self) -> Lines:
        length = self.scene.contents.room_radius / 8
        points = np.concatenate([np.zeros((1, 3)), length * np.eye(3)])
        return Lines(points, np.array([[0, 1], [0, 2], [0, 3]]), np.array(AXES, np.uint8))

    def _grid(self, style: Style) -> Lines:
        points, pairs, fade = grid(self.scene)
        colours = np.array(style.line) * 0.55 * (1 - fade[:, None]) + np.array(style.bottom) * fade[:, None]
        return Lines(points, pairs, colours.astype(np.uint8))

    def _emitters(self, style: Style, level: int) -> Dots:
        emitters = self.scene.emitters
        assert emitters is not None
        first = min(ELLIPSOIDS, len(emitters)) if style.emitters == "ellipsoids" else 0
        chosen = slice(first, MOVING_EMITTERS if level else None)
        radiance = emitters.radiance[chosen]
        share = shades.bright(radiance, self.white(style))
        width = np.median(np.asarray(emitters.gaussians.scales[chosen], np.float64), axis=1)
        width = np.minimum(width, 1.5 * np.median(width)) if len(width) else width
        larger = 0.7 + 1.1 * share
        return Dots(
            np.asarray(emitters.gaussians.means[chosen], np.float32),
            _on_dark(shades.toned(radiance, self.white(style))),
            (0.17 * width * larger).astype(np.float32),
            (0.95 * larger).astype(np.float32),
            (2.7 * larger).astype(np.float32),
        )

    def _points(self, level: int) -> Dots:
        assert self.scene.poses is not None
        points = np.asarray(self.scene.poses.points, np.float32)
        points = points[:: max(len(points) // MOVING_EMITTERS, 1)] if level else points
        same = np.full(len(points), 0.9, np.float32)
        return Dots(points, np.tile(np.array(SPARSE, np.uint8), (len(points), 1)), 0 * same, same, same)


def _on_dark(colours: UInt8[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """What is darker than the ground lifted above it, so that it can be seen; the rest as it is."""
    lift = np.maximum(FLOOR - colours.max(axis=1, initial=0).astype(np.int16), 0)
    return (colours + lift[:, None]).astype(np.uint8)
