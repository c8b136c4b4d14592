"""Two runs held against one another give the differences that were put in."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.inspect import maps, runs
from app.inspect.comparing import compare
from app.inspect.maps import Maps
from engine.errors import SessionError
from tests.app import furnace

TILT = np.radians(10.0)
TURN = np.array([[1, 0, 0], [0, np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), np.cos(TILT)]])


@pytest.fixture
def one(tmp_path: Path) -> Maps:
    return maps.load(runs.runs_of(furnace.finished(tmp_path))[0])


def changed(one: Maps, **changes) -> Maps:
    return replace(one, surface=replace(one.surface, **changes))


def test_a_run_agrees_with_itself(one: Maps) -> None:
    found = compare(one, one)
    for difference in found.differences:
        assert np.abs(difference.known).max() == pytest.approx(0, abs=1e-4), difference.key
    assert found.iou == 1
    assert found.depth_factor == 1
    assert found.of("normal").expected == 1


def test_turned_normals_differ_by_the_turn(one: Maps) -> None:
    other = changed(one, normal=(one.surface.normal @ TURN.T).astype(np.float32))
    difference = compare(one, other).of("normal")
    numbers = difference.summary()
    # Normals along the axis stay; all others move by at most the turn.
    assert numbers.most <= 10.01
    assert numbers.median == pytest.approx(9.7, abs=0.4)
    assert np.isnan(numbers.bias)
    assert not difference.signed
    assert difference.scale().low == 0
    # 10 degrees is far beyond 1.96 times the two standard errors of 1.15 degrees together.
    assert difference.expected < 0.1


def test_differences_keep_their_sign(one: Maps) -> None:
    s = one.surface
    other = changed(
        one, albedo=s.albedo + np.where(s.mask, 0.1, 0)[..., None], roughness=s.roughness - 0.2 * s.mask
    )
    found = compare(one, other)
    assert found.of("albedo").summary().bias == pytest.approx(0.1, abs=1e-4)
    assert found.of("roughness").summary().bias == pytest.approx(-0.2, abs=1e-4)
    assert found.of("roughness").summary().median == pytest.approx(0.2, abs=1e-4)
    scale = found.of("roughness").scale()
    assert scale.low == -scale.high
    backwards = compare(other, one)
    assert backwards.of("albedo").summary().bias == pytest.approx(-0.1, abs=1e-4)


def test_depth_is_compared_after_one_factor(one: Maps) -> None:
    depth = one.surface.depth * 2
    row, column = np.argwhere(one.surface.mask)[50]
    depth[row, column] *= 1.05
    found = compare(one, changed(one, depth=depth))
    assert found.depth_factor == pytest.approx(2)
    assert found.of("depth").summary().median == pytest.approx(0, abs=1e-4)
    assert found.of("depth").values[row, column] == pytest.approx(5, abs=1e-3)


def test_only_what_both_hold_is_compared(one: Maps) -> None:
    mask = one.surface.mask.copy()
    mask[:, :20] = False
    found = compare(one, changed(one, mask=mask))
    assert found.both == mask.sum()
    assert found.either == one.surface.mask.sum()
    assert np.isnan(found.of("albedo").values[:, :20]).all()


def test_other_sizes_and_other_places_are_refused(one: Maps) -> None:
    arrays = [name for name in type(one.surface).__slots__ if name not in ("material", "part", "stderr_part")]
    small = {name: getattr(one.surface, name)[:-2] for name in arrays}
    with pytest.raises(SessionError, match="40 x 30 and 40 x 28 pixels"):
        compare(one, replace(one, surface=type(one.surface)(**small)))
    with pytest.raises(SessionError, match="no pixel belongs"):
        compare(one, changed(one, mask=~one.surface.mask))
