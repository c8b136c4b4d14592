"""A desk in this process: commands go in as its child would hear them, events come out, and what the page would show."""

import json
import os
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from app.capture.desk.serving import Desk
from app.capture.panel_state import PanelState, heard
from app.work.worker import Link
from hardware.rig import Rig
from tests.app.capture import quick_devices
from tests.app.capture.captures import HASTY

PATIENCE_S = 60.0  # generous: the machine may be busy


class Bench:
    """As a context: the desk serves meanwhile."""

    def __init__(self, folder: Path, opening: Callable[..., Rig] | None = None) -> None:
        """
        Args:
            folder: for the desk's pictures.
            opening: as `find.open_rig`; quick devices if None.
        """
        self.rigs: list[Rig] = []  # as they were opened

        def opened(rig: str, camera: str, **options: Any) -> Rig:
            self.rigs.append(quick_devices.rig() if opening is None else opening(rig, camera, **options))
            return self.rigs[-1]

        source, self._out = os.pipe()
        self.link = Link(self._out)
        self.events: list[Mapping[str, Any]] = []
        self.states = [PanelState()]
        self._changed = threading.Condition()
        folder.mkdir(parents=True, exist_ok=True)
        self._desk = Desk(self.link, folder, opened, HASTY)
        self._reader = threading.Thread(target=self._read, args=[source], daemon=True)
        self._server = threading.Thread(target=self._desk.serve, daemon=True)

    def __enter__(self) -> "Bench":
        self._reader.start()
        self._server.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.send("cancel")
        self._server.join(PATIENCE_S)
        assert not self._server.is_alive()
        os.close(self._out)
        self._reader.join(PATIENCE_S)

    @property
    def state(self) -> PanelState:
        return self.states[-1]

    def send(self, command: str, **facts: Any) -> None:
        self.link.take(json.dumps({"command": command, **facts}).encode())

    def order(self, command: str, **facts: Any) -> PanelState:
        """Send an order and wait until it is over."""
        overs = self._overs()
        self.send(command, **facts)
        self.until(lambda _: self._overs() > overs)
        return self.state

    def until(self, met: Callable[[PanelState], object]) -> PanelState:
        """The first state from now on that meets this."""
        deadline = time.monotonic() + PATIENCE_S
        with self._changed:
            at = len(self.states) - 1
            while not met(self.states[at]):
                at += 1
                while at == len(self.states):
                    assert self._changed.wait(deadline - time.monotonic()), self.state
            return self.states[at]

    def told(self, kind: str) -> list[Mapping[str, Any]]:
        """Every event of a kind."""
        return [event for event in self.events if event.get("kind") == kind]

    def _overs(self) -> int:
        return sum(event["command"] == "" for event in self.told("order"))

    def _read(self, source: int) -> None:
        with os.fdopen(source, "rb") as lines:
            for line in lines:
                event = json.loads(line)
                with self._changed:
                    self.events.append(event)
                    self.states.append(heard(self.state, event))
                    self._changed.notify_all()


def start(session: Path, poses: int = 4, **facts: Any) -> dict[str, Any]:
    """What `start` says besides its name."""
    wanted = {
        "session": str(session), "plan": {"kind": "gimbal", "poses": poses}, "bracket": [-3, 0, 3],
        "shutter": 0.02, "iso": None, "aperture": None, "settle": None, "helpful_first": False, "any_format": False,
    }  # fmt: skip
    return {**wanted, **facts}


def resume(session: Path, **facts: Any) -> dict[str, Any]:
    return {"session": str(session), "helpful_first": False, "at_zero": False, **facts}
