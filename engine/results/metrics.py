"""How far a result is from the truth: surface, poses and mask.

Source: the paper, Sec. 4.1 (mean angular error of normals, PSNR of albedo with and without matching the
mean, mean absolute error of roughness; depth after one scale). Camera frame; errors in the unit each name
says. Scores are taken where both the surface and the truth hold a pixel; so that leaving the hard pixels
out cannot pay, `coverage` says how much of the truth was answered, and the `charged` scores count each
pixel left out as a blind guess: a normal 90 degrees off, a black albedo, the worse end of roughness.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from engine.errors import TruthError
from engine.geometry import align_similarity, angle_between
from engine.io.ground_truth import Truth
from engine.types import Poses, Surface

BAND = 1.96  # half width, in standard errors, of the interval that should hold 95 % of the errors
NORMAL_BAND = math.sqrt(math.log(20))
"""The same of a normal, whose error has two tangent components and whose standard error is the root of both variances' sum: of
two that are alike, exp(-(error / standard error)^2) lie farther out."""


def normal_coverage(error: Float[np.ndarray, " p"], stderr: Float[np.ndarray, " p"], level: float) -> float:
    """Share of normals whose error is within the interval that should hold `level` of them; both in one unit."""
    return float((error <= math.sqrt(-math.log(1 - level)) * stderr).mean())


def sparsification_error(error: Float[np.ndarray, " p"], stderr: Float[np.ndarray, " p"]) -> float:
    """How much worse standard errors sort pixels than their true errors would: the area between the two curves of the mean error of
    what is left as ever more of the worst is taken out, over the mean error of all; 0 at best.

    Source: Ilg et al., "Uncertainty Estimates and Multi-Hypotheses Networks for Optical Flow", ECCV 2018 (AUSE).
    """
    kept = np.arange(1, len(error) + 1)
    by_stderr, by_error = (np.cumsum(error[np.argsort(key, kind="stable")]) / kept for key in (stderr, error))
    return float((by_stderr - by_error).mean() / error.mean())


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Scores of one surface against its truth; `as_dict` is ready for JSON."""

    truth_pixels: int
    unanswered_pixels: int  # of the truth's, those the surface says nothing about
    extra_pixels: int  # the surface answers, the truth has no object there
    coverage: float  # answered share of the truth's pixels
    iou: float  # of the surface's mask with the truth's
    normal_mean_deg: float
    normal_median_deg: float
    normal_mean_charged_deg: float
    albedo_psnr_db: float
    albedo_psnr_matched_db: float
    albedo_psnr_charged_db: float
    albedo_match: float  # factor that gives the albedo the truth's mean
    roughness_mae: float
    roughness_mae_charged: float
    depth_scale: float  # factor that gives the depth the truth's size
    depth_relative_median: float  # |error| / true depth, after depth_scale
    depth_relief_median: float  # |error| / relief of the object (5th to 95th percentile of depth)
    normal_in_band: float  # share of pixels whose error is within NORMAL_BAND standard errors; ideal 0.95
    albedo_in_band: float
    roughness_in_band: float

    def as_dict(self) -> dict[str, float | int | None]:
        """For JSON, which knows no NaN or infinity: those become null."""
        return _finite(asdict(self))


@dataclass(frozen=True, slots=True)
class PoseEvaluation:
    """Scores of estimated poses against the true ones."""

    views: int
    registered: int
    registered_share: float
    rotation_median_deg: float
    rotation_max_deg: float
    position_median_percent: float  # of the path's extent
    position_max_percent: float
    extent: float  # largest distance between two true camera centres, the truth's unit
    scale: float  # truth's unit per unit of the estimate

    def as_dict(self) -> dict[str, float | int | None]:
        """For JSON, which knows no NaN or infinity: those become null."""
        return _finite(asdict(self))


@dataclass(frozen=True, slots=True)
class MaskEvaluation:
    """Scores of an object mask against the true one."""

    iou: float
    boundary_mean_px: float  # both ways: from each outline to the nearest point of the other

    def as_dict(self) -> dict[str, float | int | None]:
        """For JSON, which knows no NaN or infinity: those become null."""
        return _finite(asdict(self))


