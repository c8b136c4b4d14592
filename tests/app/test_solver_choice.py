"""`roomlight process --solver reference`: the paper's solver on a small session, and all that reads its results."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from app import results
from app.cli import main
from app.inspect import runs
from app.inspect.rerendering import open_run
from engine.errors import SessionError
from engine.io import session as sessions
from engine.pipeline import artifacts, stage_table, stages
from engine.pipeline import settings as asked
from engine.pipeline.settings import Settings
from engine.reference.params import ReferenceParams, scaled, title
from engine.types import Surface
from tests.app import furnace
from tests.app.calls import refused
from tests.engine.folders import write_exr

FEW = [
    word
    for setting in ("samples=8", "epochs=2", "pixels=40", "object_distance=1.0")
    for word in ("--set", f"surface.{setting}")
]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball in an even room, processed up to its light, which is given."""
    folder = tmp_path_factory.mktemp("choice")
    shape, placed = furnace.surface(), furnace.poses()
    pictures, made = folder / "renders", folder / "a.session"
    pictures.mkdir()
    frames = furnace.photographs(shape)
    for name, radiance in zip(frames.names, frames.radiance, strict=True):
        write_exr(pictures / f"{name}.exr", radiance)
    cv2.imwrite(str(folder / "mask.png"), 255 * shape.mask.astype(np.uint8))
    assert main(["import", str(pictures), str(made), "--mask", str(folder / "mask.png")]) == 0
    names = [shot.name for shot in sessions.shots(sessions.open_session(made))]
    views = dict(zip(names, placed.cam_from_world.tolist(), strict=True))
    content = {"camera": asdict(furnace.CAMERA), "views": views, "points": [], "scale": "given"}
    (made / "edits" / "poses.json").write_text(json.dumps(content))
    assert main(["process", str(made), "--until", "poses", "--device", "cpu"]) == 0
    (light,) = (step for step in planned(made, Settings()) if step.stage.name == "light")
    light.folder.mkdir(parents=True)
    gaussians, lamps = furnace.room()
    artifacts.save(light.folder, "gaussians", gaussians)
    artifacts.save(light.folder, "lamps", lamps)
    record = {"version": light.stage.version, "params": {}, "inputs": {}, "finished": 1.0, "seconds": 1.0}
    artifacts.save_json(light.folder / "record.json", record | {"device": "cpu", "stage": "light"})
    np.savez(
        folder / "truth.npz",
        **{name: getattr(shape, name) for name in ("normal", "albedo", "roughness", "depth", "mask")},
    )
    assert main(["process", str(made), "--solver", "reference", *FEW, "--device", "cpu"]) == 0
    return made


def planned(session: Path, settings: Settings) -> tuple[stages.Step, ...]:
    return stages.plan(sessions.open_session(session), stage_table.stages(settings.solver), settings)


def test_its_results_are_exported_reported_and_evaluated(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(session), "--to", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "maps.exr").is_file()
    assert main(["report", str(session), "--to", str(tmp_path / "report.html")]) == 0
    page = (tmp_path / "report.html").read_text()
    assert "reference at 8 samples, 2 epochs" in page
    assert "seconds_per_sample" in page
    capsys.readouterr()
    assert main(["evaluate", str(session), str(session.parent / "truth.npz"), "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)["surface"]
    assert scores["unanswered_pixels"] == scores["truth_pixels"] - 40
    # An even room tells no normals: what is asked is the score of what was solved, not that it is good.
    shape = artifacts.load(results.finished(session, "surface").folder, "surface", Surface)
    true = np.load(session.parent / "truth.npz")
    both = shape.mask & true["mask"]
    cosine = (shape.normal[both] * true["normal"][both]).sum(-1)
    error = np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()
    assert scores["normal_mean_deg"] == pytest.approx(error, rel=1e-3)
    assert error < 90  # all of them face the camera, as the ball does


def test_the_choice_is_kept_and_planned_with_its_own_parameters(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["plan", str(session)]) == 0
    assert all(line.split()[2] == "done" for line in capsys.readouterr().out.splitlines())
    assert main(["plan", str(session), "--set", "surface.samples=16"]) == 0
    assert "params.samples 8 -> 16" in capsys.readouterr().out
    assert "no parameter 'directions'" in refused(capsys, "plan", session, "--set", "surface.directions=64")


def test_another_solver_has_another_fingerprint_and_drops_the_old_ones_parameters(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = asked.from_toml(sessions.read_params(sessions.open_session(session)))
    back = asked.with_changes(kept, None, None, [], "transport")
    assert kept.solver == "reference"
    assert back == Settings()
    prints = [{step.stage.name: step.fingerprint for step in planned(session, s)} for s in (kept, back)]
    assert [name for name in prints[0] if prints[0][name] != prints[1][name]] == ["surface", "export"]
    capsys.readouterr()
    assert main(["plan", str(session), "--solver", "transport"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[3].endswith("done")
    assert lines[4].endswith("will run because another method, with other parameters")


def test_a_preset_of_params_toml_from_before_there_was_a_choice_is_ours() -> None:
    assert asked.to_toml(asked.from_toml({"preset": "draft", "seed": 1})) == {"preset": "draft", "seed": 1}
    assert asked.from_toml({}).solver == "transport"
    with pytest.raises(SessionError, match="solver 'montecarlo' is unknown"):
        asked.from_toml({"solver": "montecarlo"})


def test_a_cut_short_preset_of_the_papers_solver_says_so_and_the_others_are_as_published(
    session: Path,
) -> None:
    asked_for = {
        preset: next(
            step.params
            for step in planned(session, Settings(preset, solver="reference"))
            if step.stage.name == "surface"
        )
        for preset in asked.PRESETS
    }
    assert asked_for["standard"] == asked_for["fine"] == ReferenceParams()
    assert asked_for["draft"] == replace(scaled(64, 25), emitter_share=0.1)
    assert title(asked_for["draft"]) == "reference at 64 samples, 25 epochs"


def test_its_light_may_be_its_own_and_another_is_refused(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["plan", str(session), "--set", "surface.emitter=one_stage"]) == 0
    assert "params.emitter ours -> one_stage" in capsys.readouterr().out
    said = refused(capsys, "plan", session, "--set", "surface.emitter=three_stage")
    assert "choose ours, two_stage, one_stage" in said


def test_its_views_are_not_rendered_anew_and_that_is_said(session: Path) -> None:
    (run,) = runs.runs_of(session)
    with pytest.raises(SessionError, match="reference solver made this result"):
        open_run(run)
