"""Bake a room's light once: the outgoing radiance of every panel, path-traced, as one atlas.

The object is small and does not move the room's light noticeably, so all views share the lightmap.
Irradiance is sampled from just above each panel with parallel-projection cameras, averaged over blocks of
`BLOCK` x `BLOCK` texels, and multiplied back onto the full-resolution albedo. Direct light is
blurred by a centimetre at most, so that shadows stay crisp; light that came by way of other panels is smooth and
takes fewer samples, blurred more.
World frame, metres, linear.
"""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from hardware.virtual.studio import tracer
from hardware.virtual.studio.rooms import Panel, Room

VERSION = 1  # raise when the baked values would change
BLOCK = 4
DIRECT_SAMPLES = 10  # per texel, so 160 per block
INDIRECT_SAMPLES = 2
DIRECT_BLUR, INDIRECT_BLUR = 0.7, 3.0  # standard deviation, blocks
# Texels a side of a parallel-projection picture; few sizes, since each is compiled once.
TILES = (32, 64, 128)
ATLAS_WIDTH = 3072
GUTTER = 2  # texels repeated around each panel, so that interpolation never reaches a neighbour

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """One picture for all panels; `low` and `high` are the texture coordinates of each panel's corners."""

    picture: Float[np.ndarray, "h w 3"]
    low: Float[np.ndarray, "p 2"]  # (u, v) of the corner, v downwards
    high: Float[np.ndarray, "p 2"]


def bake(room: Room, cache: Path, device: str, progress: Progress) -> Atlas:
    """The room's outgoing radiance; read from `cache` when it was baked before.

    Raises:
        StudioError: the device is not there.
    """
    path = cache / f"{room.name}-{digest(room)}.npz"
    if not path.exists():
        radiance = _outgoing(room, device, progress)
        cache.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.npz")
        np.savez(partial, picture=pack(room.panels, radiance).picture.astype(np.float16))
        partial.rename(path)
    low, high, _ = _layout(room.panels)
    with np.load(path) as stored:
        return Atlas(stored["picture"].astype(np.float32), low, high)


def digest(room: Room) -> str:
    """Names the room's content: geometry, paint, lamps and the way it is baked."""
    method = (VERSION, BLOCK, DIRECT_SAMPLES, INDIRECT_SAMPLES, DIRECT_BLUR, INDIRECT_BLUR, TILES, ATLAS_WIDTH,
              GUTTER)  # fmt: skip
    sha = hashlib.sha256(repr(method).encode())
    for panel in room.panels:
        for part in (panel.corner, panel.right, panel.down, panel.albedo):
            sha.update(np.ascontiguousarray(part, np.float32).tobytes())
    for globe in room.globes:
        sha.update(np.array([*globe.centre, globe.radius_m, *globe.radiance], np.float32).tobytes())
    for sheet in room.sheets:
        for part in (sheet.corner, sheet.right, sheet.down, sheet.radiance):
            sha.update(np.ascontiguousarray(part, np.float32).tobytes())
    return sha.hexdigest()[:16]


def pack(panels: tuple[Panel, ...], pictures: list[np.ndarray]) -> Atlas:
    """Lay one picture per panel into an atlas, rims repeated into the gutters."""
    low, high, corners = _layout(panels)
    height = max(y + p.shape[0] + GUTTER for (y, _), p in zip(corners, pictures, strict=True))
    atlas = np.zeros((height, ATLAS_WIDTH, 3), np.float32)
    for (y, x), picture in zip(corners, pictures, strict=True):
        h, w = picture.shape[:2]
        padded = np.pad(picture, ((GUTTER, GUTTER), (GUTTER, GUTTER), (0, 0)), mode="edge")
        atlas[y - GUTTER : y + h + GUTTER, x - GUTTER : x + w + GUTTER] = padded
    return Atlas(atlas, low, high)


