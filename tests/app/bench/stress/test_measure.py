"""A worse capture goes through light and surface once; what refuses it is its answer."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.bench.alike import alike
from app.bench.rows import Answer, Method
from app.bench.sizes import SIZES
from app.bench.stored import Stored
from app.bench.stress import measure as measuring
from app.bench.stress.measure import CLEAN, measure
from engine.errors import Cancelled, LightError
from engine.progress import Progress
from tests.app.bench.synthetic import a_set, leaning, method


@dataclass(frozen=True, slots=True)
class Report:
    """What a stage says of itself."""

    held_out_error: float = 0.5
    stderr_normal_deg: float = 1.0
    distance: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(value=0.5))


def a_call(folder: Path, fresh: bool = False) -> Any:
    args = SimpleNamespace(preset="draft", seed=0, fresh=fresh)
    return SimpleNamespace(args=args, device="cpu", folder=folder, size=SIZES["tiny"])


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of views of all fits; fewer than ten are refused."""
    counts: list[int] = []

    def fit(frames: Any, masks: Any, poses: Any, params: Any, *rest: Any) -> Any:
        assert params.max_gaussians == SIZES["tiny"].settings["light"]["max_gaussians"]
        counts.append(len(frames.names))
        if len(frames.names) < 10:
            raise LightError("too few views; add some")
        stored = a_set().stored
        return stored.gaussians, stored.lamps, Report()

    monkeypatch.setattr(measuring.light_fit, "fit", fit)
    emitters = SimpleNamespace(gaussians=None, lamps=a_set().stored.lamps)
    solved = SimpleNamespace(surface=leaning(4.0), report=Report(), emitters=emitters)
    monkeypatch.setattr(measuring, "solve", lambda *asked: solved)
    return counts


def test_errors_and_the_verdict_are_those_of_the_answer_and_kept(tmp_path: Path, fits: list[int]) -> None:
    found = measure(a_call(tmp_path), a_set(), CLEAN, 0)
    assert found.normal_deg == pytest.approx(4, abs=1e-3)
    assert found.others == {}
    assert (found.in_50, found.in_95) == (0, 0)  # four degrees off, and less than one stated
    assert found.solved == 1
    assert (found.refused, found.grade) == ("", "not to be trusted")
    assert "by 50 %" in found.reason
    assert found.facts["segment.border_alike"] == 1  # its photographs are of one colour each
    assert measure(a_call(tmp_path), a_set(), CLEAN, 0) == found
    assert fits == [12]
    measure(a_call(tmp_path, fresh=True), a_set(), CLEAN, 0)
    measure(a_call(tmp_path), a_set(), "exposure", 2)
    assert fits == [12, 12, 12]


def test_others_are_held_against_ours_over_their_own_pixels(tmp_path: Path, fits: list[int]) -> None:
    mask = a_set().truth.mask
    tile = mask & (np.cumsum(mask).reshape(mask.shape) <= 16)

    def on_a_tile(given: Stored, device: str, seed: int, progress: Progress) -> Answer:
        assert alike(given, device, seed).distance == 0.5  # that of our own solve, which is not run again
        return Answer(leaning(6.0, tile), 900.0)

    others = (Method("reference", "", "reference", on_a_tile), method("nowhere", 2.0, 5.0))
    found = measure(a_call(tmp_path), a_set(), CLEAN, 0, others)
    theirs = found.others["reference"]
    assert theirs.normal_deg == pytest.approx(6, abs=1e-3)
    assert theirs.ours_deg == pytest.approx(4, abs=1e-3)
    assert theirs.roughness == pytest.approx(0.06, abs=1e-3)  # of the tile: what it left out is not charged
    assert theirs.solved == pytest.approx(16 / mask.sum())
    assert measure(a_call(tmp_path), a_set(), CLEAN, 0, others) == found
    measure(a_call(tmp_path), a_set(), CLEAN, 0, others[:1])  # other methods: another measurement
    assert fits == [12, 12]


def test_a_capture_that_is_refused_says_why(tmp_path: Path, fits: list[int]) -> None:
    for _ in range(2):
        found = measure(a_call(tmp_path), a_set(), "views", 5)
        assert found.refused == "too few views; add some"
        assert math.isnan(found.normal_deg)
        assert found.amount == 9
    assert fits == [9]


def test_a_stop_is_no_refusal_and_is_not_kept(
    tmp_path: Path, fits: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*asked: Any) -> Any:
        raise Cancelled("stopped")

    with monkeypatch.context() as patched:
        patched.setattr(measuring, "solve", stopped)
        with pytest.raises(Cancelled):
            measure(a_call(tmp_path), a_set(), CLEAN, 0)
    assert measure(a_call(tmp_path), a_set(), CLEAN, 0).refused == ""
