"""What the object is made of, where the model's paint does not do: how much it mirrors head on, and metal.

Most things are dielectrics of an index near 1.5, and everything is taken for such paint until its photographs say otherwise.
Some pixels are solved as each other material in part of the views; the views kept back say which explains them best. How
much a dielectric mirrors, all pixels of a region tell together: one alone can hardly tell more mirror from less
roughness. Metal is plain in most pixels; where some are, every pixel is asked, and its neighbours with it. A region is
what is near and looks alike. The materials are those of `brdf`. Camera frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.cluster.vq import kmeans2
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from engine.progress import Progress
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.exhaustive_search import exhaustive_search
from engine.surface.optimize.pixel_sample import PixelSample, interior, random_subset, sample_pixels
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import PAINT
from engine.surface.rendering.object_pixels import ObjectPixels
from engine.surface.rendering.transport import IncidentLight, SurfaceGeometry, pixel_blocks

LEVELS = np.array([0.25, 0.5, 1.0])
"""Specular levels tried: a reflectance head on of 0.02 (water has that), of paint, and of 0.08 (sapphire)."""
METAL = (0.5, 1.0)
KEPT_BACK = 4
"""Of so many views one decides."""
PASSES, CANDIDATES = 8, 300
ASKED = 600
"""Pixels that are solved as every material."""
REGIONS = 12
ANYTHING = 1e6
"""Spread of what is expected where nothing is."""
LIKE = 0.5
"""A difference in log radiance that parts two pixels as far as half the object's size does."""
LOUDEST = 1.0
"""Log likelihood ratio for one view and channel: the most that a pixel says for or against a level."""
NEEDED, SURE, FEWEST = 0.05, 4.0, 20
"""What it takes to believe in another level: a gain in log likelihood for one view and channel, the mean over a region; how many
times its own standard error that is; and so many pixels. A coat that mirrors twice as much brought 0.2."""
EXPLAINED, WELL = 1.5, 0.33
"""Pixels that speak of levels: whose residuals are at most so many times as wide as in this share of all. Where shadows are not
foreseen rightly another level may explain a groove better than paint does."""
NARROWER, CERTAIN = 3.0, 1.5
"""So many times narrower a metal's residuals must be as metal's than as paint's, and the logarithm of a further factor that
makes quite sure. Of gold, satin, they are 14 times narrower in the median and 5 in the tenth worst; where a groove's
shadows are not foreseen yet, metal explains paint up to twice as well as paint does."""
SOME = 0.02
"""Share of pixels asked that are metal from which on all are asked."""
NEIGHBOURS = 1.0
"""Pixels, one standard deviation, whose word on metal counts as a pixel's own."""


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Some pixels in the views that fit them and in those that judge, and what they are taken for so far."""

    fitted: tuple[PixelSample, IncidentLight]
    kept: tuple[PixelSample, IncidentLight]
    state: gauss_newton.PixelEstimate

    @property
    def data(self) -> int:
        """Views times channels that judge each pixel."""
        return self.kept[0].observations.radiance.shape[1]

    def tried(self, material: tuple[float, float], progress: Progress) -> gauss_newton.PixelEstimate:
        """The pixels as of one material, by the views that fit."""
        spread, count = self.state.residual_scale, len(self.state.residual_scale)
        made = np.tile(material, (count, 1))
        answer = _solved(self.fitted, self.state, made, PASSES, progress.part(0, 0.5))
        so_far = self.fitted[0].geometry.material
        if np.any((PAINT[1] if so_far is None else so_far[:, 1]) != material[1]):
            # As another kind of thing it may have ended anywhere.
            begun = replace(_sought(self.fitted, made, progress.part(0.5, 0.6)), residual_scale=spread)
            other = _solved(self.fitted, begun, made, PASSES, progress.part(0.6, 1))
            answer = gauss_newton.where(other.cost < answer.cost, other, answer)
        return answer

    def likelihood(
        self, answer: gauss_newton.PixelEstimate, material: tuple[float, float]
    ) -> Float[np.ndarray, " p"]:
        """Of every pixel's kept views by what was `tried` as this material, per view and channel; a logarithm, up to what is
        alike for all materials: residuals are as wide as they are so far."""
        # What is expected of roughness is no photograph's word.
        free = replace(answer, roughness_prior=np.tile([0.5, ANYTHING], (len(answer.residual_scale), 1)))
        judged = _solved(self.kept, free, np.tile(material, (len(free.residual_scale), 1)), 1, Progress())
        return -judged.cost / (2 * self.data * self.state.residual_scale**2)

    def spread(
        self, answer: gauss_newton.PixelEstimate, material: tuple[float, float]
    ) -> Float[np.ndarray, " p"]:
        """How wide the residuals of every pixel's kept views are by what was `tried` as this material."""
        of, light = self.kept
        geometry = replace(of.geometry, material=np.tile(material, (len(answer.residual_scale), 1)))
        return gauss_newton.update_residual_scale(
            answer, of.light_transport(light), geometry, of.regions, of.observations
        ).residual_scale


