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
from engine.surface.lighting.emitter_groups import CLIPPED, FILLED, KNOWN, UNSEEN, EmitterGroupsConfig
from engine.surface.lighting.grouped_light import GroupedLight
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.pixel_sample import PixelSample
from engine.surface.rendering.transport import LightTransport


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


@dataclass(frozen=True, slots=True, eq=False)
class LightParameters:
    """Where the object stands and how bright the groups are, relative to what the background said."""

    distance: float
    gain: Float[np.ndarray, "k 3"]
    distance_stderr: float  # of log distance; 0 if it was given, inf if nothing depends on it
    cost: float  # what was minimised; compares settings of one sample
    exposure_offset: Float[np.ndarray, " n"]  # of each view's log exposure
    lamp_offset: Float[np.ndarray, "l 2"]  # radians across, of each lamp


def prior_light(
    grouped_light: GroupedLight,
    distance: float,
    unseen: float = 1.0,
    config: CalibrationConfig = CalibrationConfig(),
) -> LightParameters:
    """The light as the background has it; clipped lamps as bright as lamps are expected to be, what no photograph
    shows so many times brighter than its surroundings."""
    gain = np.exp(light_belief(grouped_light, config)[0])[:, None].repeat(3, 1)
    gain[grouped_light.unseen] = unseen
    still = (
        np.zeros(grouped_light.incident.energy.shape[2] // 3),
        np.zeros((len(grouped_light.area_lights.radii), 2)),
    )
    return LightParameters(distance, gain, float("inf"), float("inf"), *still)


def split_groups(
    grouped_light: GroupedLight,
    light_parameters: LightParameters,
    config: CalibrationConfig = CalibrationConfig(),
) -> tuple[GroupedLight, LightParameters] | None:
    """The same light with the brightest parts that no view shows each in several; None if none is bright, or the views cannot
    tell more parts apart."""
    if grouped_light.patches is None or grouped_light.patch is None:
        return None
    light = luminance(grouped_light.levels() * light_parameters.gain)
    most = config.unseen_per_view * grouped_light.incident.energy.shape[2] // 3
    more = most - int(grouped_light.unseen.sum())
    ranked = np.argsort(np.where(grouped_light.unseen, -light, 0), kind="stable")[
        : max(0, more) // (EmitterGroupsConfig().parts - 1)
    ]
    group = grouped_light.patches.split(
        ranked[light[ranked] * grouped_light.unseen[ranked] > config.split_share * light.sum()]
    )
    end = int(grouped_light.patches.group.max()) + 1
    added = int(group.max()) + 1 - end
    if not added:
        return None
    # Of each new number the one that it was part of.
    numbers, somewhere = np.unique(group, return_index=True)
    whole = grouped_light.patches.group[somewhere[numbers >= end]]
    before = np.concatenate([np.arange(end), whole, np.arange(end, len(grouped_light.kind))])
    cells = np.where(
        grouped_light.patch >= 0,
        group[grouped_light.patch],
        grouped_light.group + added * (grouped_light.group >= end),
    )
    finer = replace(
        grouped_light,
        group=cells,
        kind=grouped_light.kind[before],
        clipped_share=grouped_light.clipped_share[before],
        patches=replace(grouped_light.patches, group=group),
    )
    return finer, replace(light_parameters, gain=light_parameters.gain[before])


def calibrate(
    light_parameters: LightParameters,
    grouped_light: GroupedLight,
    sample: PixelSample,
    state: gauss_newton.PixelEstimate,
    free_distance: bool,
    free_light: bool,
    rounds: int,
    passes: int,
    progress: Progress,
    config: CalibrationConfig = CalibrationConfig(),
) -> tuple[LightParameters, gauss_newton.PixelEstimate]:
    """`rounds` times the pixels under the setting, then the setting under the pixels; the best one wins."""
    best = replace(light_parameters, cost=float("inf")), state
    for turn in range(rounds + 1):
        span = progress.part(turn / (rounds + 1), (turn + 1) / (rounds + 1))
        even, geometry = (
            sample.with_exposure_compensated(light_parameters.exposure_offset),
            sample.geometry_at(light_parameters.distance),
        )
        transport = even.light_transport(
            grouped_light.with_gains(light_parameters.gain, light_parameters.lamp_offset)
        )
        state = gauss_newton.minimize(
            state, transport, geometry, sample.regions, even.observations, passes, span, reset_scale=True
        )
        fresh, misfit = _step(
            light_parameters, grouped_light, sample, state, free_distance, free_light, config
        )
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
    away = [
        np.log([after.distance / before.distance]),
        after.exposure_offset - before.exposure_offset,
        after.lamp_offset - before.lamp_offset,
    ]
    return float(change / light) + max(float(np.abs(x).max(initial=0)) for x in away)


def calibrate_with_distance(
    light_parameters: LightParameters,
    grouped_light: GroupedLight,
    sample: PixelSample,
    state: gauss_newton.PixelEstimate,
    free_light: bool,
    rounds: int,
    passes: int,
    progress: Progress,
    config: CalibrationConfig = CalibrationConfig(),
) -> LightParameters:
    """The distance at which the light that suits it best misfits least: the middle of a parabola through three.

    The joint step of `calibrate` stops on the flank: normals and gains lean the way that makes a wrong distance look
    right, and each of its steps takes them as they are. So every distance tried here gets pixels and gains of its
    own. The standard error is the parabola's: where the misfit, a sum of squared standard errors, rises by one.
    """
    tried: dict[int, LightParameters] = {}

    def at(shift: float) -> LightParameters:
        begun = replace(
            light_parameters, distance=light_parameters.distance * float(np.exp(shift * config.search_step))
        )
        return calibrate(
            begun, grouped_light, sample, state, False, free_light, rounds, passes, progress, config
        )[0]

    lowest = 0
    for _ in range(config.search_steps):
        for k in (lowest - 1, lowest, lowest + 1):
            if k not in tried:
                tried[k] = at(float(k))
        before, lowest = lowest, min(tried, key=lambda k: tried[k].cost)
        if lowest == before:
            break
    if not {lowest - 1, lowest + 1} <= tried.keys():
        return replace(
            tried[lowest], distance_stderr=float("inf")
        )  # still falling: it stands farther than told
    left, middle, right = (tried[lowest + k].cost for k in (-1, 0, 1))
    bend = left + right - 2 * middle
    if bend <= 0:
        return replace(tried[lowest], distance_stderr=float("inf"))
    found = at(lowest + 0.5 * (left - right) / bend)
    return replace(found, distance_stderr=config.search_step * float(np.sqrt(2 / bend)))


def light_belief(
    grouped_light: GroupedLight, config: CalibrationConfig = CalibrationConfig()
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Mean and spread of every group's log gain. Of one that is clipped in part, that part alone may be brighter."""
    beliefs = {
        KNOWN: (0.0, grouped_light.gain_sigma), CLIPPED: config.clipped_belief, UNSEEN: config.unseen_belief,
        FILLED: config.filled_belief,
    }  # fmt: skip
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


def _unknowns(setting, parts):
    """Where the step has log distance, log exposures and the lamps' first angle, and how many unknowns there are.

    Log gains come first; exposures and both angles of each lamp only where they are open.
    """
    far, views = setting.gain.size, len(setting.exposure_offset)
    angles = far + 1 + views * bool(parts.exposure_sigma)
    return (
        far,
        slice(far + 1, angles),
        angles,
        angles + setting.lamp_offset.size * bool(parts.lamp_offset_sigma),
    )


def _system(setting, parts, sample, state, config):
    """What the pixels say about the light, their own unknowns eliminated: system, slope, the misfit of each pixel, and how its
    own unknowns follow the light's (p 6 u)."""
    count, views = len(setting.gain), len(setting.exposure_offset)
    far, exposures, angles, unknowns = _unknowns(setting, parts)
    system, slope = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    sample = sample.with_exposure_compensated(setting.exposure_offset)
    seen, geometry = sample.observations, sample.geometry_at(setting.distance)
    transport = sample.light_transport(parts.with_gains(setting.gain, setting.lamp_offset))
    dark = LightTransport(parts.incident, sample.photographed, sample.full_diffuse, False, "cpu")
    misfits, following = np.zeros(len(seen.eps)), np.zeros((len(seen.eps), 6, unknowns))
    lamps = parts.of_lamps
    others = np.r_[0 : lamps.start, lamps.stop : count]
    near = transport.incident.area_lights
    lean = [
        parts.lamps_moved(setting.lamp_offset + config.lamp_step_rad * way).under(setting.gain[lamps])
        for way in np.eye(2)
    ]

    def tell(pixels: Int[np.ndarray, " _"]) -> tuple[Float[np.ndarray, "u u"], Float[np.ndarray, " u"]]:
        block = transport.block(geometry, pixels)
        points, here = block.points, block.points.mean(0)
        each = parts.at(here, setting.gain)[others]
        further = parts.at(here * np.exp(config.distance_step), setting.gain).sum(0)
        total = each.sum(0)
        n, r, a = state.normals[pixels], state.roughness[pixels], state.albedo[pixels]
        variants, rough, inward = gauss_newton.perturbed(n, r)
        diffuse, specular = transport(block, variants, rough)
        made = sample.full_diffuse, block.material
        shining = near.each(points, block.views, variants, rough, block.lamps, *made)
        channels = total.shape[1]
        colour = np.tile(a, channels // 3)
        eps = seen.eps[pixels][:, None]
        base, own = gauss_newton.jacobian(diffuse, specular, a, inward, seen.eps[pixels])
        e = np.log((seen.radiance[pixels] + eps) / base)
        weight = seen.weight[pixels]
        alike = config.residual_scale
        width = (seen.cauchy * alike) ** 2
        misfits[pixels] = width * np.log1p(weight * e * e / width).sum(1) / (alike**2 * config.correlated)
        width = (seen.cauchy * state.residual_scale[pixels][:, None]) ** 2
        weight = weight / (1 + weight * e * e / width)
        weight = weight / (state.residual_scale[pixels][:, None] ** 2 * config.correlated)
        lights = np.concatenate([each, (further - total)[None] / config.distance_step]).transpose(1, 0, 2)
        every = np.ascontiguousarray(lights).reshape(len(total), -1)
        d, s = dark(block.under(every), n[:, None], r[:, None])
        sent = (len(pixels), len(others) + 1, channels)
        share = colour[:, None] * d.reshape(sent) + s.reshape(sent)
        # What hides what does not change when the whole object moves along the viewing rays.
        moved = points * np.exp(config.distance_step)
        moved = near.each(moved, block.views, n[:, None], r[:, None], block.lamps, *made)
        for gain_of, now, then in zip((colour, 1.0), shining, moved, strict=True):
            change = near.shone(then - now[:, :1]).reshape(len(pixels), channels) / config.distance_step
            share[:, -1] += gain_of * change
        share = share / base[:, None]
        light = np.zeros((*base.shape, unknowns))
        for c in range(3):
            light[:, c::3, c + 3 * others] = share[:, :-1, c::3].transpose(0, 2, 1)
            # p n l: what each lamp sends to a channel.
            lamp = a[:, c, None, None] * shining[0][:, 0] + shining[1][:, 0]
            lamp = lamp * near.radiance[..., c] / base[:, c::3, None]
            light[:, c::3, c + 3 * lamps.start : c + 3 * lamps.stop : 3] = lamp
        light[..., far] = share[:, -1]
        if parts.exposure_sigma:
            known = seen.radiance[pixels] / (seen.radiance[pixels] + eps)
            for c in range(3):
                light[:, c::3, exposures] = known[:, c::3, None] * np.eye(views)
        if parts.lamp_offset_sigma:
            for way, there in enumerate(lean):
                d, s = there.each(points, block.views, n[:, None], r[:, None], block.lamps, *made)
                for c in range(3):
                    change = a[:, c, None, None] * (d[:, 0] - shining[0][:, 0]) + s[:, 0] - shining[1][:, 0]
                    change = change * near.radiance[..., c] / (config.lamp_step_rad * base[:, c::3, None])
                    light[:, c::3, angles + way :: 2] = change
        wo, wl = own * weight[..., None], light * weight[..., None]
        inner = own.transpose(0, 2, 1) @ wo + 1e-9 * np.eye(6)
        cross = own.transpose(0, 2, 1) @ wl  # p 6 u
        own_slope = np.einsum("pvi,pv->pi", wo, e)
        solved = np.linalg.solve(inner, np.concatenate([cross, own_slope[..., None]], 2))
        following[pixels] = -solved[..., :-1]
        flat, weighted = light.reshape(-1, unknowns), wl.reshape(-1, unknowns)
        own_share = cross.reshape(-1, unknowns).T @ solved.reshape(-1, unknowns + 1)
        return flat.T @ weighted - own_share[:, :-1], weighted.T @ e.ravel() - own_share[:, -1]

    for more, pull in abreast(tell, sample.regions):
        system += more
        slope += pull
    return system, slope, misfits, following


def _system_with_prior(setting, parts, sample, state, free_distance, free_light, config):
    """The pixels' system and slope with what is believed of the light; and the misfit at the setting."""
    views = len(setting.exposure_offset)
    far, exposures, angles, unknowns = _unknowns(setting, parts)
    system, slope, misfits, _ = _system(setting, parts, sample, state, config)
    misfit = np.sort(misfits)[: int(config.trusted_share * len(misfits))].mean() * len(misfits)
    mean, spread = light_belief(parts, config)
    logs = np.log(setting.gain)
    off = (logs - mean[:, None]) / spread[:, None]
    trust = np.full(unknowns, config.fixed_weight)
    if free_light:
        trust[:far] = np.repeat(1 / spread**2, 3)
    if free_distance:
        trust[far] = config.free_weight
    slope[:far] -= (off / spread[:, None]).ravel()
    misfit += float((off**2).sum())
    if parts.exposure_sigma:
        trust[exposures] = 1 / parts.exposure_sigma**2
        system[exposures, exposures] += 1 / (views * config.exposure_mean_sigma) ** 2
        slope[exposures] -= (
            setting.exposure_offset / parts.exposure_sigma**2
            + setting.exposure_offset.sum() / (views * config.exposure_mean_sigma) ** 2
        )
        # Not in the misfit: beside residuals in units of `residual_scale` the prior would stop the step short of the data.
    if parts.lamp_offset_sigma:
        trust[angles:] = 1 / parts.lamp_offset_sigma**2
        slope[angles:] -= setting.lamp_offset.ravel() / parts.lamp_offset_sigma**2
        misfit += float((setting.lamp_offset**2).sum()) / parts.lamp_offset_sigma**2
    system += np.diag(trust)
    # The sum of all light that is neither clipped nor unseen is the background's; only its parts are open to argument, else
    # albedo drifts.
    # What is clipped in part counts as far as its gain is the background's to say.
    said = np.minimum(parts.gain_sigma / spread, 1) ** 2 * ~parts.unseen
    known = parts.levels() * said[:, None]
    part = known * setting.gain
    drift = np.log(part.sum(0) / known.sum(0))
    misfit += float((drift**2).sum()) / config.total_sigma**2
    part = part / part.sum(0)
    for c in range(3):
        row = np.zeros(unknowns)
        row[c:far:3] = part[:, c]
        system += np.outer(row, row) / config.total_sigma**2
        slope -= row * drift[c] / config.total_sigma**2
    return system, slope, float(misfit)


def _step(setting, parts, sample, state, free_distance, free_light, config):
    """One Schur-reduced Gauss-Newton step from a setting; and the misfit at the setting itself."""
    far, exposures, angles, _ = _unknowns(setting, parts)
    system, slope, misfit = _system_with_prior(
        setting, parts, sample, state, free_distance, free_light, config
    )
    covariance = np.linalg.inv(system)
    step = covariance @ slope
    step[angles:] = np.clip(step[angles:], -config.max_lamp_step_rad, config.max_lamp_step_rad)
    step = np.clip(step, -config.max_step, config.max_step)
    logs = np.log(setting.gain) + step[:far].reshape(setting.gain.shape)
    # What is clipped is no dimmer than recorded.
    logs[parts.clipped] = np.maximum(logs[parts.clipped], np.log(parts.clipped_share[parts.clipped, None]))
    distance, stderr = setting.distance, 0.0
    if free_distance:
        distance, stderr = float(distance * np.exp(step[far])), float(np.sqrt(covariance[far, far]))
    drifted, aside = setting.exposure_offset, setting.lamp_offset
    if parts.exposure_sigma:
        drifted = drifted + step[exposures]
    if parts.lamp_offset_sigma:
        aside = aside + step[angles:].reshape(aside.shape)
    return LightParameters(distance, np.exp(logs), stderr, float("inf"), drifted, aside), misfit


def light_variance(
    light_parameters: LightParameters,
    grouped_light: GroupedLight,
    voting: tuple[PixelSample, gauss_newton.PixelEstimate],
    others: tuple[PixelSample, gauss_newton.PixelEstimate],
    config: CalibrationConfig = CalibrationConfig(),
) -> Float[np.ndarray, "p 6"]:
    """Variances of other pixels' unknowns by what those that vote leave open of the light; the distance stands."""
    system, _, _ = _system_with_prior(light_parameters, grouped_light, *voting, False, True, config)
    following = _system(light_parameters, grouped_light, *others, config)[3]
    return np.einsum("piu,uv,piv->pi", following, np.linalg.inv(system), following, optimize=True)
