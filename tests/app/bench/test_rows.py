"""The rows beside ours: the same light and distance for all, and what a part of the pixels stands for."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.bench import alike, rows
from app.bench.alike import Alike, under
from app.bench.baselines.methods import BASELINES
from app.bench.record import BenchError
from app.bench.sizes import SIZES, Size
from app.bench.stored import Stored, fewer_pixels
from engine.light.gaussians.gaussians import Y00
from engine.progress import Progress
from engine.reference.params import ReferenceParams, scaled
from engine.surface.lighting.room_light import build_room_light
from engine.surface.params import SurfaceParams
from tests.engine.reference.lit_room import DISTANCE, lambert, scene

QUICK = SIZES["quick"]


@pytest.fixture(scope="module")
def lit() -> Stored:
    """A ball of which only so many pixels are asked for that the reference, which solves `FEW` of them, leaves half."""
    return fewer_pixels(Stored("f00d", *scene(lambert, views=10).given), 2 * rows.FEW)


def test_what_ours_found_of_a_lamp_is_in_the_lamp_and_in_its_gaussian(lit: Stored):
    room = build_room_light(lit.captured, SurfaceParams(), 0)
    assert len(lit.lamps.radii) > 0
    gain = np.ones((len(room.kind), 3))
    gain[-1] = [3.0, 2.0, 1.0]
    bright = under(lit, room.with_gains(gain))
    np.testing.assert_allclose(bright.lamps.radiance[-1], lit.lamps.radiance[-1] * [3, 2, 1])
    np.testing.assert_allclose(bright.gaussians.radiance[-1, 0] * Y00, bright.lamps.radiance[-1], rtol=1e-6)
    np.testing.assert_allclose(bright.gaussians.radiance[:-1], lit.gaussians.radiance[:-1], rtol=1e-6)
    assert not bright.lamps.clipped.any()


def test_a_part_of_the_pixels_is_told_as_the_whole(lit: Stored, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rows, "alike", lambda stored, device, seed: Alike(stored, DISTANCE))
    answer = rows.reference(scaled(2, 1), replace(QUICK, reference_work=1), rows.FEW).solve(
        lit, "cpu", 0, Progress()
    )
    whole = int(lit.masks.object.sum())
    assert answer.surface.mask.sum() == rows.FEW < whole
    assert answer.extrapolated
    assert answer.rendered > 0
    every = rows.reference(scaled(2, 1), replace(QUICK, reference_work=10**9), rows.FEW).solve(
        lit, "cpu", 0, Progress()
    )
    assert every.surface.mask.sum() == whole
    assert not every.extrapolated


@pytest.mark.parametrize("size", SIZES.values(), ids=lambda size: size.name)
def test_every_baseline_and_switch_has_a_row_of_its_own(size: Size):
    methods = (*rows.preset_rows(), *rows.others(size, rows.MANY), *rows.swept(size))
    assert len({method.key for method in methods}) == len(methods)
    assert {method.key for method in methods if method.kind == "baseline"} == set(BASELINES)
    begun, last, without, two, one = rows.switched(size)
    assert len({row.key for row in (begun, last, without, two, one)}) == 5
    assert (two.facts["emitter"], one.facts["emitter"]) == ("two_stage", "one_stage")
    assert two.facts["emitter_share"] == size.training
    assert "the paper's light in two stages" in two.title
    assert last.key == rows.others(size, rows.MANY)[0].key
    assert without.facts["emitter_sampling"] is False
    assert begun.facts["epochs"] == 0


def test_what_is_reported_is_the_reference_as_published():
    for name in ("small", "standard"):
        assert rows.dearest(SIZES[name]) == ReferenceParams()


def test_the_reference_before_its_first_step_takes_no_time_and_solves_as_many_pixels(
    lit: Stored, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(rows, "alike", lambda stored, device, seed: Alike(stored, DISTANCE))
    size = replace(QUICK, samples=(4,), epochs=(1,), reference_work=1)
    begun, last, *_ = (row.solve(lit, "cpu", 0, Progress()) for row in rows.switched(size)[:2])
    assert np.isnan(begun.seconds)
    np.testing.assert_array_equal(begun.surface.mask, last.surface.mask)


def test_what_our_row_found_is_handed_to_the_rows_beside_it(lit: Stored, monkeypatch: pytest.MonkeyPatch):
    solved: list[SurfaceParams] = []
    emitters = build_room_light(lit.captured, SurfaceParams(), 0).emitters

    def solve(*given, leave_out=()):
        solved.append(given[1])
        report = SimpleNamespace(held_out_error=0.1, distance=SimpleNamespace(value=DISTANCE), part_worths=())
        return SimpleNamespace(
            surface=SimpleNamespace(mask=None), emitters=emitters, report=report, renders=None
        )

    monkeypatch.setattr(rows, "solve", solve)
    monkeypatch.setattr(rows.results, "error_by_view", lambda *given: ())
    monkeypatch.setattr(alike, "solve", solve)
    monkeypatch.setattr(alike, "_found", {})
    draft, standard = (rows.ours(name, name, rows.params_of(name)) for name in ("draft", "standard"))
    draft.solve(lit, "cpu", 0, Progress())
    assert alike.alike(lit, "cpu", 0).distance == DISTANCE  # draft's is not ours at its defaults
    assert len(solved) == 2
    alike._found.clear()
    standard.solve(lit, "cpu", 0, Progress())
    assert alike.alike(lit, "cpu", 0) is alike.alike(lit, "cpu", 0)
    assert len(solved) == 3
    alike.alike(lit, "cpu", 1)
    assert len(solved) == 4  # another seed, another answer


def test_the_training_of_the_papers_own_light_counts_in_its_seconds(
    lit: Stored, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(rows, "alike", lambda stored, device, seed: Alike(stored, DISTANCE))
    report = SimpleNamespace(
        seconds_per_pixel=2.0, object_pixels=10, emitter_seconds=5.0, pixels=4, held_out_error=0.1
    )
    found = SimpleNamespace(surface=None, report=report)
    monkeypatch.setattr("engine.reference.solver.solve", lambda *given: found)
    *_, two, _ = rows.switched(QUICK)
    assert two.solve(lit, "cpu", 0, Progress()).seconds == 25


def test_chosen_rows_keep_their_order_and_another_key_is_refused():
    methods = rows.preset_rows()
    assert [m.key for m in rows.chosen(methods, ("fine", "draft"))] == ["draft", "fine"]
    assert rows.chosen(methods, ()) == methods
    with pytest.raises(BenchError, match="'lambrt'; choose of draft, standard, fine"):
        rows.chosen(methods, ("lambrt",))
