"""Photographs of half the size, and what they tell of the full ones."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.ndimage import distance_transform_edt

from engine.geometry import resized
from engine.progress import Progress
from engine.surface.data.observations import pixel_index
from engine.surface.optimize import gauss_newton
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.object_pixels import ObjectPixels, depth_from_normals
from engine.surface.rendering.transport import SurfaceGeometry
from engine.types import Camera, Frames


def downsample(
    frames: Frames, mask: Bool[np.ndarray, "h w"], camera: Camera
) -> tuple[Frames, Bool[np.ndarray, "h2 w2"], Camera]:
    """Photographs of half the size: means over each 2 x 2, of the object's pixels where it is the object, else of the others."""
    height, width = mask.shape[0] // 2 * 2, mask.shape[1] // 2 * 2

    def fours(x: Shaped[np.ndarray, "*n h w"]) -> Shaped[np.ndarray, "*n h2 w2 4"]:
        x = x[..., :height, :width].reshape(*x.shape[:-2], height // 2, 2, width // 2, 2)
        return np.moveaxis(x, -3, -2).reshape(*x.shape[:-4], height // 2, width // 2, 4)

    inside = fours(mask)
    small = inside.sum(-1) >= 2
    own = inside == small[..., None]
    count = np.maximum(own.sum(-1), 1)
    radiance = np.empty((len(frames.names), *small.shape, 3), np.float32)
    for view, photograph in enumerate(frames.radiance):  # one by one: all of them may be more than fits
        for c in range(3):
            radiance[view, ..., c] = (fours(photograph[..., c]) * own).sum(-1) / count
    clipped, dark = (
        np.stack([(fours(view) & inside).any(-1) for view in views])
        for views in (frames.clipped, frames.dark)
    )
    shot, floor = frames.noise
    # A mean of four: a quarter of the variance.
    fewer = Frames(frames.names, radiance, clipped, dark, (shot / 4, floor / 2))
    # An odd last row or column is cut off, and the field of view with it.
    even = Camera(
        width, height, camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2
    )
    return fewer, small, resized(even, width // 2, height // 2)


def parent_index(small: Bool[np.ndarray, "h2 w2"], mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, " p"]:
    """For each of the mask's pixels the nearest of the `halved` ones."""
    nearest = distance_transform_edt(~small, return_distances=False, return_indices=True)
    index = pixel_index(small)[tuple(nearest)]  # pyrefly: ignore[bad-argument-type]
    v, u = np.nonzero(mask)
    return index[np.minimum(v // 2, small.shape[0] - 1), np.minimum(u // 2, small.shape[1] - 1)]


def upsample_estimate(
    object_pixels: ObjectPixels,
    half: ObjectPixels,
    state: gauss_newton.PixelEstimate,
    geometry: SurfaceGeometry,
    distance: float,
    progress: Progress,
) -> tuple[ObjectPixels, gauss_newton.PixelEstimate, Float[np.ndarray, "h w"], SurfaceGeometry]:
    """What `halved` pixels know as a start for the full ones (`object_pixels`), each taking the nearest one's; with a depth of their
    own. The full ones are of the half ones' material then."""
    take = parent_index(half.mask, object_pixels.mask)
    object_pixels = replace(object_pixels, material=of_pixels(half.material, take))
    state = gauss_newton.initial_estimate(state.normals[take], state.albedo[take], state.roughness[take])
    depth = depth_from_normals(object_pixels, state, distance, progress)
    hidden = None
    if geometry.visibility is not None:
        count = int(half.mask.sum())
        behind = np.full(count, -1, np.int32)
        behind[take] = np.arange(len(take))
        hidden = geometry.visibility.part(take).told(count, behind, len(take))
    return (object_pixels, state, depth, replace(object_pixels.geometry_of_depth(depth), visibility=hidden))
