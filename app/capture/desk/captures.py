"""One capture at the desk: made from what the window wants, run, and told as events.

Statuses are told at most 20 a second and the coverage once a second, the last of each always; a finding is told at
once, and where it says that what follows will be of no use, the capture pauses: a person decides.
"""

import contextlib
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.capture import checks, order
from app.capture.checks import Watching
from app.capture.control import Control
from app.capture.desk import wishes
from app.capture.desk.devices import Devices
from app.capture.desk.newest import Newest
from app.capture.desk.pictures import Pictures
from app.capture.order import Order, Pose
from app.capture.recovery import Patience
from app.capture.run import USUAL, Capture
from app.capture.status import Finding, Missing, Phase, Status
from app.capture.wanted import captured
from engine.capture_checks.finding import Severity
from engine.errors import RoomlightError
from engine.io import session as sessions
from engine.io.session import Shot
from hardware.errors import HardwareError

if TYPE_CHECKING:
    from app.work.worker import Link

STATUS_S, COVERAGE_S = 0.05, 1.0
COVERAGE_ROWS = 240


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """What runs work with."""

    link: "Link"
    devices: Devices
    pictures: Pictures
    aside: Newest  # where pictures are made, so that they delay nothing
    patience: Patience = USUAL


class Run:
    """One run of one capture; the control may be used from any thread."""

    def __init__(
        self,
        around: Around,
        session: Path,
        order: Order,
        helpful_first: bool,
        resumed: bool = False,
        at_zero: bool = False,
    ) -> None:
        """
        Raises:
            SettingsError: no devices are open.
            PoseError: an axis of the rig's geometry has no direction.
        """
        self._link, self._devices, self._pictures = around.link, around.devices, around.pictures
        self._aside = around.aside
        self._session, self._order = session, order
        self._live = checks.watching(order, by_hand=False)
        done = captured(session) if resumed else None
        self._earlier = frozenset[str]() if done is None else done.done
        self._seen = set(self._earlier)
        self._telling = threading.Lock()
        self._told: set[Finding] = set()
        self._statuses = Newest("statuses", STATUS_S)
        self._coverages = Newest("coverage", COVERAGE_S)
        self._capture = Capture(
            session,
            order,
            around.devices.lent(),
            resumed=resumed,
            at_zero=at_zero,
            watch=self._look,
            reorder=checks.reordering(self._live, helpful_first),
            listener=self._hear,
            warnings=() if resumed else checks.of_order(order),
            keep_open=True,
            patience=around.patience,
        )

    @property
    def control(self) -> Control:
        return self._capture.control

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Of all its runs, in the order of the plan."""
        return self._order.poses

    def run(self) -> None:
        """
        Raises:
            CaptureError, HardwareError, SessionError: why it could not begin; there is no session to go on with.
        """
        trouble, outcome = "", None
        try:
            outcome = self._capture.run()
        except (RoomlightError, HardwareError) as error:
            if not self._capture.began:
                raise
            trouble = " ".join(str(error).split())
        finally:
            self._devices.taken_back()
            self._statuses.close()
            self._coverages.close()
        status = self._capture.status
        if self._capture.began:
            self._emit(
                "ended",
                session=str(self._session),
                taken=status.taken,
                total=status.total,
                cancelled=outcome is not None and outcome.cancelled,
                missing=_missing(status.missing),
                trouble=trouble,
            )

    def pause(self) -> None:
        """
        Raises:
            HardwareError: the rig could not be told; the capture pauses at the next pose all the same.
        """
        try:
            self.control.pause()
        finally:
            self._hear(self._capture.status)

    def go_on(self) -> None:
        """
        Raises:
            HardwareError: the rig that was held could not be told.
        """
        try:
            self.control.resume()
        finally:
            self._hear(self._capture.status)

    # ---- what the capture says, in its own threads

    def _hear(self, status: Status) -> None:
        if status.phase is not Phase.EXPOSING:
            self._devices.hush()
        for finding in status.findings:
            self._tell(finding)
        # The newest is told, which may be a later one than this.
        self._statuses.put("status", lambda: self._emit_status(self._capture.status))

    def _look(self, shot: Shot) -> Sequence[Finding]:
        """The capture's watch."""
        fresh = shot.name not in self._earlier
        if fresh:
            flip = sessions.open_session(shot.folder.parent.parent).orientation
            self._aside.put("picture", lambda: self._pictures.show(shot.files, shot.name, flip))
        if self._live is None:
            return ()
        live = self._live
        found = live(shot)
        for finding in found:
            self._tell(finding)
        self._seen.add(shot.name)
        self._coverages.put("coverage", lambda: self._emit_coverage(live))
        # What an earlier run found was decided then.
        if fresh and any(finding.severity is Severity.STOP for finding in found):
            # A rig that cannot be told to hold pauses at the next pose.
            with contextlib.suppress(HardwareError):
                self.pause()
        return found

    def _tell(self, finding: Finding) -> None:
        with self._telling:
            if finding in self._told:
                return
            self._told.add(finding)
            self._emit("finding", pose=finding.pose, text=finding.text, severity=finding.severity.value)

    def _emit_status(self, status: Status) -> None:
        share = status.taken / status.total if status.total else 0.0
        self._link.emit("progress", fraction=share, note=status.message, left_s=status.left_s)
        angles = None if status.pose is None else status.pose.angles
        self._emit(
            "status",
            phase=status.phase.value,
            pose=None if status.pose is None else status.pose.name,
            pan=None if angles is None else angles.pan_deg,
            tilt=None if angles is None else angles.tilt_deg,
            taken=status.taken,
            total=status.total,
            left_s=status.left_s,
            message=status.message,
            missing=_missing(status.missing),
            paused=self.control.paused,
        )

    def _emit_coverage(self, live: Watching) -> None:
        seen = live.seen(COVERAGE_ROWS)
        if seen is None:
            return
        covered, panorama = seen
        left = [pose.angles for pose in self._order.poses if pose.name not in self._seen]
        try:
            png = self._pictures.write("coverage", panorama)
        except RoomlightError as error:
            self._link.log(f"the coverage cannot be shown: {error}")
            return
        self._emit(
            "coverage",
            png=str(png),
            share=covered.share,
            share_unclipped=covered.share_unclipped,
            next=live.next_pose([angles for angles in left if angles is not None]) if left else "",
        )

    def _emit(self, kind: str, **facts: Any) -> None:
        self._link.emit("data", kind=kind, **facts)


