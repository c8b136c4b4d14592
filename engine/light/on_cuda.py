"""Tiles on a CUDA device: what travels there and back, and in which batches.

Projection and the tiles' lists stay on the CPU (`tiles.py`), where they are a few hundredths of a view's work;
their sort and compaction would be a second set of kernels. So they bound what a device can gain, and each
view carries some 150 bytes a visible Gaussian, 12 an entry of the lists and 40 a pixel there and back.
The probes of `probes.py` do not come here: a fifth of one is projection, the rest many small pictures.

A launch takes as many tiles as `rows` entries of their lists allow, so device memory stays bounded: a row is
64 rays of 12 bytes forward and 20 backward. The batches do not change any result.
"""

# What numba shows of itself takes every dtype for float64 and hides its settings.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Int
from numba import config

from engine.errors import LightError
from engine.light import kernels_cuda as kernel
from engine.light.kernels_cpu import GRADIENTS
from engine.light.kernels_cuda import AREA, cuda
from engine.light.rasterise import Run, Threads

ROWS = 200_000  # 256 MB going back


def available() -> bool:
    """Whether numba finds a CUDA device, its driver and its compiler."""
    return cuda is not None and cuda.is_available()


def _batches(tile_start: Int[np.ndarray, " t"], rows: int) -> Iterator[tuple[int, int]]:
    """First tile and number of tiles whose lists together hold at most `rows` entries, or of one tile."""
    first, tiles = 0, len(tile_start) - 1
    while first < tiles:
        end = int(np.searchsorted(tile_start, tile_start[first] + rows, side="right")) - 1
        end = max(end, first + 1)
        yield first, end - first
        first = end


class OnCuda(Run):
    """Tiles on the current CUDA device, all else on the CPU's threads."""

    def __init__(self, threads: Threads, rows: int = ROWS) -> None:
        """Raises: LightError where numba has no device."""
        if not available():
            raise LightError(
                "numba finds no CUDA device here; use device cpu, or install the NVIDIA driver and"
                " `pip install numba-cuda[cu13]` (cu12 with a driver of that age)"
            )
        config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # the first pictures of a fit are small, and meant to be
        self._threads, self._rows = threads, rows
        self._scratch: list = []
        self._held = 0  # rows of `_scratch`

    def __call__(self, kernel: Callable, args: tuple) -> None:
        """See `Run`."""
        self._threads(kernel, args)

    def _tiled(self, packed, lists, lens, near) -> tuple:
        tile_start, members, _, _ = lists
        return *(cuda.to_device(a) for a in (packed, tile_start, members, lens)), np.float32(near)

    def _columns(self, batches: list[tuple[int, int]], tile_start: np.ndarray, count: int) -> list:
        """At least `count` scratch arrays with rows for the largest batch; the third holds whole numbers."""
        rows = max(int(tile_start[first + tiles] - tile_start[first]) for first, tiles in batches)
        if rows > self._held:
            self._scratch, self._held = [], rows  # freed before the larger ones are asked for
        for at in range(len(self._scratch), count):
            kind = np.int32 if at == 2 else np.float32
            self._scratch.append(cuda.device_array((self._held, AREA), kind))
        return self._scratch

    def forward(self, packed, lists, lens, near, image) -> None:
        """See `Run`."""
        tile_start = lists[0]
        if not tile_start[-1]:
            return self._threads.forward(packed, lists, lens, near, image)
        batches = list(_batches(tile_start, self._rows))
        scratch = self._columns(batches, tile_start, 3)
        tiled, there = self._tiled(packed, lists, lens, near), cuda.device_array_like(image)
        for first, tiles in batches:
            kernel.forward[tiles, AREA](*tiled, first, *scratch[:3], there)
        there.copy_to_host(image)

    def backward(self, packed, lists, lens, near, image, loss, totals) -> None:
        """See `Run`."""
        tile_start, members, own_start, slots = lists
        if not tile_start[-1]:
            return self._threads.backward(packed, lists, lens, near, image, loss, totals)
        batches = list(_batches(tile_start, self._rows))
        scratch = self._columns(batches, tile_start, 5)
        tiled, there = self._tiled(packed, lists, lens, near), cuda.device_array_like(image)
        target, weights, floor_only, knee, hollow, surface = loss
        target, weights, surface = (
            cuda.to_device(np.ascontiguousarray(a, np.float32)) for a in (target, weights, surface)
        )
        floor_only = cuda.to_device(np.ascontiguousarray(floor_only))
        judged = (target, weights, floor_only, np.float32(knee), np.float32(hollow), surface)
        grads = cuda.device_array((len(members), GRADIENTS), np.float32)
        for first, tiles in batches:
            kernel.backward[tiles, AREA](*tiled, first, *scratch[:3], there, *judged, *scratch[3:], grads)
        sums = cuda.device_array(totals.shape, np.float32)
        blocks = -(-totals.size // AREA)
        kernel.collect[blocks, AREA](grads, cuda.to_device(own_start), cuda.to_device(slots), sums)
        there.copy_to_host(image)
        sums.copy_to_host(totals)
