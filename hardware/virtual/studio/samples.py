"""How many samples a pixel takes of each kind, and the numbers that place them.

Strata are points of Sobol's sequence, shifted digit by digit for each pixel and salt, so that neither pixels
nor views repeat one another's pattern; noise is Mitsuba's hash of lane and salt (Tiny Encryption Algorithm,
Zafar, Olano and Curtis 2010). Lane `k` is sample `k % count` of pixel `k // count`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter

from hardware.virtual.studio.rooms import Room

PILOT = 64  # samples that tell how many a pixel needs
FEWEST, MOST = 64, 4096
FALL = (
    0.65  # noise falls with this power of the count: strata do better than chance's 0.5 (measured 0.6 to 0.7)
)


@dataclass(frozen=True, slots=True)
class Effort:
    """Samples per pixel and view, powers of two; at least one per lamp, or its light is lost."""

    diffuse: int
    glossy: int
    aimed: tuple[int, ...]  # per lamp


def plan(room: Room, samples: int) -> Effort:
    """Share `samples` out: that many follow the reflectance, others go to the lamps by how hard they are to sample.

    A sheet with a picture is hard (bars, sky, garden), an even one is not, globes are nearly points. The shares
    make the kinds' variances, per second they cost, about equal in the room `study`.
    """

    def power(value: float) -> int:
        return 1 << max(2, round(np.log2(max(value, 1))))

    strengths = [float(np.linalg.norm(np.cross(s.right, s.down)) * s.radiance.mean()) for s in room.sheets]
    strongest = max(strengths, default=1.0)
    sheets = [
        power(samples * (0.25 if len(sheet.radiance) < 8 else 0.5) * (strength / strongest) ** 0.5)
        for sheet, strength in zip(room.sheets, strengths, strict=True)
    ]
    globes = [power(samples / 16)] * len(room.globes)
    return Effort(power(samples), power(samples / 2), (*globes, *sheets))


def needed(
    noise: Float[np.ndarray, " p"], touched: Bool[np.ndarray, "h w"], target: float
) -> Int[np.ndarray, " p"]:
    """`plan`'s samples for each touched pixel, powers of two, that leave noise of `target` on average over the pixels.

    `noise` is what PILOT samples leave, a rough estimate, so neighbours share theirs. Where noise falls with the
    count's power -e, the cost is least when counts follow the noise's power 1 / (1 + e).
    """
    variance = np.zeros(touched.shape)
    variance[touched] = noise**2
    weight = uniform_filter(touched.astype(float), 3, mode="constant")
    # A running sum may come out a hair below zero where no pixel is noisy.
    around = np.maximum(uniform_filter(variance, 3, mode="constant")[touched], 0)
    shared = np.sqrt(around / weight[touched])
    share = shared ** (1 / (1 + FALL))
    counts = PILOT * share * (share.mean() / target) ** (1 / FALL)
    return 1 << np.rint(np.log2(np.clip(counts, FEWEST, MOST))).astype(int)


class Numbers:
    """Numbers in [0, 1) for the lanes of one batch, the first of which is lane `first` of all."""

    def __init__(self, mi: Any, count: int, first: int):
        import drjit as dr
        from scipy.stats import qmc  # takes half a second to load

        self.mi = mi
        self.first = dr.opaque(mi.UInt32, first)
        points = qmc.Sobol(4, scramble=False, bits=32).random(count)
        self.points = mi.UInt32(np.ravel(points * 2.0**32).astype(np.uint32))

    def stratum(self, axis: int, sample: Any, pixel: Any, salt: Any) -> Any:
        """Coordinates `axis` and `axis + 1` of the points."""
        mi = self.mi
        import drjit as dr

        x, y = mi.sample_tea_32(pixel * 2 + axis // 2, salt)
        x ^= dr.gather(mi.UInt32, self.points, sample * 4 + axis)
        y ^= dr.gather(mi.UInt32, self.points, sample * 4 + axis + 1)
        return mi.Point2f(mi.Float(x >> 8), mi.Float(y >> 8)) * 2.0**-24

    def noise(self, lane: Any, salt: Any) -> list[Any]:
        """Three independent numbers for each of some lanes."""
        mi, lane = self.mi, lane + self.first
        a, b = mi.sample_tea_32(lane, salt ^ 0x9E3779B9)
        c, _ = mi.sample_tea_32(lane, salt ^ 0x9E3779BA)
        return [mi.Float(word >> 8) * 2.0**-24 for word in (a, b, c)]
