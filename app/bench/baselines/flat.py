"""Light that is the same all over the object: one panorama per view, and its spherical harmonics to second order.

Source: R. Ramamoorthi and P. Hanrahan, "An efficient representation for irradiance environment maps" (2001): a
matt surface answers the light of degree l by A_l = pi, 2 pi / 3, pi / 4 times its harmonics, and hardly to those
above. Camera frame of each view; harmonics real, in the order of `sh_basis`; the axis `v` = 3 n is view-major.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from engine.light.gaussians.gaussians import sh_basis
from engine.light.incident.direction_grid import deconvolve
from engine.light.incident.probes import gather_probes
from engine.progress import Progress
from engine.surface.lighting.room_light import mean_camera_centre
from engine.surface.rendering.area_lights import AreaLights, area_lights_of
from engine.surface.rendering.transport import (
    Block,
    IncidentLight,
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
    shared = shared + area_lights_of(emitters.lamps, emitters.shown(), from_world, point, directions).spread(
        point
    )
    shared = deconvolve(shared[None].astype(np.float32), cells)
    return IncidentLight(EVERYWHERE, cells, shared, AreaLights.none(len(views), directions))


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
        return Block(geometry.points[pixels], geometry.views[pixels], coefficients, *alike, None, no_lamps)

    def __call__(
        self, block: Block, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "p k v"], Float[np.ndarray, "p k v"]]:
        """(diffuse, zeros); the roughness does not matter."""
        diffuse = (answers(normals) @ block.energy).astype(np.float32)
        return diffuse, np.zeros_like(diffuse)
