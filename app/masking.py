"""Painting strokes on a mask, without Qt: what is object, what is room, and how every change is taken back.

Places are in pixels of the developed photographs, x right, y down; the centre of the first pixel is (0.5, 0.5).
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

NOTHING, ADD, TAKE = 0, 1, 2  # of a pixel: nobody painted it, it is object, it is room
EXACT = 2  # more where that says nothing of what is around it
SMALLEST, LARGEST = 1, 400  # of a brush, pixels across
LIGHTEST = 0.2  # share of the brush's size that the lightest touch of a pen paints with
TOOLS = ("brush", "eraser", "polygon")

Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Patch:
    """A part of the painting before and after a change; `apply` goes either way."""

    top: int
    left: int
    shape: tuple[int, int]
    before: bytes  # deflated
    after: bytes


class Painting:
    """One label a pixel. `labels` stays the same array for the painting's whole life."""

    def __init__(self, labels: UInt8[np.ndarray, "h w"]) -> None:
        height, width = labels.shape
        # Rows begin at whole words: the window draws this very memory.
        self.labels: UInt8[np.ndarray, "h w"] = np.zeros((height, -(-width // 4) * 4), np.uint8)[:, :width]
        self.labels[...] = labels
        self._before: np.ndarray | None = None

    @property
    def empty(self) -> bool:
        return not self.labels.any()

    def begin(self) -> None:
        """A change begins; `end` makes one patch of all that was painted since."""
        self._before = self.labels.copy()

    def line(self, one: Place, other: Place, size: float, label: int) -> None:
        """A round brush, `size` pixels across, drawn from one place to another."""
        half = max(size, SMALLEST) / 2
        (x0, y0), (x1, y1) = one, other
        rows, columns = self._box(
            min(x0, x1) - half, min(y0, y1) - half, max(x0, x1) + half, max(y0, y1) + half
        )
        y, x = (np.arange(part.start, part.stop) + 0.5 for part in (rows, columns))
        dx, dy = x1 - x0, y1 - y0
        along = ((x - x0) * dx + ((y - y0) * dy)[:, None]) / max(dx * dx + dy * dy, 1e-12)
        along = np.clip(along, 0, 1)
        far = np.square(x - x0 - along * dx) + np.square((y - y0)[:, None] - along * dy)
        covered = far <= half * half
        # A brush finer than the grid still paints the pixel it is in.
        at = int(y1) - rows.start, int(x1) - columns.start
        if 0 <= at[0] < covered.shape[0] and 0 <= at[1] < covered.shape[1]:
            covered[at] = True
        self.labels[rows, columns][covered] = label

    def polygon(self, corners: Sequence[Place], label: int) -> None:
        """Everything inside; where it crosses itself, what an odd number of turns encloses."""
        xs, ys = [x for x, _ in corners], [y for _, y in corners]
        rows, columns = self._box(min(xs), min(ys), max(xs), max(ys))
        inside = enclosed(np.array(corners, float), rows, columns)
        self.labels[rows, columns][inside] = label

    def clear(self) -> None:
        self.labels[...] = NOTHING

    def end(self) -> Patch | None:
        """What changed since `begin`; None where nothing did."""
        before, self._before = self._before, None
        if before is None:
            return None
        changed = before != self.labels
        rows, columns = (np.flatnonzero(changed.any(axis)) for axis in (1, 0))
        if not len(rows):
            return None
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        old, new = before[box], self.labels[box]
        return Patch(int(rows[0]), int(columns[0]), new.shape, _packed(old), _packed(new))

    def apply(self, patch: Patch, back: bool) -> None:
        """Make a change again, or take it back."""
        height, width = patch.shape
        content = zlib.decompress(patch.before if back else patch.after)
        place = slice(patch.top, patch.top + height), slice(patch.left, patch.left + width)
        self.labels[place] = np.frombuffer(content, np.uint8).reshape(patch.shape)
        if self._before is not None:
            self._before[place] = self.labels[place]  # no part of what is being painted meanwhile

    def _box(self, left: float, top: float, right: float, bottom: float) -> tuple[slice, slice]:
        """The pixels that such a box touches, as rows and columns."""
        height, width = self.labels.shape
        rows = slice(min(max(int(top), 0), height), min(max(int(bottom) + 1, 0), height))
        return rows, slice(min(max(int(left), 0), width), min(max(int(right) + 1, 0), width))


class Editor:
    """The tool in the hand, and what it is doing."""

    def __init__(self) -> None:
        self.painting: Painting | None = None
        self.tool = "brush"
        self.adds, self.exact = True, False
        self.size = 24
        self.corners: list[Place] = []
        self._last: tuple[Place, float] | None = None  # of the stroke under way, with its brush's size

    @property
    def label(self) -> int:
        said = (ADD if self.adds else TAKE) + EXACT * self.exact
        return NOTHING if self.tool == "eraser" else said

    @property
    def drawing(self) -> bool:
        """Whether a stroke is under way."""
        return self._last is not None

    def show(self, painting: Painting | None) -> None:
        self.painting, self._last = painting, None
        self.corners = []

    def choose(self, tool: str) -> None:
        self.tool = tool
        self.corners = []

    def resize(self, size: int) -> None:
        self.size = min(max(size, SMALLEST), LARGEST)

    def press(self, at: Place, pressure: float = 1.0) -> None:
        """Put brush or eraser down; `pressure` of a pen, from 0 to 1, scales it."""
        if self.painting is None or self.tool == "polygon":
            return
        self.painting.begin()
        self._last = at, self._scaled(pressure)
        self.painting.line(at, at, self._last[1], self.label)

    def drag(self, at: Place, pressure: float = 1.0) -> None:
        if self.painting is not None and self._last is not None:
            size = self._scaled(pressure)
            self.painting.line(self._last[0], at, size, self.label)
            self._last = at, size

    def release(self) -> Patch | None:
        """Lift it."""
        drawing, self._last = self.drawing, None
        return self.painting.end() if self.painting is not None and drawing else None

    def corner(self, at: Place) -> None:
        """Set the polygon's next corner; a place twice in a row counts once."""
        if self.painting is not None and self.corners[-1:] != [at]:
            self.corners.append(at)

    def drop_corner(self) -> None:
        if self.corners:
            self.corners.pop()

    def close(self) -> Patch | None:
        """Fill the polygon; fewer than three corners enclose nothing and are forgotten."""
        corners, self.corners = self.corners, []
        if self.painting is None or len(corners) < 3:
            return None
        self.painting.begin()
        self.painting.polygon(corners, self.label)
        return self.painting.end()

    def clear(self) -> Patch | None:
        """Take all strokes away."""
        self.corners = []
        if self.painting is None:
            return None
        self.painting.begin()
        self.painting.clear()
        return self.painting.end()

    def _scaled(self, pressure: float) -> float:
        return self.size * (LIGHTEST + (1 - LIGHTEST) * min(max(pressure, 0.0), 1.0))


def enclosed(corners: Float[np.ndarray, "n 2"], rows: slice, columns: slice) -> Bool[np.ndarray, "h w"]:
    """Pixels whose centre lies inside a polygon, by the parity of the edges left of it."""
    height, width = rows.stop - rows.start, columns.stop - columns.start
    flips = np.zeros((height, width + 1), np.uint8)
    centres = np.arange(rows.start, rows.stop) + 0.5
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        crossed = np.flatnonzero((y0 > centres) != (y1 > centres))
        if len(crossed):
            x = x0 + (centres[crossed] - y0) / (y1 - y0) * (x1 - x0)
            first = np.clip(np.ceil(x - 0.5).astype(int) - columns.start, 0, width)
            flips[crossed, first] ^= 1
    return np.bitwise_xor.accumulate(flips, axis=1)[:, :width].astype(bool)


def outline(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "n 4"]:
    """The border of a mask along its pixels' edges, as straight pieces x0, y0, x1, y1."""
    y, x0, x1 = _runs(mask)
    x, y0, y1 = _runs(mask.T)
    return np.concatenate([np.stack([x0, y, x1, y], axis=1), np.stack([x, y0, x, y1], axis=1)])


def _runs(mask: Bool[np.ndarray, "h w"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Border between rows: the row below it, and the columns from which to which it goes."""
    across = np.diff(np.pad(mask.astype(np.int8), ((1, 1), (0, 0))), axis=0) != 0
    ends = np.diff(np.pad(across.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    row, first = np.nonzero(ends == 1)
    return row, first, np.nonzero(ends == -1)[1]


def _packed(labels: UInt8[np.ndarray, "h w"]) -> bytes:
    return zlib.compress(np.ascontiguousarray(labels).tobytes(), 1)
