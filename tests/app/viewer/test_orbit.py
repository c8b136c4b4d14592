"""The eye of the 3D view: laws of orbit, pan and zoom, and values worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.viewer import orbit
from app.viewer.orbit import Orbit
from engine.geometry import check_rigid, inverse, transform

few = settings(max_examples=40)
WIDTH, HEIGHT = 800, 600
angles = st.floats(-3.0, 3.0)
shares = st.floats(0.05, 0.95)


@st.composite
def eyes(draw: st.DrawFn) -> Orbit:
    up = np.array([draw(st.floats(-1, 1)) for _ in range(3)]) + [0.0, -1.5, 0.0]
    up /= np.linalg.norm(up)
    front = np.cross(up, [1.0, 0.3, 0.2])
    front /= np.linalg.norm(front)
    return Orbit(
        tuple(draw(st.floats(-5, 5)) for _ in range(3)),
        draw(st.floats(0.1, 20)),
        draw(angles),
        draw(st.floats(-1.5, 1.5)),
        tuple(map(float, up)),
        tuple(map(float, front)),
        draw(st.floats(0.3, 1.2)),
        draw(angles),
    )


@few
@given(eyes())
def test_the_pose_is_rigid_and_looks_at_the_target(eye: Orbit) -> None:
    pose = orbit.cam_from_world(eye)
    check_rigid(pose, "eye", 1e-9)
    np.testing.assert_allclose(transform(pose, np.array(eye.target)), [0, 0, eye.distance], atol=1e-8)
    np.testing.assert_allclose(inverse(pose)[:, 3], orbit.eye(eye), atol=1e-8)


def test_from_the_front_up_is_up_and_right_is_right() -> None:
    eye = Orbit((0.0, 0.0, 0.0), 2.0)  # up is -y, front is +z: our own camera frame, two units back
    np.testing.assert_allclose(
        orbit.cam_from_world(eye), np.eye(3, 4) + [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 2]]
    )
    np.testing.assert_allclose(orbit.project(eye, np.array([1.0, 0, 0]), WIDTH, HEIGHT)[1:], [300, 2])
    assert orbit.project(eye, np.array([1.0, 0, 0]), WIDTH, HEIGHT)[0] > 400


@pytest.mark.parametrize(
    ("view", "place"),
    [
        ("front", (0, 0, -2)), ("back", (0, 0, 2)), ("left", (-2, 0, 0)), ("right", (2, 0, 0)),
        ("top", (0, -2, 0)), ("bottom", (0, 2, 0)),
    ],
)  # fmt: skip
def test_standing_views_are_where_their_names_say(view: str, place: tuple[float, ...]) -> None:
    eye = orbit.standing(Orbit((0.0, 0.0, 0.0), 2.0, 1.0, 0.3, roll=0.4), view)
    np.testing.assert_allclose(orbit.eye(eye), place, atol=1e-12)


@few
@given(eyes(), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2))
def test_turning_keeps_target_and_distance(eye: Orbit, right: float, up: float) -> None:
    turned = orbit.turned(eye, right, up)
    assert (turned.target, turned.distance) == (eye.target, eye.distance)
    assert -math.pi / 2 <= turned.elevation <= math.pi / 2


@few
@given(eyes())
def test_turning_right_moves_the_eye_to_the_right_of_its_own_picture(eye: Orbit) -> None:
    level = orbit.Orbit(eye.target, eye.distance, eye.azimuth, 0.0, eye.up, eye.front, eye.fov, eye.roll)
    step = orbit.axes(level) @ (orbit.eye(orbit.turned(level, 1e-4, 0.0)) - orbit.eye(level))
    np.testing.assert_allclose(step / level.distance, [1e-4, 0, 0], atol=1e-7)
    step = orbit.axes(level) @ (orbit.eye(orbit.turned(level, 0.0, 1e-4)) - orbit.eye(level))
    np.testing.assert_allclose(step / level.distance, [0, -1e-4, 0], atol=1e-7)


@few
@given(eyes(), st.floats(-300, 300), st.floats(-300, 300))
def test_panning_moves_the_target_by_so_many_pixels(eye: Orbit, right: float, down: float) -> None:
    moved = orbit.project(orbit.panned(eye, right, down, HEIGHT), np.array(eye.target), WIDTH, HEIGHT)
    np.testing.assert_allclose(moved[:2], [WIDTH / 2 + right, HEIGHT / 2 + down], atol=1e-5)


@few
@given(eyes(), st.floats(0.3, 3.0), shares, shares)
def test_zooming_keeps_what_is_under_the_mouse_there(eye: Orbit, factor: float, x: float, y: float) -> None:
    at = x * WIDTH, y * HEIGHT
    direction = orbit.ray(eye, *at, WIDTH, HEIGHT)
    point = orbit.eye(eye) + direction * eye.distance / (direction @ orbit.axes(eye)[2])
    nearer = orbit.zoomed(eye, factor, at, (WIDTH, HEIGHT))
    assert nearer.distance == pytest.approx(eye.distance / factor)
    np.testing.assert_allclose(orbit.project(nearer, point, WIDTH, HEIGHT)[:2], at, atol=1e-5)


def test_zooming_ends_at_the_limits() -> None:
    eye = Orbit((0.0, 0.0, 0.0), 1.0)
    assert orbit.zoomed(eye, 1e30).distance == orbit.NEAREST
    assert orbit.zoomed(eye, 1e-30).distance == orbit.FURTHEST


@few
@given(eyes(), shares, shares)
def test_a_ray_goes_through_its_pixel(eye: Orbit, x: float, y: float) -> None:
    point = orbit.eye(eye) + 3.0 * orbit.ray(eye, x * WIDTH, y * HEIGHT, WIDTH, HEIGHT)
    np.testing.assert_allclose(
        orbit.project(eye, point, WIDTH, HEIGHT)[:2], [x * WIDTH, y * HEIGHT], atol=1e-6
    )


def test_what_is_behind_the_eye_has_no_pixel() -> None:
    assert np.isnan(orbit.project(Orbit((0.0, 0.0, 0.0), 1.0), np.array([0.0, 0, -3]), 80, 60)[0])


@few
@given(eyes(), st.floats(0.5, 3.0))
def test_a_fitted_ball_fills_the_shorter_side(eye: Orbit, aspect: float) -> None:
    fitted = orbit.fitted(eye, (1.0, 2.0, 3.0), 0.7, aspect)
    half = fitted.fov / 2 if aspect >= 1 else math.atan(math.tan(fitted.fov / 2) * aspect)
    assert math.asin(0.7 / fitted.distance) == pytest.approx(half)


@few
@given(eyes(), st.floats(0.2, 9.0))
def test_looking_through_a_pose_gives_that_pose(eye: Orbit, depth: float) -> None:
    pose = orbit.cam_from_world(eye)
    seen = orbit.through(Orbit((9.0, 9.0, 9.0), 3.0, up=eye.up, front=eye.front), pose, depth, 0.8)
    np.testing.assert_allclose(orbit.cam_from_world(seen), pose, atol=1e-8)
    assert seen.distance == depth


def test_looking_through_a_camera_that_looks_straight_down_works() -> None:
    pose = orbit.cam_from_world(Orbit((0.0, 0.0, 0.0), 1.0, 0.6, math.pi / 2))
    np.testing.assert_allclose(
        orbit.cam_from_world(orbit.through(Orbit((0.0, 0.0, 0.0), 5.0), pose, 1.0, 0.8)), pose, atol=1e-9
    )


@few
@given(eyes(), eyes())
def test_a_way_begins_and_ends_where_it_should(a: Orbit, b: Orbit) -> None:
    b = orbit.Orbit(b.target, b.distance, b.azimuth, b.elevation, a.up, a.front, b.fov, b.roll)
    np.testing.assert_allclose(
        orbit.cam_from_world(orbit.between(a, b, 0.0)), orbit.cam_from_world(a), atol=1e-6
    )
    assert orbit.between(a, b, 1.0) == b


def test_a_way_goes_the_short_way_round() -> None:
    a, b = Orbit((0.0, 0.0, 0.0), 1.0, 3.0), Orbit((0.0, 0.0, 0.0), 4.0, -3.0)
    half = orbit.between(a, b, 0.5)
    assert abs(half.azimuth) == pytest.approx(math.pi)
    assert half.distance == pytest.approx(2.0)


@few
@given(eyes(), st.floats(40, 400))
def test_a_scale_bar_is_round_and_not_too_long(eye: Orbit, longest: float) -> None:
    length, pixels = orbit.scale_bar(eye, HEIGHT, longest)
    assert longest / 2.51 < pixels <= longest * (1 + 1e-9)
    assert f"{length:.0e}"[0] in "125"
    assert length / pixels == pytest.approx(eye.distance / orbit.focal_px(eye, HEIGHT))


def test_aiming_at_a_point_keeps_its_depth() -> None:
    eye = Orbit((0.0, 0.0, 0.0), 2.0)
    aimed = orbit.aimed(eye, np.array([0.4, 0.1, 1.0]))
    assert aimed.target == (0.4, 0.1, 1.0)
    assert aimed.distance == pytest.approx(3.0)
