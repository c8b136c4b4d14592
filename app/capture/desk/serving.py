"""Task "desk": a worker child that holds rig and camera, for jogging and for capturing, as long as the page wants.

Commands (JSON lines): list; open {rig, camera} (device URLs); close; home; move {pan, tilt}; jog {pan, tilt} (so far
from here); stop (rig and camera at once; a capture ends); preview {shutter, iso, aperture}; plan {plan}; start
{session, plan, bracket, shutter, iso, aperture, settle, helpful_first, any_format}; resume {session, helpful_first,
at_zero}; pause; go_on; end; answer. Plans and exposures as `wishes` has them; degrees and seconds.

Orders to the devices are carried out one at a time in the task's own thread, and another is refused meanwhile; list and
plan are answered beside them; stop, pause, go_on, end and answer are obeyed at once.

Events are `data` with a kind; `app/capture/panel_state.py` says what each tells: order (one begins, or "" when it is
over), devices, opened, closed, where, camera, picture, planned, status, finding, coverage, ask, answered, ended, trouble.
`progress` tells of a virtual room that is baked for its first photograph and, with `left_s`, of the capture.
"""

import contextlib
import shutil
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from app.capture.desk import wishes
from app.capture.desk.devices import Devices, Lookout, Opening, plugged_in
from app.capture.desk.newest import Newest
from app.capture.desk.pictures import Pictures
from app.capture.order import Pose, poses_of
from app.capture.recovery import Patience
from app.capture.status import Phase
from app.rigs import within
from engine.errors import Cancelled, RoomlightError
from engine.io.session import told
from hardware import find
from hardware.errors import HardwareError, PositionLostError, StoppedError
from hardware.interfaces import Angles, Bracket
from hardware.plan import fitted

if TYPE_CHECKING:
    from app.capture.desk.captures import Run
    from app.work.worker import Link

Content = Mapping[str, Any]

USUAL = Patience()

UNTOUCHED = frozenset(
    {Phase.EXPOSING, Phase.DOWNLOADING}
)  # the camera works: nothing else is asked of the rig


def serve(request: Content, link: "Link") -> Content:
    """Task "desk": {}."""
    with tempfile.TemporaryDirectory(prefix="roomlight-desk-", ignore_cleanup_errors=True) as folder:
        Desk(link, Path(folder)).serve()
    return {}


