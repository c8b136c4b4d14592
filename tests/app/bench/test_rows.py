"""The rows beside ours: the same light and distance for all, and what a part of the pixels stands for."""

from dataclasses import replace

import numpy as np
import pytest

from app.bench import rows
from app.bench.alike import Alike, under
from app.bench.sizes import SIZES, Size
from app.bench.stored import Stored
from engine.light.gaussians import Y00
from engine.progress import Progress
from engine.reference.baselines import BASELINES
from engine.reference.params import ReferenceParams, scaled
from engine.surface.surroundings import furnished
from tests.engine.reference.lit_room import DISTANCE, lambert, scene

QUICK = SIZES["quick"]


@pytest.fixture(scope="module")
def lit() -> Stored:
    return Stored("f00d", *scene(lambert).given)


def test_what_ours_found_of_a_lamp_is_in_the_lamp_and_in_its_gaussian(lit: Stored):
    room = furnished(lit.gaussians, lit.lamps, lit.frames, lit.masks, lit.poses, 12, 0.02, 0)
    assert len(lit.lamps.radii) > 0
    gain = np.ones((len(room.kind), 3))
    gain[-1] = [3.0, 2.0, 1.0]
    bright = under(lit, room.under(gain))
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
    assert (two.facts["one_stage"], one.facts["one_stage"]) == (False, True)
    assert two.facts["iterations"] == round(30_000 * size.training)
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


def test_the_papers_own_light_takes_the_place_of_ours(lit: Stored, monkeypatch: pytest.MonkeyPatch):
    seen: list[Stored] = []

    def solved(given: Stored, *_: object) -> rows.Answer:
        seen.append(given)
        return rows.Answer(None, 5.0, True)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(rows, "alike", lambda stored, device, seed: Alike(stored, DISTANCE))
    monkeypatch.setattr(rows, "by_reference", solved)
    # A room to train on: dim, with a bright third.
    radiance = np.full_like(lit.frames.radiance, 0.2)
    radiance[:, :, : radiance.shape[2] // 3] = 20.0
    photographed = replace(lit, frames=replace(lit.frames, radiance=radiance))
    for one_stage in (True, False):
        answer = rows.trained(one_stage, replace(QUICK, training=1e-4)).solve(
            photographed, "cpu", 0, Progress()
        )
        assert answer.seconds > 5
    one, two = (given.gaussians for given in seen)
    assert not len(seen[0].lamps.radii)
    np.testing.assert_array_equal(one.means, two.means)  # the second stage is about colours alone
    assert np.abs(one.radiance - two.radiance).max() > 0
