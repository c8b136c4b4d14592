"""Damped Gauss-Newton on every pixel's own six unknowns: normal (2), albedo (3), roughness (1).

A pixel of the object's rim holds a share b of what is photographed beside it, which is a seventh unknown and is eliminated
from the systems that others see.

Residual: log((I + eps) / ((1 - b) (a D + S) + b I_beside + eps)) per view and channel, weighted by its variance and by a Cauchy
weight whose width is the pixel's own spread of residuals, so that views with a passing shadow or a
highlight the model misses count little. Marquardt damping per pixel; a step that does not lower the misfit
is taken back. Albedo is solved as its logarithm. Derivatives of D and S by forward differences of the rows.
"""

import itertools
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeGuard, no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from engine.geometry import angle_between, tangents
from engine.parallel import abreast, each
from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.rendering.transport import LightTransport, SurfaceGeometry, TransportModel

STEP = 0.01
"""Forward-difference step: radians of normal, units of roughness."""
ROUGHNESS = (0.06, 1.0)
ALBEDO = (0.004, 1.0)
SHARE = (0.0, 0.8)
SHARE_SPREAD = 0.3
"""Of a weak prior, one observation's worth, around no share at all."""
OF_MEDIAN = 1.4826
"""A normal distribution's spread over its median deviation."""


@dataclass(frozen=True, slots=True)
class GaussNewtonConfig:
    """Steps are of two tilts (radians), the logarithms of albedo (3), roughness and the share of the background. The tolerance
    is a tenth, or so, of the errors that are left: shorter ones are not worth the rows they take."""

    step_tolerance: tuple[float, ...] = (math.radians(0.05),) * 2 + (1e-3,) * 3 + (2e-3,) * 2
    max_step: tuple[float, ...] = (0.3,) * 2 + (0.7,) * 3 + (0.2,) * 2  # beyond, nothing is linear
    lambda_initial: float = 1e-2  # damping of a pixel that has not stepped yet,
    lambda_down: float = 0.3  # times this after a step that was worth it,
    lambda_up: float = 6.0  # and this after one that was not,
    lambda_bounds: tuple[float, float] = (1e-4, 1e4)  # within these
    ridge: float = 1e-6  # on a system's diagonal, damped or not: nothing divides by zero
    jacobian_reuse_step: float = 0.03  # up to it (radians, roughness) derivatives are left as they were
    max_light_ratio: float = 5.0  # of a pixel's own to the shared, which may be next to nothing
    least_residual_scale: float = 0.3  # what no pixel's residuals fall below
    grazing_cosine: float = 0.03  # to the camera: from here on a normal is one that can be seen
    roughness_prior: tuple[float, float] = (0.5, 0.25)  # mean and spread, where nothing is known


CONFIG = GaussNewtonConfig()


@dataclass(frozen=True, slots=True, eq=False)
class PixelEstimate:
    """Where the iteration stands; arrays over pixels in mask order."""

    normals: Float[np.ndarray, "p 3"]
    albedo: Float[np.ndarray, "p 3"]
    roughness: Float[np.ndarray, " p"]
    background_fraction: Float[np.ndarray, " p"]  # of what is beside the object in what a pixel photographed
    residual_scale: Float[np.ndarray, " p"]  # robust standard deviation of the weighted residuals
    lm_lambda: Float[np.ndarray, " p"]
    cost: Float[np.ndarray, " p"]  # robust misfit at the accepted state
    hessian: Float[np.ndarray, "p 6 6"]  # J^T W J at the accepted state, the share eliminated
    gradient: Float[np.ndarray, "p 6"]
    roughness_prior: Float[np.ndarray, "p 2"]  # mean and spread of the roughness that is expected

    def copy(self) -> "PixelEstimate":
        """The same in arrays of its own."""
        return PixelEstimate(*(getattr(self, name).copy() for name in PixelEstimate.__slots__))

    def part(self, pixels: Int[np.ndarray, " k"]) -> "PixelEstimate":
        """The same of a few pixels."""
        return PixelEstimate(*(getattr(self, name)[pixels] for name in PixelEstimate.__slots__))

    def begun_anew(self, **changes: np.ndarray) -> "PixelEstimate":
        """The same, some of it changed, with no misfit known and no step tried yet."""
        count = len(self.cost)
        fresh = {"cost": np.full(count, np.inf), "lm_lambda": np.full(count, CONFIG.lambda_initial)}
        return replace(self, **fresh, **changes)


