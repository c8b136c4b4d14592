"""How many Gaussians a room is worth: counted by hand on pictures of few squares."""

import numpy as np
import pytest

from engine.light import budget
from engine.light.budget import worth
from engine.light.photographs import Photographs

SIDE = 64


def pictures(radiance: np.ndarray, views: int = 1, weight: np.ndarray | None = None) -> Photographs:
    """The same grey picture in some views that look the same way, 90 degrees across."""
    weight = np.ones((SIDE, SIDE), np.float32) if weight is None else weight
    shown = np.repeat(radiance[None, ..., None], views, 0) * np.ones(3)
    return Photographs(
        np.tile(np.eye(3, 4), (views, 1, 1)), np.full(4, SIDE / 2), shown.astype(np.float32),
        np.tile(weight, (views, 1, 1)), np.zeros((views, SIDE, SIDE), bool),
    )  # fmt: skip


@pytest.fixture(autouse=True)
def unbounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(budget, "FEWEST", 0)


def patches(radiance: np.ndarray, weight: np.ndarray | None = None) -> int:
    known = np.ones(radiance.shape, bool) if weight is None else weight > 0
    return budget.patches_of(np.log(radiance)[..., None], known)


def test_a_bare_wall_is_one_patch():
    assert patches(np.ones((SIDE, SIDE))) == 1
    assert patches(np.ones((SIDE, SIDE + 1))) == 2  # squares begin at the corner


def test_a_bright_corner_takes_seven_patches():
    wall = np.ones((SIDE, SIDE))
    wall[:16, :16] = 50.0
    # Three quarters are even, and of the fourth every quarter.
    assert patches(wall) == 7


def test_what_no_view_shows_takes_none():
    wall, weight = np.ones((SIDE, SIDE)), np.ones((SIDE, SIDE))
    wall[:16, :16], weight[:16, :16] = 50.0, 0
    assert patches(wall, weight) == 1
    assert patches(wall, 0 * weight) == 0


def test_noise_below_the_measure_is_nothing_and_a_crowd_is_much():
    rng = np.random.default_rng(0)
    assert patches(np.exp(0.05 * rng.normal(size=(SIDE, SIDE)))) == 1
    assert patches(np.exp(np.kron(rng.normal(size=(16, 16)), np.ones((4, 4))))) > 100


def test_views_that_show_the_same_count_once_and_the_sphere_is_filled_as_far_as_it_is_seen():
    crowd = np.exp(np.kron(np.random.default_rng(0).normal(size=(16, 16)), np.ones((4, 4))))
    once, thrice = (worth(pictures(crowd, views), pictures(crowd, views)) for views in (1, 3))
    assert once == thrice
    # A cube's face is a sixth of the sphere; its pixels are smaller at the rim, so fewer of the middle's size fill it.
    pixels = 4 * np.pi * (SIDE / 2) ** 2 / 6
    assert once == pytest.approx(patches(crowd) * pixels / SIDE**2, rel=0.1)
