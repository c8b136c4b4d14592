"""Dots, glows and the ground over a picture with depth."""

import numpy as np

from app.viewer import sprites
from app.viewer.parts import Dots, Glows

POSE = np.eye(3, 4)
CENTRE = (20.0, 15.0)
FOCAL = 40.0


def blank() -> tuple[np.ndarray, np.ndarray]:
    return np.zeros((30, 40, 4), np.uint8), np.zeros((30, 40), np.float32)


def dots(
    *points: tuple[float, float, float], size: float = 0.0, least: float = 1.5, most: float = 9.0
) -> Dots:
    one = np.ones(len(points), np.float32)
    colours = np.array([(10 * k + 10, 20, 30) for k in range(len(points))], np.uint8)
    return Dots(np.array(points, np.float32), colours, size * one, least * one, most * one)


def draw(what: Dots, image: np.ndarray, depth: np.ndarray, near: float = 0.01) -> None:
    sprites.dot(image, depth, what, POSE, FOCAL, CENTRE, 1.0, near)


def test_a_dot_is_round_and_at_its_pixel() -> None:
    image, depth = blank()
    draw(dots((0.5, 0.25, 2.0)), image, depth)  # at pixel coordinates (30, 20)
    rows, columns = np.nonzero(depth)
    np.testing.assert_allclose((columns.mean() + 0.5, rows.mean() + 0.5), (30, 20))
    assert (np.hypot(columns + 0.5 - 30, rows + 0.5 - 20) <= 1.5).all()
    assert len(rows) == 4
    assert tuple(image[19, 29]) == (30, 20, 10, 0)  # blue green red


def test_a_dots_radius_follows_its_distance_within_limits() -> None:
    for z, radius in ((2.0, 8.0), (4.0, 4.0), (100.0, 1.5), (0.5, 9.0)):
        image, depth = blank()
        draw(dots((0.0, 0.0, z), size=0.4), image, depth)
        area = (depth > 0).sum()
        assert abs(area - np.pi * radius**2) < 0.12 * np.pi * radius**2 + 5


def test_nearer_dots_hide_further_ones_in_any_order() -> None:
    for order in ((1.0, 3.0), (3.0, 1.0)):
        image, depth = blank()
        draw(dots(*((0.0, 0.0, z) for z in order)), image, depth)
        assert depth[15, 20] == 1.0
        assert image[15, 20, 2] == 10 * order.index(1.0) + 10


def test_dots_behind_a_surface_are_hidden() -> None:
    image, depth = blank()
    depth[:] = 2.0
    draw(dots((0.0, 0.0, 3.0)), image, depth)
    assert not image.any()
    draw(dots((0.0, 0.0, 1.0)), image, depth)
    assert image.any()


def test_dots_nearer_than_the_cut_are_left_out() -> None:
    image, depth = blank()
    draw(dots((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)), image, depth, near=1.5)
    assert not image.any()


def test_dots_at_and_beyond_the_edge_do_no_harm() -> None:
    image, depth = blank()
    draw(
        dots((-1.0, -0.75, 2.0), (1.0, 0.75, 2.0), (1e9, 0, 1), (0, -1e9, 1e-3), (np.nan, 0, 1)), image, depth
    )
    assert image[0, 0].any()
    assert image[-1, -1].any()


def test_the_ground_is_seen_only_where_nothing_is() -> None:
    depth = np.zeros((30, 40), np.float32)
    depth[:, 20:] = 1.0
    colour = np.full((30, 40, 3), (1.0, 0.5, 0.0), np.float32)
    image = sprites.grounded(colour, depth, (100, 60, 20), (0, 0, 0))
    assert tuple(image[4, 30]) == (0, 128, 255, 255)
    assert image[0, 0, 2] > 90
    assert image[-1, 0, 2] < 10
    assert (image[..., 3] == 255).all()


def test_a_glow_lightens_around_a_lamp_but_not_what_is_in_front() -> None:
    image, depth = blank()
    depth[:, :20] = 1.0
    lamp = Glows(np.array([[0.0, 0.0, 4.0]]), np.array([[200, 100, 50]], np.uint8), np.array([0.8]))
    sprites.glow(image, depth, lamp, POSE, FOCAL, CENTRE, 1.0)
    assert not image[:, :20].any()
    blue, green, red = image[15, 20, :3]
    assert red > green > blue > 0
    assert image[15, 20, 2] > image[15, 24, 2]
    assert not image[15, 30].any()


def test_a_glow_behind_the_eye_is_not_drawn() -> None:
    image, depth = blank()
    lamp = Glows(np.array([[0.0, 0.0, -4.0]]), np.array([[200, 100, 50]], np.uint8), np.array([0.8]))
    sprites.glow(image, depth, lamp, POSE, FOCAL, CENTRE, 1.0)
    assert not image.any()


def test_preparing_needs_nothing() -> None:
    sprites.prepare()
