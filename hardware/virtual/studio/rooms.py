"""Furnish the virtual rooms: painted panels, lamps, and the free space in which the rig moves.

World frame: x and y along the walls, z up, metres, origin on the floor below the rig's centre. Everything
is built from rectangles (`Panel`), so that a lightmap is one picture per panel. Radiance is on one scale
per room; the brightest lamp stays below about 300 times the mean wall, which a bracket of three exposures can hold.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from hardware.errors import StudioError
from hardware.virtual.studio import order, paint
from hardware.virtual.studio.paint import Painter

TEXEL_M = 0.004  # under a pixel of the standard size from 1.7 m on

# What stands next to a lamp is small, dark and a little away from it: specks nearly as bright as the lamp
# itself would be found by chance only, and cost more samples than all the rest of the room.
SOOT = paint.paint_of((0.04, 0.04, 0.04))
NECK_M = 0.03

FREE_M = 0.98  # from a room's centre; nothing stands there, so that the rig may move


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """A diffuse rectangle seen from the side that `cross(down, right)` points to."""

    corner: Float[np.ndarray, "3"]  # world, metres: where the texture's first row and column meet
    right: Float[np.ndarray, "3"]  # whole edge along a row
    down: Float[np.ndarray, "3"]  # whole edge along a column
    albedo: Float[np.ndarray, "h w 3"]


@dataclass(frozen=True, slots=True, eq=False)
class Globe:
    """A glowing sphere."""

    centre: Float[np.ndarray, "3"]
    radius_m: float
    radiance: Float[np.ndarray, "3"]


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A glowing rectangle: window, ceiling light, screen; black when seen from behind."""

    corner: Float[np.ndarray, "3"]
    right: Float[np.ndarray, "3"]
    down: Float[np.ndarray, "3"]
    radiance: Float[np.ndarray, "h w 3"]


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A furnished room; nothing stands within `FREE_M` of `centre`."""

    name: str
    panels: tuple[Panel, ...]
    globes: tuple[Globe, ...]
    sheets: tuple[Sheet, ...]
    centre: Float[np.ndarray, "3"]
    polish: float = 0.0  # of the floor: what it mirrors of the light that falls on it


Vector = tuple[float, float, float]
X, Y, Z = np.eye(3)


class _Builder:
    """Collects what stands in a room while it is being furnished."""

    def __init__(self, size: Vector, seed: int, texel_m: float | None = None):
        self.size, self.texel_m = np.array(size), texel_m or TEXEL_M
        self.rng = np.random.default_rng(seed)
        self.panels: list[Panel] = []
        self.globes: list[Globe] = []
        self.sheets: list[Sheet] = []

    def face(self, middle: np.ndarray, normal: np.ndarray, up: np.ndarray, width: float, height: float,
             painter: Painter) -> None:  # fmt: skip
        """A panel around `middle`, upright along `up`, seen from where `normal` points."""
        right = np.cross(up, normal)
        corner = middle - right * width / 2 + up * height / 2
        albedo = painter(height, width, self.texel_m, self.rng)
        self.panels.append(Panel(corner, right * width, -up * height, albedo))

    def shell(self, walls: list[Painter], floor: Painter, ceiling: Painter) -> None:
        """Four walls (+x, +y, -x, -y), floor and ceiling."""
        lx, ly, lz = self.size
        for painter, axis, length in zip(walls, (X, Y, -X, -Y), (ly, lx, ly, lx), strict=True):
            middle = axis * np.abs(axis @ self.size) / 2 + Z * lz / 2
            self.face(middle, -axis, Z, length, lz, painter)
        self.face(np.zeros(3), Z, Y, lx, ly, floor)
        self.face(Z * lz, -Z, Y, lx, ly, ceiling)

    def box(self, low_middle: Vector, size: Vector, painter: Painter, yaw_deg: float = 0.0,
            front: Painter | None = None, top: Painter | None = None) -> None:  # fmt: skip
        """A box standing on `low_middle`; `front` is its local -y side."""
        c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
        x, y = np.array([c, s, 0.0]), np.array([-s, c, 0.0])
        sx, sy, sz = size
        middle = np.array(low_middle) + Z * sz / 2
        self.face(middle + x * sx / 2, x, Z, sy, sz, painter)
        self.face(middle - x * sx / 2, -x, Z, sy, sz, painter)
        self.face(middle + y * sy / 2, y, Z, sx, sz, painter)
        self.face(middle - y * sy / 2, -y, Z, sx, sz, front or painter)
        self.face(middle + Z * sz / 2, Z, y, sx, sy, top or painter)
        if low_middle[2] > 0:
            self.face(middle - Z * sz / 2, -Z, y, sx, sy, painter)

    def pictures(self, wall: int, count: int, low_m: float, high_m: float, margin_m: float = 0.1) -> None:
        """Framed posters of random size, not overlapping, on wall 0..3 (+x, +y, -x, -y)."""
        axis = (X, Y, -X, -Y)[wall]
        along = np.cross(Z, -axis)
        length = self.size[1] if wall % 2 == 0 else self.size[0]
        placed: list[tuple[float, float, float, float]] = []
        for _ in range(200):
            if len(placed) == count:
                return
            w, h = self.rng.uniform(0.2, 0.75), self.rng.uniform(0.2, 0.6)
            a = self.rng.uniform(-length / 2 + w / 2 + margin_m, length / 2 - w / 2 - margin_m)
            z = self.rng.uniform(low_m + h / 2, high_m - h / 2)
            if any(
                abs(a - b) < (w + v) / 2 + 0.05 and abs(z - y) < (h + g) / 2 + 0.05 for b, y, v, g in placed
            ):
                continue
            placed.append((a, z, w, h))
            depth = self.rng.uniform(0.015, 0.05)
            middle = axis * np.abs(axis @ self.size) / 2 + along * a - axis * depth / 2
            yaw = np.degrees(np.arctan2(axis[1], axis[0])) - 90
            low = middle + Z * (z - h / 2)
            frame = paint.paint_of(tuple(self.rng.uniform(0.08, 0.5, 3)))
            self.box((low[0], low[1], low[2]), (w, depth, h), frame, yaw, front=paint.poster())

    def shelf(
        self, wall: int, along_m: float, width_m: float, heights_m: list[float], depth_m: float
    ) -> None:
        """Boards on wall 0..3, loaded with books and boxes."""
        axis = (X, Y, -X, -Y)[wall]
        along = np.cross(Z, -axis)
        yaw = float(np.degrees(np.arctan2(axis[1], axis[0])) - 90)
        flush = axis * (np.abs(axis @ self.size) / 2) + along * along_m
        for z in heights_m:
            x, y, _ = flush - axis * depth_m / 2
            self.box((x, y, z), (width_m, depth_m, 0.025), paint.planks((0.45, 0.3, 0.18)), yaw)
            at = -width_m / 2
            while at < width_m / 2 - 0.08:
                w = min(self.rng.uniform(0.1, 0.4), width_m / 2 - at)
                deep, tall = depth_m * self.rng.uniform(0.5, 0.95), self.rng.uniform(0.14, 0.26)
                x, y, _ = flush - axis * deep / 2 + along * (at + w / 2)
                cover = paint.paint_of(tuple(self.rng.uniform(0.15, 0.6, 3)))
                front = paint.books() if self.rng.uniform() < 0.65 else paint.poster(0.6)
                self.box((x, y, z + 0.025), (w - 0.01, deep, tall), cover, yaw, front=front, top=front)
                at += w + self.rng.uniform(0.0, 0.06)

    def clutter(self, x: tuple[float, float], y: tuple[float, float], z: float, count: int,
                size: tuple[float, float]) -> None:  # fmt: skip
        """Boxes of printed card, turned every way about the vertical."""
        for _ in range(count):
            sx, sy, sz = self.rng.uniform(*size, 3) * [1, 1, 0.7]
            at = (self.rng.uniform(*x), self.rng.uniform(*y), z)
            card = paint.poster(0.7) if self.rng.uniform() < 0.6 else paint.wallpaper((0.5, 0.42, 0.33))
            self.box(at, (sx, sy, sz), card, self.rng.uniform(0, 90), top=paint.poster())

    def table(self, at: tuple[float, float], size: Vector, wood: Painter) -> None:
        """Top and four legs."""
        sx, sy, sz = size
        self.box((*at, sz - 0.04), (sx, sy, 0.04), wood)
        for i, j in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            leg = (at[0] + i * (sx / 2 - 0.04), at[1] + j * (sy / 2 - 0.04), 0.0)
            self.box(leg, (0.06, 0.06, sz - 0.04), wood)

    def standing_lamp(self, at: Vector, radius_m: float, radiance: Vector) -> None:
        """A globe on a pole with a foot."""
        x, y, z = at
        self.box((x, y, 0.0), (0.26, 0.26, 0.03), SOOT, 20.0, top=paint.stones((0.4, 0.35, 0.3), 0.05))
        self.box((x, y, 0.03), (0.014, 0.014, z - radius_m - 0.03 - NECK_M), SOOT)
        self.globes.append(Globe(np.array(at), radius_m, np.array(radiance)))

    def hanging_lamp(self, at: Vector, radius_m: float, radiance: Vector) -> None:
        """A globe on a cord from the ceiling."""
        x, y, z = at
        cord = self.size[2] - z - radius_m - NECK_M
        self.box((x, y, z + radius_m + NECK_M), (0.008, 0.008, cord), SOOT)
        self.globes.append(Globe(np.array(at), radius_m, np.array(radiance)))

    def sheet(self, middle: np.ndarray, normal: np.ndarray, up: np.ndarray, radiance: np.ndarray,
              width: float, height: float) -> None:  # fmt: skip
        """A glowing rectangle around `middle`."""
        right = np.cross(up, normal)
        corner = middle - right * width / 2 + up * height / 2
        self.sheets.append(Sheet(corner, right * width, -up * height, radiance.astype(np.float32)))

    def window(
        self, wall: int, along_m: float, low_m: float, width: float, height: float, sky: float
    ) -> None:
        """Sky over a garden behind a cross of glazing bars, in a frame."""
        axis = (X, Y, -X, -Y)[wall]
        along = np.cross(Z, -axis)
        middle = axis * (np.abs(axis @ self.size) / 2 - 0.01) + along * along_m + Z * (low_m + height / 2)
        h, w = paint.texels(height, width, 0.01)
        down = np.linspace(0, 1, h)[:, None, None]
        view = sky * ((1 - down) * np.array([0.75, 0.95, 1.25]) + down * np.array([1.15, 1.1, 1.0]))
        view = np.broadcast_to(view, (h, w, 3)).copy()
        garden = 0.35 + 0.12 * paint.noise((1, w), 0.01, 0.5, self.rng)[0]
        green = paint.finish(np.full((h, w, 3), 0.25, np.float32) * np.array([0.7, 1.0, 0.45], np.float32))
        hues = paint.palette(self.rng, 8, 0.25, 0.5, 0.4) * np.array([0.8, 1.1, 0.5], np.float32)
        paint.leaves(green, 0.01, self.rng, hues, 0.04, 0.3, 2.0)
        below = (1 - np.linspace(0, 1, h))[:, None] < garden
        view[below] = (sky * green)[below]
        self.sheet(middle, -axis, Z, view, width, height)
        yaw = float(np.degrees(np.arctan2(axis[1], axis[0])) - 90)
        bar = paint.paint_of((0.1, 0.07, 0.05))
        spans = [(0.0, -0.05, width + 0.1, 0.05), (0.0, height, width + 0.1, 0.05), (-width / 2 - 0.025, 0, 0.05, height),
                 (width / 2 + 0.025, 0, 0.05, height), (0.0, 0, 0.035, height), (0.0, height * 0.62, width, 0.035)]  # fmt: skip
        for a, z, w_m, h_m in spans:
            x, y, _ = middle + along * a - axis * 0.015
            self.box((x, y, low_m + z), (w_m, 0.04, h_m), bar, yaw)

    def twig(self, middle: np.ndarray, count: int, spread_m: float) -> None:
        """Thin leaves turned every way about `middle`."""
        for _ in range(count):
            at = middle + self.rng.normal(0, spread_m, 3)
            normal = self.rng.normal(size=3)
            normal /= np.linalg.norm(normal)
            up = np.cross(normal, self.rng.normal(size=3))
            up /= np.linalg.norm(up)
            wide, tall = self.rng.uniform(0.02, 0.045), self.rng.uniform(0.05, 0.1)
            green = paint.paint_of(tuple(self.rng.uniform(0.5, 1.0) * np.array([0.2, 0.42, 0.1])))
            for side in (normal, -normal):
                self.face(at + 0.0005 * side, side, up, wide, tall, green)

    def room(self, name: str, polish: float = 0.0) -> Room:
        centre = np.array([0.0, 0.0, 1.35])
        return Room(name, tuple(self.panels), tuple(self.globes), tuple(self.sheets), centre, polish)


def _ceiling_light(
    build: _Builder, at: tuple[float, float], size: tuple[float, float], radiance: Vector
) -> None:
    """A luminous panel a hand below the ceiling, on a housing."""
    z = build.size[2] - 0.06
    build.box((*at, z), (size[0] + 0.06, size[1] + 0.06, 0.06), paint.paint_of((0.1, 0.1, 0.1)))
    glow = np.broadcast_to(np.array(radiance, np.float32), (4, 4, 3))
    build.sheet(np.array([*at, z - 0.004]), -Z, Y, glow, *size)


def _beams(build: _Builder, count: int, wood: Painter) -> None:
    lx, ly, lz = build.size
    for i, y in enumerate(np.linspace(-ly / 2, ly / 2, count + 2)[1:-1]):
        build.box((0.0, y, lz - 0.1 - 0.03 * (i % 2)), (lx, 0.1, 0.1 + 0.03 * (i % 2)), wood, front=wood)


def study() -> Room:
    """A work room: window, ceiling light, a lamp close by, a screen; everything textured."""
    build = _Builder((4.2, 3.4, 2.7), seed=11)
    walls = [paint.wallpaper((0.62, 0.56, 0.47)), paint.plaster((0.6, 0.58, 0.52)),
             paint.stones((0.5, 0.42, 0.36)), paint.wallpaper((0.5, 0.58, 0.56))]  # fmt: skip
    build.shell(walls, paint.planks((0.42, 0.28, 0.17)), paint.planks((0.72, 0.62, 0.5), 0.2))
    _beams(build, 3, paint.planks((0.4, 0.27, 0.17)))
    _ceiling_light(build, (0.25, 0.42), (1.4, 0.4), (30.0, 28.5, 26.0))
    build.window(2, 0.2, 0.95, 1.3, 1.1, sky=20.0)
    build.pictures(0, 5, 1.0, 2.4)
    build.pictures(1, 4, 1.5, 2.45)
    build.pictures(3, 6, 0.7, 2.4)
    build.shelf(1, 0.6, 1.4, [0.25, 0.65, 1.05], 0.28)
    build.shelf(0, -0.9, 0.9, [0.3, 0.7], 0.3)
    build.table((1.45, 0.55), (0.9, 1.5, 0.74), paint.planks((0.5, 0.33, 0.2)))
    screen = paint.poster(0.9)(0.34, 0.58, 0.005, build.rng) * np.array([3.2, 3.6, 4.2], np.float32)
    build.box((1.62, 0.5, 0.78), (0.04, 0.62, 0.4), paint.paint_of((0.1, 0.1, 0.1)))
    build.sheet(np.array([1.597, 0.5, 0.98]), -X, Z, screen, 0.58, 0.34)
    build.clutter((1.2, 1.6), (1.0, 1.25), 0.74, 4, (0.08, 0.2))
    build.clutter((1.2, 1.4), (-0.1, 0.2), 0.74, 2, (0.08, 0.16))
    build.box((-0.1, -0.2, 0.0), (2.2, 1.6, 0.012), paint.rug(), 8.0, top=paint.rug())
    build.box((-1.55, -1.1, 0.0), (0.7, 0.6, 0.8), paint.planks((0.45, 0.25, 0.2)), 12.0, top=paint.rug())
    build.clutter((-1.75, -1.4), (-1.3, -1.0), 0.8, 4, (0.1, 0.25))
    build.clutter((-1.2, 1.0), (-1.4, 1.1), 0.012, 12, (0.1, 0.32))
    build.standing_lamp((-0.55, -1.05, 1.55), 0.06, (30.0, 23.5, 15.0))
    return build.room("study")


def lamps() -> Room:
    """Night: only globes, several within arm's reach of the object."""
    build = _Builder((4.0, 3.3, 2.7), seed=23)
    walls = [paint.stones((0.58, 0.5, 0.42)), paint.wallpaper((0.62, 0.52, 0.45)),
             paint.plaster((0.64, 0.6, 0.5)), paint.planks((0.6, 0.44, 0.3))]  # fmt: skip
    build.shell(walls, paint.stones((0.5, 0.44, 0.4), 0.22, 1.3), paint.wallpaper((0.7, 0.68, 0.62), 0.8))
    _beams(build, 2, paint.planks((0.5, 0.36, 0.24)))
    for wall, count in ((0, 6), (1, 5), (2, 7), (3, 5)):
        build.pictures(wall, count, 0.5, 2.4)
    build.shelf(1, -0.8, 1.2, [0.3, 0.7, 1.1], 0.26)
    build.table((-1.4, 0.3), (0.8, 1.3, 0.7), paint.planks((0.55, 0.4, 0.25)))
    build.clutter((-1.6, -1.3), (-0.1, 0.8), 0.7, 6, (0.08, 0.24))
    build.box((0.1, 0.1, 0.0), (2.0, 1.7, 0.012), paint.rug(), -12.0, top=paint.rug())
    build.clutter((-1.0, 1.4), (-1.3, 1.2), 0.012, 14, (0.1, 0.34))
    build.standing_lamp((0.82, -0.72, 1.5), 0.072, (52.0, 40.0, 25.0))
    build.standing_lamp((-0.9, -0.75, 1.05), 0.066, (46.0, 38.0, 28.0))
    build.standing_lamp((-0.55, 1.0, 1.75), 0.072, (44.0, 42.0, 40.0))
    build.hanging_lamp((0.85, 0.55, 2.0), 0.072, (54.0, 36.0, 18.0))
    build.hanging_lamp((-0.45, -0.25, 2.32), 0.062, (40.0, 40.0, 44.0))
    build.standing_lamp((0.75, 0.95, 0.62), 0.066, (36.0, 32.0, 26.0))
    build.globes.append(Globe(np.array([-1.5, 0.75, 0.89]), 0.072, np.array([50.0, 36.0, 20.0])))
    return build.room("lamps")


