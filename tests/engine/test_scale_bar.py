"""A scale bar on a sphere of known size: the length of a scene unit, on any grid, and what refuses it."""

from dataclasses import replace

import numpy as np
import pytest

from engine.errors import SurfaceError
from engine.geometry import project, resized, transform
from engine.io.scale_edit import ScaleBar
from engine.scale_bar import factor, scaled
from engine.types import Lamps
from tests.engine.ball import CAMERA, CENTRE, RADIUS, ball

LENGTH_M = 0.062  # of the chord below
LEFT, RIGHT = CENTRE + [-0.6 * RADIUS, 0, -0.8 * RADIUS], CENTRE + [0.6 * RADIUS, 0, -0.8 * RADIUS]
BAR = ScaleBar(tuple(tuple(project(CAMERA, at)) for at in (LEFT, RIGHT)), (64, 48), LENGTH_M)
TRUE = LENGTH_M / (1.2 * RADIUS)


@pytest.mark.parametrize("by", [1, 2])
def test_two_points_of_a_sphere_tell_how_long_a_scene_unit_is(by: int) -> None:
    """Also where the maps are averaged down from the photographs that the points are of."""
    large = resized(CAMERA, by * CAMERA.width, by * CAMERA.height)
    bar = replace(
        BAR, points=tuple(tuple(by * np.array(at)) for at in BAR.points), size=(large.width, large.height)
    )
    assert factor(bar, ball(), CAMERA) == pytest.approx(TRUE, rel=3e-3)
    assert factor(bar, ball(large), large) == pytest.approx(TRUE, rel=3e-3)


def test_a_scaled_result_measures_what_was_given() -> None:
    assert factor(BAR, scaled(ball(), TRUE), CAMERA) == pytest.approx(1, rel=3e-3)


def test_every_length_is_scaled_and_nothing_else() -> None:
    from tests.app import furnace

    placed, (gaussians, _) = furnace.poses(), furnace.room()
    moved = replace(placed, cam_from_world=placed.cam_from_world + [0, 0, 0, 0.5], points=np.ones((1, 3)))
    larger = scaled(moved, 3.0)
    assert (moved.metric, larger.metric) == (False, True)
    seen = [transform(poses.cam_from_world[1], poses.points[0]) for poses in (moved, larger)]
    assert np.allclose(seen[1], 3 * seen[0])
    assert np.array_equal(larger.cam_from_world[..., :3], moved.cam_from_world[..., :3])
    light = scaled(gaussians, 3.0)
    assert np.allclose(light.means, 3 * gaussians.means)
    assert np.allclose(light.scales, 3 * gaussians.scales)
    assert light.density is gaussians.density
    assert light.radiance is gaussians.radiance
    lamp = scaled(Lamps(np.ones((1, 3)), np.ones(1), np.ones((1, 3)), np.zeros(1, bool)), 3.0)
    assert (lamp.centres[0, 0], lamp.radii[0], lamp.radiance[0, 0]) == (3, 3, 1)


def test_what_determines_no_length_is_refused() -> None:
    whole = ball(wall=True)
    parts = np.where(ball().mask, 1, 2).astype(np.int16)
    apart = replace(BAR, points=(BAR.points[0], (2.0, 2.0)))
    with pytest.raises(SurfaceError, match=r"different parts of the depth, whose offset is less certain"):
        factor(apart, replace(whole, part=parts), CAMERA)
    with pytest.raises(SurfaceError, match="different parts"):  # too small to be told
        factor(BAR, replace(whole, part=np.where(ball().mask, 0, 2).astype(np.int16)), CAMERA)
    with pytest.raises(SurfaceError, match=r"2\.0, 2\.0 .* is off the object"):
        factor(apart, ball(), CAMERA)
    with pytest.raises(SurfaceError, match="two points are one"):
        factor(replace(BAR, points=(BAR.points[0],) * 2), ball(), CAMERA)
    assert factor(BAR, replace(whole, part=parts), CAMERA) == pytest.approx(TRUE, rel=3e-3)
