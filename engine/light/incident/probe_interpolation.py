"""Light at many places of a room, told from cube maps of few of them.

Where the object stands in one view it stood, or nearly, in another: probes of a hundred views crowd into half a metre, and
what arrives from a direction changes little from one to the next. Cube maps, their faces along the world's axes, are gathered
where the others say least (the largest pivot of a Cholesky factorisation: Harbrecht, Peters, Schneider, "On the low-rank
approximation by the pivoted Cholesky decomposition", 2012), until the next ones come out as was foretold. All probes' are weighted sums of
these (kriging), turned into their cameras.

World frame, but for direction cells and probes.
"""

from collections.abc import Callable
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.linalg import solve_triangular

from engine.geometry import inverse
from engine.light.gaussians.rasterize import thread_pool
from engine.light.incident.direction_grid import face_directions, interpolated_cells, pixel_solid_angles
from engine.light.incident.inpainting import inpaint_energy, neighbourhood
from engine.light.incident.probes import BATCH, cubes, gather_probes
from engine.progress import Progress
from engine.types import Gaussians

FIRST, MORE = 96, 0.25
"""Cube maps before any place is foretold; and by what share of them their number grows at least."""
WORTH = 0.5
"""Share of the places at which cube maps are worth their weighing."""
CERTAIN = 1e-9
"""Share of a place's variance below which the places before it leave nothing open."""
TOGETHER = 4
"""Views whose cube maps are mixed in one product: 12 MB of them."""


def interpolate(
    gaussians: Gaussians,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    cam_points: Float[np.ndarray, "m 3"],
    directions: Float[np.ndarray, "d 3"],
    face: int,
    receivers: Float[np.ndarray, "r t"],
    tolerance: float,
    progress: Progress,
) -> Float[np.ndarray, "n m d 3"]:
    """The energy that `probes.arriving` finds, unseen directions filled; where cube maps would be as many as half the probes,
    that itself.

    Args:
        face: pixels along an edge of the cube maps.
        receivers: shares of what comes from every pixel of a cube map (`direction_grid.face_directions`, world frame) that things send on
            which have to look right.
        tolerance: what these send may be off by so much of itself, root mean square.
    """
    at = inverse(cam_from_world)
    places = (np.einsum("nij,mj->nmi", at[:, :, :3], cam_points) + at[:, None, :, 3]).reshape(-1, 3)
    most = int(WORTH * len(places))
    choice = _PivotedCholesky(places, most)
    known, mean = cubes(gaussians, places[choice.first(FIRST)], face, None, progress.part(0, 0.2))
    needed = 2 * FIRST
    while len(known) < needed:
        if needed > most:
            return gather_probes(
                gaussians, cam_from_world, cam_points, directions, face, True, progress.part(0.8, 1)
            ).energy
        count = len(known)
        some = choice.first(min(max(needed, int((1 + MORE) * count)), 2 * count))[count:]
        if not len(some):
            break  # all places are those that there are cube maps of
        span = progress.part(0.8 * count / needed, 0.8)
        added, _ = cubes(gaussians, places[some], face, mean, span)
        off = _apart(np.tensordot(choice.weights(some, count), known, 1), added, receivers, face)
        known = np.concatenate([known, added])
        # Errors fall with the number of cube maps, nearly as its inverse.
        needed = int(np.ceil(count * off / tolerance))
    every = np.arange(len(places)).reshape(len(at), -1)

    def mixed(views: slice) -> Float[np.ndarray, "k m t 4"]:
        """Cube maps at all probes of some views."""
        these = every[views]
        mixed = choice.weights(these.ravel(), len(known)) @ known.reshape(len(known), -1)
        return mixed.reshape(*these.shape, -1, 4)

    return _sorted(mixed, len(cam_points), cam_from_world, directions, face, progress.part(0.8, 1))


class _PivotedCholesky:
    """Places, each the one of which those before it say least, and what they say of all.

    Light is taken for a random field with two derivatives (Matern 5/2) that changes over the extent of the places; what it
    is worth to know that better, or to take another, is nothing (decision 52).
    """

    def __init__(self, places: Float[np.ndarray, "m 3"], most: int) -> None:
        self.places, self.scale = places, np.sqrt(places.var(0).sum())
        self.order: list[int] = []
        self.left = np.ones(len(places))  # of their variance, that the chosen leave open
        self.factor = np.zeros((len(places), most))  # of the covariance of all with the chosen (Cholesky)

    def first(self, count: int) -> Int[np.ndarray, " k"]:
        """So many of them, or fewer where nothing else is open."""
        for k in range(len(self.order), min(count, self.factor.shape[1])):
            i = int(self.left.argmax())
            if self.left[i] < CERTAIN:
                break
            r = np.sqrt(5) * np.linalg.norm(self.places - self.places[i], axis=1) / self.scale
            column = (1 + r + r * r / 3) * np.exp(-r) - self.factor[:, :k] @ self.factor[i, :k]
            self.factor[:, k] = column / np.sqrt(self.left[i])
            self.left -= self.factor[:, k] ** 2
            self.left[i] = 0
            self.order.append(i)
        return np.array(self.order[:count])

    def weights(self, of: Int[np.ndarray, " q"], count: int) -> Float[np.ndarray, "q k"]:
        """What the first of them weigh at some places; they sum to one."""
        among = self.factor[self.order[:count], :count]
        weights = np.asarray(solve_triangular(among, self.factor[of, :count].T, lower=True, trans=1)).T
        return (weights / weights.sum(1, keepdims=True)).astype(np.float32)


