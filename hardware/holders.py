"""Who has a device open. Source: proc(5), `/proc/PID/fd`; what belongs to other users stays hidden from us."""

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

PROC = Path("/proc")


@dataclass(frozen=True, slots=True)
class Holder:
    """A process with the device open."""

    process: int
    name: str

    @property
    def ourselves(self) -> bool:
        return self.process == os.getpid()

    def __str__(self) -> str:
        return "this program itself" if self.ourselves else f"{self.name} (process {self.process})"


def holders(device: Path, proc: Path = PROC) -> tuple[Holder, ...]:
    """Every process we can see that has the file of a device open."""
    target, found = os.path.realpath(device), []
    for folder in sorted(proc.glob("[0-9]*"), key=lambda folder: int(folder.name)):
        # Processes end while we look, and those of others may not be looked into.
        with contextlib.suppress(OSError):
            if any(_leads_to(link, target) for link in (folder / "fd").iterdir()):
                found.append(Holder(int(folder.name), _name(folder)))
    return tuple(found)


def _leads_to(link: Path, target: str) -> bool:
    with contextlib.suppress(OSError):
        return os.readlink(link) == target
    return False


def _name(folder: Path) -> str:
    """The program's name; `comm` holds only 15 letters of it."""
    first = (folder / "cmdline").read_bytes().split(b"\0")[0].decode(errors="replace")
    return Path(first).name or (folder / "comm").read_text().strip()
