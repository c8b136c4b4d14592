"""What of a session stays put: finds out where the object is, and holds each shot's sharpness and place against earlier ones.

Fed by `checker`, shot by shot; keeps a dozen sharp pictures, and small ones of the first 48 shots.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float16, Float32

from engine.capture_checks import object_motion, rough_mask, sharpness
from engine.capture_checks.finding import Finding
from engine.capture_checks.object_motion import Motion, Reference
from engine.capture_checks.sharpness import Edges, Sharpness
from engine.capture_checks.shot_preview import ShotPreview, log_light
from engine.hdr.develop import averaged

FEWEST_KEPT = 6  # shots, for a reference
KEEP_AT = (14, 18, 22, 28, 36, 46, 60, 80, 110, 150, 200)  # shots that take an earlier one's place
MOST_TINY = max(rough_mask.AGAIN)


class ReferenceShots:
    """The object, as the shots so far show it."""

    def __init__(self) -> None:
        self._count = 0
        self._object: Bool[np.ndarray, "h w"] | None = None
        self._tiny: list[Float32[np.ndarray, "h w 3"]] = []
        self._edges: list[Edges] = []  # of every shot, until it is known where the object is
        self._sharpness: list[Sharpness] = []
        self._kept: list[tuple[str, Float16[np.ndarray, "H W"]]] = []  # name and `log_light`
        self._reference: Reference | None = None
        self._motions: list[Motion] = []  # of the shots in which it did not move

    @property
    def object_mask(self) -> Bool[np.ndarray, "h w"] | None:
        """On a small grid over the picture; None while nobody knows."""
        return self._object

    def see(self, now: ShotPreview) -> list[Finding]:
        """Blur, and whether the object kept its place."""
        found = self._outlined(now)
        mask = None if self._object is None else rough_mask.on_grid(self._object, now.fine.shape)
        blurred = self._blur(now, mask)
        log = log_light(now)
        moved = self._place(now, log, bool(blurred))
        if not blurred and moved is None:
            self._keep(now, log, mask)
        self._count += 1
        return found + blurred + ([] if moved is None else [moved])

    def _outlined(self, now: ShotPreview) -> list[Finding]:
        """Guess now and then where the object is, from the shots so far; what hangs on it is made anew."""
        if len(self._tiny) == MOST_TINY:
            return []
        self._tiny.append(averaged(now.small, tiny_by(now)))
        if len(self._tiny) not in rough_mask.AGAIN:
            return []
        by = now.fine.shape[1] / self._tiny[0].shape[1]
        shot, floor = now.noise
        guessed = rough_mask.guess(self._tiny, (shot / by**2, floor / by))
        if guessed is None:
            return []
        first = self._object is None
        self._object = guessed
        mask = rough_mask.on_grid(guessed, now.fine.shape)
        if first:
            self._sharpness = [sharpness.measure(one, mask) for one in self._edges]
            self._edges = []
        self._refer(mask)
        return self._look_back(now.pitch) if first else []

    def _blur(self, now: ShotPreview, mask: Bool[np.ndarray, "H W"] | None) -> list[Finding]:
        edges = sharpness.edges_of(now)
        if mask is None:
            self._edges.append(edges)
        sharp = sharpness.measure(edges, mask)
        found = sharpness.check(now, sharp, self._sharpness)
        self._sharpness.append(sharp)
        return list(found)

    def _place(self, now: ShotPreview, log: Float32[np.ndarray, "H W"], blurred: bool) -> Finding | None:
        if self._reference is None:
            return None
        motion = object_motion.register(log, self._reference, now.pitch, object_motion.usual(self._motions))
        moved = object_motion.check(now.name, motion, self._motions, blurred)
        if moved is None:
            self._motions.append(motion)
        return moved

    def _keep(
        self, now: ShotPreview, log: Float32[np.ndarray, "H W"], mask: Bool[np.ndarray, "H W"] | None
    ) -> None:
        """The first shots are kept to compare with; as the session grows later ones take turns with them."""
        entry = (now.name, log.astype(np.float16))
        if len(self._kept) < object_motion.KEPT:
            self._kept.append(entry)
        elif self._count in KEEP_AT:
            # The earliest stay: what creeps is found by comparing with the beginning.
            half = object_motion.KEPT // 2
            self._kept[half + KEEP_AT.index(self._count) % half] = entry
            if mask is not None:
                self._refer(mask)

    def _refer(self, mask: Bool[np.ndarray, "H W"]) -> None:
        if len(self._kept) >= FEWEST_KEPT:
            self._reference = object_motion.reference(self._logs(), mask)

    def _look_back(self, pitch: float) -> list[Finding]:
        """Did the object move while nobody knew where it is?"""
        reference = self._reference
        if reference is None:
            return []
        motions = [object_motion.register(log, reference, pitch) for log in self._logs()]
        found: list[Finding] = []
        for (name, _), motion in zip(self._kept, motions, strict=True):
            moved = object_motion.check(name, motion, motions)
            if moved is None:
                self._motions.append(motion)
            else:
                found.append(moved)
        return found

    def _logs(self) -> Sequence[Float32[np.ndarray, "H W"]]:
        return [log.astype(np.float32) for _, log in self._kept]


def tiny_by(now: ShotPreview) -> int:
    """The whole factor that makes `small` into what the outline is guessed from."""
    return max(1, round(max(now.small.shape) / rough_mask.EDGE_PX))
