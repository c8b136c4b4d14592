"""Who holds a camera on USB, and how to make them let go: nearly always the desktop's own photo importer.

Source: usbfs (`/dev/bus/usb/BBB/DDD`).
"""

import re
from pathlib import Path

from hardware.holders import PROC, Holder, holders

BUS = Path("/dev/bus/usb")

# First part of the program's name: what makes it let go.
_REMEDY = (
    ("gvfs", "eject the camera in the file manager, or run `gio mount -s gphoto2`"),
    ("kiod", "eject the camera in the file manager"),
    ("kioslave", "eject the camera in the file manager"),
)


def device(port: str, bus: Path = BUS) -> Path | None:
    """The device file of a port as libgphoto2 names it ('usb:001,005'); None for ports that name none."""
    found = re.fullmatch(r"usb:(\d+),(\d+)", port)
    return bus / f"{int(found[1]):03d}" / f"{int(found[2]):03d}" if found else None


def in_use(port: str, proc: Path = PROC, bus: Path = BUS) -> str:
    """'in use by NAME (process 12): REMEDY', as far as we can see."""
    path = device(port, bus)
    found = holders(path, proc) if path else ()
    if not found:
        look = f"`sudo fuser -v {path}` names it" if path else "close what imports photographs"
        return f"in use by a program that is hidden from us: {look}"
    return f"in use by {' and '.join(map(str, found))}: {_remedy(found[0])}"


def _remedy(holder: Holder) -> str:
    if holder.ourselves:
        return "it has the camera open already"
    return next((cure for begin, cure in _REMEDY if holder.name.startswith(begin)), "close that program")
