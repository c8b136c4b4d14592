"""The capture session: a plan of poses becomes a session's shots, unattended, whatever fails on the way.

A pose is moved to, settled, photographed, downloaded, checked and kept as the shot of its name; a pose whose shot
is whole is finished and is never taken again. Whatever ends a capture, a kill or a power cut included, the next
run goes on at the first pose that is not finished. One thread runs a capture; any other may pause, resume, cancel
or stop it. Nothing here prints: a listener is told every change.
"""

import contextlib
import shutil
import statistics
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.capture import disk as capture_disk
from app.capture import folder as capture_folder
from app.capture import frames as capture_frames
from app.capture.control import Asked, Control
from app.capture.journal import Journal
from app.capture.order import CaptureError, Order, Pose
from app.capture.recovery import Patience, Recovery
from app.capture.status import Finding, Missing, Outcome, Phase, Status
from app.capture.watch import Watch, Watcher
from engine.capture_checks.finding import Severity
from engine.errors import Cancelled, RoomlightError
from engine.io import session as sessions
from engine.io.session import Session, Shot
from hardware.errors import HardwareError
from hardware.rig import Rig, Step

PACE_POSES = 20  # the last so many tell the pace
PHASES = {Step.MOVE: Phase.MOVING, Step.EXPOSE: Phase.EXPOSING, Step.FETCH: Phase.DOWNLOADING}
USUAL = Patience()


