"""What the object's own heights hide, direction by direction, with a derivative.

All directions that lie in one plane with a pixel's viewing ray go one way over the picture. What stands on the way, as solid as
`depth_mesh` takes it to be, hides those between where its front begins and where its back ends: two angles, each made by one or two
other pixels' heights and the pixel's own. How far a direction is from them says how much of the width of its cell is open: a
shadow with a soft edge (`soft_shadow_transport`).

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
from engine.surface.data.observations import numbered
from engine.surface.visibility.depth_mesh import JUMP
from engine.types import Camera

AZIMUTHS = 96
"""Ways over the picture: twice as fine as the cells of a thousand directions are wide."""
NEAREST = 2
"""Pixels from a point to where something may stand in its way: nearer, a height says how the surface leans, which is the
normal's to tell."""
CLOSE, GROWTH, FARTHEST = 16, 1.12, 160
"""Pixels along a way that are looked at: every one so far, then in steps that grow, and no farther."""
PIECES = 4
"""Of one way that are told apart, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Rims:
    """What stands in the way of some pixels: on every way PIECES at most, each from where it begins to hide to where it ends."""

    angle: Float[np.ndarray, "b k m 2"]  # where a piece begins and where it ends; both pi where there is none
    first: Int[np.ndarray, "b k m 2"]  # the two pixels between which that is; -1: none
    second: Int[np.ndarray, "b k m 2"]
    share: Float[np.ndarray, "b k m 2"]  # of the first in what follows
    lever: Float[
        np.ndarray, "b k m 2"
    ]  # radians by which an end falls as its log height grows, and the pixel's own does not

    def pull(
        self, slope: Float[np.ndarray, "b k m 2"], pixels: Int[np.ndarray, " b"], count: int
    ) -> Float[np.ndarray, " p"]:
        """From what a radian of each end costs more, what each of `count` log heights does."""
        moved = slope * self.lever
        found = np.bincount(pixels, -moved.sum((1, 2, 3)), count)
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

    def rims(
        self, height: Float[np.ndarray, " p"], deep: Float[np.ndarray, " p"], pixels: Int[np.ndarray, " b"]
    ) -> Rims:
        """Of some pixels, where what every pixel shows is so `deep`, in logarithms of z as the heights are."""
        shape = len(pixels), AZIMUTHS, PIECES, 2
        found = Rims(
            np.full(shape, np.pi),
            np.full(shape, -1),
            np.full(shape, -1),
            np.zeros(shape),
            np.zeros(shape),
        )
        turn = 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
        jump = JUMP * abs(self.pitch[0])
        _march(
            np.exp(height), np.exp(height + deep), self.index, self.place[pixels], pixels, *self.pitch, *self.corner,
            self.steps, jump, np.cos(turn), np.sin(turn), found.angle, found.first, found.second, found.share, found.lever,
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
    z, back, index, place, pixels, pitch_x, pitch_y, left, top, steps, jump, cosine, sine, angle, first, second, share, lever
):  # fmt: skip
    """Along the major axis of every way from pixel to pixel, between two of them on the minor one: of planes, 1 / z is linear
    there, so that no plane hides itself. What does not jump from step to step, or not farther than it is deep, is one piece."""
    rows, columns = index.shape
    most = angle.shape[2]
    ends, one_of, two_of = np.empty((most, 2)), np.empty((most, 2), np.int64), np.empty((most, 2), np.int64)
    parts, lengths = np.empty((most, 2)), np.empty((most, 2))
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
            before, before_back, before_step, now, pieces = 0.0, 0.0, 0, -1, 0
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
                    now = -1
                    continue
                if abs(z[one] - z[two]) > jump * min(z[one], z[two]):  # nothing stands half-way
                    one = two = one if part < 0.5 else two
                stands = z[one] * z[two] / ((1 - part) * z[two] + part * z[one])
                stops = back[one] * back[two] / ((1 - part) * back[two] + part * back[one])
                if now >= 0:
                    near, beyond, near_back = (
                        (before, stands, before_back) if before < stands else (stands, before, stops)
                    )
                    if beyond > max(near_back, near * (1 + jump * (step - before_step))):
                        now = -1
                before, before_back, before_step = stands, stops, step
                if now < 0:
                    now = min(pieces, most - 1)
                    if now == pieces:
                        pieces += 1
                        ends[now, 0], ends[now, 1] = -2.0, 2.0
                for end in range(2):
                    at = stands if end == 0 else stops
                    x, y, deep = (left + pitch_x * u) * at - x0, (top + pitch_y * v) * at - y0, at - own
                    length = np.sqrt(x * x + y * y + deep * deep)
                    nearer = -(x * x0 + y * y0 + deep * own) / (far * length)
                    if nearer > ends[now, 0] if end == 0 else nearer < ends[now, 1]:
                        ends[now, end], one_of[now, end], two_of[now, end] = nearer, one, two
                        parts[now, end] = (1 - part) * at / (z[one] if end == 0 else back[one])
                        lengths[now, end] = length
            # Pieces that overlap are one.
            one = 0
            while one < pieces:
                two, joined = one + 1, False
                while two < pieces:
                    if ends[two, 0] >= ends[one, 1] and ends[one, 0] >= ends[two, 1]:
                        for end in range(2):
                            if ends[two, 0] > ends[one, 0] if end == 0 else ends[two, 1] < ends[one, 1]:
                                _take(one, two, end, ends, one_of, two_of, parts, lengths)
                        pieces -= 1
                        for end in range(2):
                            _take(two, pieces, end, ends, one_of, two_of, parts, lengths)
                        joined = True
                    else:
                        two += 1
                one += not joined
            for m in range(pieces):
                for end in range(2):
                    toward = min(max(ends[m, end], -1.0), 1.0)
                    angle[b, k, m, end] = np.arccos(toward)
                    first[b, k, m, end], second[b, k, m, end] = one_of[m, end], two_of[m, end]
                    share[b, k, m, end] = parts[m, end]
                    # The pixel's own distance turns the way between them by this, seen from either end.
                    lever[b, k, m, end] = far / lengths[m, end] * np.sqrt(max(1 - toward * toward, 0.0))


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy", forceinline=True)
@no_type_check
def _take(one, two, end, ends, first, second, parts, lengths):
    """Piece `one` gets an end of piece `two`."""
    ends[one, end], first[one, end], second[one, end] = ends[two, end], first[two, end], second[two, end]
    parts[one, end], lengths[one, end] = parts[two, end], lengths[two, end]
