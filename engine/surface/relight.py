"""What only the object can tell about the light: how bright its parts are, and how far away they stand.

The background says how bright each part of the room is, within some uncertainty; of a lamp that is clipped in
every exposure it says no more than a lower bound. And camera and object are fixed to one another, so the object
cannot be triangulated: how far in front of the camera it is shows only in the parallax of near light. Both
speak through the object's own shading in every view.

Unknown are therefore the log of the object's distance and, for every group of emitters (each lamp its own, the rest
by neighbourhood, and what no view has seen) and channel, the log of a gain with the background's uncertainty as
prior. They and a sample of the object's pixels are solved in one Gauss-Newton system whose pixel unknowns are
eliminated first (Schur complement): a pixel has six, the light dozens to a hundred. The object's own shadows and
bounced light, which do not change when the whole object moves along the viewing rays, are those of
the surface that is already known.

Logs throughout: residual log((I + eps) / (model + eps)). Camera frame.
"""

from dataclasses import dataclass, replace
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from engine.progress import Progress
from engine.radiance import luminance
from engine.surface import newton
from engine.surface.groups import CLIPPED, FILLED, KNOWN, UNSEEN
from engine.surface.near import Near
from engine.surface.observations import Observations
from engine.surface.transport import Incident, Responses, Sight