def window() -> Room:
    """A room by day, lit by one window alone."""
    build = _Builder((4.0, 3.4, 2.7), seed=37)
    walls = [paint.wallpaper((0.66, 0.62, 0.55)), paint.stones((0.56, 0.5, 0.45)),
             paint.wallpaper((0.64, 0.6, 0.56)), paint.plaster((0.68, 0.64, 0.58))]  # fmt: skip
    build.shell(walls, paint.planks((0.5, 0.36, 0.24)), paint.stones((0.7, 0.67, 0.62), 0.35))
    _beams(build, 4, paint.planks((0.6, 0.46, 0.32)))
    build.window(1, -0.1, 0.75, 1.7, 1.45, sky=20.0)
    build.pictures(0, 6, 0.6, 2.4)
    build.pictures(2, 6, 0.6, 2.4)
    build.pictures(3, 5, 0.9, 2.4)
    build.shelf(3, -0.5, 1.5, [0.25, 0.6], 0.28)
    build.table((1.5, -0.5), (0.7, 1.4, 0.72), paint.planks((0.56, 0.4, 0.26)))
    build.clutter((1.3, 1.7), (-1.0, 0.0), 0.72, 6, (0.08, 0.26))
    build.box((0.0, -0.1, 0.0), (2.1, 1.7, 0.012), paint.rug(), 5.0, top=paint.rug())
    build.clutter((-1.5, 1.1), (-1.2, 1.3), 0.012, 14, (0.1, 0.34))
    return build.room("window")


