"""What a ray meets in a baked interior, and how to aim at what glows of itself: many rays at once.

A hit sends its look's emission plus albedo times the irradiance / pi that was baked for its side; a miss sees what lies
outside. That is one function of where a ray goes, for the background of photographs and for what lights the object. Aiming
finds lamps and the outside by their strength; densities are per steradian. World frame. Needs a vectorised variant.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from hardware.virtual.studio.interior import outside
from hardware.virtual.studio.interior.lightmap import Layout
from hardware.virtual.studio.interior.read import Interior
from hardware.virtual.studio.interior.table import Table

REACH = 1 - 1e-3  # what was aimed at is met no nearer than this share of the way


@dataclass(frozen=True, slots=True, eq=False)
class Met:
    """What rays met."""

    radiance: Any
    distance: Any  # inf: nothing
    density: Any  # with which `Glow.aim` finds this very point
    face: Any
    facing: Any  # cosine between the ray and the normal of the side that it met
    point: Any  # number of the nearest point of the lightmap, both sides counted


class Room:
    """An interior and its light, ready to be looked at along rays in world space."""

    def __init__(self, mi: Any, room: Interior, grid: Layout, light: Float[np.ndarray, "2 n 3"]):
        self.mi, self.grid = mi, grid
        self.scene = mi.load_dict({"type": "scene", "room": _mesh(mi, room)})
        corners = room.vertices[room.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        twice = np.linalg.norm(across, axis=1)
        self.faces = _floats(
            mi, np.concatenate([across / np.maximum(twice, 1e-20)[:, None], twice[:, None] / 2], 1)
        )
        self.uv = _floats(mi, room.uv[room.faces].reshape(-1, 6))
        self.numbers = mi.UInt32(np.ravel(np.stack([room.look, grid.first, grid.cells], 1)).astype(np.uint32))
        self.looks = _Pictures(mi, room)
        self.light = _four(mi, light.reshape(-1, 3))
        size = float(np.linalg.norm(np.ptp(room.vertices[room.faces], axis=(0, 1))))
        self.nudge = 2e-6 * size
        self._lamps(room, corners, twice / 2)

    def _lamps(self, room: Interior, corners: np.ndarray, areas: np.ndarray) -> None:
        """Tables of what glows: faces by what they send, the outside by what comes from there."""
        mi = self.mi
        level = np.array([look.emission.mean() for look in room.looks])[room.look]
        power = areas * level
        glowing = np.flatnonzero(power > 0)
        self.any_faces = len(glowing) > 0
        share = power[glowing] / max(power.sum(), 1e-20)
        self.face_table = Table(mi, share[None] if self.any_faces else np.ones((1, 1)))
        self.face_number = mi.UInt32((glowing if self.any_faces else np.zeros(1)).astype(np.uint32))
        chance = np.zeros(len(room.faces))
        chance[glowing] = share
        self.face_chance = mi.Float(chance.astype(np.float32))
        self.corners = _floats(mi, corners.reshape(-1, 9))
        self.sky = _four(mi, room.outside.reshape(-1, 3))
        self.any_sky = bool(room.outside.max() > 0)
        weight = room.outside.mean(-1) * outside.areas()[:, None]
        self.sky_table = Table(mi, weight if self.any_sky else np.ones((1, 1)))
        # Half of the tries each where there are both.
        self.sky_share = 0.0 if not self.any_sky else 0.5 if self.any_faces else 1.0
        self.lamps = self.any_sky or self.any_faces

    def meet(self, ray: Any, active: Any = True) -> Met:
        """What `ray`, with a unit direction, meets first."""
        mi = self.mi
        import drjit as dr

        hit = self.scene.ray_intersect_preliminary(ray, active=active)
        met = hit.is_valid() & active
        face = dr.select(met, hit.prim_index, 0)
        facts = dr.gather(mi.Vector4f, self.faces, face, met)
        along = -(facts.x * ray.d.x + facts.y * ray.d.y + facts.z * ray.d.z)
        behind = along < 0
        look, first, cells = (dr.gather(mi.UInt32, self.numbers, face * 3 + k, met) for k in range(3))
        b, c = hit.prim_uv.x, hit.prim_uv.y
        a = 1 - b - c
        p, q, r = (dr.gather(mi.Point2f, self.uv, face * 3 + k, met) for k in range(3))
        albedo, glow = self.looks.at(look, p * a + q * b + r * c, behind, met)
        light, point = self._irradiance(first, cells, b, c, behind, met)
        sky, sky_density = self._outside(ray.d, ~met & active)
        lamp = dr.gather(mi.Float, self.face_chance, face, met & ~behind) if self.any_faces else mi.Float(0.0)
        lamp *= dr.square(hit.t) / dr.maximum(facts.w * dr.abs(along), 1e-20) * (1 - self.sky_share)
        return Met(
            dr.select(met, glow + albedo * light, sky), dr.select(met, hit.t, dr.inf),
            dr.select(met, dr.select(behind, 0.0, lamp), sky_density * self.sky_share), face, dr.abs(along), point,
        )  # fmt: skip

    def aim(self, point: Any, u: Any) -> tuple[Any, Any]:
        """Directions towards what glows, and how far it is."""
        mi = self.mi
        import drjit as dr

        to_sky = u.x < self.sky_share
        within = dr.select(
            to_sky, u.x / max(self.sky_share, 1e-6), (u.x - self.sky_share) / max(1 - self.sky_share, 1e-6)
        )
        zero = mi.UInt32(0) + dr.zeros(mi.UInt32, dr.width(within))
        row, column, inner, _ = self.sky_table.sample(zero, within, u.y, to_sky)
        away = from_texel(mi, row, column, inner, outside.ROWS, outside.COLUMNS)
        _, entry, inner, _ = self.face_table.sample(zero, u.y, within, ~to_sky)
        face = dr.gather(mi.UInt32, self.face_number, entry, ~to_sky)
        corners = [dr.gather(mi.Point3f, self.corners, face * 3 + k, ~to_sky) for k in range(3)]
        weights = mi.warp.square_to_uniform_triangle(inner)
        at = corners[0] * (1 - weights.x - weights.y) + corners[1] * weights.x + corners[2] * weights.y
        to = mi.Vector3f(at - point)
        distance = dr.norm(to)
        direction = dr.select(to_sky, away, to / dr.maximum(distance, 1e-12))
        return direction, dr.select(to_sky, dr.inf, distance)

    def _irradiance(
        self, first: Any, cells: Any, b: Any, c: Any, behind: Any, active: Any
    ) -> tuple[Any, Any]:
        """Linear between the three points around; the number of the nearest."""
        mi = self.mi
        import drjit as dr

        size = mi.Float(cells)
        x, y = dr.clip(b, 0, 1) * size, dr.clip(c, 0, 1) * size
        i = dr.minimum(mi.UInt32(x), dr.maximum(cells, 1) - 1)
        j = dr.minimum(mi.UInt32(y), dr.maximum(cells, 1) - 1 - i)
        x, y = x - mi.Float(i), y - mi.Float(j)
        upper = (x + y > 1) & (i + j + 1 < cells)
        base = first + dr.select(behind, self.grid.count, 0)

        def number(i: Any, j: Any) -> Any:
            return base + dr.select(cells > 0, j * (2 * cells + 3 - j) // 2 + i, 0)

        at = [dr.select(upper, number(i + 1, j + 1), number(i, j)), number(i + 1, j), number(i, j + 1)]
        weight = [
            dr.select(upper, x + y - 1, 1 - x - y), dr.select(upper, 1 - y, x), dr.select(upper, 1 - x, y)
        ]  # fmt: skip
        weight[0] = dr.select(cells > 0, weight[0], 1.0)
        total, nearest, most = mi.Color3f(0.0), at[0], weight[0]
        for number_, share in zip(at, weight, strict=True):
            inside = active & ((cells > 0) | (number_ == at[0]))
            share = dr.select(inside, share, 0.0)
            value = dr.gather(mi.Vector4f, self.light, number_, inside)
            total += mi.Color3f(value.x, value.y, value.z) * share
            nearest, most = dr.select(share > most, number_, nearest), dr.maximum(share, most)
        return dr.maximum(total, 0), nearest

    def _outside(self, direction: Any, active: Any) -> tuple[Any, Any]:
        mi = self.mi
        import drjit as dr

        row, column = to_texel(mi, direction, outside.ROWS, outside.COLUMNS)
        texel = row * outside.COLUMNS + column
        value = dr.gather(mi.Vector4f, self.sky, texel, active)
        if not self.any_sky:
            return mi.Color3f(value.x, value.y, value.z), mi.Float(0.0)
        chance = self.sky_table.chance(mi.UInt32(0), row, column, active)
        density = chance / solid_angle(mi, row, outside.ROWS, outside.COLUMNS)
        return mi.Color3f(value.x, value.y, value.z), density


class _Pictures:
    """All looks' pictures in one row."""

    def __init__(self, mi: Any, room: Interior):
        self.mi = mi
        facts, albedo, glow, begin, glowing = [], [], [], 0, False
        for look in room.looks:
            rows, columns = (
                max(a, b) for a, b in zip(look.albedo.shape[:2], look.emission.shape[:2], strict=True)
            )
            facts.append([begin, rows, columns, look.repeats, look.two_sided, *look.low, *look.size])
            albedo.append(np.broadcast_to(look.albedo, (rows, columns, 3)).reshape(-1, 3))
            glow.append(np.broadcast_to(look.emission, (rows, columns, 3)).reshape(-1, 3))
            begin, glowing = begin + rows * columns, glowing or bool(look.emission.max() > 0)
        table = np.array(facts, float)
        self.places = mi.UInt32(np.ravel(table[:, :5]).astype(np.uint32))
        self.spans = _floats(mi, table[:, 5:])
        self.albedo = _four(mi, np.concatenate(albedo))
        self.glow = _four(mi, np.concatenate(glow)) if glowing else None

    def at(self, look: Any, uv: Any, behind: Any, active: Any) -> tuple[Any, Any]:
        """Albedo of the side that is seen, and what it glows."""
        mi = self.mi
        import drjit as dr

        begin, rows, columns, repeats, two_sided = (
            dr.gather(mi.UInt32, self.places, look * 5 + k, active) for k in range(5)
        )
        span = dr.gather(mi.Vector4f, self.spans, look, active)
        u, v = (uv.x - span.x) / span.z, (uv.y - span.y) / span.w
        again = repeats > 0
        u = dr.select(again, u - dr.floor(u), dr.clip(u, 0, 1))
        v = dr.select(again, v - dr.floor(v), dr.clip(v, 0, 1))
        x, y = u * mi.Float(columns) - 0.5, v * mi.Float(rows) - 0.5
        left, top = dr.floor(x), dr.floor(y)
        x, y = x - left, y - top

        def wrapped(k: Any, count: Any) -> Any:
            n = mi.Int32(count)
            return mi.UInt32(
                dr.select(again, (mi.Int32(k) + n) % dr.maximum(n, 1), dr.clip(mi.Int32(k), 0, n - 1))
            )

        xs, ys = (
            [wrapped(left, columns), wrapped(left + 1, columns)],
            [wrapped(top, rows), wrapped(top + 1, rows)],
        )
        reflecting = active & (~behind | (two_sided > 0))

        def fetched(table: Any, where: Any) -> Any:
            total = mi.Color3f(0.0)
            for row, across in zip(ys, (1 - y, y), strict=True):
                for column, along in zip(xs, (1 - x, x), strict=True):
                    value = dr.gather(mi.Vector4f, table, begin + row * columns + column, where)
                    total += mi.Color3f(value.x, value.y, value.z) * (across * along)
            return total

        glow = mi.Color3f(0.0) if self.glow is None else fetched(self.glow, active & ~behind)
        return fetched(self.albedo, reflecting), glow


