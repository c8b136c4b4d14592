"""Did the object move relative to the camera? Registers each shot's object to what earlier shots agree on.

Source: Weiss, "Deriving intrinsic images from image sequences" (2001): under changing light the median over
the shots of the gradient of log light is the gradient of the paint. Outlines against a changing room have no
steady sign, so the gradient's doubled angle and strength, relative to their surroundings, are taken as well.
Each value weighs by how steady it was; the shift, turn and scale that explain a new shot are found by
Gauss-Newton with a robust weight (Lucas and Kanade 1981), their errors from how blocks of the object disagree.
Pixels are those of `fine`, averaged until the object is at most 450 across; findings tell sites of the sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64

from engine.capture_checks.finding import Finding, Severity
from engine.hdr.develop import averaged

WIDEST_PX = 450  # of the region that is registered
MARGIN_PX = 8  # around the object: its outline, and room for a shift
SMOOTH_PX, AROUND_PX = 1.0, 4.0  # before gradients; of what a gradient's strength is relative to
FAINT = 1e-4  # squared log light per pixel: what is smoother has no strength to speak of
STEADIEST = 0.3  # of the typical spread: no value weighs as if it were steadier
ROBUST = 2.0  # spreads beyond which a value counts less and less
ROUNDS, DONE_PX = 10, 0.005
BLOCKS = 50
REACH_PX = 24  # how far a lost object is looked for
KEPT = 12  # shots that make the reference
WARN_PX, STOP_PX = 0.5, 1.5  # sites of the sensor
SURE = 5.0  # standard errors
ERROR_FLOOR_PX, ERROR_FACTOR = (
    0.02,
    3.0,
)  # light deceives neighbouring blocks alike: blocks say too small an error
FEWEST_HISTORY = 6
LOST, LOST_BLURRED = 0.4, 0.25  # of the usual likeness; below it the object is not what it was


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """What the kept shots agree on, over the object's surroundings."""

    box: tuple[slice, slice]  # of the averaged picture
    by: int  # `fine` is averaged by this
    values: Float32[np.ndarray, "c h w"]
    weight: Float32[np.ndarray, "c h w"]  # 1 / spread^2, zero away from the object
    slopes: Float32[np.ndarray, "c 4 h w"]  # of `values`, by shift x, shift y, turn and scale, in pixels
    centre: tuple[float, float]  # x, y in the box
    radius: float  # rms distance of the object's pixels from the centre


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """How a shot's object lies to the reference: x, y, turn and scale, the last two times `radius`."""

    moved: Float64[np.ndarray, " 4"]  # pixels of the averaged picture
    stderr: Float64[np.ndarray, " 4"]
    likeness: float  # 1: the same up to light; 0: nothing in common
    pitch: float  # sites of the sensor per pixel

    @property
    def distance(self) -> float:
        """Root mean square over the object, sites of the sensor."""
        return float(np.linalg.norm(self.moved)) * self.pitch


