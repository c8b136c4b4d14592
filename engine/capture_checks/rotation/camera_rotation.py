"""How the camera stood in every shot: from the rig's log, else from what the shots' backgrounds have in common.

Fed by `checker`, shot by shot; keeps the features of all shots, about 100 kB each. On the way it finds the lens's
field of view where Exif does not tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int

from engine.capture_checks.finding import Finding
from engine.capture_checks.rotation import focal_length, overlap, rig_consistency, rotation_averaging
from engine.capture_checks.rotation.overlap import Features, ViewPair
from engine.capture_checks.rotation.rotation_averaging import RotationGraph
from engine.capture_checks.shot_preview import ShotPreview


@dataclass(frozen=True, slots=True)
class Field:
    """What is known of the lens's field of view."""

    focal: float  # in widths of the picture
    source: str  # "Exif", "the shots" or "assumed"

    def told(self) -> str:
        return f"{focal_length.field_of_view_deg(self.focal):.0f} degrees across ({self.source})"


class Bearings:
    """The turns so far."""

    def __init__(self) -> None:
        self._field = Field(focal_length.focal_of(focal_length.ASSUMED_DEG), "assumed")
        self._tally: list[Float64[np.ndarray, " g"]] = []
        self._names: list[str] = []
        self._marks: list[Features] = []
        self._links: list[list[ViewPair]] = []
        self._logged: list[Float64[np.ndarray, "3 3"] | None] = []
        self._turned = rotation_averaging.NOTHING

    @property
    def field(self) -> Field:
        return self._field

    @property
    def turned(self) -> RotationGraph:
        return self._turned

    @property
    def logged(self) -> Float64[np.ndarray, "k 3 3"]:
        """cam_from_world of the shots whose angles the rig told."""
        return self._turned.cam_from_world[self._turned.logged]

    def placed(self) -> tuple[Int[np.ndarray, " k"], Float64[np.ndarray, "k 3 3"]]:
        """The shots that hang together, and their cam_from_world."""
        turned = self._turned
        placed = np.flatnonzero(turned.group == turned.main)
        return placed, turned.cam_from_world[placed]

    def believe(self, focal: float) -> None:
        """What Exif tells."""
        self._field = Field(focal, "Exif")

    def see(
        self,
        now: ShotPreview,
        mask: Bool[np.ndarray, "H W"] | None,
        logged: Float64[np.ndarray, "3 3"] | None,
    ) -> list[Finding]:
        """Place a shot; `logged` is the rig's word on its cam_from_world."""
        new = overlap.detect_features(now, mask)
        partners = overlap.likely(new, self._marks)
        self._marks.append(new)
        number = len(self._names)
        links = [overlap.match_pair(one, number, self._marks, self._field.focal) for one in partners]
        self._logged.append(logged)
        known = self._field.source != "assumed"
        found = [
            overlap.check(now.name, new, links, self._names),
            rig_consistency.check(now.name, links, self._logged, self._names, known, mask is not None),
        ]
        self._names.append(now.name)
        self._links.append(links)
        every = [one for some in self._links for one in some]
        self._turned = rotation_averaging.with_shot(self._turned, links, every, logged)
        if self._field.source == "assumed":
            self._ask_lens(links)
        return [one for one in found if one is not None]

    def _ask_lens(self, links: Sequence[ViewPair]) -> None:
        """Add a pair to the tally of focal lengths; what hangs on it is made anew once they agree."""
        best = max(links, key=lambda one: one.inliers, default=None)
        if best is None or best.inliers < overlap.ENOUGH or len(self._tally) >= focal_length.MOST_PAIRS:
            return
        self._tally.append(focal_length.misfits(best))
        focal = focal_length.agreed(np.stack(self._tally))
        if focal is None:
            return
        self._field = Field(focal, "the shots")
        turned, so_far = rotation_averaging.NOTHING, list[ViewPair]()
        for number, logged in enumerate(self._logged):
            self._links[number] = [overlap.with_focal(one, focal) for one in self._links[number]]
            so_far += self._links[number]
            turned = rotation_averaging.with_shot(turned, self._links[number], so_far, logged)
        self._turned = turned
