"""The light around the object as a child worked it out: where it is kept, its shares, its picture. No engine rooms.

Panoramas as in `engine.types.Panorama`: row v from the top (-y), column u, the middle looks along +z of the camera.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from app.inspect import falsecolour
from app.inspect.runs import Run
from engine.color import luminance
from engine.errors import SessionError, reason
from engine.io.formats.arrays import UNREADABLE

HATCH_PX = 8
GUESSED = (240, 150, 60)


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """What arrives at the object's middle in one view."""

    view: str
    radiance: Float[np.ndarray, "h w 3"]
    seen: Float[np.ndarray, "h w"]  # 1 where photographed
    clipped: Bool[np.ndarray, "h w"]  # photographed, but saturated in every view that shows it

    def shares(self) -> dict[str, tuple[float, float]]:
        """Of photographed, only clipped and guessed light: (share of the sphere, share of the energy)."""
        height = len(self.seen)
        solid = np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None] * np.ones_like(self.seen)
        energy = solid * luminance(self.radiance)
        bare = self.seen * self.clipped
        parts = {"photographed": self.seen - bare, "only clipped": bare, "guessed": 1 - self.seen}
        whole = solid.sum(), max(float(energy.sum()), 1e-30)
        return {
            name: (float((solid * part).sum() / whole[0]), float((energy * part).sum() / whole[1]))
            for name, part in parts.items()
        }

    def picture(self, scale: int = 3) -> UInt8[np.ndarray, "h2 w2 4"]:
        """Logarithmic, so that lamps and walls both show; clipped in red, guesses hatched."""
        level = luminance(self.radiance)
        white = float(np.percentile(level, 99.5)) or 1.0
        shown = falsecolour.radiance(self.radiance, white, 0.0, "log")
        shown = shown.repeat(scale, 0).repeat(scale, 1)
        guessed = (self.seen < 0.5).repeat(scale, 0).repeat(scale, 1)
        bare = (self.clipped & (self.seen >= 0.5)).repeat(scale, 0).repeat(scale, 1)
        row, column = np.indices(guessed.shape)
        shown[guessed] = (shown[guessed] * 0.6).astype(np.uint8)
        shown[guessed & ((row + column) % HATCH_PX < 2), :3] = GUESSED[::-1]
        shown[bare, :3] = falsecolour.CLIPPED[::-1]
        shown[..., 3] = 255
        return shown


def coverage_file(run: Run) -> Path:
    """Where the child keeps it; may be removed at any time."""
    return run.session / "derived" / "coverage" / run.fingerprint / "coverage.npz"


def load(run: Run) -> Light | None:
    """The light of a run; None where it was not worked out yet.

    Raises:
        SessionError: the file is damaged.
    """
    path = coverage_file(run)
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            return Light(str(file["view"]), file["radiance"], file["seen"], file["clipped"].astype(bool))
    except UNREADABLE as error:
        raise SessionError(f"{path}: damaged ({reason(error)}); remove it, it is made again") from None
