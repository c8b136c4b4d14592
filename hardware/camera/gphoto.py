"""Take brackets with a camera on a cable: set, release, wait for its files, download and check them.

Every wait has a deadline that no event puts off: some bodies report changed properties without end. Only files decide
whether an exposure was taken; nothing tells when some bodies are ready again, so what they refuse as busy is asked
again, ever more slowly and not for ever. Source: libgphoto2 2.5; `hardware.camera.body`, `hardware.camera.quirks`.
"""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from hardware.camera import body as gphoto_body
from hardware.camera import exif, transfer
from hardware.camera import quirks as camera_quirks
from hardware.camera import values as camera_values
from hardware.camera.body import Body, Kind, Refused, meaning
from hardware.camera.dial import Dial
from hardware.errors import (
    BatteryError,
    ExposureError,
    HardwareError,
    StoppedError,
    StoreFullError,
)
from hardware.interfaces import Bracket, Camera, CameraFeatures, CameraStatus, Frame, Taken

SLICE_S = 0.2  # of waiting for an event: how soon a stop is noticed
POLL_S = 0.01  # some drivers answer at once that nothing happened
STATUS_S = 0.4
STALE_S = 0.3  # at most, for events of before to be cleared away
LATE_S = 3.0  # for files of a bracket that was given up
CLOSE_S = 10.0  # longest wait for an order to end
MOST_EVENTS = 50  # of one moment: some bodies never stop talking
TRIES = 3  # of one download
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.05, 1.0  # between two tries while it is busy
MISMATCH_EV = 0.5  # between what was set and what the file says of itself


@dataclass(frozen=True, slots=True)
class GphotoConfig:
    """Which camera, and how it is used; `port` as libgphoto2 names it, None: the only one."""

    port: str | None = None
    to_card: bool = True  # else to the camera's memory: gone when it is switched off
    arrive_s: float = 15.0  # longest time from the end of an exposure to its file
    lowest_battery: float = 0.05


