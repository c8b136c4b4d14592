"""Stage *segment*: find the object, which stays put in the image while the room turns behind it.

Several first guesses, each from the pixels that behave unlike the frame's border, grow into populations
(`engine/segmentation/gmm_graph_cut.py`) of steady and changing pixels (`engine/segmentation/temporal_stability.py`) on small images; the guess
whose outline is the strongest is refined at full size. Masks are on the pixel grid of the photographs.

What a person painted is certain there, and a hint around it (`engine/segmentation/scribbles.py`).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int

from engine.errors import MaskError
from engine.progress import Progress
from engine.sampling import evenly_spaced
from engine.segmentation import gmm_graph_cut, scribbles
from engine.segmentation.params import SegmentParams
from engine.segmentation.temporal_stability import (
    FEATURES,
    TemporalStability,
    border_alike,
    measure,
    unexplained,
)
from engine.types import Frames, Masks

SQUARE = np.ones((3, 3), np.uint8)
OBJECT_PARTS, ROOM_PARTS = 4, 5  # Gaussians: albedos and shadows of the object, walls and lamps of the room
BORDER = 0.06  # of the shorter side: the frame in which mostly room is seen
ROOM_TAIL = 1.0  # percentile of the room's own density: what is rarer does not change like the room
HINT = 2.5  # a stroke's pull on the pixels beside it, in units of what their own evidence may weigh at most


@dataclass(frozen=True, slots=True, eq=False)
class Strokes:
    """What a person painted: certain there, a hint around it but where it is exact."""

    add: Bool[np.ndarray, "h w"]
    remove: Bool[np.ndarray, "h w"]
    exact: Bool[np.ndarray, "h w"] | None = None

    def hints(self) -> "Strokes | None":
        """Those that speak for what is around them."""
        if self.exact is None:
            return self
        hints = Strokes(self.add & ~self.exact, self.remove & ~self.exact)
        return hints if (hints.add | hints.remove).any() else None


@dataclass(frozen=True, slots=True)
class SegmentReport:
    """Facts of one segmentation, fit for JSON."""

    # Logs of how much more changes across the outline than within and outside; NaN of a mask that was given.
    stands_out: float
    border_alike: float  # share of the mask's border across which pixels change alike; NaN: not known


def segment(
    frames: Frames,
    params: SegmentParams,
    strokes: Strokes | None,
    progress: Progress,
    views: Int[np.ndarray, " k"] | None = None,
) -> tuple[Masks, SegmentReport]:
    """One object mask for the session, one background mask for each view; only `views`, by index, are looked at, or all.

    Raises:
        MaskError: too few views, or nothing stands out as staying put.
    """
    views = np.arange(len(frames.names)) if views is None else views
    if len(views) < params.fewest_views:
        raise MaskError(
            f"{len(views)} views are too few to tell the object from the room (at least"
            f" {params.fewest_views}); add views or give a mask"
        )
    rng = np.random.default_rng(0)
    chosen, by = _sample(frames, params, views)
    progress.step(0.0, "measuring what changes")
    small = measure(frames, chosen, by)
    best, best_score, begun = None, -np.inf, 0
    guesses = list(_first_guesses(small))
    hints = strokes and strokes.hints()
    said = hints and Strokes(scribbles.reduced(hints.add, by), scribbles.reduced(hints.remove, by))
    answers: list[Bool[np.ndarray, "h w"]] = []
    for number, guess in enumerate(guesses):
        progress.step(0.1 + 0.5 * number / len(guesses), "comparing first guesses")
        if any((guess & known).sum() > params.same_share * (guess | known).sum() for known in answers):
            continue
        grown = _grow(small, guess, params, params.search_rounds, rng, None)
        if grown is None:
            continue
        answers.append(grown)
        score = _score(grown, small, params) - _against(grown, said, params)
        if score > best_score:
            best, best_score, begun = grown, score, number
    stands_out = best is not None and _score(best, small, params) >= params.min_contrast
    guessed = stands_out or said is None or not said.add.any()
    if said is not None and not guessed:
        best = said.add  # where the object begins
    if best is None:
        raise MaskError(_NOTHING)
    full = small
    if by > 1:
        progress.step(0.6, "refining the outline")
        h, w = frames.dark.shape[1:]
        full = measure(frames, chosen, 1)
        best = cv2.resize(best.astype(np.uint8), (w, h), interpolation=cv2.INTER_NEAREST) > 0
        if guessed:  # also what hardly stands out on small images may do so at full size
            best = _sharper(best, full, begun, by)
    if by > 1 or hints is not None:
        best = _grow(full, best, params, params.refine_rounds, rng, hints)
        if best is None:
            raise MaskError(_NOTHING)
    progress.step(0.95, "checking")
    found = _without_specks(best, params)
    if strokes is None or not strokes.add.any():
        # A person who says where the object is needs no proof that it is there.
        _check(found, full, params)
    if strokes is not None:
        found = (found | strokes.add) & ~strokes.remove
    return from_object(frames, found, params), report_on(
        frames, found, params, views, _score(found, full, params)
    )


def report_on(
    frames: Frames,
    object_mask: Bool[np.ndarray, "h w"],
    params: SegmentParams,
    views: Int[np.ndarray, " k"] | None = None,
    stands_out: float = math.nan,
) -> SegmentReport:
    """What the photographs say of a mask, whoever it is from."""
    chosen, by = _sample(frames, params, np.arange(len(frames.names)) if views is None else views)
    enough = len(chosen) >= params.fewest_views
    return SegmentReport(stands_out, border_alike(frames, chosen, object_mask, by) if enough else math.nan)


def _sample(
    frames: Frames, params: SegmentParams, views: Int[np.ndarray, " k"]
) -> tuple[Int[np.ndarray, " n"], int]:
    """Of `views` those that are looked at, and the factor to the images of the search."""
    chosen = views[evenly_spaced(len(views), params.most_views)]
    return chosen, max(1, round(max(frames.dark.shape[1:]) / params.search_edge_px))


def from_object(frames: Frames, object_mask: Bool[np.ndarray, "h w"], params: SegmentParams) -> Masks:
    """Masks for an object that is known: the background is what lies clear of it by the margin.

    Raises:
        MaskError: the mask is empty, leaves no background, or is of another size.
    """
    if object_mask.shape != frames.dark.shape[1:]:
        height, width = frames.dark.shape[1:]
        raise MaskError(
            f"the object mask is {object_mask.shape[1]} x {object_mask.shape[0]}, the photographs are {width}"
            f" x {height}; give a mask of the photographs' size"
        )
    size = 2 * params.margin_px + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    clear = cv2.dilate(object_mask.astype(np.uint8), kernel) == 0
    if not object_mask.any() or not clear.any():
        what = "no object" if not object_mask.any() else "no background"
        raise MaskError(f"the mask leaves {what}; paint the object white, the room black")
    return Masks(object_mask, np.broadcast_to(clear, frames.dark.shape).copy())


_NOTHING = (
    "nothing in the photographs stays put while the rest moves; check that camera and object move together"
    " through the room, or give a mask (--mask)"
)


def _first_guesses(steadiness: TemporalStability) -> Iterator[Bool[np.ndarray, "h w"]]:
    """Where pixels are steadier than, or in any way unlike, the border of the image, its rows or its columns.

    A turntable shows each row its own band of the room, a tilting head each column.
    """
    h, w, _ = steadiness.features.shape
    band = max(3, round(BORDER * min(h, w)))
    ring = np.ones((h, w), bool)
    ring[band:-band, band:-band] = False
    spread, colour = FEATURES.index("spread"), FEATURES.index("colour_spread")
    everything = (FEATURES.index("mean"), spread, FEATURES.index("red"), FEATURES.index("blue"), colour)

    def unlike(feature: int, reference: str) -> Float32[np.ndarray, "h w"]:
        """Robust standard deviations below the reference."""
        values = steadiness.features[..., feature]
        if reference == "ring":
            border, middle = values[ring], np.median(values[ring])
        elif reference == "rows":
            border = np.concatenate([values[:, : 2 * band], values[:, -2 * band :]], axis=1)
            middle = np.median(border, axis=1, keepdims=True)
        else:
            border = np.concatenate([values[: 2 * band], values[-2 * band :]], axis=0)
            middle = np.median(border, axis=0, keepdims=True)
        mad = np.median(np.abs(border - middle))
        return ((middle - values) / (1.4826 * mad + 0.05)).astype(np.float32)

    for reference in ("ring", "rows", "columns"):
        steady = sum(np.clip(unlike(feature, reference), -3, 8) for feature in (spread, colour))
        yield _above(cv2.medianBlur(np.asarray(steady, np.float32), 5), 2.0)
        odd = sum(np.minimum(np.abs(unlike(feature, reference)), 8) for feature in everything)
        yield _above(cv2.medianBlur(np.asarray(odd, np.float32), 5), 5.0)


def _sharper(
    found: Bool[np.ndarray, "h w"], full: TemporalStability, begun: int, by: int
) -> Bool[np.ndarray, "h w"]:
    """An answer found on images smaller `by` a factor, without the gaps that the first guess it grew from has at full size.

    Gaps too narrow for the smaller images would be learnt as the object, and never be cut out again.
    """
    missed = found & ~next(islice(_first_guesses(full), begun, None))
    # What is broader than that was plain on the smaller images, which knew better than a first guess.
    broad = cv2.morphologyEx(
        missed.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2 * by + 1, 2 * by + 1), np.uint8)
    )
    return found & ~(missed & (broad == 0))


def _above(evidence: Float32[np.ndarray, "h w"], least: float) -> Bool[np.ndarray, "h w"]:
    """Above Otsu's threshold, and above `least` robust standard deviations."""
    low, high = np.percentile(evidence, [0.5, 99.5])
    levels = np.clip((evidence - low) / max(high - low, 1e-6) * 255, 0, 255).astype(np.uint8)
    threshold = low + cv2.threshold(levels, 0, 255, cv2.THRESH_OTSU)[0] / 255 * (high - low)
    return evidence > max(threshold, least)