def evaluate(surface: Surface, truth: Truth) -> Evaluation:
    """Hold a surface against its truth.

    Raises:
        TruthError: sizes differ, or the surface answers none of the truth's pixels.
    """
    if surface.mask.shape != truth.mask.shape:
        raise TruthError(
            f"the truth is {_size(truth.mask)} pixels, the result {_size(surface.mask)}; evaluate against the"
            " truth of the same photographs"
        )
    both = surface.mask & truth.mask
    answered, asked = int(both.sum()), int(truth.mask.sum())
    if answered == 0:
        raise TruthError(
            "the result answers none of the truth's pixels; this is the truth of another session"
        )
    lacking = asked - answered

    angle = np.degrees(angle_between(surface.normal[both], truth.normal[both]))
    albedo, true_albedo = surface.albedo[both].astype(np.float64), truth.albedo[both]
    match = float(true_albedo.mean() / albedo.mean()) if albedo.mean() > 0 else math.nan
    missed = truth.mask & ~surface.mask
    charged_albedo = np.concatenate([albedo - true_albedo, -truth.albedo[missed]])
    rough_error = np.abs(surface.roughness[both].astype(np.float64) - truth.roughness[both])
    worst_rough = np.maximum(truth.roughness[missed], 1 - truth.roughness[missed])

    depth, true_depth = surface.depth[both].astype(np.float64), truth.depth[both]
    known = depth > 0
    scale = float(np.median(true_depth[known] / depth[known])) if known.any() else math.nan
    depth_error = np.abs(scale * depth[known] - true_depth[known])
    relief = float(np.subtract(*np.percentile(truth.depth[truth.mask], [95, 5])))

    return Evaluation(
        truth_pixels=asked,
        unanswered_pixels=lacking,
        extra_pixels=int((surface.mask & ~truth.mask).sum()),
        coverage=answered / asked,
        iou=_iou(surface.mask, truth.mask),
        normal_mean_deg=float(angle.mean()),
        normal_median_deg=float(np.median(angle)),
        normal_mean_charged_deg=float((angle.sum() + 90.0 * lacking) / asked),
        albedo_psnr_db=psnr(albedo - true_albedo),
        albedo_psnr_matched_db=psnr(match * albedo - true_albedo),
        albedo_psnr_charged_db=psnr(charged_albedo),
        albedo_match=match,
        roughness_mae=float(rough_error.mean()),
        roughness_mae_charged=float((rough_error.sum() + worst_rough.sum()) / asked),
        depth_scale=scale,
        depth_relative_median=float(np.median(depth_error / true_depth[known])) if known.any() else math.nan,
        depth_relief_median=float(np.median(depth_error) / relief)
        if known.any() and relief > 0
        else math.nan,
        normal_in_band=_in_band(np.radians(angle), surface.stderr_normal[both], NORMAL_BAND),
        albedo_in_band=_in_band(np.abs(albedo - true_albedo), surface.stderr_albedo[both][:, None]),
        roughness_in_band=_in_band(rough_error, surface.stderr_roughness[both]),
    )


