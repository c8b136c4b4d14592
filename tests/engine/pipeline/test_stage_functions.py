"""The stages' own work beyond their rooms': what export takes from which stage."""

import json
from pathlib import Path

import numpy as np
import plyfile
import pytest

from engine.errors import PoseError
from engine.io import session as sessions
from engine.light.fitting.lamp_model import with_lamps
from engine.light.gaussians.gaussians import from_3dgs
from engine.pipeline import artifacts, stage_functions
from engine.pipeline.stages import Work
from engine.progress import Progress
from engine.results.params import ExportParams
from engine.sfm.params import PoseParams
from engine.types import Emitters, Frames, Lamps
from tests.app import furnace


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        '{"camera": {"width": 4}}',
        '{"camera": {"width": 1, "height": 6, "fx": 9.0, "fy": 9.0, "cx": 4.0, "cy": 3.0}}',
        '{"camera": {"width": 8, "height": 6, "fx": 9.0, "fy": 9.0, "cx": 4.0, "cy": 3.0}, "views": []}',
        '{"camera": {"width": 8, "height": 6, "fx": 9.0, "fy": 9.0, "cx": 4.0, "cy": 3.0}, "views": {"a": [1]}}',
    ],
)
def test_given_poses_that_are_damaged_are_one_line_with_a_remedy(tmp_path: Path, content: str) -> None:
    session = sessions.create(tmp_path / "a.session", "linear", {"width": 8, "height": 6})
    (session.folder / "edits" / "poses.json").write_text(content)
    dark = np.zeros((1, 6, 8), bool)
    frames = Frames(("a",), np.zeros((1, 6, 8, 3), np.float32), dark, dark, (0.01, 0.1))
    given = Work(session, PoseParams(), 0, "cpu", tmp_path, True, lambda *_: frames, Progress())
    with pytest.raises(
        PoseError, match=r"edits/poses\.json: cannot be read .*; import the poses again, or remove"
    ):
        stage_functions.poses(given)


def test_given_poses_are_checked_and_keep_the_points_they_came_with(tmp_path: Path, monkeypatch) -> None:
    session = sessions.create(tmp_path / "a.session", "linear", {"width": 8, "height": 6})
    pose = np.eye(4)[:3].tolist()
    camera = {"width": 8, "height": 6, "fx": 9.0, "fy": 9.0, "cx": 4.0, "cy": 3.0}
    dark = np.zeros((1, 6, 8), bool)
    frames = Frames(("a",), np.zeros((1, 6, 8, 3), np.float32), dark, dark, (0.01, 0.1))
    monkeypatch.setattr(
        "engine.sfm.triangulate.triangulate", lambda *_: (np.ones((4, 3)), "what the photographs say")
    )
    for number, points in enumerate([[[1.0, 2.0, 3.0]], []]):
        content = {"camera": camera, "views": {"a": pose}, "points": points, "scale": "given", "notes": []}
        (session.folder / "edits" / "poses.json").write_text(json.dumps(content))
        folder = tmp_path / str(number)
        folder.mkdir()
        records = stage_functions.poses(
            Work(session, PoseParams(), 0, "cpu", folder, True, lambda *_: frames, Progress())
        )
        assert records["report"] == "what the photographs say"
        np.testing.assert_array_equal(records["poses"].points, points or np.ones((4, 3)))


def test_an_export_holds_the_light_as_the_surface_found_it(tmp_path: Path) -> None:
    session = furnace.finished(tmp_path / "session")
    sessions.create(tmp_path / "empty", "linear", {"make": "", "model": "", "width": 40, "height": 30})
    gaussians, _ = furnace.room()
    overhead = gaussians.means[:, 1] < -0.7 * furnace.ROOM  # y is down
    gaussians.radiance[overhead] *= 6
    lamp = Lamps(np.array([[0, 0, 2.5]]), np.array([0.1]), np.full((1, 3), 9.0), np.array([True]))
    whole = with_lamps(gaussians, lamp)
    artifacts.save(session / "stages" / "surface" / "aaaa", "emitters", Emitters(whole, lamp, 0))
    places = {"hdr": "hhhh", "segment": "ssss", "poses": "pppp", "surface": "aaaa"}

    def load(stage: str, name: str, kind: type):
        return artifacts.load(session / "stages" / stage / places[stage], name, kind)

    to = tmp_path / "made"
    to.mkdir()
    opened = sessions.open_session(tmp_path / "empty")
    records = stage_functions.export(Work(opened, ExportParams(), 0, "cpu", to, False, load, Progress()))
    top = records["panorama"].radiance[:8]
    assert 5.7 * furnace.GLOW < np.median(top) < 6.3 * furnace.GLOW
    (written,) = to.rglob("light.ply")
    vertices = plyfile.PlyData.read(str(written))["vertex"]
    back = from_3dgs({item.name: vertices[item.name] for item in vertices.properties})
    np.testing.assert_allclose(back.radiance, whole.radiance, rtol=1e-4)
    (listed,) = to.rglob("lamps.json")
    assert json.loads(listed.read_text())["lamps"][0]["radiance"] == [9.0] * 3
