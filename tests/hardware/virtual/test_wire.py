"""A wire that was pulled and is closed after that touches no file that took over its number."""

import os
from pathlib import Path

from hardware.virtual.wire import Wire


class Mute:
    """Firmware that says nothing."""

    def receive(self, data: bytes, now: float) -> None:
        pass

    def advance(self, now: float) -> bytes:
        return b""


def test_closing_a_pulled_wire_leaves_files_that_were_opened_since(tmp_path: Path) -> None:
    wire = Wire(Mute())
    wire.pull()
    with (tmp_path / "a").open("wb") as one, (tmp_path / "b").open("wb") as other:
        wire.close()
        for file in (one, other):
            os.fsync(file.fileno())