def open_camera(
    config: GphotoConfig,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Camera:
    """The camera that `config` names.

    Raises:
        AbsentError, BusyError, AccessError, SettingsError: as `gphoto_body.open_body`.
        HardwareError: it answers, but will not be used.
    """
    return GphotoCamera(lambda: gphoto_body.open_body(config.port), config, clock, sleep)


class GphotoCamera(Camera):
    """A camera on a cable; `opener` gives its body, again after a transfer that was broken off."""

    def __init__(
        self,
        opener: Callable[[], Body],
        config: GphotoConfig,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self._opener, self._config, self._clock, self._sleep = opener, config, clock, sleep
        self._using = threading.Lock()
        self._stopped = threading.Event()
        self._asker: threading.Thread | None = None
        self._closed = self._ordered = self._full = self._unsettled = False
        self._body: Body | None = opener()
        self._port, self._model = self._body.port, self._body.model
        self._quirks = camera_quirks.of(self._model)
        try:
            self._dial = Dial(self._body, self._quirks, self._patiently, sleep)
            self._dial.store(self._body, config.to_card)
            self._features = self._dial.features(self._model)
            self._status = self._looked(self._body)
        except BaseException as fault:
            with contextlib.suppress(Refused):
                self._body.close()
            if isinstance(fault, Refused):
                raise meaning(self.name, fault) from fault
            raise

    @property
    def name(self) -> str:
        return f"{self._model} ({self._port})"

    @property
    def features(self) -> CameraFeatures:
        return self._features

    def status(self) -> CameraStatus:
        """What a thread of its own finds out, if it does so in time: a silent camera blocks whoever asks it."""
        if self._closed:
            return CameraStatus(False, message="closed")
        if self._ordered:
            return CameraStatus(False, self._status.battery, self._status.free_shots, "busy with an order")
        if self._asker is None or not self._asker.is_alive():
            self._asker = threading.Thread(target=self._look, name="camera status", daemon=True)
            self._asker.start()
        self._asker.join(STATUS_S)
        if self._asker.is_alive():
            return CameraStatus(False, message="does not answer")
        return self._status

    def expose(self, bracket: Bracket) -> tuple[Taken, ...]:
        with self._order() as body:
            self._check_battery(body)
            own = self._dial.own_bracket(bracket)
            exposures = self._dial.plan(body, bracket)
            self._clear(body)
            try:
                if own is not None:
                    middle = exposures[bracket.stops.index(0.0)]
                    self._dial.turn(body, middle, own.changes)
                    paths = self._release(
                        body, len(own.order), sum(item.shutter_s or 0.0 for item in exposures)
                    )
                    by_stop = dict(zip(own.order, paths, strict=True))
                    paths = [by_stop[stop] for stop in bracket.stops]
                else:
                    paths = []
                    for exposure in exposures:
                        self._dial.turn(body, exposure, self._quirks.single)
                        paths += self._release(body, 1, exposure.shutter_s or 0.0)
            except Refused as fault:
                raise self._refusal(fault) from fault
            if len(set(paths)) < len(paths):
                raise ExposureError(
                    f"{self.name}: the camera names one file twice: {', '.join(sorted(paths))}"
                )
            self._full = False
            self._features = replace(self._features, suffix=PurePosixPath(paths[0]).suffix.lower())
            return tuple(
                Taken(path, stop, exposure)
                for path, stop, exposure in zip(paths, bracket.stops, exposures, strict=True)
            )

    def download(self, taken: Taken, to: Path) -> Frame:
        with self._order() as body:
            original = PurePosixPath(taken.handle).name
            for left in reversed(range(TRIES)):
                try:
                    arrived = self._fetched(body, taken, to)
                    break
                except (Refused, ExposureError) as fault:
                    error = meaning(self.name, fault) if isinstance(fault, Refused) else fault
                    if not isinstance(error, ExposureError) or not left:
                        raise error from fault
            else:
                raise AssertionError("the last try ends the loop or raises")
            self._check_exposure(taken, to)
            return Frame(to, original, arrived.sha256, arrived.bytes, taken)

    def forget(self, taken: Sequence[Taken]) -> None:
        if self._config.to_card:
            return
        with self._order() as body:
            for item in taken:
                # What cannot be deleted costs room, which the camera reports itself when it is needed.
                with contextlib.suppress(Refused):
                    self._patiently(lambda path=item.handle: body.delete(path))

    def stop(self) -> None:
        self._stopped.set()

    def close(self) -> None:
        self._closed = True
        self._stopped.set()
        if not self._using.acquire(timeout=CLOSE_S):
            return  # it hangs in the driver, where it cannot be taken away safely
        try:
            body, self._body = self._body, None
            if body is not None:
                self._dial.restore(body)
                with contextlib.suppress(Refused):
                    body.close()
        finally:
            self._using.release()

    @contextlib.contextmanager
    def _order(self) -> Iterator[Body]:
        """One order at a time, with a body that answers; what libgphoto2 refuses becomes what it means."""
        with self._using:
            if self._closed:
                raise HardwareError(f"{self.name}: was closed; open the camera again")
            self._stopped.clear()
            self._ordered = True
            try:
                if self._body is None:
                    self._body = self._opener()
                yield self._body
            except Refused as fault:
                raise meaning(self.name, fault) from fault
            finally:
                self._ordered = False

    def _patiently(self, ask: Callable[[], None]) -> None:
        """Ask again while the camera says that it is busy; pauses double up to a second.

        Raises:
            StoppedError: `stop` was called.
            Refused: it was busy for too long, or refused for another reason.
        """
        deadline, pause_s = self._clock() + self._quirks.busy_s, FIRST_PAUSE_S
        while True:
            try:
                return ask()
            except Refused as fault:
                if fault.code != gphoto_body.CAMERA_BUSY or self._clock() + pause_s > deadline:
                    raise
            self._check_stop()
            self._sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    def _release(self, body: Body, count: int, exposed_s: float) -> list[str]:
        """Release once and wait until `count` photographs are stored."""
        self._check_stop()
        self._patiently(body.trigger)
        self._unsettled = True
        # Some bodies take a dark frame as long as the exposure.
        deadline = self._clock() + 2 * exposed_s + self._config.arrive_s
        paths: list[str] = []
        while True:
            event = body.event(SLICE_S)
            if event.kind is Kind.FILE and event.path not in paths:
                paths.append(event.path)
                if len(_photographs(paths, self._dial.files)) == count:
                    return self._and_no_more(body, paths, count)
            elif event.kind is Kind.FULL:
                self._full, self._unsettled = True, False
                raise _full(self.name)
            self._check_stop()
            if self._clock() > deadline:
                raise ExposureError(
                    f"{self.name}: released, but {len(paths)} of {count * self._dial.files} files arrived in"
                    f" {self._config.arrive_s:g} s; look at the camera's screen, and set the lens to manual focus"
                )
            if event.kind is Kind.NOTHING:
                self._sleep(POLL_S)

    def _and_no_more(self, body: Body, paths: list[str], count: int) -> list[str]:
        """The photographs, if nothing else was told together with them."""
        for _ in range(MOST_EVENTS):
            event = body.event(0.0)
            if event.kind is Kind.NOTHING:
                break
            if event.kind is Kind.FILE and event.path not in paths:
                paths.append(event.path)
        found = _photographs(paths, 1)
        if len(found) != count:
            raise ExposureError(
                f"{self.name}: more files than exposures: {', '.join(found)}; is its drive mode single?"
            )
        self._unsettled = False
        return found

    def _clear(self, body: Body) -> None:
        """Let go of events of before: a file that came late is none of this bracket."""
        end = self._clock() + (LATE_S if self._unsettled else STALE_S)
        while self._clock() < end:
            if body.event(SLICE_S if self._unsettled else 0.0).kind is Kind.NOTHING:
                if not self._unsettled:
                    return
                self._sleep(POLL_S)
            self._check_stop()

    def _refusal(self, fault: Refused) -> HardwareError:
        """Once full, some bodies refuse without giving the reason again."""
        if fault.code in (gphoto_body.NO_MEMORY, gphoto_body.NO_SPACE) or (
            self._full and fault.code == gphoto_body.GENERAL
        ):
            self._full = True
            return _full(self.name)
        return meaning(self.name, fault)

    def _fetched(self, body: Body, taken: Taken, to: Path) -> transfer.Arrived:
        """One try at a download."""
        size, content = None, b""

        def ask() -> None:
            nonlocal size, content
            size, content = body.size(taken.handle), body.read(taken.handle, self._stopped.is_set)

        self._check_stop()
        try:
            self._patiently(ask)
        except Refused as fault:
            if fault.code == gphoto_body.CANCELLED:
                # The rest of the answer is still on the cable: the next one would be taken for it.
                self._body = None
                with contextlib.suppress(Refused):
                    body.close()
                raise StoppedError(f"{self.name}: stopped while {taken.handle} was downloaded") from fault
            raise
        return transfer.deliver([content], to, size)

    def _check_exposure(self, taken: Taken, to: Path) -> None:
        """The file's own account against what was set; a file without one is believed."""
        asked_s, told_s = taken.exposure.shutter_s, exif.read(to).shutter_s
        if asked_s and told_s and abs(math.log2(told_s / asked_s)) > MISMATCH_EV:
            to.unlink()
            raise ExposureError(
                f"{self.name}: {PurePosixPath(taken.handle).name} was exposed for {camera_values.told(told_s)} s, but"
                f" {camera_values.told(asked_s)} s were set: turn the mode dial to M, and the bracketing sequence to 0, -, +"
            )

    def _check_battery(self, body: Body) -> None:
        battery = self._dial.battery(body)
        if battery is not None and battery <= self._config.lowest_battery:
            raise BatteryError(f"{self.name}: its battery is at {100 * battery:.0f} %; charge or change it")

    def _check_stop(self) -> None:
        if self._stopped.is_set():
            raise StoppedError(f"{self.name}: stopped while waiting for the camera")

    def _look(self) -> None:
        if not self._using.acquire(timeout=STATUS_S / 2):
            return
        try:
            if self._body is not None:
                self._status = self._looked(self._body)
        except Refused as fault:
            self._status = CameraStatus(False, message=str(meaning(self.name, fault)))
        finally:
            self._using.release()

    def _looked(self, body: Body) -> CameraStatus:
        battery = self._dial.battery(body)
        if battery is not None and battery <= self._config.lowest_battery:
            return CameraStatus(False, battery, body.free_shots(), "battery low")
        if self._full:
            return CameraStatus(True, battery, 0, "no room left")
        return CameraStatus(True, battery, body.free_shots())


def _photographs(paths: Sequence[str], files: int) -> list[str]:
    """One path for each exposure whose files have all come: the RAW file where a JPEG lies beside it."""
    together: dict[str, list[str]] = {}
    for path in paths:
        together.setdefault(str(PurePosixPath(path).with_suffix("")), []).append(path)
    return [
        min(group, key=lambda path: PurePosixPath(path).suffix.lower() in exif.JPEG_SUFFIXES)
        for group in together.values()
        if len(group) >= files
    ]


def _full(name: str) -> StoreFullError:
    return StoreFullError(f"{name}: its card or memory is full; free some room or put in another card")
