"""The room as the photographs' light has it: Gaussians composited exactly, by the engine's own kernel.

Too slow to keep up with a moving eye without a graphics card, so the picture comes in bands that can be
interrupted, and coarse at first. World frame.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from app.viewer import shades
from app.viewer.canvas import Eye
from app.viewer.scene import Emitters
from engine.light.gaussians import rasterize, rasterize_kernels

BAND = 96  # rows


@dataclass(frozen=True, slots=True, eq=False)
class Haze:
    """What the Gaussians look like: colours 0 to 255, opacity, and the depth at which they are."""

    colours: UInt8[np.ndarray, "h w 3"]
    opacity: Float[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]


class Splats:
    """Composites one set of Gaussians."""

    def __init__(self, emitters: Emitters) -> None:
        self._radiance = emitters.radiance
        self._shapes = rasterize.shapes(emitters.gaussians)

    def rows(self, eye: Eye, divisor: int, first: int, last: int) -> Float[np.ndarray, "r w 5"]:
        """Radiance, transmittance and weighted depth of rows `first` to `last` of every `divisor`-th pixel."""
        focal = eye.focal / divisor
        lens = np.array([focal, focal, eye.width / divisor / 2, eye.height / divisor / 2 - first])
        band = rasterize.Pinhole(
            np.ascontiguousarray(eye.cam_from_world, np.float64), lens, -(-eye.width // divisor), last - first
        )
        with rasterize.thread_pool() as run:
            return rasterize.render(self._shapes, self._radiance, band, eye.near, run)

    def coarse(self, eye: Eye, divisor: int, white: float) -> Haze:
        """The whole picture at once, at `divisor`, blurred up to its size."""
        picture = self.rows(eye, divisor, 0, -(-eye.height // divisor))
        return haze(cv2.resize(picture, (eye.width, eye.height), interpolation=cv2.INTER_LINEAR), white)


def compiled() -> bool:
    """Whether this process has the kernel already; from an empty cache it takes seconds to make."""
    return bool(rasterize_kernels.forward.signatures)


def haze(picture: Float[np.ndarray, "h w 5"], white: float) -> Haze:
    opacity = 1 - np.clip(picture[..., 3], 0, 1)
    safe = np.maximum(opacity, 1e-4)
    colours = shades.toned(picture[..., :3] / safe[..., None], white)
    return Haze(colours, opacity, picture[..., 4] / safe)


def veil(
    image: UInt8[np.ndarray, "h w 4"], depth: Float[np.ndarray, "h w"], seen: Haze
) -> UInt8[np.ndarray, "h w 4"]:
    """A picture with the haze in front of what is further away than it, behind the rest."""
    share = np.where((depth > 0) & (depth < seen.depth), 0.0, seen.opacity)[..., None].astype(np.float32)
    mixed = image.copy()
    mixed[..., :3] = image[..., :3] * (1 - share) + seen.colours[..., ::-1] * share
    return mixed
