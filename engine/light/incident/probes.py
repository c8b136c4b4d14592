"""Light arriving at points: energy per direction cell around probes, and panoramas.

A probe renders the six faces of a cube with the tile kernel and sums radiance x solid angle into the
caller's direction cells, so energy is conserved whatever the cells are. Tiles that hold bright Gaussians
are rendered 2 or 4 times finer, else a lamp of two degrees would fall between the rays. Directions
that no photograph showed are marked by `seen` and can be filled smoothly.

Frames: Gaussians in the world frame; probes and directions in the camera frame of their view.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from engine.color import luminance
from engine.errors import LightError
from engine.light.gaussians import rasterize_kernels as kernel
from engine.light.gaussians import tiles
from engine.light.gaussians.gaussians import radiance_towards
from engine.light.gaussians.rasterize import Pinhole, Shapes, render, shapes, thread_pool
from engine.light.incident.direction_grid import (
    FACES,
    CellMap,
    interpolated_cells,
    own_cells,
    pixel_solid_angles,
)
from engine.light.incident.inpainting import inpaint_energy, neighbourhood
from engine.progress import Progress
from engine.types import Gaussians

FINEST = 4
# A tile is refined once its brightest Gaussian exceeds this many times the mean radiance (at 64 pixels a
# face). What matt pixels send from a study with a window, at 48 pixels: 1.1 % off in one view at 150, 0.5 % at 50 for 1.3
# times the time, and no better at 15 for twice the time; the edge of the window falls between the rays.
_CONTRAST = 50.0

BATCH = 8
"""Views, or groups of places, at a time, so that progress and stops get through."""
CLOSE = 12
"""Places that share what Gaussians look like along the axes of a cube."""

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract", "nsz"}}


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _brightest(packed, members, begin, end):
    """The greatest luminance in a tile's list."""
    bright = np.float32(0)
    for slot in range(begin, end):
        row = packed[members[slot]]
        bright = max(bright, (0.2126 * row[13] + 0.7152 * row[14] + 0.0722 * row[15]) * min(row[12], 1.0))
    return bright


@njit(forceinline=True, **_FLAGS)
@no_type_check
def _finesse(bright, mean, side):
    """How many times finer than its pixels a tile is to be sampled that holds something so bright: 1, 2 or 4."""
    contrast = bright / max(mean, 1e-30) * (64.0 / side) ** 1.5 / _CONTRAST
    return 4 if contrast > 2.83 else (2 if contrast > 1.0 else 1)


@njit(**_FLAGS)
@no_type_check
def _probe(
    white, means, density, colours, maps, spans, faces, first, among, origin, near, side, mean,
    index1, share1, index2, share2, index4, share4, omega1, omega2, omega4, energy, opacity, shine,
):  # fmt: skip
    """Add one probe's light to `energy` [d 3], `opacity` [d] (x solid angle), `shine` [d 3] (luminance x solid angle x where
    it comes from, seen from the probe). Face f may see the Gaussians `among`[`first`[f] : `first`[f + 1]], of which `maps` and
    `spans` tell what `tiles.turned` says. Tiles are refined where a `mean` radiance is given; returns the brightest seen.
    """
    brightest = np.float32(0)
    half = side / 2.0
    lens = np.array([half, half, half, half])
    across = (side + tiles.TILE - 1) // tiles.TILE
    xs, ys = np.empty(kernel.AREA, np.float32), np.empty(kernel.AREA, np.float32)
    out = np.empty((kernel.AREA, kernel.CHANNELS + 1), np.float32)
    for face in range(6):
        begin, end = first[face], first[face + 1]
        _, packed, boxes, _ = tiles.touching(
            white, means, density, colours, maps[begin:end], spans[begin:end], faces[face], origin, lens, side, side,
            among[begin:end],
        )  # fmt: skip
        tile_start, members, _, _ = tiles.lists(boxes, across, across)
        size = kernel.longest(tile_start)
        alpha, depth = np.empty((size, kernel.AREA), np.float32), np.empty((size, kernel.AREA), np.float32)
        live, order = np.empty(size, np.int64), np.empty(size + 1, np.int64)
        for tile in range(across * across):
            begin, end = tile_start[tile], tile_start[tile + 1]
            if begin == end:
                continue
            bright = _brightest(packed, members, begin, end)
            brightest = max(brightest, bright)
            fine = _finesse(bright, mean, side) if mean > 0 else 1
            index = index1 if fine == 1 else (index2 if fine == 2 else index4)
            share = share1 if fine == 1 else (share2 if fine == 2 else share4)
            omega = omega1 if fine == 1 else (omega2 if fine == 2 else omega4)
            scale = half * fine
            for piece in range(fine * fine):
                row = tile // across * fine + piece // fine
                column = tile % across * fine + piece % fine
                kernel.tile_rays(column, row, scale, scale, scale, scale, xs, ys)
                n = kernel.gather(packed, members, begin, end, xs, ys, near, alpha, depth, live)
                kernel.composite(packed, members, live, alpha, depth, n, order, out)
                for i in range(kernel.AREA):
                    v, u = row * tiles.TILE + i // tiles.TILE, column * tiles.TILE + i % tiles.TILE
                    if v >= side * fine or u >= side * fine:
                        continue
                    lit, turn = out[i, kernel.CHANNELS], faces[face]
                    x = (turn[0, 0] * xs[i] + turn[1, 0] * ys[i] + turn[2, 0]) * lit
                    y = (turn[0, 1] * xs[i] + turn[1, 1] * ys[i] + turn[2, 1]) * lit
                    z = (turn[0, 2] * xs[i] + turn[1, 2] * ys[i] + turn[2, 2]) * lit
                    for s in range(index.shape[3]):
                        at = index[face, v, u, s]
                        part = share[face, v, u, s] * omega[v, u]
                        energy[at, 0] += part * out[i, 0]
                        energy[at, 1] += part * out[i, 1]
                        energy[at, 2] += part * out[i, 2]
                        opacity[at] += part * (1.0 - out[i, 3])
                        shine[at, 0] += part * x
                        shine[at, 1] += part * y
                        shine[at, 2] += part * z
    return brightest


