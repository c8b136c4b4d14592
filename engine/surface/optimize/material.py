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
from engine.surface.optimize.exhaustive_search import exhaustive_search
from engine.surface.optimize.gauss_newton import (
    PixelEstimate,
    PixelProblem,
    minimize,
    update_residual_scale,
    where,
)
from engine.surface.optimize.pixel_sample import interior, random_subset, sample_pixels
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import PAINT
from engine.surface.rendering.object_pixels import ObjectPixels
from engine.surface.rendering.transport import IncidentLight, SurfaceGeometry, pixel_blocks

METAL = (0.5, 1.0)


@dataclass(frozen=True, slots=True)
class MaterialConfig:
    """Levels are of a reflectance head on of 0.02 (water has that), of paint, and of 0.08 (sapphire).

    To believe in another takes a mean gain over a region; a coat that mirrors twice as much brought 0.2. Where shadows are not
    foreseen rightly another level may explain a groove better than paint does, and metal up to twice as well; of gold, satin, the
    residuals are 14 times narrower as metal's in the median and 5 in the tenth worst.
    """

    specular_levels: tuple[float, float, float] = (0.25, 0.5, 1.0)
    kept_back: int = 4  # of so many views one decides
    gauss_newton_steps: int = 8
    candidates: int = 300  # normals, searched
    pixels: int = 600  # that are solved as every material
    regions: int = 12
    no_prior: float = 1e6  # spread of what is expected where nothing is
    like: float = 0.5  # difference in log radiance that parts two pixels as far as half the object's size
    loudest: float = 1.0  # that a pixel says for or against a level at most: log ratio per view and channel
    least_gain: float = 0.05  # of another level, in log likelihood per view and channel;
    least_gain_sigmas: float = 4.0  # so many of its own standard errors;
    least_pixels: int = 20  # and of so many
    explained_ratio: float = 1.5  # pixels speak of levels whose residuals are at most so many times as wide
    explained_share: float = 0.33  # as in this share of all
    narrower: float = 3.0  # so many times narrower a metal's residuals must be as metal's than as paint's;
    certain: float = 1.5  # log of a further factor that makes quite sure
    metal_share: float = 0.02  # of the pixels asked, from which on all are
    neighbours_px: float = 1.0  # one standard deviation: whose word on metal counts as a pixel's own


CONFIG = MaterialConfig()


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """Some pixels in the views that fit them and in those that judge, and what they are taken for so far."""

    fitted: PixelProblem
    kept: PixelProblem
    state: PixelEstimate

    @property
    def data(self) -> int:
        """Views times channels that judge each pixel."""
        return self.kept.observations.radiance.shape[1]

    def tried(self, material: tuple[float, float], progress: Progress) -> PixelEstimate:
        """The pixels as of one material, by the views that fit."""
        problem, so_far = as_of(self.fitted, material), self.fitted.geometry.material
        first, searching, last = (progress.part(*span) for span in ((0, 0.5), (0.5, 0.6), (0.6, 1)))
        answer = minimize(self.state.begun_anew(), problem, CONFIG.gauss_newton_steps, first)
        if np.any((PAINT[1] if so_far is None else so_far[:, 1]) != material[1]):
            # As another kind of thing it may have ended anywhere; from nothing, with nothing hidden.
            bare = replace(problem, geometry=replace(problem.geometry, visibility=None))
            begun = exhaustive_search(bare, CONFIG.candidates, searching)
            begun = begun.begun_anew(residual_scale=self.state.residual_scale)
            other = minimize(begun, problem, CONFIG.gauss_newton_steps, last)
            answer = where(other.cost < answer.cost, other, answer)
        return answer

    def likelihood(self, answer: PixelEstimate, material: tuple[float, float]) -> Float[np.ndarray, " p"]:
        """Of every pixel's kept views by what was `tried` as this material, per view and channel; a logarithm, up to what is
        alike for all materials: residuals are as wide as they are so far."""
        # What is expected of roughness is no photograph's word.
        free = answer.begun_anew(roughness_prior=np.tile([0.5, CONFIG.no_prior], (len(answer.cost), 1)))
        judged = minimize(free, as_of(self.kept, material), 1, Progress())
        return -judged.cost / (2 * self.data * self.state.residual_scale**2)

    def spread(self, answer: PixelEstimate, material: tuple[float, float]) -> Float[np.ndarray, " p"]:
        """How wide the residuals of every pixel's kept views are by what was `tried` as this material."""
        return update_residual_scale(answer, as_of(self.kept, material)).residual_scale


def as_of(problem: PixelProblem, material: tuple[float, float]) -> PixelProblem:
    """The same pixels as if all were of one material."""
    made = np.tile(material, (len(problem.geometry.points), 1))
    return replace(problem, geometry=replace(problem.geometry, material=made))


