"""The desk from the window's side: events become facts, and a child that dies leaves a session that resumes."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.capture import order as orders
from app.capture.panel import Panel, PanelState, heard, lost
from app.capture.panel_state import AxisFacts, Going, Missed
from app.capture.run import Capture
from app.capture.status import Phase
from app.state import Trouble
from engine.capture_checks.finding import Severity
from engine.io import session as sessions
from hardware import find
from hardware.interfaces import State
from tests.app.calls import ROOT
from tests.app.work.children import job

PATIENCE_S = 60.0


def after(*events: dict[str, Any], state: PanelState | None = None) -> PanelState:
    state = state or PanelState()
    for event in events:
        state = heard(state, event)
    return state


def data(kind: str, **facts: Any) -> dict[str, Any]:
    return {"event": "data", "kind": kind, **facts}


RIG = {
    "name": "a rig", "axes": [{"name": "pan", "lowest_deg": None, "highest_deg": None, "fastest_deg_s": 60.0}],
    "automatic": True, "homes": True, "holds": False, "reports_angles": True,
}  # fmt: skip
CAMERA = {
    "name": "a camera", "model": "R8", "shutters_s": [0.01, 0.02], "isos": [100], "apertures": [],
    "sets_exposure": True, "suffix": ".cr3",
}  # fmt: skip
STARTED = data("order", command="start", session="/s")
STATUS = data(
    "status", phase="moving", pose="pose0003", pan=90.0, tilt=-10.0, taken=2, total=9, left_s=40.0, message="",
    missing=[{"pose": "pose0001", "reason": "it would not focus"}], paused=False,
)  # fmt: skip


def test_what_is_open_is_known_until_it_is_closed() -> None:
    state = after(data("opened", rig=RIG, camera=CAMERA))
    assert state.open
    assert state.rig is not None
    assert state.rig.axes == (AxisFacts("pan", None, None, 60.0),)
    assert state.camera is not None
    assert state.camera.shutters_s == (0.01, 0.02)
    state = after(
        data("where", state="moving", pan=1.5, tilt=None, message=""),
        data("camera", ready=True, battery=0.5, free_shots=None, message=""),
        state=state,
    )
    assert (state.where.state, state.where.pan_deg, state.where.tilt_deg) == (State.MOVING, 1.5, None)
    assert state.camera_now is not None
    assert state.camera_now.battery == 0.5
    state = after(data("closed"), state=state)
    assert not state.open
    assert state.camera_now is None


def test_a_capture_begins_with_a_clean_slate_and_its_end_stays() -> None:
    finding = data("finding", pose="pose0002", text="blurred", severity="warning")
    coverage = data("coverage", png="/c.png", share=0.5, share_unclipped=0.4, next="turn")
    ended = data(
        "ended", session="/s", taken=9, total=9, cancelled=False, missing=[], trouble="it hangs; pull it out"
    )
    state = after(STARTED, STATUS, finding, coverage, ended, data("order", command="", session=""))
    assert not state.capturing
    assert state.ended is not None
    assert state.ended.trouble == Trouble("it hangs", "pull it out")
    assert state.findings[0].severity is Severity.WARNING
    assert state.coverage is not None
    assert state.going is not None
    assert state.going.missing == (Missed("pose0001", "it would not focus"),)
    again = after(data("order", command="resume", session="/t"), state=state)
    assert again.capturing
    assert (again.session, again.going) == (Path("/t"), Going())
    assert (again.findings, again.coverage, again.ended) == ((), None, None)


def test_pausing_is_shown_as_soon_as_it_is_asked_for() -> None:
    state = after(STARTED, {**STATUS, "paused": True})
    assert state.paused
    assert state.going is not None
    assert state.going.phase is Phase.MOVING


def test_a_room_that_is_baked_is_shown_while_it_lasts() -> None:
    baking = {"event": "progress", "fraction": 0.3, "note": "baking the light"}
    preview = data("order", command="preview", session="")
    assert after(preview, baking).working == (0.3, "baking the light")
    assert after(preview, baking, {"event": "progress", "fraction": 1.0}).working is None
    stopped = data("order", command="", session="")
    assert after(preview, baking, stopped, baking).working is None
    assert after(STARTED, baking, {**STATUS, "phase": "exposing"}).working is not None
    assert after(STARTED, baking, {**STATUS, "phase": "downloading"}).working is None


def test_a_trouble_told_twice_is_seen_twice() -> None:
    trouble = data("trouble", command="jog", text="beyond 80; change the plan")
    once, twice = after(trouble), after(trouble, trouble)
    assert once.told is not None
    assert once.told.trouble == Trouble("beyond 80", "change the plan")
    assert twice.told != once.told


def test_what_is_not_known_changes_nothing() -> None:
    state = after(STARTED, STATUS)
    assert after(data("poem"), {"event": "log", "text": "hm"}, {"event": "stage"}, state=state) is state


def test_a_desk_that_is_lost_in_a_capture_leaves_one_to_resume() -> None:
    state = lost(after(data("opened", rig=RIG, camera=CAMERA), STARTED, STATUS), Trouble("it crashed"))
    assert not state.open
    assert not state.capturing
    assert state.ended is not None
    assert (state.ended.session, state.ended.taken, state.ended.total) == (Path("/s"), 2, 9)
    assert state.ended.trouble == Trouble("it crashed")
    assert state.told is not None
    calm = lost(after(data("opened", rig=RIG, camera=CAMERA)), None)
    assert calm.ended is None
    assert calm.told is None


# ---- the panel with a child


class Watched:
    """A panel and every state of it."""

    def __init__(self, panel: Panel) -> None:
        self.panel = panel
        self._changed = threading.Condition()
        self.states: list[PanelState] = []
        panel.listen(self._hear)

    def _hear(self, state: PanelState) -> None:
        with self._changed:
            self.states.append(state)
            self._changed.notify_all()

    def until(self, met: Callable[[PanelState], object]) -> PanelState:
        deadline = time.monotonic() + PATIENCE_S
        with self._changed:
            while not met(self.panel.state):
                assert self._changed.wait(deadline - time.monotonic()), self.panel.state
            return self.panel.state


ECHO = """
while True:
    said = hear()
    if said is None or said["command"] == "cancel":
        emit("cancelled"); break
    if said["command"] == "move":
        os.kill(os.getpid(), signal.SIGKILL)
    emit("data", kind="trouble", command=said["command"], text="heard")
