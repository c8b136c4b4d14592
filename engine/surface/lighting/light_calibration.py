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

Two things more may have gone wrong between background and object, and are among the unknowns where the room leaves
them open: the exposure of every view (one log factor each, the mean of all zero: the scale stays the background's), and
the direction of every lamp (two angles across the way to it; how far away it stands would be argued with the
object's own distance).

Logs throughout: residual log((I + eps) / (model + eps)). Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from engine.color import luminance
from engine.parallel import abreast
from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.lighting.emitter_groups import CLIPPED, FILLED, KNOWN, UNSEEN, EmitterGroupsConfig
from engine.surface.lighting.grouped_light import GroupedLight
from engine.surface.optimize.gauss_newton import PixelEstimate, jacobian, minimize, perturbed, roughness_step
from engine.surface.optimize.pixel_sample import PixelSample
from engine.surface.rendering.transport import Block, LightTransport


@dataclass(frozen=True, slots=True)
class CalibrationConfig:
    """Beliefs are mean and spread of a log gain; steps are of logs where no unit is named.

    The background's sum is right to 0.3-0.8 % as fitted; given 1 %, the pixels, whose model errors are alike, made it 1-2 % too
    bright and the object a hundredth too far away and too dark. A clipped lamp is likely twice as bright as it could be recorded;
    the spread is wide enough that a room of clipped lamps is not pulled towards dim lamps and bright paint.
    """

    total_sigma: float = 0.001  # relative, per channel, of the sum of the light neither clipped nor unseen
    correlated: float = 10.0  # observations that share one model error: a pixel has so many times fewer
    clipped_belief: tuple[float, float] = (0.7, 2.0)  # of a lamp that is clipped all over
    unseen_belief: tuple[float, float] = (0.0, 1.5)  # of what no view shows: a lamp may hang there, or none;
    # of a part of it less, as that is smaller: dividing the unseen says nothing about it
    filled_belief: tuple[float, float] = (0.0, 1e-3)  # of what was filled in between: it keeps its level
    split_share: float = 0.005  # of all light, from which on a part that no view shows is divided
    unseen_per_view: int = 8  # such parts, at most: of a matt object nine numbers tell about its light
    exposure_mean_sigma: float = 1e-4  # how well the mean of the views' log exposures is zero
    lamp_step_rad: float = 0.003  # in a lamp's direction, for its derivative
    max_lamp_step_rad: float = 0.02  # a sharp highlight's flank ends there
    distance_step: float = 0.02  # for its derivative
    max_step: float = 0.4  # of one gain or of distance
    trusted_share: float = 0.8  # of the pixels: those in a shadow nobody foresaw misfit everywhere
    search_step: float = 0.03  # of distance, in `calibrate_with_distance`
    search_steps: int = 4  # it goes at most
    free_weight: float = 1e-6  # of the prior on an unknown that anything may move,
    fixed_weight: float = 1e12  # and on one that nothing may
    settled: float = 1e-3  # a setting that `_change` less stands: the background's sum is known no better
    residual_scale: float = 3.0  # one for every pixel, so that misfits compare
    rounds: int = 4  # of the pixels and then the light,
    gauss_newton_steps: int = 2  # with so many steps of the pixels each time


CONFIG = CalibrationConfig()


@dataclass(frozen=True, slots=True, eq=False)
class LightParameters:
    """Where the object stands and how bright the groups are, relative to what the background said."""

    distance: float
    gain: Float[np.ndarray, "k 3"]
    distance_stderr: float  # of log distance; 0 if it was given, inf if nothing depends on it
    cost: float  # what was minimised; compares settings of one sample
    exposure_offset: Float[np.ndarray, " n"]  # of each view's log exposure
    lamp_offset: Float[np.ndarray, "l 2"]  # radians across, of each lamp


def prior_light(grouped_light: GroupedLight, distance: float, unseen: float = 1.0) -> LightParameters:
    """The light as the background has it; clipped lamps as bright as lamps are expected to be, what no photograph
    shows so many times brighter than its surroundings."""
    gain = np.exp(light_belief(grouped_light)[0])[:, None].repeat(3, 1)
    gain[grouped_light.unseen] = unseen
    still = np.zeros(grouped_light.incident.energy.shape[2] // 3)
    there = np.zeros((len(grouped_light.area_lights.radii), 2))
    return LightParameters(distance, gain, float("inf"), float("inf"), still, there)


def split_groups(
    grouped_light: GroupedLight, light_parameters: LightParameters
) -> tuple[GroupedLight, LightParameters] | None:
    """The same light with the brightest parts that no view shows each in several; None if none is bright, or the views cannot
    tell more parts apart."""
    if grouped_light.patches is None or grouped_light.patch is None:
        return None
    light = grouped_light.shares(light_parameters.gain)
    most = CONFIG.unseen_per_view * grouped_light.incident.energy.shape[2] // 3
    more = max(0, most - int(grouped_light.unseen.sum())) // (EmitterGroupsConfig().parts - 1)
    light = light * grouped_light.unseen
    ranked = np.argsort(-light, kind="stable")[:more]
    group = grouped_light.patches.split(ranked[light[ranked] > CONFIG.split_share])
    end = int(grouped_light.patches.group.max()) + 1
    added = int(group.max()) + 1 - end
    if not added:
        return None
    # Of each new number the one that it was part of.
    numbers, somewhere = np.unique(group, return_index=True)
    whole = grouped_light.patches.group[somewhere[numbers >= end]]
    before = np.concatenate([np.arange(end), whole, np.arange(end, len(grouped_light.kind))])
    shifted = grouped_light.group + added * (grouped_light.group >= end)
    finer = replace(
        grouped_light, kind=grouped_light.kind[before], clipped_share=grouped_light.clipped_share[before],
        group=np.where(grouped_light.patch >= 0, group[grouped_light.patch], shifted),
        patches=replace(grouped_light.patches, group=group),
    )  # fmt: skip
    return finer, replace(light_parameters, gain=light_parameters.gain[before])


def calibrate(
    light_parameters: LightParameters,
    grouped_light: GroupedLight,
    sample: PixelSample,
    state: PixelEstimate,
    free_distance: bool,
    free_light: bool,
    progress: Progress,
    config: CalibrationConfig = CONFIG,
) -> tuple[LightParameters, PixelEstimate]:
    """`rounds` times the pixels under the setting, then the setting under the pixels; the best one wins."""
    best = replace(light_parameters, cost=float("inf")), state
    for span in progress.parts(config.rounds + 1):
        even = sample.with_exposure_compensated(light_parameters.exposure_offset)
        light = grouped_light.with_gains(light_parameters.gain, light_parameters.lamp_offset)
        problem = even.problem(light, light_parameters.distance)
        state = minimize(state, problem, config.gauss_newton_steps, span, reset_scale=True)
        fresh, misfit = _step(light_parameters, grouped_light, sample, state, free_distance, free_light)
        if misfit < best[0].cost:
            best = replace(light_parameters, distance_stderr=fresh.distance_stderr, cost=misfit), state
        moved, light_parameters = _change(grouped_light, light_parameters, fresh), fresh
        if moved < config.settled:
            break
        span.step(1.0, "refining the light")
    return best


def _change(grouped_light: GroupedLight, before: LightParameters, after: LightParameters) -> float:
    """How far two settings are apart: in shares of all light, in logs of distance and exposure, in radians of the lamps."""
    levels = grouped_light.levels()
    light, change = (
        luminance(levels * np.abs(gain)).sum() for gain in (before.gain, after.gain - before.gain)
    )
    away = np.concatenate([
        np.log([after.distance / before.distance]), after.exposure_offset - before.exposure_offset,
        (after.lamp_offset - before.lamp_offset).ravel(),
    ])  # fmt: skip
    return float(change / light) + float(np.abs(away).max())


def calibrate_with_distance(
    light_parameters: LightParameters,
    grouped_light: GroupedLight,
    sample: PixelSample,
    state: PixelEstimate,
    free_light: bool,
    progress: Progress,
    config: CalibrationConfig = CONFIG,
) -> LightParameters:
    """The distance at which the light that suits it best misfits least: the middle of a parabola through three.

    The joint step of `calibrate` stops on the flank: normals and gains lean the way that makes a wrong distance look
    right, and each of its steps takes them as they are. So every distance tried here gets pixels and gains of its
    own. The standard error is the parabola's: where the misfit, a sum of squared standard errors, rises by one.
    """
    tried: dict[int, LightParameters] = {}

    def at(shift: float) -> LightParameters:
        distance = light_parameters.distance * float(np.exp(shift * config.search_step))
        begun = replace(light_parameters, distance=distance)
        return calibrate(begun, grouped_light, sample, state, False, free_light, progress, config)[0]

    lowest = 0
    for _ in range(config.search_steps):
        for k in (lowest - 1, lowest, lowest + 1):
            if k not in tried:
                tried[k] = at(float(k))
        before, lowest = lowest, min(tried, key=lambda k: tried[k].cost)
        if lowest == before:
            break
    costs = [tried[k].cost for k in (lowest - 1, lowest, lowest + 1) if k in tried]
    # Still falling: it stands farther than told.
    left, middle, right = costs if len(costs) == 3 else (0.0, 0.0, 0.0)
    bend = left + right - 2 * middle
    if bend <= 0:
        return replace(tried[lowest], distance_stderr=float("inf"))
    found = at(lowest + 0.5 * (left - right) / bend)
    return replace(found, distance_stderr=config.search_step * float(np.sqrt(2 / bend)))


def light_belief(grouped_light: GroupedLight) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Mean and spread of every group's log gain. Of one that is clipped in part, that part alone may be brighter."""
    known = 0.0, grouped_light.gain_sigma
    beliefs = {KNOWN: known, CLIPPED: CONFIG.clipped_belief, UNSEEN: CONFIG.unseen_belief}
    beliefs[FILLED] = CONFIG.filled_belief
    mean, spread = np.array([beliefs[int(kind)] for kind in grouped_light.kind]).T
    share, clipped = grouped_light.clipped_share, grouped_light.clipped
    # The less of a group is clipped, the nearer is what is to what can be recorded.
    mean, spread = (np.where(clipped, share * x, x) for x in (mean, spread))
    brighter = share * np.exp(mean)
    gain = np.where(clipped, 1 - share + brighter, np.exp(mean))
    spread = np.where(clipped, np.maximum(spread * brighter / gain, grouped_light.gain_sigma), spread)
    if grouped_light.patches is not None:
        spread = spread / np.sqrt(grouped_light.patches.extent(len(spread)))
    return np.log(gain), spread


@dataclass(frozen=True, slots=True)
class _Unknowns:
    """Where a step has what, after the log gains of all groups and channels; exposures and angles only where they are open."""

    distance: int  # its log
    exposures: slice  # log, of every view
    angles: slice  # two of each lamp
    count: int

    @classmethod
    def of(cls, setting: LightParameters, parts: GroupedLight) -> "_Unknowns":
        far = setting.gain.size
        angles = far + 1 + len(setting.exposure_offset) * bool(parts.exposure_sigma)
        count = angles + setting.lamp_offset.size * bool(parts.lamp_offset_sigma)
        return cls(far, slice(far + 1, angles), slice(angles, count), count)


@dataclass(frozen=True, slots=True, eq=False)
class _LightEquations:
    """What pixels say about the light, their own unknowns eliminated."""

    hessian: Float[np.ndarray, "u u"]
    gradient: Float[np.ndarray, " u"]
    costs: Float[np.ndarray, " p"]
    following: Float[np.ndarray, "p 6 u"]  # how the pixels' own unknowns follow the light's


class _Linearization:
    """What some pixels send around one setting of the light."""

    def __init__(
        self, setting: LightParameters, parts: GroupedLight, sample: PixelSample, state: PixelEstimate
    ):
        self.setting, self.parts, self.state = setting, parts, state
        self.unknowns = _Unknowns.of(setting, parts)
        sample = sample.with_exposure_compensated(setting.exposure_offset)
        light = parts.with_gains(setting.gain, setting.lamp_offset)
        self.problem, self.lamps = sample.problem(light, setting.distance), light.area_lights
        # For what is no lamp, part by part.
        self.dark = LightTransport(parts.incident, sample.photographed, sample.full_diffuse, False, "cpu")

    def equations(self) -> _LightEquations:
        """Of all pixels."""
        count, unknowns = len(self.state.normals), self.unknowns.count
        system, slope = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
        found = _LightEquations(system, slope, np.zeros(count), np.zeros((count, 6, unknowns)))

        def tell(pixels: Int[np.ndarray, " _"]) -> tuple[Float[np.ndarray, "u u"], Float[np.ndarray, " u"]]:
            at, seen = self.state.part(pixels), self.problem.observations.part(pixels)
            block = self.problem.transport.block(self.problem.geometry, pixels)
            variants, rough = perturbed(at.normals, at.roughness)
            answers = self.problem.transport(block, variants, rough)
            total, own = jacobian(*answers, at.albedo, roughness_step(at.roughness), seen.eps)
            each = block.each_lamp(self.lamps, variants[:, :1], rough[:, :1], self.dark.full_diffuse)
            light = self._jacobian(block, at, seen, total, each[:, :, 0])
            e = np.log((seen.radiance + seen.eps[:, None]) / total)
            alike, width = CONFIG.residual_scale, (seen.cauchy * CONFIG.residual_scale) ** 2
            cost = width * np.log1p(seen.weight * e * e / width).sum(1)
            found.costs[pixels] = cost / (alike**2 * CONFIG.correlated)
            width = (seen.cauchy * at.residual_scale[:, None]) ** 2
            weight = seen.weight / (1 + seen.weight * e * e / width)
            weight = weight / (at.residual_scale[:, None] ** 2 * CONFIG.correlated)
            wo, wl = own * weight[..., None], light * weight[..., None]
            inner = own.transpose(0, 2, 1) @ wo + 1e-9 * np.eye(6)
            cross = own.transpose(0, 2, 1) @ wl  # p 6 u
            own_slope = np.einsum("pvi,pv->pi", wo, e)
            solved = np.linalg.solve(inner, np.concatenate([cross, own_slope[..., None]], 2))
            found.following[pixels] = -solved[..., :-1]
            flat, weighted = light.reshape(-1, unknowns), wl.reshape(-1, unknowns)
            own_share = cross.reshape(-1, unknowns).T @ solved.reshape(-1, unknowns + 1)
            return flat.T @ weighted - own_share[:, :-1], weighted.T @ e.ravel() - own_share[:, -1]

        for more, pull in abreast(tell, self.problem.blocks):
            system += more
            slope += pull
        return found

    def _jacobian(
        self,
        block: Block,
        at: PixelEstimate,
        seen: Observations,
        total: Float[np.ndarray, "p v"],
        each_lamp: Float[np.ndarray, "2 p n l"],
    ) -> Float[np.ndarray, "p v u"]:
        """How the logarithm of what the pixels send in all, with eps, follows the light; `each_lamp` is at unit radiance."""
        parts, setting, unknowns = self.parts, self.setting, self.unknowns
        lamps = parts.of_lamps
        others = np.r_[0 : lamps.start, lamps.stop : len(setting.gain)]
        middle = block.geometry.points.mean(0)
        each = parts.at(middle, setting.gain)[others]
        further = parts.at(middle * np.exp(CONFIG.distance_step), setting.gain).sum(0)
        lights = np.concatenate([each, (further - each.sum(0))[None] / CONFIG.distance_step])
        every = np.ascontiguousarray(lights.transpose(1, 0, 2)).reshape(lights.shape[1], -1)
        n, r, full_diffuse = at.normals[:, None], at.roughness[:, None], self.dark.full_diffuse
        d, s = self.dark(block.under(every), n, r)
        sent = (len(n), len(lights), total.shape[1])
        colour = np.tile(at.albedo, total.shape[1] // 3)
        share = colour[:, None] * d.reshape(sent) + s.reshape(sent)
        # What hides what does not change when the whole object moves along the viewing rays.
        moved = replace(block, geometry=block.geometry.at(float(np.exp(CONFIG.distance_step))))
        moved = moved.each_lamp(self.lamps, n, r, full_diffuse)
        for gain_of, now, then in zip((colour, 1.0), each_lamp, moved, strict=True):
            change = self.lamps.shone(then - now[:, None])
            share[:, -1] += gain_of * (change.reshape(total.shape) / CONFIG.distance_step)
        share = share / total[:, None]
        aside = CONFIG.lamp_step_rad * np.eye(2) if parts.lamp_offset_sigma else ()
        aside = [parts.lamps_moved(setting.lamp_offset + step).under(setting.gain[lamps]) for step in aside]
        turned = [block.each_lamp(there, n, r, full_diffuse)[:, :, 0] for there in aside]
        light = np.zeros((*total.shape, unknowns.count))
        light[..., unknowns.distance] = share[:, -1]
        known = seen.radiance / (seen.radiance + seen.eps[:, None])
        for c in range(3):
            light[:, c::3, c + 3 * others] = share[:, :-1, c::3].transpose(0, 2, 1)
            a, whole, radiance = (
                at.albedo[:, c, None, None],
                total[:, c::3, None],
                self.lamps.radiance[..., c],
            )
            # p n l: what each lamp sends to a channel.
            lamp = (a * each_lamp[0] + each_lamp[1]) * radiance / whole
            light[:, c::3, c + 3 * lamps.start : c + 3 * lamps.stop : 3] = lamp
            if parts.exposure_sigma:
                light[:, c::3, unknowns.exposures] = known[:, c::3, None] * np.eye(known.shape[1] // 3)
            for way, there in enumerate(turned):
                change = a * (there[0] - each_lamp[0]) + there[1] - each_lamp[1]
                change = change * radiance / (CONFIG.lamp_step_rad * whole)
                light[:, c::3, unknowns.angles.start + way :: 2] = change
        return light


def _with_prior(setting, parts, told, free_distance, free_light):
    """The pixels' system and slope with what is believed of the light; and the misfit at the setting."""
    views, unknowns = len(setting.exposure_offset), _Unknowns.of(setting, parts)
    far, exposures, angles = unknowns.distance, unknowns.exposures, unknowns.angles
    system, slope, misfits = told.hessian, told.gradient, told.costs
    misfit = np.sort(misfits)[: int(CONFIG.trusted_share * len(misfits))].mean() * len(misfits)
    mean, spread = light_belief(parts)
    logs = np.log(setting.gain)
    off = (logs - mean[:, None]) / spread[:, None]
    trust = np.full(unknowns.count, CONFIG.fixed_weight)
    if free_light:
        trust[:far] = np.repeat(1 / spread**2, 3)
    if free_distance:
        trust[far] = CONFIG.free_weight
    slope[:far] -= (off / spread[:, None]).ravel()
    misfit += float((off**2).sum())
    if parts.exposure_sigma:
        trust[exposures] = 1 / parts.exposure_sigma**2
        system[exposures, exposures] += 1 / (views * CONFIG.exposure_mean_sigma) ** 2
        slope[exposures] -= (
            setting.exposure_offset / parts.exposure_sigma**2
            + setting.exposure_offset.sum() / (views * CONFIG.exposure_mean_sigma) ** 2
        )
        # Not in the misfit: beside residuals in units of `residual_scale` the prior would stop the step short of the data.
    if parts.lamp_offset_sigma:
        trust[angles] = 1 / parts.lamp_offset_sigma**2
        slope[angles] -= setting.lamp_offset.ravel() / parts.lamp_offset_sigma**2
        misfit += float((setting.lamp_offset**2).sum()) / parts.lamp_offset_sigma**2
    system += np.diag(trust)
    # The sum of all light that is neither clipped nor unseen is the background's; only its parts are open to argument, else
    # albedo drifts.
    # What is clipped in part counts as far as its gain is the background's to say.
    said = np.minimum(parts.gain_sigma / spread, 1) ** 2 * ~parts.unseen
    known = parts.levels() * said[:, None]
    part = known * setting.gain
    drift = np.log(part.sum(0) / known.sum(0))
    misfit += float((drift**2).sum()) / CONFIG.total_sigma**2
    part = part / part.sum(0)
    for c in range(3):
        row = np.zeros(unknowns.count)
        row[c:far:3] = part[:, c]
        system += np.outer(row, row) / CONFIG.total_sigma**2
        slope -= row * drift[c] / CONFIG.total_sigma**2
    return replace(told, hessian=system, gradient=slope), float(misfit)


def _step(setting, parts, sample, state, free_distance, free_light):
    """One Schur-reduced Gauss-Newton step from a setting; and the misfit at the setting itself."""
    unknowns = _Unknowns.of(setting, parts)
    told = _Linearization(setting, parts, sample, state).equations()
    told, misfit = _with_prior(setting, parts, told, free_distance, free_light)
    covariance = np.linalg.inv(told.hessian)
    step = covariance @ told.gradient
    longest, far = CONFIG.max_lamp_step_rad, unknowns.distance
    step[unknowns.angles] = np.clip(step[unknowns.angles], -longest, longest)
    step = np.clip(step, -CONFIG.max_step, CONFIG.max_step)
    logs = np.log(setting.gain) + step[:far].reshape(setting.gain.shape)
    # What is clipped is no dimmer than recorded.
    logs[parts.clipped] = np.maximum(logs[parts.clipped], np.log(parts.clipped_share[parts.clipped, None]))
    distance, stderr = setting.distance, 0.0
    if free_distance:
        distance, stderr = float(distance * np.exp(step[far])), float(np.sqrt(covariance[far, far]))
    drifted, aside = setting.exposure_offset, setting.lamp_offset
    if parts.exposure_sigma:
        drifted = drifted + step[unknowns.exposures]
    if parts.lamp_offset_sigma:
        aside = aside + step[unknowns.angles].reshape(aside.shape)
    return LightParameters(distance, np.exp(logs), stderr, float("inf"), drifted, aside), misfit


def light_variance(
    light_parameters: LightParameters,
    grouped_light: GroupedLight,
    voting: tuple[PixelSample, PixelEstimate],
    others: tuple[PixelSample, PixelEstimate],
) -> Float[np.ndarray, "p 6"]:
    """Variances of other pixels' unknowns by what those that vote leave open of the light; the distance stands."""
    told, heard = (
        _Linearization(light_parameters, grouped_light, *some).equations() for some in (voting, others)
    )
    told, _ = _with_prior(light_parameters, grouped_light, told, False, True)
    following = heard.following
    return np.einsum("piu,uv,piv->pi", following, np.linalg.inv(told.hessian), following, optimize=True)
