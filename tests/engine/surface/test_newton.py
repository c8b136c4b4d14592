"""Gauss-Newton on pixels: what stands still is not evaluated again, and comes out as if it had been."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface import newton
from engine.surface.relight import Sample
from engine.surface.transport import Responses
from tests.engine.surface.test_relight import TRUE_Z, parts_of_lamps, sample_of


@dataclass
class Counted:
    """Rows that remember how many pixels were asked for."""

    rows: Responses
    asked: list[int] = field(default_factory=list)

    @property
    def incident(self):
        return self.rows.incident

    def block(self, sight, pixels):
        return self.rows.block(sight, pixels)

    def __call__(self, block, normals, roughness):
        self.asked.append(len(normals))
        return self.rows(block, normals, roughness)


@pytest.fixture(scope="module")
def told() -> tuple[Sample, newton.State, Responses]:
    parts = parts_of_lamps(np.random.default_rng(9), False)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    return sample, state, sample.responses(parts.under(np.ones((4, 3))))


def iterated(told, state: newton.State, passes: int) -> tuple[newton.State, list[int]]:
    sample, _, responses = told
    counted = Counted(responses)
    found = newton.iterate(state, counted, sample.at(TRUE_Z), sample.regions, sample.seen, passes, Progress())
    return found, counted.asked


def moved(told) -> newton.State:
    """Some degrees and a tenth of albedo away from the truth."""
    sample, state, responses = told
    lean = np.random.default_rng(1).normal(0, 0.05, (len(state.normals), 2))
    state = replace(state, normals=newton.tilt(state.normals, lean), albedo=0.9 * state.albedo)
    return newton.respread(state, responses, sample.at(TRUE_Z), sample.regions, sample.seen)


def test_what_stands_still_comes_out_as_if_it_had_been_evaluated_to_the_end(told, monkeypatch):
    start = moved(told)
    found, asked = iterated(told, start, 9)
    monkeypatch.setattr(newton, "AT_REST", np.zeros(6))
    whole, every = iterated(told, start, 9)
    assert sum(every) == 9 * len(start.normals)
    assert sum(asked) < 0.8 * sum(every)
    assert np.degrees(angle_between(found.normals, whole.normals)).max() < 0.2
    np.testing.assert_allclose(found.albedo, whole.albedo, rtol=5e-3)
    assert np.isfinite(found.misfit).all()


def test_a_pixel_at_rest_is_evaluated_once_and_stays(told):
    still, _ = iterated(told, moved(told), 12)
    again, asked = iterated(told, still, 6)
    assert sum(asked) < 1.2 * len(still.normals)
    assert np.degrees(angle_between(still.normals, again.normals)).max() < 0.2


def test_a_block_of_a_few_has_what_reaches_them(told):
    sample, state, responses = told
    sight, pixels = sample.at(TRUE_Z), sample.regions[0]
    block, few = responses.block(sight, pixels), np.arange(0, len(pixels), 2)
    whole = responses(block, state.normals[pixels][:, None], state.roughness[pixels][:, None])
    part = responses(
        block.part(few), state.normals[pixels[few]][:, None], state.roughness[pixels[few]][:, None]
    )
    for all_of_them, some in zip(whole, part, strict=True):
        np.testing.assert_allclose(some, all_of_them[few], rtol=1e-5, atol=1e-7)
