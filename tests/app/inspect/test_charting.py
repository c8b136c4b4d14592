"""The charts hold the numbers of the stages' records, with their units."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.inspect import charting, maps, runs
from app.relight.lights import Light, coverage_file, load
from engine.errors import SessionError, TruthError
from engine.io.ground_truth import Truth
from tests.app import furnace


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """Two runs; the older took less time and has the larger error."""
    furnace.finished(tmp_path, "newer", 2e9)
    furnace.finished(tmp_path, "older", 1e9)
    for name, seconds, error in (("newer", 10.0, 0.1), ("older", 5.0, 0.2)):
        folder = tmp_path / "stages" / "surface" / name
        record, report = (json.loads((folder / f"{part}.json").read_text()) for part in ("record", "report"))
        record["seconds"], report["values"]["held_out_error"] = seconds, error
        (folder / "record.json").write_text(json.dumps(record))
        (folder / "report.json").write_text(json.dumps(report))
    return tmp_path


def test_errors_stand_against_the_time_of_all_stages(session: Path) -> None:
    chart = charting.errors(runs.runs_of(session), "held_out_error")
    (series,) = chart.series
    assert series.x == (15.0, 20.0)  # from left to right, though the newest run comes first
    assert series.y == pytest.approx((20.0, 10.0))
    assert "[% of the radiance]" in chart.y_label
    assert "[s]" in chart.x_label
    assert len(series.labels) == 2


def test_a_run_that_does_not_tell_is_left_out(session: Path) -> None:
    (session / "stages" / "surface" / "newer" / "report.json").unlink()
    chart = charting.errors(runs.runs_of(session), "residual")
    assert chart.series[0].y == (1.5,)
    (session / "stages" / "surface" / "older" / "report.json").unlink()
    assert charting.errors(runs.runs_of(session), "residual").missing


def test_the_truth_gives_the_error_of_the_normals(session: Path) -> None:
    found = runs.runs_of(session)
    s = furnace.surface()
    angle = np.radians(4.0)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    same = Truth(s.normal, s.albedo, s.roughness, s.depth, s.mask)
    turned = replace(same, normal=s.normal @ turn.T)
    assert charting.errors(found, "truth", same).series[0].y == pytest.approx((0, 0), abs=1e-3)
    assert charting.errors(found, "truth", turned).series[0].y == pytest.approx((3.8, 3.8), abs=0.3)
    assert "choose one" in charting.errors(found, "truth").missing
    small = Truth(*(getattr(same, name)[:-2] for name in ("normal", "albedo", "roughness", "depth", "mask")))
    with pytest.raises(TruthError, match="40 x 30 and 40 x 28"):
        charting.errors(found, "truth", small)


def test_the_truth_beside_a_simulated_session_is_known(tmp_path: Path) -> None:
    assert charting.known_truth(tmp_path / "session") is None
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "truth.npz").touch()
    assert charting.known_truth(tmp_path / "session") == tmp_path / "truth" / "truth.npz"


def test_the_stages_times_are_stacked(session: Path) -> None:
    chart = charting.stage_times(runs.runs_of(session))
    assert {series.name: series.y for series in chart.series} == {
        "Merge brackets": (2.0, 2.0), "Mask": (1.0, 1.0), "Poses": (3.0, 3.0), "Light": (4.0, 4.0), "Surface": (10.0, 5.0),
    }  # fmt: skip
    assert chart.stacked
    assert len(chart.ticks) == 2


def test_each_views_residual_is_that_of_its_pixels(session: Path) -> None:
    shown = maps.load(runs.runs_of(session)[0])
    shown.rerendered.mkdir(parents=True)
    assert shown.frames is not None
    true = shown.frames.radiance[4][shown.surface.mask]
    np.save(shown.rerendered / "0004.npy", (0.7 * true).astype(np.float32))
    chart = charting.view_residuals(shown)
    fitted, kept_out = chart.series
    assert fitted.x == (4.0,)
    assert fitted.y == pytest.approx((30.0,), abs=0.01)
    assert kept_out.x == tuple(map(float, furnace.HELD_OUT))
    assert kept_out.y == pytest.approx((10.0, 10.0), abs=0.01)
    assert fitted.upper[0] >= fitted.y[0]
    assert chart.facts == {"known": 3, "registered": furnace.VIEWS}
    assert chart.lacking


def test_the_search_for_the_distance_is_shown_in_the_runs_unit(session: Path) -> None:
    run = runs.runs_of(session)[0]
    shown = replace(maps.load(run), unit="mm", unit_factor=1000.0)
    chart = charting.distance(run, shown)
    curve, mark = chart.series
    assert curve.x == pytest.approx((400.0, 800.0, 1600.0))
    assert curve.y == (9.0, 2.0, 7.0)
    assert mark.x == pytest.approx((800.0,))
    assert "[mm]" in chart.x_label
    assert chart.said.format(**chart.facts).startswith(
        "Camera to object along the viewing axis: 800 mm \u00b1 1.2 %"
    )
    report = session / "stages" / "surface" / run.fingerprint / "report.json"
    content = json.loads(report.read_text())
    content["values"]["distance"] = {
        "value": 0.8,
        "stderr": 0.0,
        "source": "given",
        "tried": [],
        "misfit": [],
    }
    report.write_text(json.dumps(content))
    assert "given" in charting.distance(run, shown).missing


def test_settling_and_exposures_follow_the_records(session: Path) -> None:
    run = runs.runs_of(session)[0]
    assert charting.settling(run).series[0].y == (3.0, 1.5)
    shown = maps.load(run)
    assert shown.frames is not None
    clipped = np.zeros_like(shown.frames.clipped)
    clipped[3, :15] = True
    chart = charting.exposures(replace(shown, frames=replace(shown.frames, clipped=clipped)))
    assert chart.series[0].y[3] == pytest.approx(50.0)
    assert sum(chart.series[0].y) == pytest.approx(50.0)


def half_seen() -> Light:
    """The lower half was never photographed; all within 45 degrees of up, four times as bright, only clipped."""
    seen = np.zeros((32, 64), np.float32)
    seen[:16] = 1
    clipped = np.zeros((32, 64), bool)
    clipped[:8] = True
    radiance = np.where(clipped[..., None], 4.0, 1.0) * np.ones(3, np.float32)
    return Light("view07", radiance.astype(np.float32), seen, clipped)


def test_coverage_is_counted_by_solid_angle_and_by_energy() -> None:
    shares = half_seen().shares()
    cap = (1 - np.sqrt(0.5)) / 2  # of the sphere within 45 degrees
    whole = 0.5 + 4 * cap + (0.5 - cap)
    assert shares["guessed"] == pytest.approx((0.5, 0.5 / whole), abs=1e-3)
    assert shares["only clipped"] == pytest.approx((cap, 4 * cap / whole), abs=1e-3)
    assert shares["photographed"] == pytest.approx((0.5 - cap, (0.5 - cap) / whole), abs=1e-3)
    chart = charting.coverage(half_seen())
    assert sum(series.y[0] for series in chart.series) == pytest.approx(100)
    assert chart.image is not None
    assert charting.coverage(None).lacking


def test_clipped_light_is_red_and_a_guess_hatched() -> None:
    picture = half_seen().picture(scale=2)
    blue, green, red = (picture[10, 10, c] for c in range(3))
    assert red > 200 > green > blue - 30
    lower = picture[40:, :, :3].reshape(-1, 3)
    assert len(np.unique(lower, axis=0)) == 2  # the dimmed guess and the hatching


def test_coverage_is_read_back_and_a_damaged_file_is_told(session: Path) -> None:
    run = runs.runs_of(session)[0]
    assert load(run) is None
    path = coverage_file(run)
    path.parent.mkdir(parents=True)
    light = half_seen()
    np.savez(path, radiance=light.radiance, seen=light.seen, clipped=light.clipped, view=np.array(light.view))
    read = load(run)
    assert read is not None
    assert read.shares() == light.shares()
    path.write_bytes(b"PK half")
    with pytest.raises(SessionError, match="damaged"):
        load(run)


def test_a_charts_numbers_come_out_as_csv(session: Path) -> None:
    chart = charting.stage_times(runs.runs_of(session))
    rows = list(csv.reader(io.StringIO(charting.as_csv(chart))))
    assert rows[0] == ["series", "place", "time [s]", "upper", "label"]
    assert len(rows) == 1 + 5 * 2
    assert rows[-1][0] == "Surface"
    assert rows[-1][1] == chart.ticks[1.0]
    assert float(rows[-1][2]) == 5.0