def started(around: Around, content: Mapping[str, Any]) -> Run:
    """A new capture from the command `start`.

    Raises:
        SettingsError, LimitError: the plan or the bracket cannot be meant, or not with this rig.
    """
    rig = around.devices.needed()
    plan = wishes.plan(content["plan"], rig.motion.features)
    settle_s = None if content["settle"] is None else float(content["settle"])
    wanted = order.planned(
        plan, rig, around.devices.urls, wishes.bracket(content), settle_s, bool(content["any_format"])
    )
    session, helpful_first = Path(content["session"]), bool(content["helpful_first"])
    return Run(around, session, wanted, helpful_first)


def resumed(around: Around, content: Mapping[str, Any]) -> Run:
    """A capture to go on with, from the command `resume`; its own devices are opened unless some are.

    Raises:
        CaptureError, SessionError: it was not captured, or is damaged.
        HardwareError: as the drivers say.
    """
    session = Path(content["session"])
    wanted = order.read(session)
    if around.devices.rig is None:
        around.devices.open(wanted.rig, wanted.camera)
    helpful_first, at_zero = bool(content["helpful_first"]), bool(content["at_zero"])
    return Run(around, session, wanted, helpful_first, resumed=True, at_zero=at_zero)


def _missing(missing: Sequence[Missing]) -> list[dict[str, str]]:
    return [{"pose": item.pose.name, "reason": item.reason} for item in missing]
