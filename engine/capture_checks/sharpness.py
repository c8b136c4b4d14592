"""How wide the sharpest edges are: blur of the object (focus) and of the room behind it (motion), told apart.

Source: Zhuo and Sim, "Defocus map estimation from a single image" (2011): at an edge, the ratio of gradients at
two smoothings tells the edge's own width (its standard deviation as a blurred step). Gradients are of the
logarithm of light, so that bright and dark edges count alike. Only ridges well above noise are measured, and a
view with too few of them is not judged. Motion blurs edges across it only, hence the four directions. Widths are
in pixels of `fine` inside, in sites of the sensor in findings.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, UInt8

from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.shot_preview import ShotPreview, log_light

NARROW_PX, WIDE_PX = 0.7, 2.0  # the two smoothings
SHARPEST = 25  # percentile of the widths: thin lines look sharper, shadows' rims wider, than a step
FEWEST_EDGES = 30  # of a direction
LEAST_STEP = 0.04  # log light per pixel; weaker edges are shading
NOISES = 8.0  # gradients below so many standard deviations are noise
DIRECTIONS = ("horizontal", "falling diagonal", "vertical", "rising diagonal")  # that edges are blurred along
STEPS = np.array([(1, 0), (1, 1), (0, 1), (-1, 1)])  # x and y, along each
WIDER_PX, SPREADS = 0.5, 6.0  # beyond earlier shots: pixels, and median absolute deviations
FEWEST_EARLIER = 3
OBJECT_MOST_PX, ROOM_MOST_PX = 2.2, 1.8  # whatever earlier shots say
ONE_WAY_PX = 0.4  # between directions: then the blur is motion


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Every edge pixel of a shot that can be measured."""

    row: Int[np.ndarray, " n"]  # of `fine`
    column: Int[np.ndarray, " n"]
    width: Float32[np.ndarray, " n"]
    direction: UInt8[np.ndarray, " n"]  # index into `DIRECTIONS`


@dataclass(frozen=True, slots=True, eq=False)
class Sharpness:
    """Width of the sharpest quarter of edges across each of `DIRECTIONS`; NaN where too few."""

    object: Float64[np.ndarray, " 4"]
    room: Float64[np.ndarray, " 4"]