def plain() -> Room:
    """Evenly lit from above between bare painted walls: little for feature matching to hold on to."""
    build = _Builder((4.0, 3.2, 2.6), seed=53)
    walls = [paint.paint_of((0.74, 0.73, 0.7), 0.03), paint.paint_of((0.72, 0.73, 0.74), 0.03),
             paint.paint_of((0.75, 0.72, 0.69), 0.03), paint.paint_of((0.73, 0.74, 0.71), 0.03)]  # fmt: skip
    build.shell(walls, paint.paint_of((0.5, 0.48, 0.45), 0.05), paint.paint_of((0.8, 0.8, 0.79), 0.02))
    for x in (-1.0, 1.0):
        for y in (-0.75, 0.75):
            _ceiling_light(build, (x, y), (0.9, 0.6), (4.0, 3.9, 3.75))
    build.box((-1.7, -1.2, 0.0), (0.5, 0.6, 1.8), paint.paint_of((0.6, 0.6, 0.58), 0.04))
    build.table((1.5, 0.6), (0.7, 1.3, 0.72), paint.paint_of((0.55, 0.5, 0.45), 0.06))
    build.pictures(0, 1, 1.0, 2.2)
    build.pictures(3, 1, 1.0, 2.2)
    build.clutter((-1.4, -1.0), (0.9, 1.2), 0.0, 2, (0.2, 0.4))
    return build.room("plain")