_Lit = tuple[np.ndarray, np.ndarray, np.ndarray]


class _Prober:
    """Maps for one set of directions, ready to light any number of probes."""

    def __init__(self, maps: tuple[CellMap, CellMap, CellMap], face: int, count: int) -> None:
        """`maps` of pixels as they are, twice and `FINEST` times as fine, to `count` directions."""
        self.face = face
        self.count = count
        self.maps = [part for m in maps for part in (m.index, m.share)]
        self.omegas = [pixel_solid_angles(face * fine).astype(np.float32) for fine in (1, 2, FINEST)]
        self.solid_angle = np.zeros(self.count)
        for s in range(maps[-1].index.shape[3]):
            np.add.at(
                self.solid_angle,
                maps[-1].index[..., s],
                maps[-1].share[..., s] * np.broadcast_to(self.omegas[-1], (6, *self.omegas[-1].shape)),
            )
        if (self.solid_angle <= 0).any():
            raise LightError(
                f"{self.count} direction cells are finer than cube faces of {face * FINEST} pixels;"
                " raise face"
            )

    def lights(
        self,
        geometry: Shapes,
        gaussians: Gaussians,
        face_from_world: Float[np.ndarray, "6 3 3"],
        points: Float[np.ndarray, "m 3"],
        mean: float | None = None,
    ) -> Iterator[_Lit]:
        """Energy, opacity, and mean place of what shines, per cell at points that are close together.

        `mean`: the radiance around them; None: as it is at the first of them.
        """
        middle = points.mean(0)
        colours = radiance_towards(gaussians, middle).astype(np.float64)
        away = np.linalg.norm(points - middle, axis=1).max()
        # One order serves all: the kernel wants lists that are nearly sorted.
        nearest = np.argsort(np.linalg.norm(geometry.means - middle, axis=1), kind="stable")
        lens = np.full(4, self.face / 2)
        lists = [
            tiles.around(
                geometry.spread, geometry.means, geometry.density, face, middle, away, lens, self.face,
                self.face, nearest,
            )
            for face in face_from_world
        ]  # fmt: skip
        first, among = np.cumsum([0, *map(len, lists)]), np.concatenate(lists)
        faces = zip(face_from_world, lists, strict=True)
        turned = [tiles.turned(geometry.white, geometry.spread, geometry.density, *face) for face in faces]
        maps, spans = (np.concatenate(parts) for parts in zip(*turned, strict=True))

        def light(origin: np.ndarray, mean: float) -> tuple[float, _Lit]:
            energy, opacity = np.zeros((self.count, 3)), np.zeros(self.count)
            shine = np.zeros((self.count, 3))
            brightest = _probe(
                geometry.white, geometry.means, geometry.density, colours, maps, spans, face_from_world,
                first, among, origin, np.float32(0), self.face, mean, *self.maps, *self.omegas, energy,
                opacity, shine,
            )  # fmt: skip
            places = origin + shine / np.maximum(luminance(energy), 1e-30)[:, None]
            return brightest, (energy, opacity, places)

        if mean is None:
            brightest, plain = light(points[0], 0.0)
            mean = float(luminance(plain[0].sum(0)) / (4 * np.pi))
            yield plain if _finesse(brightest, mean, self.face) == 1 else light(points[0], mean)[1]
            points = points[1:]
        for point in points:
            yield light(point, mean)[1]


