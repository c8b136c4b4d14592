"""A given scale: only the export is to be made again, all that it writes has one unit, and every reader shows that one."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import plyfile
import pytest

from app import results
from app.cli import main
from app.inspect import charting, maps, readings, runs
from app.viewer import reading
from engine.errors import BusyError, SessionError, SurfaceError
from engine.geometry import project
from engine.io import scale_edit
from engine.io import session as sessions
from engine.io.scale_edit import ScaleBar
from engine.pipeline import artifacts, stage_functions, stage_table, stages
from engine.pipeline.settings import Settings
from engine.pipeline.stages import Work
from engine.progress import Progress
from engine.results.params import ExportParams
from tests.app import furnace
from tests.engine.ball import CENTRE, RADIUS

ENDS = [CENTRE + [side * 0.6 * RADIUS, 0, -0.8 * RADIUS] for side in (-1, 1)]
PX = [tuple(float(x) for x in project(furnace.CAMERA, end)) for end in ENDS]
SIZE = (furnace.CAMERA.width, furnace.CAMERA.height)
BY = 0.4  # metres per scene unit
BAR = ScaleBar((PX[0], PX[1]), SIZE, BY * 1.2 * RADIUS)
CLOSE = {"rel": 5e-3}  # to the grid of the maps


@pytest.fixture
def session(tmp_path: Path) -> sessions.Session:
    made = sessions.create(
        tmp_path / "a.session", "linear", {"make": "", "model": "", "width": SIZE[0], "height": SIZE[1]}
    )
    furnace.finished(made.folder)
    return made


def plan(session: sessions.Session) -> dict[str, stages.Step]:
    return {step.stage.name: step for step in stages.plan(session, stage_table.stages(), Settings())}


@pytest.fixture(autouse=True)
def little_panorama(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light has no unit of length."""
    monkeypatch.setattr(stage_functions, "PANORAMA_ROWS", 32)


def exported(session: sessions.Session, to: Path) -> Path:
    places = {"hdr": "hhhh", "segment": "ssss", "poses": "pppp", "surface": "aaaa"}
    to.mkdir()

    def load(stage: str, name: str, kind: type):
        return artifacts.load(session.folder / "stages" / stage / places[stage], name, kind)

    stage_functions.export(Work(session, ExportParams(), 0, "cpu", to, False, load, Progress()))
    return to


def test_the_export_alone_is_made_again_and_removing_the_scale_finds_the_earlier_one(
    session: sessions.Session,
) -> None:
    before = plan(session)
    step = before["export"]
    step.folder.mkdir(parents=True)
    params = stages.counted_params(step.stage, step.params, 0, False)
    record = {"version": step.stage.version, "params": params, "inputs": dict(step.inputs), "finished": 2e9}
    (step.folder / "record.json").write_text(json.dumps(record))
    scale_edit.write(session, BAR)
    after = plan(session)
    assert after["export"].reasons == ("scale changed",)
    assert {name for name in after if after[name].fingerprint != before[name].fingerprint} == {"export"}
    scale_edit.write(session, None)
    assert plan(session)["export"].done


def test_all_that_is_exported_is_in_metres(session: sessions.Session, tmp_path: Path) -> None:
    plain = exported(session, tmp_path / "plain")
    scale_edit.write(session, BAR)
    scaled = exported(session, tmp_path / "scaled")
    units, depths, points, places = [], [], [], []
    for folder in (plain, scaled):
        units.append(json.loads((folder / "export.json").read_text())["unit_of_length"])
        depths.append(maps_depth(folder / "maps.exr"))
        vertices = plyfile.PlyData.read(str(folder / "surface.ply"))["vertex"]
        points.append(np.stack([vertices[axis] for axis in "xyz"], -1))
        places.append(plyfile.PlyData.read(str(folder / "light.ply"))["vertex"]["x"])
    assert units == ["unknown", "metre"]
    for one, other in (depths, points, places):
        ratio = other[one != 0] / one[one != 0]
        assert ratio == pytest.approx(BY, **CLOSE)
    assert np.ptp(points[1][:, 0]) == pytest.approx(np.ptp(points[0][:, 0]) * BY, **CLOSE)