def polished() -> Room:
    """A window and lamps over a floor of polished stone, which mirrors the room."""
    build = _Builder((4.0, 3.3, 2.7), seed=67)
    walls = [paint.plaster((0.62, 0.55, 0.47)), paint.wallpaper((0.6, 0.56, 0.5)),
             paint.stones((0.55, 0.48, 0.42)), paint.wallpaper((0.52, 0.56, 0.58))]  # fmt: skip
    build.shell(walls, paint.stones((0.3, 0.28, 0.26), 0.4), paint.planks((0.7, 0.62, 0.5), 0.2))
    for wall, count in ((0, 5), (1, 5), (3, 5)):
        build.pictures(wall, count, 0.5, 2.4)
    build.table((1.45, -0.5), (0.8, 1.3, 0.72), paint.planks((0.5, 0.36, 0.24)))
    build.clutter((1.3, 1.6), (-0.9, -0.1), 0.72, 5, (0.08, 0.24))
    build.clutter((-1.5, 1.0), (-1.3, 1.3), 0.0, 10, (0.1, 0.32))
    _ceiling_light(build, (0.2, -0.3), (1.4, 0.4), (26.0, 25.0, 23.0))
    build.window(2, 0.2, 0.95, 1.3, 1.1, sky=20.0)
    build.standing_lamp((-0.9, 0.95, 1.5), 0.066, (30.0, 25.0, 18.0))
    return build.room("polished", polish=0.4)