def where(first: Bool[np.ndarray, " p"], one: PixelEstimate, other: PixelEstimate) -> PixelEstimate:
    """Of every pixel the one state where `first`, else the other."""
    return PixelEstimate(*(
        np.where(first.reshape(-1, *[1] * (x.ndim - 1)), x, y)
        for x, y in ((getattr(one, name), getattr(other, name)) for name in PixelEstimate.__slots__)
    ))  # fmt: skip


def medoid(states: Sequence[PixelEstimate]) -> PixelEstimate:
    """Of every pixel the state whose normal is nearest to those of all."""
    apart = np.array([[angle_between(one.normals, other.normals) for other in states] for one in states])
    chosen, nearest = states[0], apart.sum(axis=1).argmin(axis=0)
    for k, state in enumerate(states):
        chosen = where(nearest == k, state, chosen)
    return chosen


def initial_estimate(
    normals: Float[np.ndarray, "p 3"], albedo: Float[np.ndarray, "p 3"], roughness: Float[np.ndarray, " p"]
) -> PixelEstimate:
    """A state with no misfit known yet."""
    count = len(normals)
    return PixelEstimate(
        normals, np.clip(albedo, *ALBEDO), np.clip(roughness, *ROUGHNESS), np.zeros(count), np.full(count, np.nan),
        np.full(count, CONFIG.lambda_initial), np.full(count, np.inf), np.zeros((count, 6, 6)), np.zeros((count, 6)),
        np.tile(CONFIG.roughness_prior, (count, 1)),
    )  # fmt: skip


def rotate_normals(
    normals: Float[np.ndarray, "p 3"], steps: Float[np.ndarray, "p 2"]
) -> Float[np.ndarray, "p 3"]:
    """Normals moved by `steps` radians along their tangents."""
    first, second = tangents(normals)
    moved = normals + first * steps[:, :1] + second * steps[:, 1:]
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


@dataclass(frozen=True, slots=True, eq=False)
class PixelProblem:
    """Some pixels under a light, as they were photographed."""

    transport: TransportModel
    geometry: SurfaceGeometry
    blocks: list[Int[np.ndarray, " _"]]  # pixels that share products with one light
    observations: Observations


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Of the seven unknowns of some pixels, the last the share of the background; maybe by groups of views."""

    cost: Float[np.ndarray, " p *g"]
    hessian: Float[np.ndarray, "p *g 7 7"]  # J^T W J
    gradient: Float[np.ndarray, "p *g 7"]  # J^T W e


def update_residual_scale(state: PixelEstimate, problem: PixelProblem) -> PixelEstimate:
    """Measure each pixel's residual spread and forget its old misfit (the objective changed)."""
    spread = np.empty(len(state.normals))

    def measure(pixels: Int[np.ndarray, " _"]) -> None:
        at, seen = state.part(pixels), problem.observations.part(pixels)
        block = problem.transport.block(problem.geometry, pixels)
        answers = problem.transport(block, at.normals[:, None], at.roughness[:, None])
        spread[pixels] = _residual_scale(answers, at, seen)

    deque(abreast(measure, problem.blocks), 0)
    return replace(state, residual_scale=spread, cost=np.full(len(spread), np.inf))