class Desk:
    """Hears commands and obeys them."""

    def __init__(
        self,
        link: "Link",
        folder: Path,
        opening: Opening = find.open_rig,
        patience: Patience = USUAL,
    ) -> None:
        """
        Args:
            folder: for pictures; whoever gives it clears it away.
            opening: as `find.open_rig`.
            patience: of captures, with devices that fail.
        """
        self._link, self._folder, self._patience = link, folder, patience
        self._devices = Devices(link, opening)
        self._pictures = Pictures(link, folder)
        self._changed = threading.Condition()
        self._order: Content | None = None  # given, and not done yet
        self._leaving = self._stopping = False
        self._run: Run | None = None  # the capture under way
        self._aside = Newest("beside the desk")

    def serve(self) -> None:
        """Until it is cancelled or the window is gone."""
        lookout = Lookout(self._link, self._devices, lambda: self._order is None, self._exposing)
        for command in self._orders():
            self._link.hear(command, self._take)
        at_once: dict[str, Callable[[Content], None]] = {
            "list": lambda content: self._beside(content, self._list),
            "plan": lambda content: self._beside(content, self._plan),
            "stop": self._stop,
            "pause": lambda content: self._tell_run(content, lambda run: run.pause()),
            "go_on": lambda content: self._tell_run(content, lambda run: run.go_on()),
            "end": lambda content: self._tell_run(content, lambda run: run.control.cancel()),
            "answer": lambda content: self._devices.answer(),
            "cancel": self._leave,
            "gone": self._leave,
        }
        for command, handler in at_once.items():
            self._link.hear(command, handler)
        try:
            while (content := self._next()) is not None:
                self._obey(content)
                lookout.look()
        finally:
            lookout.close()
            self._devices.close()
            self._aside.close()

    def _orders(self) -> Mapping[str, Callable[[Content], None]]:
        return {
            "open": lambda content: self._devices.open(content["rig"], content["camera"]),
            "close": lambda content: self._devices.close(),
            "home": self._home,
            "move": self._move,
            "jog": self._jog,
            "preview": self._preview,
            "start": self._capture,
            "resume": self._capture,
        }

    # ---- orders, in the task's own thread

    def _next(self) -> Content | None:
        with self._changed:
            self._changed.wait_for(lambda: self._leaving or self._order is not None)
            return None if self._leaving else self._order

    def _obey(self, content: Content) -> None:
        command = content["command"]
        self._stopping = False
        self._emit("order", command=command, session=content.get("session", ""))
        try:
            self._orders()[command](content)
        except Cancelled:
            pass
        except (RoomlightError, HardwareError) as error:
            # Who pressed stop knows.
            if not (self._stopping and isinstance(error, StoppedError)):
                self._trouble(command, error)
        self._devices.hush()
        with self._changed:
            self._order = None
        self._emit("order", command="", session="")

    def _home(self, content: Content) -> None:
        self._devices.needed().home()

    def _move(self, content: Content) -> None:
        self._devices.needed().go(Angles(float(content["pan"]), float(content["tilt"])))

    def _jog(self, content: Content) -> None:
        rig = self._devices.needed()
        here = rig.motion.status().angles
        if here is None:
            raise PositionLostError(f"{rig.motion.name}: does not know where it stands; home it first")
        axes = {axis.name: axis for axis in rig.motion.features.axes}
        pan, tilt = float(content["pan"]), float(content["tilt"])
        # An axis that shall stay may stand a little beyond its travel, at its switch.
        rig.go(
            Angles(
                here.pan_deg + pan if pan else within(here.pan_deg, axes.get("pan")),
                here.tilt_deg + tilt if tilt else within(here.tilt_deg, axes.get("tilt")),
            )
        )

    def _preview(self, content: Content) -> None:
        rig, place = self._devices.needed(), self._folder / "preview"
        with told(place):
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
        # Where it stands, and with nobody's time to hold it another way: no order of the rig's.
        taken = rig.camera.expose(Bracket(wishes.exposure(content), (0.0,)))
        frames = [rig.camera.download(one, place / PurePosixPath(one.handle).name) for one in taken]
        self._pictures.show([frame.path for frame in frames], "")
        rig.camera.forget(taken)

    def _capture(self, content: Content) -> None:
        # The checks take a second to load, which the devices need not wait for.
        from app.capture.desk.captures import Around, resumed, started

        make = started if content["command"] == "start" else resumed
        around = Around(self._link, self._devices, self._pictures, self._aside, self._patience)
        self._run = run = make(around, content)
        # What the page shows may be another plan than the one that is captured.
        self._beside({"command": "plan"}, lambda plan: self._tell_plan(run.poses))
        try:
            if self._leaving or self._stopping:
                return
            run.run()
        finally:
            self._run = None

    # ---- beside them

    def _beside(self, content: Content, answer: Callable[[Content], None]) -> None:
        """Answer in another thread; the newest of a kind is enough."""

        def call() -> None:
            try:
                answer(content)
            except (RoomlightError, HardwareError) as error:
                self._trouble(content["command"], error)

        self._aside.put(content["command"], call)

    def _list(self, content: Content) -> None:
        self._emit("devices", **plugged_in(self._link))

    def _plan(self, content: Content) -> None:
        rig = self._devices.rig
        plan = wishes.plan(content["plan"], None if rig is None else rig.motion.features)
        if rig is not None:
            plan = fitted(plan, rig.motion.features)
        self._tell_plan(poses_of(plan))

    def _tell_plan(self, planned: Sequence[Pose]) -> None:
        from app.capture import checks

        rig = self._devices.rig
        angles = [pose.angles for pose in planned if pose.angles is not None]
        poses = [
            {
                "name": pose.name,
                "pan": None if pose.angles is None else pose.angles.pan_deg,
                "tilt": None if pose.angles is None else pose.angles.tilt_deg,
            }
            for pose in planned
        ]
        warnings = checks.of_plan(None if rig is None else rig.geometry, angles) if angles else ()
        self._emit("planned", poses=poses, warnings=warnings)

    # ---- commands, in the thread that hears them: nothing here may wait

    def _take(self, content: Content) -> None:
        with self._changed:
            under_way = self._order
            if under_way is None:
                self._order = content
                self._changed.notify_all()
        if under_way is not None:
            self._emit(
                "trouble",
                command=content["command"],
                text=f"busy with {under_way['command']}; wait for it, or press stop",
            )

    def _stop(self, content: Content) -> None:
        self._stopping = True
        run, rig = self._run, self._devices.rig
        try:
            if run is not None:
                run.control.stop()
            elif rig is not None:
                rig.stop()
        except HardwareError as error:
            self._trouble("stop", f"THE STOP DID NOT REACH THE RIG: {error}")

    def _tell_run(self, content: Content, tell: "Callable[[Run], None]") -> None:
        run = self._run
        if run is None:
            return
        try:
            tell(run)
        except HardwareError as error:
            self._trouble(content["command"], error)

    def _leave(self, content: Content) -> None:
        """End: a capture after its exposure, anything else at once."""
        with self._changed:
            self._leaving = True
            busy = self._order is not None
            self._changed.notify_all()
        run, rig = self._run, self._devices.rig
        # The window is closing: a rig that does not hear is left, as the closing of its port will tell it to stop.
        with contextlib.suppress(HardwareError):
            if run is not None:
                run.control.cancel()
            elif busy and rig is not None:
                rig.stop()

    # ---- telling

    def _exposing(self) -> bool:
        run = self._run
        return run is not None and run.control.phase in UNTOUCHED

    def _trouble(self, command: str, error: object) -> None:
        self._emit("trouble", command=command, text=" ".join(str(error).split()))

    def _emit(self, kind: str, **facts: Any) -> None:
        self._link.emit("data", kind=kind, **facts)