def leafy() -> Room:
    """One lamp close by, behind a plant with thin leaves, and a window."""
    build = _Builder((4.0, 3.4, 2.7), seed=71)
    walls = [paint.wallpaper((0.6, 0.57, 0.5)), paint.plaster((0.62, 0.58, 0.52)),
             paint.planks((0.56, 0.42, 0.3)), paint.stones((0.55, 0.5, 0.45))]  # fmt: skip
    build.shell(walls, paint.planks((0.45, 0.32, 0.2)), paint.stones((0.68, 0.65, 0.6), 0.35))
    _beams(build, 3, paint.planks((0.5, 0.38, 0.26)))
    build.window(2, 0.3, 0.95, 1.3, 1.1, sky=20.0)
    for wall, count in ((0, 6), (1, 5), (3, 5)):
        build.pictures(wall, count, 0.5, 2.4)
    build.box((0.0, 0.1, 0.0), (2.0, 1.6, 0.012), paint.rug(), 10.0, top=paint.rug())
    build.clutter((-1.4, 1.2), (-1.3, 1.3), 0.012, 12, (0.1, 0.32))
    lamp = np.array([1.25, -0.8, 1.75])
    build.standing_lamp((lamp[0], lamp[1], lamp[2]), 0.07, (36.0, 31.0, 24.0))
    to_centre = np.array([0.0, 0.0, 1.35]) - lamp
    build.twig(lamp + 0.27 * to_centre / np.linalg.norm(to_centre), 40, 0.07)
    return build.room("leafy")