def _layout(panels: tuple[Panel, ...]) -> tuple[np.ndarray, np.ndarray, list[tuple[int, int]]]:
    """Shelf packing, tallest first; texture coordinates and first texel (row, column) of every panel."""
    corners: list[tuple[int, int]] = [(0, 0)] * len(panels)
    y, x, shelf = 0, 0, 0
    for index in sorted(range(len(panels)), key=lambda i: -panels[i].albedo.shape[0]):
        h, w = (s + 2 * GUTTER for s in panels[index].albedo.shape[:2])
        if x + w > ATLAS_WIDTH:
            y, x, shelf = y + shelf, 0, 0
        shelf = max(shelf, h)
        corners[index] = (y + GUTTER, x + GUTTER)
        x += w
    height = y + shelf
    low = np.array([(x / ATLAS_WIDTH, y / height) for y, x in corners])
    size = np.array([(p.albedo.shape[1] / ATLAS_WIDTH, p.albedo.shape[0] / height) for p in panels])
    return low, low + size, corners


def _outgoing(room: Room, device: str, progress: Progress) -> list[np.ndarray]:
    """Radiance leaving each texel of each panel."""
    trace = tracer.RoomTracer(room, pack(room.panels, [p.albedo for p in room.panels]), device)
    tiles = []
    for index, panel in enumerate(room.panels):
        h, w = panel.albedo.shape[:2]
        # 400: a picture's own cost
        tile = min(TILES, key=lambda t: (-(-h // t)) * (-(-w // t)) * (t * t + 400))
        tiles += [(index, tile, row, column) for row in range(0, h, tile) for column in range(0, w, tile)]
    direct = [np.zeros_like(panel.albedo) for panel in room.panels]
    indirect = [np.zeros_like(panel.albedo) for panel in room.panels]
    area = np.cumsum([tile * tile for _, tile, _, _ in tiles])
    for done, (index, tile, row, column) in enumerate(tiles):
        if done % 16 == 0:
            progress(float(area[done] / area[-1]), f"baking the light of room {room.name}")
        panel = room.panels[index]
        h, w = panel.albedo.shape[:2]
        part = (row / h, column / w, tile / h, tile / w)
        here = (index, slice(row, row + tile), slice(column, column + tile))
        straight = trace.above(panel, *part, tile, DIRECT_SAMPLES, seed=done, bounced=False)
        # The same seed takes the same first steps, so the difference is what bounced and nothing else.
        once = trace.above(panel, *part, tile, INDIRECT_SAMPLES, seed=done, bounced=False)
        every = trace.above(panel, *part, tile, INDIRECT_SAMPLES, seed=done, bounced=True)
        direct[index][here[1:]] = straight[: h - row, : w - column]
        indirect[index][here[1:]] = (every - once)[: h - row, : w - column]
    return [
        (_irradiance(d, panel.albedo, DIRECT_BLUR) + _irradiance(i, panel.albedo, INDIRECT_BLUR))
        * panel.albedo
        for d, i, panel in zip(direct, indirect, room.panels, strict=True)
    ]


def _irradiance(outgoing: np.ndarray, albedo: np.ndarray, blur: float) -> np.ndarray:
    """Irradiance / pi per texel, from block averages of radiance over block averages of albedo."""
    h, w = albedo.shape[:2]
    rows, columns = max(1, round(h / BLOCK)), max(1, round(w / BLOCK))
    block = np.minimum(np.arange(h) * rows // h, rows - 1)[:, None] * columns
    block = (block + np.minimum(np.arange(w) * columns // w, columns - 1)[None]).reshape(-1)

    def mean(values: np.ndarray) -> np.ndarray:
        sums = [np.bincount(block, values[..., k].reshape(-1), rows * columns) for k in range(3)]
        return np.stack(sums, -1).reshape(rows, columns, 3)

    coarse = mean(outgoing) / mean(albedo)
    if blur > 0:
        coarse = ndimage.gaussian_filter(coarse, (blur, blur, 0), mode="nearest", truncate=2.5)
    y = (np.arange(h) + 0.5) * rows / h - 0.5
    x = (np.arange(w) + 0.5) * columns / w - 0.5
    grid = np.meshgrid(y, x, indexing="ij")
    fine = [ndimage.map_coordinates(coarse[..., k], grid, order=1, mode="nearest") for k in range(3)]
    return np.stack(fine, -1).astype(np.float32)
