"""How many probes and directions tell the light around an object: as many as its parallax and its gloss ask for.

Between probes the light is interpolated, so what matters is how far it bends between them. Along each axis of the object's
box, what a grey ball sends to the camera is told by the light in the middle and by the mean of the light at both ends;
a line cut into k pieces bends away from its chords by a k-th squared. Between directions light is averaged; whether there
are enough is seen on some of the object's own pixels, for only a highlight tells one from the next. A few views suffice:
they see one room from a few places. Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from engine.light.incident.probes import gather_probes
from engine.progress import Progress
from engine.sampling import evenly_spaced
from engine.surface.lighting.room_light import ball, gather_incident_light
from engine.surface.optimize.gauss_newton import PixelEstimate
from engine.surface.params import SurfaceParams
from engine.surface.rendering.transport import (
    LightTransport,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
    predict,
    probe_grid_around,
)
from engine.types import Camera, Emitters


@dataclass(frozen=True, slots=True)
class ProbeDensityConfig:
    """Shares are of the misfit expected of a good model. Errors of a solve go on falling beyond the most directions, though slower
    than its time grows: preset fine takes four times as many."""

    probes_share: float = 0.25  # that may be the interpolation's between probes,
    directions_share: float = 0.5  # and what too few directions leave out
    parallax_directions: int = 512  # under which it is measured
    least_directions: int = 256
    most_directions: int = 1024
    most_probes: int = 125  # altogether; rooms ask for 20 to 60
    pixels: int = 200  # that are looked at;
    dark: float = 0.01  # what is darker than so much of their mean counts as that
    views: int = 8


CONFIG = ProbeDensityConfig()


def choose_probe_grid(
    camera: Camera,
    mask: Bool[np.ndarray, "h w"],
    near_far: tuple[float, float],
    emitters: Emitters,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    params: SurfaceParams,
    progress: Progress,
) -> ProbeGrid:
    """The lattice around the object's pixels between two z, as dense as was asked or as the light of these views needs."""
    asked = params.probe_grid_xy, params.probe_grid_xy, params.probe_grid_z
    box = probe_grid_around(camera, mask, near_far, (3, 3, 3))
    if not all(asked):
        few = cam_from_world[evenly_spaced(len(cam_from_world), CONFIG.views)]
        measured = probe_counts(box, emitters, few, params, progress)
        across, down, deep = (a or m for a, m in zip(asked, measured, strict=True))
        asked = across, down, deep
    return replace(box, shape=asked)


def probe_counts(
    box: ProbeGrid,
    emitters: Emitters,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    params: SurfaceParams,
    progress: Progress,
) -> tuple[int, ...]:
    """Along each axis of the box as many as leave `probes_share` of `params.model_error`; one where the light stays the same.

    The lamps are not counted: they shine on every pixel from their own place.
    """
    # Of 3 x 3 x 3 places the middle, and both ends of each axis.
    cross = [[1, 1, 1], [0, 1, 1], [2, 1, 1], [1, 0, 1], [1, 2, 1], [1, 1, 0], [1, 1, 2]]
    points = replace(box, shape=(3, 3, 3)).points().reshape(3, 3, 3, 3)[tuple(np.transpose(cross))]
    cells = direction_cells(CONFIG.parallax_directions)
    light = gather_probes(
        emitters.field(), cam_from_world, points, cells, params.probe_resolution, True, progress
    )
    sent = np.einsum("md,npdc->npmc", ball(cells, params.diffuse == "disney"), light.energy)
    middle, ends = sent[:, 0], (sent[:, 1::2], sent[:, 2::2])

    def off(other: Float[np.ndarray, "n 3 m c"]) -> Float[np.ndarray, " 3"]:
        """From the middle, for each axis."""
        return np.sqrt((((other - middle[:, None]) / middle[:, None]) ** 2).mean((0, 2, 3)))

    bent, moved = off((ends[0] + ends[1]) / 2), np.maximum(off(ends[0]), off(ends[1]))
    least = CONFIG.probes_share * params.model_error
    pieces = np.clip(np.ceil(np.sqrt(bent / least)), 1, CONFIG.most_probes)
    counts = np.where(moved <= least, 1, pieces + 1).astype(int)
    # Else light that bends without end would take all time.
    while counts.prod() > CONFIG.most_probes:
        counts[counts.argmax()] -= 1
    return tuple(counts.tolist())


def choose_direction_count(
    state: PixelEstimate,
    geometry: SurfaceGeometry,
    emitters: Emitters,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    params: SurfaceParams,
    progress: Progress,
) -> int:
    """Fewest directions, `most_directions` at most, under which this surface looks as under twice as many as that.

    The RMS of the logarithms of what some pixels send may be `directions_share` of `params.model_error`.
    """
    few = evenly_spaced(len(state.normals), CONFIG.pixels)
    there = cam_from_world[evenly_spaced(len(cam_from_world), CONFIG.views)]
    x, y, z = geometry.points[few].mean(0)
    middle = np.array([x / z, y / z, z])
    alone, some = replace(geometry, visibility=None).part(few), state.part(few)
    nothing = np.zeros((0, 3 * len(there)), np.float32)

    def sent(directions: int) -> Float[np.ndarray, "p n 3"]:
        at = ProbeGrid(middle, middle, (1, 1, 1))
        light = gather_incident_light(at, emitters, there, directions, params.probe_resolution, progress)
        transport = LightTransport(light, nothing, params.diffuse == "disney", False, "cpu")
        every = [np.arange(len(few))]
        ((_, radiance),) = predict(transport, alone, every, some.normals, some.albedo, some.roughness)
        return np.asarray(np.log(np.maximum(radiance, CONFIG.dark * radiance.mean())))

    whole, directions = sent(2 * CONFIG.most_directions), CONFIG.least_directions
    while directions < CONFIG.most_directions:
        if np.sqrt(((sent(directions) - whole) ** 2).mean()) <= CONFIG.directions_share * params.model_error:
            break
        directions *= 2
    return directions