"""


def test_a_child_is_started_by_the_first_command_and_again_after_it_died() -> None:
    watched = Watched(Panel(lambda: job(ECHO)))
    panel = watched.panel
    panel.stop()  # nobody is there to hear it, and nobody is started for it
    assert panel.job is None
    panel.look()
    told = watched.until(lambda state: state.told).told
    assert told is not None
    assert told.command == "list"
    assert panel.state.alive
    first = panel.job
    panel.move(1.0, 2.0)
    state = watched.until(lambda state: not state.alive)
    assert state.told is not None
    assert "killed" in state.told.trouble.what
    panel.home()
    watched.until(lambda state: state.told is not None and state.told.command == "home")
    assert panel.job is not first
    panel.shut()
    state = watched.until(lambda state: not state.alive)
    panel.home()
    assert panel.job is not None
    assert panel.job.wait(PATIENCE_S).ended


def resumed(session: Path) -> list[str]:
    """Finish a capture as `roomlight capture --resume --rig` does, at ten times the speed; the poses that are there then."""
    order = orders.read(session)
    rig = order.rig.replace("speed=20", "speed=200")
    outcome = Capture(session, order, lambda: find.open_rig(rig, order.camera), resumed=True).run()
    assert outcome.missing == ()
    shots = sessions.shots(sessions.open_session(session))
    for shot in shots:
        sessions.verify(shot)
    return [shot.name for shot in shots]


POSES = 6
SLOW = "virtual:grbl?speed=20&kind=turntable"  # a second for each pose


def begun(watched: Watched, session: Path) -> PanelState:
    watched.panel.open(SLOW, "virtual:?size=64x48")
    watched.until(lambda state: state.open and not state.order)
    watched.panel.start(session, {"kind": "turntable", "poses": POSES}, (0,), any_format=True)
    return watched.until(lambda state: state.going is not None and state.going.taken)


def test_a_desk_that_is_killed_in_a_capture_leaves_every_finished_shot(tmp_path: Path) -> None:
    watched = Watched(Panel())
    session = tmp_path / "a"
    begun(watched, session)
    assert watched.panel.job is not None
    watched.panel.job.kill()
    state = watched.until(lambda state: not state.alive)
    assert state.ended is not None
    assert state.ended.trouble is not None
    assert state.ended.session == session
    assert resumed(session) == [f"pose{index:04d}" for index in range(POSES)]


PARENT = f"""
import sys, time
from pathlib import Path
from tests.app.capture.test_panel import Watched, begun
from app.capture.panel import Panel
watched = Watched(Panel())
begun(watched, Path(sys.argv[1]))
print(watched.panel.job._child.pid, flush=True)
time.sleep({PATIENCE_S})
"""


def test_a_window_that_is_killed_in_a_capture_takes_its_desk_along_and_the_session_resumes(
    tmp_path: Path,
) -> None:
    session = tmp_path / "a"
    window = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(session)], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert window.stdout is not None
    desk = int(window.stdout.readline())
    window.kill()
    window.wait()
    deadline = time.monotonic() + PATIENCE_S
    while alive(desk):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    kept = len(sessions.shots(sessions.open_session(session)))
    assert 1 <= kept < POSES
    assert resumed(session) == [f"pose{index:04d}" for index in range(POSES)]


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except (ProcessLookupError, FileNotFoundError):
        return False
