"""What the object's own heights hide, direction by direction, with a derivative.

All directions that lie in one plane with a pixel's viewing ray go one way over the picture, and what stands nearest to that ray on
the way is the horizon of them all: an angle, which one or two other pixels' heights and the pixel's own make. What a direction
clears it by says how much of the width of its cell is open: a shadow with a soft edge. As in the mesh that `visibility` casts rays
at, what stands in front is taken to be solid.

Camera frame; heights are logarithms of z; angles are radians from the way to the camera.
"""

# The stubs of scipy and numba misstate what comes back here.
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from engine.geometry import rays
from engine.surface.observations import numbered
from engine.types import Camera

AZIMUTHS = 96
"""Ways over the picture: twice as fine as the cells of a thousand directions are wide."""
NEAREST = 2
"""Pixels from a point to where something may stand in its way: nearer, a height says how the surface leans, which is the
normal's to tell."""
CLOSE, GROWTH, FARTHEST = 16, 1.12, 160
"""Pixels along a way that are looked at: every one so far, then in steps that grow, and no farther."""


@dataclass(frozen=True, slots=True, eq=False)
class Rims:
    """The horizons of some pixels."""

    angle: Float[np.ndarray, "b k"]  # pi where nothing stands
    first: Int[np.ndarray, "b k"]  # the two pixels between which it is; -1: none
    second: Int[np.ndarray, "b k"]
    share: Float[np.ndarray, "b k"]  # of the first in what follows
    lever: Float[
        np.ndarray, "b k"
    ]  # radians by which a horizon falls as its log height grows, and the pixel's own does not

    def pull(
        self, slope: Float[np.ndarray, "b k"], pixels: Int[np.ndarray, " b"], count: int
    ) -> Float[np.ndarray, " p"]:
        """From what a radian of each horizon costs more, what each of `count` log heights does."""
        moved = slope * self.lever
        found = np.bincount(pixels, -moved.sum(1), count)
        for which, share in ((self.first, self.share), (self.second, 1 - self.share)):
            stands = which >= 0
            found += np.bincount(which[stands], (moved * share)[stands], count)
        return found


class Ground:
    """Where the pixels of a mask look, ready for any heights."""

    def __init__(self, camera: Camera, mask: Bool[np.ndarray, "h w"]) -> None:
        q = rays(camera)[mask]
        self.towards = q / np.linalg.norm(q, axis=1, keepdims=True)
        self.place = np.stack(np.nonzero(mask), 1)
        # Ways are straight on the ideal plane, pixels a regular grid of it as far as the lens bends little over the object.
        grid = np.column_stack([self.place[:, ::-1], np.ones(len(self.place))])
        fit = np.linalg.lstsq(grid, q[:, :2] / q[:, 2:], rcond=None)[0]
        self.pitch, self.corner = (fit[0, 0], fit[1, 1]), fit[2]
        self.index = numbered(mask)
        steps = [*range(1, CLOSE + 1)]
        while (farther := int(np.ceil(steps[-1] * GROWTH))) <= FARTHEST:
            steps.append(farther)
        self.steps = np.array([step for step in steps if step >= NEAREST])

    def rims(self, height: Float[np.ndarray, " p"], pixels: Int[np.ndarray, " b"]) -> Rims:
        """Of some pixels."""
        shape = len(pixels), AZIMUTHS
        found = Rims(
            np.empty(shape),
            np.empty(shape, np.int64),
            np.empty(shape, np.int64),
            np.zeros(shape),
            np.zeros(shape),
        )
        turn = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
        _march(
            np.exp(height), self.index, self.place[pixels], pixels, *self.pitch, *self.corner, self.steps,
            np.cos(turn), np.sin(turn), found.angle, found.first, found.second, found.share, found.lever,
        )  # fmt: skip
        return found

    def seen(
        self, pixels: Int[np.ndarray, " b"], directions: Float[np.ndarray, "d 3"]
    ) -> tuple[Int[np.ndarray, " d"], Float[np.ndarray, "b d"]]:
        """The way on which every direction lies, one for neighbouring pixels all; and each pixel's angle to it (float32)."""
        middle = self.towards[pixels].mean(0)
        x, y = middle[:2] / middle[2]
        azimuth = np.arctan2(directions[:, 1] - y * directions[:, 2], directions[:, 0] - x * directions[:, 2])
        way = np.rint(azimuth * AZIMUTHS / (2 * np.pi)).astype(np.int64) % AZIMUTHS
        return way, np.arccos(np.clip(-self.towards[pixels] @ directions.T, -1, 1)).astype(np.float32)


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _march(
    z,
    index,
    place,
    pixels,
    pitch_x,
    pitch_y,
    left,
    top,
    steps,
    cosine,
    sine,
    angle,
    first,
    second,
    share,
    lever,
):
    """Along the major axis of every way from pixel to pixel, between two of them on the minor one: of planes, 1 / z is linear
    there, so that no plane hides itself."""
    rows, columns = index.shape
    for b in range(len(pixels)):
        v0, u0 = place[b]
        own = z[pixels[b]]
        x0, y0 = (left + pitch_x * u0) * own, (top + pitch_y * v0) * own
        far = np.sqrt(x0 * x0 + y0 * y0 + own * own)
        for k in range(len(cosine)):
            across, down = cosine[k] / pitch_x, sine[k] / pitch_y
            wide = abs(across) >= abs(down)
            sign = np.sign(across) if wide else np.sign(down)
            slope = (down if wide else across) / max(abs(across), abs(down))
            best, at, to, part_at, stands_at, length_at = -1.0, -1, -1, 0.0, 0.0, 1.0
            for step in steps:
                u = u0 + (sign if wide else slope) * step
                v = v0 + (slope if wide else sign) * step
                if not (0 <= u <= columns - 1 and 0 <= v <= rows - 1):
                    break
                if wide:
                    low = min(int(v), rows - 2)
                    part, one, two = v - low, index[low, int(u)], index[low + 1, int(u)]
                else:
                    low = min(int(u), columns - 2)
                    part, one, two = u - low, index[int(v), low], index[int(v), low + 1]
                if one < 0 or two < 0:
                    continue
                stands = z[one] * z[two] / ((1 - part) * z[two] + part * z[one])
                x, y, deep = (
                    (left + pitch_x * u) * stands - x0,
                    (top + pitch_y * v) * stands - y0,
                    stands - own,
                )
                length = np.sqrt(x * x + y * y + deep * deep)
                nearer = -(x * x0 + y * y0 + deep * own) / (far * length)
                if nearer > best:
                    best, at, to, part_at, stands_at, length_at = nearer, one, two, part, stands, length
            angle[b, k], first[b, k], second[b, k] = np.arccos(min(best, 1.0)), at, to
            if at >= 0:
                share[b, k] = (1 - part_at) * stands_at / z[at]
                # The pixel's own distance turns the way between them by this, seen from either end.
                lever[b, k] = far / length_at * np.sqrt(max(1 - best * best, 0.0))
