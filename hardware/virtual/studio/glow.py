"""What a ray meets in a baked room, and how to aim at its lamps: many rays at once, nothing but radiance.

All panels and sheets are one mesh of rectangles, globes are met by formula, and all radiance lies in one picture, so
that a ray costs one intersection and one bilinear fetch. World frame, metres; lamps are numbered globes first, then
sheets. Needs one of Mitsuba's vectorised variants; `tracer` builds the same room out of Mitsuba's own parts.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from hardware.virtual.studio import samples, tracer
from hardware.virtual.studio.bake import Atlas
from hardware.virtual.studio.rooms import Room

STOP = 1 - 1e-4  # shadow rays end this share of the way to the lamp


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What each ray met; black where it met nothing or the back of something."""

    radiance: Any
    is_lamp: Any
    lamp: Any  # its number; 0 where it is none
    density: Any  # with which `Glow.aim` finds this direction once it has chosen this lamp, per steradian


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Directions towards lamps; a density of zero marks those that find nothing."""

    direction: Any
    distance: Any
    radiance: Any
    density: Any


class Glow:
    """The baked room, ready to be looked at along rays in world space."""

    only_lamps = False

    def __init__(self, mi: Any, room: Room, atlas: Atlas):
        self.mi, self.room = mi, room
        quads = (*room.panels, *room.sheets)
        self.panels, self.globes, self.lamps = (
            len(room.panels),
            room.globes,
            len(room.globes) + len(room.sheets),
        )
        self.scene = mi.load_dict({"type": "scene", "room": _mesh(mi, tracer.quad_corners(quads))})
        glows = [globe.radiance.reshape(1, 1, 3) for globe in room.globes] + [s.radiance for s in room.sheets]
        picture, low, size = _picture(atlas, glows)
        self.pitch = picture.shape[1]
        self.picture = mi.Float(np.ravel(picture))
        order = [*range(self.panels), *range(self.panels + len(room.globes), len(low))]
        front = np.stack([np.cross(q.down, q.right) for q in quads])
        front /= np.linalg.norm(front, axis=1, keepdims=True)
        self.quad_front = _table(mi, front)
        self.quad_texels = mi.Float(np.ravel(np.hstack([low[order], size[order]])).astype(np.float32))
        # Lamps as tables: where a table does not apply to a lamp its row is never looked at.
        blank = np.zeros((len(room.globes), 3))
        self.lamp_texels = mi.Float(np.ravel(np.hstack([low, size])[self.panels :]).astype(np.float32))
        self.corner = _table(mi, np.vstack([blank, *(s.corner for s in room.sheets)]))
        self.right = _table(mi, np.vstack([blank, *(s.right for s in room.sheets)]))
        self.down = _table(mi, np.vstack([blank, *(s.down for s in room.sheets)]))
        areas = [float(np.linalg.norm(np.cross(s.right, s.down))) for s in room.sheets]
        self.area = mi.Float([0.0] * len(room.globes) + areas)
        middles = [g.centre for g in room.globes] + [s.corner + (s.right + s.down) / 2 for s in room.sheets]
        self.middle = _table(mi, np.reshape(middles, (-1, 3)))
        self.radius = mi.Float([g.radius_m for g in room.globes] + [0.0] * len(room.sheets))
        strengths = [np.pi * g.radius_m**2 * g.radiance.mean() for g in room.globes]
        strengths += [a * s.radiance.mean() for a, s in zip(areas, room.sheets, strict=True)]
        self.strengths = [float(s) for s in strengths]

    def view(self, world_from_cam: Float[np.ndarray, "4 4"]) -> None:
        """Nothing here depends on where the body stands."""

    def effort(self, count: int) -> samples.Effort:
        """How `count` samples a pixel are shared."""
        return samples.plan(self.room, count)

    def look(self, ray: Any, normal: Any = None) -> Seen:
        """What `ray`, with a unit direction, meets first."""
        mi = self.mi
        import drjit as dr

        hit = self.scene.ray_intersect_preliminary(ray)
        met = hit.is_valid()
        quad, odd = hit.prim_index >> 1, (hit.prim_index & 1) == 1
        one, both = hit.prim_uv.x, hit.prim_uv.x + hit.prim_uv.y
        across, down = dr.select(odd, both, hit.prim_uv.y), dr.select(odd, one, both)
        facing = -dr.dot(ray.d, dr.gather(mi.Vector3f, self.quad_front, quad, met))
        texels = dr.gather(mi.Vector4f, self.quad_texels, quad, met)
        is_lamp = met & (quad >= self.panels)
        lamp = dr.select(is_lamp, quad - self.panels + len(self.globes), 0)
        nearest = dr.select(met, hit.t, dr.inf)
        density = dr.square(nearest) / (
            dr.gather(mi.Float, self.area, lamp, is_lamp) * dr.maximum(facing, 1e-9)
        )
        visible = met & (facing > 0)
        for k, _ in enumerate(self.globes):
            away, cone = self._globe(mi.UInt32(k), ray.o)
            t = self._reach(k, ray, away)
            closer = t < nearest
            nearest = dr.select(closer, t, nearest)
            is_lamp, visible, lamp = is_lamp | closer, visible | closer, dr.select(closer, k, lamp)
            density = dr.select(closer, 1 / (dr.two_pi * cone), density)
        texels = dr.select(
            is_lamp, dr.gather(mi.Vector4f, self.lamp_texels, lamp, is_lamp) if self.lamps else 0.0, texels
        )
        radiance = dr.select(visible, self._fetch(texels, across, down, visible), 0.0)
        return Seen(radiance, is_lamp & visible, lamp, dr.select(is_lamp & visible, density, 0.0))

    def aim(self, lamp: Any, point: Any, u: Any, normal: Any = None) -> Aim:
        """Directions to lamps: uniform over the cone of a globe, over the area of a sheet."""
        mi = self.mi
        import drjit as dr

        is_globe = lamp < len(self.globes)
        away, cone = self._globe(lamp, point)
        distance = dr.norm(away)
        cosine = 1 - u.x * cone
        sine_2 = dr.maximum(1 - dr.square(cosine), 0)
        frame = mi.Frame3f(away / distance)
        s, c = dr.sincos(dr.two_pi * u.y)
        sine = dr.sqrt(sine_2)
        to_globe = frame.to_world(mi.Vector3f(sine * c, sine * s, cosine))
        radius = dr.gather(mi.Float, self.radius, lamp)
        globe_at = distance * cosine - dr.safe_sqrt(dr.square(radius) - dr.square(distance) * sine_2)

        right, down = dr.gather(mi.Vector3f, self.right, lamp), dr.gather(mi.Vector3f, self.down, lamp)
        to_sheet = dr.gather(mi.Vector3f, self.corner, lamp) + right * u.x + down * u.y - mi.Vector3f(point)
        sheet_at = dr.norm(to_sheet)
        to_sheet /= sheet_at
        area = dr.gather(mi.Float, self.area, lamp)
        facing = -dr.dot(to_sheet, dr.cross(down, right)) / area
        sheet_density = dr.select(facing > 1e-6, dr.square(sheet_at) / (area * dr.maximum(facing, 1e-6)), 0.0)

        direction = dr.select(is_globe, to_globe, to_sheet)
        density = dr.select(is_globe, 1 / (dr.two_pi * cone), sheet_density)
        texels = dr.gather(mi.Vector4f, self.lamp_texels, lamp)
        radiance = self._fetch(texels, u.x, u.y, density > 0)
        return Aim(direction, dr.select(is_globe, globe_at, sheet_at), radiance, density)

    def arriving(self, point: Any, normal: Any, aim: Aim, active: Any) -> tuple[Any, Any, Any]:
        """Whether nothing in the room stands before the lamps that were aimed at; what they send, and the density."""
        mi = self.mi
        ray = mi.Ray3f(point, aim.direction)
        ray.maxt = aim.distance * STOP
        clear = ~self.scene.ray_test(ray, active)
        for k, _ in enumerate(self.globes):
            away, _ = self._globe(mi.UInt32(k), point)
            clear &= self._reach(k, ray, away) > ray.maxt
        return clear, aim.radiance, aim.density

    def choice(self, point: Any) -> list[Any]:
        """Probability of each lamp, in proportion to what it would send here were it turned this way."""
        mi = self.mi
        import drjit as dr

        shares = [
            strength / dr.squared_norm(dr.gather(mi.Point3f, self.middle, mi.UInt32(k)) - point)
            for k, strength in enumerate(self.strengths)
        ]
        total = sum(shares)
        return [share / total for share in shares]

    def _globe(self, lamp: Any, point: Any) -> tuple[Any, Any]:
        """Vector from `point` to a globe's centre, and 1 - cos of the half angle it subtends."""
        mi = self.mi
        import drjit as dr

        away = dr.gather(mi.Vector3f, self.middle, lamp) - mi.Vector3f(point)
        sine_2 = dr.minimum(
            dr.square(dr.gather(mi.Float, self.radius, lamp)) / dr.squared_norm(away), 1 - 1e-6
        )
        return away, dr.maximum(sine_2, 1e-12) / (1 + dr.sqrt(1 - sine_2))

    def _reach(self, k: int, ray: Any, away: Any) -> Any:
        """How far along `ray` the surface of globe `k` lies; inf: nowhere."""
        import drjit as dr

        along = dr.dot(away, ray.d)
        # The foot point's distance, not a difference of squares: float32 would lose the rim.
        inside = self.globes[k].radius_m ** 2 - dr.squared_norm(away - along * ray.d)
        return dr.select((inside > 0) & (along > 0), along - dr.safe_sqrt(inside), dr.inf)

    def _fetch(self, texels: Any, across: Any, down: Any, active: Any) -> Any:
        """Bilinear, at fractions of a rectangle of texels (x, y, width, height)."""
        mi = self.mi
        import drjit as dr

        x = texels.x + texels.z * across - 0.5
        y = texels.y + texels.w * down - 0.5
        column, row = dr.floor(x), dr.floor(y)
        x, y = x - column, y - row
        first = mi.UInt32(row) * self.pitch + mi.UInt32(column)

        def texel(offset: int) -> Any:
            value = dr.gather(mi.Vector4f, self.picture, first + offset, active)
            return mi.Color3f(value.x, value.y, value.z)

        upper = texel(0) * (1 - x) + texel(1) * x
        lower = texel(self.pitch) * (1 - x) + texel(self.pitch + 1) * x
        return upper * (1 - y) + lower * y


