"""Jogging and looking at the desk: every order is answered, one at a time, and stop is heard at once."""

import shutil
import threading
from pathlib import Path
from typing import Any

import pytest

from app.capture.desk.newest import Newest
from hardware import find
from hardware.interfaces import Angles, State
from hardware.manual import Manual
from hardware.rig import Rig
from tests.app.capture.desk.bench import Bench, resume, start
from tests.app.capture.quick_devices import Body, Table


def where(bench: Bench, pan_deg: float, tilt_deg: float) -> None:
    bench.until(lambda state: (state.where.pan_deg, state.where.tilt_deg) == (pan_deg, tilt_deg))


def test_devices_are_opened_told_of_and_closed(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        state = bench.order("open", rig="a", camera="b")
        assert state.rig is not None
        assert state.camera is not None
        assert [axis.name for axis in state.rig.axes] == ["pan", "tilt"]
        assert (state.rig.homes, state.rig.automatic, state.camera.suffix) == (True, True, ".dng")
        bench.until(lambda state: state.where.state is State.UNHOMED)
        bench.until(lambda state: state.camera_now is not None and state.camera_now.ready)
        first = bench.rigs[0]
        bench.order("open", rig="c", camera="d")
        assert first.motion.status().state is State.OFFLINE
        state = bench.order("close")
        assert not state.open
        assert bench.rigs[1].motion.status().state is State.OFFLINE
    assert not bench.state.told


def test_it_homes_moves_and_jogs_from_where_it_stands(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.order("open", rig="", camera="")
        bench.order("home")
        where(bench, 0.0, 0.0)
        bench.order("move", pan=30, tilt=-10)
        where(bench, 30.0, -10.0)
        bench.order("jog", pan=5, tilt=0)
        where(bench, 35.0, -10.0)
        assert bench.state.told is None
        bench.order("jog", pan=0, tilt=-75)
        told = bench.state.told
        assert told is not None
        assert (told.command, told.trouble.what) == ("jog", "tilt -85 is beyond 80")
        table = bench.rigs[0].motion
        assert isinstance(table, Table)
        assert table.moves == [Angles(30.0, -10.0), Angles(35.0, -10.0)]


@pytest.mark.parametrize(
    ("command", "facts"),
    [
        ("home", {}),
        ("jog", {"pan": 1, "tilt": 0}),
        ("preview", {"shutter": None, "iso": None, "aperture": None}),
        ("start", start(Path("nowhere"))),
    ],
)
def test_without_devices_an_order_is_a_trouble_that_names_the_remedy(
    tmp_path: Path, command: str, facts: dict[str, Any]
) -> None:
    with Bench(tmp_path) as bench:
        told = bench.order(command, **facts).told
    assert told is not None
    assert told.command == command
    assert told.trouble.what == "no rig and camera are open"
    assert told.trouble.remedy


def in_mid_move(bench: Bench) -> Table:
    """Open and homed, on its way to 90 degrees; the table goes on once it may."""
    bench.order("open", rig="", camera="")
    bench.order("home")
    table = bench.rigs[0].motion
    assert isinstance(table, Table)
    table.may_move.clear()
    bench.send("move", pan=90, tilt=0)
    assert table.moving.wait(10)
    return table


def test_an_order_under_way_refuses_others_and_stop_ends_it_without_a_word(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        table = in_mid_move(bench)
        bench.send("home")
        told = bench.until(lambda state: state.told).told
        assert told is not None
        assert (told.command, told.trouble.what) == ("home", "busy with move")
        bench.send("stop")
        bench.until(lambda state: not state.order)
        assert table.moves == []
        assert len(bench.told("trouble")) == 1
        assert table.homings == 1


def test_a_preview_shows_a_photograph_and_keeps_none(tmp_path: Path) -> None:
    with Bench(tmp_path / "pictures") as bench:
        bench.order("open", rig="", camera="")
        state = bench.order("preview", shutter=0.01, iso=100, aperture=None)
        assert state.picture is not None
        assert state.picture.pose == ""
        assert state.picture.png.read_bytes()[:4] == b"\x89PNG"
        assert state.picture.clip_png is not None
        assert state.picture.clip_png.is_file()
        assert state.picture.histogram is not None
        assert sum(state.picture.histogram.green) == 16 * 16  # cells of the quick camera
        camera = bench.rigs[0].camera
        assert isinstance(camera, Body)
        assert len(camera.forgotten) == 1


def test_plans_are_drawn_with_or_without_a_rig_and_fitted_to_it(tmp_path: Path) -> None:
    file = tmp_path / "plan.csv"
    file.write_text("pan_deg,tilt_deg\n0,0\n90,85\n")
    with Bench(tmp_path) as bench:

        def planned(**plan: Any) -> None:
            bench.events.clear()
            bench.send("plan", plan=plan)
            bench.until(lambda state: bench.told("planned") or bench.told("trouble"))

        planned(kind="turntable", poses=4)
        found = bench.state.planned
        assert found is not None
        assert [(pose.name, pose.pan_deg) for pose in found.poses] == [
            (f"pose{index:04d}", 90.0 * index) for index in range(4)
        ]
        assert "one axis" in found.warnings[0]
        planned(kind="free", poses=2)
        assert bench.state.planned is not None
        assert [pose.pan_deg for pose in bench.state.planned.poses] == [None, None]
        planned(kind="suited", poses=6)
        assert "no rig is open" in bench.told("trouble")[0]["text"]
        bench.order("open", rig="", camera="")
        planned(kind="suited", poses=6)
        assert bench.state.planned is not None
        assert len({pose.tilt_deg for pose in bench.state.planned.poses}) == 2
        planned(kind="file", path=str(file))
        assert "pose 1 has tilt 85, beyond -80 to 80" in bench.told("trouble")[0]["text"]


def test_what_is_plugged_in_is_told_beside_an_order(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        table = in_mid_move(bench)
        bench.send("list")
        assert "virtual:" in bench.until(lambda state: state.found.rigs).found.rigs
        table.may_move.set()


def test_a_person_turns_a_manual_rig_when_asked_and_stop_withdraws_the_question(tmp_path: Path) -> None:
    def by_hand(rig: str, camera: str, **options: Any) -> Rig:
        return Rig(Manual(options["ask"]), Body(Table()))

    with Bench(tmp_path, by_hand) as bench:
        bench.order("open", rig="", camera="")
        bench.send("move", pan=30, tilt=0)
        ask = bench.until(lambda state: state.ask).ask
        assert ask is not None
        assert ask.confirm
        assert "pan 30" in ask.text
        bench.send("answer")
        bench.until(lambda state: not state.order)
        assert bench.state.ask is None
        where(bench, 30.0, 0.0)
        bench.send("move", pan=60, tilt=0)
        bench.until(lambda state: state.ask)
        bench.send("stop")
        bench.until(lambda state: not state.order)
        assert bench.state.ask is None
        assert bench.state.told is None
        where(bench, 30.0, 0.0)


def test_a_watched_folder_asks_for_a_photograph_and_notices_it(tmp_path: Path) -> None:
    tethered, taken = tmp_path / "tethered", tmp_path / "taken"
    tethered.mkdir()
    quick = Body(Table())
    from hardware.interfaces import Bracket, Exposure

    (photograph,) = quick.expose(Bracket(Exposure(0.02), (0.0,)))
    taken.mkdir()
    quick.download(photograph, taken / "a.dng")
    with Bench(tmp_path / "pictures", find.open_rig) as bench:
        bench.order("open", rig="none:", camera=f"folder:{tethered}")
        assert bench.state.camera is not None
        assert not bench.state.camera.sets_exposure
        bench.send("preview", shutter=None, iso=None, aperture=None)
        ask = bench.until(lambda state: state.ask).ask
        assert ask is not None
        assert not ask.confirm
        assert str(tethered) in ask.text
        shutil.copy(taken / "a.dng", tethered)
        state = bench.until(lambda state: state.picture)
        bench.until(lambda state: not state.order)
        assert state.told is None
        assert bench.state.ask is None
        assert (tethered / "a.dng").is_file()


def test_leaving_in_the_midst_of_a_move_stops_the_rig(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        table = in_mid_move(bench)
    assert table.stops
    assert table.status().state is State.OFFLINE


def test_a_session_that_was_not_captured_cannot_be_resumed(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        state = bench.order("resume", **resume(tmp_path / "nothing"))
        assert state.told is not None
        assert "no capture to resume" in state.told.trouble.what
        assert state.ended is None


def test_the_newest_of_a_kind_replaces_what_waits_and_the_last_is_always_done() -> None:
    begun, go_on = threading.Event(), threading.Event()
    done: list[str] = []
    newest = Newest("test", pause_s=60.0)

    def first() -> None:
        begun.set()
        go_on.wait(10)
        done.append("first")

    newest.put("a", first)
    assert begun.wait(10)
    for name in ("lost", "last"):
        newest.put("a", lambda name=name: done.append(name))
    newest.put("b", lambda: done.append("other"))
    go_on.set()
    newest.close()
    assert done == ["first", "last", "other"]
