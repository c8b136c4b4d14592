"""The capture desk from the window's side: what the page shows, and the child that holds rig and camera.

Without Qt. The child is started by the first command, and again by the next one after it ended.
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.capture.panel_state import CAPTURES, PanelState, asked, heard, lost
from app.state import trouble
from app.work.jobs import Event, Job, JobState, JobStatus

__all__ = ["CAPTURES", "Panel", "PanelState", "heard", "lost"]

# Closing after the exposure under way; whatever it takes longer, the session resumes.
PATIENCE_S = 30.0


def desk() -> Job:
    """A child that holds the devices."""
    return Job("capture", "desk", {}, patience_s=PATIENCE_S)


class Panel:
    """Sends commands and keeps the state; every method may be called from any thread and returns at once.

    What a command leads to arrives as a state; what it cannot do, as `PanelState.told`.
    """

    def __init__(self, make: Callable[[], Job] = desk) -> None:
        self._make = make
        self._state = PanelState()
        self._job: Job | None = None
        self._shut = False
        # Held while listeners are told, so that they hear states in order; a job never holds its own lock then.
        self._lock = threading.RLock()
        self._listeners: list[Callable[[PanelState], None]] = []

    @property
    def state(self) -> PanelState:
        return self._state

    @property
    def job(self) -> Job | None:
        """The child, for details and to wait for its end; None before the first command."""
        return self._job

    def listen(self, listener: Callable[[PanelState], None]) -> Callable[[], None]:
        """Tell `listener` of every later state, in reader threads; it must return soon. Returns what ends that."""
        self._listeners.append(listener)

        def leave() -> None:
            if listener in self._listeners:
                self._listeners.remove(listener)

        return leave

    # ---- commands

    def look(self) -> None:
        """See what is plugged in."""
        self._send("list")

    def open(self, rig: str, camera: str) -> None:
        """Device URLs; what was open is closed first."""
        self._send("open", rig=rig, camera=camera)

    def close(self) -> None:
        """Let go of rig and camera."""
        self._send("close")

    def home(self) -> None:
        self._send("home")

    def move(self, pan_deg: float, tilt_deg: float) -> None:
        self._send("move", pan=pan_deg, tilt=tilt_deg)

    def jog(self, pan_deg: float, tilt_deg: float) -> None:
        """So far from where it stands."""
        self._send("jog", pan=pan_deg, tilt=tilt_deg)

    def stop(self) -> None:
        """Rig and camera, at once; a capture ends."""
        self._ask("stop")

    def preview(
        self, shutter_s: float | None = None, iso: int | None = None, aperture: float | None = None
    ) -> None:
        """One photograph that is not kept; None: as the camera has it."""
        self._send("preview", shutter=shutter_s, iso=iso, aperture=aperture)

    def plan(self, plan: Mapping[str, Any]) -> None:
        """What a capture of it would look like; `plan` as the desk's docstring has it."""
        self._send("plan", plan=dict(plan))

    def start(
        self,
        session: Path,
        plan: Mapping[str, Any],
        bracket: Sequence[float],
        shutter_s: float | None = None,
        iso: int | None = None,
        aperture: float | None = None,
        settle_s: float | None = None,
        helpful_first: bool = False,
        any_format: bool = False,
    ) -> None:
        """A new capture with the devices that are open; `bracket` in EV, None as camera and rig have it."""
        self._send(
            "start", session=str(session), plan=dict(plan), bracket=list(bracket), shutter=shutter_s, iso=iso,
            aperture=aperture, settle=settle_s, helpful_first=helpful_first, any_format=any_format,
        )  # fmt: skip

    def resume(self, session: Path, helpful_first: bool = False, at_zero: bool = False) -> None:
        """Go on with a capture, with the devices that are open or else with its own.

        Args:
            at_zero: a person turned a rig that cannot find its zero there.
        """
        self._send("resume", session=str(session), helpful_first=helpful_first, at_zero=at_zero)

    def pause(self) -> None:
        """Before the next pose; a rig that moves and can hold does so now."""
        self._ask("pause")

    def go_on(self) -> None:
        """After `pause`, or after a finding that paused the capture."""
        self._ask("go_on")

    def end(self) -> None:
        """End the capture after the exposure under way."""
        self._ask("end")

    def answer(self) -> None:
        """What `PanelState.ask` asked is done."""
        self._send("answer")

    def shut(self) -> None:
        """For ever: the child ends a capture under way after its exposure, closes the devices and goes."""
        with self._lock:
            self._shut = True
            job = self._job
        if job is not None:
            job.cancel()

    # ---- the child

    def _ask(self, command: str) -> None:
        """Of the order under way; seen at once, however long the desk takes to answer."""
        self._send(command)
        with self._lock:
            self._change(asked(self._state, command))

    def _send(self, command: str, **facts: Any) -> None:
        with self._lock:
            if self._shut:
                return
            job = self._job
            fresh = job is None or job.status.ended
            if fresh:
                if command in ("stop", "pause", "go_on", "end", "answer", "close"):
                    return  # nothing is open that could hear it
                job = self._job = self._make()
                job.listen_events(self._hear)
                job.listen(self._heard_of(job))
        assert job is not None
        if fresh:
            job.start()
        job.send(command, **facts)

    def _hear(self, event: Event) -> None:
        with self._lock:
            self._change(heard(self._state, event))

    def _heard_of(self, job: Job) -> Callable[[JobStatus], None]:
        def hear(status: JobStatus) -> None:
            with self._lock:
                if job is not self._job:
                    return
                if status.ended:
                    failed = status.state is JobState.FAILED
                    told = trouble(status.message, status.details) if failed else None
                    self._change(lost(self._state, told))
                elif not self._state.alive:
                    self._change(replace(self._state, alive=True))

        return hear

    def _change(self, state: PanelState) -> None:
        """Under the lock."""
        if state == self._state:
            return
        self._state = state
        for listener in tuple(self._listeners):
            listener(state)
