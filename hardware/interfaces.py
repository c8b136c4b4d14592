"""What a rig's motion and a camera can do, whoever made them: the code above knows nothing else.

Angles are degrees here, as rigs count them: `pan` right-handed about the pan axis, `tilt` about the tilt axis
that the pan table carries. One thread gives orders (`home`, `move`, `expose`, ...) and each blocks until it is
done; `stop` and `status` may be called from any thread at any moment, also while an order is under way.
`tests/hardware/contracts/` holds every implementation to what is said here.
"""

import enum
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Angles:
    """Where a rig stands or shall go, degrees. A pan table that turns endlessly counts on: 370 is not 10."""

    pan_deg: float
    tilt_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis: travel (None: turns endlessly), how fine it can be told, and how fast it goes."""

    name: str  # "pan" or "tilt"
    lowest_deg: float | None
    highest_deg: float | None
    resolution_deg: float
    fastest_deg_s: float


@dataclass(frozen=True, slots=True)
class MotionFeatures:
    """What this rig can do; the capture offers nothing else."""

    axes: tuple[Axis, ...]  # empty: nothing turns (handheld)
    automatic: bool  # moves by itself; otherwise a person is asked to
    homes: bool
    holds: bool  # can pause in motion and go on
    reports_angles: bool


class State(enum.Enum):
    """What a rig is doing."""

    UNHOMED = "not homed"  # position unknown: home before the first move
    IDLE = "idle"
    MOVING = "moving"
    HOMING = "homing"
    HELD = "held"
    FAULT = "fault"  # alarm, stall, e-stop: `message` says which
    OFFLINE = "offline"


@dataclass(frozen=True, slots=True)
class MotionStatus:
    """What a rig last said of itself; `angles` is None where it does not know or cannot tell."""

    state: State
    angles: Angles | None
    message: str = ""


class Motion(ABC):
    """One or two axes that turn camera and object together."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What a person calls it: model, firmware and port."""

    @property
    @abstractmethod
    def features(self) -> MotionFeatures: ...

    @abstractmethod
    def status(self) -> MotionStatus:
        """From any thread, within 0.5 s; never raises for a device that fell silent, but says OFFLINE."""

    @abstractmethod
    def home(self) -> Angles:
        """Find the zero of every axis, clearing an alarm first; returns where it stands then.

        Raises:
            HardwareError: it could not; the position is then unknown.
        """

    @abstractmethod
    def move(self, angles: Angles) -> Angles:
        """Go there and stand still; returns what the rig reports once it has settled.

        Raises:
            LimitError: beyond the travel; nothing was sent.
            PositionLostError: it is not homed, or lost its position on the way.
            StoppedError: `stop` was called meanwhile.
            ReplyError, RefusedError, DisconnectedError: as their names say.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop at once. The bytes are on the wire when this returns, whatever other threads are doing."""

    @abstractmethod
    def hold(self) -> None:
        """Pause a motion under way; nothing where the rig cannot or does not move."""

    @abstractmethod
    def resume(self) -> None:
        """Go on after `hold`."""

    @abstractmethod
    def close(self) -> None:
        """Stop what moves and let go of the port; may be called twice."""


@dataclass(frozen=True, slots=True)
class Exposure:
    """What the camera is set to for one photograph; None: as the camera has it."""

    shutter_s: float | None
    iso: int | None = None
    aperture: float | None = None


@dataclass(frozen=True, slots=True)
class Bracket:
    """The exposures of one pose: `base`, and offsets to its shutter in EV, in the order they are taken."""

    base: Exposure
    stops: tuple[float, ...] = (-3.0, 0.0, 3.0)


@dataclass(frozen=True, slots=True)
class CameraFeatures:
    """What this camera offers; empty tuples where it does not tell or cannot be set from here."""

    model: str
    shutters_s: tuple[float, ...]  # ascending
    isos: tuple[int, ...]
    apertures: tuple[float, ...]
    suffix: str  # of its files, ".dng", ".cr3", ".jpg", ...; "" if that is only known by looking
    sets_exposure: bool  # False: brackets are set on the camera's body (a watched folder)
    file_bytes: int | None = None  # of one photograph, about; None: as its kind of file usually has


@dataclass(frozen=True, slots=True)
class CameraStatus:
    """What the camera last said of itself; None where it does not tell."""

    ready: bool
    battery: float | None = None  # 0 to 1
    free_shots: int | None = None
    message: str = ""


@dataclass(frozen=True, slots=True)
class Taken:
    """One photograph that exists, still on the camera, on its card or in a watched folder."""

    handle: str  # the camera's own name for it, as a path
    ev: float  # offset within the bracket
    exposure: Exposure  # as the camera set it, which may differ from what was asked


@dataclass(frozen=True, slots=True)
class Frame:
    """A photograph downloaded and verified."""

    path: Path
    original: str  # its name on the camera, as IMG_0412.CR3
    sha256: str
    bytes: int
    taken: Taken


class Camera(ABC):
    """Takes brackets and hands the files over."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What a person calls it: model and where it is plugged in."""

    @property
    @abstractmethod
    def features(self) -> CameraFeatures: ...

    @abstractmethod
    def status(self) -> CameraStatus:
        """From any thread, within 0.5 s; never raises for a camera that fell silent."""

    @abstractmethod
    def expose(self, bracket: Bracket) -> tuple[Taken, ...]:
        """Take every exposure of a bracket; they are on the camera (or in the folder) when this returns.

        Raises:
            ExposureError: it may succeed when tried again; nothing of this bracket counts.
            StoreFullError, BatteryError, StoppedError, DisconnectedError: as their names say.
            SettingsError: an exposure that the camera does not offer; nothing was taken.
        """

    @abstractmethod
    def download(self, taken: Taken, to: Path) -> Frame:
        """Copy one photograph to the file `to` and check it is whole; it stays on the camera.

        Raises:
            ExposureError: transfer failed after its bounded tries.
            DisconnectedError, HardwareError: the camera or the disk refused.
        """

    @abstractmethod
    def forget(self, taken: Sequence[Taken]) -> None:
        """These are safe here: the camera may free their room. Nothing on cards and in folders of the person's."""

    @abstractmethod
    def stop(self) -> None:
        """Give up waiting: an `expose` or `download` under way raises StoppedError soon."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the camera; may be called twice."""


@dataclass(frozen=True, slots=True)
class Geometry:
    """Where camera and axes are, in the frame of the camera at pan = tilt = 0 (x right, y down, z forward), metres.

    world_from_cam(pan, tilt) = turn(pan_axis, pan_point, pan) . turn(tilt_axis, tilt_point, tilt), right-handed.
    """

    pan_axis: tuple[float, float, float]
    pan_point: tuple[float, float, float]
    tilt_axis: tuple[float, float, float]
    tilt_point: tuple[float, float, float]
