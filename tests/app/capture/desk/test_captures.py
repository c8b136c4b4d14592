"""Captures at the desk: told step by step, ended at any moment, and always to go on with."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from app.capture import checks
from app.capture import order as orders
from app.capture.status import Finding, Phase
from engine.capture_checks.finding import Severity
from engine.io import session as sessions
from engine.io.session import Shot
from hardware import find
from hardware.errors import AbsentError
from hardware.interfaces import Angles, State
from hardware.manual import Manual
from hardware.rig import Rig
from hardware.virtual.rig import VirtualRig
from tests.app.capture import quick_devices
from tests.app.capture.captures import faults_of
from tests.app.capture.desk.bench import Bench, resume, start
from tests.app.capture.quick_devices import Body, Table

MIDST = (2, Phase.MOVING)  # of four poses
GIMBAL = {"kind": "gimbal", "poses": 4}


class Strict:
    """Live checks that know one thing."""

    def __init__(self, stop_at: str = "") -> None:
        self._stop_at = stop_at

    def __call__(self, shot: Shot) -> Sequence[Finding]:
        if shot.name != self._stop_at:
            return ()
        return (Finding(shot.name, "the object moved; fix it", Severity.STOP),)

    def seen(self, height: int) -> None:
        return None


def strict(monkeypatch: pytest.MonkeyPatch, stop_at: str = "") -> None:
    monkeypatch.setattr(checks, "watching", lambda order, by_hand: Strict(stop_at))


def table_of(bench: Bench) -> Table:
    table = bench.rigs[-1].motion
    assert isinstance(table, Table)
    return table


def held_after(moves: int) -> Callable[..., Rig]:
    """Opens a table that, after so many moves, waits in the midst of the next one until it is let go."""

    def opening(*urls: str, **options: Any) -> Rig:
        left = iter(range(moves - 1, -1, -1))

        def fault(order: str) -> None:
            if order == "move" and next(left, None) == 0:
                table.may_move.clear()

        table = Table(fault)
        return Rig(table, Body(table))

    return opening


def opened(bench: Bench) -> Table:
    bench.order("open", rig="quick:", camera="quick:")
    return table_of(bench)


def test_a_capture_is_told_from_its_start_to_its_end_and_leaves_the_devices_open(tmp_path: Path) -> None:
    session = tmp_path / "a"
    with Bench(tmp_path / "pictures") as bench:
        bench.order("open", rig="quick:", camera="quick:")
        bench.rigs[0].settle_s = 0.0
        state = bench.order("start", **start(session, settle=0.001))
        assert state.planned is not None
        assert len(state.planned.poses) == 4  # told by the capture itself: nobody asked for a plan
        assert state.ended is not None
        assert (state.ended.session, state.ended.taken, state.ended.total) == (session, 4, 4)
        assert not state.ended.cancelled
        assert state.ended.trouble is None
        assert state.going is not None
        assert (state.going.phase, state.going.taken) == (Phase.ENDED, 4)
        assert state.session == session
        # Noise cannot be matched from shot to shot; the checks say so of some pose.
        assert {finding.pose for finding in state.findings} <= {f"pose{index:04d}" for index in range(4)}
        assert len(set(state.findings)) == len(state.findings)
        progress = [event["fraction"] for event in bench.events if event["event"] == "progress"]
        assert (progress[0], progress[-1]) == (0, 1)  # for the status bar of the window
        assert state.working is None
        bench.until(lambda state: state.picture is not None and state.picture.pose == "pose0003")
        assert bench.state.coverage is not None
        assert bench.state.coverage.png.read_bytes()[:4] == b"\x89PNG"
        assert bench.rigs[0].settle_s == 0.0
        bench.order("jog", pan=3, tilt=0)
        assert bench.state.told is None
        assert len(bench.rigs) == 1
    assert faults_of(session, orders.read(session)) == []
    assert orders.read(session).rig == "quick:"


def test_what_cannot_begin_is_a_trouble_and_leaves_no_session(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.mkdir()
    (taken / "thesis.txt").write_text("years of work")
    with Bench(tmp_path / "pictures") as bench:
        opened(bench)
        for told, facts in (
            ("exists already", start(taken)),
            ("a bracket of []", start(tmp_path / "a", bracket=[])),
            ("0 poses", start(tmp_path / "a", poses=0)),
            ("beyond -80 to 80", start(tmp_path / "a", plan={**GIMBAL, "lowest": -85, "highest": 85})),
            ("no plan of the kind", start(tmp_path / "a", plan={"kind": "spiral", "poses": 4})),
        ):
            state = bench.order("start", **facts)
            assert state.told is not None
            assert told in state.told.trouble.what
            assert state.ended is None
        assert state.told.number == 5
        assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("way", ["end", "stop", "cancel", "gone"])
def test_a_capture_that_is_ended_in_the_midst_is_resumed_at_the_first_missing_pose(
    tmp_path: Path, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    strict(monkeypatch)
    session = tmp_path / "a"
    with Bench(tmp_path / "pictures", held_after(2)) as bench:
        opened(bench)
        bench.send("start", **start(session))
        bench.until(lambda state: state.going is not None and (state.going.taken, state.going.phase) == MIDST)
        if way == "gone":
            bench.link.end()
        else:
            bench.send(way)
        ended = bench.until(lambda state: state.ended).ended
        assert ended is not None
        assert (ended.taken, ended.total, ended.cancelled) == (2, 4, True)
        assert bench.state.told is None
    assert faults_of(session, orders.read(session), complete=False) == []
    with Bench(tmp_path / "again") as bench:
        state = bench.order("resume", **resume(session))  # opens the order's own devices
        assert state.open
        assert state.ended is not None
        assert (state.ended.taken, state.ended.cancelled) == (4, False)
        assert len(table_of(bench).moves) == 2
    assert faults_of(session, orders.read(session)) == []


def test_a_shot_that_was_damaged_meanwhile_is_told_of_and_taken_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    strict(monkeypatch)
    session = tmp_path / "a"
    with Bench(tmp_path / "pictures") as bench:
        opened(bench)
        bench.order("start", **start(session))
        (session / "shots" / "0001" / "shot.json").write_text("{")
        state = bench.order("resume", **resume(session))
        assert state.ended is not None
        assert (state.ended.taken, state.ended.trouble) == (4, None)
        (finding,) = state.findings
        assert finding.severity is Severity.WARNING
        assert "taken again" in finding.text
    assert faults_of(session, orders.read(session)) == []


def test_it_pauses_before_the_next_pose_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    strict(monkeypatch)
    with Bench(tmp_path / "pictures", held_after(2)) as bench:
        table = opened(bench)
        bench.send("start", **start(tmp_path / "a"))
        bench.until(lambda state: state.going is not None and (state.going.taken, state.going.phase) == MIDST)
        bench.send("pause")
        bench.until(lambda state: state.paused)
        assert table.holds == 1
        table.resume()
        state = bench.until(lambda state: state.going is not None and state.going.phase is Phase.PAUSED)
        assert state.going is not None
        assert state.going.taken == 3
        bench.send("go_on")
        ended = bench.until(lambda state: state.ended).ended
        assert ended is not None
        assert ended.taken == 4
        assert not bench.state.paused


def test_a_finding_that_says_stop_pauses_and_a_person_decides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    strict(monkeypatch, "pose0001")
    session, openings = tmp_path / "a", iter([held_after(3), lambda *urls, **options: quick_devices.rig()])
    with Bench(tmp_path / "pictures", lambda *urls, **options: next(openings)(*urls, **options)) as bench:
        table = opened(bench)
        bench.send("start", **start(session, poses=6))
        state = bench.until(lambda state: state.paused and state.findings)
        (finding,) = state.findings
        assert (finding.pose, finding.severity) == ("pose0001", Severity.STOP)
        table.resume()
        bench.until(lambda state: state.going is not None and state.going.phase is Phase.PAUSED)
        bench.send("end")
        ended = bench.until(lambda state: state.ended).ended
        assert ended is not None
        assert 2 <= ended.taken <= 4
        assert ended.cancelled
        bench.until(lambda state: not state.order)
        opened(bench)
        # What was decided once does not pause again.
        state = bench.order("resume", **resume(session))
        assert state.ended is not None
        assert state.ended.taken == 6
        assert [finding.pose for finding in state.findings] == ["pose0001"]
        assert not any(event["paused"] for event in bench.told("status")[-3:])


def test_a_manual_rig_asks_before_every_pose(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    strict(monkeypatch)
    table = Table()

    def by_hand(rig: str, camera: str, **options: Any) -> Rig:
        def ask(request: Any) -> None:
            table.angles = request.angles
            options["ask"](request)

        return Rig(Manual(ask), Body(table))

    session = tmp_path / "a"
    with Bench(tmp_path / "pictures", by_hand) as bench:
        bench.order("open", rig="manual:", camera="quick:")
        bench.send("start", **start(session, poses=3))
        for turn in range(1, 4):
            bench.until(lambda state, turn=turn: len(bench.told("ask")) == turn and state.ask)
            bench.send("answer")
        ended = bench.until(lambda state: state.ended).ended
        assert ended is not None
        assert ended.taken == 3
        assert bench.state.ask is None
    assert faults_of(session, orders.read(session)) == []


VIRTUAL = ("virtual:grbl?speed=200", "virtual:?size=64x48")


def on_virtual(session: Path) -> dict[str, Any]:
    return start(session, shutter=None, bracket=[0])


def pulled_at_a_move(rig: Rig, monkeypatch: pytest.MonkeyPatch, then: Callable[[], None]) -> None:
    """Pull the cable of a virtual rig just before it goes to its second pose."""
    pulled, moves = rig.motion, iter(range(9))
    assert isinstance(pulled, VirtualRig)
    move = pulled.move

    def last(angles: Angles) -> Angles:
        if next(moves) == 1:
            pulled.pull()
            then()
        return move(angles)

    monkeypatch.setattr(pulled, "move", last)


def test_a_cable_that_is_pulled_ends_it_with_a_trouble_and_it_resumes_when_the_cable_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    strict(monkeypatch)
    session, there = tmp_path / "a", [True]

    def opening(rig: str, camera: str, **options: Any) -> Rig:
        if not there[0]:
            raise AbsentError(f"{rig}: there is no such port; plug the rig in")
        return find.open_rig(rig, camera, **options)

    with Bench(tmp_path / "pictures", opening) as bench:
        bench.order("open", rig=VIRTUAL[0], camera=VIRTUAL[1])
        pulled_at_a_move(bench.rigs[0], monkeypatch, lambda: there.__setitem__(0, False))
        bench.send("start", **on_virtual(session))
        state = bench.until(lambda state: state.ended)
        assert state.ended is not None
        assert state.ended.trouble is not None
        assert state.ended.trouble.what.endswith("there is no such port")
        assert 1 <= state.ended.taken < 4
        bench.until(lambda state: not state.order and state.where.state is State.OFFLINE)
        there[0] = True
        bench.order("open", rig=VIRTUAL[0], camera=VIRTUAL[1])
        state = bench.order("resume", **resume(session))
        assert state.ended is not None
        assert (state.ended.taken, state.ended.trouble) == (4, None)
    for shot in sessions.shots(sessions.open_session(session)):
        sessions.verify(shot)


def test_a_cable_that_is_pulled_for_a_moment_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    strict(monkeypatch)
    with Bench(tmp_path / "pictures", find.open_rig) as bench:
        bench.order("open", rig=VIRTUAL[0], camera=VIRTUAL[1])
        pulled_at_a_move(bench.rigs[0], monkeypatch, lambda: None)
        bench.send("start", **on_virtual(tmp_path / "a"))
        ended = bench.until(lambda state: state.ended).ended
        assert ended is not None
        assert (ended.taken, ended.trouble) == (4, None)
        # The rig that was opened again is the desk's now.
        bench.until(lambda state: not state.order)
        bench.order("move", pan=10, tilt=0)
        assert bench.state.told is None
        assert len(bench.rigs) == 2
        angles = bench.rigs[1].motion.status().angles
        assert angles is not None
        assert angles.pan_deg == pytest.approx(10.0, abs=0.02)
