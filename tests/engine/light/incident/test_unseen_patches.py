"""Where no photograph looked stands something, as far away and as bright as what is around it."""

import numpy as np
import pytest

from engine.geometry import fibonacci_sphere
from engine.light.gaussians.gaussians import Y00, joined, part
from engine.light.incident.probes import gather_probes
from engine.light.incident.unseen_patches import unseen_patches
from engine.types import Gaussians
from tests.engine.light import clouds

RADIUS, RADIANCE = 3.0, 2.5
CENTRE = np.array([0.2, -0.1, 0.15])
HERE = np.concatenate([np.eye(3), -CENTRE[:, None]], axis=1)[None]


def without_cap(degrees: float) -> Gaussians:
    """A shell around the origin without its part so near to +y."""
    whole = clouds.shell(RADIANCE, RADIUS)
    return part(whole, whole.means[:, 1] < RADIUS * np.cos(np.radians(degrees)))


def test_patches_close_the_hole_and_nothing_else():
    room = without_cap(50)
    made = unseen_patches(room, CENTRE)
    away = made.means - CENTRE
    assert (away[:, 1] / np.linalg.norm(away, axis=1) > np.cos(np.radians(56))).all()
    np.testing.assert_allclose(np.linalg.norm(made.means, axis=1), RADIUS, rtol=0.06)
    directions = fibonacci_sphere(800)

    def opacity(light: Gaussians) -> np.ndarray:
        return gather_probes(light, HERE, np.zeros((1, 3)), directions, 32, fill=False).seen[0, 0]

    assert opacity(room).min() < 0.01
    assert opacity(joined(room, made)).min() > 0.8
    assert len(unseen_patches(joined(room, made), CENTRE).means) == 0


def test_patches_are_as_bright_as_their_surroundings():
    room = without_cap(60)
    blue = room.means[:, 0] < 0
    room.radiance[blue] *= [0.1, 0.1, 1.0]
    made = unseen_patches(room, CENTRE)
    colours = made.radiance[:, 0] * Y00
    far_left, far_right = made.means[:, 0] < -0.5 * RADIUS, made.means[:, 0] > 0.5 * RADIUS
    np.testing.assert_allclose(np.median(colours[far_right], 0), RADIANCE, rtol=0.25)
    np.testing.assert_allclose(np.median(colours[far_left], 0), RADIANCE * np.array([0.1, 0.1, 1]), rtol=0.25)
    assert made.radiance.shape[1:] == room.radiance.shape[1:]


@pytest.mark.parametrize("degrees", [0, 17])
def test_a_closed_room_and_a_small_hole_need_none(degrees: float):
    assert len(unseen_patches(without_cap(degrees), CENTRE).means) == 0


def test_nothing_is_made_up_where_nothing_is_known():
    assert len(unseen_patches(without_cap(180), CENTRE).means) == 0


def test_what_is_black_does_not_draw_patches_to_the_cameras():
    room = without_cap(50)
    black = (room.means[:, 1] > 0) & (room.means[:, 0] > 0)
    room.radiance[black] = 0
    made = unseen_patches(room, CENTRE)
    np.testing.assert_allclose(np.linalg.norm(made.means, axis=1), RADIUS, rtol=0.08)
