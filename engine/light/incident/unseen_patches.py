"""The part of the room that no photograph shows, as patches that stand where its walls would go on.

A camera that only turns about one axis never sees ceiling and floor, and most of the light may come from there.
How bright that is only the object's shading can tell; for it to be asked, something must stand there: flat round
Gaussians at the smooth continuation of the distances around, as bright as the smooth continuation of the light. World
frame, scene units.
"""

import numpy as np
from jaxtyping import Float

from engine.color import luminance
from engine.geometry import fibonacci_sphere
from engine.light.gaussians.gaussians import isotropic_gaussians, part
from engine.light.incident.inpainting import inpaint, inpaint_energy, neighbourhood
from engine.light.incident.probes import gather_probes
from engine.types import Gaussians

DIRECTIONS = 2400
"""Patches that would close the whole sphere: four degrees from one to the next. A ceiling's lamp has a width and a length, and the
right light seen through patches twice as far apart explains an object worse than a wrong one does."""
OPEN = 0.5
"""Opacity below which a direction needs a patch."""
LEAST = 0.01
"""Share of the sphere that must be open; smaller holes are filled at every probe as their rims are (`inpainting.py`)."""
DENSITY = 5.0
WIDE, FLAT = 0.75, 0.1
"""Scale of a patch by the distance to the next, so that all together let little through; its thickness by that."""


def unseen_patches(gaussians: Gaussians, centre: Float[np.ndarray, " 3"]) -> Gaussians:
    """What closes the room as seen from `centre`; none where it is closed but for small holes."""
    directions = fibonacci_sphere(DIRECTIONS)
    here = np.concatenate([np.eye(3), -centre[:, None]], axis=1)[None]
    found = gather_probes(gaussians, here, np.zeros((1, 3)), directions, fill=False)
    seen = found.seen[0, 0].astype(np.float64)
    missing = seen < OPEN
    if missing.mean() < LEAST or not (luminance(found.energy[0, 0]) * ~missing).any():
        return part(gaussians, slice(0))
    around, area = neighbourhood(directions), 4 * np.pi / DIRECTIONS
    solid = np.full(DIRECTIONS, area)
    energy = inpaint_energy(
        found.energy[0, 0].astype(np.float64), seen, np.where(missing, 0, seen), solid, around
    )
    away = np.linalg.norm(found.places[0, 0] - centre, axis=1).astype(np.float64)
    # Where nothing shines, nothing says from where.
    told = np.where(missing | (away < 1e-3 * away.max()), 0, seen)
    logs = np.log(np.maximum(away, 1e-9))[:, None]
    distance = np.exp(inpaint(logs, told, around))[missing]
    towards = directions[missing]
    scales = WIDE * np.sqrt(area) * distance * [1.0, 1.0, FLAT]
    colours, coefficients = energy[missing] / area, gaussians.radiance.shape[1]
    return isotropic_gaussians(
        centre + distance * towards, _turned_to(towards), scales, DENSITY, colours, coefficients
    )


def _turned_to(directions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 4"]:
    """Quaternions (w, x, y, z) that turn z into each direction."""
    x, y, z = directions.T
    half = np.stack([1 + z, -y, x, np.zeros(len(x))], axis=1)
    half[z < -1 + 1e-9] = [0, 1, 0, 0]
    return half / np.linalg.norm(half, axis=1, keepdims=True)
