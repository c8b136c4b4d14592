"""Aim from an object at what a baked interior sends it: directions by the light that comes from them and by the surface's normal.

Around `PLACES` places on the object the room's radiance is looked up once per view, in `FINE` texels of the sphere; `COARSE`
blocks of them, weighed by the cosine to each of `NORMALS` normals, are chosen first, then a texel in the block. A share of the
tries goes to lamps and to the outside instead (`Room.aim`), which texels are too coarse for. All of it is one density, so
that the whole room is one lamp to `relight`. What is looked up only aims: what counts is what a ray meets.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.cluster.vq import kmeans2
from scipy.ndimage import uniform_filter

from hardware.virtual.studio.glow import Seen
from hardware.virtual.studio.interior import glow
from hardware.virtual.studio.interior.table import Table
from hardware.virtual.studio.samples import Effort

PLACES = 6
FINE, BLOCK = (128, 256), 8
NORMALS = 12  # a side of the octahedral map of normals
ACROSS = 0.1  # added to cosines: normals lie about their cell's middle
BEYOND = -0.35  # cosine to a cell's normal below which none of its normals faces a direction
FAINT = 0.03  # of the mean: what texels that looked dark are taken for
LOOKS = 4  # rays a texel
LAMPS_SHARE = 0.06  # of the tries


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Directions, and how far off the lamp is that was aimed at (0: whatever is met counts)."""

    direction: Any
    distance: Any