class Capture:
    """One run of one capture, new or resumed; `control` pauses, cancels and stops it."""

    def __init__(
        self,
        folder: Path,
        order: Order,
        open_rig: Callable[[], Rig],
        resumed: bool = False,
        at_zero: bool = False,
        watch: Watch | None = None,
        reorder: Callable[[Sequence[Pose]], Sequence[Pose]] = lambda left: left,
        listener: Callable[[Status], None] = lambda status: None,
        warnings: Sequence[str] = (),
        keep_open: bool = False,
        patience: Patience = USUAL,
        free: Callable[[Path], int] = capture_disk.free_bytes,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            folder: the session; it must not exist, or with `resumed` hold this very order.
            open_rig: called at the start, and again after a cable was pulled; the run closes what it opened.
            at_zero: a person put a rig that cannot find its zero by itself there; taken for granted when new.
            reorder: puts the poses that are left in the order in which they shall be taken; asked before each.
            listener: called in the capture's thread at every change; must return soon.
            warnings: what a person should know of the plan before it starts.
            keep_open: leave the rig open at the end, for whoever gave it.
        """
        self._folder, self._order, self._resumed = folder, order, resumed
        self._open, self._listener, self._patience = open_rig, listener, patience
        self._reorder, self._keep_open = reorder, keep_open
        self._free, self._clock = free, clock
        self.control = Control()
        self._recovery = Recovery(
            self.control, patience, self._opened, self._enter, self._note, at_zero or not resumed
        )
        self._watcher = Watcher(watch)
        self._session: Session | None = None  # while its lock is held
        self._journal: Journal | None = None
        self._known: set[str] = set()  # hashes of every photograph kept
        self._missing: dict[str, Missing] = {}  # by pose
        self._bracket = order.bracket
        self._paces: deque[float] = deque(maxlen=PACE_POSES)
        self._bytes: deque[float] = deque(maxlen=PACE_POSES)  # of a photograph, pose by pose
        self._status = Status(total=len(order.poses), findings=_warnings(warnings))

    @property
    def status(self) -> Status:
        return self._status

    @property
    def began(self) -> bool:
        """There is a session to go on with."""
        return self._session is not None

    def run(self) -> Outcome:
        """Take every pose that is not finished.

        Returns:
            What was taken, what is missing and why; `cancelled` when somebody asked for the end.

        Raises:
            CaptureError, HardwareError, SessionError: why it cannot start or go on; resuming goes on from there.
        """
        try:
            with contextlib.ExitStack() as stack:
                stack.callback(self._watcher.close)
                return self._run(stack)
        except Cancelled:
            return self._outcome(cancelled=True)
        finally:
            self._tell(phase=Phase.ENDED, pose=None, message="")

    def _run(self, stack: contextlib.ExitStack) -> Outcome:
        finished = self._sorted_out(self._hold(stack)) if self._resumed else {}
        left = [pose for pose in self._order.poses if pose.name not in finished]
        self._tell(taken=len(finished))
        if not left:
            return self._outcome(cancelled=False)
        self.control.rig = rig = self._opened()
        if not self._keep_open:
            stack.callback(self._close)
        # What can be known to go wrong is told before anything moves, and before there is a session.
        capture_disk.check_plan(self._folder, self._order, len(left), rig.camera.features, self._free)
        capture_folder.check_devices(self._order, rig)
        if not self._resumed:
            capture_folder.create(self._folder, self._order)
            self._hold(stack)
        for shot in finished.values():
            self._keep_exposure(shot)
            self._watcher.show(shot)
        self._note("started", rig=rig.motion.name, camera=rig.camera.name, left=len(left))
        try:
            self._take_all(left)
        except Cancelled:
            self._note("cancelled")
            raise
        except (RoomlightError, HardwareError) as error:
            # A full disk may refuse these words too; the error itself is what counts.
            with contextlib.suppress(RoomlightError):
                self._note("stopped", reason=str(error))
            raise
        finally:
            shutil.rmtree(capture_folder.incoming(self._folder), ignore_errors=True)
        self._note("ended", missing=list(self._missing))
        return self._outcome(cancelled=False)

    def _opened(self) -> Rig:
        if not self._resumed and self._session is None:
            capture_folder.check_free_place(self._folder)
        rig = self._open()
        if self._order.settle_s is not None:
            rig.settle_s = self._order.settle_s
        return rig

    def _close(self) -> None:
        with contextlib.suppress(HardwareError):
            self._rig.close()

    def _hold(self, stack: contextlib.ExitStack) -> Session:
        """Lock the session and open its journal."""
        self._session = session = sessions.open_session(self._folder)
        stack.enter_context(sessions.lock(session))
        self._journal = Journal(capture_folder.journal(self._folder))
        stack.callback(self._journal.close)
        return session

    def _sorted_out(self, session: Session) -> dict[str, Shot]:
        """The finished poses; what was half done or damaged is out of the way."""
        names = {pose.name for pose in self._order.poses}
        finished, damaged = capture_folder.sort_out(
            session, names, lambda name: self._enter(Phase.PREPARING, f"checking {name}")
        )
        for name, reason in damaged:
            self._note("damaged", shot=name, reason=reason)
            again = Finding(name, f"{reason}; put aside, its pose will be taken again", Severity.WARNING)
            self._tell(findings=(*self._status.findings, again))
        self._known = {sha256 for shot in finished.values() for sha256 in shot.sha256}
        return finished

    def _take_all(self, poses: Sequence[Pose]) -> None:
        """Every pose, then once more those that failed; what is missing still is in `_missing`.

        Raises:
            CaptureError: so many failed one after the other that more would fail as well.
        """
        self.control.rig = self._recovery.ready(self._rig)
        self._round(poses)
        again = [item.pose for item in self._missing.values()]
        if again:
            with contextlib.suppress(_SeveralInARow):
                self._round(again)
        self._tell(phase=Phase.LOOKING, pose=None)
        self._tell(findings=self._status.findings + self._watcher.drain(self.control.sleep))

    def _round(self, poses: Sequence[Pose]) -> None:
        in_a_row, left = 0, list(poses)
        while left:
            left = list(self._reorder(left))
            pose = left.pop(0)
            reason = self._pose(pose)
            if reason:
                self._missing[pose.name] = Missing(pose, reason)
                self._note("left", pose=pose.name, reason=reason)
            else:
                self._missing.pop(pose.name, None)
            self._tell(missing=tuple(self._missing.values()))
            in_a_row = in_a_row + 1 if reason else 0
            if in_a_row == self._patience.in_a_row:
                raise _SeveralInARow(f"{in_a_row} poses in a row failed, {pose.name} at last: {reason}")

    def _pose(self, pose: Pose) -> str:
        """Take one pose within its tries; "" when it was taken, else why not."""
        reason = ""
        for attempt in range(1, self._patience.tries + 1):
            self._pause_here(pose)
            start = self._clock()
            self._tell(pose=pose)
            try:
                self._note("begun", pose=pose.name, attempt=attempt)
                shot = self._take(pose)
            except HardwareError as error:
                self.control.check()
                reason = str(error)
                self._note("failed", pose=pose.name, attempt=attempt, reason=reason)
                if not error.transient:
                    raise
                self._enter(Phase.RECOVERING, reason)
                self.control.sleep(self._patience.wait_s * 2 ** (attempt - 1))
                self.control.rig = self._recovery.ready(self._rig, error)
            else:
                self._note("finished", pose=pose.name, shot=shot.folder.name)
                self._finished(shot, self._clock() - start)
                return ""
        return reason

    def _pause_here(self, pose: Pose) -> None:
        self.control.check()
        if self.control.paused:
            self._note("paused", pose=pose.name)
            self._tell(phase=Phase.PAUSED, pose=pose, message="")
            self.control.wait_while_paused()
            self._note("resumed", pose=pose.name)

    # ---- one pose

    def _take(self, pose: Pose) -> Shot:
        place = capture_folder.incoming(self._folder) / pose.name
        with sessions.told(place):
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir(parents=True)
            taken = self._rig.take(pose.angles, self._bracket, place, self._step)
        self._enter(Phase.FILING, finish=True)
        exposures = len(self._order.bracket.stops)
        checked = capture_frames.check(pose, taken.frames, exposures, self._known, self._order.any_format)
        assert self._session is not None
        self._session = capture_folder.with_camera(self._session, checked[0].camera)
        shot = capture_folder.keep(self._session, self._order, pose, taken.angles, checked)
        self._known |= set(shot.sha256)
        try:
            self._rig.camera.forget([frame.taken for frame in taken.frames])
        except HardwareError as error:
            # The photographs are safe here: a camera that cannot free their room loses nothing by it.
            self._note("failed", step="freeing the camera's memory", reason=str(error))
        return shot

    def _step(self, step: Step) -> None:
        """The rig begins it; what was exposed is still fetched when the end was asked for."""
        self._enter(PHASES[step], finish=step is Step.FETCH)

    @property
    def _rig(self) -> Rig:
        assert self.control.rig is not None
        return self.control.rig

    def _finished(self, shot: Shot, seconds: float) -> None:
        """
        Raises:
            CaptureError: what is left will not fit on the disk.
        """
        self._keep_exposure(shot)
        self._watcher.show(shot)
        self._paces.append(seconds)
        self._bytes.append(statistics.fmean(file.stat().st_size for file in shot.files))
        taken = self._status.taken + 1
        left = len(self._order.poses) - taken
        findings = self._status.findings + self._watcher.collect()
        self._tell(taken=taken, message="", left_s=statistics.median(self._paces) * left, findings=findings)
        # The whole plan once its files are known, then as long as there is room for the next pose.
        poses = left if len(self._bytes) == 1 else min(left, 1)
        photographs = poses * len(self._order.bracket.stops)
        capture_disk.check(self._folder, photographs, statistics.fmean(self._bytes), self._free)

    def _keep_exposure(self, shot: Shot) -> None:
        """Where no shutter time was asked for, the first pose's holds for all: a bracket leaves the camera at its last."""
        base = self._bracket.base
        if base.shutter_s is None and self._rig.camera.features.sets_exposure:
            found = capture_frames.base_shutter_s(shot.exposures)
            self._bracket = replace(self._bracket, base=replace(base, shutter_s=found))

    # ---- telling

    def _enter(self, phase: Phase, message: str = "", finish: bool = False) -> None:
        """Tell the next step, unless the end was asked for; `finish`: only a stop ends it here."""
        self._tell(phase=phase, message=message)
        if not finish or self.control.asked is Asked.STOP:
            self.control.check()

    def _tell(self, **changes: Any) -> None:
        self._status = replace(self._status, **changes)
        self.control.phase = self._status.phase
        self._listener(self._status)

    def _note(self, event: str, **facts: Any) -> None:
        if self._journal is not None:
            self._journal.note(event, **facts)

    def _outcome(self, cancelled: bool) -> Outcome:
        status = self._status
        return Outcome(status.taken, status.total, tuple(self._missing.values()), cancelled, status.findings)


def _warnings(texts: Sequence[str]) -> tuple[Finding, ...]:
    return tuple(Finding("", text, Severity.WARNING) for text in texts)


class _SeveralInARow(CaptureError):
    """Poses failed one after the other."""
