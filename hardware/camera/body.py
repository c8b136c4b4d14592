"""A camera body on a cable, as libgphoto2 sees it: settings by name, release, events, files. The one file that knows it.

python-gphoto2 is an optional extra and imported when a body is asked for. Paths are a folder and a name joined by '/'.
What it refuses is raised as `Refused` with libgphoto2's own code; what that means is for the driver to say. Source:
libgphoto2 2.5 (gphoto2-result.h, gphoto2-port-result.h, gphoto2-camera.h), PTP (ISO 15740) event codes.
"""

import importlib
import locale
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from hardware.camera import usb_holder
from hardware.errors import (
    AbsentError,
    AccessError,
    BusyError,
    DisconnectedError,
    ExposureError,
    HardwareError,
    SettingsError,
    StoppedError,
)

GENERAL, BAD_NAME, NO_MEMORY, UNKNOWN_PORT, IO = -1, -2, -3, -5, -7
IO_INIT, IO_READ, IO_WRITE, USB_FIND, USB_CLAIM, IO_LOCK = -31, -34, -35, -52, -53, -60
UNKNOWN_MODEL, NO_FILE, CAMERA_BUSY, CANCELLED, NO_SPACE = -105, -108, -110, -112, -115

_STORE_FULL = "PTP Event 400a"  # ISO 15740: StoreFull; libgphoto2 passes it on as text


class Refused(Exception):
    """libgphoto2 said no."""

    def __init__(self, code: int, text: str):
        super().__init__(f"{text} ({code})")
        self.code = code


def meaning(name: str, fault: Refused) -> HardwareError:
    """What a refusal in use says to a person."""
    if fault.code in (IO, IO_INIT, IO_READ, IO_WRITE, USB_FIND, UNKNOWN_MODEL):
        return DisconnectedError(
            f"{name}: the connection is gone ({fault}); check cable, power and auto power off"
        )
    if fault.code == CANCELLED:
        return StoppedError(f"{name}: stopped")
    if fault.code == CAMERA_BUSY:
        return ExposureError(f"{name}: still busy; is it writing to a slow card, or showing a menu?")
    if fault.code == NO_FILE:
        return ExposureError(f"{name}: the photograph is no longer on the camera")
    return ExposureError(
        f"{name}: refused ({fault}); close its menus, set the lens to manual focus, look at its screen"
    )


class Kind(Enum):
    """What happened at the camera."""

    NOTHING = 1  # in the time given
    FILE = 2  # a photograph was stored; `path` names it
    FULL = 3  # there is no more room
    OTHER = 4


@dataclass(frozen=True, slots=True)
class Event:
    kind: Kind
    path: str = ""


@dataclass(frozen=True, slots=True)
class Setting:
    """One entry of the camera's configuration; no choices: it takes any text, or is only told."""

    value: str
    choices: tuple[str, ...] = ()
    readonly: bool = False


@dataclass(frozen=True, slots=True)
class Found:
    """A camera that answers."""

    model: str
    port: str


class Body(Protocol):
    """What the driver needs of a body; every method may raise `Refused`. One thread at a time."""

    model: str
    port: str

    def settings(self) -> Mapping[str, Setting]: ...
    def setting(self, name: str) -> Setting: ...
    def set(self, name: str, choice: str) -> None: ...
    def jpeg_only(self) -> bool: ...
    def free_shots(self) -> int | None: ...
    def trigger(self) -> None: ...
    def event(self, wait_s: float) -> Event: ...
    def size(self, path: str) -> int | None: ...
    def read(self, path: str, cancelled: Callable[[], bool]) -> bytes: ...
    def delete(self, path: str) -> None: ...
    def close(self) -> None: ...


def detect() -> tuple[Found, ...]:
    """Every camera that answers on USB.

    Raises:
        AbsentError: python-gphoto2 is not installed.
    """
    return _detected(_library())


def open_body(port: str | None = None) -> Body:
    """The camera on a port ('usb:001,005', 'ptpip:192.168.0.7'), or the only one.

    Raises:
        AbsentError: no camera answers there, or python-gphoto2 is not installed.
        SettingsError: several answer and none was named.
        BusyError, AccessError: somebody else holds it, or this user may not.
    """
    gp = _library()
    port = port or _only(_detected(gp)).port
    camera = gp.Camera()
    try:
        ports = gp.PortInfoList()
        ports.load()
        camera.set_port_info(ports[ports.lookup_path(port)])
        camera.init()
    except gp.GPhoto2Error as error:
        raise _unopened(gp, port, error.code, error.string) from error
    return Cabled(gp, camera, port)


