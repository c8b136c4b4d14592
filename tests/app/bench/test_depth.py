"""Depth is told part by part: what normals know, and how far parts stand behind one another."""

import math

import numpy as np
import pytest

from app.bench.depth import depth_error, parts_of
from engine.geometry import rays
from engine.types import Camera

CAMERA = Camera(40, 30, 60.0, 60.0, 20.0, 15.0, 0.0, 0.0, 0.0, 0.0)


def steps(gap: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(depth, normals, mask): two slanting boards, the right one `gap` behind the left."""
    ray = rays(CAMERA)
    ray = ray / ray[..., 2:]
    normal = np.array([0.6, 0.0, -0.8])
    depth = np.broadcast_to(-0.8 / (ray @ normal), (30, 40)).copy()
    depth[:, 20:] += gap
    mask = np.ones((30, 40), bool)
    mask[:, :2] = False
    return depth, np.broadcast_to(normal, (30, 40, 3)), mask


def test_a_slant_is_one_part_and_a_jump_makes_two() -> None:
    depth, normal, mask = steps(0.0)
    assert parts_of(depth, normal, mask, CAMERA).max() == 0
    depth, normal, mask = steps(0.2)
    part = parts_of(depth, normal, mask, CAMERA)
    assert set(np.unique(part[:, 2:20])) == {0}
    assert set(np.unique(part[:, 20:])) == {1}
    assert (part[~mask] == -1).all()


def test_a_part_that_joins_round_the_corner_is_no_second_one() -> None:
    depth, normal, mask = steps(0.2)
    depth[:10] = steps(0.0)[0][:10]
    depth[:, 20:] = steps(0.0)[0][:, 20:] + 0.2 * np.linspace(0, 1, 30)[:, None]
    assert parts_of(depth, normal, mask, CAMERA).max() == 0


def test_the_whole_may_be_larger_and_a_part_too_near() -> None:
    true, normal, mask = steps(0.2)
    part = parts_of(true, normal, mask, CAMERA)
    same = depth_error(3 * true, true, part, mask, CAMERA)
    assert (same.within, same.between) == pytest.approx((0, 0), abs=1e-9)
    assert same.parts == 2
    moved = true.copy()
    moved[:, 20:] *= 0.97
    off = depth_error(moved, true, part, mask, CAMERA)
    assert off.within == pytest.approx(0, abs=1e-9)
    # 20 of 38 columns stand 3 % off, which is 0.03 z in pixel widths of z / 60; the factor for all is theirs, being more.
    assert off.between == pytest.approx(60 * (1 / 0.97 - 1) * 18 / 38 * 0.97, rel=0.04)


def test_what_is_off_inside_a_part_is_not_between_parts() -> None:
    true, normal, mask = steps(0.0)
    part = parts_of(true, normal, mask, CAMERA)
    wavy = true * (1 + 0.01 * (-1.0) ** np.arange(40))
    off = depth_error(wavy, true, part, mask, CAMERA)
    assert 0 < off.within < 60 * 0.021
    assert math.isnan(off.between)


def test_parts_of_few_pixels_are_left_out() -> None:
    true, normal, mask = steps(0.2)
    part = parts_of(true, normal, mask, CAMERA)
    few = mask & (np.arange(40) < 21) & ((np.arange(40) < 20) | (np.arange(30) < 10)[:, None])
    assert depth_error(true, true, part, few, CAMERA).parts == 1
    assert math.isnan(depth_error(0 * true, true, part, mask, CAMERA).within)
