"""Whatever fails during a capture: nothing is lost, doubled or mislabelled, and the message is the right one.

`python -m tests.bench.capture` does the same with 500 poses and 100 kills.
"""

import os
import random
from pathlib import Path

import pytest

from app.capture import disk as capture_disk
from app.capture import journal as capture_journal
from app.capture.order import CaptureError
from app.capture.run import Capture
from app.capture.status import Outcome
from engine.errors import SessionError
from engine.io import session as sessions
from hardware.errors import (
    AbsentError,
    BatteryError,
    DisconnectedError,
    ExposureError,
    HardwareError,
    LimitError,
    PositionLostError,
    RefusedError,
    ReplyError,
    StoppedError,
    StoreFullError,
)
from hardware.interfaces import Angles, State
from hardware.rig import Rig
from tests.app.capture import quick_devices
from tests.app.capture.captures import HASTY, faults_of, order
from tests.app.capture.faulty import capture_among_faults, finished, kill_until_done, some_shots


class Scripted:
    """Fails the orders of a list, each as often as it says: ("move", 2, error) fails the next two moves."""

    def __init__(self, *script: tuple[str, int, HardwareError]):
        self._script = list(script)

    def __call__(self, name: str) -> None:
        for place, (what, times, error) in enumerate(self._script):
            if what == name and times:
                self._script[place] = (what, times - 1, error)
                raise error


def run(
    folder: Path, poses: int, *script: tuple[str, int, HardwareError], rig: Rig | None = None, **options
) -> Outcome:
    made = rig or quick_devices.rig(Scripted(*script))
    return Capture(folder, order(poses), lambda: made, patience=HASTY, **options).run()


def resume(folder: Path, poses: int, rig: Rig | None = None) -> Outcome:
    made = rig or quick_devices.rig()
    return Capture(folder, order(poses), lambda: made, True, patience=HASTY).run()


def events(folder: Path, kind: str) -> list[dict]:
    journal = capture_journal.read(folder / "capture" / "journal.jsonl")
    return [event for event in journal if event["event"] == kind]


@pytest.mark.parametrize("seed", range(2))
def test_random_faults_lose_double_and_mislabel_nothing(tmp_path: Path, seed: int) -> None:
    wanted = order(30)
    outcome, happened, _ = capture_among_faults(tmp_path / "a", wanted, seed, every=4)
    assert sum(happened.values()) >= 5
    assert outcome.taken == 30
    assert faults_of(tmp_path / "a", wanted) == []


def test_kills_lose_no_finished_shot_and_the_resume_is_exact(tmp_path: Path) -> None:
    kills = kill_until_done(tmp_path / "a", 30, 3, some_shots(random.Random(5), 6))
    assert kills == 3
    assert len(finished(tmp_path / "a")) == 30
    assert faults_of(tmp_path / "a", order(30)) == []


@pytest.mark.parametrize("name", ["move", "expose", "download"])
def test_a_passing_fault_costs_one_more_try(tmp_path: Path, name: str) -> None:
    error = ReplyError("late") if name == "move" else ExposureError("blurted")
    assert run(tmp_path / "a", 3, (name, 2, error)).taken == 3
    assert faults_of(tmp_path / "a", order(3)) == []
    assert [event["reason"] for event in events(tmp_path / "a", "failed")] == [str(error)] * 2


def test_a_lost_position_is_homed_before_the_next_move(tmp_path: Path) -> None:
    rig = quick_devices.rig(Scripted(("move", 1, PositionLostError("stalled"))))
    assert run(tmp_path / "a", 3, rig=rig).taken == 3
    assert rig.motion.homings == 2
    assert len(events(tmp_path / "a", "homed")) == 2


def test_homing_that_fails_is_tried_a_few_times_and_then_told(tmp_path: Path) -> None:
    rig = quick_devices.rig(Scripted(("home", 99, PositionLostError("the switch was not found"))))
    with pytest.raises(PositionLostError, match="switch was not found"):
        run(tmp_path / "a", 3, rig=rig)
    assert rig.motion.moves == []
    assert len(events(tmp_path / "a", "failed")) == HASTY.recoveries


def test_a_rig_that_cannot_home_does_not_guess_where_it_stands(tmp_path: Path) -> None:
    rig = quick_devices.rig(Scripted(("expose", 1, PositionLostError("the table slipped"))), homes=False)
    with pytest.raises(HardwareError, match="turn it there by hand, then resume with --at-zero"):
        run(tmp_path / "a", 3, rig=rig)
    assert (rig.motion.homings, len(rig.motion.moves)) == (1, 1)  # a new capture begins where it stands
    rig = quick_devices.rig(homes=False)
    with pytest.raises(HardwareError, match="turn it there by hand"):
        resume(tmp_path / "a", 3, rig)
    assert (rig.motion.homings, rig.motion.moves) == (0, [])
    rig = quick_devices.rig(homes=False)
    outcome = Capture(tmp_path / "a", order(3), lambda: rig, resumed=True, at_zero=True, patience=HASTY).run()
    assert (outcome.taken, rig.motion.homings) == (3, 1)
    assert faults_of(tmp_path / "a", order(3)) == []


