"""The arithmetic of the light's benchmark: two lights at one point, cell by cell, and lamps seen from corners.

Camera frame. An "energy" is radiance times solid angle per direction cell; both lights are sorted into the same
cells by the same rule, so that neither is sharper than the other.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_matrix
from scipy.spatial import KDTree

from engine.color import luminance
from engine.geometry import angle_between
from engine.light.incident.direction_grid import interpolated_cells, pixel_solid_angles
from engine.light.incident.probes import panorama_directions

FINER = 3  # parts along each edge of a panorama's pixel that find their cells by themselves
FOUND_DEG = 10.0
"""A true lamp without one of ours this near, on average over views and corners, was not found."""


@dataclass(frozen=True, slots=True, eq=False)
class Binning:
    """How panoramas of one size are sorted into direction cells, and how large those come out."""

    directions: Float[np.ndarray, "d 3"]
    matrix: csr_matrix  # cells x pixels: solid angle of the pixel's part in the cell
    solid_angle: Float[np.ndarray, " d"]


def binning(directions: Float[np.ndarray, "d 3"], height: int) -> Binning:
    """Every part of a pixel is shared among the three cells around it, its direction their weighted mean."""
    fine = panorama_directions(height * FINER).reshape(-1, 3)
    near = KDTree(directions).query(fine, k=3)[1]
    shares = np.linalg.solve(np.swapaxes(directions[near], 1, 2), fine[..., None])[..., 0]
    shares = np.maximum(shares, 0)
    shares /= shares.sum(1, keepdims=True)
    edges = np.cos(np.pi * np.arange(height * FINER + 1) / (height * FINER))
    part = (edges[:-1] - edges[1:]) * np.pi / (height * FINER)
    row, column = np.divmod(np.arange(len(fine)), 2 * height * FINER)
    pixel = row // FINER * 2 * height + column // FINER
    entries = (shares * part[row][:, None]).ravel()
    matrix = csr_matrix((entries, (near.ravel(), np.repeat(pixel, 3))), (len(directions), 2 * height**2))
    return Binning(directions, matrix, np.asarray(matrix.sum(1)).ravel())


def binned(panorama: Float[np.ndarray, "h w 3"], onto: Binning) -> Float[np.ndarray, "d 3"]:
    """A panorama's energy per cell."""
    return np.asarray(onto.matrix @ panorama.reshape(-1, 3).astype(np.float64))


def probe_solid_angle(directions: Float[np.ndarray, "d 3"], side: int) -> Float[np.ndarray, " d"]:
    """How large the cells of a probe come out: its triangles are not always the three nearest directions."""
    cells, pixels = interpolated_cells(directions, side), pixel_solid_angles(side)
    return np.bincount(cells.index.ravel(), (cells.share * pixels[..., None]).ravel(), len(directions))


@dataclass(frozen=True, slots=True)
class Irradiance:
    """|ours - true| over all normals and channels: over the view's mean irradiance, and over itself; percent."""

    mean: float
    p95: float
    own_mean: float
    own_p95: float


def irradiance_error(
    ours: Float[np.ndarray, "d 3"],
    true: Float[np.ndarray, "d 3"],
    directions: Float[np.ndarray, "d 3"],
    normals: Float[np.ndarray, "m 3"],
) -> Irradiance:
    """Irradiance of diffuse surfaces that face each of the normals, one view."""
    cosine = np.maximum(normals @ directions.T, 0)
    want = cosine @ true
    off = np.abs(cosine @ ours - want)
    relative, own = 100 * off / want.mean(), 100 * off / want
    return Irradiance(
        float(relative.mean()), float(np.percentile(relative, 95)), float(own.mean()), float(np.percentile(own, 95))
    )  # fmt: skip


def brightest(
    energy: Float[np.ndarray, "d 3"], solid_angle: Float[np.ndarray, " d"], share: float
) -> Bool[np.ndarray, " d"]:
    """The cells of highest luminance that together fill `share` of the sphere."""
    order = np.argsort(-luminance(energy) / solid_angle, kind="stable")
    filled = np.cumsum(solid_angle[order])
    chosen = np.zeros(len(energy), bool)
    chosen[order[: np.searchsorted(filled, share * filled[-1]) + 1]] = True
    return chosen


def within(
    directions: Float[np.ndarray, "d 3"], towards: Float[np.ndarray, "p 3"], radius: float
) -> Bool[np.ndarray, " d"]:
    """Cells within `radius` (radians) of any of the directions `towards` (any length)."""
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    return KDTree(towards).query(directions)[0] <= 2 * np.sin(radius / 2)


def centroid(
    energy: Float[np.ndarray, "k 3"], directions: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, " 3"]:
    """Direction that the light of some cells comes from on average, unit."""
    mean = luminance(energy) @ directions
    return mean / np.linalg.norm(mean)


def lamp_angles(
    true: Float[np.ndarray, "t 3"],
    ours: Float[np.ndarray, "o 3"],
    true_cam_from_world: Float[np.ndarray, "n 3 4"],
    our_cam_from_world: Float[np.ndarray, "n 3 4"],
    scale: float,
    corners: Float[np.ndarray, "c 3"],
) -> Float[np.ndarray, "t o n c"]:
    """Degrees between true lamps and ours, seen from each corner in each view.

    Args:
        true, ours: lamps, each in the world of its own poses.
        scale: the truth's unit per unit of ours.
        corners: camera frame, the truth's unit.
    """
    there = np.einsum("nij,tj->tni", true_cam_from_world[:, :, :3], true) + true_cam_from_world[:, :, 3]
    here = np.einsum("nij,oj->oni", our_cam_from_world[:, :, :3], ours) + our_cam_from_world[:, :, 3]
    a = there[:, None, :, None] - corners
    b = scale * here[None, :, :, None] - corners
    return np.degrees(angle_between(*np.broadcast_arrays(a, b)))


def matched(angles: Float[np.ndarray, "t o n c"]) -> Int[np.ndarray, " t"]:
    """Which of ours each true lamp is, one to one by mean angle; -1 where none is near."""
    mean = angles.mean((2, 3))
    chosen = np.full(len(mean), -1)
    for lamp, candidate in zip(*linear_sum_assignment(mean), strict=True):
        if mean[lamp, candidate] <= FOUND_DEG:
            chosen[lamp] = candidate
    return chosen
