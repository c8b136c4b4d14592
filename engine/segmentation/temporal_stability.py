"""How steadily each pixel behaves while the room turns behind the object: numbers for *segment*.

A pixel of the object shows one surface point in every view: its brightness follows the light around it, a
smooth thing, and its colour and its ratio to its neighbours hardly change. A pixel of the background shows
another part of the room each time. All statistics are taken over the views, pixel by pixel, without looking
around, so that thin parts are told as well as broad ones. Logarithms are natural, of luminance unless said otherwise.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int
from scipy.spatial import KDTree

from engine.color import luminance
from engine.hdr.develop import averaged
from engine.types import Frames

NORMAL_ROOTS = 2.19  # a normal variable's variance over the fourth power of its mean root magnitude
STEADY = 0.01**2  # variance of a log ratio that counts as no change
APART_PX = 2  # from the mask's border, on images of the search's size: past the pixels that mix both
ALIKE = 0.8  # correlation from which on two histories are of the same thing
BLOCK_PIXELS = 1 << 18  # histories that are explained at once: 100 MB of a hundred views
FEATURES = ("mean", "spread", "red", "blue", "colour_spread", "steadiest_links")


@dataclass(frozen=True, slots=True, eq=False)
class TemporalStability:
    """Statistics over the views of one session."""

    features: Float32[np.ndarray, "h w 6"]  # in the order of FEATURES
    link_x: Float32[np.ndarray, "h w-1"]  # how much the log ratio to the right neighbour changes, squared
    link_y: Float32[np.ndarray, "h-1 w"]  # and that to the one below; the photographs' noise is taken off
    relative: Float32[np.ndarray, "n h w"]  # luminance over the pixel's geometric mean


def measure(frames: Frames, views: Int[np.ndarray, " n"], by: int) -> TemporalStability:
    """One pass over `views`, each averaged down by a whole factor; of the photographs one at a time is in memory."""

    def seen(view: int) -> Float32[np.ndarray, "h w 3"]:
        return averaged(np.asarray(frames.radiance[view]), by)

    n = len(views)
    shot, floor = frames.noise[0] / by**2, frames.noise[1] / by
    some = np.stack([luminance(seen(view)) for view in views[:: max(1, n // 8)].tolist()])
    middle, (h, w) = float(np.median(some)), some.shape[1:]
    # Below the offset a logarithm would only show noise.
    offset = np.float32(max(3 * floor, 1e-3 * middle))
    first, second, noise = np.zeros((3, h, w)), np.zeros((3, h, w)), np.zeros((h, w))
    relative = np.empty((n, h, w), np.float32)
    for row, view in enumerate(views.tolist()):
        radiance = np.maximum(seen(view), 0)
        lum = luminance(radiance)
        logs = np.log(radiance + offset)
        brightness = np.log(lum + offset)
        values = np.stack([brightness, logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]])
        first += values
        second += np.square(values)
        noise += (shot * lum + floor**2) / np.square(lum + offset)
        relative[row] = brightness
    mean = first / n
    deviation = np.sqrt(np.maximum(second / n - np.square(mean), 0))
    noise /= n
    relative -= mean[0].astype(np.float32)
    link_x, link_y = np.zeros((h, w - 1), np.float32), np.zeros((h - 1, w), np.float32)
    for view in relative:
        # Roots, for what counts is that a ratio changes in most views: a lamp passes any pixel once.
        link_x += np.sqrt(np.abs(np.diff(view, axis=1)))
        link_y += np.sqrt(np.abs(np.diff(view, axis=0)))
    link_x = np.power(link_x / n, 4) * NORMAL_ROOTS - (noise[:, 1:] + noise[:, :-1])
    link_y = np.power(link_y / n, 4) * NORMAL_ROOTS - (noise[1:] + noise[:-1])
    # What noise leaves cannot be told from steadiness, nor a change of one percent from none.
    link_x = np.maximum(link_x, STEADY + 0.5 * (noise[:, 1:] + noise[:, :-1])).astype(np.float32)
    link_y = np.maximum(link_y, STEADY + 0.5 * (noise[1:] + noise[:-1])).astype(np.float32)
    np.exp(relative, out=relative)
    features = np.stack(
        [
            mean[0],
            np.log(deviation[0] + 1e-3),
            mean[1],
            mean[2],
            np.log(deviation[1:].mean(axis=0) + 1e-3),
            _steadiest(link_x, link_y),
        ],
        axis=-1,
    )
    return TemporalStability(features.astype(np.float32), link_x, link_y, relative)


def border_alike(
    frames: Frames, views: Int[np.ndarray, " n"], mask: Bool[np.ndarray, "h w"], by: int
) -> float:
    """Share of the mask's border across which two pixels change alike from view to view; NaN without such pixels.

    One shows the object, the other the room, and these do not. Where they do, both show the same: the mask is too large, too
    small or lacks a piece, or the photographs are out of focus. Only those pixels are read, every `by`-th at most.
    """
    small = mask[by // 2 :: by, by // 2 :: by]
    within, without = (
        cv2.distanceTransform(side.astype(np.uint8), cv2.DIST_L2, 5) for side in (small, ~small)
    )
    inside, outside = (np.argwhere((away >= APART_PX) & (away < APART_PX + 1)) for away in (within, without))
    if not len(inside) or not len(outside):
        return math.nan
    pairs = inside, outside[KDTree(outside).query(inside)[1]]
    rows, columns = np.moveaxis(by * np.stack(pairs) + by // 2, -1, 0)
    seen = np.stack([luminance(frames.radiance[view][rows, columns]) for view in views.tolist()])
    offset = max(3 * frames.noise[1], 1e-3 * float(np.median(seen)))
    logs = np.log(np.maximum(seen, 0) + offset)
    logs -= logs.mean(axis=0)
    together, (one, other) = logs.prod(axis=1).sum(axis=0), np.square(logs).sum(axis=0)
    return float((together > ALIKE * np.sqrt(one * other)).mean())


def unexplained(
    steadiness: TemporalStability, core: Bool[np.ndarray, "h w"], rank: int, rng: np.random.Generator
) -> Float32[np.ndarray, "h w"]:
    """Log of the part of each pixel's history that the histories of `core` do not explain.

    Under any light, a matte surface's shading is close to a sum of few patterns (nine, Ramamoorthi and
    Hanrahan 2001), so a few patterns learnt on the object explain the rest of it and little of the room.
    """
    n, h, w = steadiness.relative.shape
    history = steadiness.relative.reshape(n, h * w)
    inside = np.flatnonzero(core)
    sample = history[:, rng.permutation(inside)[:1500]]
    # A lamp close by may brighten a view tenfold; relative to the typical pixel every view counts alike.
    typical = np.maximum(np.median(sample, axis=1, keepdims=True), 1e-6)
    # Left singular vectors, from the small square matrix: its eigenvectors come in ascending order.
    shares = (sample / typical).astype(np.float64)
    patterns = np.linalg.eigh(shares @ shares.T)[1][:, -rank:].astype(np.float32)
    found = np.empty(h * w, np.float32)
    for begin in range(0, h * w, BLOCK_PIXELS):
        block = slice(begin, begin + BLOCK_PIXELS)
        scaled = history[:, block] / typical
        rest = scaled - patterns @ (patterns.T @ scaled)
        # Half of the views: glints and cast shadows in the others may go unexplained.
        found[block] = np.log(np.median(np.abs(rest), axis=0) + 1e-3)
    return found.reshape(h, w)


def _steadiest(
    link_x: Float32[np.ndarray, "h a"], link_y: Float32[np.ndarray, "b w"]
) -> Float64[np.ndarray, "h w"]:
    """Log deviation along the steadier two of a pixel's four links: an edge on one side does not count."""
    h, w = link_x.shape[0], link_y.shape[1]
    links = np.full((4, h, w), np.inf)
    links[0, :, :-1], links[1, :, 1:] = link_x, link_x
    links[2, :-1], links[3, 1:] = link_y, link_y
    return 0.5 * np.log(np.sort(links, axis=0)[:2].mean(axis=0))
