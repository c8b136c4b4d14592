"""Blocks abreast: in order, alike on any number of cores, and stopped soon."""

import os
import threading
import time

import numpy as np
import pytest

from engine.parallel import WAITING, abreast
from engine.progress import Progress
from engine.surface.optimize import gauss_newton
from tests.engine.surface.lighting.test_light_calibration import TRUE_Z, parts_of_lamps, sample_of


@pytest.fixture(params=[1, 2, 5])
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(request.param)))
    return request.param


def test_answers_come_in_the_order_of_the_things(cores: int) -> None:
    assert list(abreast(lambda x: x * x, range(40))) == [x * x for x in range(40)]
    assert list(abreast(str, [])) == []


def test_no_more_at_once_than_memory_allows(cores: int) -> None:
    lock, running, most = threading.Lock(), [0], [0]

    def work(_: int) -> None:
        with lock:
            running[0] += 1
            most[0] = max(most[0], running[0])
        time.sleep(1e-3)
        with lock:
            running[0] -= 1

    assert len(list(abreast(work, range(20), 2))) == 20
    assert most[0] <= 2


def test_what_goes_wrong_is_raised_where_it_is_asked_for(cores: int) -> None:
    def work(x: int) -> int:
        if x == 7:
            raise ValueError("the seventh")
        return x

    answers = abreast(work, range(40))
    assert [next(answers) for _ in range(7)] == list(range(7))
    with pytest.raises(ValueError, match="the seventh"):
        next(answers)


def test_who_stops_listening_stops_the_work(cores: int) -> None:
    done = []
    for _ in abreast(done.append, range(1000)):
        break
    assert len(done) <= 2 * (WAITING * cores + 1)


def test_pixels_come_out_the_same_to_the_bit_on_any_number_of_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    parts = parts_of_lamps(np.random.default_rng(9), False)
    sample, state, _ = sample_of(parts, np.ones((4, 3)))
    problem = sample.problem(parts.with_gains(np.ones((4, 3))), TRUE_Z)

    def solved(cores: int) -> gauss_newton.PixelEstimate:
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
        return gauss_newton.minimize(
            gauss_newton.update_residual_scale(state, problem), problem, 3, Progress()
        )

    one, three = solved(1), solved(3)
    for name in ("normals", "albedo", "roughness", "residual_scale", "cost", "hessian"):
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))
