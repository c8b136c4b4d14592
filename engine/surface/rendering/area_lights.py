"""Lamps as every pixel sees them: from its own place instead of its block's, and no wider than they are.

A lamp half a metre away stands elsewhere for every point of the object, and its highlight is sharper than the cells
that the rest of the light is sorted into. So each pixel is lit by each lamp from its own direction and distance, as
by a sphere of even radiance whose extent widens the specular lobe. What hides a lamp is what hides the cells
around it.

Camera frame; a lamp moves with the room, so that it stands elsewhere in every view.
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Int

from engine.geometry import fibonacci_sphere, sphere_solid_angle, transform
from engine.light.fitting.lamp_model import lamp_transmittance
from engine.light.incident.direction_grid import FACES, CellMap, interpolated_cells
from engine.surface.reflectance.brdf import lobes
from engine.surface.visibility.ray_visibility import SparseVisibility
from engine.types import Gaussians, Lamps


@functools.lru_cache(4)
def cells_around(count: int) -> CellMap:
    """Which three of `count` direction cells are around each direction of a cube map, less than a degree each, and their shares."""
    return interpolated_cells(fibonacci_sphere(count), 128)


@dataclass(frozen=True, slots=True, eq=False)
class AreaLights:
    """The lamps of some views."""

    centres: Float[np.ndarray, "n l 3"]
    radii: Float[np.ndarray, " l"]  # scene units
    radiance: Float[np.ndarray, "n l 3"]  # that gets past what stands in the room; zero: hidden
    cells: int  # direction cells of the light beside them

    @staticmethod
    def none(views: int, cells: int) -> "AreaLights":
        """No lamps."""
        nothing = np.zeros((views, 0, 3))
        return AreaLights(nothing, np.zeros(0), nothing.astype(np.float32), cells)

    def views(self, index: Int[np.ndarray, " k"]) -> "AreaLights":
        """The same for some of its views."""
        return AreaLights(self.centres[index], self.radii, self.radiance[index], self.cells)

    def moved(self, steps: Float[np.ndarray, "n l 3"]) -> "AreaLights":
        """Every lamp elsewhere; what hides it stays."""
        return replace(self, centres=self.centres + steps)

    def from_afar(self, point: Float[np.ndarray, " 3"], times: float = 1000.0) -> "AreaLights":
        """Every lamp so many times as far from a point, and as large from there."""
        return replace(self, centres=point + times * (self.centres - point), radii=times * self.radii)

    def beside(self, other: "AreaLights") -> "AreaLights":
        """Their views, and another's after them, of the same lamps."""
        centres = np.concatenate([self.centres, other.centres])
        return replace(self, centres=centres, radiance=np.concatenate([self.radiance, other.radiance]))

    def under(self, gain: Float[np.ndarray, "l 3"]) -> "AreaLights":
        """Every lamp under its gain."""
        return replace(self, radiance=self.radiance * gain.astype(np.float32))

    def visible(
        self, points: Float[np.ndarray, "p 3"], hidden: SparseVisibility | None
    ) -> Float[np.ndarray, "p n l"]:
        """The share of each lamp that each point sees (float32); 0 where the room hides it from all of them. `hidden` is of
        the same points."""
        seen = np.zeros((len(points), *self.centres.shape[:2]), np.float32)
        if not len(self.radii):
            return seen
        start, direction = np.zeros(len(points) + 1, np.int64), np.zeros(0, np.int32)
        if hidden is not None:
            start, direction = hidden.start, hidden.direction
        around = cells_around(self.cells)
        _visible(
            points, self.centres, self.radiance.max(2) > 0, start, direction, self.cells, around.index, around.share,
            FACES, seen,
        )  # fmt: skip
        return seen

    def shone(self, unit: Float[np.ndarray, "p k n l"]) -> Float[np.ndarray, "p k n 3"]:
        """The sum over the lamps, each at its radiance."""
        return np.einsum("pknl,nlc->pknc", unit, self.radiance, optimize=True)

    def levels(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "l 3"]:
        """Radiance times solid angle of each lamp, summed over points and views."""
        distance = np.linalg.norm(self.centres[None] - points[:, None, None], axis=3)
        return np.einsum("mnl,nlc->lc", sphere_solid_angle(self.radii, distance), self.radiance.astype(float))


def area_lights_of(
    lamps: Lamps,
    gaussians: Gaussians,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    middle: Float[np.ndarray, " 3"],
    cells: int,
) -> AreaLights:
    """The lamps in the frames of some views; what of the room hides one from `middle` (camera frame) hides it."""
    seen = [transform(pose, lamps.centres.reshape(-1, 3)) for pose in cam_from_world]
    centres = np.array(seen).reshape(len(seen), len(lamps.radii), 3)
    through = lamp_transmittance(lamps, gaussians, cam_from_world, middle)
    radiance = (through[..., None] * lamps.radiance).astype(np.float32)
    return AreaLights(centres, lamps.radii, radiance, cells)