def chink() -> Room:
    """Shutters closed on a sunny day: all light comes through a chink ten thousand times brighter than the walls."""
    build = _Builder((4.0, 3.4, 2.7), seed=73)
    walls = [paint.wallpaper((0.66, 0.62, 0.55)), paint.planks((0.5, 0.38, 0.26)),
             paint.stones((0.62, 0.57, 0.52)), paint.plaster((0.68, 0.64, 0.58))]  # fmt: skip
    build.shell(walls, paint.planks((0.5, 0.36, 0.24)), paint.plaster((0.7, 0.67, 0.62)))
    _beams(build, 3, paint.planks((0.6, 0.46, 0.32)))
    glow = np.broadcast_to(np.array([2900.0, 3000.0, 3200.0], np.float32), (4, 4, 3))
    build.sheet(np.array([-0.3, 1.69, 1.7]), -Y, Z, glow, 0.05, 0.07)
    for wall, count in ((0, 6), (2, 6), (3, 6)):
        build.pictures(wall, count, 0.5, 2.4)
    build.shelf(3, 0.4, 1.4, [0.25, 0.6], 0.28)
    build.box((0.0, -0.1, 0.0), (2.0, 1.7, 0.012), paint.rug(), -7.0, top=paint.rug())
    build.clutter((-1.5, 1.3), (-1.2, 1.3), 0.012, 14, (0.1, 0.34))
    return build.room("chink")