def evaluate_poses(poses: Poses, true_cam_from_world: Float[np.ndarray, "n 3 4"]) -> PoseEvaluation:
    """Hold estimated poses against true ones, view by view in the same order.

    The two worlds differ by a similarity. Positions are compared after the least-squares one over camera
    centres. Rotations are compared after the mean turn between the two worlds, taken from the rotations
    themselves, so that a short or straight path does not blur them.

    Raises:
        TruthError: the numbers of views differ, or fewer than 3 views are registered.
    """
    if len(poses.cam_from_world) != len(true_cam_from_world):
        raise TruthError(
            f"the truth has {len(true_cam_from_world)} poses, the session {len(poses.cam_from_world)} views;"
            " evaluate against the truth of the same photographs"
        )
    seen = poses.registered
    if seen.sum() < 3:
        raise TruthError(f"only {int(seen.sum())} views are registered; poses can be compared from 3 on")
    estimate, true = poses.cam_from_world[seen], true_cam_from_world[seen]
    centres, true_centres = _centres(estimate), _centres(true)
    scale, truth_from_estimate = align_similarity(centres, true_centres)
    aligned = scale * centres @ truth_from_estimate[:, :3].T + truth_from_estimate[:, 3]
    all_centres = _centres(true_cam_from_world)
    extent = float(np.linalg.norm(all_centres[:, None] - all_centres[None], axis=-1).max())
    off = np.linalg.norm(aligned - true_centres, axis=-1)

    # cam_from_truth = cam_from_estimate @ estimate_from_truth: the mean of what each view says of the last.
    turns = np.swapaxes(estimate[:, :, :3], 1, 2) @ true[:, :, :3]
    u, _, vt = np.linalg.svd(turns.sum(0))
    estimate_from_truth = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    rest = estimate[:, :, :3] @ estimate_from_truth @ np.swapaxes(true[:, :, :3], 1, 2)
    rotation = np.degrees(_rotation_angle(rest))
    return PoseEvaluation(
        views=len(seen),
        registered=int(seen.sum()),
        registered_share=float(seen.mean()),
        rotation_median_deg=float(np.median(rotation)),
        rotation_max_deg=float(rotation.max()),
        position_median_percent=float(100 * np.median(off) / extent) if extent > 0 else math.nan,
        position_max_percent=float(100 * off.max() / extent) if extent > 0 else math.nan,
        extent=extent,
        scale=scale,
    )


def evaluate_mask(mask: Bool[np.ndarray, "h w"], true_mask: Bool[np.ndarray, "hh ww"]) -> MaskEvaluation:
    """Hold an object mask against the true one.

    Raises:
        TruthError: sizes differ, or one mask has no outline (empty, or the whole image).
    """
    if mask.shape != true_mask.shape:
        raise TruthError(
            f"the true mask is {_size(true_mask)} pixels, the mask {_size(mask)}; use the same photographs"
        )
    outline, true_outline = _outline(mask), _outline(true_mask)
    if len(outline) == 0 or len(true_outline) == 0:
        raise TruthError("a mask without outline (empty, or the whole image) cannot be compared")
    there, _ = KDTree(true_outline).query(outline)
    back, _ = KDTree(outline).query(true_outline)
    return MaskEvaluation(
        iou=_iou(mask, true_mask), boundary_mean_px=float((np.mean(there) + np.mean(back)) / 2)
    )


def psnr(error: Float[np.ndarray, "n c"]) -> float:
    """Decibels against a peak of 1; infinite when there is no error."""
    mse = float(np.mean(error**2))
    return -10 * math.log10(mse) if mse > 0 else math.inf


def _in_band(error: np.ndarray, stderr: np.ndarray, band: float = BAND) -> float:
    return float((error <= band * stderr).mean())


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / max(int((a | b).sum()), 1))


def _outline(mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "n 2"]:
    """Midpoints (x, y) of the pixel edges between inside and outside."""
    row, column = np.nonzero(mask[:, 1:] != mask[:, :-1])
    upright = np.stack([column + 1.0, row + 0.5], axis=-1)
    row, column = np.nonzero(mask[1:] != mask[:-1])
    level = np.stack([column + 0.5, row + 1.0], axis=-1)
    return np.concatenate([upright, level])


def _centres(cam_from_world: Float[np.ndarray, "n 3 4"]) -> Float[np.ndarray, "n 3"]:
    return -np.einsum("nji,nj->ni", cam_from_world[:, :, :3], cam_from_world[:, :, 3])


def _rotation_angle(rotations: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, " n"]:
    """Radians; from |R - I| = 2 sqrt(2) sin(angle / 2), which keeps small angles exact."""
    chord = np.linalg.norm(rotations - np.eye(3), axis=(-2, -1))
    return 2 * np.arcsin(np.clip(chord / math.sqrt(8), 0, 1))


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]} x {image.shape[0]}"


def _finite(facts: dict) -> dict[str, float | int | None]:
    return {key: value if math.isfinite(value) else None for key, value in facts.items()}