def classify(
    object_pixels: ObjectPixels,
    state: gauss_newton.PixelEstimate,
    light: IncidentLight,
    geometry: SurfaceGeometry,
    exactly: bool,
    params: SurfaceParams,
    seed: int,
    progress: Progress,
) -> Float[np.ndarray, "p 2"] | None:
    """The material of every pixel; None: nothing speaks against paint. `geometry` is that under which the state was
    solved; only `exactly` is it asked what else than metal it may be; `seed` picks the pixels that are asked."""
    chosen = random_subset(interior(object_pixels), ASKED, seed)
    trial = _trial(object_pixels, chosen, state, light, geometry, params)
    spans = iter(progress.parts(len(LEVELS) + 2))
    as_paint = trial.tried(PAINT, next(spans))
    shiny = metallic(trial, as_paint, next(spans)) > 0
    level = np.full(len(state.residual_scale), PAINT[0])
    heard = ~shiny & (trial.state.residual_scale < EXPLAINED * np.quantile(trial.state.residual_scale, WELL))
    if exactly and heard.any():
        kinds = [(float(one), PAINT[1]) for one in LEVELS]
        answers = [as_paint if one == PAINT else trial.tried(one, next(spans)) for one in kinds]
        said = np.stack([trial.likelihood(*pair) for pair in zip(answers, kinds, strict=True)], 1)
        region = regions(object_pixels, chosen, seed)
        level = levels(said[heard], region[chosen][heard], int(region.max()) + 1)[region]
    metal = np.zeros(len(level), bool)
    if shiny.mean() >= SOME:
        everybody = _trial(
            object_pixels,
            np.arange(len(level)),
            state,
            light,
            geometry,
            params,
            pixel_blocks(object_pixels.mask),
        )
        voices = np.zeros(object_pixels.mask.shape)
        first, second = next(spans).parts(2)
        voices[object_pixels.mask] = metallic(everybody, everybody.tried(PAINT, first), second)
        metal = gaussian_filter(voices, NEIGHBOURS)[object_pixels.mask] > 0
    if (level == PAINT[0]).all() and not metal.any():
        return None
    return np.where(metal[:, None], METAL, np.stack([level, np.full(len(level), PAINT[1])], 1))


def metallic(
    trial: Trial, as_paint: gauss_newton.PixelEstimate, progress: Progress
) -> Float[np.ndarray, " p"]:
    """How much narrower each pixel's residuals are as metal's than as paint's: a logarithm, above 0 where that is enough."""
    as_metal = trial.tried(METAL, progress)
    gained = np.log(trial.spread(as_paint, PAINT) / trial.spread(as_metal, METAL)) - np.log(NARROWER)
    return np.clip(gained, -CERTAIN, CERTAIN)


def kind(material: Float[np.ndarray, "p 2"] | None, object_pixels: ObjectPixels) -> Bool[np.ndarray, " p"]:
    """Which pixels are metal."""
    return np.zeros(int(object_pixels.mask.sum()), bool) if material is None else material[:, 1] > 0


def same(one: Float[np.ndarray, "p 2"] | None, other: Float[np.ndarray, "p 2"] | None) -> bool:
    """Whether two materials of the same pixels are one."""
    if one is None or other is None:
        return one is other
    return bool((one == other).all())