TOTAL = 0.001
"""How well the background fixes the sum of the light that is neither clipped nor unseen, per channel (relative): as good as wholly. As
fitted it is right to 0.3-0.8 %; given 1 %, the pixels, whose model errors are alike, made it 1-2 % too bright and
the object a hundredth too far away and too dark."""
CORRELATED = 10.0
"""Observations that share one model error; each pixel counts as so many times fewer than it has."""
BRIGHTER = (0.7, 2.0)
"""Mean and spread of the log gain of a clipped lamp: likely twice as bright as it could be recorded, and wide
enough that a room of clipped lamps is not pulled towards dim lamps and bright paint."""
GUESSED = (0.0, 1.5)
"""The same of a part of the room that no view shows: a lamp may hang there, or none."""
CERTAIN = (0.0, 1e-3)
"""The same of what was filled in between: it keeps its level."""
NUDGE = 0.02
"""Step in log distance for its derivative."""
LONGEST = 0.4
"""Longest step of one log gain or of log distance."""
TRUSTED = 0.8
"""Share of the pixels that vote on a comparison: those in a shadow nobody foresaw misfit everywhere."""
STRIDE, FARTHEST = 0.03, 4
"""Of `place`: steps of log distance, and how many of them it goes at most."""
FREE, FIXED = 1e-6, 1e12
"""Weights of the prior on an unknown that anything may move, and on one that nothing may."""
SPREAD = 3.0
"""One residual spread for every pixel, so that misfits compare."""


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """The light at a lattice of probes, by groups of emitters: the room's, each lamp, and what was filled in."""

    incident: Incident  # without the lamps
    group: Int[np.ndarray, "m d n"]  # of each cell of it
    near: Near  # the lamps, as recorded: the groups just before the last
    kind: UInt8[np.ndarray, " k"]  # of every group, see `groups.py`; the last is what was filled in
    prior: float  # spread of the log gain of a known one

    @property
    def of_lamps(self) -> slice:
        """The lamps' groups."""
        return slice(len(self.kind) - 1 - len(self.near.radii), len(self.kind) - 1)

    @property
    def clipped(self) -> Bool[np.ndarray, " k"]:
        """Groups whose brightness is only a lower bound."""
        return self.kind == CLIPPED

    @property
    def unseen(self) -> Bool[np.ndarray, " k"]:
        """Groups that no photograph shows."""
        return self.kind == UNSEEN

    def at(
        self, point: Float[np.ndarray, " 3"], gain: Float[np.ndarray, "k 3"]
    ) -> Float[np.ndarray, "k d v"]:
        """Every group's energy at a point, under its gain; nothing of the lamps."""
        weights = self.incident.lattice.weights(point).astype(np.float32)
        gain = gain.astype(np.float32)
        out = np.zeros((len(gain), *self.incident.energy.shape[1:]), np.float32)
        for k in np.nonzero(weights)[0]:
            _add_by_group(self.incident.energy[k], self.group[k], weights[k] * gain, out)
        return out

    def under(self, gain: Float[np.ndarray, "k 3"]) -> Incident:
        """All the light, every group under its gain."""
        m, d, v = self.incident.energy.shape
        energy = self.incident.energy.reshape(m, d, v // 3, 3) * gain.astype(np.float32)[self.group]
        near = self.near.under(gain[self.of_lamps])
        return Incident(self.incident.lattice, self.incident.directions, energy.reshape(m, d, v), near)

    def levels(self) -> Float[np.ndarray, "k 3"]:
        """The groups' share of the light before any gain, summed over probes, directions and views."""
        energy = self.incident.energy.reshape(-1, 3)
        flat = self.group.ravel()
        sums = np.stack([np.bincount(flat, energy[:, c], minlength=len(self.kind)) for c in range(3)], 1)
        sums[self.of_lamps] = self.near.levels(self.incident.lattice.points())
        return sums

    def unseen_share(self, gain: Float[np.ndarray, "k 3"]) -> float:
        """The share of all light, under its gains, that comes from where no photograph looked."""
        light = luminance(self.levels() * gain)
        return float(light[self.unseen].sum() / max(light.sum(), 1e-30))


@numba.njit(cache=True)
@no_type_check
def _add_by_group(energy, group, gain, out):
    for d in range(group.shape[0]):
        for n in range(group.shape[1]):
            k = group[d, n]
            for c in range(3):
                out[k, d, 3 * n + c] += gain[k, c] * energy[d, 3 * n + c]


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The pixels that vote: where they are up to the one factor, what they see, what they were seen as."""

    sight: Sight  # with the object at distance 1
    seen: Observations
    photographed: Float[np.ndarray, "q v"]  # of all the object's pixels, for the light they throw
    regions: list[Int[np.ndarray, " _"]]
    full_diffuse: bool
    bounce: bool
    walls: Float[np.ndarray, "w v"] | None = None  # the same of the walls that no photograph shows

    def at(self, distance: float) -> Sight:
        """What the pixels see when the object stands at `distance`."""
        return self.sight.at(distance)

    def responses(self, light: Incident) -> Responses:
        """How they answer a light."""
        return Responses(light, self.photographed, self.full_diffuse, self.bounce, "cpu", self.walls)


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """Where the object stands and how bright the groups are, relative to what the background said."""

    distance: float
    gain: Float[np.ndarray, "k 3"]
    distance_stderr: float  # of log distance; 0 if it was given, inf if nothing depends on it
    misfit: float  # what was minimised; compares settings of one sample


def untouched(parts: Parts, distance: float, unseen: float = 1.0) -> Setting:
    """The light as the background has it; clipped lamps as bright as lamps are expected to be, what no photograph
    shows so many times brighter than its surroundings."""
    gain = np.exp(_belief(parts)[0])[:, None].repeat(3, 1)
    gain[parts.unseen] = unseen
    return Setting(distance, gain, float("inf"), float("inf"))


def settle(
    setting: Setting,
    parts: Parts,
    sample: Sample,
    state: newton.State,
    free_distance: bool,
    free_light: bool,
    rounds: int,
    passes: int,
    progress: Progress,
) -> tuple[Setting, newton.State]:
    """`rounds` times the pixels under the setting, then the setting under the pixels; the best one wins."""
    best = replace(setting, misfit=float("inf")), state
    for turn in range(rounds + 1):
        span = progress.part(turn / (rounds + 1), (turn + 1) / (rounds + 1))
        responses, sight = sample.responses(parts.under(setting.gain)), sample.at(setting.distance)
        state = newton.respread(state, responses, sight, sample.regions, sample.seen)
        state = newton.iterate(state, responses, sight, sample.regions, sample.seen, passes, span)
        fresh, misfit = _improved(setting, parts, sample, state, free_distance, free_light)
        if misfit < best[0].misfit:
            errors = replace(fresh, distance=setting.distance, gain=setting.gain)
            best = replace(errors, misfit=misfit), state
        setting = fresh
        span.step(1.0, "refining the light")
    return best


def place(
    setting: Setting,
    parts: Parts,
    sample: Sample,
    state: newton.State,
    free_light: bool,
    rounds: int,
    passes: int,
    progress: Progress,
) -> Setting:
    """The distance at which the light that suits it best misfits least: the middle of a parabola through three.

    The joint step of `settle` stops on the flank: normals and gains lean the way that makes a wrong distance look
    right, and each of its steps takes them as they are. So every distance tried here gets pixels and gains of its
    own. The standard error is the parabola's: where the misfit, a sum of squared standard errors, rises by one.
    """
    tried: dict[int, Setting] = {}

    def at(shift: float) -> Setting:
        begun = replace(setting, distance=setting.distance * float(np.exp(shift * STRIDE)))
        return settle(begun, parts, sample, state, False, free_light, rounds, passes, progress)[0]

    lowest = 0
    for _ in range(FARTHEST):
        for k in (lowest - 1, lowest, lowest + 1):
            if k not in tried:
                tried[k] = at(float(k))
        before, lowest = lowest, min(tried, key=lambda k: tried[k].misfit)
        if lowest == before:
            break
    if not {lowest - 1, lowest + 1} <= tried.keys():
        return replace(
            tried[lowest], distance_stderr=float("inf")
        )  # still falling: it stands farther than told
    left, middle, right = (tried[lowest + k].misfit for k in (-1, 0, 1))
    bend = left + right - 2 * middle
    if bend <= 0:
        return replace(tried[lowest], distance_stderr=float("inf"))
    found = at(lowest + 0.5 * (left - right) / bend)
    return replace(found, distance_stderr=STRIDE * float(np.sqrt(2 / bend)))


def _belief(parts: Parts) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Mean and spread of every group's log gain."""
    beliefs = {KNOWN: (0.0, parts.prior), CLIPPED: BRIGHTER, UNSEEN: GUESSED, FILLED: CERTAIN}
    mean, spread = np.array([beliefs[int(kind)] for kind in parts.kind]).T
    return mean, spread


def _improved(setting, parts, sample, state, free_distance, free_light):
    """One Schur-reduced Gauss-Newton step from a setting; and the misfit at the setting itself."""
    count = len(setting.gain)
    unknowns = 3 * count + 1  # log gains, then log distance
    system, slope = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    seen, sight = sample.seen, sample.at(setting.distance)
    responses = sample.responses(parts.incident)
    dark = Responses(parts.incident, sample.photographed, sample.full_diffuse, False, "cpu")
    misfits = np.zeros(len(seen.eps))
    lamps = parts.of_lamps
    others = np.r_[0 : lamps.start, lamps.stop : count]
    near = parts.near.under(setting.gain[lamps])
    for pixels in sample.regions:
        block = responses.block(sight, pixels)
        points, here = block.points, block.points.mean(0)
        each = parts.at(here, setting.gain)[others]
        further = parts.at(here * np.exp(NUDGE), setting.gain).sum(0)
        total = each.sum(0)
        n, r, a = state.normals[pixels], state.roughness[pixels], state.albedo[pixels]
        variants, rough, inward = newton.variants(n, r)
        diffuse, specular = responses(replace(block, energy=total), variants, rough)
        seen_lamps = near.visible(points, block.hidden[:2] if block.hidden else None)
        shining = near.each(points, block.views, variants, rough, seen_lamps, sample.full_diffuse)
        diffuse += near.shone(shining[0]).reshape(diffuse.shape)
        specular += near.shone(shining[1]).reshape(specular.shape)
        channels = total.shape[1]
        colour = np.tile(a, channels // 3)
        model = colour[:, None] * diffuse + specular  # p 4 v
        eps = seen.eps[pixels][:, None]
        base = np.maximum(model[:, 0], 0) + eps
        e = np.log((seen.radiance[pixels] + eps) / base)
        weight = seen.weight[pixels]
        width = (seen.cauchy * SPREAD) ** 2
        misfits[pixels] = width * np.log1p(weight * e * e / width).sum(1) / (SPREAD**2 * CORRELATED)
        width = (seen.cauchy * state.spread[pixels][:, None]) ** 2
        weight = weight / (1 + weight * e * e / width) / (state.spread[pixels][:, None] ** 2 * CORRELATED)
        own = np.zeros((*base.shape, 6))
        own[..., 0] = (model[:, 1] - model[:, 0]) / (newton.STEP * base)
        own[..., 1] = (model[:, 2] - model[:, 0]) / (newton.STEP * base)
        own[..., 5] = (model[:, 3] - model[:, 0]) / (inward[:, None] * base)
        for c in range(3):
            own[:, c::3, 2 + c] = (colour * diffuse[:, 0] / base)[:, c::3]
        lights = np.concatenate([each, (further - total)[None] / NUDGE]).transpose(1, 0, 2)
        every = np.ascontiguousarray(lights).reshape(len(total), -1)
        d, s = dark(replace(block, energy=every), n[:, None], r[:, None])
        sent = (len(pixels), len(others) + 1, channels)
        share = colour[:, None] * d.reshape(sent) + s.reshape(sent)
        # What hides what does not change when the whole object moves along the viewing rays.
        moved = near.each(
            points * np.exp(NUDGE), block.views, n[:, None], r[:, None], seen_lamps, sample.full_diffuse
        )
        for gain_of, now, then in zip((colour, 1.0), shining, moved, strict=True):
            change = near.shone(then - now[:, :1]).reshape(len(pixels), channels) / NUDGE
            share[:, -1] += gain_of * change
        share = share / base[:, None]
        light = np.zeros((*base.shape, unknowns))
        for c in range(3):
            light[:, c::3, c + 3 * others] = share[:, :-1, c::3].transpose(0, 2, 1)
            # p n l: what each lamp sends to a channel.
            lamp = a[:, c, None, None] * shining[0][:, 0] + shining[1][:, 0]
            lamp = lamp * near.radiance[..., c] / base[:, c::3, None]
            light[:, c::3, c + 3 * lamps.start : c + 3 * lamps.stop : 3] = lamp
        light[..., -1] = share[:, -1]
        wo, wl = own * weight[..., None], light * weight[..., None]
        inner = own.transpose(0, 2, 1) @ wo + 1e-9 * np.eye(6)
        cross = own.transpose(0, 2, 1) @ wl  # p 6 u
        own_slope = np.einsum("pvi,pv->pi", wo, e)
        solved = np.linalg.solve(inner, np.concatenate([cross, own_slope[..., None]], 2))
        flat, weighted = light.reshape(-1, unknowns), wl.reshape(-1, unknowns)
        system += flat.T @ weighted - cross.reshape(-1, unknowns).T @ solved[..., :-1].reshape(-1, unknowns)
        slope += weighted.T @ e.ravel() - cross.reshape(-1, unknowns).T @ solved[..., -1].ravel()
    misfit = np.sort(misfits)[: int(TRUSTED * len(misfits))].mean() * len(misfits)
    mean, spread = _belief(parts)
    logs = np.log(setting.gain)
    off = (logs - mean[:, None]) / spread[:, None]
    trust = np.append(np.repeat(1 / spread**2, 3), FREE if free_distance else FIXED)
    if not free_light:
        trust[:-1] = FIXED
    system += np.diag(trust)
    slope[:-1] -= (off / spread[:, None]).ravel()
    misfit += float((off**2).sum())
    # The sum of all light that is neither clipped nor unseen is the background's; only its parts are open to argument, else
    # albedo drifts.
    known = parts.levels() * ~(parts.clipped | parts.unseen)[:, None]
    part = known * setting.gain
    drift = np.log(part.sum(0) / known.sum(0))
    misfit += float((drift**2).sum()) / TOTAL**2
    part = part / part.sum(0)
    for c in range(3):
        row = np.zeros(unknowns)
        row[c : 3 * count : 3] = part[:, c]
        system += np.outer(row, row) / TOTAL**2
        slope -= row * drift[c] / TOTAL**2
    covariance = np.linalg.inv(system)
    step = np.clip(covariance @ slope, -LONGEST, LONGEST)
    logs = logs + step[:-1].reshape(count, 3)
    logs[parts.clipped] = np.maximum(logs[parts.clipped], 0)  # a clipped lamp is no dimmer than recorded
    distance, stderr = setting.distance, 0.0
    if free_distance:
        distance, stderr = float(distance * np.exp(step[-1])), float(np.sqrt(covariance[-1, -1]))
    return Setting(distance, np.exp(logs), stderr, float("inf")), float(misfit)