def parlour() -> Room:
    """A living room by day: a window, a lamp and pictures, of coarse texels, so that it stands there in seconds.

    Its light comes baked with the program (`bake.SHIPPED`).
    """
    build = _Builder((3.8, 3.2, 2.6), seed=83, texel_m=0.008)
    walls = [paint.stones((0.55, 0.47, 0.4)), paint.planks((0.6, 0.58, 0.52), 0.18),
             paint.stones((0.58, 0.52, 0.46), 0.24, 1.4), paint.stones((0.5, 0.56, 0.57), 0.1)]  # fmt: skip
    build.shell(walls, paint.planks((0.42, 0.29, 0.18)), paint.planks((0.72, 0.64, 0.52), 0.2))
    _beams(build, 2, paint.planks((0.45, 0.3, 0.2)))
    build.window(2, 0.2, 0.9, 1.3, 1.2, sky=20.0)
    for wall, count in ((0, 3), (1, 4), (3, 4)):
        build.pictures(wall, count, 0.6, 2.3)
    build.table((1.4, -0.6), (0.7, 1.0, 0.7), paint.planks((0.5, 0.34, 0.22)))
    build.clutter((1.25, 1.6), (-0.95, -0.25), 0.7, 2, (0.1, 0.2))
    build.box((0.0, -0.1, 0.0), (2.0, 1.6, 0.012), paint.rug(), 8.0, top=paint.rug())
    build.clutter((-1.4, 1.1), (-1.2, 1.2), 0.012, 4, (0.12, 0.26))
    build.standing_lamp((-0.7, -1.05, 1.6), 0.065, (30.0, 24.0, 16.0))
    return build.room("parlour")


