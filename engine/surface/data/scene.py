"""What a solve never changes: the photographs, at several sizes, and what was asked. Camera frame."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from engine.geometry import cropped, resized
from engine.io.initial_maps import InitialMaps
from engine.sampling import evenly_spaced
from engine.surface.data.observations import parent_index
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import ObjectPixels, observe_object
from engine.surface.rendering.transport import BLOCK
from engine.types import Camera, Frames, Poses

HALVED_FROM = 6000
"""Object pixels from which on half the size is worth a look: light and distance are told by some hundred, whatever their size."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """The photographs at one size."""

    frames: Frames
    mask: Bool[np.ndarray, "h w"]
    camera: Camera
    initial_maps: InitialMaps | None = None  # in place of the global search

    def part(self, rows: slice, columns: slice) -> "Picture":
        """A window of it; nothing is copied. Start maps are kept only by one that holds the whole object."""
        frames = self.frames
        window = Frames(
            frames.names, frames.radiance[:, rows, columns], frames.clipped[:, rows, columns],
            frames.dark[:, rows, columns], frames.noise,
        )  # fmt: skip
        mask, start = self.mask[rows, columns], self.initial_maps
        if start is not None:
            start = replace(start, mask=mask) if mask.sum() == self.mask.sum() else None
        return Picture(window, mask, cropped(self.camera, rows, columns), start)

    def of_views(self, views: Int[np.ndarray, " n"]) -> "Picture":
        """Some of the photographs."""
        return replace(self, frames=self.frames.views(views))

    def downsampled(self) -> "Picture":
        """Half as many pixels across: means over each 2 x 2, of the object's pixels where it is the object, else of the others.
        An odd last row or column is cut off, and the field of view with it."""
        frames, camera = self.frames, self.camera
        height, width = self.mask.shape[0] // 2 * 2, self.mask.shape[1] // 2 * 2

        def fours(x: Shaped[np.ndarray, "*n h w"]) -> Shaped[np.ndarray, "*n h2 w2 4"]:
            x = x[..., :height, :width].reshape(*x.shape[:-2], height // 2, 2, width // 2, 2)
            return np.moveaxis(x, -3, -2).reshape(*x.shape[:-4], height // 2, width // 2, 4)

        inside = fours(self.mask)
        mask = inside.sum(-1) >= 2
        own = inside == mask[..., None]
        count = np.maximum(own.sum(-1), 1)
        radiance = np.empty((len(frames.names), *mask.shape, 3), np.float32)
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
        camera = resized(replace(camera, width=width, height=height), width // 2, height // 2)
        start = None if self.initial_maps is None else self.initial_maps.downsampled(mask)
        return Picture(fewer, mask, camera, start)

    def pixels(self, views: Int[np.ndarray, " n"], params: SurfaceParams) -> ObjectPixels:
        """The object's in some of the photographs."""
        return observe_object(self.frames, self.mask, self.camera, views, params)


def window(mask: Bool[np.ndarray, "h w"]) -> tuple[slice, slice]:
    """Rows and columns that hold the object, cut where blocks and halved pixels are cut."""
    v, u = np.nonzero(mask)
    spans = [(x.min() // BLOCK * BLOCK, x.max() + 1) for x in (v, u)]
    return slice(*map(int, spans[0])), slice(*map(int, spans[1]))


def downsample_to(picture: Picture, most: int) -> tuple[Picture, Int[np.ndarray, " p"]]:
    """The picture halved until at most so many pixels are the object's, and the pixel of it that stands for each of the
    whole one's."""
    take = np.arange(int(picture.mask.sum()))
    while picture.mask.sum() > most:
        half = picture.downsampled()
        take, picture = parent_index(half.mask, picture.mask)[take], half
    return picture, take


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The object as photographed, which views serve for what, and what was asked of the solve."""

    picture: Picture  # of all views, at full size
    coarse: tuple[Picture, ...]  # of `coarse_views`, at full size, half and a quarter
    poses: Poses
    coarse_views: Int[np.ndarray, " c"]
    fitted: Int[np.ndarray, " n"]
    validation: Int[np.ndarray, " k"]  # views that no phase fits
    params: SurfaceParams
    device: str
    seed: int

    @property
    def smallest(self) -> int:
        """The level of the smallest picture."""
        return len(self.coarse) - 1

    def at(self, level: int) -> Picture:
        """All photographs at a level: 0 is full size, each next half of it."""
        picture = self.picture
        for _ in range(level):
            picture = picture.downsampled()
        return picture

    def cam_from_world(self, views: Int[np.ndarray, " m"]) -> Float[np.ndarray, "m 3 4"]:
        """Poses of some views."""
        return self.poses.cam_from_world[views]


def build_scene(
    picture: Picture,
    poses: Poses,
    fitted: Int[np.ndarray, " f"],
    validation: tuple[int, ...],
    params: SurfaceParams,
    device: str,
    seed: int,
) -> Scene:
    """A scene whose coarse phases have `params.coarse_views` of the views that are fitted, the fine ones `params.views`."""
    views = fitted[evenly_spaced(len(fitted), params.coarse_views)]
    sizes = [picture.of_views(views)]
    while sizes[-1].mask.sum() > HALVED_FROM and len(sizes) < 3:
        sizes.append(sizes[-1].downsampled())
    fine = fitted[evenly_spaced(len(fitted), params.views or len(fitted))]
    return Scene(picture, tuple(sizes), poses, views, fine, np.array(validation, int), params, device, seed)