def _apart(
    foretold: Float[np.ndarray, "k t 4"],
    known: Float[np.ndarray, "k t 4"],
    receivers: Float[np.ndarray, "r t"],
    face: int,
) -> float:
    """How far off what things send on is by cube maps that were foretold: root mean square, relative."""
    omega = np.broadcast_to(pixel_solid_angles(face), (6, face, face)).ravel()
    takes = (receivers * omega).astype(np.float32)
    taken, expected = (takes @ x[..., :3] for x in (known, foretold))
    return float(np.sqrt(((expected / np.maximum(taken, 1e-30) - 1) ** 2).mean()))


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def _looked_up(cubes, side, rays, omega, index, share, energy, opacity):
    """Add what cube maps have along some rays of their frame, each with its solid angle and shared among its cells, to
    `energy` [m d 3] and `opacity` [m d] (x solid angle). Linear between pixels; beyond a face's outermost as these are.
    """
    for r in range(len(rays)):
        x, y, z = rays[r]
        # Which face, and where on it: `direction_grid.FACES`.
        if abs(z) >= abs(x) and abs(z) >= abs(y):
            face, right, down, away = (0, x, y, z) if z > 0 else (1, -x, y, -z)
        elif abs(x) >= abs(y):
            face, right, down, away = (2, -z, y, x) if x > 0 else (3, z, y, -x)
        else:
            face, right, down, away = (4, x, -z, y) if y > 0 else (5, x, z, -y)
        u = min(max((right / away + 1) * side / 2 - 0.5, 0.0), side - 1.0)
        v = min(max((down / away + 1) * side / 2 - 0.5, 0.0), side - 1.0)
        column, row = min(int(u), side - 2), min(int(v), side - 2)
        at, u, v = (face * side + row) * side + column, np.float32(u - column), np.float32(v - row)
        a, b, c, d = (1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v
        for m in range(len(cubes)):
            one, two, three, four = (
                cubes[m, at],
                cubes[m, at + 1],
                cubes[m, at + side],
                cubes[m, at + side + 1],
            )
            for channel in range(4):
                value = a * one[channel] + b * two[channel] + c * three[channel] + d * four[channel]
                value *= omega[r]
                for s in range(index.shape[1]):
                    if channel < 3:
                        energy[m, index[r, s], channel] += share[r, s] * value
                    else:
                        opacity[m, index[r, s]] += share[r, s] * value


def _sorted(
    mixed: Callable[[slice], Float[np.ndarray, "k m t 4"]],
    probes: int,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    directions: Float[np.ndarray, "d 3"],
    face: int,
    progress: Progress,
) -> Float[np.ndarray, "n m d 3"]:
    """The energy in every view's direction cells, of the cube maps at its probes; what is not covered is filled."""
    rays = face_directions(face).reshape(-1, 3)
    cells, graph = interpolated_cells(directions, face), neighbourhood(directions)
    index, share = cells.index.reshape(len(rays), -1), cells.share.reshape(len(rays), -1)
    omega = np.broadcast_to(pixel_solid_angles(face), (6, face, face)).ravel().astype(np.float32)
    solid_angle = np.bincount(index.ravel(), (share * omega[:, None]).ravel(), len(directions))

    n = len(cam_from_world)
    energy = np.zeros((n, probes, len(directions), 3), np.float32)

    def some(views: slice) -> None:
        for i, maps in enumerate(mixed(views), views.start):
            found, opacity = np.zeros(energy.shape[1:]), np.zeros(energy.shape[1:3])
            turned = np.ascontiguousarray(rays @ cam_from_world[i, :, :3])
            _looked_up(maps, face, turned, omega, index, share, found, opacity)
            for probe, covered in enumerate(np.clip(opacity / solid_angle, 0, 1)):
                energy[i, probe] = inpaint_energy(found[probe], covered, covered, solid_angle, graph)

    with thread_pool() as run:
        for begin in range(0, n, BATCH):
            progress.step(begin / n, f"light at the object, view {begin + 1} of {n}")
            these = [slice(i, min(i + TOGETHER, n)) for i in range(begin, min(begin + BATCH, n), TOGETHER)]

            def share_of(part: int, parts: int, these: list[slice] = these) -> None:
                for views in these[part::parts]:
                    some(views)

            run(share_of, ())
    return energy
