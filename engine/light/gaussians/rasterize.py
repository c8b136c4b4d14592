"""Render a view of the Gaussians and its gradients on all threads: the kernels' front door.

World frame; a view is `cam_from_world` with a pinhole (no lens distortion: resample the photographs).
Channels of a rendering: radiance (3), transmittance left over, sum of weight * z.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from engine.light.gaussians import rasterize_kernels, tiles
from engine.light.gaussians.gaussians import radiance_towards, rotations
from engine.types import Gaussians


@dataclass(frozen=True, slots=True, eq=False)
class Pinhole:
    """A view without lens distortion; focal lengths and principal point in pixels."""

    cam_from_world: Float[np.ndarray, "3 4"]
    lens: Float[np.ndarray, " 4"]  # fx fy cx cy
    width: int
    height: int

    @property
    def origin(self) -> Float[np.ndarray, " 3"]:
        """Centre of projection, world frame."""
        return -self.cam_from_world[:, :3].T @ self.cam_from_world[:, 3]


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """What the kernels need of the Gaussians whatever the view: factors of Sigma and its inverse."""

    white: Float[np.ndarray, "k 3 3"]  # W = S^-1 R^T
    spread: Float[np.ndarray, "k 3 3"]  # S R^T
    means: Float[np.ndarray, "k 3"]
    density: Float[np.ndarray, " k"]


@dataclass(frozen=True, slots=True, eq=False)
class Gradients:
    """d loss / d parameters of the Gaussians a view can see; `turn` is about the Gaussian's own axes."""

    index: Int[np.ndarray, " v"]
    means: Float[np.ndarray, "v 3"]
    turn: Float[np.ndarray, "v 3"]  # R <- R exp([turn]x)
    log_scales: Float[np.ndarray, "v 3"]
    density: Float[np.ndarray, " v"]
    colours: Float[np.ndarray, "v 3"]
    weight: Float[np.ndarray, " v"]  # sum of compositing weights over the pixels
    blame: Float[np.ndarray, " v"]  # the same, each times its pixel's loss


Lists = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # what `tiles.lists` returns
Loss = tuple[np.ndarray, np.ndarray, float, float, np.ndarray]  # of `rasterize_kernels.backward`


@dataclass(frozen=True, slots=True, eq=False)
class ThreadPool:
    """Where the work is done: a pool of threads, among which every kernel is divided into `parts`."""

    pool: ThreadPoolExecutor
    parts: int

    def __call__(self, kernel: Callable, args: tuple) -> None:
        """Do `kernel(*args, part, parts)` for every part; the split does not change any result."""
        for job in [self.pool.submit(kernel, *args, part, self.parts) for part in range(self.parts)]:
            job.result()

    def forward(
        self, packed: Float[np.ndarray, "v 20"], lists: Lists, lens: Float[np.ndarray, " 4"], near: float,
        image: Float[np.ndarray, "h w 5"],
    ) -> None:  # fmt: skip
        """Render into `image`."""
        tile_start, members, _, _ = lists
        self(rasterize_kernels.forward, (packed, tile_start, members, lens, np.float32(near), image))

    def backward(
        self, packed: Float[np.ndarray, "v 20"], lists: Lists, lens: Float[np.ndarray, " 4"], near: float,
        image: Float[np.ndarray, "h w 5"], loss: Loss, totals: Float[np.ndarray, "v 18"],
    ) -> None:  # fmt: skip
        """Render into `image` and sum every Gaussian's gradients into `totals`."""
        tile_start, members, own_start, slots = lists
        grads = np.empty((len(members), rasterize_kernels.GRADIENTS), np.float32)
        tiled = (packed, tile_start, members, lens, np.float32(near), image)
        self(rasterize_kernels.backward, (*tiled, *loss, grads))
        self(rasterize_kernels.collect, (grads, own_start, slots, totals))


@contextmanager
def thread_pool(threads: int | None = None) -> Iterator[ThreadPool]:
    """The processor's threads; as many as it has if none are asked for."""
    count = threads or len(os.sched_getaffinity(0))
    with ThreadPoolExecutor(count) as pool:
        yield ThreadPool(pool, 8 * count)


def shapes(gaussians: Gaussians) -> Shapes:
    """The Gaussians' geometry as the kernels take it."""
    axes = np.swapaxes(rotations(np.asarray(gaussians.quaternions, np.float64)), 1, 2)
    return Shapes(
        np.ascontiguousarray(axes / gaussians.scales[:, :, None], dtype=np.float64),
        np.ascontiguousarray(axes * gaussians.scales[:, :, None], dtype=np.float64),
        np.ascontiguousarray(gaussians.means, dtype=np.float64),
        np.ascontiguousarray(gaussians.density, dtype=np.float64),
    )


