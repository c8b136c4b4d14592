"""Take what another program stores in a folder: for every camera whose tether tool (or card reader) can fill one.

A person, or the other program, takes the photographs; a file counts when its size and time were the same at two looks
one after the other. What lay there before is none of it. The files tell which exposure each is, by Exif; where they
do not, they count in the order in which they came. Seconds, EV.
"""

import errno
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hardware.camera import exif, transfer
from hardware.camera.exif import JPEG_SUFFIXES, RAW_SUFFIXES, Exif
from hardware.errors import (
    AbsentError,
    AccessError,
    DisconnectedError,
    ExposureError,
    HardwareError,
    SettingsError,
    StoppedError,
)
from hardware.interfaces import Bracket, Camera, CameraFeatures, CameraStatus, Exposure, Frame, Taken

UNLIKE_EV = 0.5  # between the bracket that was asked for and the one that came


@dataclass(frozen=True, slots=True)
class FolderConfig:
    """Which folder, and what to expect of it."""

    folder: Path
    suffix: str = (
        ""  # ".cr3": nothing else counts; "": RAW files of any kind, and no JPEG that lies beside them
    )
    bracket: int | None = None  # files of one pose, if the camera's body fixes that
    timeout_s: float = 300.0  # longest time without a new file
    poll_s: float = 0.5  # between two looks


@dataclass(frozen=True, slots=True)
class _Seen:
    size: int
    time_ns: int