def from_texel(mi: Any, row: Any, column: Any, within: Any, rows: int, columns: int) -> Any:
    """A direction inside a texel as `outside` numbers them, even over its area."""
    import drjit as dr

    low, high = dr.cos(dr.pi * mi.Float(row) / rows), dr.cos(dr.pi * (mi.Float(row) + 1) / rows)
    z = dr.fma(high - low, within.x, low)
    s, c = dr.sincos(dr.two_pi * (mi.Float(column) + within.y) / columns)
    across = dr.safe_sqrt(1 - z * z)
    return mi.Vector3f(across * c, across * s, z)


def to_texel(mi: Any, direction: Any, rows: int, columns: int) -> tuple[Any, Any]:
    import drjit as dr

    polar = dr.safe_acos(direction.z) * (rows / dr.pi)
    azimuth = dr.atan2(direction.y, direction.x) * (columns / dr.two_pi)
    azimuth = dr.select(azimuth < 0, azimuth + columns, azimuth)
    return (
        dr.minimum(mi.UInt32(dr.maximum(polar, 0)), rows - 1), dr.minimum(mi.UInt32(azimuth), columns - 1)
    )  # fmt: skip


def solid_angle(mi: Any, row: Any, rows: int, columns: int) -> Any:
    import drjit as dr

    # Product form of a difference of cosines: float32 would lose the poles' texels.
    return 2 * dr.sin(dr.pi * (mi.Float(row) + 0.5) / rows) * np.sin(np.pi / 2 / rows) * (2 * np.pi / columns)


def _floats(mi: Any, rows: np.ndarray) -> Any:
    return mi.Float(np.ravel(rows).astype(np.float32))


def _four(mi: Any, rows: Float[np.ndarray, "n 3"]) -> Any:
    """Three channels and a blank, so that each row is fetched in one piece."""
    return _floats(mi, np.concatenate([rows, np.zeros((len(rows), 1))], 1))


def _mesh(mi: Any, room: Interior) -> Any:
    mesh = mi.Mesh("room", len(room.vertices), len(room.faces))
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.ravel(room.vertices).astype(np.float32)
    params["faces"] = np.ravel(room.faces).astype(np.uint32)
    params.update()
    return mesh
