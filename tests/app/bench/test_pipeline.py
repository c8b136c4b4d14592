"""The bench of all stages: what starting costs is told apart, poses are held against the truth, ratios alone are gated."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app.bench import pipeline, pipeline_chart, record
from app.bench.pipeline import Part, Way
from app.bench.record import BenchError
from app.cli import main
from engine.pipeline import artifacts
from engine.types import Camera, Poses

STAGES = ("hdr", "poses", "light")


def true_poses() -> np.ndarray:
    poses = np.tile(np.eye(3, 4), (5, 1, 1))
    poses[:, :, 3] = np.random.default_rng(0).normal(size=(5, 3))
    return poses


def way(name: str, *parts: tuple[str, float]) -> Way:
    return Way("small", name, tuple(Part(part, seconds, 2 * seconds, 10**9) for part, seconds in parts))


OURS = way("process", ("hdr", 1.0), ("poses", 6.0), ("light", 3.0))
THEIRS = replace(
    way("colmap exhaustive", ("features", 4.0), ("matching", 4.0), ("mapping", 4.0)), registered_share=1.0
)


def test_a_stages_seconds_are_its_own_and_what_starting_took(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran: list[str] = []

    def child(words: Sequence[str], name: str) -> tuple[float, float, str]:
        stage = words[words.index("--until") + 1]
        folder = tmp_path / "stages" / stage / "print"
        folder.mkdir(parents=True)
        ran.append(stage)
        (folder / "record.json").write_text(json.dumps({"seconds": 4.0, "peak_memory_bytes": 7}))
        if stage == "poses":
            found = 3 * true_poses() * [[[1 / 3, 1 / 3, 1 / 3, 1]]]  # the same rotations, another unit
            lens = Camera(8, 6, 10.0, 10.0, 4.0, 3.0)
            poses = Poses(lens, found, np.ones(5, bool), np.zeros((0, 3)), "unknown", 0.1)
            artifacts.save(folder, "poses", poses)
        return 5.0, 9.0, ""

    monkeypatch.setattr(pipeline, "_child", child)
    monkeypatch.setattr(pipeline, "read_truth", lambda _: SimpleNamespace(cam_from_world=true_poses()))
    found = pipeline.ours("small", tmp_path, tmp_path, STAGES, ["--preset", "draft"])
    assert ran == list(STAGES)
    assert found.parts[0] == Part("hdr", 5.0, 9.0, 7, 1.0)
    assert found.seconds == 15.0
    assert found.registered_share == 1
    assert found.rotation_deg == pytest.approx(0, abs=1e-6)
    assert found.position_percent == pytest.approx(0, abs=1e-6)


def test_a_stage_that_fails_says_why() -> None:
    with pytest.raises(BenchError, match=r"small hdr failed: .*no\.session"):
        pipeline._child([*pipeline.THIS, "plan", "no.session"], "small hdr")


def test_only_the_ratio_to_colmap_is_gated() -> None:
    failed = replace(THEIRS, name="colmap sequential", registered_share=0.04)
    metrics = {metric.key: metric for metric in pipeline.as_metrics([OURS, THEIRS, failed])}
    assert metrics["small/process/poses/seconds"].tolerance is None
    ratio = metrics["small/poses-in-colmap-exhaustive"]
    assert (ratio.value, ratio.direction) == (0.5, "lower")
    assert [metric.key for metric in metrics.values() if metric.tolerance is not None] == [ratio.key]


def test_another_release_is_held_against_stage_by_stage(tmp_path: Path) -> None:
    old = replace(
        way("process of /old/roomlight", ("hdr", 2.0), ("poses", 4.0), ("light", 3.0)), registered_share=1.0
    )
    ratios = {metric.key: metric.value for metric in pipeline.as_metrics([old, OURS]) if metric.unit == "1"}
    shown = "process-of-/old/roomlight"
    assert ratios == {
        f"small/hdr-in-{shown}": 0.5,
        f"small/poses-in-{shown}": 1.5,
        f"small/light-in-{shown}": 1.0,
    }


def test_a_program_that_is_not_there_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "pipeline", "--beside", "colmap", "no/such/roomlight"]) == 2
    assert "--beside no/such/roomlight: no such program; give colmap" in capsys.readouterr().err


def test_the_command_measures_draws_and_leaves_no_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "pipeline.session"
    session.mkdir()
    monkeypatch.setattr(pipeline, "photographs", lambda *_: (session, tmp_path))
    monkeypatch.setattr(pipeline, "ours", lambda *_: OURS)
    monkeypatch.setattr(pipeline, "colmap", lambda size, route, *_: THEIRS)
    words = [
        "--sizes",
        "small",
        "--views",
        "20",
        "--beside",
        "colmap",
        "--device",
        "cpu",
        "--sets",
        tmp_path,
        "--out",
        tmp_path,
    ]
    assert main(["bench", "pipeline", *map(str, words), "--json", str(tmp_path / "record.json")]) == 0
    measured = record.read(tmp_path / "record.json")
    assert "small 20 x 320 x 240" in measured.inputs
    assert {metric.unit for metric in measured.metrics} == {"s", "bytes", "1"}
    assert "| small | process" in " ".join(capsys.readouterr().out.split())
    assert (tmp_path / "pipeline.png").stat().st_size > 5000
    assert (tmp_path / "pipeline.csv").read_text().splitlines()[1] == "small,process,hdr,1,0,2,1000000000"
    assert not session.exists()


def test_fewer_views_than_are_solved_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "pipeline", "--views", "7"]) == 2
    assert "--views 7: stage surface wants 8 at least" in capsys.readouterr().err


def test_a_chart_has_a_panel_a_size_and_a_bar_a_part() -> None:
    figure = pipeline_chart.draw([OURS, THEIRS], "caption")
    (axes,) = figure.axes
    assert [bar.get_width() for bar in axes.patches] == [1, 6, 3, 4, 4, 4]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["process", "colmap exhaustive"]
