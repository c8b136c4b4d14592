"""Gaussians under the paper's training: what Adam steps, and where they are cloned, split and pruned.

Source: the paper trains with 3DGRT's defaults (Moenne-Loccoz et al. 2024), which are those of 3DGS (Kerbl et al.
2023, Sec. 5) but for the gradient that asks for more Gaussians: that of the mean, in the world, times half the
distance to the camera. World frame; radiance in units of the 1 in Eq. (5).

One row per Gaussian: mean (3), quaternion (4), log scales (3), logit of the peak opacity, and then the radiance's
spherical harmonics, three channels each. The peak opacity is 1 - exp(-density) of Eq. (4). Scales are ours,
without the 1/2 in the exponent: larger than those of 3DGS by the root of 2.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.spatial import KDTree
from scipy.special import expit

from engine.light.gaussians.gaussians import Y00, rotations, sh_basis, sh_degree
from engine.light.gaussians.rasterize import Gradients, ThreadPool
from engine.types import Gaussians

_FLAGS = {"cache": True, "nogil": True, "error_model": "numpy"}
_OPACITY, _COLOURS = 10, 11  # columns of a row
_BETA1, _BETA2, _EPSILON = 0.9, 0.999, 1e-15  # Adam's defaults; the last is of 3DGS
# Step sizes of 3DGS and 3DGRT: quaternion, log scale, logit of opacity, constant term, other harmonics.
_QUATERNION, _LOG_SCALE, _LOGIT, _CONSTANT, _HARMONICS = 1e-3, 5e-3, 5e-2, 2.5e-3, 2.5e-3 / 20
_MEAN = (1.6e-4, 1.6e-6)  # at the start and at the end, in extents of the camera path; falls exponentially
_FIRST_OPACITY = 0.1
# Mean gradient from which on a Gaussian is cloned or split: 2e-4 of a loss that is a mean over the channels; Eq. (5) sums.
_ASKING = 3 * 2e-4
_LARGE = 0.01  # extents of the camera path; larger ones are split, smaller ones cloned
_SHRINK = 1.6  # by which the halves of a split are smaller
_FAINT, _RESET = 0.005, 0.01  # opacities: what is pruned, and what a reset leaves


@dataclass(slots=True, eq=False)
class Cloud:
    """Rows under training, Adam's moments, and how often and how hard each mean was pulled of late."""

    rows: Float[np.ndarray, "k c"]
    first: Float[np.ndarray, "k c"]
    second: Float[np.ndarray, "k c"]
    pulled: Float[np.ndarray, " k"]
    seen: Int[np.ndarray, " k"]
    steps: int = 0


def begin(points: Float[np.ndarray, "k 3"], colours: Float[np.ndarray, "k 3"]) -> Cloud:
    """One faint ball per point, as large as its three nearest neighbours are far."""
    near = KDTree(points).query(points, k=min(4, len(points)))[0][:, 1:]
    size = np.sqrt(2 * np.maximum((near**2).mean(1), 1e-7))
    rows = np.zeros((len(points), _COLOURS + 3))
    rows[:, :3], rows[:, 3] = points, 1
    rows[:, 7:10] = np.log(size)[:, None]
    rows[:, _OPACITY] = np.log(_FIRST_OPACITY / (1 - _FIRST_OPACITY))
    rows[:, _COLOURS:] = colours / Y00
    return _fresh(rows, np.zeros_like(rows), np.zeros_like(rows), 0)


def gaussians_of(cloud: Cloud) -> Gaussians:
    """The Gaussians as they stand."""
    rows = cloud.rows
    return Gaussians(
        means=rows[:, :3],
        quaternions=rows[:, 3:7],
        scales=np.exp(rows[:, 7:10]),
        density=np.logaddexp(0, rows[:, _OPACITY]),
        radiance=rows[:, _COLOURS:].reshape(len(rows), -1, 3),
    )