def test_a_pulled_cable_is_opened_again_and_homed(tmp_path: Path) -> None:
    faults = Scripted(("move", 1, DisconnectedError("the cable is out")))
    number = quick_devices.counter()
    opened: list[Rig] = []

    def open_rig() -> Rig:
        if len(opened) == 1:
            opened.append(opened[0])
            raise AbsentError("no such port yet")
        opened.append(quick_devices.rig(faults, number=number))
        return opened[-1]

    outcome = Capture(tmp_path / "a", order(4), open_rig, patience=HASTY).run()
    assert outcome.taken == 4
    assert opened[0].motion.status().state is State.OFFLINE  # it was closed
    assert opened[-1].motion.homings == 1
    assert faults_of(tmp_path / "a", order(4)) == []
    assert len(events(tmp_path / "a", "reconnected")) == 1


def test_a_rig_that_knows_where_it_stands_is_not_homed_for_the_cameras_cable(tmp_path: Path) -> None:
    faults = Scripted(("expose", 1, DisconnectedError("the camera's cable is out")))
    number = quick_devices.counter()
    opened: list[Rig] = []

    def open_rig() -> Rig:
        opened.append(quick_devices.rig(faults, number=number))
        if len(opened) > 1:
            opened[-1].motion.state = State.IDLE  # a controller that kept its power
        return opened[-1]

    assert Capture(tmp_path / "a", order(4), open_rig, patience=HASTY).run().taken == 4
    assert [rig.motion.homings for rig in opened] == [1, 0]
    assert faults_of(tmp_path / "a", order(4)) == []


def test_a_cable_that_stays_out_ends_the_capture_with_its_message(tmp_path: Path) -> None:
    rig = quick_devices.rig(Scripted(("move", 1, DisconnectedError("the cable is out"))))
    opened = [rig]

    def open_rig() -> Rig:
        if not opened:
            raise AbsentError("/dev/ttyUSB0: there is no such port")
        return opened.pop()

    with pytest.raises(AbsentError, match="no such port"):
        Capture(tmp_path / "a", order(4), open_rig, patience=HASTY).run()
    assert resume(tmp_path / "a", 4).taken == 4


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("expose", StoreFullError("the card is full")),
        ("expose", BatteryError("3 % left")),
        ("move", RefusedError("error:9, locked")),
        ("move", StoppedError("somebody pressed the button")),
    ],
)
def test_what_another_try_cannot_help_stops_at_once_and_resumes(
    tmp_path: Path, name: str, error: HardwareError
) -> None:
    rig = quick_devices.rig(Scripted((name, 1, error)))
    with pytest.raises(type(error), match=str(error)):
        run(tmp_path / "a", 3, rig=rig)
    assert len(rig.motion.moves) <= 1
    assert events(tmp_path / "a", "stopped")[0]["reason"] == str(error)
    assert resume(tmp_path / "a", 3).taken == 3
    assert faults_of(tmp_path / "a", order(3)) == []


def _rig_failing_at(*poses: int, times: int = 99) -> Rig:
    """With a camera that cannot photograph some poses, so often."""
    rig = quick_devices.rig()
    wanted = [pose.angles for pose in order(8).poses]
    rig.camera.fails_at = {wanted[pose]: times for pose in poses}
    return rig


def test_a_pose_that_fails_is_left_for_the_end_and_taken_then(tmp_path: Path) -> None:
    rig = _rig_failing_at(2, times=HASTY.tries)
    outcome = run(tmp_path / "a", 8, rig=rig)
    assert (outcome.taken, outcome.missing) == (8, ())
    taken = [shot.name for shot in sessions.shots(sessions.open_session(tmp_path / "a"))]
    assert taken[-1] == "pose0002"
    assert faults_of(tmp_path / "a", order(8)) == []


def test_a_pose_that_never_succeeds_is_reported_and_resume_tries_it_again(tmp_path: Path) -> None:
    outcome = run(tmp_path / "a", 8, rig=_rig_failing_at(2, 5))
    assert outcome.taken == 6
    assert [(item.pose.name, item.reason) for item in outcome.missing] == [
        ("pose0002", "it would not focus"), ("pose0005", "it would not focus"),
    ]  # fmt: skip
    tried = [event["pose"] for event in events(tmp_path / "a", "begun")]
    assert tried.count("pose0002") == 2 * HASTY.tries
    assert resume(tmp_path / "a", 8).taken == 8
    assert faults_of(tmp_path / "a", order(8)) == []


def test_a_camera_that_fails_at_every_pose_does_not_run_through_the_plan(tmp_path: Path) -> None:
    rig = _rig_failing_at(*range(2, 8))
    with pytest.raises(CaptureError, match="3 poses in a row failed, pose0004 at last: it would not focus"):
        run(tmp_path / "a", 8, rig=rig)
    assert rig.motion.angles == order(8).poses[4].angles


