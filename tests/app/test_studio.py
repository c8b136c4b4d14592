"""`roomlight simulate` through the command line, with a bare room and a coarse object: what it writes, what it refuses."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app import studio
from app.cli import main
from engine.io import session as sessions
from engine.io.ground_truth import read_truth
from engine.io.raw import read_mosaic
from hardware.virtual import sensor
from hardware.virtual.studio import meshes, objects, rooms, samples, solids, tracer
from hardware.virtual.studio.interior import gather
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.rooms import Panel, Room, Sheet
from hardware.virtual.studio.shoot import View
from tests.app.calls import digest, refused
from tests.hardware.virtual.studio.interior import scenes

SIDE_M = 3.0


def bare() -> Room:
    """Six mottled walls around the middle, a glowing sheet under the ceiling."""
    paint = np.random.default_rng(0).uniform(0.3, 0.7, (8, 8, 3)).astype(np.float32)
    centre = np.array([0.0, 0.0, SIDE_M / 2])
    walls = []
    for inwards in (*np.eye(3), *-np.eye(3)):
        right, down = np.roll(inwards, 1), np.cross(np.roll(inwards, 1), inwards)
        corner = centre - SIDE_M / 2 * (inwards + right + down)
        walls.append(Panel(corner, SIDE_M * right, SIDE_M * down, paint))
    glow = np.full((2, 2, 3), 5.0, np.float32)
    lamp = Sheet(
        np.array([-0.5, -0.5, SIDE_M - 0.05]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), glow
    )
    return Room("window", tuple(walls), (), (lamp,), centre)


def ball() -> Body:
    solid = solids.ball(24, lambda directions: np.full(len(directions), 0.118))
    count = len(solid.vertices)
    return Body("sphere", solid, np.full((count, 3), 0.5), np.full(count, 0.5))


@pytest.fixture(autouse=True, scope="module")
def cheap(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Little to build, few paths, and a cache of this file's own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(rooms.ROOMS, "window", bare)
        patch.setitem(objects.OBJECTS, "sphere", ball)
        patch.setattr(samples, "PILOT", 4)
        patch.setattr(samples, "FEWEST", 4)
        patch.setattr(samples, "MOST", 8)
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def words(out: Path, **changes: object) -> list[str]:
    options = {
        "room": "window",
        "object": "sphere",
        "views": 3,
        "motion": "gimbal",
        "device": "cpu",
    } | changes
    named = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    return ["simulate", str(out), *named, "--size", "48", "36"]


@pytest.fixture(scope="module")
def made(cheap: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("simulated")
    assert main(words(out)) == 0
    return out


def test_a_session_of_brackets_and_the_truth_lie_side_by_side(made: Path) -> None:
    assert {path.name for path in made.iterdir()} == {"session", "truth"}
    session = sessions.open_session(made / "session")
    views = sessions.shots(session)
    assert [len(view.files) for view in views] == [3, 3, 3]
    assert session.facts["camera"]["width"] == 48
    assert session.facts["rig"]["kind"] == "gimbal"
    assert all(view.rig is not None and view.rig["kind"] == "gimbal" for view in views)
    truth = read_truth(made / "truth")
    assert truth.mask.shape == (36, 48)
    assert truth.cam_from_world is not None
    assert len(truth.cam_from_world) == len(list((made / "truth" / "panoramas").iterdir())) == 3
    assert not [path for path in (made / "session").rglob("*") if "truth" in path.name]


def test_the_same_order_takes_the_same_photographs(made: Path, tmp_path: Path) -> None:
    assert main(words(tmp_path)) == 0
    assert digest(tmp_path / "session" / "shots") == digest(made / "session" / "shots")
    assert digest(tmp_path / "truth") == digest(made / "truth")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"room": "cellar"}, "no room called 'cellar'; choose one of study"),
        ({"object": "bust"}, "no object called 'bust'; choose one of sphere"),
        ({"views": 0}, "0 views were asked for; at least 1"),
        ({"seed": -1}, "seed -1: a seed is a whole number >= 0"),
        ({"vignetting": 1.5}, "vignetting 1.5: it is the share of light lost"),
        ({"vignetting": "nan"}, "vignetting nan"),
    ],
)
def test_an_order_that_cannot_be_carried_out_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], changes: dict, told: str
) -> None:
    assert told in refused(capsys, *words(tmp_path, **changes))
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_never_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth").mkdir()
    assert "truth: exists already; choose another folder" in refused(capsys, *words(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["truth"]


def test_a_scene_file_and_a_mesh_make_a_session_and_say_what_was_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if not tracer.is_vectorised(tracer.load("cpu")):
        pytest.skip("no libLLVM here: rooms from files are refused")
    monkeypatch.setattr(gather, "QUALITY", gather.Quality(100, (4,) * 4, (4,)))
    monkeypatch.setattr(meshes, "DIVIDED_FACES", 20_000)
    inner = scenes.box(1.5, scenes.matte("0.5")) + scenes.lamp(1.4, 0.4, "5")
    room, thing = (
        scenes.scene(tmp_path / "box.xml", inner),
        scenes.ball(tmp_path / "ball.obj", inside_out=True),
    )
    assert main(words(tmp_path / "out", room=room, object=thing, material="clay", views=2)) == 0
    said = capsys.readouterr().out
    assert "the rig stands at --place" in said
    assert "inside out" in said
    assert len(sessions.shots(sessions.open_session(tmp_path / "out" / "session"))) == 2
    assert read_truth(tmp_path / "out" / "truth").mask.any()


def test_photographs_larger_than_what_is_drawn_have_noise_of_their_own(tmp_path: Path) -> None:
    view = View(0, np.eye(3, 4), np.full((8, 12, 3), 0.3), None)
    files, facts = studio._brackets([view], sensor.Sensor(), seed=0, enlarged=3)(view, tmp_path)
    counts = read_mosaic(files[1]).counts
    assert counts.shape == (24, 36)
    assert len(facts) == len(files) == 3
    green = counts[::2, 1::2].reshape(4, 3, 6, 3)
    assert green.std(axis=(1, 3)).min() > 0  # inside of what was one pixel
