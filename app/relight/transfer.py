"""Prepare a finished surface for relighting in real time; runs in a worker child.

What light from every direction does to every pixel (the project's BRDF, cosine, what the object hides of the room) is
a matrix of pixels x directions. Blocks of 16 x 16 pixels share most of it: each block keeps a few rows (its leading
singular vectors, diffuse and specular apart) and what every pixel makes of them, so that a new light costs a few
milliseconds. After P.-P. Sloan, J. Hall, J. Hart, J. Snyder, "Clustered principal components for precomputed
radiance transfer" (2003). What hides the room throws light itself: tiles of the object
stand beside the directions as further columns.
Camera frame; lengths in scene units. `app/relight/relit.py` reads what is written here.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from app.inspect.rerendering import find, open_run, upright
from app.inspect.runs import Run
from app.relight import files as relighting_files
from app.relight.files import keep
from app.relight.relit import CELLS, TILE_UNIT
from app.relight.sources import recovered
from engine.geometry import fibonacci_sphere, rays, resized
from engine.io.session import told
from engine.light.incident.direction_grid import interpolated_cells
from engine.surface.reflectance.brdf import lobe_floor, of_pixels, rows
from engine.surface.rendering.transport import BLOCK, pixel_blocks
from engine.surface.visibility.ray_visibility import SparseVisibility, trace_occlusion
from engine.types import Camera, Surface

if TYPE_CHECKING:
    from app.work.worker import Link
    from engine.progress import Progress

SIDE_PX = 320  # of the object's longer side in the preview
LOST = 0.03  # share of a block's response (root mean square over directions) that compressing may lose; it is
# mostly single directions at the edges of shadows, so that pictures under real light differ far less
FIRST_RANK = 32  # rows of a block that are looked for first
MOST_ROWS = 48  # of a block: where every pixel has a shadow of its own, more would not fit a frame's time
TRIM = 0.8  # of what may be lost, what probing may lose; the rest is for leaving out rows
TILE = 16  # pixels along a side of what throws bounced light as one
CUBE = 96  # pixels along an edge of the cube map that finds a direction's cells


@dataclass(frozen=True, slots=True, eq=False)
class Small:
    """The surface at the preview's size."""

    camera: Camera
    mask: Bool[np.ndarray, "h w"]
    normal: Float[np.ndarray, "h w 3"]
    albedo: Float[np.ndarray, "h w 3"]
    roughness: Float[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    box: tuple[int, int, int, int]  # left, top, right, bottom of what is shown, pixels
    material: Float[np.ndarray, "h w 2"] | None = None  # as the surface has it


def serve(request: Mapping[str, Any], link: "Link") -> Mapping[str, Any]:
    """Task "relight": {session, fingerprint, view or None}; gives {view}."""
    run = find(Path(request["session"]), request["fingerprint"])
    return {"view": prepare(run, request.get("view"), link.progress())}


def prepare(run: Run, view: int | None, progress: "Progress") -> int:
    """Keep what the surface answers and the light of a view, one in the middle for None, where they are not there yet; which view it is."""
    folder = relighting_files.folder(run)
    progress.step(0.0, "reading the result")
    solved = upright(open_run(run))
    if view is None or not solved.poses.registered[int(view)]:
        from engine.pipeline.stage_functions import middle_view

        view = middle_view(solved.poses)
    with told(folder):
        folder.mkdir(parents=True, exist_ok=True)
    small = shrunk(solved.surface, solved.poses.camera)
    transfer, light = relighting_files.transfer_file(run), relighting_files.light_file(run, int(view))
    if not transfer.is_file():
        made = build(small, solved.params.diffuse == "disney", progress.part(0.05, 0.8))
        keep(transfer, made)
    if not light.is_file():
        progress.step(0.8, "the light at the object")
        keep(light, recovered(solved, int(view), np.array(relighting_files.middle_of(transfer))))
    progress.step(1.0)
    return int(view)


def prepare_full(run: Run, progress: "Progress") -> None:
    """Keep what the surface answers at the photographs' own size."""
    solved = upright(open_run(run))
    whole = shrunk(solved.surface, solved.poses.camera, max(solved.surface.mask.shape))
    keep(
        relighting_files.transfer_file(run, full=True),
        build(whole, solved.params.diffuse == "disney", progress),
    )


def shrunk(surface: Surface, camera: Camera, side: int = SIDE_PX) -> Small:
    """The surface averaged down by a whole factor, so that the object's longer side has at most `side` pixels."""
    rows_, columns = (np.nonzero(surface.mask.any(axis))[0] for axis in (1, 0))
    longest = max(np.ptp(rows_), np.ptp(columns)) + 1
    by = max(1, -(-int(longest) // side))
    height, width = surface.mask.shape[0] // by * by, surface.mask.shape[1] // by * by

    def cells(values: np.ndarray) -> np.ndarray:
        cut = values[:height, :width].astype(np.float64)
        return cut.reshape(height // by, by, width // by, by, *values.shape[2:]).swapaxes(1, 2)

    inside = cells(surface.mask)
    count = inside.sum((2, 3))
    mask = count >= 0.5 * by * by

    def mean(values: np.ndarray) -> np.ndarray:
        weight = inside.reshape(*inside.shape, *([1] * (values.ndim - 2)))
        total = (cells(values) * weight).sum((2, 3))
        share = np.maximum(count, 1).reshape(*count.shape, *([1] * (values.ndim - 2)))
        return np.where(mask.reshape(share.shape[:2] + (1,) * (values.ndim - 2)), total / share, 0)

    normal = mean(surface.normal)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    even = Camera(
        width, height, camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2
    )
    lens = resized(even, width // by, height // by)
    pad = 0.12 * longest / by
    box = (
        max(int(columns[0] / by - pad), 0), max(int(rows_[0] / by - pad), 0),
        min(int(columns[-1] / by + pad) + 2, width // by), min(int(rows_[-1] / by + pad) + 2, height // by),
    )  # fmt: skip
    made = None if surface.material is None else mean(surface.material)
    albedo, roughness, depth = (mean(values) for values in (surface.albedo, surface.roughness, surface.depth))
    return Small(lens, mask, normal, albedo, roughness, depth, box, made)


def build(small: Small, full_diffuse: bool, progress: "Progress") -> dict[str, np.ndarray]:
    """The arrays of a `relighting.Transfer`."""
    mask, q = small.mask, rays(small.camera)
    points = q / q[..., 2:] * small.depth[..., None]
    directions = fibonacci_sphere(CELLS)
    hidden = trace_occlusion(points, small.normal, mask, directions, progress.part(0, 0.5))
    normals, rough = small.normal[mask], small.roughness[mask]
    made = of_pixels(small.material, mask)
    towards = -q[mask]
    tile, tiles = _tiles(mask)
    parts = pixel_blocks(mask)
    floor = lobe_floor(CELLS)
    random = np.random.default_rng(0).standard_normal((CELLS + tiles, BLOCK**2), np.float32)
    pixels, ranks, basis, weights, middles = [], [], [], [], []
    light = small.albedo[mask].mean(1)
    for i, block in enumerate(parts):
        progress.step(0.5 + 0.5 * i / len(parts), "what light does to each pixel")
        diffuse, specular = rows(
            normals[block],
            rough[block],
            towards[block],
            directions,
            full_diffuse,
            floor,
            of_pixels(made, block),
        )
        answers = _with_tiles(hidden, block, (diffuse, specular), tile, tiles)
        matters = float(np.linalg.norm(diffuse * light[block, None]))
        for table, least in zip(answers, (0.0, matters), strict=True):
            share, lead = leading(table, random, least)
            weights.append(share.ravel())
            basis.append(lead)
            ranks.append(len(lead))
        pixels.append(block)
        middles.append(points[mask][block].mean(0))
    inside = points[mask]
    cube = interpolated_cells(directions, CUBE)
    left, top, right, bottom = small.box
    return {
        "mask": mask,
        "box": np.array(small.box),
        "albedo": small.albedo[mask].astype(np.float32),
        "pixels": np.concatenate(pixels).astype(np.int32),
        "sizes": np.array([len(block) for block in pixels], np.int32),
        "ranks": np.array(ranks, np.int32),
        "basis": np.concatenate(basis).astype(np.float16),
        "weights": np.concatenate(weights).astype(np.float16),
        "middles": np.array(middles, np.float32),
        "middle": np.median(inside, axis=0),
        "cube_index": cube.index.astype(np.int16),
        "cube_share": cube.share.astype(np.float16),
        "tile": tile.astype(np.int32),
        "rays": q[top:bottom, left:right].astype(np.float32),
    }


def leading(
    table: Float[np.ndarray, "p d"], chances: Float[np.ndarray, "d q"], least: float = 0.0, lost: float = LOST
) -> tuple[Float[np.ndarray, "p k"], Float[np.ndarray, "k d"]]:
    """(weights, rows) with weights @ rows = table but for a share `lost` of its norm, or of `least` if that is more.

    Rows are found by probing with random vectors, twice as many until enough is caught (N. Halko, P.-G. Martinsson,
    J. Tropp, "Finding structure with randomness" (2011), Algorithm 4.2); a full decomposition took ten times as long.
    """
    total = float((table.astype(np.float64) ** 2).sum())
    allowed = lost**2 * max(total, least**2)
    size = min(FIRST_RANK, len(table))
    while True:
        if size < len(table):
            around, _ = np.linalg.qr(table @ chances[:, :size])
            caught = around.T @ table
        else:
            around, caught = np.eye(len(table), dtype=np.float32), table
        left = total - float((caught.astype(np.float64) ** 2).sum())
        if left <= TRIM**2 * allowed or size >= min(MOST_ROWS + FIRST_RANK // 2, len(table)):
            break
        size = min(2 * size, len(table))
    value, vector = np.linalg.eigh(caught.astype(np.float64) @ caught.T.astype(np.float64))
    value, vector = np.maximum(value[::-1], 0), vector[:, ::-1].astype(np.float32)
    beyond = left + value.sum() - np.cumsum(value)
    count = int(np.searchsorted(-beyond, -allowed)) + 1
    vector = vector[:, : min(max(count, 1), len(value), MOST_ROWS)]
    return around @ vector, vector.T @ caught


def _tiles(mask: Bool[np.ndarray, "h w"]) -> tuple[Int[np.ndarray, " p"], int]:
    """Each pixel's tile, numbered without gaps, and how many there are."""
    v, u = np.nonzero(mask)
    _, tile = np.unique(v // TILE * mask.shape[1] + u // TILE, return_inverse=True)
    return tile, int(tile.max()) + 1


def _with_tiles(
    hidden: SparseVisibility,
    block: Int[np.ndarray, " b"],
    answers: tuple[Float[np.ndarray, "b d"], Float[np.ndarray, "b d"]],
    tile: Int[np.ndarray, " p"],
    tiles: int,
) -> list[Float[np.ndarray, "b d2"]]:
    """Take hidden directions out of the block's rows (in place), and add a column for every tile of the object.

    What hides the room throws light itself: a tile's column is the response to its radiance, in units of
    `relighting.TILE_UNIT`, so that both kinds of columns weigh about the same when they are compressed together.
    """
    of_block = hidden.part(block)
    direction, source = of_block.direction, of_block.occluder
    owner = np.repeat(np.arange(len(block)), np.diff(of_block.start))
    seen = source >= 0
    place = owner[seen].astype(np.int64) * tiles + tile[source[seen]]
    made = []
    for answer in answers:
        lost = answer[owner, direction] * np.float32(4 * np.pi / CELLS / TILE_UNIT)
        answer[owner, direction] = 0
        thrown = np.bincount(place, lost[seen], len(block) * tiles).reshape(len(block), tiles)
        made.append(np.concatenate([answer, thrown.astype(np.float32)], 1))
    return made