def regions(object_pixels: ObjectPixels, chosen: Int[np.ndarray, " k"], seed: int) -> Int[np.ndarray, " p"]:
    """A number for every pixel; alike for what is near and looks alike."""
    place = np.stack(np.nonzero(object_pixels.mask), 1)
    radiance = object_pixels.observations.radiance.reshape(len(place), -1, 3)
    looks = np.log(np.median(radiance, axis=1) + object_pixels.observations.eps[:, None])
    size = np.sqrt(len(place))
    feature = np.concatenate([2 * place / size, looks / LIKE], 1)
    count = min(REGIONS, len(chosen))
    centres, _ = kmeans2(feature[chosen], count, rng=seed, minit="++")
    return np.asarray(KDTree(centres).query(feature)[1])


def levels(
    said: Float[np.ndarray, "k l"], region: Int[np.ndarray, " k"], count: int
) -> Float[np.ndarray, " r"]:
    """The specular level of each of `count` regions by their pixels' log likelihoods, for one view and channel, of `LEVELS`:
    that of all together, unless its own speak against it."""
    usual = _level(said, PAINT[0]) or PAINT[0]
    found = np.full(count, usual)
    for k in np.unique(region):
        found[k] = _level(said[region == k], usual) or usual
    return found


def _level(said: Float[np.ndarray, "k l"], usual: float) -> float | None:
    """The level that some pixels speak for, against a `usual` one; None: not plainly for another."""
    if len(said) < FEWEST:
        return None
    low, middle, high = np.clip(said - said[:, 1:2], -LOUDEST, LOUDEST).T
    # Their logarithms are evenly spaced: the top of a parabola through three, no farther than they go.
    slope, bend = (high - low) / 2, low + high - 2 * middle
    top = -slope.mean() / bend.mean() if bend.mean() < 0 else np.sign(slope.mean())
    top, there = float(np.clip(top, -1, 1)), float(np.log2(usual / LEVELS[1]))
    gained = slope * (top - there) + bend * (top**2 - there**2) / 2
    # NaN: nobody knows, and it stays as it is.
    if not gained.mean() >= max(NEEDED, SURE * gained.std() / np.sqrt(len(gained))):
        return None
    return float(LEVELS[1] * 2.0**top)


def _trial(
    object_pixels: ObjectPixels,
    chosen: Int[np.ndarray, " k"],
    state: gauss_newton.PixelEstimate,
    light: IncidentLight,
    geometry: SurfaceGeometry,
    params: SurfaceParams,
    blocks: list[Int[np.ndarray, " _"]] | None = None,
) -> Trial:
    """Of some pixels; `parts` of them share their light (a few large ones where left out)."""
    every = np.arange(light.energy.shape[2] // 3)
    back = every[KEPT_BACK - 1 :: KEPT_BACK]
    seen = []
    for views in (np.setdiff1d(every, back), back):
        here = light.views(views)
        of = sample_pixels(object_pixels, geometry, 1.0, chosen, params, views, here)
        seen.append((of if blocks is None else replace(of, regions=blocks), here))
    return Trial(seen[0], seen[1], state.part(chosen))


def _solved(
    witness: tuple[PixelSample, IncidentLight],
    begun: gauss_newton.PixelEstimate,
    material: Float[np.ndarray, "p 2"],
    passes: int,
    progress: Progress,
) -> gauss_newton.PixelEstimate:
    """Every pixel as of a material; with one pass its misfit as begun."""
    of, light = witness
    count = len(begun.cost)
    begun = replace(
        begun, cost=np.full(count, np.inf), lm_lambda=np.full(count, gauss_newton.CONFIG.lambda_initial)
    )
    geometry = replace(of.geometry, material=material)
    return gauss_newton.minimize(
        begun, of.light_transport(light), geometry, of.regions, of.observations, passes, progress
    )


def _sought(
    witness: tuple[PixelSample, IncidentLight], material: Float[np.ndarray, "p 2"], progress: Progress
) -> gauss_newton.PixelEstimate:
    """Every pixel from nothing, with nothing hidden."""
    of, light = replace(witness[0], bounce=False), witness[1]
    geometry = replace(of.geometry, material=material, visibility=None)
    return gauss_newton.initial_estimate(
        *exhaustive_search(
            of.light_transport(light), geometry, of.observations, of.regions, CANDIDATES, progress
        )
    )