@functools.lru_cache(4)
def _prober(directions: bytes, face: int) -> _Prober:
    """Its maps take a second to make, and the same directions are asked for again and again."""
    towards = np.frombuffer(directions).reshape(-1, 3)
    once, twice, finest = (interpolated_cells(towards, face * fine) for fine in (1, 2, FINEST))
    return _Prober((once, twice, finest), face, len(towards))


@functools.lru_cache(2)
def _own_prober(face: int) -> _Prober:
    """For the pixels of cube maps themselves."""
    once, twice, finest = (own_cells(face, fine) for fine in (1, 2, FINEST))
    return _Prober((once, twice, finest), face, 6 * face * face)


@dataclass(frozen=True, slots=True, eq=False)
class ProbeLight:
    """What reaches probes of every view from every camera-frame direction; float32."""

    energy: Float[np.ndarray, "n m d 3"]  # radiance x solid angle
    seen: Float[np.ndarray, "n m d"]  # in [0, 1]: the share of a direction's light that was photographed
    places: Float[np.ndarray, "n m d 3"]  # world: where it comes from, mean by luminance before any filling


def gather_probes(
    gaussians: Gaussians,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    cam_points: Float[np.ndarray, "m 3"],
    directions: Float[np.ndarray, "d 3"],
    face: int = 64,
    fill: bool = True,
    progress: Progress | None = None,
) -> ProbeLight:
    """The light at every probe of every view.

    Args:
        cam_points: the probes, camera frame (they move with the camera).
        directions: unit, near equal area, camera frame.
        face: pixels along an edge of the cube map; a cell should hold a few pixels.
        fill: give directions that were not seen a smooth, never-zero guess from what was seen.
    """
    progress = progress or Progress()
    n, m, d = len(cam_from_world), len(cam_points), len(directions)
    prober = _prober(np.asarray(directions, np.float64).tobytes(), face)
    graph = neighbourhood(np.asarray(directions, np.float64))
    geometry = shapes(gaussians)
    energy, seen = np.zeros((n, m, d, 3), np.float32), np.zeros((n, m, d), np.float32)
    places = np.zeros_like(energy)

    def view(i: int) -> None:
        rotation, shift = cam_from_world[i, :, :3], cam_from_world[i, :, 3]
        face_from_world = np.ascontiguousarray(FACES @ rotation)
        world_points = (cam_points - shift) @ rotation
        found = prober.lights(geometry, gaussians, face_from_world, world_points)
        for j, (cell_energy, opacity, where) in enumerate(found):
            share = np.minimum(opacity / prober.solid_angle, 1)
            energy[i, j], seen[i, j], places[i, j] = cell_energy, share, where
            if fill:
                energy[i, j] = inpaint_energy(cell_energy, share, share, prober.solid_angle, graph)

    with thread_pool() as run:
        for begin in range(0, n, BATCH):
            progress.step(begin / n, f"light at the object, view {begin + 1} of {n}")

            def some(part: int, parts: int, begin: int = begin) -> None:
                for i in range(begin + part, min(begin + BATCH, n), parts):
                    view(i)

            run(some, ())
    progress.step(1.0, "light at the object")
    return ProbeLight(energy, seen, places)


def cubes(
    gaussians: Gaussians, places: Float[np.ndarray, "k 3"], face: int, mean: float | None, progress: Progress
) -> tuple[Float[np.ndarray, "k t 4"], float]:
    """Radiance and opacity of the pixels of cube maps at some places (`direction_grid.face_directions`), all in the world frame; float32;
    and the mean radiance by which is told what is bright: as given, or at the first of the places.
    """
    prober, geometry = _own_prober(face), shapes(gaussians)
    found = np.empty((len(places), prober.count, 4), np.float32)

    def gather(near: Int[np.ndarray, " _"], mean: float | None = mean) -> None:
        lit = prober.lights(geometry, gaussians, FACES, places[near], mean)
        for i, (energy, opacity, _) in zip(near, lit, strict=True):
            found[i, :, :3] = energy / prober.solid_angle[:, None]
            found[i, :, 3] = np.minimum(opacity / prober.solid_angle, 1)

    if mean is None:
        gather(np.array([0]))
        mean = float(luminance(found[0, :, :3].astype(float).T @ prober.solid_angle) / (4 * np.pi))
    groups = _close(places, np.arange(len(places)))
    with thread_pool() as run:
        for begin in range(0, len(groups), BATCH):
            progress.step(begin / len(groups), "light around the object")

            def some(part: int, parts: int, begin: int = begin) -> None:
                for near in groups[begin : begin + BATCH][part::parts]:
                    gather(near, mean)

            run(some, ())
    return found, mean


