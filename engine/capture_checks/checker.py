"""Everything that looks at a session while it is captured: fed each new shot, it says what a person should hear.

One thread feeds it, shot by shot in the order they were taken; what it knows may be asked for by any thread. It needs
about 0.3 s for a bracket of 512 x 384 and 1.2 s for one of 24 megapixels, twice that now and then, and keeps some
200 kB a shot. Its guesses (where the object is, how the camera stood) serve the capture only; the pipeline finds its
own.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64, UInt8

from engine.capture_checks import exposure, rough_mask
from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.planning import coverage, next_view
from engine.capture_checks.planning.coverage import Coverage, Look, Sight
from engine.capture_checks.planning.next_view import NextView
from engine.capture_checks.reference_shots import ReferenceShots, tiny_by
from engine.capture_checks.rotation import focal_length
from engine.capture_checks.rotation.camera_rotation import Bearings, Field
from engine.capture_checks.rotation.rotation_averaging import RotationGraph
from engine.capture_checks.shot_preview import Sensor, ShotPreview, learn, preview, read
from engine.color import luminance
from engine.errors import RawError
from engine.hdr.develop import averaged
from engine.orientation import rotation
from engine.sfm import rig_alignment as rigs

Angles = tuple[float, float]  # pan and tilt as the rig counts them, degrees
Geometry = Mapping[str, Sequence[float]]  # of a rig, as in `session.json`
CLIPPED_SHARE = 0.1  # of a direction's sites; with more it counts as clipped
NOTED_AGAIN = 1.5  # times as much as what was noted before


class ShotChecker:
    """The session as seen so far."""

    def __init__(self, geometry: Geometry | None = None) -> None:
        """
        Args:
            geometry: the rig's; None: how the camera stood is told from the photographs.

        Raises:
            PoseError: the geometry lacks an axis or point.
        """
        self._geometry = geometry
        if geometry is not None:
            _logged(geometry, [(0.0, 0.0)])
        self._sensor: Sensor | None = None
        self._size: tuple[int, int] | None = None
        self._upright = np.eye(3)  # upright_from_cam
        self._names: tuple[str, ...] = ()
        self._histogram = np.zeros(1)
        self._noted = 0.0  # the largest share clipped that was noted, %
        self._stillness = ReferenceShots()
        self._bearings = Bearings()
        self._looks: list[Look] = []

    # ---- what is known

    @property
    def names(self) -> tuple[str, ...]:
        """The shots that could be read."""
        return self._names

    @property
    def field(self) -> Field:
        return self._bearings.field

    @property
    def object_mask(self) -> Bool[np.ndarray, "h w"] | None:
        """Where the object is thought to be, on a small grid over the picture; None while nobody knows."""
        return self._stillness.object_mask

    @property
    def turned(self) -> RotationGraph:
        """How the camera stood in every shot of `names`."""
        return self._bearings.turned

    def coverage(self) -> Coverage | None:
        """Directions seen by the shots that hang together; None before the first shot."""
        placed, turns = self._bearings.placed()
        if not len(placed):
            return None
        looks = [self._looks[i] for i in placed]
        return coverage.cover(self._sight(), looks, turns, len(self._looks) - len(placed))

    def panorama(self, height: int = 180) -> UInt8[np.ndarray, "h w 3"] | None:
        """`coverage` as a picture; None before the first shot."""
        covered, turns = self.coverage(), self._bearings.placed()[1]
        if covered is None:
            return None
        held = self._upright @ turns
        level = coverage.upright(held)
        return coverage.panorama(covered, held[0] if level is None else level, height)

    def next_by_hand(self) -> NextView | None:
        """Where a person should point next; None before the first shot."""
        covered, turns = self.coverage(), self._bearings.placed()[1]
        if covered is None:
            return None
        level = coverage.upright(self._upright @ turns)
        return next_view.for_hands(self._sight(), covered, turns, level, self._upright)

    def order(self, left: Sequence[Angles]) -> list[int] | None:
        """A rig's remaining poses by index, the most helpful first; None where its geometry is not known."""
        if self._geometry is None:
            return None
        return next_view.order(self._sight(), self._bearings.logged, _logged(self._geometry, left))

    def next_by_rig(self, left: Sequence[Angles]) -> NextView | None:
        """The most helpful of a rig's remaining poses; None without one, a shot, or the rig's geometry."""
        covered = self.coverage()
        if self._geometry is None or covered is None or not left:
            return None
        return next_view.best_pose(
            self._sight(), covered, self._bearings.logged, _logged(self._geometry, left)
        )

    # ---- a new shot

    def add(self, name: str, files: Sequence[Path], angles: Angles | None = None) -> tuple[Finding, ...]:
        """Look at one shot's bracket; `angles` where the rig logged them."""
        try:
            mosaics = read(files)
        except RawError as error:
            return _unreadable(name, f"the photographs cannot be read ({error})", "take this pose again")
        sizes = {mosaic.counts.shape[::-1] for mosaic in mosaics} | ({self._size} if self._size else set())
        if len(sizes) > 1:
            told = " and ".join(f"{width} x {height}" for width, height in sorted(sizes))
            return _unreadable(
                name, f"photographs of {told} do not go together", "set the camera to its full size"
            )
        if self._sensor is None:
            self._sensor = learn(mosaics)
        now = preview(name, mosaics, self._sensor)
        if self._size is None:
            self._size = (now.width, now.height)
            self._upright = rotation(now.facts[0].orientation)
            self._histogram = np.zeros_like(now.histogram)
            focal = focal_length.told(files[0], now.width, now.height)
            if focal is not None:
                self._bearings.believe(focal)
        clipped = averaged(now.clipped, tiny_by(now)) > CLIPPED_SHARE
        self._looks.append(Look(clipped, luminance(averaged(now.small, tiny_by(now)))))
        still = self._stillness.see(now)
        found = [*self._exposure(now, self._sensor), *still]
        logged = None
        if angles is not None and self._geometry is not None:
            logged = _logged(self._geometry, [angles])[0]
        mask = None if self.object_mask is None else rough_mask.on_grid(self.object_mask, now.fine.shape)
        apart = self._bearings.see(now, mask, logged)
        # That a blurred shot cannot be tied to others is no news: it is to be taken again anyway.
        blurred = any(one.kind == "blur" for one in still)
        found += [one for one in apart if not (blurred and one.kind == "overlap")]
        self._names = (*self._names, name)
        return tuple(found)

    def _exposure(self, now: ShotPreview, sensor: Sensor) -> list[Finding]:
        self._histogram = self._histogram + now.histogram
        mask = None if self.object_mask is None else rough_mask.on_grid(self.object_mask, now.clipped.shape)
        found = exposure.check(now, mask, self._histogram, sensor)
        # Lamps that clip come into view again and again: they are noted when they are more than before.
        told = [
            one for one in found if one.severity is not Severity.NOTE or one.value > NOTED_AGAIN * self._noted
        ]
        self._noted = max([self._noted, *(one.value for one in told if one.severity is Severity.NOTE)])
        return told

    def _sight(self) -> Sight:
        mask = self.object_mask
        if mask is None:
            mask = np.zeros(self._looks[0].clipped.shape if self._looks else (96, 144), bool)
        return coverage.sight(self.field.focal, mask)


def plan_findings(
    geometry: Geometry, planned: Sequence[Angles], focal: float | None = None
) -> tuple[Finding, ...]:
    """What a person should know of a rig's plan before it starts; `focal` in widths, None: assumed."""
    sight = Sight(focal or focal_length.focal_of(focal_length.ASSUMED_DEG), np.ones((96, 144), bool))
    finding = next_view.one_axis(_logged(geometry, planned), sight)
    return () if finding is None else (finding,)


def _unreadable(name: str, seen: str, remedy: str) -> tuple[Finding, ...]:
    return (Finding(name, "unreadable", Severity.STOP, 0.0, "", seen, remedy),)


def _logged(geometry: Geometry, angles: Sequence[Angles]) -> Float64[np.ndarray, "n 3 3"]:
    """cam_from_world of a rig's angles; its world is the camera's frame at rest."""
    pan, tilt = np.array(angles, np.float64).reshape(-1, 2).T
    return rigs.logged_poses(rigs.RigLog("gimbal", pan, tilt, geometry))[:, :, :3]