def _picture(
    atlas: Atlas, glows: list[np.ndarray]
) -> tuple[Float[np.ndarray, "h w 4"], np.ndarray, np.ndarray]:
    """Atlas with the lamps' own pictures below it; first texel (x, y) and size of every panel and lamp."""
    rows, columns = atlas.picture.shape[:2]
    low = [tuple(row) for row in atlas.low * [columns, rows]]
    size = [tuple(row) for row in (atlas.high - atlas.low) * [columns, rows]]
    x, y, tall = 0, rows, 0
    placed = []
    for glow in glows:
        h, w = glow.shape[0] + 2, glow.shape[1] + 2
        if x + w > columns:
            x, y, tall = 0, y + tall, 0
        placed.append((y, x, np.pad(glow, ((1, 1), (1, 1), (0, 0)), mode="edge")))
        low.append((x + 1, y + 1))
        size.append((w - 2, h - 2))
        x, tall = x + w, max(tall, h)
    # A fourth channel lets a texel be fetched in one piece; one more row is touched with weight zero.
    picture = np.zeros((y + tall + 1, columns, 4), np.float32)
    picture[:rows, :, :3] = atlas.picture
    for y, x, glow in placed:
        picture[y : y + glow.shape[0], x : x + glow.shape[1], :3] = glow
    return picture, np.array(low), np.array(size)


def _table(mi: Any, rows: np.ndarray) -> Any:
    return mi.Float(np.ravel(rows).astype(np.float32))


def _mesh(mi: Any, corners: Float[np.ndarray, "q 4 3"]) -> Any:
    """Triangles 2q (corner, down, across) and 2q + 1 (corner, across, right) of every rectangle."""
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first + [0, 3, 2], first + [0, 2, 1]], 1)
    mesh = mi.Mesh("room", 4 * len(corners), 2 * len(corners))
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.ravel(corners).astype(np.float32)
    params["faces"] = np.ravel(faces).astype(np.uint32)
    params.update()
    return mesh
