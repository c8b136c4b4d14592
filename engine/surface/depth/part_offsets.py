"""How far the parts of the depth stand behind one another, as the photographs tell.

Normals tell the shape of every part that jumps divide, and not how high a jump is. What stands beside a jump hides some of the room
from the pixels behind it, the more the higher it is. So every part is moved along the rays, the largest first; what is then hidden
from the pixels beside its border is traced anew, and they are solved again: their misfit says where it stands. Offsets are of
log z; a pixel's width on the surface is the inverse of the focal length. Camera frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

from engine.progress import Progress
from engine.surface.data.observations import pixel_index
from engine.surface.depth.normal_integration import IntegratedDepth, integrate_parts
from engine.surface.optimize.gauss_newton import PixelEstimate, minimize
from engine.surface.optimize.pixel_sample import random_subset, sample_pixels
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import ObjectPixels, image
from engine.surface.rendering.transport import IncidentLight
from engine.surface.visibility.ray_visibility import trace_occlusion
from engine.types import Camera


@dataclass(frozen=True, slots=True)
class PartOffsetsConfig:
    """Lengths are widths of a pixel on the surface."""

    first_step_px: float = 4.0  # of a part, either way; doubled
    farthest_px: float = 64.0  # up to this
    beside_px: float = 20.0  # of a border: pixels that say where a part stands,
    pixels: int = 200  # so many of them at most
    gauss_newton_steps: int = 2
    loudest: float = 1.0  # log likelihood, per view and channel, that one pixel has at most
    sigmas: float = 2.0  # standard errors by which a place must be likelier than another to be told from it


CONFIG = PartOffsetsConfig()

Likelihood = Callable[[Float[np.ndarray, "h w"], Int[np.ndarray, " n"]], Float[np.ndarray, " n"]]
"""Of a depth: of some pixels, by their numbers, a logarithm per view and channel."""


@dataclass(frozen=True, slots=True, eq=False)
class DepthParts:
    """A depth in parts that jumps divide."""

    together: IntegratedDepth  # with the parts drawn together
    part: Int[np.ndarray, "h w"]  # every pixel's, from 0 on; -1 off the mask
    offset: Float[np.ndarray, " k"]  # of every part,
    stderr: Float[np.ndarray, " k"]  # and its standard error
    focal: float  # pixels

    @classmethod
    def of(
        cls,
        camera: Camera,
        mask: Bool[np.ndarray, "h w"],
        normals: Float[np.ndarray, "p 3"],
        distance: float,
        told: Float[np.ndarray, "h w 2"] | None,
        progress: Progress,
    ) -> "DepthParts":
        """What normals tell of depth, in the mean at a distance; the parts stand behind one another as `told` pixel by pixel."""
        found = integrate_parts(camera, image(mask, normals), mask, distance, progress)
        numbered = found.part > 0 if found.part.any() else mask
        # Parts too small to be told go with the nearest.
        nearest = distance_transform_edt(~numbered, return_distances=False, return_indices=True)
        part = np.where(mask, np.maximum(found.part[tuple(nearest)].astype(int) - 1, 0), -1)  # pyrefly: ignore[bad-argument-type]
        focal = float(np.sqrt(camera.fx * camera.fy))
        unknown = CONFIG.farthest_px / focal
        before = np.tile([0.0, unknown], (mask.sum(), 1)) if told is None else told[mask]
        offset, stderr = (np.bincount(part[mask], one) / np.bincount(part[mask]) for one in before.T)
        return cls(found, part, offset, stderr, focal)

    @property
    def told(self) -> Float[np.ndarray, "h w 2"]:
        """Pixel by pixel the offset and its standard error; 0 off the mask."""
        every = np.stack([self.offset, self.stderr], 1)
        return np.where(self.part[..., None] >= 0, every[self.part], 0)

    @property
    def stderr_px(self) -> tuple[float, ...]:
        """Of the parts that are numbered, in widths of a pixel; a `CONFIG.farthest_px` and more: not determined."""
        return tuple(map(float, self.focal * self.stderr[: len(self.together.shares)]))

    @property
    def placed(self) -> Float[np.ndarray, "h w"]:
        """The depth with the parts where they stand, in the mean as far away."""
        moved = self.together.depth * np.exp(self.told[..., 0])
        return moved * (self.together.depth.sum() / moved.sum())

    def moved(self, part: int, by_px: float) -> "DepthParts":
        """The same with one part so many widths of a pixel behind where it was."""
        here = np.arange(len(self.offset)) == part
        return replace(self, offset=self.offset + by_px / self.focal * here)


def place(parts: DepthParts, likelihood: Likelihood, seed: int, progress: Progress) -> DepthParts:
    """The parts where the photographs say that they stand; those of which they say nothing plainly stay."""
    mask = parts.part >= 0
    for k, _ in enumerate(parts.offset):
        progress.step(k / len(parts.offset), "placing the parts of the depth")
        inside = parts.part == k
        if (mask == inside).all():
            continue
        to_part, to_others = (np.asarray(distance_transform_edt(~some)) for some in (inside, mask & ~inside))
        near = mask & (np.where(inside, to_others, to_part) <= CONFIG.beside_px)
        parts = _best(parts, k, likelihood, random_subset(pixel_index(mask)[near], CONFIG.pixels, seed))
    return parts


def _best(parts, k, likelihood, pixels):
    """With part `k` where it is likeliest, or where it was if it is not plainly likelier elsewhere. The next places that are plainly
    less likely are two standard errors away."""
    before, best, gained = likelihood(parts.placed, pixels), 0.0, 0.0
    worse = {0.0: 0.0}  # how likely a place is at most; lengths in widths of a pixel
    for way in (1, -1):
        step = CONFIG.first_step_px
        while step <= CONFIG.farthest_px and best * way >= 0:
            gain = likelihood(parts.moved(k, way * step).placed, pixels) - before
            gain = np.clip(gain, -CONFIG.loudest, CONFIG.loudest)
            plainly = CONFIG.sigmas * gain.std() / np.sqrt(len(gain))
            worse[way * step] = gain.mean() + plainly
            if gain.mean() > max(gained, plainly):
                best, gained = way * step, gain.mean()
            elif worse[way * step] < gained:
                break
            step *= 2
    less = [at for at, most in worse.items() if most < gained]
    above = min((at for at in less if at > best), default=2 * CONFIG.farthest_px)
    below = max((at for at in less if at < best), default=-2 * CONFIG.farthest_px)
    stderr = np.where(np.arange(len(parts.stderr)) == k, (above - below) / 4 / parts.focal, parts.stderr)
    return replace(parts.moved(k, best), stderr=stderr)


def likelihood_of(
    object_pixels: ObjectPixels, state: PixelEstimate, light: IncidentLight, params: SurfaceParams
) -> Likelihood:
    """How well pixels explain their photographs under a depth, solved again from a state; up to what is alike for all depths."""
    mask, data = object_pixels.mask, object_pixels.observations.radiance.shape[1]
    normals = image(mask, state.normals)

    def of(depth: Float[np.ndarray, "h w"], pixels: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        geometry = object_pixels.geometry_at(depth[mask])
        points = image(mask, geometry.points)
        hidden = trace_occlusion(points, normals, mask, light.directions, Progress(), some=pixels)
        sample = sample_pixels(object_pixels, geometry, 1.0, pixels, params)
        problem = replace(sample, geometry=replace(sample.geometry, visibility=hidden)).problem(light)
        begun = state.part(pixels).begun_anew()
        cost = minimize(begun, problem, CONFIG.gauss_newton_steps, Progress()).cost
        return -cost / (2 * data * begun.residual_scale**2)

    return of
