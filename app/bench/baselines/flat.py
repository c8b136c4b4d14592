"""Light that is the same all over the object: one panorama per view, and its spherical harmonics to second order.

Source: R. Ramamoorthi and P. Hanrahan, "An efficient representation for irradiance environment maps" (2001): a
matt surface answers the light of degree l by A_l = pi, 2 pi / 3, pi / 4 times its harmonics, and hardly to those
above. Camera frame of each view; harmonics real, in the order of `sh_basis`; the axis `v` = 3 n is view-major.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Int

from engine.light.gaussians.gaussians import sh_basis
from engine.light.incident.direction_grid import FACES, deconvolve
from engine.light.incident.probes import gather_probes
from engine.progress import Progress
from engine.surface.lighting.room_light import mean_camera_centre
from engine.surface.rendering.area_lights import AreaLights, area_lights_of, cells_around, place_in_cube
from engine.surface.rendering.transport import (
    Block,
    IncidentLight,
    LightModes,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
)
from engine.types import Emitters, Poses

HARMONICS = 9
COSINE_LOBE = np.pi * np.repeat([1, 2 / 3, 1 / 4], [1, 3, 5])  # A_l of each of the nine
EVERYWHERE = ProbeGrid(np.array([0, 0, 1.0]), np.array([0, 0, 1.0]), (1, 1, 1))


def panoramas(
    emitters: Emitters,
    poses: Poses,
    views: Int[np.ndarray, " n"],
    point: Float[np.ndarray, " 3"] | None,
    directions: int,
    face_px: int,
    progress: Progress,
) -> IncidentLight:
    """The light of some views as if it were infinitely far: without parallax, lamps sorted into the cells.

    It is what arrives at `point` of the camera frame, anew in each view. None: what arrives in the middle of all
    cameras, so that from view to view the panorama only turns.
    """
    from_world = poses.cam_from_world[views]
    if point is None:
        middle = mean_camera_centre(poses)
        turn = from_world[..., :3]
        from_world, point = np.concatenate([turn, -turn @ middle[:, None]], axis=2), np.zeros(3)
    cells = direction_cells(directions)
    energy = gather_probes(emitters.field(), from_world, point[None], cells, face_px, True, progress).energy
    shared = energy[:, 0].transpose(1, 0, 2).reshape(directions, -1)
    lamps = area_lights_of(emitters.lamps, emitters.shown(), from_world, point, directions)
    shared = shared + sorted_into_cells(lamps, point)
    shared = deconvolve(shared[None].astype(np.float32), cells)
    return IncidentLight(EVERYWHERE, cells, shared, AreaLights.none(len(views), directions))


def sorted_into_cells(lamps: AreaLights, point: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "d v"]:
    """Radiance times solid angle of the lamps at one point, sorted into the direction cells (float32)."""
    out = np.zeros((len(lamps.centres), lamps.cells, 3), np.float32)
    if len(lamps.radii):
        around = cells_around(lamps.cells)
        _spread(
            np.asarray(point, float), lamps.centres, lamps.radii, lamps.radiance, around.index, around.share, FACES, out
        )  # fmt: skip
    return out.transpose(1, 0, 2).reshape(lamps.cells, -1)


@numba.njit(nogil=True, cache=True, error_model="numpy")
@no_type_check
def _spread(point, centres, radii, radiance, index, share, faces, out):
    side, points = index.shape[1], 37  # that a lamp's disc is spread over the cells by
    golden = math.pi * (1 + math.sqrt(5.0))
    for n in range(centres.shape[0]):
        for l in range(centres.shape[1]):
            if radiance[n, l].max() <= 0:
                continue
            x = centres[n, l, 0] - point[0]
            y = centres[n, l, 1] - point[1]
            z = centres[n, l, 2] - point[2]
            distance = math.sqrt(x * x + y * y + z * z)
            x, y, z = x / distance, y / distance, z / distance
            sine = min(radii[l] / distance, 0.99)
            rim = math.sqrt(1 - sine * sine)
            power = 2 * math.pi * sine * sine / (1 + rim) / points
            # Two vectors across the way to the lamp.
            if abs(x) < 0.7:
                ax, ay, az = 0.0, z, -y
            else:
                ax, ay, az = -z, 0.0, x
            length = math.sqrt(ax * ax + ay * ay + az * az)
            ax, ay, az = ax / length, ay / length, az / length
            bx, by, bz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
            for i in range(points):
                up = 1 - (i + 0.5) / points * (1 - rim)  # even in area
                flat = math.sqrt(1 - up * up)
                c, s = flat * math.cos(golden * (i + 0.5)), flat * math.sin(golden * (i + 0.5))
                face, v, u = place_in_cube(
                    faces, side, up * x + c * ax + s * bx, up * y + c * ay + s * by, up * z + c * az + s * bz
                )
                for j in range(3):
                    part = power * share[face, v, u, j]
                    at = index[face, v, u, j]
                    for ch in range(3):
                        out[n, at, ch] += part * radiance[n, l, ch]


@dataclass(frozen=True, slots=True, eq=False)
class Harmonics:
    """Incident radiance to second order, for every view and channel."""

    coefficients: Float[np.ndarray, "9 v"]

    def at(self, point: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "9 v"]:
        """The same at every point."""
        return self.coefficients


def projected(directions: Float[np.ndarray, "d 3"], energy: Float[np.ndarray, "d v"]) -> Harmonics:
    """The harmonics of energies (radiance times solid angle)."""
    return Harmonics(sh_basis(directions, 2).T @ energy)


def answers(normals: Float[np.ndarray, "*p 3"]) -> Float[np.ndarray, "*p 9"]:
    """What a white Lambert surface sends back (irradiance / pi) of each harmonic at unit radiance."""
    return sh_basis(normals, 2) * (COSINE_LOBE / np.pi)


class HarmonicRows:
    """Lambert surfaces under second-order light, nothing hidden: `transport.TransportModel` without a highlight.

    Light to second order may be negative somewhere, and so may the answer; it is left so.
    """

    def __init__(self, light: Harmonics):
        self.incident = light

    def block(self, geometry: SurfaceGeometry, pixels: Int[np.ndarray, " p"]) -> Block:
        """All pixels see all of the light."""
        coefficients = self.incident.coefficients
        no_lamps = np.zeros((len(pixels), coefficients.shape[1] // 3, 0), np.float32)
        alike = np.zeros((0, *coefficients.shape)), np.zeros((len(pixels), 0))
        return Block(geometry.part(pixels), LightModes(coefficients, *alike), no_lamps)

    def __call__(
        self, block: Block, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "p k v"], Float[np.ndarray, "p k v"]]:
        """(diffuse, zeros); the roughness does not matter."""
        diffuse = (answers(normals) @ block.light.mean).astype(np.float32)
        return diffuse, np.zeros_like(diffuse)
