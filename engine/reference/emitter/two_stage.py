"""The paper's two-stage training of the emitter, to hold ours against: `engine/light/fitting/fit.py` is what runs.

Source: the paper, Sec. 3.2, Eq. (5) and (6), and "Implementation details": stage 1 has 3DGRT's defaults (`cloud.py`),
stage 2 a rate of 0.1 for the colours, each 30 000 iterations; an iteration is a step of Adam on one view. The
kernels are ours, and so is the profile of a Gaussian that they evaluate (`engine/light/gaussians/raytrace_reference.py`).

What the paper leaves open: the unit of radiance that is the 1 of Eq. (5), here that of our own fit (`knee_of`), and
the epsilon of Eq. (6), here that of our own solve. Clipped pixels are taken at their word. World frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from engine.color import luminance
from engine.errors import LightError
from engine.light.fitting.color_solve import (
    LinearRenders,
    backproject_rows,
    epsilon_of,
    linear_renders,
    otsu_threshold,
    render_rows,
)
from engine.light.fitting.fit import split_views
from engine.light.fitting.initialize import mean_radiance
from engine.light.fitting.plane_sweep import FEW_POINTS, depth_range, knee_of
from engine.light.fitting.training_views import Photographs, camera_centres, resample
from engine.light.gaussians.gaussians import Y00, radiance_towards, sh_basis, sh_degree
from engine.light.gaussians.rasterize import ThreadPool, backward, render, shapes, thread_pool
from engine.progress import Progress
from engine.reference.emitter import cloud as clouds
from engine.reference.params import MOST
from engine.types import Frames, Gaussians, Masks, Poses

_RATE = 0.1  # of stage 2, for the constant term; the other harmonics' is 20 times smaller, as in 3DGRT


@dataclass(frozen=True, slots=True)
class EmitterParams:
    """How the paper trains. Counts are iterations; those not in the paper are 3DGRT's (and 3DGS's) defaults."""

    iterations: int = 30_000  # stage 1
    refinements: int = 30_000  # stage 2
    one_stage: bool = False  # stage 1 alone: the paper's ablation
    width: int = 512  # of the pictures, pixels: the paper's
    holdout: int = 8  # every so many-th view only judges, as in our fit
    degree: int = 3  # of the spherical harmonics, at the end
    degree_every: int = 1000  # from 0, one degree more
    densify_from: int = 500
    densify_until: int = 15_000
    densify_every: int = 300
    prune_every: int = 100
    reset_every: int = 3000
    most: int = MOST  # Gaussians; where they would be more, those pulled hardest go first
    random_points: int = 100_000  # to start from where SfM found next to none


def scaled(share: float, params: EmitterParams | None = None) -> EmitterParams:
    """Every count of iterations times `share`: what the paper does, cut short. Step sizes stay.

    Opacities are reset as rarely as before, as they take as many steps to come back.
    """
    full = params or EmitterParams()
    names = (
        "iterations",
        "refinements",
        "degree_every",
        "densify_from",
        "densify_until",
        "densify_every",
        "prune_every",
    )
    fewer: dict[str, Any] = {name: max(1, round(share * getattr(full, name))) for name in names}
    return replace(full, **fewer)


@dataclass(frozen=True, slots=True)
class EmitterReport:
    """What the training reached on the views that supervised it."""

    count: int
    unit: float  # radiance that Eq. (5) takes for 1
    log_l1: float  # Eq. (5)
    views_used: int


def log_l1(photographed: Float[np.ndarray, "p 3"], rendered: Float[np.ndarray, "p 3"]) -> float:
    """Eq. (5): mean over the pixels, sum over the channels; what noise puts below black counts as black."""
    gap = np.log1p(np.maximum(photographed, 0)) - np.log1p(np.maximum(rendered, 0))
    return float(np.abs(gap).sum(1).mean())


def relative_l1(
    photographed: Float[np.ndarray, "p 3"],
    rendered: Float[np.ndarray, "p 3"],
    epsilon: float,
    frozen: Float[np.ndarray, "p 3"] | None = None,
) -> float:
    """Eq. (6): mean over the pixels, sum over the channels; `frozen` stands for sg(m), `rendered` itself if None.

    The gradient that the paper follows is that of the loss frozen where it is, so it comes to rest at the colours that
    are best when frozen at themselves: to see whether two answers are the same, freeze both at one of them.
    """
    scale = rendered if frozen is None else frozen
    return float((np.abs(photographed - rendered) / (scale + epsilon)).sum(1).mean())


def train(
    frames: Frames, masks: Masks, poses: Poses, params: EmitterParams, seed: int, progress: Progress
) -> tuple[Gaussians, EmitterReport]:
    """The paper's emitter, from the background pixels of the registered views that are not held out.

    Raises:
        LightError: fewer than 4 registered views, or no background.
    """
    used, _ = split_views(poses, params.holdout)
    photographs = supervision(resample(frames, masks, poses, used, params.width))
    rng = np.random.default_rng(seed)
    with thread_pool() as run:
        gaussians = stage_one(photographs, poses.points, params, rng, progress.part(0, 0.6), run)
        if not params.one_stage:
            gaussians = stage_two(gaussians, photographs, params, rng, progress.part(0.6, 1), run)
        unit = knee_of(photographs)
        photographed, rendered = pixels(gaussians, photographs, run)
    loss = log_l1(photographed / unit, rendered / unit)
    return gaussians, EmitterReport(len(gaussians.means), unit, loss, len(used))


def pixels(
    gaussians: Gaussians, photographs: Photographs, run: ThreadPool
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
    """All background pixels, as photographed and as rendered."""
    geometry, rendered = shapes(gaussians), []
    for view, weight in enumerate(photographs.weight):
        pinhole = photographs.pinhole(view)
        image = render(geometry, radiance_towards(gaussians, pinhole.origin), pinhole, 0.0, run)
        rendered.append(image[weight > 0][:, :3])
    return photographs.radiance[photographs.weight > 0], np.concatenate(rendered)


def supervision(photographs: Photographs) -> Photographs:
    """As the paper takes them: a pixel shows the room or does not, and its radiance is what it says."""
    shown = photographs.weight > 0
    return replace(photographs, weight=shown.astype(np.float32), clipped=np.zeros_like(photographs.clipped))


def stage_one(
    photographs: Photographs, points: Float[np.ndarray, "m 3"], params: EmitterParams,
    rng: np.random.Generator, progress: Progress, run: ThreadPool,
) -> Gaussians:  # fmt: skip
    """All parameters by Adam on Eq. (5), cloning, splitting and pruning on the way.

    Raises:
        LightError: no view shows any background.
    """
    shown = photographs.weight.sum((1, 2))  # N_b of each view
    views = np.nonzero(shown)[0]
    if not len(views):
        raise LightError("no view shows any background; mask less or photograph more of the room")
    unit = knee_of(photographs)
    target = (photographs.radiance / np.float32(unit)).astype(np.float32)
    centres = camera_centres(photographs)
    extent = 1.1 * float(np.linalg.norm(centres - centres.mean(0), axis=1).max())  # as 3DGS measures a scene
    cloud = _first(photographs, points, params, unit, rng)
    nothing = np.zeros_like(photographs.weight[0])
    for step, view in zip(range(1, params.iterations + 1), _shuffled(views, rng), strict=False):
        progress.step((step - 1) / params.iterations, f"stage 1, {len(cloud.rows)} Gaussians")
        gaussians, pinhole = clouds.gaussians_of(cloud), photographs.pinhole(view)
        colours = radiance_towards(gaussians, pinhole.origin)
        # With knee 1 and neither charges for what is left through nor for what stands in between, this is Eq. (5).
        _, gradients = backward(
            shapes(gaussians), colours, pinhole, 0.0, target[view], photographs.weight[view] / shown[view],
            1.0, 0.0, nothing, run,
        )  # fmt: skip
        slope = clouds.slopes(cloud, gradients, colours, pinhole.origin)
        rate = clouds.rates(cloud, extent, step / params.iterations)
        clouds.advance(cloud, gradients, slope, rate, pinhole.origin, run)
        cloud = _tended(cloud, step, extent, params, rng)
    trained = clouds.gaussians_of(cloud)
    return replace(trained, radiance=trained.radiance * unit)


def _tended(
    cloud: clouds.Cloud, step: int, extent: float, params: EmitterParams, rng: np.random.Generator
) -> clouds.Cloud:
    """What follows a step now and then."""
    if params.densify_from < step < params.densify_until:
        if step % params.densify_every == 0:
            cloud = clouds.densified(cloud, extent, params.most, rng)
        if step % params.prune_every == 0:
            cloud = clouds.pruned(cloud)
    if step < params.densify_until and step % params.reset_every == 0:
        clouds.make_faint(cloud)
    if step % params.degree_every == 0 and step // params.degree_every <= params.degree:
        cloud = clouds.finer_harmonics(cloud, step // params.degree_every)
    return cloud


def _first(
    photographs: Photographs, points: Float[np.ndarray, "m 3"], params: EmitterParams, unit: float,
    rng: np.random.Generator,
) -> clouds.Cloud:  # fmt: skip
    """From the SfM points; without, from random ones, which for a room around the cameras fill a shell."""
    if len(points) < FEW_POINTS:
        centres = camera_centres(photographs)
        away = rng.normal(size=(params.random_points, 3))
        nearest, farthest = np.log(depth_range(centres, points))
        far = np.exp(rng.uniform(nearest, farthest, (params.random_points, 1)))
        points = centres.mean(0) + far * away / np.linalg.norm(away, axis=1, keepdims=True)
    typical = np.median(photographs.radiance[photographs.weight > 0], axis=0).astype(np.float64)
    return clouds.begin(points, mean_radiance(photographs, points, typical) / unit)


def _shuffled(views: np.ndarray, rng: np.random.Generator) -> Iterator[int]:
    """A random view at a time; none comes again before all have come."""
    while True:
        yield from rng.permutation(views).tolist()


def stage_two(
    gaussians: Gaussians, photographs: Photographs, params: EmitterParams,
    rng: np.random.Generator, progress: Progress, run: ThreadPool,
) -> Gaussians:  # fmt: skip
    """The colours of the bright Gaussians alone, by Adam on Eq. (6)."""
    free = high_luminance(gaussians)
    rows = linear_renders(shapes(gaussians), photographs, run)
    radiance = gaussians.radiance
    steps = descend(gaussians, rows, photographs, free, knee_of(photographs), rng, run)
    for step in range(params.refinements):
        progress.step(step / params.refinements, f"stage 2, {int(free.sum())} bright Gaussians")
        radiance = next(steps)
    return replace(gaussians, radiance=radiance)


def high_luminance(gaussians: Gaussians) -> Bool[np.ndarray, " k"]:
    """Otsu's threshold on the luminance itself, as the paper says; our own solve takes the logarithm's."""
    level = luminance(np.maximum(gaussians.radiance[:, 0] * Y00, 0))
    return level > otsu_threshold(level)


def descend(
    gaussians: Gaussians, rows: LinearRenders, photographs: Photographs, free: Bool[np.ndarray, " k"], unit: float,
    rng: np.random.Generator, run: ThreadPool,
) -> Iterator[Float[np.ndarray, "k b 3"]]:  # fmt: skip
    """Radiance coefficients after each iteration of stage 2, without end; the array is reused.

    With the geometry fixed a rendering is linear in the colours: `rows` hold its weights, view after view, and the
    step is the one that rendering anew would give. `unit` is the radiance that the rate of 0.1 counts in.
    """
    coefficients = gaussians.radiance.astype(np.float64)
    k, b, _ = coefficients.shape
    epsilon = epsilon_of(rows)
    ends = np.cumsum((photographs.weight > 0).sum((1, 2)))
    own = [
        replace(
            rows, begins=rows.begins[begin:end], counts=rows.counts[begin:end],
            photographed=rows.photographed[begin:end], trust=rows.trust[begin:end],
        )
        for begin, end in zip([0, *ends[:-1]], ends, strict=True)
    ]  # fmt: skip
    table = coefficients[free].reshape(-1, 3 * b)
    first, second = np.zeros_like(table), np.zeros_like(table)
    rate = np.repeat(unit * _RATE * np.array([1.0] + [1 / 20] * (b - 1)), 3)
    everyone = np.arange(len(table))
    views = np.nonzero(np.diff(ends, prepend=0))[0]
    for step, view in enumerate(_shuffled(views, rng), 1):
        towards = gaussians.means - photographs.pinhole(view).origin
        towards = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
        basis = sh_basis(towards.astype(np.float64), sh_degree(b))
        colours = np.einsum("kb,kbc->kc", basis, coefficients)
        seen = own[view]
        rendered = np.empty((len(seen.begins), 3))
        render_rows(seen, np.maximum(colours, 0), rendered, run)
        slope = np.sign(rendered - seen.photographed) / (rendered + epsilon) / len(rendered)
        slope = backproject_rows(seen, slope, k, run) * (colours > 0)
        slope = (basis[:, :, None] * slope[:, None, :])[free].reshape(-1, 3 * b)
        clouds.adam(table, first, second, everyone, slope, rate, step, run)
        coefficients[free] = table.reshape(-1, b, 3)
        yield coefficients
