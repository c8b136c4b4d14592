import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine.capture_checks.planning import coverage
from engine.capture_checks.planning.coverage import (
    CLIPPED,
    CLIPPED_RGB,
    SEEN,
    UNSEEN,
    UNSEEN_RGB,
    Look,
    Sight,
)
from engine.geometry import fibonacci_sphere

SHAPE = (90, 120)
OPEN = Sight(0.5 / np.tan(np.radians(30)), np.ones(SHAPE, bool))


def look(light: float = 1.0, clipped: bool = False) -> Look:
    return Look(np.full(SHAPE, clipped), np.full(SHAPE, light, np.float32))


def facing(yaw_deg: float, pitch_deg: float = 0.0) -> np.ndarray:
    """cam_from_world of a level camera turned right, then up."""
    world_from_cam = Rotation.from_euler("YX", [yaw_deg, pitch_deg], degrees=True)
    return world_from_cam.inv().as_matrix()


def solid_angle_share(focal: float, aspect: float) -> float:
    """Of a pyramid of half widths 1/2 and aspect/2 at distance `focal`."""
    a, b = 0.5 / focal, 0.5 * aspect / focal
    return 4 * np.arcsin(a * b / np.sqrt((1 + a * a) * (1 + b * b))) / (4 * np.pi)


def test_one_look_shows_its_solid_angle():
    covered = coverage.cover(OPEN, [look()], np.eye(3)[None])
    assert covered.share == pytest.approx(solid_angle_share(OPEN.focal, 0.75), rel=0.05)
    assert covered.share == covered.share_unclipped
    seen = covered.directions[covered.state == SEEN]
    assert np.degrees(np.arccos(seen[:, 2].min())) < 37
    assert (covered.shots[covered.state == SEEN] == 1).all()


def test_two_looks_apart_show_twice_as_much_and_the_same_one_again_nothing():
    once = coverage.cover(OPEN, [look()], np.eye(3)[None]).share
    turns = np.stack([np.eye(3), facing(120)])
    assert coverage.cover(OPEN, [look(), look()], turns).share == pytest.approx(2 * once, rel=0.05)
    assert coverage.cover(OPEN, [look(), look()], np.stack([np.eye(3)] * 2)).share == once


def test_the_object_hides_what_is_behind_it():
    mask = np.zeros(SHAPE, bool)
    mask[20:70, 30:90] = True
    hidden = coverage.cover(coverage.sight(OPEN.focal, mask), [look()], np.eye(3)[None])
    whole = coverage.cover(OPEN, [look()], np.eye(3)[None])
    assert hidden.share < 0.75 * whole.share
    assert hidden.state[np.argmax(hidden.directions[:, 2])] == UNSEEN
    # Another look from the side shows it.
    both = coverage.cover(coverage.sight(OPEN.focal, mask), [look()] * 2, np.stack([np.eye(3), facing(25)]))
    assert both.state[np.argmax(both.directions[:, 2])] == SEEN


def test_a_clear_look_outweighs_a_clipped_one():
    twice = np.stack([np.eye(3)] * 2)
    clipped = coverage.cover(OPEN, [look(clipped=True)], np.eye(3)[None])
    assert set(clipped.state) == {UNSEEN, CLIPPED}
    assert clipped.share_unclipped == 0 < clipped.share
    assert set(coverage.cover(OPEN, [look(clipped=True), look()], twice).state) == {UNSEEN, SEEN}
    assert set(coverage.cover(OPEN, [look(), look(clipped=True)], twice).state) == {UNSEEN, SEEN}


def test_what_lights_the_visible_side_counts_most():
    directions = fibonacci_sphere(5000)
    weight = coverage.need(np.eye(3)[None], directions)
    assert weight.sum() == pytest.approx(1)
    behind_camera, beside, behind_object = (
        weight[np.argmax(directions @ way)] for way in np.array([[0, 0, -1.0], [1, 0, 0], [0, 0, 1]])
    )
    # Lambert: a ball lit from the side shows 1/pi of the light of a full one.
    assert beside / behind_camera == pytest.approx(1 / np.pi, rel=0.05)
    assert behind_object < 0.01 * behind_camera
    # A camera that looks both ways needs both sides.
    both = coverage.need(np.stack([np.eye(3), facing(180)]), directions)
    assert both[np.argmax(directions[:, 2])] == pytest.approx(both[np.argmin(directions[:, 2])], rel=0.05)


def test_the_panorama_shows_up_above_and_right_right():
    turns = np.stack([facing(0), facing(90), facing(0, 60)])
    looks = [look(1.0), look(9.0), look(1.0, clipped=True)]
    covered = coverage.cover(OPEN, looks, turns)
    picture = coverage.panorama(covered, coverage.upright(turns), 90)

    def at(yaw_deg: float, pitch_deg: float) -> tuple[int, ...]:
        return tuple(picture[int((90 - pitch_deg) / 2), int((yaw_deg + 180) / 2)])

    assert at(0, 60) == CLIPPED_RGB
    assert at(0, -60) == UNSEEN_RGB
    assert at(-90, 0) == UNSEEN_RGB
    assert at(90, 0) > at(0, 0)
    assert len(set(at(0, 0))) == 1


def test_cameras_held_every_way_up_have_no_level():
    rng = np.random.default_rng(0)
    assert coverage.upright(Rotation.random(60, rng=rng).as_matrix()) is None
    assert coverage.upright(np.zeros((0, 3, 3))) is None
    level = coverage.upright(np.stack([facing(yaw, 20) for yaw in (0, 40, 80)]))
    np.testing.assert_allclose(level @ facing(0, 20)[1], [0, 1, 0], atol=0.5)
    np.testing.assert_allclose(level @ level.T, np.eye(3), atol=1e-12)
