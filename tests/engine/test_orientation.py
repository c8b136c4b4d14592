"""Turning a picture, its vectors, its camera and its poses is one and the same turn, and turning back undoes it."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine import conventions
from engine.errors import RawError
from engine.geometry import project, rays, transform
from engine.orientation import back, turn_camera, turn_picture, turn_poses, turn_vectors, turned
from engine.types import Camera, Frames, Gaussians, Masks, Poses, ValidationRenders
from tests.engine.ball import CENTRE, RADIUS, ball
from tests.engine.results.test_metrics import ring

CAMERA = Camera(48, 32, 50.0, 53.0, 21.25, 17.5, 0.08, -0.03, 0.011, -0.007)
TURNS = pytest.mark.parametrize("flip", [3, 5, 6])
FLIPS = st.sampled_from([0, 3, 5, 6])


def records() -> tuple[Any, ...]:
    rng = np.random.default_rng(0)
    flags = rng.uniform(size=(2, 32, 48)) > 0.5
    radiance = rng.uniform(size=(2, 32, 48, 3)).astype(np.float32)
    surface = ball(CAMERA)
    poses = ring(4)
    poses[1] = np.nan
    return (
        CAMERA,
        Poses(CAMERA, poses, np.array([True, False, True, True]), rng.normal(size=(5, 3)), "rig", 0.2),
        Frames(("a", "b"), radiance, flags, ~flags, (0.1, 0.2)),
        Masks(flags[0], flags),
        ValidationRenders((0, 1), radiance),
        surface,
        replace(surface, material=rng.uniform(size=(32, 48, 2))),
    )


@TURNS
@pytest.mark.parametrize("record", records(), ids=lambda record: type(record).__name__)
def test_turned_back_every_record_is_what_it_was(record: Any, flip: int) -> None:
    again = turned(turned(record, flip), back(flip))
    for item in fields(record):
        before, after = getattr(record, item.name), getattr(again, item.name)
        if isinstance(before, np.ndarray | float):
            np.testing.assert_allclose(after, before, rtol=1e-14, err_msg=item.name)
        else:
            assert after == before, item.name


@TURNS
def test_what_lies_in_the_world_is_not_turned(flip: int) -> None:
    none = np.zeros((0, 3))
    light = Gaussians(none, np.zeros((0, 4)), none, np.zeros(0), np.zeros((0, 1, 3)))
    assert turned(light, flip) is light


@TURNS
def test_the_maps_of_a_turned_surface_fit_the_turned_camera(flip: int) -> None:
    """Of a ball, points and normals tell one another."""
    made, camera = turned(ball(CAMERA), flip), turn_camera(CAMERA, flip)
    ray = rays(camera)[made.mask]
    points = ray / ray[:, 2:] * made.depth[made.mask][:, None]
    centre = turn_vectors(CENTRE, flip)
    np.testing.assert_allclose(made.normal[made.mask], (points - centre) / RADIUS, atol=1e-9)


@given(FLIPS)
def test_a_pixels_ray_turns_with_it(flip: int) -> None:
    there = rays(turn_camera(CAMERA, flip))
    np.testing.assert_allclose(turn_vectors(turn_picture(rays(CAMERA), flip), flip), there, atol=1e-12)


@given(FLIPS, st.integers(0, 2**32 - 1))
def test_a_point_of_the_world_falls_on_the_turned_pixel(flip: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = ring(4)[seed % 4]
    world = transform(
        np.linalg.inv(np.vstack([pose, [0, 0, 0, 1]]))[:3], rng.uniform([-1, -1, 2], [1, 1, 4], (20, 3))
    )
    before = project(CAMERA, transform(pose, world))
    after = project(turn_camera(CAMERA, flip), transform(turn_poses(pose, flip), world))
    u, v = before.T
    there = {0: (u, v), 3: (48 - u, 32 - v), 5: (v, 48 - u), 6: (32 - v, u)}[flip]
    np.testing.assert_allclose(after, np.stack(there, -1), atol=1e-9)


def test_pictures_turn_as_the_tag_says() -> None:
    """Exif 2.3: of a picture tagged 6 the first row is shown at the right, of one tagged 8 at the left."""
    picture = np.array([[1, 2, 3], [4, 5, 6]])
    assert turn_picture(picture, 6).tolist() == [[4, 1], [5, 2], [6, 3]]
    assert turn_picture(picture, 5).tolist() == [[3, 6], [2, 5], [1, 4]]
    assert turn_picture(picture, 3).tolist() == [[6, 5, 4], [3, 2, 1]]


@pytest.mark.parametrize(("flip", "tag"), [(1, 2), (2, 4), (4, 5), (7, 7)])
def test_a_mirrored_picture_is_refused_by_its_tag(flip: int, tag: int) -> None:
    with pytest.raises(
        RawError, match=rf"a\.CR2: its Orientation tag \({tag}\) says that the picture is mirrored.*correct"
    ):
        conventions.check(flip, "a.CR2")


def test_a_session_has_the_most_frequent_orientation_and_says_what_differs() -> None:
    assert conventions.common([6, 0, 6, 3]) == 6
    assert conventions.common([]) == 0
    assert conventions.differing([6, 6], 6) == ()
    (said,) = conventions.differing([6, 0, 6, 3], 6)
    assert "2 of 4 photographs" in said