def _residual_scale(answers, at, seen, config=CONFIG):
    """Of the residuals of the answers' first variants, that of the state itself."""
    diffuse, specular = (x[:, 0] for x in answers)
    eps = seen.eps[:, None]
    model = diffuse * np.tile(at.albedo, diffuse.shape[1] // 3) + specular
    mixed = np.nonzero(seen.row >= 0)[0]
    share = at.background_fraction[mixed, None]
    model[mixed] += share * (seen.beside[seen.row[mixed]] - model[mixed])
    logs = np.log((seen.radiance + eps) / (np.maximum(model, 0) + eps))
    residual = np.sort(np.abs(np.where(seen.weight > 0, logs * np.sqrt(seen.weight), np.nan)), axis=1)
    known = np.isfinite(residual).sum(1)  # those that are not stand last
    middle = np.stack([(known - 1) // 2, known // 2], 1).clip(0)
    spread = OF_MEDIAN * np.take_along_axis(residual, middle, 1).mean(1)
    return np.maximum(np.nan_to_num(spread, nan=1.0), config.least_residual_scale)


def perturbed(
    normals: Float[np.ndarray, "p 3"], roughness: Float[np.ndarray, " p"]
) -> tuple[Float[np.ndarray, "p 4 3"], Float[np.ndarray, "p 4"]]:
    """What forward differences need of each pixel: itself, leaning both ways, and rougher by `roughness_step`."""
    first, second = tangents(normals)
    leaning = np.stack([normals, normals + STEP * first, normals + STEP * second, normals], 1)
    leaning /= np.linalg.norm(leaning, axis=2, keepdims=True)
    return leaning, np.stack([roughness] * 3 + [roughness + roughness_step(roughness)], 1)


def roughness_step(roughness: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """The signed step of a forward difference: inwards at the upper bound."""
    return np.where(roughness + STEP > ROUGHNESS[1], -STEP, STEP)


def on_other_device(transport: TransportModel) -> TypeGuard[LightTransport]:
    """Whether these are solved on another device than the processor."""
    return isinstance(transport, LightTransport) and transport.device != "cpu"


def minimize(
    state: PixelEstimate,
    problem: PixelProblem,
    steps: int,
    progress: Progress,
    reset_scale: bool = False,
    config: GaussNewtonConfig = CONFIG,
) -> PixelEstimate:
    """Up to `steps` evaluations of every pixel with a damped step between them; ends on an accepted state.

    A pixel whose next step would be less than `step_tolerance` is left where it is. `reset_scale`: after an `update_residual_scale`,
    which costs nothing here.
    """
    transport = problem.transport
    if on_other_device(transport):
        from engine.surface.optimize import gauss_newton_cuda  # torch takes seconds to load

        return gauss_newton_cuda.minimize(state, problem, transport, steps, progress, reset_scale, config)
    kept, count = state.copy(), len(state.normals)
    # Of the share of the background, which the systems of `kept` have eliminated: its row and its slope.
    tie = np.zeros((count, 7)), np.zeros(count)

    def solve(pixels: Int[np.ndarray, " _"]) -> None:
        block = transport.block(problem.geometry, pixels)
        at, seen = kept.part(pixels), problem.observations.part(pixels)
        told = _evaluate(transport, block, at, steps > 1)
        for turn in range(steps):
            if reset_scale and turn == 0:
                kept.residual_scale[pixels] = _residual_scale(told.variants, at, seen, config)
                kept.cost[pixels] = np.inf
            at = replace(at, residual_scale=kept.residual_scale[pixels])
            _keep_better(kept, tie, pixels, at, _normal_equations(told.variants, at, seen), config)
            if turn + 1 == steps:
                break
            move = _damped_step(kept, tie, pixels, config)
            moving = np.nonzero((np.abs(move) > config.step_tolerance).any(1))[0]
            if not len(moving):
                break
            if len(moving) < len(pixels):
                pixels, move, at = pixels[moving], move[moving], at.part(moving)
                block, told, seen = block.part(moving), told.part(moving), seen.part(moving)
            before, at = at, _moved(kept.part(pixels), move, block.geometry.views, config)
            far = np.linalg.norm(at.normals - before.normals, axis=1) > config.jacobian_reuse_step
            far |= np.abs(at.roughness - before.roughness) > config.jacobian_reuse_step
            far |= roughness_step(at.roughness) != roughness_step(before.roughness)
            _update_evaluations(transport, block, at, told, far, config)

    each(solve, problem.blocks, progress, "solving pixels")
    return kept


def _keep_better(kept, tie, pixels, at, found, config):
    """Of the pixels that are better `at` where they were tried than as `kept`, keep that; and the damping of all of them."""
    better = found.cost <= kept.cost[pixels]
    won, lost = pixels[better], pixels[~better]
    for name in ("normals", "albedo", "roughness", "background_fraction"):
        getattr(kept, name)[won] = getattr(at, name)[better]
    kept.cost[won] = found.cost[better]
    kept.hessian[won], kept.gradient[won] = eliminate_last(found.hessian[better], found.gradient[better])
    tie[0][won], tie[1][won] = found.hessian[better, 6], found.gradient[better, 6]
    least, most = config.lambda_bounds
    kept.lm_lambda[won] = np.maximum(kept.lm_lambda[won] * config.lambda_down, least)
    kept.lm_lambda[lost] = np.minimum(kept.lm_lambda[lost] * config.lambda_up, most)


def _damped_step(kept, tie, pixels, config):
    """Of all seven unknowns of some pixels."""
    system, longest = kept.hessian[pixels], np.array(config.max_step)
    diagonal = np.einsum("pii->pi", system)
    damped = system + np.eye(6) * (diagonal * kept.lm_lambda[pixels][:, None] + config.ridge)[:, None]
    move = np.linalg.solve(damped, kept.gradient[pixels][..., None])[..., 0]
    move = np.clip(move, -longest[:6], longest[:6])
    row, slope = tie[0][pixels], tie[1][pixels]
    # Unknown, and then nothing, where not even the first evaluation was an improvement.
    stiff = np.where(row[:, 6] > 0, row[:, 6], np.inf)
    shift = (slope - (row[:, :6] * move).sum(1)) / stiff
    return np.clip(np.column_stack([move, shift]), -longest, longest)


def _moved(at, move, views, config):
    """Where a step leads to, within bounds and facing the camera."""
    return replace(
        at,
        normals=clamp_to_visible(rotate_normals(at.normals, move[:, :2]), views, config),
        albedo=np.clip(at.albedo * np.exp(move[:, 2:5]), *ALBEDO),
        roughness=np.clip(at.roughness + move[:, 5], *ROUGHNESS),
        background_fraction=np.clip(at.background_fraction + move[:, 6], *SHARE),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Evaluations:
    """What some pixels of a block answer: diffuse, specular."""

    variants: tuple[Float[np.ndarray, "p 4 v"], ...]
    shared: tuple[Float[np.ndarray, "p v"], ...]  # the first to the light that all of the block share

    def part(self, pixels: Int[np.ndarray, " k"]) -> "_Evaluations":
        """The same of a few of them."""
        return _Evaluations(tuple(x[pixels] for x in self.variants), tuple(x[pixels] for x in self.shared))

    def put(self, pixels: Int[np.ndarray, " k"], other: "_Evaluations") -> None:
        """Take what is told of a few of them."""
        for into, x in zip((*self.variants, *self.shared), (*other.variants, *other.shared), strict=True):
            into[pixels] = x


def _evaluate(transport, block, at, more):
    """All of it; what is shared only if `more` follows."""
    answers = shared = transport(block, *perturbed(at.normals, at.roughness))
    if more and len(block.light.modes):
        shared = _evaluate_shared(transport, block, at)
    return _Evaluations(answers, tuple(x[:, 0].copy() for x in shared))


def _evaluate_shared(transport, block, at):
    leaning, rough = perturbed(at.normals, at.roughness)
    return transport(block.under(block.light.mean), leaning[:, :1], rough[:, :1])


def _update_evaluations(transport, block, at, told, far, config):
    """Bring it to where a step has led. Of pixels that did not go `far` only what the first variant answers to the shared light is
    asked anew, which is a fifth of the work: their variants differ as before, their own light from the shared as many times."""
    near, some = np.nonzero(~far)[0], np.nonzero(far)[0]
    if len(near):
        which = slice(None) if not len(some) else near
        answers = _evaluate_shared(
            transport, *((block, at) if not len(some) else (block.part(near), at.part(near)))
        )
        for into, shared, x in zip(told.variants, told.shared, answers, strict=True):
            before = shared[which]
            times = np.divide(into[which, 0], before, out=np.ones_like(before), where=before > 0)
            into[which] += ((x[:, 0] - before) * np.minimum(times, config.max_light_ratio))[:, None]
            shared[which] = x[:, 0]
    if len(some):
        told.put(some, _evaluate(transport, block.part(some), at.part(some), True))


def eliminate_last(
    system: Float[np.ndarray, "*p 7 7"], slope: Float[np.ndarray, "*p 7"]
) -> tuple[Float[np.ndarray, "*p 6 6"], Float[np.ndarray, "*p 6"]]:
    """A system and slope whose last unknown, the share, is eliminated."""
    tie = system[..., :6, 6] / system[..., 6:, 6]
    left = system[..., :6, :6] - tie[..., None] * system[..., 6:, :6]
    return left, slope[..., :6] - tie * slope[..., 6:]


def hessians_by_view_group(
    state: PixelEstimate, problem: PixelProblem, count: int, progress: Progress
) -> tuple[PixelEstimate, NormalEquations]:
    """The state after a `update_residual_scale`, and its normal equations parted by stretches of `g` = `count` views in a row; each
    bears its share of the priors."""
    pixels_in_all, columns = len(state.normals), problem.observations.radiance.shape[1]
    ends = np.linspace(0, columns // 3, count + 1).astype(int) * 3
    found = NormalEquations(*(np.empty((pixels_in_all, count, *shape)) for shape in ((), (7, 7), (7,))))
    spread, doing = np.empty(pixels_in_all), "judging the answer by parts of the views"
    state = replace(state, residual_scale=spread, cost=np.full(pixels_in_all, np.inf))

    def judge(pixels: Int[np.ndarray, " _"]) -> None:
        at, seen = state.part(pixels), problem.observations.part(pixels)
        block = problem.transport.block(problem.geometry, pixels)
        answers = problem.transport(block, *perturbed(at.normals, at.roughness))
        spread[pixels] = _residual_scale(answers, at, seen)
        at = replace(at, residual_scale=spread[pixels])
        for k, (begin, end) in enumerate(itertools.pairwise(ends)):
            every = *answers, seen.radiance, seen.weight, seen.beside
            *some, radiance, weight, beside = (np.ascontiguousarray(x[..., begin:end]) for x in every)
            group = replace(seen, radiance=radiance, weight=weight, beside=beside)
            told = _normal_equations(some, at, group, 1 / count)
            for name in NormalEquations.__slots__:
                getattr(found, name)[pixels, k] = getattr(told, name)

    if on_other_device(problem.transport):
        from engine.surface.optimize import gauss_newton_cuda  # as above

        gauss_newton_cuda.hessians_by_view_group(
            state, problem, problem.transport, ends, found, progress, doing
        )
    else:
        each(judge, problem.blocks, progress, doing)
    return state, found


def jacobian(
    diffuse: Float[np.ndarray, "p 4 v"],
    specular: Float[np.ndarray, "p 4 v"],
    albedo: Float[np.ndarray, "p 3"],
    step: Float[np.ndarray, " p"],
    eps: Float[np.ndarray, " p"],
) -> tuple[Float[np.ndarray, "p v"], Float[np.ndarray, "p v 6"]]:
    """What the answers to `perturbed` send, with eps, and how its logarithm follows each of the unknowns."""
    colour = np.tile(albedo, diffuse.shape[2] // 3)
    model = colour[:, None] * diffuse + specular
    base = np.maximum(model[:, 0], 0) + eps[:, None]
    own = np.zeros((*base.shape, 6))
    own[..., 0] = (model[:, 1] - model[:, 0]) / (STEP * base)
    own[..., 1] = (model[:, 2] - model[:, 0]) / (STEP * base)
    own[..., 5] = (model[:, 3] - model[:, 0]) / (step[:, None] * base)
    for c in range(3):
        own[:, c::3, 2 + c] = (colour * diffuse[:, 0] / base)[:, c::3]
    return base, own


def with_ridge(system: Float[np.ndarray, "p u u"]) -> Float[np.ndarray, "p u u"]:
    """The system with so much on its diagonal that it can be inverted."""
    return system + (1e-9 * np.einsum("pii->p", system)[:, None, None] + 1e-12) * np.eye(system.shape[-1])


def clamp_to_visible(normals, views, config=CONFIG):
    """Turn normals that look away from the camera back to grazing; such a point could not be seen."""
    cosine = (normals * views).sum(-1, keepdims=True)
    fixed = normals + views * np.maximum(config.grazing_cosine - cosine, 0)
    return fixed / np.linalg.norm(fixed, axis=-1, keepdims=True)


@numba.njit(nogil=True, cache=True, fastmath=True, error_model="numpy")
@no_type_check
def _ratios(diffuse, specular, albedo, radiance, eps, share, row, beside):
    """What was photographed over what the state sends, eps included."""
    out = np.empty(radiance.shape, np.float32)
    for p in range(len(out)):
        part, mixed, q = np.float32(share[p]), row[p] >= 0, max(row[p], 0)
        for c in range(3):
            a = np.float32(albedo[p, c])
            for v in range(c, out.shape[1], 3):
                model = a * diffuse[p, 0, v] + specular[p, 0, v]
                if mixed:
                    model += part * (beside[q, v] - model)
                out[p, v] = (radiance[p, v] + eps[p]) / (max(model, np.float32(0)) + eps[p])
    return out


def _normal_equations(answers, at, seen, prior=1.0):
    """At a state, of what its `perturbed` variants answer."""
    diffuse, specular = answers
    # Numpy takes logarithms a vector at a time, a kernel of ours one by one.
    logs = _ratios(
        diffuse, specular, at.albedo, seen.radiance, seen.eps, at.background_fraction, seen.row, seen.beside
    )
    np.log(logs, out=logs)
    return NormalEquations(*_equations(
        diffuse, specular, logs, at.albedo, roughness_step(at.roughness), seen.weight, seen.eps, at.residual_scale,
        seen.cauchy, at.roughness, at.roughness_prior, at.background_fraction, seen.row, seen.beside, prior,
    ))  # fmt: skip


@numba.njit(nogil=True, cache=True, fastmath=True, error_model="numpy")
@no_type_check
def _equations(
    diffuse, specular, logs, albedo, inward, weight, eps, spread, cauchy, roughness, gloss, share, row, beside,
    prior,
):  # fmt: skip
    count, _, channels = diffuse.shape
    at_once = 3 * 16  # residuals whose share of the misfit is summed as the logarithm of a product
    misfit = np.zeros(count)
    system = np.zeros((count, 7, 7))
    slope = np.zeros((count, 7))
    for p in range(count):
        width = (cauchy * spread[p]) ** 2
        tilt_step, rough_step = np.float32(1 / STEP), np.float32(1) / np.float32(inward[p])
        d, s = diffuse[p], specular[p]
        mixed, q = row[p] >= 0, max(row[p], 0)
        own, part = np.float32(1) - np.float32(share[p]), np.float32(share[p])
        total = 0.0
        for c in range(3):
            a = np.float32(albedo[p, c])
            # One channel sees four unknowns: two tilts, its own albedo, roughness.
            h00 = h01 = h02 = h03 = h11 = h12 = h13 = h22 = h23 = h33 = 0.0
            g0 = g1 = g2 = g3 = 0.0
            h04 = h14 = h24 = h34 = h44 = g4 = 0.0
            # The product of a few is within the numbers' range, and has one logarithm; without its one, so that small ratios count.
            for begin in range(c, channels, at_once):
                excess = 0.0
                for v in range(begin, min(begin + at_once, channels), 3):
                    w = weight[p, v]
                    model = a * d[0, v] + s[0, v]
                    other = np.float32(0)
                    if mixed:
                        other = beside[q, v] - model
                        model += part * other
                    over = np.float32(1) / (max(model, np.float32(0)) + eps[p])
                    other *= over
                    e = logs[p, v]
                    ratio = w * e * e / width
                    excess += ratio + excess * ratio
                    robust = w / (1 + ratio)
                    over *= own
                    j0 = (a * (d[1, v] - d[0, v]) + s[1, v] - s[0, v]) * over * tilt_step
                    j1 = (a * (d[2, v] - d[0, v]) + s[2, v] - s[0, v]) * over * tilt_step
                    j2 = a * d[0, v] * over
                    j3 = (a * (d[3, v] - d[0, v]) + s[3, v] - s[0, v]) * over * rough_step
                    g0 += robust * j0 * e
                    g1 += robust * j1 * e
                    g2 += robust * j2 * e
                    g3 += robust * j3 * e
                    h00 += robust * j0 * j0
                    h01 += robust * j0 * j1
                    h02 += robust * j0 * j2
                    h03 += robust * j0 * j3
                    h11 += robust * j1 * j1
                    h12 += robust * j1 * j2
                    h13 += robust * j1 * j3
                    h22 += robust * j2 * j2
                    h23 += robust * j2 * j3
                    h33 += robust * j3 * j3
                    if mixed:
                        g4 += robust * other * e
                        h04 += robust * j0 * other
                        h14 += robust * j1 * other
                        h24 += robust * j2 * other
                        h34 += robust * j3 * other
                        h44 += robust * other * other
                total += math.log1p(excess)
            k = 2 + c
            slope[p, 0] += g0
            slope[p, 1] += g1
            slope[p, k] = g2
            slope[p, 5] += g3
            system[p, 0, 0] += h00
            system[p, 0, 1] += h01
            system[p, 1, 1] += h11
            system[p, 0, 5] += h03
            system[p, 1, 5] += h13
            system[p, 5, 5] += h33
            system[p, 0, k] = h02
            system[p, 1, k] = h12
            system[p, k, k] = h22
            system[p, k, 5] = h23
            slope[p, 6] += g4
            system[p, 0, 6] += h04
            system[p, 1, 6] += h14
            system[p, k, 6] = h24
            system[p, 5, 6] += h34
            system[p, 6, 6] += h44
        spread_r = gloss[p, 1]
        off = (roughness[p] - gloss[p, 0]) / spread_r
        misfit[p] = width * total + prior * off * off * spread[p] ** 2
        slope[p, 5] -= prior * off / spread_r * spread[p] ** 2
        system[p, 5, 5] += prior * (spread[p] / spread_r) ** 2
        off = share[p] / SHARE_SPREAD
        misfit[p] += prior * off * off * spread[p] ** 2
        slope[p, 6] -= prior * off / SHARE_SPREAD * spread[p] ** 2
        system[p, 6, 6] += prior * (spread[p] / SHARE_SPREAD) ** 2
        for k in range(7):
            for j in range(k):
                system[p, k, j] = system[p, j, k]
    return misfit, system, slope
