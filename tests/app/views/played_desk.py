"""A desk without a child: keeps the commands it was given, and says what a test lets it say."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.capture.panel import Panel
from app.work.jobs import Job, JobState, JobStatus

RIG = {
    "name": "virtual rig",
    "axes": [
        {"name": "pan", "lowest_deg": None, "highest_deg": None, "fastest_deg_s": 90.0},
        {"name": "tilt", "lowest_deg": -80.0, "highest_deg": 80.0, "fastest_deg_s": 60.0},
    ],
    "automatic": True, "homes": True, "holds": True, "reports_angles": True,
}  # fmt: skip
CAMERA = {
    "name": "virtual camera", "model": "Virtual", "shutters_s": [0.001, 0.01, 0.1, 1.0], "isos": [100, 400],
    "apertures": [8.0], "sets_exposure": True, "suffix": ".dng",
}  # fmt: skip


class PlayedJob(Job):
    """Starts nothing."""

    def __init__(self) -> None:
        super().__init__("capture", "desk", {})
        self.sent: list[tuple[str, Mapping[str, Any]]] = []

    def start(self) -> None:
        self._become(JobState.RUNNING)

    def send(self, command: str, **facts: Any) -> None:
        self.sent.append((command, facts))

    def cancel(self) -> None:
        self.sent.append(("cancel", {}))

    def kill(self) -> None:
        self._become(JobState.CANCELLED)

    def emit(self, event: str, **facts: Any) -> None:
        for listener in tuple(self._event_listeners):
            listener({"event": event, **facts})

    def die(self, message: str) -> None:
        self._become(JobState.FAILED, message=message)

    def _become(self, state: JobState, **facts: Any) -> None:
        if self._status.state is state:
            return
        self._status: JobStatus = replace(self._status, state=state, **facts)
        for listener in tuple(self._listeners):
            listener(self._status)


class PlayedDesk:
    """The job and the panel over it; `say` plays an event of the desk."""

    def __init__(self) -> None:
        self.job = PlayedJob()
        self.panel = Panel(lambda: self.job)

    @property
    def commands(self) -> list[str]:
        return [command for command, _ in self.job.sent]

    def last(self, command: str) -> Mapping[str, Any]:
        """The facts of the latest such command."""
        return next(facts for sent, facts in reversed(self.job.sent) if sent == command)

    def say(self, kind: str, **facts: Any) -> None:
        self.job.emit("data", kind=kind, **facts)

    def open(self, **rig: Any) -> None:
        self.say("order", command="open")
        self.say("opened", rig={**RIG, **rig}, camera=CAMERA)
        self.say("order", command="")
        self.say("where", state="idle", pan=0.0, tilt=0.0, message="")

    def plan(
        self, poses: int, warnings: tuple[str, ...] = (), place: Callable[[int], Any] | None = None
    ) -> None:
        told = [
            {"name": f"pose{i:04d}", "pan": (i * 47.0) % 360, "tilt": -60.0 + 120.0 * i / max(poses - 1, 1)}
            for i in range(poses)
        ]
        self.say("planned", poses=told, warnings=list(warnings))

    def begin(self, session: Path, command: str = "start") -> None:
        self.say("order", command=command, session=str(session))

    def status(self, phase: str, pose: int | None, taken: int, total: int, **facts: Any) -> None:
        name = None if pose is None else f"pose{pose:04d}"
        rest = {"pan": 0.0, "tilt": 0.0, "left_s": 90.0, "message": "", "missing": [], "paused": False}
        self.say("status", phase=phase, pose=name, taken=taken, total=total, **{**rest, **facts})

    def end(self, session: Path, taken: int, total: int, **facts: Any) -> None:
        rest = {"cancelled": False, "missing": [], "trouble": ""}
        self.say("ended", session=str(session), taken=taken, total=total, **{**rest, **facts})
        self.say("order", command="")