def measure(edges: Edges, object_mask: Bool[np.ndarray, "H W"] | None) -> Sharpness:
    """The sharpest edges of object and room; without a mask everything counts as the room."""
    if object_mask is None:
        return Sharpness(np.full(4, np.nan), _sharpest(edges, np.ones(len(edges.row), bool)))
    # An edge on the outline is the object's: it lies in the object's focus.
    near = cv2.dilate(object_mask.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    ours = near[edges.row, edges.column]
    return Sharpness(_sharpest(edges, ours), _sharpest(edges, ~ours))


def blur_px(glance: ShotPreview) -> float:
    """Width of the picture's sharpest edges across the worst direction, in sites of the sensor; NaN where too few."""
    widths = measure(edges_of(glance), None).room
    return float("nan") if np.isnan(widths).all() else float(np.nanmax(widths)) * glance.pitch


def check(glance: ShotPreview, now: Sharpness, earlier: Sequence[Sharpness]) -> tuple[Finding, ...]:
    """Findings of one shot against the session's earlier ones and against what any lens can do."""
    object_px, object_usual, object_blurred = _wider(
        now.object, [one.object for one in earlier], OBJECT_MOST_PX
    )
    room_px, room_usual, room_blurred = _wider(now.room, [one.room for one in earlier], ROOM_MOST_PX)
    found: list[Finding] = []

    def say(width: float, seen: str, remedy: str) -> None:
        found.append(Finding(glance.name, "blur", Severity.WARNING, width * glance.pitch, "px", seen, remedy))

    def told(width: float, usual: float) -> str:
        than = "" if np.isnan(usual) else f" ({usual * glance.pitch:.1f} px in earlier shots)"
        return f"{width * glance.pitch:.1f} px wide{than}"

    if object_blurred:
        where = "the object's edges are" if not room_blurred else "the edges of object and room are"
        say(object_px, f"{where} {told(object_px, object_usual)}: out of focus",
            "switch autofocus off, focus on the object, and take this pose again")  # fmt: skip
    elif room_blurred:
        spread = np.nanmax(now.room) - np.nanmin(now.room)
        if spread > ONE_WAY_PX:
            along = DIRECTIONS[int(np.nanargmax(now.room))]
            say(room_px, f"the room's edges are {told(room_px, room_usual)} along the {along}: the rig moved"
                " while it exposed", "wait longer before each shot, or hold still, and take this pose"
                " again")  # fmt: skip
        else:
            say(room_px, f"the room's edges are {told(room_px, room_usual)} in all directions",
                "check that nothing shook and that focus did not change; close the aperture if the room is"
                " always that soft")  # fmt: skip
    return tuple(found)


def _wider(
    now: Float64[np.ndarray, " 4"], earlier: Sequence[Float64[np.ndarray, " 4"]], most_px: float
) -> tuple[float, float, bool]:
    """Width in the worst direction, what it usually is (NaN unknown), and whether that is too much."""
    if np.isnan(now).all():
        return float("nan"), float("nan"), False
    worst = float(np.nanmax(now))
    before = np.array([np.nanmax(one) for one in earlier if not np.isnan(one).all()])
    if len(before) < FEWEST_EARLIER:
        return worst, float("nan"), worst > most_px
    usual = float(np.median(before))
    spread = float(np.median(np.abs(before - usual)))
    return worst, usual, worst > usual + max(WIDER_PX, SPREADS * spread) or worst > max(most_px, usual + 0.3)


def edges_of(glance: ShotPreview) -> Edges:
    """Ridges of the gradient that stand out from noise and shading, clear of what is clipped."""
    shot, floor = glance.noise
    log = log_light(glance)
    narrow_x, narrow_y = _gradient(log, NARROW_PX)
    narrow = np.hypot(narrow_x, narrow_y)
    spoiled = cv2.dilate(glance.fine_clipped.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    row, column = np.nonzero((narrow > LEAST_STEP) & ~spoiled)
    angle = np.arctan2(narrow_y[row, column], narrow_x[row, column])
    direction = np.mod(np.rint(angle / (np.pi / 4)), 4).astype(np.uint8)
    size, here = narrow[row, column], np.maximum(glance.fine[row, column], 0)
    # Standard deviation of a component of the gradient of smoothed white noise.
    noise = np.sqrt(shot * here + floor**2) / np.exp(log[row, column]) / (NARROW_PX**2 * np.sqrt(8 * np.pi))
    padded = np.pad(narrow, 1, mode="edge")
    step_x, step_y = STEPS[direction].T
    ridge = (size >= padded[row + 1 + step_y, column + 1 + step_x]) & (
        size >= padded[row + 1 - step_y, column + 1 - step_x]
    )
    sure = ridge & (size > NOISES * noise)
    row, column, direction, size = row[sure], column[sure], direction[sure], size[sure]
    wide_x, wide_y = _gradient(log, WIDE_PX)
    wide = np.hypot(wide_x[row, column], wide_y[row, column])
    ratio = np.square(size / np.maximum(wide, np.float32(1e-9)))
    # ratio = (WIDE^2 + width^2) / (NARROW^2 + width^2), solved for the width.
    squared = (WIDE_PX**2 - ratio * NARROW_PX**2) / np.maximum(ratio - 1, 0.02)
    return Edges(row, column, np.sqrt(np.maximum(squared, 0)).astype(np.float32), direction)


def _gradient(log: Float32[np.ndarray, "H W"], smooth_px: float) -> tuple[np.ndarray, np.ndarray]:
    soft = cv2.GaussianBlur(log, (0, 0), smooth_px)
    return (
        cv2.Sobel(soft, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8),
        cv2.Sobel(soft, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8),
    )


def _sharpest(edges: Edges, chosen: Bool[np.ndarray, " n"]) -> Float64[np.ndarray, " 4"]:
    answer = np.full(4, np.nan)
    for turn in range(4):
        found = edges.width[chosen & (edges.direction == turn)]
        if len(found) >= FEWEST_EDGES:
            answer[turn] = np.percentile(found, SHARPEST)
    return answer
