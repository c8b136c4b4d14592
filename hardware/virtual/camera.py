"""A camera without hardware: it sees a scene from where the virtual rig stands and stores real DNG files on a card.

It meters once, at its first bracket, where no shutter time is asked for. Files have a camera's names and Exif times; the
card is a folder, which is removed with the camera unless it was given. Faults are called from any thread (`Faults`).
Seconds, EV; radiance as `hardware.virtual.sensor` has it.
"""

import datetime
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hardware.camera import transfer
from hardware.camera.values import nearest, told
from hardware.errors import (
    BatteryError,
    DisconnectedError,
    ExposureError,
    HardwareError,
    SettingsError,
    StoppedError,
    StoreFullError,
)
from hardware.interfaces import Angles, Bracket, Camera, CameraFeatures, CameraStatus, Exposure, Frame, Taken
from hardware.virtual import dng, sensor
from hardware.virtual.eye import Eye
from hardware.virtual.scenes import Scene

# Thirds of a stop, 1/8000 to 30 s as dials call them; exact, so that the file tells the true time.
SHUTTERS_S = tuple(2.0 ** (third / 3) for third in range(-39, 16))
TRIES = 3  # of one download
HANG_S = 0.01
LAST_NUMBER = 9999  # of a folder on the card (DCF)


@dataclass(slots=True)
class Faults:
    """What goes wrong next; counts fall by one each time, `None`, `False` and nought are no fault."""

    busy: int = 0  # orders refused because the camera is busy
    lost: int = 0  # releases that leave no file
    cut: int = 0  # transfers that end half-way
    garbled: int = 0  # transfers that change a byte
    room: int | None = None  # photographs until the card is full
    battery: float = 1.0
    hangs: bool = False  # releases wait until somebody stops them
    unplugged: bool = False


@dataclass(frozen=True, slots=True)
class VirtualCameraConfig:
    """How it is built; `card` None: a folder of its own."""

    size: tuple[int, int] = (320, 240)
    seed: int = 1
    vignetting: float = 0.0
    card: Path | None = None
    lowest_battery: float = 0.05