def project(geometry: Shapes, colours: Float[np.ndarray, "k 3"], view: Pinhole) -> tuple:
    """What `tiles.project` and `tiles.lists` say of one view: indices, packed rows, and the lists of its tiles."""
    # Arrays in another order would have the kernel compiled a second time, for nine seconds.
    white, spread, rotation = map(
        np.ascontiguousarray, (geometry.white, geometry.spread, view.cam_from_world[:, :3])
    )
    index, packed, boxes = tiles.project(
        white, spread, geometry.means, geometry.density, np.ascontiguousarray(colours, dtype=np.float64),
        rotation, view.origin, view.lens, view.width, view.height,
    )  # fmt: skip
    across, down = -(-view.width // tiles.TILE), -(-view.height // tiles.TILE)
    return index, packed, tiles.lists(boxes, across, down)


def render(
    geometry: Shapes, colours: Float[np.ndarray, "k 3"], view: Pinhole, near: float, run: ThreadPool
) -> Float[np.ndarray, "h w 5"]:
    """One view; Gaussians that answer nearer than z = `near` do not count."""
    _, packed, lists = project(geometry, colours, view)
    image = np.zeros((view.height, view.width, rasterize_kernels.CHANNELS), np.float32)
    run.forward(packed, lists, view.lens, near, image)
    return image


def render_view(gaussians: Gaussians, view: Pinhole, near: float = 0.0) -> Float[np.ndarray, "h w 5"]:
    """`render` for a caller that wants one picture."""
    with thread_pool() as run:
        return render(shapes(gaussians), radiance_towards(gaussians, view.origin), view, near, run)


def backward(
    geometry: Shapes,
    colours: Float[np.ndarray, "k 3"],
    view: Pinhole,
    near: float,
    target: Float[np.ndarray, "h w 3"],
    weights: Float[np.ndarray, "h w"],
    knee: float,
    hollow: float,
    surface: Float[np.ndarray, "h w"],
    run: ThreadPool,
) -> tuple[Float[np.ndarray, "h w 5"], Gradients]:
    """Render one view and differentiate the loss of `rasterize_kernels.backward` by every parameter."""
    index, packed, lists = project(geometry, colours, view)
    image = np.zeros((view.height, view.width, rasterize_kernels.CHANNELS), np.float32)
    totals = np.empty((len(index), rasterize_kernels.GRADIENTS), np.float32)
    loss = (target, weights, knee, hollow, surface)
    run.backward(packed, lists, view.lens, near, image, loss, totals)
    return image, _chain(geometry, view, index, totals.astype(np.float64))


def _chain(
    geometry: Shapes, view: Pinhole, index: Int[np.ndarray, " v"], totals: Float[np.ndarray, "v 18"]
) -> Gradients:
    """From M = W R_wc and m = W (mu - origin) back to mean, rotation and scale."""
    white, spread = geometry.white[index], geometry.spread[index]
    d_camera, d_m = totals[:, :9].reshape(-1, 3, 3), totals[:, 9:12]
    offset = geometry.means[index] - view.origin
    d_white = d_camera @ view.cam_from_world[:, :3] + d_m[:, :, None] * offset[:, None, :]
    # W = S^-1 R^T: with R <- R exp([w]x), d W = -S^-1 [w]x S W, hence the antisymmetric part below.
    mixed = d_white @ np.swapaxes(spread, 1, 2)  # d_white R S
    scales2 = (spread * spread).sum(-1)
    twist = mixed / scales2[:, :, None] ** 0.5  # S^-1 d_white R S
    twist = twist / scales2[:, None, :] ** 0.5  # S^-1 d_white R
    turn = np.stack(
        [twist[:, 1, 2] - twist[:, 2, 1], twist[:, 2, 0] - twist[:, 0, 2], twist[:, 0, 1] - twist[:, 1, 0]],
        axis=1,
    )
    return Gradients(
        index=index,
        means=np.einsum("vij,vi->vj", white, d_m),
        turn=turn,
        log_scales=-(d_white * white).sum(-1),
        density=totals[:, 12],
        colours=totals[:, 13:16],
        weight=totals[:, 16],
        blame=totals[:, 17],
    )
