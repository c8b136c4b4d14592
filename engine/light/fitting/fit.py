"""Fit the room's light to the background of the photographs: stage *light*.

Source: the paper, Sec. 3.2: stage 1 is Eq. (5) by Adam, coarse to fine, on a budget of Gaussians;
stage 2 is the colour solve of `color_solve.py`. World frame, scene units, linear radiance.

Held-out views judge the fit: they supervise neither stage. A Gaussian looks the same from every side.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from engine.color import luminance
from engine.errors import LightError
from engine.light.fitting.adam import GaussianOptimizer, gaussians_of, optimizer_of, relocate, step
from engine.light.fitting.color_solve import is_bright, linear_renders, solve_colours
from engine.light.fitting.free_space import FreeSpace, free_depth, inside_free_space, unsupported
from engine.light.fitting.initialize import initial_gaussians
from engine.light.fitting.lamp_detection import LampDetections, find_lamps
from engine.light.fitting.lamp_model import insert_lamps, mask_lamps, measure_lamps
from engine.light.fitting.params import LightParams
from engine.light.fitting.plane_sweep import knee_of
from engine.light.fitting.training_views import Photographs, camera_centres, resample
from engine.light.gaussians.gaussians import Y00, radiance_towards
from engine.light.gaussians.rasterize import ThreadPool, backward, render, shapes, thread_pool
from engine.light.gaussians.rasterize_kernels import DARKEST
from engine.progress import Progress
from engine.sampling import evenly_spaced
from engine.types import Frames, Gaussians, Lamps, Masks, Poses


@dataclass(frozen=True, slots=True)
class LightReport:
    """What the fit reached; held-out numbers are over background pixels of views that did not supervise."""

    count: int
    keep_out: float  # scene units
    knee: float  # radiance that Eq. (5) takes for 1
    heldout_log_l1: float
    heldout_psnr_db: float  # of log(1 + m), against its range
    heldout_energy: float  # rendered over photographed, all background pixels
    heldout_energy_bright: float  # the same, brightest 1 % of pixels
    training_log_l1: float
    lamps: int  # small bright things that were found beforehand and stand apart from the fit
    lamps_clipped: int  # those whose radiance is a lower bound
    views_used: int
    views_heldout: int


def fit(
    frames: Frames, masks: Masks, poses: Poses, params: LightParams, seed: int, progress: Progress
) -> tuple[Gaussians, Lamps, LightReport]:
    """The room's light from the background pixels of the registered views; its small lamps are the last Gaussians.

    Raises:
        LightError: fewer than 4 registered views, or hardly any background.
    """
    used, held = split_views(poses, params.validation_every)
    widest = min(params.max_image_width, poses.camera.width)
    widths = [max(32, widest >> (len(params.epochs) - 1 - i)) for i in range(len(params.epochs))]
    rng = np.random.default_rng(seed)
    with thread_pool() as run:
        progress.step(0.0, "depth of the room")
        # Many views tell no more of lamps and colours than some of them do, and take more memory.
        some = evenly_spaced(len(used), params.epoch_views)
        sightings, lamps = _lamps(frames, masks, poses, used[some], 4 * params.max_image_width)

        def room(width: int) -> Photographs:
            return mask_lamps(resample(frames, masks, poses, used, width), lamps)

        small = room(min(64, poses.camera.width))
        start, free_space = initial_gaussians(
            small,
            room(widths[-1]),
            poses.points,
            max(500, params.max_gaussians // 3),
            params.camera_clearance,
            run,
        )
        optimizer, photographs = optimizer_of(start), small
        knee = knee_of(small)
        total = sum(p * w * w for p, w in zip(params.epochs, widths, strict=True))
        done, loss = 0.0, np.nan
        everything = sum(params.epochs)
        count = 0
        for passes, width in zip(params.epochs, widths, strict=True):
            photographs = room(width)
            surface = free_depth(free_space, photographs)
            for _ in range(passes):
                progress.step(
                    0.05 + 0.85 * done / total, f"light at {width} px, {len(optimizer.means)} Gaussians"
                )
                rate = 0.05 ** (count / everything)
                loss = _epoch(optimizer, photographs, surface, params, knee, rate, rng, run)
                done, count = done + width * width, count + 1
                optimizer = _relocate(optimizer, photographs, params, free_space, count / everything)
        photographs = photographs.of_views(some)
        gaussians = solve_bright_colours(gaussians_of(optimizer), photographs, progress.part(0.9, 0.96), run)
        gaussians = insert_lamps(gaussians, lamps, sightings, small.of_views(some))
        progress.step(0.98, "light, held-out views")
        judged = resample(frames, masks, poses, held if len(held) else used, widest)
        heldout = evaluate(gaussians, judged, knee, run)
    return (
        gaussians,
        lamps,
        LightReport(
            count=len(gaussians.means),
            keep_out=float(np.median(free_space.radii)),
            knee=knee,
            **heldout,
            training_log_l1=float(loss),
            lamps=len(lamps.radii),
            lamps_clipped=int(lamps.clipped.sum()),
            views_used=len(used),
            views_heldout=len(held),
        ),
    )


def split_views(poses: Poses, holdout: int) -> tuple[Int[np.ndarray, " u"], Int[np.ndarray, " h"]]:
    """Registered views that supervise, and those that only judge: every `holdout`-th if there are enough.

    Raises:
        LightError: fewer than 4 registered views, or none of them left to supervise.
    """
    views = np.nonzero(poses.registered)[0]
    if len(views) < 4:
        raise LightError(
            f"{len(views)} views are registered; the light needs at least 4: photograph more of the room"
        )
    held = views[holdout // 2 :: holdout] if holdout and len(views) >= 2 * holdout else views[:0]
    used = np.setdiff1d(views, held)
    if len(used) < 4:
        raise LightError(
            f"light.validation_every = {holdout} leaves {len(used)} of {len(views)} views for the light, which needs at least 4: "
            "hold out every 8th, or 0 for none"
        )
    return used, held


def _lamps(
    frames: Frames, masks: Masks, poses: Poses, used: np.ndarray, width: int
) -> tuple[LampDetections, Lamps]:
    """The lamps, from photographs that are sharper than those of the fit; they are not kept, for they are as much larger."""
    sharp = resample(frames, masks, poses, used, width)
    return measure_lamps(find_lamps(sharp), sharp)


def solve_bright_colours(
    gaussians: Gaussians, photographs: Photographs, progress: Progress, run: ThreadPool
) -> Gaussians:
    """Stage 2: colours of the bright Gaussians that render the photographed energy.

    Eq. (5) and Eq. (6) take medians of ratios, which dims what is small and much brighter than its
    surroundings, as lamps and windows are: the energy objective of `color_solve.py` does not.
    """
    rows = linear_renders(shapes(gaussians), photographs, run)
    start = gaussians.radiance[:, 0].astype(np.float64) * Y00
    free = is_bright(start)
    colours = solve_colours(
        rows, start, free, "energy", run, step=lambda share: progress.step(share, "colours of the lamps")
    )
    radiance = gaussians.radiance.copy()
    radiance[free, 0] = colours[free] / Y00
    return replace(gaussians, radiance=radiance)


def _epoch(
    optimizer: GaussianOptimizer,
    photographs: Photographs,
    surface: Float[np.ndarray, "n h w"],
    params: LightParams,
    knee: float,
    rate: float,
    rng: np.random.Generator,
    run: ThreadPool,
) -> float:
    """One Adam step per view, in random order; mean log-L1 of the pass."""
    views = rng.permutation(len(photographs.weight))[: params.epoch_views].tolist()
    optimizer.weight[:] = 0
    optimizer.blame[:] = 0
    loss = 0.0
    tree = KDTree(camera_centres(photographs))
    distance = tree.query(optimizer.means)[0]
    smallest, largest = 0.35 * distance / photographs.lens[0], 0.3 * distance
    for view in views:
        _, gradients = backward(
            optimizer.geometry, np.exp(optimizer.log_radiance), photographs.pinhole(view), 0.0,
            photographs.radiance[view], photographs.weight[view], knee, params.opacity_weight, surface[view], run,
        )  # fmt: skip
        loss += gradients.blame.sum() / max(photographs.weight[view].sum(), 1) / 3
        i = gradients.index
        step(optimizer, gradients, rate, smallest[i], largest[i])
    return loss / len(views)


def _relocate(
    optimizer: GaussianOptimizer,
    photographs: Photographs,
    params: LightParams,
    free_space: FreeSpace,
    fraction: float,
) -> GaussianOptimizer:
    """Grow to the budget by three fifths of the way, move the useless until four fifths, then only clear."""
    useless = inside_free_space(free_space, optimizer.means, 2 * np.exp(optimizer.log_scales.max(1)))
    useless |= unsupported(free_space, optimizer.means)
    budget = 0
    if fraction < 0.85:
        useless |= optimizer.weight < 0.3
        grown = min(1.0, fraction / 0.6)
        budget = int(params.max_gaussians * (1 / 3 + 2 / 3 * grown))
        faint = np.argsort(optimizer.weight, kind="stable")[: int(0.02 * len(optimizer.weight))]
        useless[faint] = True
    return relocate(optimizer, budget, useless)


def evaluate(
    gaussians: Gaussians, photographs: Photographs, knee: float, run: ThreadPool
) -> dict[str, float]:
    """The report's `heldout_...`: renderings against photographs, on background pixels that were not clipped."""
    geometry = shapes(gaussians)
    wide = replace(gaussians, radiance=gaussians.radiance.astype(np.float64))
    ours, theirs = [], []
    for view in range(len(photographs.weight)):
        pinhole = photographs.pinhole(view)
        image = render(geometry, radiance_towards(wide, pinhole.origin), pinhole, 0.0, run)
        good = (photographs.weight[view] > 0) & ~photographs.clipped[view]
        ours.append(image[good][:, :3])
        theirs.append(photographs.radiance[view][good])
    m, want = np.concatenate(ours).astype(np.float64), np.concatenate(theirs).astype(np.float64)
    # Noise, or a colour beyond the display's, may put a pixel below black by more than the knee.
    gap = np.log(knee + m) - np.log(np.maximum(knee + want, DARKEST * knee))
    span = np.log(knee + want.max()) - np.log(knee)
    bright = luminance(want) >= np.quantile(luminance(want), 0.99)
    return {
        "heldout_log_l1": float(np.abs(gap).mean()),
        "heldout_psnr_db": float(10 * np.log10(span**2 / (gap**2).mean())),
        "heldout_energy": float(m.sum() / want.sum()),
        "heldout_energy_bright": float(m[bright].sum() / want[bright].sum()),
    }
