"""Does the bracket hold the light? Shares clipped and dark, and the bracket that would hold all of it.

A lamp in the background may clip: its photograph is then a lower bound, and the object's shading tells the
rest. The object itself must never clip. EV are powers of two of exposure (s * ISO / 100 / f^2).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.shot_preview import LEVELS_PER_EV, LOWEST_EV, SATURATION, Sensor, ShotPreview

HELD_SHARE = 0.999  # of the pixels a proposed bracket holds
DARK_FLOORS = 4.0  # read noises that the darkest of them should reach in the longest exposure
MEDIAN_LEVEL = 1 / 2  # of full: what the longest exposure should give the typical pixel, for its noise
WIDEST_STEP_EV = 3.0  # between exposures: a site too bright for one still has a tenth of full in the next
BEYOND_EV = 3.0  # guessed where the shortest exposure clips: how much brighter nobody knows
OBJECT_CLIPPED, OBJECT_DARK = 5e-4, 0.02  # shares of the object
ROOM_CLIPPED_NOTE, ROOM_CLIPPED, ROOM_DARK = 0.01, 0.05, 0.10  # shares of the picture
HOPELESS = 0.90  # the merge refuses a view beyond


@dataclass(frozen=True, slots=True)
class Proposal:
    """A bracket: what to change the middle exposure by, and the offsets around it, in EV."""

    shift_ev: float
    stops: tuple[float, ...]
    at_least: bool  # lamps outshine the shortest exposure, so it may have to be shorter still

    def told(self) -> str:
        steps = ", ".join(f"{stop:+.3g}" if stop else "0" for stop in self.stops)
        change = f"change the middle exposure by {self.shift_ev:+.1f} EV and " if self.shift_ev else ""
        return f"{change}bracket {steps} EV{' or wider' if self.at_least else ''}"


def check(
    glance: ShotPreview,
    object_mask: Bool[np.ndarray, "h w"] | None,
    histogram: Float64[np.ndarray, " b"],
    sensor: Sensor,
) -> tuple[Finding, ...]:
    """Findings of one shot; `object_mask` on the grid of `glance.small`, `histogram` of all shots so far."""
    remedy = _remedy(proposal(glance.exposures, histogram, glance.share_clipped, sensor, glance.full_counts))
    found: list[Finding] = []

    def say(severity: Severity, share: float, seen: str) -> None:
        found.append(Finding(glance.name, "exposure", severity, 100 * share, "%", seen, remedy))

    if glance.share_clipped > HOPELESS:
        say(Severity.STOP, glance.share_clipped, f"{glance.share_clipped:.0%} of the picture is clipped in"
            " every exposure")  # fmt: skip
    elif glance.share_clipped > ROOM_CLIPPED_NOTE:
        severity = Severity.WARNING if glance.share_clipped > ROOM_CLIPPED else Severity.NOTE
        say(severity, glance.share_clipped, f"{glance.share_clipped:.1%} of the picture is clipped even in the"
            " shortest exposure")  # fmt: skip
    if glance.share_dark > HOPELESS:
        say(Severity.STOP, glance.share_dark, f"{glance.share_dark:.0%} of the picture is below noise in every"
            " exposure (lens cap on, or no light?)")  # fmt: skip
    elif glance.share_dark > ROOM_DARK:
        say(Severity.WARNING, glance.share_dark, f"{glance.share_dark:.0%} of the picture is below noise even"
            " in the longest exposure")  # fmt: skip
    if object_mask is None or any(finding.severity is Severity.STOP for finding in found):
        return tuple(found)
    # Nobody knows the outline exactly, and a lamp may shine just beside it.
    inside = cv2.erode(object_mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if not inside.any():
        return tuple(found)
    clipped, dark = (float(flag[inside].mean()) for flag in (glance.clipped, glance.dark))
    if clipped > OBJECT_CLIPPED:
        say(
            Severity.WARNING, clipped, f"{clipped:.2%} of the object is clipped even in the shortest exposure"
        )
    if dark > OBJECT_DARK:
        say(Severity.WARNING, dark, f"{dark:.1%} of the object is below noise even in the longest exposure")
    return tuple(found)


def proposal(
    exposures: Sequence[float],
    histogram: Float64[np.ndarray, " b"],
    share_clipped: float,
    sensor: Sensor,
    full_counts: float,
) -> Proposal | None:
    """The bracket that holds the light in `histogram`; None where the one in use (`exposures`) does."""
    total = float(histogram.sum())
    if not total > 0:
        return None
    below = np.cumsum(histogram) / total
    tail = (1 - HELD_SHARE) / 2
    edges = LOWEST_EV + np.arange(len(histogram) + 1) / LEVELS_PER_EV
    darkest, middle = (float(edges[np.searchsorted(below, share)]) for share in (tail, 0.5))
    brightest = float(edges[1 + np.searchsorted(below, 1 - tail)])
    at_least = share_clipped > tail
    if at_least:
        # Clipped pixels are counted at the level where the shortest exposure clips.
        brightest = max(brightest, -math.log2(exposures[0])) + BEYOND_EV
    low = math.log2(SATURATION * sensor.white_share) - brightest
    floor = DARK_FLOORS * sensor.noise.read / full_counts
    high = max(math.log2(floor) - darkest, math.log2(MEDIAN_LEVEL) - middle, low)
    now = [math.log2(exposure) for exposure in exposures]
    slack = 1 / LEVELS_PER_EV
    if now[0] <= low + slack and now[-1] >= high - slack:
        return None
    half = (high - low) / 2
    steps = math.ceil(half / WIDEST_STEP_EV - 0.05)
    step = math.ceil(3 * half / steps - 0.1) / 3 if steps else 0.0
    shift = round(3 * ((low + high) / 2 - now[len(now) // 2])) / 3
    return Proposal(shift, tuple(step * i for i in range(-steps, steps + 1)), at_least)


def _remedy(proposed: Proposal | None) -> str:
    if proposed is None:
        return "the bracket suits the other shots: see what is different here"
    return proposed.told()