def test_a_photograph_that_arrives_damaged_is_taken_again(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    spoilt: list[Path] = []

    def spoil(path: Path) -> None:
        if not spoilt:
            spoilt.append(path)
            path.write_bytes(path.read_bytes()[:-2])

    rig.camera.spoil = spoil
    assert run(tmp_path / "a", 3, rig=rig).taken == 3
    assert "arrived damaged" in events(tmp_path / "a", "failed")[0]["reason"]
    assert faults_of(tmp_path / "a", order(3)) == []


def test_a_photograph_of_another_pose_is_noticed(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    rig.camera.stale = 1  # hands over the pose before once more
    assert run(tmp_path / "a", 3, rig=rig).taken == 3
    assert "again, which an earlier pose has already" in events(tmp_path / "a", "failed")[0]["reason"]
    assert faults_of(tmp_path / "a", order(3)) == []


def test_exposures_in_the_wrong_order_are_noticed(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    rig.camera.swapped = 1  # calls the dark one bright
    assert run(tmp_path / "a", 3, rig=rig).taken == 3
    assert "they are of different brackets" in events(tmp_path / "a", "failed")[0]["reason"]
    assert faults_of(tmp_path / "a", order(3)) == []


def test_another_camera_in_the_midst_is_told(tmp_path: Path) -> None:
    assert run(tmp_path / "a", 3).taken == 3
    (tmp_path / "a" / "shots" / "0002" / "shot.json").unlink()
    with pytest.raises(CaptureError, match=r"now the camera is .* at 64 x 64, earlier poses .* 32 x 32"):
        resume(tmp_path / "a", 3, quick_devices.rig(size=64))


def test_a_plan_beyond_the_travel_moves_nothing_and_makes_no_session(tmp_path: Path) -> None:
    rig = quick_devices.rig(tilts=False)
    with pytest.raises(LimitError, match="no tilt axis"):
        run(tmp_path / "a", 8, rig=rig)
    assert rig.motion.moves == []
    assert rig.motion.homings == 0
    assert not (tmp_path / "a").exists()


def test_photographs_that_processing_cannot_use_are_refused_before_anything_moves(tmp_path: Path) -> None:
    table = quick_devices.Table()
    rig = Rig(table, quick_devices.Body(table, suffix=".jpg"))
    with pytest.raises(CaptureError, match=r"writes \.jpg.*set the camera to RAW"):
        run(tmp_path / "a", 3, rig=rig)
    assert not (tmp_path / "a").exists()
    table = quick_devices.Table()
    rig = Rig(table, quick_devices.Body(table, suffix=".jpg"))
    wanted = order(3, any_format=True)
    assert Capture(tmp_path / "a", wanted, lambda: rig, patience=HASTY).run().taken == 3
    assert [shot.files[0].suffix for shot in sessions.shots(sessions.open_session(tmp_path / "a"))] == [
        ".JPG"
    ] * 3


def test_a_disk_too_small_for_the_plan_is_told_before_anything_moves(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    needed = 36 * 3048 * 1.05 + capture_disk.SPARE_BYTES
    with pytest.raises(CaptureError, match=r"36 photographs .* need 0\.05 GB, and 0\.05 GB are free"):
        run(tmp_path / "a", 12, rig=rig, free=lambda folder: int(needed) - 1000)
    assert rig.motion.homings == 0
    assert not (tmp_path / "a").exists()
    assert run(tmp_path / "a", 12, free=lambda folder: int(needed) + 1000).taken == 12


def test_larger_files_than_thought_are_told_after_the_first_pose(tmp_path: Path) -> None:
    rig = quick_devices.rig(told_bytes=100)
    room = capture_disk.SPARE_BYTES + 50_000
    with pytest.raises(CaptureError, match=r"33 photographs of about 0\.001\d\d? MB"):
        run(tmp_path / "a", 12, rig=rig, free=lambda folder: room)
    assert len(rig.motion.moves) == 1
    assert len(finished(tmp_path / "a")) == 1


def test_a_disk_that_fills_up_stops_with_its_message_and_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, count = os.fsync, 0

    def fsync(handle: int) -> None:
        nonlocal count
        count += 1
        if count > 40:
            raise OSError(28, "No space left on device")
        real(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(SessionError, match="disk is full; free some space"):
        run(tmp_path / "a", 12)
    monkeypatch.undo()
    there = len(finished(tmp_path / "a"))
    assert 1 <= there < 12
    assert resume(tmp_path / "a", 12).taken == 12
    assert faults_of(tmp_path / "a", order(12)) == []


def test_a_camera_that_cannot_free_its_room_loses_nothing(tmp_path: Path) -> None:
    assert run(tmp_path / "a", 3, ("forget", 3, ExposureError("the card is locked"))).taken == 3
    assert faults_of(tmp_path / "a", order(3)) == []


def test_a_rig_still_turning_is_waited_for_and_then_stopped(tmp_path: Path) -> None:
    rig = quick_devices.rig()
    rig.motion.state = State.MOVING
    stop = rig.motion.stop

    def stopped() -> None:
        stop()
        rig.motion.state = State.UNHOMED

    rig.motion.stop = stopped
    assert run(tmp_path / "a", 2, rig=rig).taken == 2
    assert rig.motion.homings == 1
    assert rig.motion.moves[0] == Angles(0.0, -70.0)