def classify(
    object_pixels: ObjectPixels,
    state: PixelEstimate,
    light: IncidentLight,
    geometry: SurfaceGeometry,
    exactly: bool,
    params: SurfaceParams,
    seed: int,
    progress: Progress,
) -> Float[np.ndarray, "p 2"] | None:
    """The material of every pixel; None: nothing speaks against paint. `geometry` is that under which the state was
    solved; only `exactly` is it asked what else than metal it may be; `seed` picks the pixels that are asked."""
    chosen = random_subset(interior(object_pixels), CONFIG.pixels, seed)
    trial = _trial(object_pixels, chosen, state, light, geometry, params)
    spans = iter(progress.parts(len(CONFIG.specular_levels) + 2))
    as_paint = trial.tried(PAINT, next(spans))
    shiny = metallic(trial, as_paint, next(spans)) > 0
    level = np.full(len(state.residual_scale), PAINT[0])
    scale = trial.state.residual_scale
    heard = ~shiny & (scale < CONFIG.explained_ratio * np.quantile(scale, CONFIG.explained_share))
    if exactly and heard.any():
        kinds = [(float(one), PAINT[1]) for one in CONFIG.specular_levels]
        answers = [as_paint if one == PAINT else trial.tried(one, next(spans)) for one in kinds]
        said = np.stack([trial.likelihood(*pair) for pair in zip(answers, kinds, strict=True)], 1)
        region = regions(object_pixels, chosen, seed)
        level = levels(said[heard], region[chosen][heard], int(region.max()) + 1)[region]
    metal = np.zeros(len(level), bool)
    if shiny.mean() >= CONFIG.metal_share:
        everybody = _trial(object_pixels, np.arange(len(level)), state, light, geometry, params)
        blocks = pixel_blocks(object_pixels.mask)
        fitted, kept = (replace(some, blocks=blocks) for some in (everybody.fitted, everybody.kept))
        everybody = replace(everybody, fitted=fitted, kept=kept)
        voices = np.zeros(object_pixels.mask.shape)
        first, second = next(spans).parts(2)
        voices[object_pixels.mask] = metallic(everybody, everybody.tried(PAINT, first), second)
        metal = gaussian_filter(voices, CONFIG.neighbours_px)[object_pixels.mask] > 0
    if (level == PAINT[0]).all() and not metal.any():
        return None
    return np.where(metal[:, None], METAL, np.stack([level, np.full(len(level), PAINT[1])], 1))


def metallic(trial: Trial, as_paint: PixelEstimate, progress: Progress) -> Float[np.ndarray, " p"]:
    """How much narrower each pixel's residuals are as metal's than as paint's: a logarithm, above 0 where that is enough."""
    as_metal = trial.tried(METAL, progress)
    gained = np.log(trial.spread(as_paint, PAINT) / trial.spread(as_metal, METAL)) - np.log(CONFIG.narrower)
    return np.clip(gained, -CONFIG.certain, CONFIG.certain)


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
    feature = np.concatenate([2 * place / size, looks / CONFIG.like], 1)
    count = min(CONFIG.regions, len(chosen))
    centres, _ = kmeans2(feature[chosen], count, rng=seed, minit="++")
    return np.asarray(KDTree(centres).query(feature)[1])


def levels(
    said: Float[np.ndarray, "k l"], region: Int[np.ndarray, " k"], count: int
) -> Float[np.ndarray, " r"]:
    """The specular level of each of `count` regions by their pixels' log likelihoods, for one view and channel, of `specular_levels`:
    that of all together, unless its own speak against it."""
    usual = _level(said, PAINT[0]) or PAINT[0]
    found = np.full(count, usual)
    for k in np.unique(region):
        found[k] = _level(said[region == k], usual) or usual
    return found


def _level(said: Float[np.ndarray, "k l"], usual: float) -> float | None:
    """The level that some pixels speak for, against a `usual` one; None: not plainly for another."""
    if len(said) < CONFIG.least_pixels:
        return None
    low, middle, high = np.clip(said - said[:, 1:2], -CONFIG.loudest, CONFIG.loudest).T
    # Their logarithms are evenly spaced: the top of a parabola through three, no farther than they go.
    slope, bend = (high - low) / 2, low + high - 2 * middle
    top = -slope.mean() / bend.mean() if bend.mean() < 0 else np.sign(slope.mean())
    top, there = float(np.clip(top, -1, 1)), float(np.log2(usual / CONFIG.specular_levels[1]))
    gained = slope * (top - there) + bend * (top**2 - there**2) / 2
    # NaN: nobody knows, and it stays as it is.
    least = max(CONFIG.least_gain, CONFIG.least_gain_sigmas * gained.std() / np.sqrt(len(gained)))
    if not gained.mean() >= least:
        return None
    return float(CONFIG.specular_levels[1] * 2.0**top)


def _trial(
    object_pixels: ObjectPixels,
    chosen: Int[np.ndarray, " k"],
    state: PixelEstimate,
    light: IncidentLight,
    geometry: SurfaceGeometry,
    params: SurfaceParams,
) -> Trial:
    """Of some pixels; a few large parts of them share their light."""
    every = np.arange(light.energy.shape[2] // 3)
    back = every[CONFIG.kept_back - 1 :: CONFIG.kept_back]
    seen = []
    for views in (np.setdiff1d(every, back), back):
        here = light.views(views)
        sample = sample_pixels(object_pixels, geometry, 1.0, chosen, params, views, here)
        seen.append(sample.problem(here))
    return Trial(seen[0], seen[1], state.part(chosen))
