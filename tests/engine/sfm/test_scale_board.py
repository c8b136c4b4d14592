"""A board of known size gives the length of a unit, or says nothing."""

import cv2
import numpy as np
import pytest

from engine.errors import PoseError
from engine.geometry import project, transform
from engine.sfm.scale_board import Board, BoardScale, measure, parse
from engine.types import Camera
from tests.engine.box_room import look

CAMERA = Camera(640, 480, 600.0, 600.0, 320.0, 240.0, k1=-0.02)
METRES = 0.4  # per scene unit
WORLD_FROM_BOARD = np.column_stack([cv2.Rodrigues(np.array([0.3, -0.4, 0.2]))[0], [-0.2, -0.3, 2.5]])


def poses(count: int) -> np.ndarray:
    """Views from places some tenths of a unit apart, two units and a half before the board."""
    rng = np.random.default_rng(0)
    return np.stack([look(0.05 * i, 0.02 * i, 0.0, rng.normal(size=3) * 0.2) for i in range(count)])


def sightings(board: Board, cam_from_world: np.ndarray) -> list:
    """Every corner of plate 0 in every view, with a twentieth of a pixel of noise."""
    rng = np.random.default_rng(1)
    world_points = transform(WORLD_FROM_BOARD, board.plates[0] / METRES)
    pixels = [project(CAMERA, transform(pose, world_points)) for pose in cam_from_world]
    return [{0: dict(enumerate(seen + 0.05 * rng.normal(size=seen.shape)))} for seen in pixels]


@pytest.mark.parametrize("words", ["charuco 5x7 0.04 0.03 DICT_4X4_50", "aruco 0.2 DICT_4X4_50"])
def test_metres_per_unit_come_from_the_corners(words: str) -> None:
    board, placed = parse(words), poses(6)
    found = measure(board, sightings(board, placed), CAMERA, placed)
    assert isinstance(found, BoardScale)
    assert found.metres == pytest.approx(METRES, rel=5 * found.stderr)
    assert found.stderr < 0.02
    assert found.views == 6
    assert found.residual_px < 0.1


def test_a_board_that_moves_along_with_the_camera_says_nothing() -> None:
    board, placed = parse("charuco 5x7 0.04 0.03 DICT_4X4_50"), poses(6)
    assert measure(board, sightings(board, placed[:1]) * 6, CAMERA, placed) is None


def test_views_that_are_not_placed_do_not_count() -> None:
    board, placed = parse("charuco 5x7 0.04 0.03 DICT_4X4_50"), poses(4)
    seen = sightings(board, placed)
    placed[:2] = np.nan
    assert measure(board, seen, CAMERA, placed) is None


@pytest.mark.parametrize("words", ["charuco 5x7 0.04 0.03 DICT_4X4_50", "aruco 0.05 DICT_4X4_50"])
def test_corners_are_found_where_they_are_printed(words: str) -> None:
    board, side = parse(words), 60
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    if words.startswith("charuco"):
        print_of = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.03, dictionary)
        picture = print_of.generateImage((5 * side, 7 * side))
        # The printed squares' edges lie between pixels: at whole numbers, in our convention.
        expected = board.plates[0][:, :2] / 0.04 * side
    else:
        marker = cv2.aruco.generateImageMarker(dictionary, 0, 4 * side)
        picture = cv2.copyMakeBorder(marker, side, side, side, side, cv2.BORDER_CONSTANT, value=255)
        expected = (board.plates[0][:, :2] * [1, -1] / 0.05 + 0.5) * 4 * side + side
    found = board.find(picture)[0]
    assert len(found) == len(expected)
    off = np.array([pixel - expected[corner] for corner, pixel in found.items()])
    assert np.abs(off).max() < 0.4
    assert np.abs(off.mean(0)).max() < 0.1  # not half a pixel to one side


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        ("charuco 5x7 0.03 0.04 DICT_4X4_50", "a marker must be smaller than its square"),
        ("charuco 5by7 0.04 0.03 DICT_4X4_50", "5by7"),
        ("aruco 0 DICT_4X4_50", "the side must be positive"),
        ("aruco 0.05 DICT_9X9_1", "DICT_9X9_1"),
        ("aruco 0.05", "is not a dictionary such as"),
        ("checkers 0.05 DICT_4X4_50", "unknown form"),
    ],
)
def test_words_that_describe_no_board_are_refused_with_the_form(words: str, cause: str) -> None:
    with pytest.raises(PoseError, match=cause) as fault:
        parse(words)
    assert "write " in str(fault.value)