class FolderCamera(Camera):
    """A folder that fills; `ask` tells the person what to do."""

    def __init__(
        self,
        config: FolderConfig,
        ask: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        """
        Raises:
            AbsentError, AccessError: the folder is not there, or may not be read.
            SettingsError: a suffix no photograph has, or times that cannot be meant.
        """
        suffix = config.suffix.lower()
        self._suffix = f".{suffix.lstrip('.')}" if suffix else ""
        if self._suffix and self._suffix not in RAW_SUFFIXES | JPEG_SUFFIXES:
            raise SettingsError(
                f"suffix {config.suffix!r}: no kind of photograph; say one as .cr3, .nef or .jpg"
            )
        if not (config.timeout_s > 0 and config.poll_s > 0) or (
            config.bracket is not None and config.bracket < 1
        ):
            raise SettingsError("timeout, poll and bracket of a watched folder are numbers above 0")
        self._config, self._ask, self._clock, self._sleep = config, ask, clock, sleep
        self._stopped = threading.Event()
        self._closed = False
        self._camera = ""  # as the first file that tells calls it
        try:
            os.listdir(config.folder)
        except OSError as error:
            raise _unopened(config.folder, error) from error
        self._used = set(self._looked())

    @property
    def name(self) -> str:
        return f"folder {self._config.folder}"

    @property
    def features(self) -> CameraFeatures:
        return CameraFeatures(self._camera or "watched folder", (), (), (), self._suffix, sets_exposure=False)

    def status(self) -> CameraStatus:
        if self._closed:
            return CameraStatus(False, message="closed")
        if not os.access(self._config.folder, os.R_OK | os.X_OK):
            return CameraStatus(False, message=f"{self._config.folder} is gone or may not be read")
        return CameraStatus(True)

    def expose(self, bracket: Bracket) -> tuple[Taken, ...]:
        self._begin()
        count = len(bracket.stops)
        if self._config.bracket not in (None, count):
            raise SettingsError(
                f"{self.name}: {self._config.bracket} files make one pose there, but {count} exposures were asked for"
            )
        there = set(self._looked())
        early = sorted(there - self._used)
        self._used = there
        stops = ", ".join(f"{stop:+g}" if stop else "0" for stop in bracket.stops)
        what = f"a bracket of {count} photographs ({stops} EV)" if count > 1 else "a photograph"
        unused = f"; not used, because it came before: {', '.join(early)}" if early else ""
        self._ask(f"take {what}; waiting for the files in {self._config.folder}{unused}")
        names = self._arrived(count)
        return self._taken(bracket, names)

    def download(self, taken: Taken, to: Path) -> Frame:
        self._begin()
        source = self._config.folder / taken.handle
        try:
            size, sha256 = source.stat().st_size, transfer.file_sha256(source)
            content = self._pieces(source)
        except FileNotFoundError:
            self._looked()  # or the whole folder is gone
            raise ExposureError(
                f"{source}: was taken away before it was copied; leave the files there"
            ) from None
        except OSError as error:
            raise _gone(source, error) from error
        arrived = transfer.deliver(content, to, size, sha256)
        return Frame(to, taken.handle, arrived.sha256, arrived.bytes, taken)

    def forget(self, taken: Sequence[Taken]) -> None:
        """The files are the person's."""

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._closed = True
        self._stopped.set()

    def _begin(self) -> None:
        if self._closed:
            raise HardwareError(f"{self.name}: was closed; open it again")
        self._stopped.clear()

    def _pieces(self, source: Path) -> Iterator[bytes]:
        for piece in transfer.pieces(source):
            self._check_stop()
            yield piece

    def _looked(self) -> dict[str, _Seen]:
        """Every photograph in the folder; what programs still write under another name is hidden or has another suffix."""
        kinds = {self._suffix} if self._suffix else RAW_SUFFIXES
        found = {}
        try:
            with os.scandir(self._config.folder) as entries:
                for entry in entries:
                    if entry.name.startswith(".") or Path(entry.name).suffix.lower() not in kinds:
                        continue
                    try:
                        stat = entry.stat()
                    except FileNotFoundError:
                        continue  # renamed while we looked
                    if entry.is_file():
                        found[entry.name] = _Seen(stat.st_size, stat.st_mtime_ns)
        except OSError as error:
            raise _gone(self._config.folder, error) from error
        return found

    def _arrived(self, count: int) -> list[str]:
        """Names of `count` whole photographs, in the order in which they came."""
        last = self._clock()
        before: dict[str, _Seen] = {}
        order: list[str] = []
        while True:
            self._check_stop()
            now = {name: seen for name, seen in self._looked().items() if name not in self._used}
            if now != before:
                last = self._clock()
            new = sorted(set(now) - set(order), key=lambda name: (now[name].time_ns, name))
            order = [name for name in order if name in now] + new
            if len(order) > count:
                self._used |= set(now)
                raise ExposureError(
                    f"{self.name}: {len(order)} photographs came where {count} were asked for: {', '.join(order)};"
                    " take this pose again"
                )
            if len(order) == count and all(
                seen.size > 0 and before.get(name) == seen for name, seen in now.items()
            ):
                self._used |= set(now)
                return order
            if self._clock() - last > self._config.timeout_s:
                self._used |= set(now)
                came = f"only {', '.join(order)}" if order else f"no {self._suffix or 'RAW file'}"
                raise ExposureError(
                    f"{self.name}: {came} came within {self._config.timeout_s:g} s where {count} photographs were asked"
                    " for; is the other program storing RAW files into this folder? For another kind say suffix=.jpg"
                )
            before = now
            self._sleep(self._config.poll_s)

    def _taken(self, bracket: Bracket, names: Sequence[str]) -> tuple[Taken, ...]:
        """Which stop each file is.

        Raises:
            ExposureError: they are of another camera, or of another bracket.
        """
        try:
            told = {name: exif.read(self._config.folder / name) for name in names}
        except OSError as error:
            raise ExposureError(f"{self.name}: {error.filename} cannot be read ({error.strerror})") from error
        self._check_camera(told)
        kinds = {Path(name).suffix.lower() for name in names}
        if len(kinds) > 1:
            raise ExposureError(
                f"{self.name}: {', '.join(names)} are of several kinds; let one camera store there"
            )
        self._suffix = self._suffix or Path(names[0]).suffix.lower()
        lights = {
            name: light for name, exposure in told.items() if (light := exposure.light_ev()) is not None
        }
        if len(lights) < len(names):
            ordered = list(names)
        else:
            ascending = sorted(names, key=lambda name: lights[name])
            _check_bracket(self.name, bracket.stops, ascending, lights)
            ranks = sorted(range(len(names)), key=lambda index: bracket.stops[index])
            ordered = [name for _, name in sorted(zip(ranks, ascending, strict=True))]
        return tuple(
            Taken(name, stop, _exposure(told[name]))
            for name, stop in zip(ordered, bracket.stops, strict=True)
        )

    def _check_camera(self, told: dict[str, Exif]) -> None:
        for name, exposure in told.items():
            self._camera = self._camera or exposure.camera
            if exposure.camera and exposure.camera != self._camera:
                raise ExposureError(
                    f"{self.name}: {name} is from {exposure.camera}, the others are from {self._camera}; let one camera"
                    " store into this folder"
                )

    def _check_stop(self) -> None:
        if self._stopped.is_set():
            raise StoppedError(f"{self.name}: stopped while waiting for files")


def _check_bracket(
    where: str, stops: Sequence[float], ascending: Sequence[str], lights: dict[str, float]
) -> None:
    asked = sorted(stops)
    came = [lights[name] - lights[ascending[0]] for name in ascending]
    if any(abs((stop - asked[0]) - light) > UNLIKE_EV for stop, light in zip(asked, came, strict=True)):
        steps = ", ".join(f"{name} {light:+.1f}" for name, light in zip(ascending, came, strict=True))
        wanted = ", ".join(f"{stop - asked[0]:+.1f}" for stop in asked)
        raise ExposureError(
            f"{where}: not the bracket that was asked for: {steps} EV where {wanted} EV were expected; set the camera's"
            " own bracketing to it and take this pose again"
        )


def _exposure(told: Exif) -> Exposure:
    return Exposure(told.shutter_s, None if told.iso is None else round(told.iso), told.aperture)


def _unopened(folder: Path, error: OSError) -> HardwareError:
    if error.errno in (errno.ENOENT, errno.ENOTDIR):
        return AbsentError(
            f"{folder}: there is no such folder; make it, and let the camera's program store into it"
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return AccessError(f"{folder}: no permission to read it; change its permissions")
    return _gone(folder, error)


def _gone(path: Path, error: OSError) -> HardwareError:
    return DisconnectedError(
        f"{path}: cannot be read any more ({error.strerror}); check the disk or the network share"
    )