class Cabled:
    """The real thing."""

    def __init__(self, gp: Any, camera: Any, port: str):
        self._gp, self._camera = gp, camera
        self.model, self.port = str(self._ask("get_abilities").model), port

    def settings(self) -> Mapping[str, Setting]:
        found: dict[str, Setting] = {}
        left = [self._ask("get_config")]
        while left:
            widget = left.pop()
            left += [widget.get_child(i) for i in range(widget.count_children())]
            if widget.get_type() not in (self._gp.GP_WIDGET_WINDOW, self._gp.GP_WIDGET_SECTION):
                found[widget.get_name()] = self._read(widget)
        return found

    def setting(self, name: str) -> Setting:
        return self._read(self._ask("get_single_config", name))

    def set(self, name: str, choice: str) -> None:
        widget = self._ask("get_single_config", name)
        widget.set_value(choice)
        self._ask("set_single_config", name, widget)

    def jpeg_only(self) -> bool:
        found = re.search(r"Capture Formats:(.*)", str(self._ask("get_summary")))
        return found is not None and found[1].split() == ["JPEG"]

    def free_shots(self) -> int | None:
        told = [
            store.freeimages
            for store in self._ask("get_storageinfo")
            if store.fields & self._gp.GP_STORAGEINFO_FREESPACEIMAGES
        ]
        return max(told, default=None)

    def trigger(self) -> None:
        self._ask("trigger_capture")

    def event(self, wait_s: float) -> Event:
        kind, data = self._ask("wait_for_event", int(1000 * wait_s))
        if kind == self._gp.GP_EVENT_FILE_ADDED:
            return Event(Kind.FILE, f"{data.folder.rstrip('/')}/{data.name}")
        if kind == self._gp.GP_EVENT_UNKNOWN and str(data).startswith(_STORE_FULL):
            return Event(Kind.FULL)
        return Event(Kind.NOTHING if kind == self._gp.GP_EVENT_TIMEOUT else Kind.OTHER)

    def size(self, path: str) -> int | None:
        file = self._ask("file_get_info", *_split(path)).file
        return file.size if file.fields & self._gp.GP_FILE_INFO_SIZE else None

    def read(self, path: str, cancelled: Callable[[], bool]) -> bytes:
        gp = self._gp

        def asked(context: Any, data: Any) -> int:
            return gp.GP_CONTEXT_FEEDBACK_CANCEL if cancelled() else gp.GP_CONTEXT_FEEDBACK_OK

        context = gp.Context()
        kept = context.set_cancel_func(asked, None)  # lasts as long as this object does
        try:
            file = self._ask("file_get", *_split(path), gp.GP_FILE_TYPE_NORMAL, None, context)
        finally:
            del kept
        return bytes(file.get_data_and_size())

    def delete(self, path: str) -> None:
        self._ask("file_delete", *_split(path))

    def close(self) -> None:
        """The body must not be asked anything afterwards: libgphoto2 would touch what it has freed."""
        self._ask("exit")

    def _ask(self, order: str, *arguments: Any) -> Any:
        try:
            return getattr(self._camera, order)(*arguments)
        except self._gp.GPhoto2Error as error:
            raise Refused(error.code, error.string) from error

    def _read(self, widget: Any) -> Setting:
        chosen = widget.get_type() in (self._gp.GP_WIDGET_RADIO, self._gp.GP_WIDGET_MENU)
        choices = tuple(widget.get_choices()) if chosen else ()
        return Setting(str(widget.get_value()), choices, bool(widget.get_readonly()))


def _library() -> Any:
    try:
        gp = importlib.import_module("gphoto2")
    except ImportError as error:
        raise AbsentError(
            f"cameras on a cable need python-gphoto2 ({error}): `pip install 'roomlight[camera]'`"
        ) from error
    # It translates the camera's own words once a program has asked for the desktop's language, as Qt does.
    locale.setlocale(locale.LC_MESSAGES, "C")
    return gp


def _detected(gp: Any) -> tuple[Found, ...]:
    found = gp.Camera.autodetect()
    return tuple(Found(found.get_name(i), found.get_value(i)) for i in range(found.count()))


def _only(found: tuple[Found, ...]) -> Found:
    if not found:
        raise AbsentError(
            "no camera answers on USB: switch it on, check the cable, and set its USB mode to PTP or remote control"
        )
    first, *others = found
    if others:
        listed = ", ".join(f"gphoto2:{one.port} ({one.model})" for one in found)
        raise SettingsError(f"{len(found)} cameras answer; name one of {listed}")
    return first


def _unopened(gp: Any, port: str, code: int, text: str) -> HardwareError:
    if code in (USB_CLAIM, IO_LOCK):
        return BusyError(f"{port}: {usb_holder.in_use(port)}")
    path = usb_holder.device(port)
    if path is not None and path.exists() and not os.access(path, os.W_OK):
        return AccessError(
            f"{port}: no permission for {path}; install libgphoto2's udev rules (Debian: `sudo apt install"
            " libgphoto2-6`) and plug the camera in again"
        )
    if code in (UNKNOWN_MODEL, USB_FIND, UNKNOWN_PORT, BAD_NAME, NO_FILE) or (
        path is not None and not path.exists()
    ):
        there = ", ".join(f"{one.port} ({one.model})" for one in _detected(gp)) or "no camera"
        return AbsentError(f"{port}: no camera answers there ({text}); what does: {there}")
    return HardwareError(f"{port}: the camera does not answer ({text}); switch it off and on again")


def _split(path: str) -> tuple[str, str]:
    folder, _, name = path.rpartition("/")
    return folder or "/", name