def _close(places: Float[np.ndarray, "k 3"], which: Int[np.ndarray, " _"]) -> list[Int[np.ndarray, " _"]]:
    """Groups of a few places that are close together: halved along the longer side until they are small."""
    if len(which) <= CLOSE:
        return [which]
    side = np.ptp(places[which], axis=0).argmax()
    order = which[np.argsort(places[which, side], kind="stable")]
    middle = len(order) // 2
    return _close(places, order[:middle]) + _close(places, order[middle:])


def panorama(
    gaussians: Gaussians,
    origin: Float[np.ndarray, " 3"],
    frame_from_world: Float[np.ndarray, "3 3"],
    height: int,
    fill: bool = False,
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]:
    """Equirectangular incident radiance at a point, and how much of each pixel was seen.

    Column u, row v: azimuth 2 pi (u + 0.5) / w - pi, polar angle pi (v + 0.5) / h from -y; the centre looks
    along +z of the frame. Pixels are means over their area.
    """
    cube = Cube(gaussians, np.asarray(origin, np.float64), frame_from_world, side=max(8, 2 * height))
    fine = 3  # samples along each edge of a pixel
    at = panorama_directions(height * fine)
    sampled, _ = cube.look(at)
    sampled = sampled.reshape(height, fine, 2 * height, fine, 4).mean((1, 3))
    seen = np.minimum(sampled[..., 3], 1)
    radiance = sampled[..., :3]
    if fill:
        flat = panorama_directions(height).reshape(-1, 3)
        ones, share = np.ones(len(flat)), seen.ravel()
        radiance = inpaint_energy(radiance.reshape(-1, 3), share, share, ones, neighbourhood(flat))
    return radiance.reshape(height, 2 * height, 3).astype(np.float32), seen.astype(np.float32)


def panorama_directions(height: int) -> Float[np.ndarray, "h w 3"]:
    """Unit directions of the pixels of an equirectangular picture, in its frame (y down, z at the centre)."""
    theta = np.pi * (np.arange(height) + 0.5) / height
    phi = 2 * np.pi * (np.arange(2 * height) + 0.5) / (2 * height) - np.pi
    theta, phi = np.meshgrid(theta, phi, indexing="ij")
    return np.stack([np.sin(theta) * np.sin(phi), -np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1)


class Cube:
    """A cube map of the light at one point, to be looked up in any direction of its frame."""

    def __init__(
        self, gaussians: Gaussians, origin: Float[np.ndarray, " 3"], frame_from_world: np.ndarray, side: int
    ) -> None:
        geometry, colours = shapes(gaussians), radiance_towards(gaussians, origin)
        lens = np.full(4, side / 2)
        self.side = side
        with thread_pool() as run:
            rotations = FACES @ frame_from_world
            poses = [np.concatenate([r, -(r @ origin)[:, None]], axis=1) for r in rotations]
            views = [Pinhole(pose, lens, side, side) for pose in poses]
            self.faces = np.stack([render(geometry, colours, view, 0.0, run) for view in views])

    def look(
        self, directions: Float[np.ndarray, "*n 3"]
    ) -> tuple[Float[np.ndarray, "*n 4"], Float[np.ndarray, "*n"]]:
        """Radiance and opacity of the nearest pixel, and the mean distance of what is there."""
        local = np.einsum("fij,...j->...fi", FACES, directions)
        face = local[..., 2].argmax(-1)
        local = np.take_along_axis(local, face[..., None, None], axis=-2)[..., 0, :]
        at = (local[..., :2] / local[..., 2:] + 1) * (self.side / 2)
        u, v = np.moveaxis(np.clip(at.astype(int), 0, self.side - 1), -1, 0)
        found = self.faces[face, v, u]
        opacity = 1 - found[..., 3]
        distance = found[..., 4] / np.maximum(opacity, 1e-6) / local[..., 2]
        return np.concatenate([found[..., :3], opacity[..., None]], axis=-1), distance
