"""What the light at the object rests on: photographs, photographs that were clipped, or guesses.

A direction is photographed if Gaussians stand there and the place its light comes from lies on some view's
background; clipped if every view that shows the place is saturated there, so that photographs tell the least and no more;
guessed otherwise, whether it was filled in or left to Gaussians that no photograph shows. World frame.
"""

import numpy as np
from jaxtyping import Bool, Float

from engine.color import luminance
from engine.light.incident.coverage import coverage_of, covered
from engine.light.incident.probes import Cube, panorama_directions
from engine.types import Frames, Gaussians, LightProvenance, Masks, Panorama, Poses

PHOTOGRAPHED, CLIPPED, GUESSED = 0, 1, 2
HALF = 0.5
"""Share of a direction that must be photographed for its class to be another than guessed."""
WIDTH = 256  # of the small backgrounds, pixels: a lamp must not vanish in them
_NORMALS = 2000  # asked at most, evenly spread over the object: irradiance is smooth


def photographed(
    gaussians: Gaussians,
    origin: Float[np.ndarray, " 3"],
    frame_from_world: Float[np.ndarray, "3 3"],
    height: int,
    frames: Frames,
    masks: Masks,
    poses: Poses,
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """For each direction of a panorama at `origin`: whether Gaussians stand there and some view shows the place their
    light comes from, and whether all of those that do are clipped there.

    Args:
        gaussians: what was fitted to photographs; patches of the unseen (`unseen_patches.py`) would stand in any view's way.
    """
    directions = panorama_directions(height)
    light, distance = Cube(gaussians, origin, frame_from_world, 2 * height).look(directions)
    places = (origin + (directions @ frame_from_world) * distance[..., None]).reshape(-1, 3)
    shown, clean = (
        covered(coverage_of(masks, poses, WIDTH, without), places).reshape(distance.shape) > 0
        for without in (None, frames.clipped)
    )
    shown &= light[..., 3] >= HALF
    return shown, shown & ~clean


def provenance_of(
    panorama: Panorama, clipped: Bool[np.ndarray, "h w"], normals: Float[np.ndarray, "p 3"]
) -> LightProvenance:
    """The classes, and the shares of the diffuse irradiance averaged over the object's normals.

    Luminance counts, and nothing that hides the room from the surface does. A direction counts whole for its
    class: what little shines through Gaussians that are not quite opaque is filled in like them.

    Args:
        clipped: directions photographed with saturation only.
        normals: unit, in the panorama's frame.
    """
    height = len(clipped)
    kind = np.where(panorama.seen < HALF, GUESSED, np.where(clipped, CLIPPED, PHOTOGRAPHED)).astype(np.uint8)
    chosen = normals[np.linspace(0, len(normals) - 1, min(len(normals), _NORMALS)).astype(int)]
    facing = np.stack([np.maximum(row @ chosen.T, 0).mean(1) for row in panorama_directions(height)])
    area = np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None]
    irradiance = facing * area * luminance(panorama.radiance.astype(np.float64))
    total = max(float(irradiance.sum()), np.finfo(float).tiny)
    guessed, bound = (float(irradiance[kind == one].sum()) / total for one in (GUESSED, CLIPPED))
    return LightProvenance(kind, guessed, bound)