def booth(
    side: float = 2.8,
    lamp: float | None = None,
    texture: float = 1.0,
    glow: float | None = None,
    globe: float = 1.0,
) -> Room:
    """Six mottled walls of few texels, a glowing sheet and a globe: built in seconds, for trials of the machinery.

    Args:
        side: metres; lamps, walls and all grow with it.
        lamp: the globe is so many metres from the centre, and as large as it seems from there otherwise.
        texture: contrast of the walls' tiles.
        globe: the globe has this share of its light.
        glow: the walls glow themselves, and there are no lamps; the contrast of their tiles, which is all that light differs by.
    """
    rng, times = np.random.default_rng(61), side / 2.8
    centre = np.array([0.0, 0.0, side / 2])
    walls, shining = [], []
    for inwards in (X, Y, Z, -X, -Y, -Z):
        right, down = np.roll(inwards, 1), np.cross(np.roll(inwards, 1), inwards)
        corner = centre - side / 2 * (inwards + right + down)
        tiles = rng.uniform(0.15, 0.8, (16, 16, 3)).astype(np.float32)
        albedo = tiles if texture == 1 else 0.475 + texture * (tiles - 0.475)
        walls.append(Panel(corner, side * right, side * down, albedo))
        if glow is not None:
            radiance = 1 + glow * (tiles / 0.475 - 1)
            shining.append(Sheet(corner + 0.01 * times * inwards, side * right, side * down, radiance))
    if glow is not None:
        return Room("booth", tuple(walls), (), tuple(shining), centre)
    light = np.full((4, 4, 3), (7.0, 6.6, 6.0), np.float32)
    sheet = Sheet(times * np.array([-0.2, -0.5, 2.75]), times * X, times * Y, light)
    towards = np.array([-1.1, 0.7, 0.3])
    near = times if lamp is None else lamp / float(np.linalg.norm(towards))
    shining_globe = Globe(centre + near * towards, 0.09 * near, globe * np.array([38.0, 34.0, 30.0]))
    return Room("booth", tuple(walls), (shining_globe,), (sheet,), centre)


BOOTH = ("side", "lamp", "texture", "glow", "globe")
NEAREST_LAMP_M = 0.45  # the rig's object sweeps .35 m about the room's centre

ROOMS: dict[str, Callable[..., Room]] = {
    "study": study, "lamps": lamps, "window": window, "plain": plain, "polished": polished, "leafy": leafy,
    "chink": chink, "booth": booth, "parlour": parlour,
}  # fmt: skip


def furnish(asked: str) -> Room:
    """The room of that name; of the booth also "booth:lamp=0.5", with what `booth` takes.

    Raises:
        StudioError: no such room, or a number that it does not take.
    """
    if not is_built_in(asked):
        raise StudioError(f"there is no room called {asked!r}; choose one of {', '.join(ROOMS)}")
    name, changes = order.changed(asked, *(BOOTH if asked.startswith("booth:") else ()))
    if changes.get("side", 2.8) < 2.8 or changes.get("lamp", 1) < NEAREST_LAMP_M:
        raise StudioError(
            f"{asked}: side from 2.8 m on and lamp from {NEAREST_LAMP_M} m on leave the rig its place"
        )
    return ROOMS[name](**changes)


def is_built_in(asked: str) -> bool:
    """Whether a room is one of these rather than a scene file."""
    return asked.partition(":")[0] in ROOMS
