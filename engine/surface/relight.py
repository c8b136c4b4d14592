"""Refine the light together with the surface: one gain per group of emitters and channel.

The background says how bright each part of the room is, within some uncertainty; the object's own shading in
every view says it again. Groups of Gaussians (each lamp its own, the rest by neighbourhood, and what no view
has seen) get a log gain with the background's uncertainty as prior, and gains and pixels are solved in
one Gauss-Newton system whose pixel unknowns are eliminated first (Schur complement): a pixel has six
unknowns, the light a few dozen. A sample of the pixels is enough, since every pixel sees the same light.

Logs throughout: residual log((I + eps) / (model + eps)), unknowns log gain.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from engine.progress import Progress
from engine.surface import newton
from engine.surface.observations import Observations
from engine.surface.transport import Incident, Responses, Sight


@dataclass(frozen=True, slots=True, eq=False)
class Gains:
    """What the shading says about the light, relative to what the background said."""

    gain: Float[np.ndarray, "k 3"]
    stderr: Float[np.ndarray, "k 3"]  # of log gain
    before: float  # median weighted residual spread of the sample
    after: float


def scaled(groups: list[Incident], gain: Float[np.ndarray, "k 3"]) -> Incident:
    """The groups' light, each under its gain, together."""
    total = np.zeros_like(groups[0].energy)
    for group, factor in zip(groups, gain, strict=True):
        total += group.energy * np.tile(factor.astype(np.float32), total.shape[2] // 3)
    return Incident(groups[0].lattice, groups[0].directions, total)


def refine(
    groups: list[Incident],
    prior: Float[np.ndarray, " k"],
    state: newton.State,
    sight: Sight,
    parts: list[Int[np.ndarray, " _"]],
    seen: Observations,
    full_diffuse: bool,
    rounds: int,
    passes: int,
    progress: Progress,
) -> tuple[Gains, newton.State]:
    """Gains of the groups from a sample of pixels (all of `sight`); `prior` is the spread of log gain.

    The spread of the residuals enters as their uncertainty: model errors are shared by neighbouring views, so
    each pixel counts as CORRELATED times fewer observations than it has.
    """
    gain = np.ones((len(groups), 3))
    stderr = np.tile(prior[:, None], (1, 3))
    before = float("nan")
    for turn in range(rounds):
        span = progress.part(turn / rounds, (turn + 1) / rounds)
        responses = Responses(scaled(groups, gain), seen.radiance, full_diffuse, False, "cpu")
        state = newton.respread(state, responses, sight, parts, seen)
        if turn == 0:
            before = float(np.median(state.spread))
        state = newton.iterate(state, responses, sight, parts, seen, passes, span.part(0.0, 0.6))
        step, stderr = _light_step(groups, gain, prior, state, sight, parts, seen, full_diffuse)
        gain = gain * np.exp(np.clip(step, -0.5, 0.5))
        span.step(1.0, "refining the light")
    responses = Responses(scaled(groups, gain), seen.radiance, full_diffuse, False, "cpu")
    state = newton.respread(state, responses, sight, parts, seen)
    return Gains(gain, stderr, before, float(np.median(state.spread))), state


TOTAL = 0.01
"""How well the background fixes the sum of all light, per channel (relative)."""
CORRELATED = 10.0
"""Observations that share one model error; see `refine`."""


def _light_step(groups, gain, prior, state, sight, parts, seen, full_diffuse):
    """One Schur-reduced Gauss-Newton step of the log gains, and their standard errors."""
    count = len(groups)
    system = np.zeros((count * 3, count * 3))
    slope = np.zeros(count * 3)
    total = Responses(scaled(groups, gain), seen.radiance, full_diffuse, False, "cpu")
    each = [Responses(group, seen.radiance, full_diffuse, False, "cpu") for group in groups]
    for pixels in parts:
        n, r, a = state.normals[pixels], state.roughness[pixels], state.albedo[pixels]
        variants, rough, inward = newton.variants(n, r)
        diffuse, specular = total(sight, pixels, variants, rough, total.energy(sight, pixels))
        colour = np.tile(a, diffuse.shape[2] // 3)
        model = colour[:, None] * diffuse + specular  # p 4 v
        base = np.maximum(model[:, 0], 0) + seen.eps[pixels][:, None]
        e = np.log((seen.radiance[pixels] + seen.eps[pixels][:, None]) / base)
        weight = seen.weight[pixels]
        width = (newton.CAUCHY * state.spread[pixels][:, None]) ** 2
        weight = weight / (1 + weight * e * e / width) / (state.spread[pixels][:, None] ** 2 * CORRELATED)
        jac = np.zeros((*base.shape, 6))
        jac[..., 0] = (model[:, 1] - model[:, 0]) / (newton.STEP * base)
        jac[..., 1] = (model[:, 2] - model[:, 0]) / (newton.STEP * base)
        jac[..., 5] = (model[:, 3] - model[:, 0]) / (inward[:, None] * base)
        for c in range(3):
            jac[:, c::3, 2 + c] = (colour * diffuse[:, 0] / base)[:, c::3]
        light = np.zeros((*base.shape, count * 3))
        for k, group in enumerate(each):
            d, s = group(sight, pixels, n[:, None], r[:, None], group.energy(sight, pixels))
            share = (colour * d[:, 0] + s[:, 0]) / base
            for c in range(3):
                light[:, c::3, 3 * k + c] = share[:, c::3] * gain[k, c]
        wj, wl = jac * weight[..., None], light * weight[..., None]
        own = jac.transpose(0, 2, 1) @ wj + 1e-9 * np.eye(6)
        cross = jac.transpose(0, 2, 1) @ wl  # p 6 g
        own_slope = np.einsum("pvi,pv->pi", wj, e)
        solved = np.linalg.solve(own, np.concatenate([cross, own_slope[..., None]], 2))
        system += np.einsum("pvi,pvj->ij", light, wl, optimize=True)
        system -= np.einsum("pki,pkj->ij", cross, solved[..., :-1], optimize=True)
        slope += np.einsum("pvi,pv->i", wl, e) - np.einsum("pki,pk->i", cross, solved[..., -1])
    trust = np.repeat(1 / prior**2, 3)
    system = system + np.diag(trust)
    slope = slope - trust * np.log(gain).ravel()
    # The sum of all light is the background's; only its parts are open to argument, else albedo drifts.
    before = np.stack([group.energy.reshape(-1, 3).sum(0, dtype=np.float64) for group in groups])
    part = before * gain
    drift = part.sum(0) / before.sum(0)
    part = part / part.sum(0)
    for c in range(3):
        row = np.zeros((count, 3))
        row[:, c] = part[:, c]
        flat = row.ravel()
        system += np.outer(flat, flat) / TOTAL**2
        slope -= flat * np.log(drift[c]) / TOTAL**2
    covariance = np.linalg.inv(system)
    return (covariance @ slope).reshape(count, 3), np.sqrt(np.diag(covariance)).reshape(count, 3)
