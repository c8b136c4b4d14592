"""Who holds a USB device, and how to make them let go: nearly always the desktop's own photo importer.

Source: usbfs (`/dev/bus/usb/BBB/DDD`) and proc(5), `/proc/PID/fd`. What belongs to other users stays hidden from us.
"""

import contextlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")
BUS = Path("/dev/bus/usb")

# First part of the program's name: what makes it let go.
_REMEDY = (
    ("gvfs", "eject the camera in the file manager, or run `gio mount -s gphoto2`"),
    ("kiod", "eject the camera in the file manager"),
    ("kioslave", "eject the camera in the file manager"),
)


@dataclass(frozen=True, slots=True)
class Holder:
    """A process with the device open."""

    process: int
    name: str

    def __str__(self) -> str:
        if self.process == os.getpid():
            return "this program itself"
        return f"{self.name} (process {self.process})"

    @property
    def remedy(self) -> str:
        if self.process == os.getpid():
            return "it has the camera open already"
        return next((cure for begin, cure in _REMEDY if self.name.startswith(begin)), "close that program")


def device(port: str, bus: Path = BUS) -> Path | None:
    """The device file of a port as libgphoto2 names it ('usb:001,005'); None for ports that name none."""
    found = re.fullmatch(r"usb:(\d+),(\d+)", port)
    return bus / f"{int(found[1]):03d}" / f"{int(found[2]):03d}" if found else None


def holders(port: str, proc: Path = PROC, bus: Path = BUS) -> tuple[Holder, ...]:
    """Every process we can see that has the device of `port` open."""
    path = device(port, bus)
    if path is None:
        return ()
    target, found = os.path.realpath(path), []
    for folder in sorted(proc.glob("[0-9]*"), key=lambda folder: int(folder.name)):
        # Processes end while we look, and those of others may not be looked into.
        with contextlib.suppress(OSError):
            if any(_leads_to(link, target) for link in (folder / "fd").iterdir()):
                found.append(Holder(int(folder.name), _name(folder)))
    return tuple(found)


def in_use(port: str, proc: Path = PROC, bus: Path = BUS) -> str:
    """'in use by NAME (process 12): REMEDY', as far as we can see."""
    found = holders(port, proc, bus)
    if not found:
        path = device(port, bus)
        look = f"`sudo fuser -v {path}` names it" if path else "close what imports photographs"
        return f"in use by a program that is hidden from us: {look}"
    return f"in use by {' and '.join(map(str, found))}: {found[0].remedy}"


def _leads_to(link: Path, target: str) -> bool:
    with contextlib.suppress(OSError):
        return os.readlink(link) == target
    return False


def _name(folder: Path) -> str:
    """The program's name; `comm` holds only 15 letters of it."""
    first = (folder / "cmdline").read_bytes().split(b"\0")[0].decode(errors="replace")
    return Path(first).name or (folder / "comm").read_text().strip()
