"""A capture becomes a session that processing takes, and does at any moment what it is asked."""

import contextlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from app.capture import journal as capture_journal
from app.capture.order import CaptureError, Order, kind_of, poses_of, read
from app.capture.run import Capture
from app.capture.status import Finding, Outcome, Phase, Status
from engine.errors import ImportFault, SessionError
from engine.hdr import merge
from engine.hdr.params import HdrParams
from engine.importing import find_photographs
from engine.io import session as sessions
from engine.io.raw import Bracket
from engine.io.session import Shot
from engine.progress import Progress
from hardware import plan
from hardware.interfaces import Angles, Exposure, Geometry
from hardware.manual import Handheld
from hardware.rig import Rig
from tests.app.capture import quick_devices
from tests.app.capture.captures import HASTY, faults_of, order

WAIT_S = 20.0


def run(folder: Path, wanted: Order, rig: Rig | None = None, resumed: bool = False, **options) -> Outcome:
    made = rig or quick_devices.rig()
    return Capture(folder, wanted, lambda: made, resumed, patience=HASTY, **options).run()


def events(folder: Path, kind: str) -> list[dict]:
    journal = capture_journal.read(folder / "capture" / "journal.jsonl")
    return [event for event in journal if event["event"] == kind]


class InThread:
    """A capture in a thread of its own, as a window runs it, and what its listener heard."""

    def __init__(self, folder: Path, wanted: Order, rig: Rig, **options):
        self.heard: list[Status] = []
        self.capture = Capture(
            folder, wanted, lambda: rig, listener=self.heard.append, patience=HASTY, **options
        )
        self.control = self.capture.control
        self.result: Outcome | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self.result = self.capture.run()

    def until(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + WAIT_S
        while not condition():
            assert time.monotonic() < deadline, self.capture.status
            time.sleep(0.002)

    def end(self) -> Outcome:
        self._thread.join(WAIT_S)
        assert self.result is not None, self.capture.status
        return self.result


def test_every_pose_is_a_shot_of_its_name_with_ascending_exposures(tmp_path: Path) -> None:
    wanted = order(12, stops=(0.0, 3.0, -3.0))
    rig = quick_devices.rig()
    outcome = run(tmp_path / "a", wanted, rig)
    assert (outcome.taken, outcome.total, outcome.missing, outcome.cancelled) == (12, 12, (), False)
    assert faults_of(tmp_path / "a", wanted) == []
    shot = sessions.shots(sessions.open_session(tmp_path / "a"))[7]
    assert [file.name for file in shot.files] == [
        "pose0007_ev-3_IMG_0024.DNG", "pose0007_ev0_IMG_0022.DNG", "pose0007_ev+3_IMG_0023.DNG",
    ]  # fmt: skip
    assert shot.exposures[0]["source"] == "IMG_0024.DNG"
    assert shot.exposures[0]["shutter_s"] == pytest.approx(0.0025)
    assert shot.rig is not None
    assert shot.rig["kind"] == "gimbal"
    assert len(rig.camera.forgotten) == 36


def test_processing_takes_a_captured_session_as_an_imported_one(tmp_path: Path) -> None:
    wanted = order(8)
    geometry = Geometry((0, -1, 0), (0, 0, 0.25), (1, 0, 0), (0, 0, 0.26))
    run(tmp_path / "a", replace(wanted, geometry=geometry))
    session = sessions.open_session(tmp_path / "a")
    assert session.kind == "raw"
    assert session.facts["camera"] == {"model": "Roomlight Virtual One", "width": 32, "height": 32}
    assert session.facts["rig"]["kind"] == "gimbal"
    assert session.facts["rig"]["geometry"]["pan_axis"] == [0, -1, 0]
    shot = sessions.shots(session)[0]
    frames, report = merge.merge([Bracket(shot.name, shot.files)], HdrParams(), Progress())
    assert frames.radiance.shape == (1, 32, 32, 3)
    assert report.steps[0].exif_ev == pytest.approx(3.0, abs=0.01)
    # Its files are also what `import` would take.
    assert len(find_photographs(tmp_path / "a" / "shots")[1]) == 24


def test_an_order_is_read_as_it_was_written(tmp_path: Path) -> None:
    geometry = Geometry((0, -1, 0), (0, 0, 0.25), (1, 0, 0), (0, 0, 0.26))
    wanted = replace(order(9), geometry=geometry, settle_s=0.001, any_format=True)
    run(tmp_path / "a", wanted)
    assert read(tmp_path / "a") == wanted


def test_the_listener_hears_phases_poses_and_how_long_it_takes(tmp_path: Path) -> None:
    heard: list[Status] = []
    run(tmp_path / "a", order(3), listener=heard.append, warnings=("only one axis",))
    phases = [status.phase for status in heard if status.pose is not None and status.pose.index == 1]
    assert [one for one, two in zip(phases, phases[1:] + [None], strict=True) if one is not two][-4:] == [
        Phase.MOVING, Phase.EXPOSING, Phase.DOWNLOADING, Phase.FILING,
    ]  # fmt: skip
    assert heard[-1].phase is Phase.ENDED
    assert [status.taken for status in heard if status.left_s is not None][-1] == 3
    assert heard[-1].left_s == 0
    assert [finding.text for finding in heard[-1].findings] == ["only one axis"]


def test_what_the_watch_finds_is_told_and_its_faults_are_findings(tmp_path: Path) -> None:
    def watch(shot: Shot) -> list[Finding]:
        if shot.name == "pose0001":
            raise ImportFault("no pixels")
        return [Finding(shot.name, "too dark")] if shot.name == "pose0002" else []

    outcome = run(tmp_path / "a", order(4), watch=watch)
    assert [(finding.pose, finding.text) for finding in outcome.findings] == [
        ("pose0001", "could not be looked at: no pixels"), ("pose0002", "too dark"),
    ]  # fmt: skip


def test_a_bug_in_the_watch_is_not_hidden(tmp_path: Path) -> None:
    def watch(shot: Shot) -> list[Finding]:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(tmp_path / "a", order(2), watch=watch)


def test_the_rig_is_homed_only_when_it_does_not_know_where_it_stands(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    run(tmp_path / "a", order(2), rig)
    assert rig.motion.homings == 1
    other = quick_devices.rig()
    other.motion.home()
    run(tmp_path / "b", order(2), other)
    assert other.motion.homings == 1


def test_a_pause_waits_and_resume_goes_on(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    wanted = order(5)
    rig.motion.may_move.clear()
    going = InThread(tmp_path / "a", wanted, rig)
    going.until(rig.motion.moving.is_set)
    going.control.pause()
    assert rig.motion.holds == 1  # in motion: held at once
    going.control.resume()
    going.until(lambda: len(rig.motion.moves) > 0)
    going.control.pause()
    going.until(lambda: going.capture.status.phase in (Phase.PAUSED, Phase.MOVING))
    going.control.resume()
    assert going.end().missing == ()
    assert faults_of(tmp_path / "a", wanted) == []


def held_at_exposures() -> tuple[Rig, threading.Event, threading.Event]:
    """A rig that waits in its exposures: the rig, whether it came to one, whether it may go on."""
    exposing, may_expose = threading.Event(), threading.Event()

    def fault(name: str) -> None:
        if name == "expose":
            exposing.set()
            assert may_expose.wait(WAIT_S)

    return quick_devices.rig(fault), exposing, may_expose


def test_a_pause_between_poses_moves_nothing(tmp_path: Path) -> None:
    rig, exposing, may_expose = held_at_exposures()
    wanted = order(5)
    going = InThread(tmp_path / "a", wanted, rig)
    going.until(exposing.is_set)
    going.control.pause()
    may_expose.set()
    going.until(lambda: going.capture.status.phase is Phase.PAUSED)
    moved = len(rig.motion.moves)
    time.sleep(0.05)
    assert (moved, len(rig.motion.moves), going.capture.status.taken) == (1, 1, 1)
    going.control.resume()
    assert going.end().taken == 5
    assert len(events(tmp_path / "a", "paused")) == len(events(tmp_path / "a", "resumed")) == 1


def test_cancel_in_motion_stops_the_rig_and_the_session_resumes(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    wanted = order(6)
    going = InThread(tmp_path / "a", wanted, rig)
    going.until(lambda: going.capture.status.taken >= 2)
    rig.motion.may_move.clear()
    going.until(rig.motion.moving.is_set)
    going.control.cancel()
    outcome = going.end()
    assert outcome.cancelled
    assert rig.motion.stops >= 1
    assert 2 <= outcome.taken < 6
    assert faults_of(tmp_path / "a", wanted, complete=False) == []
    assert run(tmp_path / "a", wanted, resumed=True).taken == 6
    assert faults_of(tmp_path / "a", wanted) == []
    assert len(events(tmp_path / "a", "cancelled")) == 1


@pytest.mark.parametrize("ask", ["cancel", "stop"])
def test_the_end_does_not_wait_until_the_rig_has_settled(tmp_path: Path, ask: str) -> None:
    rig = quick_devices.rig()
    going = InThread(tmp_path / "a", replace(order(4), settle_s=3600.0), rig)
    going.until(lambda: len(rig.motion.moves) == 1)
    getattr(going.control, ask)()
    outcome = going.end()
    assert (outcome.cancelled, outcome.taken) == (True, 0)


@pytest.mark.parametrize(("ask", "kept"), [("cancel", 1), ("stop", 0)])
def test_cancel_keeps_the_exposure_under_way_and_stop_drops_it(tmp_path: Path, ask: str, kept: int) -> None:
    rig, exposing, may_expose = held_at_exposures()
    going = InThread(tmp_path / "a", order(4), rig)
    going.until(exposing.is_set)
    getattr(going.control, ask)()
    may_expose.set()
    outcome = going.end()
    assert outcome.cancelled
    assert outcome.taken == kept
    assert len(rig.motion.moves) == 1


def test_cancel_while_paused_ends(tmp_path: Path) -> None:
    going = InThread(tmp_path / "a", order(4), quick_devices.rig())
    going.control.pause()
    going.control.cancel()
    assert going.end().cancelled


def test_a_stop_that_came_just_before_the_order_is_said_again(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    rig.motion.may_move.clear()
    going = InThread(tmp_path / "a", order(4), rig)
    going.until(rig.motion.moving.is_set)
    rig.motion.deaf_stops = 3
    going.control.cancel()
    assert going.end().cancelled
    assert rig.motion.stops > 3


def test_resume_takes_only_what_is_missing(tmp_path: Path) -> None:
    wanted = order(6)
    run(tmp_path / "a", wanted)
    shots = {shot.name: shot for shot in sessions.shots(sessions.open_session(tmp_path / "a"))}
    (shots["pose0002"].folder / "shot.json").unlink()  # a kill in the midst of it
    left = shots["pose0004"].files[1]
    left.write_bytes(left.read_bytes()[:-1] + b"?")  # a disk that forgets
    rig = quick_devices.rig()
    outcome = run(tmp_path / "a", wanted, rig, resumed=True)
    assert outcome.taken == 6
    assert len(rig.motion.moves) == 2
    assert faults_of(tmp_path / "a", wanted) == []
    assert any("bytes changed" in finding.text for finding in outcome.findings)
    aside = list((tmp_path / "a" / "capture" / "damaged").rglob("*.DNG"))
    assert len(aside) == 3  # put aside, not thrown away


def test_resuming_what_is_finished_touches_no_device(tmp_path: Path) -> None:
    wanted = order(3)
    run(tmp_path / "a", wanted)

    def nothing() -> Rig:
        raise AssertionError("no device is needed")

    assert Capture(tmp_path / "a", wanted, nothing, resumed=True).run().taken == 3


def test_half_downloaded_photographs_are_wiped(tmp_path: Path) -> None:
    wanted = order(3)
    run(tmp_path / "a", wanted)
    incoming = tmp_path / "a" / "capture" / "incoming" / "pose0001"
    incoming.mkdir(parents=True)
    (incoming / "0_IMG_0001.DNG").write_bytes(b"half")
    run(tmp_path / "a", wanted, resumed=True)
    assert not incoming.parent.exists()


def test_a_new_capture_never_goes_over_what_is_there(tmp_path: Path) -> None:
    run(tmp_path / "a", order(2))
    rig = quick_devices.rig()
    with pytest.raises(CaptureError, match=r"exists already.*capture --resume"):
        run(tmp_path / "a", order(3), rig)
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "thesis.txt").write_text("years of work")
    with pytest.raises(CaptureError, match="exists already"):
        run(tmp_path / "thesis", order(3), rig)
    assert rig.motion.moves == []
    assert not rig.motion.homings


def test_two_captures_of_one_session_are_refused(tmp_path: Path) -> None:
    wanted = order(2)
    run(tmp_path / "a", wanted)
    session = sessions.open_session(tmp_path / "a")
    with sessions.lock(session), pytest.raises(SessionError, match="is working on this session"):
        run(tmp_path / "a", wanted, resumed=True)


def test_what_is_no_capture_is_told(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="no capture to resume"):
        read(tmp_path / "nothing")
    run(tmp_path / "a", order(2))
    path = tmp_path / "a" / "capture" / "order.json"
    content = json.loads(path.read_bytes())
    path.write_text(json.dumps({**content, "schema": 2}))
    with pytest.raises(CaptureError, match="install a newer roomlight"):
        read(tmp_path / "a")
    for damage in (b"", b"[]", b'{"schema": 1}', json.dumps({**content, "poses": []}).encode()):
        path.write_bytes(damage)
        with pytest.raises(SessionError, match=r"order\.json: damaged"):
            read(tmp_path / "a")


def test_a_line_torn_by_a_power_cut_spoils_no_other(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    with contextlib.closing(capture_journal.Journal(path)) as journal:
        journal.note("started", left=3)
    path.write_bytes(path.read_bytes() + b'{"time": "2026-')
    with contextlib.closing(capture_journal.Journal(path)) as journal:
        journal.note("ended", missing=[])
    assert [event["event"] for event in capture_journal.read(path)] == ["started", "ended"]


def test_every_pose_and_every_run_has_the_exposures_of_the_first(tmp_path: Path) -> None:
    """A camera is left at the last exposure of a bracket: 0 EV must not be read off it again."""
    wanted = order(4)
    wanted = replace(wanted, bracket=replace(wanted.bracket, base=Exposure(None)))
    rig = quick_devices.rig()
    assert run(tmp_path / "a", wanted, rig).taken == 4
    session = sessions.open_session(tmp_path / "a")
    (session.folder / "shots" / "0003" / "shot.json").unlink()
    other = quick_devices.rig()
    other.camera.dial_s = rig.camera.dial_s
    assert run(tmp_path / "a", wanted, other, resumed=True).taken == 4
    shutters = [[facts["shutter_s"] for facts in shot.exposures] for shot in sessions.shots(session)]
    assert shutters == [pytest.approx([0.0025, 0.02, 0.16], rel=1e-4)] * 4


def test_poses_are_taken_in_the_order_that_is_asked_for_and_keep_their_names(tmp_path: Path) -> None:
    wanted = order(5)
    run(tmp_path / "a", wanted, reorder=lambda left: sorted(left, key=lambda pose: -pose.index))
    shots = sessions.shots(sessions.open_session(tmp_path / "a"))
    assert [shot.name for shot in shots] == [f"pose{index:04d}" for index in (4, 3, 2, 1, 0)]
    assert faults_of(tmp_path / "a", wanted) == []


def test_handheld_shots_have_no_angles(tmp_path: Path) -> None:
    places = poses_of(plan.free(3))
    wanted = replace(order(3), poses=places, kind=kind_of(places))
    camera = quick_devices.Body(quick_devices.Table())
    assert run(tmp_path / "a", wanted, Rig(Handheld(), camera)).taken == 3
    session = sessions.open_session(tmp_path / "a")
    assert session.facts["rig"] is None
    assert [shot.rig for shot in sessions.shots(session)] == [None] * 3
    assert read(tmp_path / "a").poses[0].angles is None


def test_the_rig_reports_what_it_reached_not_what_was_asked(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    rig.motion.off_deg = 0.004
    run(tmp_path / "a", order(2), rig)
    shot = sessions.shots(sessions.open_session(tmp_path / "a"))[1]
    assert shot.rig is not None
    assert shot.rig["pan_deg"] == pytest.approx(rig.motion.moves[1].pan_deg + 0.004)
    assert rig.motion.moves[1] != Angles(0.0)