class Proposal:
    """What `relight` asks of a room, for the views of one object; `view` is to be called before each."""

    only_lamps = True
    lamps = 1

    def __init__(self, room: glow.Room, points: Float[np.ndarray, "n 3"], seed: int = 0):
        """`points` lie on the object, in the camera's frame."""
        self.room, self.mi = room, room.mi
        places, _ = kmeans2(points, min(PLACES, len(points)), rng=np.random.default_rng(seed), minit="++")
        self.places = places[np.isfinite(places).all(1)]
        self.normals = _octahedral_middles()
        self.lamps_share = LAMPS_SHARE if room.lamps else 0.0
        self.made: dict[bytes, tuple[Any, Table, Table]] = {}

    def effort(self, count: int) -> Effort:
        """How `count` samples a pixel are shared."""
        return Effort(max(4, count // 4), max(4, count // 4), (count,))

    def view(self, world_from_cam: Float[np.ndarray, "4 4"]) -> None:
        """Look around from the object where it stands in this view."""
        mi = self.mi
        key = world_from_cam.tobytes()
        if key not in self.made:
            places = self.places @ world_from_cam[:3, :3].T + world_from_cam[:3, 3]
            level = np.stack([self._looked(place) for place in places])
            solid = -np.diff(np.cos(np.pi * np.arange(FINE[0] + 1) / FINE[0]))[:, None] * 2 * np.pi / FINE[1]
            power = level * solid
            rows, columns = FINE[0] // BLOCK, FINE[1] // BLOCK
            blocks = power.reshape(len(places), rows, BLOCK, columns, BLOCK)
            coarse = blocks.sum((2, 4))
            cosine = np.einsum("nc,hwc->nhw", self.normals, _middles(rows, columns))
            facing = np.where(cosine > BEYOND, np.maximum(cosine, 0) + ACROSS, 0.0)
            table = Table(mi, (coarse[:, None] * facing[None]).reshape(-1, rows, columns))
            fine = Table(mi, blocks.transpose(0, 1, 3, 2, 4).reshape(-1, BLOCK, BLOCK))
            self.made[key] = (mi.Float(np.ravel(places).astype(np.float32)), table, fine)
        self.now, self.coarse, self.fine = self.made[key]

    def choice(self, point: Any) -> list[Any]:
        """There is one lamp: the room."""
        return [self.mi.Float(1.0)]

    def look(self, ray: Any, normal: Any) -> Seen:
        """What `ray` meets, and how likely `aim` is to find it from a surface of this normal."""
        met = self.room.meet(ray)
        density = self._density(ray.o, normal, ray.d) + self.lamps_share * met.density
        mi = self.mi
        return Seen(met.radiance, mi.Bool(True), mi.UInt32(0), density)

    def aim(self, lamp: Any, point: Any, u: Any, normal: Any) -> Aim:
        """Directions for numbers `u`."""
        mi = self.mi
        import drjit as dr

        q = self.lamps_share
        to_lamp = u.x < q
        x = dr.select(to_lamp, u.x / max(q, 1e-6), (u.x - q) / (1 - q))
        table, place = self._table(point, normal)
        row, column, inner, _ = self.coarse.sample(table, x, u.y, ~to_lamp)
        block = (place * self.coarse.rows + row) * self.coarse.columns + column
        down, along, inner, _ = self.fine.sample(block, inner.x, inner.y, ~to_lamp)
        direction = glow.from_texel(mi, row * BLOCK + down, column * BLOCK + along, inner, *FINE)
        if q == 0:
            return Aim(direction, mi.Float(0.0))
        lit, distance = self.room.aim(point, mi.Point2f(x, u.y))
        return Aim(dr.select(to_lamp, lit, direction), dr.select(to_lamp, distance, 0.0))

    def arriving(self, point: Any, normal: Any, aim: Aim, active: Any) -> tuple[Any, Any, Any]:
        """Whether what was aimed at is met, the radiance that is, and the density of aiming there."""
        mi = self.mi

        met = self.room.meet(mi.Ray3f(mi.Point3f(point), aim.direction), active)
        density = self._density(point, normal, aim.direction) + self.lamps_share * met.density
        # A lamp behind something: this direction counts for those who look, not for those who aim.
        good = (aim.distance <= 0) | ((met.density > 0) & (met.distance >= aim.distance * glow.REACH))
        return good, met.radiance, density

    def _density(self, point: Any, normal: Any, direction: Any) -> Any:
        mi = self.mi
        table, place = self._table(point, normal)
        row, column = glow.to_texel(mi, direction, *FINE)
        high, left = row // BLOCK, column // BLOCK
        block = (place * self.coarse.rows + high) * self.coarse.columns + left
        chance = self.coarse.chance(table, high, left) * self.fine.chance(block, row % BLOCK, column % BLOCK)
        return (1 - self.lamps_share) * chance / glow.solid_angle(mi, row, *FINE)

    def _table(self, point: Any, normal: Any) -> tuple[Any, Any]:
        """Which table holds here, and which of the places is nearest."""
        mi = self.mi
        import drjit as dr

        place, least = mi.UInt32(0), mi.Float(dr.inf)
        for k in range(len(self.places)):
            away = dr.squared_norm(dr.gather(mi.Point3f, self.now, mi.UInt32(k)) - mi.Point3f(point))
            place, least = dr.select(away < least, k, place), dr.minimum(away, least)
        size = dr.maximum(dr.abs(normal.x) + dr.abs(normal.y) + dr.abs(normal.z), 1e-9)
        x, y = normal.x / size, normal.y / size
        folded_x = (1 - dr.abs(y)) * dr.select(x >= 0, 1.0, -1.0)
        folded_y = (1 - dr.abs(x)) * dr.select(y >= 0, 1.0, -1.0)
        below = normal.z < 0
        x, y = dr.select(below, folded_x, x), dr.select(below, folded_y, y)
        column = dr.minimum(mi.UInt32(dr.clip(x * 0.5 + 0.5, 0, 1) * NORMALS), NORMALS - 1)
        row = dr.minimum(mi.UInt32(dr.clip(y * 0.5 + 0.5, 0, 1) * NORMALS), NORMALS - 1)
        return (place * NORMALS + row) * NORMALS + column, place

    def _looked(self, place: np.ndarray) -> Float[np.ndarray, "h w"]:
        """Root mean square of the radiance in and around every texel, never quite dark: a few centimetres beside the place,
        edges lie elsewhere, and what is bright there must not be thought dark.
        """
        mi = self.mi
        import drjit as dr

        lane = dr.arange(mi.UInt32, FINE[0] * FINE[1] * LOOKS)
        texel, part = lane // LOOKS, lane % LOOKS
        within = mi.Point2f((mi.Float(part // 2) + 0.5) / 2, (mi.Float(part % 2) + 0.5) / 2)
        direction = glow.from_texel(mi, texel // FINE[1], texel % FINE[1], within, *FINE)
        at = mi.Point3f(*(float(c) for c in place))
        dr.make_opaque(at)
        value = dr.mean(self.room.meet(mi.Ray3f(at, direction)).radiance)
        dr.eval(value)
        power = np.square(np.array(value, float)).reshape(*FINE, LOOKS).mean(-1)
        around = uniform_filter(power, 3, mode=("nearest", "wrap"))  # type: ignore[arg-type]
        # A running sum may come out a hair below zero where nothing is bright.
        level = np.sqrt(np.maximum(around, 0))
        return level + FAINT * level.mean()


def _middles(rows: int, columns: int) -> Float[np.ndarray, "h w 3"]:
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    azimuth = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    across = np.sin(polar)[:, None]
    height = np.broadcast_to(np.cos(polar)[:, None], (rows, columns))
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], -1)


def _octahedral_middles() -> Float[np.ndarray, "n 3"]:
    """Normals in the middle of the cells that `Proposal._table` numbers."""
    middle = (np.arange(NORMALS) + 0.5) / NORMALS * 2 - 1
    y, x = np.meshgrid(middle, middle, indexing="ij")
    z = 1 - np.abs(x) - np.abs(y)
    folded = (
        np.where(z < 0, (1 - np.abs(y)) * np.sign(x), x),
        np.where(z < 0, (1 - np.abs(x)) * np.sign(y), y),
    )
    normals = np.stack([folded[0].ravel(), folded[1].ravel(), z.ravel()], 1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