def slopes(
    cloud: Cloud, gradients: Gradients, colours: Float[np.ndarray, "k 3"], origin: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "v c"]:
    """d loss / d row of the Gaussians that the view at `origin` sees; `colours` are what it sees of all.

    How the direction to a mean, and so its harmonics, turn as it moves is left out: 3DGRT takes the ray's.
    """
    i = gradients.index
    rows = cloud.rows[i]
    length = np.linalg.norm(rows[:, 3:7], axis=1, keepdims=True)
    w, xyz, turn = rows[:, 3:4] / length, rows[:, 4:7] / length, gradients.turn
    # A change dq turns the axes by 2 q* dq, hence the gradient 2 q (0, turn).
    quaternion = np.concatenate([-(xyz * turn).sum(1, keepdims=True), w * turn + np.cross(xyz, turn)], axis=1)
    towards = rows[:, :3] - origin
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    basis = sh_basis(towards, sh_degree((rows.shape[1] - _COLOURS) // 3))
    shown = gradients.colours * (colours[i] > 0)
    return np.concatenate(
        [
            gradients.means,
            2 * quaternion / length,
            gradients.log_scales,
            (gradients.density * expit(rows[:, _OPACITY]))[:, None],
            (basis[:, :, None] * shown[:, None, :]).reshape(len(i), -1),
        ],
        axis=1,
    )


def rates(cloud: Cloud, extent: float, share: float) -> Float[np.ndarray, " c"]:
    """Adam's step size of every column, `share` of the training done."""
    begin, end = _MEAN
    rate = np.full(cloud.rows.shape[1], _HARMONICS)
    rate[:3] = extent * begin * (end / begin) ** share
    rate[3:7], rate[7:10], rate[_OPACITY] = _QUATERNION, _LOG_SCALE, _LOGIT
    rate[_COLOURS : _COLOURS + 3] = _CONSTANT
    return rate


def advance(
    cloud: Cloud,
    gradients: Gradients,
    slope: Float[np.ndarray, "v c"],
    rate: Float[np.ndarray, " c"],
    origin: Float[np.ndarray, " 3"],
    run: ThreadPool,
) -> None:
    """One step of Adam on every row (the moments of those that are not seen fade), and its count of pulls."""
    i = gradients.index
    pull = np.linalg.norm(slope[:, :3], axis=1)
    cloud.pulled[i] += pull * np.linalg.norm(cloud.rows[i, :3] - origin, axis=1) / 2
    cloud.seen[i] += pull > 0
    place = np.full(len(cloud.rows), -1)
    place[i] = np.arange(len(i))
    cloud.steps += 1
    adam(cloud.rows, cloud.first, cloud.second, place, slope, rate, cloud.steps, run)


def adam(
    rows: Float[np.ndarray, "k c"],
    first: Float[np.ndarray, "k c"],
    second: Float[np.ndarray, "k c"],
    place: Int[np.ndarray, " k"],
    slope: Float[np.ndarray, "v c"],
    rate: Float[np.ndarray, " c"],
    steps: int,
    run: ThreadPool,
) -> None:
    """Step `steps` (from 1) of Adam (Kingma and Ba 2015) in place; the slope of row k is slope[place[k]], or 0 for -1."""
    run(_adam, (rows, first, second, place, slope, rate, 1 - _BETA1**steps, 1 - _BETA2**steps))


@njit(**_FLAGS)
@no_type_check
def _adam(rows, first, second, place, slope, rate, young1, young2, part, parts):
    count = rows.shape[0]
    for k in range(count * part // parts, count * (part + 1) // parts):
        for c in range(rows.shape[1]):
            g = slope[place[k], c] if place[k] >= 0 else 0.0
            first[k, c] = _BETA1 * first[k, c] + (1 - _BETA1) * g
            second[k, c] = _BETA2 * second[k, c] + (1 - _BETA2) * g * g
            rows[k, c] -= rate[c] * (first[k, c] / young1) / (np.sqrt(second[k, c] / young2) + _EPSILON)


def finer_harmonics(cloud: Cloud, degree: int) -> Cloud:
    """The same radiance, with room for spherical harmonics of `degree`."""
    more = _COLOURS + 3 * (degree + 1) ** 2 - cloud.rows.shape[1]
    rows, first, second = (
        np.pad(table, ((0, 0), (0, more))) for table in (cloud.rows, cloud.first, cloud.second)
    )
    return Cloud(rows, first, second, cloud.pulled, cloud.seen, cloud.steps)


def densified(cloud: Cloud, extent: float, most: int, rng: np.random.Generator) -> Cloud:
    """Clone the small and split the large of those that are pulled hard, up to `most` in all."""
    asking = cloud.pulled / np.maximum(cloud.seen, 1)
    chosen = np.nonzero(asking >= _ASKING)[0]
    chosen = np.sort(chosen[np.argsort(-asking[chosen], kind="stable")[: max(most - len(asking), 0)]])
    large = np.exp(cloud.rows[chosen, 7:10]).max(1) / np.sqrt(2) > _LARGE * extent
    split, cloned = chosen[large], chosen[~large]
    halves = np.repeat(cloud.rows[split], 2, axis=0)
    away = rng.normal(size=(len(halves), 3)) * np.exp(halves[:, 7:10]) / np.sqrt(2)
    halves[:, :3] += np.einsum("kij,kj->ki", rotations(halves[:, 3:7]), away)
    halves[:, 7:10] -= np.log(_SHRINK)
    stay = np.ones(len(asking), bool)
    stay[split] = False
    born = np.concatenate([cloud.rows[cloned], halves])
    first, second = (
        np.concatenate([table[stay], np.zeros_like(born)]) for table in (cloud.first, cloud.second)
    )
    return _fresh(np.concatenate([cloud.rows[stay], born]), first, second, cloud.steps)


def pruned(cloud: Cloud) -> Cloud:
    """Without those that hardly hide anything."""
    stay = expit(cloud.rows[:, _OPACITY]) >= _FAINT
    return Cloud(
        cloud.rows[stay],
        cloud.first[stay],
        cloud.second[stay],
        cloud.pulled[stay],
        cloud.seen[stay],
        cloud.steps,
    )


def make_faint(cloud: Cloud) -> None:
    """Reset every opacity to next to nothing: those that are needed come back, the others are pruned."""
    cloud.rows[:, _OPACITY] = np.minimum(cloud.rows[:, _OPACITY], np.log(_RESET / (1 - _RESET)))
    cloud.first[:, _OPACITY] = cloud.second[:, _OPACITY] = 0


def _fresh(rows: np.ndarray, first: np.ndarray, second: np.ndarray, steps: int) -> Cloud:
    return Cloud(rows, first, second, np.zeros(len(rows)), np.zeros(len(rows), np.int64), steps)
