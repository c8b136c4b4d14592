"""A painted disc under light that changes its shading from shot to shot; the room behind it is another each time."""

import cv2
import numpy as np
import pytest

from engine.capture_checks import object_motion
from engine.capture_checks.finding import Severity

H, W = 150, 180
CENTRE = (88.0, 72.0)
RADIUS = 48.0


def clouds(rng: np.random.Generator, cells: int) -> np.ndarray:
    coarse = rng.standard_normal((cells, cells)).astype(np.float32)
    return cv2.resize(coarse, (W, H), interpolation=cv2.INTER_CUBIC)


def shot(
    number: int, right: float = 0.0, down: float = 0.0, turn_deg: float = 0.0, size: float = 1.0
) -> np.ndarray:
    """`log_light` of one shot, drawn eight times finer than its pixels where edges are sharp."""
    rng = np.random.default_rng(1000 + number)
    paint = 0.5 * clouds(np.random.default_rng(5), 24)
    shade = 0.6 * clouds(rng, 4)
    room = clouds(rng, 30)
    matrix = cv2.getRotationMatrix2D(CENTRE, -turn_deg, size)
    matrix[:, 2] += [right, down]
    y, x = np.mgrid[:H, :W]
    cover = np.clip(RADIUS + 0.5 - np.hypot(x - CENTRE[0], y - CENTRE[1]), 0, 1).astype(np.float32)
    cover = cv2.warpAffine(cover, matrix, (W, H))
    ours = cv2.warpAffine(paint, matrix, (W, H), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT) + shade
    noise = 0.02 * rng.standard_normal((H, W)).astype(np.float32)
    return cover * ours + (1 - cover) * room + noise


@pytest.fixture(scope="module")
def reference() -> object_motion.Reference:
    y, x = np.mgrid[:H, :W]
    mask = np.hypot(x - CENTRE[0], y - CENTRE[1]) < RADIUS
    return object_motion.reference([shot(number) for number in range(8)], mask)


@pytest.mark.parametrize("number", range(10, 16))
def test_light_and_room_may_change_as_they_like(reference, number):
    motion = object_motion.register(shot(number), reference, 1.0)
    assert motion.distance < 0.25
    assert object_motion.check("shot", motion, []) is None


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"right": 0.8}, (0.8, 0, 0, 0)),
        ({"down": -2.4}, (0, -2.4, 0, 0)),
        # Turn and scale are told as the way of a point at the rms radius, 0.71 of the disc's.
        ({"turn_deg": 2.0}, (0, 0, np.radians(2.0) * RADIUS / np.sqrt(2), 0)),
        ({"size": 1.03}, (0, 0, 0, 0.03 * RADIUS / np.sqrt(2))),
        ({"right": -13.0, "down": 9.0}, (-13.0, 9.0, 0, 0)),
    ],
)  # fmt: skip
def test_every_way_of_moving_is_measured(reference, change, expected):
    motion = object_motion.register(shot(20, **change), reference, 1.0)
    np.testing.assert_allclose(motion.moved, expected, atol=0.15)
    found = object_motion.check("shot", motion, [])
    assert found is not None
    assert found.severity is (Severity.STOP if np.linalg.norm(expected) > 1.5 else Severity.WARNING)


def test_distances_are_told_in_sites_of_the_sensor(reference):
    motion = object_motion.register(shot(21, right=0.5), reference, 6.0)
    assert motion.distance == pytest.approx(3.0, abs=0.4)
    found = object_motion.check("shot", motion, [])
    assert found is not None
    assert found.severity is Severity.STOP


def test_another_object_is_told_from_one_that_moved(reference):
    known = [object_motion.register(shot(number), reference, 1.0) for number in range(10, 18)]
    other = shot(30)[:, ::-1].copy()
    found = object_motion.check(
        "shot", object_motion.register(other, reference, 1.0, object_motion.usual(known)), known
    )
    assert found is not None
    assert (found.severity, found.unit) == (Severity.STOP, "")


def test_a_restless_object_needs_a_larger_movement(reference):
    """Where earlier shots seemed to move by half a pixel, as glossy ones do, as much again says nothing."""
    wandering = [
        object_motion.register(shot(10 + n, right=0.4 * (-1) ** n), reference, 1.0) for n in range(8)
    ]
    motion = object_motion.register(shot(22, right=0.7), reference, 1.0)
    assert object_motion.check("shot", motion, []) is not None
    assert object_motion.check("shot", motion, wandering) is None
