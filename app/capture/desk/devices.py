"""The rig and the camera that the desk holds: opened, told of, watched, and what they ask of a person.

One thread opens, closes and gives orders; `answer`, `look` and `stop` may come from any. Events are those that
`app/capture/desk/serving.py` lists.
"""

import contextlib
import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from hardware import find
from hardware.errors import HardwareError, SettingsError
from hardware.interfaces import CameraFeatures, MotionFeatures, State
from hardware.manual import Request
from hardware.rig import Rig

if TYPE_CHECKING:
    from app.work.worker import Link

LOOK_S, LOOK_MOVING_S = 0.5, 0.2
CAMERA_EVERY = 10  # looks at the rig

Opening = Callable[..., Rig]  # as `find.open_rig`


class Devices:
    """At most one rig with its camera."""

    def __init__(self, link: "Link", opening: Opening = find.open_rig) -> None:
        self._link, self._opening = link, opening
        self._rig: Rig | None = None
        self.urls = ("", "")  # of rig and camera
        self._settle_s = 0.0
        self._asking = threading.Lock()
        self._request: Request | None = None
        self._waiting_for_files = False

    @property
    def rig(self) -> Rig | None:
        return self._rig

    def needed(self) -> Rig:
        """
        Raises:
            SettingsError: none is open.
        """
        if self._rig is None:
            raise SettingsError("no rig and camera are open; choose them and open them first")
        return self._rig

    def open(self, rig_url: str, camera_url: str) -> None:
        """
        Raises:
            HardwareError: as the drivers say; nothing is open then.
        """
        self.close()
        self._open(rig_url, camera_url)
        rig = self.needed()
        self._emit(
            "opened",
            rig=_rig_facts(rig.motion.name, rig.motion.features),
            camera=_camera_facts(rig.camera.name, rig.camera.features),
        )

    def close(self) -> None:
        rig, self._rig = self._rig, None
        if rig is not None:
            # One that is gone has nothing to close, and needs no words: nobody holds it any more.
            with contextlib.suppress(HardwareError):
                rig.close()
            self._emit("closed")

    def lent(self) -> Callable[[], Rig]:
        """What gives a capture the rig that is open, and later, when its cable was pulled, opens it again."""
        at_hand = [self.needed()]

        def give() -> Rig:
            if at_hand:
                return at_hand.pop()
            self._open(*self.urls)
            return self.needed()

        return give

    def taken_back(self) -> None:
        """After a capture: its settle time was its own."""
        if self._rig is not None:
            self._rig.settle_s = self._settle_s

    def _open(self, rig_url: str, camera_url: str) -> None:
        self._rig = self._opening(
            rig_url, camera_url, ask=self._ask, tell=self._tell, progress=self._link.move
        )
        self.urls, self._settle_s = (rig_url, camera_url), self._rig.settle_s

    # ---- what a person is asked

    def answer(self) -> None:
        """It is done."""
        with self._asking:
            request = self._request
        if request is not None:
            request.confirm()
        else:
            self.hush()

    def hush(self) -> None:
        """The camera waits for no files any more."""
        with self._asking:
            waited, self._waiting_for_files = self._waiting_for_files, False
        if waited:
            self._emit("answered")

    def _ask(self, request: Request) -> None:
        with self._asking:
            self._request = request
        self._emit("ask", text=request.text, confirm=True)
        request.wait()
        with self._asking:
            self._request = None
        self._emit("answered")

    def _tell(self, text: str) -> None:
        with self._asking:
            self._waiting_for_files = True
        self._emit("ask", text=text, confirm=False)

    def _emit(self, kind: str, **facts: Any) -> None:
        self._link.emit("data", kind=kind, **facts)


class Lookout:
    """Looks at the devices now and then, in a thread of its own, and tells what changed."""

    def __init__(
        self, link: "Link", devices: Devices, idle: Callable[[], bool], quiet: Callable[[], bool]
    ) -> None:
        """
        Args:
            idle: no order is under way, so that the camera may be asked too.
            quiet: an exposure is under way: nobody is asked anything.
        """
        self._link, self._devices, self._idle, self._quiet = link, devices, idle, quiet
        self._looking = threading.Lock()
        self._rig: Rig | None = None
        self._last: dict[str, Any] = {}  # by kind
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lookout", daemon=True)
        self._thread.start()

    def look(self) -> bool:
        """Tell where the rig stands, if that changed; True while it moves."""
        with self._looking:
            rig = self._fresh()
            if rig is None or self._quiet():
                return False
            status = rig.motion.status()
            angles = status.angles
            self._tell(
                "where",
                state=status.state.value,
                pan=None if angles is None else angles.pan_deg,
                tilt=None if angles is None else angles.tilt_deg,
                message=status.message,
            )
            return status.state in (State.MOVING, State.HOMING)

    def look_at_camera(self) -> None:
        with self._looking:
            rig = self._fresh()
            if rig is None or not self._idle():
                return
            self._tell("camera", **asdict(rig.camera.status()))

    def close(self) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        count, moving = 0, False
        while not self._ended.wait(LOOK_MOVING_S if moving else LOOK_S):
            moving = self.look()
            count += 1
            if count % CAMERA_EVERY == 1:
                self.look_at_camera()

    def _fresh(self) -> Rig | None:
        """The rig; of another one nothing was told yet."""
        rig = self._devices.rig
        if rig is not self._rig:
            self._rig, self._last = rig, {}
        return rig

    def _tell(self, kind: str, **facts: Any) -> None:
        if self._last.get(kind) != facts:
            self._last[kind] = facts
            self._link.emit("data", kind=kind, **facts)


def plugged_in(link: "Link") -> dict[str, Any]:
    """Ports, cameras and what rigs there are, for the event `devices`."""
    from hardware.camera import body

    try:
        cameras = [{"url": f"gphoto2:{found.port}", "name": found.model} for found in body.detect()]
    except HardwareError as error:
        cameras = []
        link.log(f"cameras: {error}")
    ports = [asdict(port) for port in find.ports()]
    return {"ports": ports, "cameras": cameras, "rigs": list(find.RIGS.values())}


def _rig_facts(name: str, features: MotionFeatures) -> dict[str, Any]:
    axes = [
        {
            "name": axis.name,
            "lowest_deg": axis.lowest_deg,
            "highest_deg": axis.highest_deg,
            "fastest_deg_s": axis.fastest_deg_s,
        }
        for axis in features.axes
    ]
    return {
        "name": name,
        "axes": axes,
        "automatic": features.automatic,
        "homes": features.homes,
        "holds": features.holds,
        "reports_angles": features.reports_angles,
    }


def _camera_facts(name: str, features: CameraFeatures) -> dict[str, Any]:
    return {
        "name": name,
        "model": features.model,
        "shutters_s": features.shutters_s,
        "isos": features.isos,
        "apertures": features.apertures,
        "sets_exposure": features.sets_exposure,
        "suffix": features.suffix,
    }