def reference(kept: Sequence[Float32[np.ndarray, "H W"]], object_mask: Bool[np.ndarray, "H W"]) -> Reference:
    """From the `log_light` of some shots in which the object did not move."""
    rows, columns = np.nonzero(object_mask.any(1))[0], np.nonzero(object_mask.any(0))[0]
    by = max(1, int(np.ceil(max(np.ptp(rows), np.ptp(columns)) / WIDEST_PX)))
    mask = averaged(object_mask.astype(np.float32), by) > 0
    rows, columns = np.nonzero(mask.any(1))[0], np.nonzero(mask.any(0))[0]
    box = (
        slice(max(rows[0] - MARGIN_PX, 0), rows[-1] + MARGIN_PX + 1),
        slice(max(columns[0] - MARGIN_PX, 0), columns[-1] + MARGIN_PX + 1),
    )
    near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8))[box] > 0
    stack = np.stack([_values(averaged(log, by)[box]) for log in kept])
    ranks = np.sort(stack, axis=0)
    values = (ranks[(len(kept) - 1) // 2] + ranks[len(kept) // 2]) / 2
    # Quartiles tell the spread in the same sorting.
    quarter = len(kept) // 4
    spread = (ranks[len(kept) - 1 - quarter] - ranks[quarter]) / 1.35
    least = STEADIEST * np.median(spread[:, near], axis=1)[:, None, None] + np.float32(1e-6)
    weight = np.where(near, 1 / np.square(np.maximum(spread, least)), 0).astype(np.float32)
    y, x = (grid.astype(np.float32) for grid in np.nonzero(near))
    centre = (float(x.mean()), float(y.mean()))
    radius = float(np.sqrt(x.var() + y.var()))
    return Reference(box, by, values, weight, _slopes(values, centre, radius), centre, radius)


def usual(motions: Sequence[Motion]) -> float:
    """How like the reference shots are; 1 where there are none."""
    return float(np.median([one.likeness for one in motions])) if motions else 1.0


def register(log: Float32[np.ndarray, "H W"], to: Reference, pitch: float, alike: float = 1.0) -> Motion:
    """Where the object of a shot lies; looked for further away where it is less like the reference than `alike`."""
    values = _values(averaged(log, to.by)[to.box])
    found = _refined(values, to, np.zeros(4), pitch)
    if found.likeness < 0.7 * alike or np.abs(found.moved).max() > 2:
        again = _refined(values, to, _looked_for(values, to), pitch)
        found = max(found, again, key=lambda one: one.likeness)
    return found


def check(name: str, now: Motion, earlier: Sequence[Motion], blurred: bool = False) -> Finding | None:
    """Whether the object moved; `earlier` are the shots in which it did not."""
    before = usual(earlier)
    remedy = "fix it to the camera's plate, and begin the session anew if it does not go back by itself"
    # What is blurred looks unlike itself without having moved.
    if now.likeness < (LOST_BLURRED if blurred else LOST) * before:
        seen = (
            f"the object does not look as it did (likeness {now.likeness:.2f}, else {before:.2f}): it fell, was"
            " exchanged, or something stands before it"
        )
        return Finding(name, "moved", Severity.STOP, now.likeness, "", seen, remedy)
    error = np.maximum(ERROR_FACTOR * now.stderr, ERROR_FLOOR_PX)
    if len(earlier) >= FEWEST_HISTORY:
        wandered = np.abs(np.stack([one.moved for one in earlier]))
        error = np.maximum(error, 1.4826 * np.median(wandered, axis=0))
    sure = float(np.linalg.norm(now.moved / error))
    if now.distance < WARN_PX or sure < SURE:
        return None
    severity = Severity.STOP if now.distance >= STOP_PX else Severity.WARNING
    x, y, turn, scale = now.moved * now.pitch
    parts = [
        f"{abs(y):.1f} px {'down' if y > 0 else 'up'}" if abs(y) > 0.2 else "",
        f"{abs(x):.1f} px {'right' if x > 0 else 'left'}" if abs(x) > 0.2 else "",
        f"turned by {abs(turn):.1f} px at its rim" if abs(turn) > 0.2 else "",
        f"{'larger' if scale > 0 else 'smaller'} by {abs(scale):.1f} px at its rim"
        if abs(scale) > 0.2
        else "",
    ]
    how = ", ".join(part for part in parts if part)
    seen = f"the object moved relative to the camera by {now.distance:.1f} px" + (f" ({how})" if how else "")
    return Finding(name, "moved", severity, now.distance, "px", seen, remedy)


def _values(log: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "5 h w"]:
    """Gradient with its sign, then doubled angle and strength relative to the surroundings."""
    soft = cv2.GaussianBlur(log, (0, 0), SMOOTH_PX)
    x, y = _derivative(soft)
    xx, yy, xy = x * x, y * y, x * y
    energy = xx + yy
    around = cv2.GaussianBlur(energy, (0, 0), AROUND_PX) + np.float32(FAINT)
    return np.stack([x, y, (xx - yy) / around, 2 * xy / around, energy / around])


def _derivative(image: Float32[np.ndarray, "h w"]) -> tuple[np.ndarray, np.ndarray]:
    central, point = np.array([-0.5, 0, 0.5], np.float32), np.ones(1, np.float32)
    return (
        cv2.sepFilter2D(image, cv2.CV_32F, central, point),
        cv2.sepFilter2D(image, cv2.CV_32F, point, central),
    )


def _slopes(
    values: Float32[np.ndarray, "c h w"], centre: tuple[float, float], radius: float
) -> Float32[np.ndarray, "c 4 h w"]:
    """How the values change, per pixel, when the object goes right, down, turns clockwise or grows."""
    c, h, w = values.shape
    y, x = np.mgrid[:h, :w].astype(np.float32)
    x, y = (x - centre[0]) / np.float32(radius), (y - centre[1]) / np.float32(radius)
    slopes = np.empty((c, 4, h, w), np.float32)
    for value, slope in zip(values, slopes, strict=True):
        by_x, by_y = _derivative(value)
        slope[0], slope[1] = -by_x, -by_y
        slope[2] = by_x * y - by_y * x
        slope[3] = -(by_x * x + by_y * y)
    return slopes


def _back(
    values: np.ndarray, to: Reference, moved: Float64[np.ndarray, " 4"]
) -> Float32[np.ndarray, "c h w"]:
    """A shot's values with the object's motion undone."""
    turn, grow = moved[2] / to.radius, 1 + moved[3] / to.radius
    cosine, sine = grow * np.cos(turn), grow * np.sin(turn)
    x, y = to.centre
    matrix = np.array(
        [
            [cosine, -sine, x + moved[0] - cosine * x + sine * y],
            [sine, cosine, y + moved[1] - sine * x - cosine * y],
        ]
    )
    h, w = values.shape[1:]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.stack(
        [
            cv2.warpAffine(value, matrix, (w, h), flags=flags, borderMode=cv2.BORDER_REFLECT)
            for value in values
        ]
    )


def _refined(values: np.ndarray, to: Reference, start: Float64[np.ndarray, " 4"], pitch: float) -> Motion:
    moved = start
    flat = to.slopes.transpose(1, 0, 2, 3).reshape(4, -1)
    rounds = 0
    while True:
        rounds += 1
        back = _back(values, to, moved)
        rest = back - to.values
        weight = to.weight / (1 + np.square(rest) * to.weight / ROBUST**2)
        heavy = flat * weight.ravel()
        information = (heavy @ flat.T).astype(np.float64)
        information += 1e-9 * np.trace(information) * np.eye(4) + 1e-12 * np.eye(4)
        step = np.linalg.solve(information, (heavy @ rest.ravel()).astype(np.float64))
        # Beyond a pixel the slopes say nothing.
        moved = moved + step / max(1.0, float(np.abs(step).max()))
        if np.abs(step).max() < DONE_PX or rounds == ROUNDS:
            break
    pull = (heavy * rest.ravel()).reshape(4, *rest.shape).sum(axis=1)
    inverse = np.linalg.inv(information)
    covariance = inverse @ _scatter(pull, to) @ inverse
    return Motion(
        moved, np.sqrt(np.maximum(np.diag(covariance), 0)), _likeness(back, to), float(pitch * to.by)
    )


def _scatter(pull: np.ndarray, to: Reference) -> Float64[np.ndarray, "4 4"]:
    """How much blocks of the object pull in their own ways."""
    size = max(6, int(np.sqrt((to.weight[0] > 0).sum() / BLOCKS)))
    _, h, w = pull.shape
    padded = np.pad(pull, ((0, 0), (0, -h % size), (0, -w % size)))
    blocks = padded.reshape(4, padded.shape[1] // size, size, padded.shape[2] // size, size).sum((2, 4))
    blocks = blocks.reshape(4, -1).astype(np.float64)
    return blocks @ blocks.T


def _likeness(back: np.ndarray, to: Reference) -> float:
    """Weighted correlation with the reference."""
    both = float((to.weight * back * to.values).sum())
    sizes = float((to.weight * back * back).sum()) * float((to.weight * to.values * to.values).sum())
    return both / max(float(np.sqrt(sizes)), 1e-12)


def _looked_for(values: np.ndarray, to: Reference) -> Float64[np.ndarray, " 4"]:
    """The whole shift, up to `REACH_PX`, at which a shot is most like the reference."""
    pattern = to.weight * to.values
    h, w = pattern.shape[1:]
    reach = min(REACH_PX, h // 3, w // 3)
    size = (cv2.getOptimalDFTSize(h + reach), cv2.getOptimalDFTSize(w + reach))
    total = np.zeros((size[0], size[1] // 2 + 1), np.complex64)
    for value, template in zip(values, pattern, strict=True):
        total += np.fft.rfft2(value, size) * np.conj(np.fft.rfft2(template, size))
    match = np.fft.irfft2(total, size)
    shifts = np.arange(-reach, reach + 1)
    near = match[np.ix_(shifts, shifts)]
    y, x = np.unravel_index(int(near.argmax()), near.shape)
    return np.array([shifts[x], shifts[y], 0, 0], np.float64)