class VirtualCamera(Camera):
    """Looks at `scene` from `where` the rig stands when it is released.

    `now` is the camera's clock; `pause` lets an exposure's time pass, by default not at all.
    """

    def __init__(
        self,
        config: VirtualCameraConfig,
        scene: Callable[[], Scene],
        where: Callable[[], Angles],
        now: Callable[[], datetime.datetime] = datetime.datetime.now,
        pause: Callable[[float], None] = lambda seconds: None,
    ):
        """
        Args:
            scene: makes what it looks at; called at the first exposure and in another thread, for it may take long.

        Raises:
            StudioError: no lens loses such a share of light.
            SettingsError: sizes that no Bayer sensor has, or a negative seed.
        """
        width, height = config.size
        if min(width, height) < 16 or width % 2 or height % 2:
            raise SettingsError(f"{width} x {height} pixels: a Bayer sensor needs even sizes of at least 16")
        if config.seed < 0:
            raise SettingsError(f"seed {config.seed}: a seed is a whole number >= 0; choose another")
        self.faults = Faults()
        self._config, self._where, self._now, self._pause = config, where, now, pause
        self._eye = Eye(scene)
        self._sensor = sensor.Sensor(vignetting=config.vignetting)
        self._shutter_s: float | None = None  # as metered at the first bracket
        self._ready_at = datetime.datetime.min
        self._stopped = threading.Event()
        self._closed = False
        # Removed with the program too, if nobody closes the camera.
        self._temporary = tempfile.TemporaryDirectory(prefix="roomlight-card-", ignore_cleanup_errors=True)
        self.card = config.card or Path(self._temporary.name)
        self._count = _count(self.card)

    @property
    def name(self) -> str:
        return f"{dng.MODEL} {self._config.size[0]} x {self._config.size[1]}"

    @property
    def features(self) -> CameraFeatures:
        width, height = self._config.size
        return CameraFeatures(
            dng.MODEL,
            SHUTTERS_S,
            (self._sensor.iso,),
            (self._sensor.aperture,),
            ".dng",
            sets_exposure=True,
            file_bytes=2 * width * height + 1024,
        )

    def status(self) -> CameraStatus:
        faults = self.faults
        if self._closed:
            return CameraStatus(False, message="closed")
        if faults.unplugged:
            return CameraStatus(False, message="the connection is gone")
        if faults.battery <= self._config.lowest_battery:
            return CameraStatus(False, faults.battery, faults.room, "battery low")
        return CameraStatus(True, faults.battery, faults.room, "no room left" if faults.room == 0 else "")

    def expose(self, bracket: Bracket) -> tuple[Taken, ...]:
        self._begin()
        if self.faults.battery <= self._config.lowest_battery:
            raise BatteryError(
                f"{self.name}: its battery is at {100 * self.faults.battery:.0f} %; charge or change it"
            )
        self._check_fixed(bracket.base)
        asked_s = self._shutter_s if bracket.base.shutter_s is None else bracket.base.shutter_s
        # What cannot be set is refused before anything is looked at.
        shutters = () if asked_s is None else _shutters(asked_s, bracket.stops)
        if _spent(self.faults, "busy"):
            raise ExposureError(f"{self.name}: still busy; try again")
        radiance = self._eye.look(self._where(), self._config.seed + self._count, self._check)
        if not shutters:
            self._shutter_s = _near(sensor.meter(radiance[None], self._sensor), bracket.stops)
            shutters = _shutters(self._shutter_s, bracket.stops)
        taken = []
        for shutter_s, stop in zip(shutters, bracket.stops, strict=True):
            exposure = Exposure(shutter_s, self._sensor.iso, self._sensor.aperture)
            taken.append(Taken(self._release(radiance, shutter_s), stop, exposure))
        return tuple(taken)

    def download(self, taken: Taken, to: Path) -> Frame:
        self._begin()
        source = self.card / taken.handle
        if not source.is_file():
            raise ExposureError(f"{self.name}: {taken.handle} is no longer on the card")
        for left in reversed(range(TRIES)):
            try:
                arrived = transfer.deliver(
                    self._sent(source), to, source.stat().st_size, transfer.file_sha256(source)
                )
                return Frame(to, source.name, arrived.sha256, arrived.bytes, taken)
            except ExposureError:
                if not left:
                    raise
        raise AssertionError("the last try returns or raises")

    def forget(self, taken: Sequence[Taken]) -> None:
        """Frees the room on a card of its own; a card that was given is the person's."""
        if self._config.card is None:
            for item in taken:
                (self.card / item.handle).unlink(missing_ok=True)

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._closed = True
        self._stopped.set()
        self._eye.close()
        self._temporary.cleanup()

    def _begin(self) -> None:
        if self._closed:
            raise HardwareError(f"{self.name}: was closed; open the camera again")
        self._stopped.clear()
        self._check()

    def _check(self) -> None:
        if self.faults.unplugged:
            raise DisconnectedError(f"{self.name}: the connection is gone; check the cable")
        if self._stopped.is_set():
            raise StoppedError(f"{self.name}: stopped while waiting for the camera")

    def _check_fixed(self, base: Exposure) -> None:
        for what, asked, fixed in (
            ("ISO", base.iso, self._sensor.iso),
            ("f/", base.aperture, self._sensor.aperture),
        ):
            if asked is not None and asked != fixed:
                raise SettingsError(f"{self.name}: {what} {asked:g} is not offered, only {fixed:g}")

    def _release(self, radiance: np.ndarray, shutter_s: float) -> str:
        """Take one photograph; returns its path on the card."""
        self._check()
        while self.faults.hangs:
            time.sleep(HANG_S)
            self._check()
        if self.faults.room is not None and self.faults.room <= 0:
            raise StoreFullError(f"{self.name}: its card is full; free some room or put in another card")
        begins = max(self._now(), self._ready_at)
        self._pause(shutter_s + sensor.READOUT_S)
        self._ready_at = begins + datetime.timedelta(seconds=shutter_s + sensor.READOUT_S)
        if _spent(self.faults, "lost"):
            raise ExposureError(f"{self.name}: released, but no file arrived; try again")
        rng = np.random.default_rng([self._config.seed, self._count])
        chip = self._sensor
        photograph = dng.Photograph(
            sensor.expose(radiance, shutter_s, chip, rng), chip.black, chip.white, chip.camera_from_xyz,
            chip.neutral(), shutter_s, chip.iso, chip.aperture, begins,
        )  # fmt: skip
        path = _path(self._count)
        try:
            (self.card / path).parent.mkdir(parents=True, exist_ok=True)
            dng.write(self.card / path, photograph)
        except OSError as error:
            raise HardwareError(
                f"{self.card}: cannot be written ({error.strerror}); check the disk that holds the camera's card"
            ) from error
        self._count += 1
        if self.faults.room is not None:
            self.faults.room -= 1
        return path

    def _sent(self, source: Path) -> Iterator[bytes]:
        """The file's bytes as the cable brings them."""
        cut, garbled = _spent(self.faults, "cut"), _spent(self.faults, "garbled")
        whole = source.stat().st_size
        for piece in transfer.pieces(source):
            self._check()
            if garbled:
                piece, garbled = bytes([piece[0] ^ 1]) + piece[1:], False
            yield piece[: whole // 2] if cut else piece
            if cut:
                return


def _near(metered_s: float, stops: Sequence[float]) -> float:
    """The shutter time nearest to what the meter says whose whole bracket is offered."""
    lowest, highest = SHUTTERS_S[0] * 2.0 ** -min(stops), SHUTTERS_S[-1] * 2.0 ** -max(stops)
    return nearest(min(max(metered_s, lowest), highest), SHUTTERS_S, f"shutter of {told(metered_s)} s")


def _shutters(base_s: float, stops: Sequence[float]) -> tuple[float, ...]:
    if not base_s > 0:
        raise SettingsError(f"a shutter of {base_s:g} s cannot be meant; say a time above 0")
    return tuple(
        nearest(base_s * 2.0**stop, SHUTTERS_S, f"shutter of {told(base_s * 2.0**stop)} s") for stop in stops
    )


def _spent(faults: Faults, name: str) -> bool:
    """Whether this fault is due; one less of it is left then."""
    left = getattr(faults, name)
    setattr(faults, name, max(0, left - 1))
    return left > 0


def _path(count: int) -> str:
    """DCIM/100ROOML/IMG_0001.DNG for the first, as the standard for cameras' folders (DCF 2.0) has it."""
    folder, number = divmod(count, LAST_NUMBER)
    return f"DCIM/{100 + folder}ROOML/IMG_{number + 1:04d}.DNG"


def _count(card: Path) -> int:
    """How many photographs a card has seen: numbers go on after the last one."""
    numbers = [
        (int(path.parent.name[:3]) - 100) * LAST_NUMBER + int(path.stem[4:])
        for path in card.glob("DCIM/[0-9][0-9][0-9]ROOML/IMG_[0-9][0-9][0-9][0-9].DNG")
    ]
    return max(numbers, default=0)
