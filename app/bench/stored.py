"""What the stages before the surface left in a session, as every solver takes it; all of it or a part.

The truth is not in here: a solver never sees it.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Int

from app import results
from app.bench.record import BenchError
from engine.light.gaussians.gaussians import part
from engine.pipeline import run
from engine.sampling import evenly_spaced
from engine.types import CapturedScene, Frames, Gaussians, Lamps, Masks, Poses


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """A solver's input. `fingerprint` names the stage *light* that it comes from, and so all before it."""

    fingerprint: str
    frames: Frames
    masks: Masks
    poses: Poses
    gaussians: Gaussians
    lamps: Lamps

    @property
    def captured(self) -> CapturedScene:
        """What every solver takes first."""
        return CapturedScene(self.frames, self.masks, self.poses, self.gaussians, self.lamps)

    def views(self, index: Int[np.ndarray, " k"]) -> "Stored":
        """The same of some photographs; the light stays that of all."""
        placed, seen = self.poses.cam_from_world[index], self.poses.registered[index]
        return replace(
            self,
            frames=self.frames.views(index),
            masks=Masks(self.masks.object, self.masks.background[index]),
            poses=replace(self.poses, cam_from_world=placed, registered=seen),
        )


def load(session: Path) -> Stored:
    """Read the session's finished stages.

    Raises:
        SessionError: one has not run with the present settings.
    """
    steps = results.steps_of(session)
    read = run.loader(steps)
    (light,) = [step.fingerprint for step in steps if step.stage.name == "light"]
    return Stored(
        light, read("hdr", "frames", Frames), read("segment", "masks", Masks), read("poses", "poses", Poses),
        read("light", "gaussians", Gaussians), read("light", "lamps", Lamps),
    )  # fmt: skip


def evenly(count: int, of: int) -> list[int]:
    """`count` of `of` places in a row, evenly spread, first and last among them.

    Raises:
        BenchError: there are not so many.
    """
    if not 1 <= count <= of:
        raise BenchError(f"{count} views of a set of {of} were asked for; make larger sets, or ask for fewer")
    return evenly_spaced(of, count).tolist()


def fewer_views(stored: Stored, count: int) -> Stored:
    """Only `count` photographs of the object, evenly spread; the light stays that of all."""
    return stored.views(np.array(evenly(count, len(stored.frames.names))))


def fewer_pixels(stored: Stored, count: int) -> Stored:
    """Only the `count` object pixels around the object's middle: a solver needs neighbours."""
    mask = stored.masks.object
    v, u = np.nonzero(mask)
    far = (v - np.median(v)) ** 2 + (u - np.median(u)) ** 2
    kept = np.argsort(far, kind="stable")[:count]
    smaller = np.zeros_like(mask)
    smaller[v[kept], u[kept]] = True
    return replace(stored, masks=Masks(smaller, stored.masks.background))


def fewer_gaussians(stored: Stored, count: int, seed: int) -> Stored:
    """Only `count` Gaussians, drawn at random; the lamps, which are the last of them, stay."""
    total, lamps = len(stored.gaussians.means), len(stored.lamps.radii)
    rng = np.random.default_rng(seed)
    kept = np.sort(rng.choice(total - lamps, max(1, min(count, total) - lamps), replace=False))
    kept = np.concatenate([kept, np.arange(total - lamps, total)])
    field = part(stored.gaussians, kept)
    return replace(stored, gaussians=field)


def unlit_by_lamps(stored: Stored) -> Stored:
    """The lamps as nothing but Gaussians among the others."""
    lamps = stored.lamps
    none = Lamps(lamps.centres[:0], lamps.radii[:0], lamps.radiance[:0], lamps.clipped[:0])
    return replace(stored, lamps=none)