def _grow(
    steadiness: TemporalStability,
    guess: Bool[np.ndarray, "h w"],
    params: SegmentParams,
    rounds: int,
    rng: np.random.Generator,
    strokes: Strokes | None,
) -> Bool[np.ndarray, "h w"] | None:
    """Learn both populations from the guess, cut anew, repeat; None where one of them dies out."""
    h, w, _ = steadiness.features.shape
    flat = steadiness.features.reshape(h * w, -1)
    spread = flat.std(axis=0) + np.float32(1e-6)
    features = (flat - flat.mean(axis=0)) / spread
    rank = min(params.rank, len(steadiness.relative) // 6)
    said = strokes or Strokes(np.zeros((h, w), bool), np.zeros((h, w), bool))
    adds, removes = scribbles.pull(steadiness, said.add), scribbles.pull(steadiness, said.remove)
    found = (guess | said.add) & ~said.remove
    led = (adds > scribbles.FAINT) & ~guess  # into the object, if at all, by hints alone
    odd = np.zeros((h, w), bool)  # unlike the room
    for _ in range(rounds):
        # Pixels on the outline are mixtures of both; each population is learnt clear of it.
        core = cv2.erode(found.astype(np.uint8), SQUARE) > 0
        if core.sum() < 0.3 * found.sum():
            core = found
        away = cv2.dilate(found.astype(np.uint8), SQUARE) == 0
        # Nor does either learn from what a stroke speaks about: there the pixels misled us, or the hand slipped.
        sure = _unless(said.add | led | (removes > scribbles.FAINT), core)
        core = _unless(said.add | (led & ~odd) | (removes > scribbles.FAINT), core)
        away = _unless(said.remove | (adds > scribbles.FAINT), away)
        if min(core.sum(), away.sum()) < 4 * gmm_graph_cut.FEWEST:
            return None
        rest = unexplained(steadiness, sure, rank, rng).ravel()
        every = np.column_stack([features, (rest - rest.mean()) / (rest.std() + np.float32(1e-6))])
        ours = gmm_graph_cut.fit(every[core.ravel()], OBJECT_PARTS, rng)
        theirs = gmm_graph_cut.fit(every[away.ravel()], ROOM_PARTS, rng)
        as_room = gmm_graph_cut.log_density(every, theirs).reshape(h, w)
        odds = gmm_graph_cut.log_density(every, ours).reshape(h, w) - as_room
        # A clamp may ride along like the object, but nothing of the object changes like the room: no hint adds that.
        rare = as_room < np.percentile(as_room[away], ROOM_TAIL)
        odd = cv2.medianBlur(rare.astype(np.uint8), 5) > 0  # single pixels of the room are rare too
        own = np.clip(params.unary_weight * odds, -params.unary_limit, params.unary_limit)
        pull = own + HINT * params.unary_limit * (np.where(odd, adds, 0) - removes)
        # A stroke pulls harder than all links of a pixel can.
        certain = 5 * params.smoothness
        pull = np.where(said.add, certain, np.where(said.remove, -certain, pull))
        found = gmm_graph_cut.cut(pull, steadiness.link_x, steadiness.link_y, params.smoothness, certain)
    return found


def _unless(spoken: Bool[np.ndarray, "h w"], where: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """What of `where` nobody spoke about; all of it where that is too little to learn from."""
    rest = where & ~spoken
    return rest if rest.sum() >= 4 * gmm_graph_cut.FEWEST else where


def _contrast(
    found: Bool[np.ndarray, "h w"], steadiness: TemporalStability
) -> tuple[Float32[np.ndarray, " a"], Float32[np.ndarray, " b"], Float32[np.ndarray, " c"]]:
    """Log variances of the links across the outline, within the object, within the room."""
    pairs = ((found[:, 1:], found[:, :-1], steadiness.link_x), (found[1:], found[:-1], steadiness.link_y))
    across = np.concatenate([np.log(link[one != two]) for one, two, link in pairs])
    within = np.concatenate([np.log(link[one & two]) for one, two, link in pairs])
    outside = np.concatenate([np.log(link[~(one | two)]) for one, two, link in pairs])
    return across, within, outside


def _strength(found: Bool[np.ndarray, "h w"], steadiness: TemporalStability) -> tuple[float, float]:
    """How far the outline stands out from the object's own edges, and from the room's typical change."""
    across, within, outside = _contrast(found, steadiness)
    if min(len(across), len(within), len(outside)) < gmm_graph_cut.FEWEST:
        return -np.inf, -np.inf
    return (
        float(np.median(across) - np.percentile(within, 90)),
        float(np.percentile(across, 25) - np.median(outside)),
    )


def _score(found: Bool[np.ndarray, "h w"], steadiness: TemporalStability, params: SegmentParams) -> float:
    border = np.concatenate([found[0], found[-1], found[:, 0], found[:, -1]])
    return sum(_strength(found, steadiness)) - params.border_penalty * float(border.mean())


def _against(found: Bool[np.ndarray, "h w"], said: Strokes | None, params: SegmentParams) -> float:
    """What an answer loses for what was painted otherwise."""
    painted = 0 if said is None else int(said.add.sum() + said.remove.sum())
    if said is None or not painted:
        return 0.0
    return params.border_penalty * float((said.add & ~found).sum() + (said.remove & found).sum()) / painted


def _without_specks(found: Bool[np.ndarray, "h w"], params: SegmentParams) -> Bool[np.ndarray, "h w"]:
    """Without islands and holes too small to be real."""
    smallest = max(4.0, params.speck_share * found.size)
    for value in (True, False):
        count, labels, facts, _ = cv2.connectedComponentsWithStats(
            (found == value).astype(np.uint8), connectivity=8 if value else 4
        )
        small = [i for i in range(1, count) if facts[i, cv2.CC_STAT_AREA] < smallest]
        found = np.where(np.isin(labels, small), not value, found)
    return found


def _check(found: Bool[np.ndarray, "h w"], steadiness: TemporalStability, params: SegmentParams) -> None:
    """Refuse an outline across which no more changes than elsewhere."""
    if _score(found, steadiness, params) < params.min_contrast:
        raise MaskError(_NOTHING)