# Inlined: a cached kernel that calls another may be given that one as compiled elsewhere, which rounds differently.
@numba.njit(inline="always", error_model="numpy")
@no_type_check
def place_in_cube(faces, side, x, y, z):
    """Face, row and column of a direction in a cube map."""
    best, face, a, b = -1e30, 0, 0.0, 0.0
    for f in range(6):
        ahead = faces[f, 2, 0] * x + faces[f, 2, 1] * y + faces[f, 2, 2] * z
        if ahead > best:
            best, face = ahead, f
    a = (faces[face, 0, 0] * x + faces[face, 0, 1] * y + faces[face, 0, 2] * z) / best
    b = (faces[face, 1, 0] * x + faces[face, 1, 1] * y + faces[face, 1, 2] * z) / best
    u = min(max(int((a + 1) * 0.5 * side), 0), side - 1)
    v = min(max(int((b + 1) * 0.5 * side), 0), side - 1)
    return face, v, u


@numba.njit(nogil=True, cache=True, error_model="numpy")
@no_type_check
def _visible(points, centres, shines, start, direction, cells, index, share, faces, seen):
    side = index.shape[1]
    for p in range(points.shape[0]):
        dark = np.zeros(cells, np.float32)
        for e in range(start[p], start[p + 1]):
            dark[direction[e]] = 1
        for n in range(centres.shape[0]):
            for l in range(centres.shape[1]):
                if not shines[n, l]:
                    continue
                x = centres[n, l, 0] - points[p, 0]
                y = centres[n, l, 1] - points[p, 1]
                z = centres[n, l, 2] - points[p, 2]
                face, v, u = place_in_cube(faces, side, x, y, z)
                lost = np.float32(0)
                for s in range(3):
                    lost += share[face, v, u, s] * dark[index[face, v, u, s]]
                seen[p, n, l] = np.float32(1) - lost


@numba.njit(inline="always", fastmath=True, error_model="numpy")
@no_type_check
def _towards(centres, radii, points, p, n, l):
    """Unit vector from a point to a lamp, the sine of half its extent, and its solid angle."""
    x = np.float32(centres[n, l, 0] - points[p, 0])
    y = np.float32(centres[n, l, 1] - points[p, 1])
    z = np.float32(centres[n, l, 2] - points[p, 2])
    over = np.float32(1) / math.sqrt(x * x + y * y + z * z)
    sine = min(np.float32(radii[l]) * over, np.float32(0.99))
    # Without the cancellation of 1 - cos of a small angle.
    solid = np.float32(2 * math.pi) * sine * sine / (np.float32(1) + math.sqrt(np.float32(1) - sine * sine))
    return x * over, y * over, z * over, sine, solid


@numba.njit(inline="always", fastmath=True, error_model="numpy")
@no_type_check
def _answers(nl, nv, lv, sine, r, full_diffuse, bend, metal):
    """(diffuse, specular) per solid angle of a lamp whose middle and the view stand at these cosines."""
    if nl < sine:
        # It rises above the horizon: the mean over a disc of the cosine's positive part.
        t = min(max(nl / sine, np.float32(-1)), np.float32(1))
        side = math.sqrt(max(np.float32(1) - t * t, np.float32(0)))
        part = t * (math.pi / 2 + math.asin(t)) + side * (np.float32(2) + t * t) / np.float32(3)
        nl = max(sine * np.float32(part / math.pi), np.float32(0))
    # A disc's extent widens the lobe, as a cell's does: `brdf.lobe_floor`.
    a2 = r * r * r * r + sine * sine * np.float32(0.125)
    smith_v = nv + math.sqrt(a2 + (np.float32(1) - a2) * nv * nv)
    mv = np.float32(1) - nv
    a, b = lobes(nl, nv, smith_v, mv * mv * mv * mv * mv, lv, r, a2, full_diffuse, bend, metal)
    return a, b


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def add_lamps(
    points, views, normals, roughness, matter, centres, radii, seen, full_diffuse, radiance, diffuse, specular
):  # fmt: skip
    """Add what all lamps send to variants of each point, no albedo applied; `seen` as `AreaLights.visible` has it."""
    for p in range(points.shape[0]):
        vx, vy, vz = views[p, 0], views[p, 1], views[p, 2]
        bend, metal = matter[p, 0], matter[p, 1]
        for n in range(centres.shape[0]):
            for l in range(centres.shape[1]):
                if seen[p, n, l] <= 0:
                    continue
                x, y, z, sine, solid = _towards(centres, radii, points, p, n, l)
                lv = vx * x + vy * y + vz * z
                solid *= seen[p, n, l]
                for k in range(normals.shape[1]):
                    nx, ny, nz = normals[p, k, 0], normals[p, k, 1], normals[p, k, 2]
                    nl = nx * x + ny * y + nz * z
                    if nl <= -sine:
                        continue
                    nv = max(nx * vx + ny * vy + nz * vz, np.float32(1e-3))
                    a, b = _answers(nl, nv, lv, sine, roughness[p, k], full_diffuse, bend, metal)
                    a, b = a * solid, b * solid
                    for c in range(radiance.shape[2]):
                        diffuse[p, k, n, c] += a * radiance[n, l, c]
                        specular[p, k, n, c] += b * radiance[n, l, c]