def pretend_done(session: sessions.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but the export are up to date."""
    run = runs.runs_of(session.folder)[0]
    steps = tuple(
        step if name == "export" else replace(step, folder=run.folder(name), done=True)
        for name, step in plan(session).items()
    )
    monkeypatch.setattr(results, "steps_of", lambda folder: steps)


def maps_depth(path: Path) -> np.ndarray:
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        return np.array(file.channels()["depth.Z"].pixels)


def test_no_two_numbers_for_one_length(
    session: sessions.Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scale_edit.write(session, BAR)
    run = runs.runs_of(session.folder)[0]
    shown = maps.load(run)
    x, y = SIZE[0] // 2, SIZE[1] // 2
    (depth,) = (one for one in readings.under(shown, x, y, 0, "opengl") if one.title == "Depth")
    true_mm = 1000 * BY * float(furnace.surface().depth[y, x])
    assert (float(depth.text), depth.unit) == (pytest.approx(true_mm, **CLOSE), "mm")
    assert charting.distance(run, shown).facts["value"].startswith(f"{800 * shown.unit_factor / 1000:.4g}")
    found = reading.read(session.folder)
    assert found.poses is not None
    assert found.poses.metric
    assert found.surface is not None
    assert found.surface.depth[y, x] == pytest.approx(true_mm / 1000, **CLOSE)
    pretend_done(session, monkeypatch)
    shots = [SimpleNamespace(name=f"view{i:02d}", exposures=()) for i in range(furnace.VIEWS)]
    monkeypatch.setattr(results.sessions, "shots", lambda session: shots)
    page = results.write_report(session.folder, tmp_path / "report.html").read_text()
    (told,) = re.findall(r"<b>([\d.]+) m ± 0\.004", page)
    assert float(told) == pytest.approx(0.8 * BY, **CLOSE)
    assert "Depth</b> along the viewing axis, metres" in page
    assert "scene unit" not in page
    assert not [line for line in results.cautions(session.folder) if "scene unit" in line]


def test_a_scale_that_determines_nothing_makes_no_export_and_no_length(
    session: sessions.Session, tmp_path: Path
) -> None:
    scale_edit.write(session, ScaleBar((PX[0], (0.5, 0.5)), SIZE, 0.1))
    with pytest.raises(SurfaceError, match=r"edits/scale\.json: .* is off the object; choose two points"):
        exported(session, tmp_path / "made")
    assert not list((tmp_path / "made").iterdir())
    assert maps.load(runs.runs_of(session.folder)[0]).unit == "scene units"


@pytest.mark.parametrize(
    "content", ["[", "{}", '{"points": [[1, 2], [3, 4]], "size": [40, 30], "length_m": 0}']
)
def test_a_damaged_scale_is_one_line_with_a_remedy(session: sessions.Session, content: str) -> None:
    (session.folder / "edits" / scale_edit.FILE).write_text(content)
    with pytest.raises(SessionError, match=r"scale\.json: cannot be read .*; remove it and give the scale"):
        scale_edit.read(session.folder)


def test_inputs_do_not_change_under_a_run_nor_to_what_is_no_scale(session: sessions.Session) -> None:
    with sessions.lock(session), pytest.raises(BusyError, match="is working on this session"):
        scale_edit.write(session, BAR)
    with pytest.raises(SessionError, match="off the picture of 40 x 30"):
        scale_edit.write(session, ScaleBar(((41.0, 2.0), PX[1]), SIZE, 0.1))
    with pytest.raises(SessionError, match="a length of 0 mm fixes no scale"):
        scale_edit.write(session, ScaleBar(BAR.points, SIZE, 0.0))
    assert scale_edit.read(session.folder) is None


def test_the_command_line_takes_upright_pixels_and_a_length(session: sessions.Session, capsys) -> None:
    """No photograph is in this session: the run itself ends in words."""
    order = ["process", str(session.folder), "--until", "hdr", "--scale"]
    sessions.describe(session, {**session.facts["camera"], "orientation": 6})
    main([*order, "1,2,25.5,39=15cm"])
    assert "scale: 150 mm from 1, 2 to 25.5, 39" in capsys.readouterr().out
    assert scale_edit.read(session.folder) == ScaleBar(((1.0, 2.0), (25.5, 39.0)), (30, 40), 0.15)
    with pytest.raises(SystemExit):
        main([*order, "1,2,25=15"])
    assert "write X,Y,X,Y=LENGTH" in capsys.readouterr().err
    main([*order, "none"])
    assert scale_edit.read(session.folder) is None


def test_the_command_line_refuses_a_point_off_the_surface_that_is_there(
    session: sessions.Session, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    pretend_done(session, monkeypatch)
    order = ["process", str(session.folder), "--until", "hdr", "--scale"]
    assert main([*order, "0.5,0.5,25.5,15.5=15cm"]) == 2
    assert "0.5, 0.5 (of 40 x 30) is off the object; choose two points" in capsys.readouterr().err
    assert scale_edit.read(session.folder) is None
    main([*order, "14.5,15.5,25.5,15.5=15cm"])
    assert scale_edit.read(session.folder) is not None
