"""Bake a room's light once: the outgoing radiance of every panel, path-traced, as one atlas.

The object is small and does not move the room's light noticeably, so all views share the lightmap.
Irradiance is sampled from just above each panel with parallel-projection cameras, averaged over blocks of
`BLOCK` x `BLOCK` texels, kept as half floats, and multiplied back onto the full-resolution albedo. Direct light is
blurred by a centimetre at most, so that shadows stay crisp; light that came by way of other panels is smooth and
takes fewer samples, blurred more.
World frame, metres, linear.

`python -m hardware.virtual.studio.bake parlour` makes the irradiance that ships with the program anew.
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

VERSION = 2  # raise when the baked values would change
BLOCK = 4
DIRECT_SAMPLES = 10  # per texel, so 160 per block
INDIRECT_SAMPLES = 2
DIRECT_BLUR, INDIRECT_BLUR = 0.7, 3.0  # standard deviation, blocks
# Texels a side of a parallel-projection picture; few sizes, since each is compiled once.
TILES = (32, 64, 128)
ATLAS_WIDTH = 3072
SHIPPED = Path(__file__).parent / "baked"
ALIKE = 1e-3  # metres or albedo: processors differ in the last digits of what is painted, not in more
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
    stored = _kept(path, room) or _kept(SHIPPED / f"{room.name}.npz", room)
    if stored is None:
        keep(path, room, _irradiance(room, device, progress))
        stored = _kept(path, room)
    assert stored is not None
    return pack(room.panels, [_outgoing(*both) for both in zip(stored, room.panels, strict=True)])


def keep(path: Path, room: Room, irradiance: list[np.ndarray]) -> None:
    """Write a room's irradiance, and what it is of."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.npz")
    flat = np.concatenate([part.reshape(-1, 3) for part in irradiance]).astype(np.float16)
    np.savez_compressed(partial, irradiance=flat, version=VERSION, room=_facts(room))
    partial.rename(path)


def _kept(path: Path, room: Room) -> list[np.ndarray] | None:
    """Irradiance of each panel's blocks; None where there is none, or of a room that is furnished otherwise."""
    if not path.exists():
        return None
    with np.load(path) as stored:
        facts = _facts(room)
        if stored["version"] != VERSION or stored["room"].shape != facts.shape:
            return None
        if not np.allclose(stored["room"], facts, rtol=0, atol=ALIKE):
            return None
        flat = stored["irradiance"].astype(np.float32)
    shapes = [_blocks(panel) for panel in room.panels]
    ends = np.cumsum([rows * columns for rows, columns in shapes])
    return [part.reshape(*shape, 3) for part, shape in zip(np.split(flat, ends[:-1]), shapes, strict=True)]


def _facts(room: Room) -> np.ndarray:
    """What decides a room's irradiance: its panels, how bright they are, and its lamps."""
    panels = [[*p.corner, *p.right, *p.down, *p.albedo.mean((0, 1)), *_blocks(p)] for p in room.panels]
    globes = [[*globe.centre, globe.radius_m, *globe.radiance] for globe in room.globes]
    sheets = [[*s.corner, *s.right, *s.down, *s.radiance.mean((0, 1))] for s in room.sheets]
    return np.concatenate([np.ravel(part) for part in (panels, globes, sheets)]).astype(np.float32)


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


def _irradiance(room: Room, device: str, progress: Progress) -> list[np.ndarray]:
    """Irradiance / pi of each block of each panel."""
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
        _block_means(d, panel, DIRECT_BLUR) + _block_means(i, panel, INDIRECT_BLUR)
        for d, i, panel in zip(direct, indirect, room.panels, strict=True)
    ]


def _blocks(panel: Panel) -> tuple[int, int]:
    """Rows and columns of blocks."""
    h, w = panel.albedo.shape[:2]
    return max(1, round(h / BLOCK)), max(1, round(w / BLOCK))


def _block_means(outgoing: np.ndarray, panel: Panel, blur: float) -> np.ndarray:
    """Irradiance / pi per block, from block averages of radiance over block averages of albedo."""
    (h, w), (rows, columns) = outgoing.shape[:2], _blocks(panel)
    block = np.minimum(np.arange(h) * rows // h, rows - 1)[:, None] * columns
    block = (block + np.minimum(np.arange(w) * columns // w, columns - 1)[None]).reshape(-1)

    def mean(values: np.ndarray) -> np.ndarray:
        sums = [np.bincount(block, values[..., k].reshape(-1), rows * columns) for k in range(3)]
        return np.stack(sums, -1).reshape(rows, columns, 3)

    coarse = mean(outgoing) / mean(panel.albedo)
    if blur > 0:
        coarse = ndimage.gaussian_filter(coarse, (blur, blur, 0), mode="nearest", truncate=2.5)
    return coarse


def _outgoing(irradiance: np.ndarray, panel: Panel) -> np.ndarray:
    """Radiance leaving each texel: the blocks' irradiance, interpolated, on the albedo."""

    def along(count: int, blocks: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at = np.clip((np.arange(count) + 0.5) * blocks / count - 0.5, 0, blocks - 1)
        low = at.astype(int)
        return low, np.minimum(low + 1, blocks - 1), (at - low).astype(np.float32)

    (h, w), (rows, columns) = panel.albedo.shape[:2], irradiance.shape[:2]
    top, bottom, y = along(h, rows)
    left, right, x = along(w, columns)
    lines = irradiance[top] * (1 - y)[:, None, None] + irradiance[bottom] * y[:, None, None]
    return (lines[:, left] * (1 - x)[:, None] + lines[:, right] * x[:, None]) * panel.albedo


def main(name: str) -> None:
    """Bake a room anew into what ships."""
    from hardware.virtual.studio import rooms

    room = rooms.furnish(name)
    keep(SHIPPED / f"{name}.npz", room, _irradiance(room, "auto", lambda share, note: None))


if __name__ == "__main__":
    import sys

    main(sys.argv[1])
