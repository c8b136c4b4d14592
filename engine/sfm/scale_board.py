"""How long a scene unit is, from a printed board of stated size that stands in the room.

ArUco markers (Garrido-Jurado et al. 2014) or a ChArUco board, as OpenCV prints them. The board is rigid and
of known size in metres; with the camera poses known up to scale, its similarity to the world is fitted to
all detected corners at once. A board that moves with the camera cannot be fitted, and is refused by its
residual.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from engine.errors import PoseError
from engine.geometry import align_similarity, compose, project, unproject
from engine.types import Camera

Seen = Mapping[int, Float[np.ndarray, " 2"]]  # corner -> pixel, our convention
_FORM = '"charuco COLUMNSxROWS SQUARE_M MARKER_M DICTIONARY" or "aruco SIDE_M DICTIONARY"'


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """Rigid plates of known size, and how to find their corners in an 8-bit picture."""

    plates: Mapping[int, Float[np.ndarray, "k 3"]]  # metres, in the plate's own frame
    find: Callable[[np.ndarray], Mapping[int, Seen]]  # picture -> plate -> corner -> pixel


@dataclass(frozen=True, slots=True)
class BoardScale:
    """Metres per scene unit from a board, with its relative standard error."""

    metres: float
    stderr: float
    views: int
    residual_px: float


def parse(text: str) -> Board:
    """A board from words such as `charuco 5x7 0.04 0.03 DICT_4X4_50` or `aruco 0.05 DICT_4X4_50`; metres.

    Raises:
        PoseError: the words do not describe a board.
    """
    words = text.split()
    try:
        name = words[-1]
        if not name.startswith("DICT_"):
            raise ValueError(f"{name} is not a dictionary such as DICT_4X4_50")
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        if words[0] == "charuco" and len(words) == 5:
            columns, rows = (int(n) for n in words[1].split("x"))
            square, marker = float(words[2]), float(words[3])
            if not 0 < marker < square:
                raise ValueError("a marker must be smaller than its square")
            return _charuco(cv2.aruco.CharucoBoard((columns, rows), square, marker, dictionary))
        if words[0] == "aruco" and len(words) == 3:
            if not float(words[1]) > 0:
                raise ValueError("the side must be positive")
            return _markers(float(words[1]), dictionary)
        raise ValueError("unknown form")
    except (ValueError, IndexError, AttributeError, cv2.error) as error:
        raise PoseError(f'board "{text}": {error}; write {_FORM}') from error


def _charuco(board: cv2.aruco.CharucoBoard) -> Board:
    detector = cv2.aruco.CharucoDetector(board)

    def find(picture: UInt8[np.ndarray, "h w"]) -> Mapping[int, Seen]:
        corners, ids, _, _ = detector.detectBoard(picture)
        if ids is None or len(ids) < 4:
            return {}
        pixels = corners.reshape(-1, 2).astype(np.float64) + 0.5  # OpenCV's first pixel is centred on (0, 0)
        return {0: {int(corner): pixel for corner, pixel in zip(ids.ravel(), pixels, strict=True)}}

    return Board({0: np.asarray(board.getChessboardCorners(), np.float64)}, find)


def _markers(side: float, dictionary: cv2.aruco.Dictionary) -> Board:
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(dictionary, settings)
    square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * side / 2
    count = len(dictionary.bytesList)

    def find(picture: UInt8[np.ndarray, "h w"]) -> Mapping[int, Seen]:
        corners, ids, _ = detector.detectMarkers(picture)
        if ids is None:
            return {}
        return {
            int(marker): dict(enumerate(pixels.reshape(4, 2).astype(np.float64) + 0.5))
            for marker, pixels in zip(ids.ravel(), corners, strict=True)
        }

    return Board(dict.fromkeys(range(count), square), find)


def measure(
    board: Board,
    seen: list[Mapping[int, Seen]],
    camera: Camera,
    cam_from_world: Float[np.ndarray, "n 3 4"],
    most_px: float = 2.0,
) -> BoardScale | None:
    """Metres per scene unit; None when no plate is seen well enough by at least three placed views.

    Args:
        seen: per view, what `board.find` found, in pixels of `camera`.
        most_px: plates with a larger residual are refused: they move, or are not of the stated kind.
    """
    placed = np.asarray(np.isfinite(cam_from_world).all((1, 2)))
    logs, weights, views, residuals = [], [], set(), []
    for plate, metres in board.plates.items():
        rows = [i for i, found in enumerate(seen) if placed[i] and len(found.get(plate, ())) >= 4]
        if len(rows) < 3:
            continue
        fitted = _fit_plate(metres, [seen[i][plate] for i in rows], camera, cam_from_world[rows])
        if fitted is None or fitted[2] > most_px or fitted[1] > 0.1:
            continue
        logs.append(fitted[0])
        weights.append(1 / fitted[1] ** 2)
        residuals.append(fitted[2])
        views |= set(rows)
    if not logs:
        return None
    mean = float(np.average(logs, weights=weights))
    return BoardScale(np.exp(mean), float(np.sum(weights) ** -0.5), len(views), float(np.mean(residuals)))


def _fit_plate(
    metres: Float[np.ndarray, "k 3"],
    seen: list[Seen],
    camera: Camera,
    cam_from_world: Float[np.ndarray, "v 3 4"],
) -> tuple[float, float, float] | None:
    """Log of metres per unit, its standard error, and the residual in pixels."""
    corner = np.concatenate([list(found) for found in seen])
    view = np.repeat(np.arange(len(seen)), [len(found) for found in seen])
    pixels = np.concatenate([np.stack(list(found.values())) for found in seen])
    rays = unproject(camera, pixels)
    ids = [c for c in np.unique(corner) if (corner == c).sum() >= 2]
    if len(ids) < 4:
        return None
    points = np.stack([_intersect(rays[corner == c], cam_from_world[view[corner == c]]) for c in ids])
    units, world_from_plate = align_similarity(metres[ids], points)
    if not np.isfinite(units) or units <= 0:
        return None
    turn = Rotation.from_matrix(world_from_plate[:, :3]).as_rotvec()

    def off(x: Float[np.ndarray, " 7"]) -> Float[np.ndarray, " r"]:
        placed = np.column_stack([Rotation.from_rotvec(x[:3]).as_matrix(), x[3:6] * np.exp(x[6])])
        cam_from_plate = compose(cam_from_world, np.broadcast_to(placed, (len(seen), 3, 4)))
        here = np.exp(x[6]) * metres[corner]
        cam = np.einsum("rij,rj->ri", cam_from_plate[view, :, :3], here) + cam_from_plate[view, :, 3]
        cam[:, 2] = np.maximum(cam[:, 2], 1e-6)  # a corner behind the camera is far from where it was seen
        return (project(camera, cam) - pixels).ravel()

    start = np.concatenate([turn, world_from_plate[:, 3] / units, [np.log(units)]])
    found = least_squares(off, start, loss="soft_l1", f_scale=0.5, x_scale="jac")
    rms = float(np.sqrt(np.mean(off(found.x) ** 2)))
    information = found.jac.T @ found.jac
    if np.linalg.cond(information) > 1e15:
        return None
    stderr = float(np.sqrt(np.linalg.inv(information)[6, 6]) * max(rms, 0.02))
    return -float(found.x[6]), stderr, rms


def _intersect(rays: Float[np.ndarray, "v 2"], cam_from_world: Float[np.ndarray, "v 3 4"]) -> np.ndarray:
    """World point nearest to the viewing rays through image-plane coordinates `rays`, linear."""
    rows = np.concatenate([
        rays[:, :1, None] * cam_from_world[:, 2:3] - cam_from_world[:, 0:1],
        rays[:, 1:, None] * cam_from_world[:, 2:3] - cam_from_world[:, 1:2],
    ]).reshape(-1, 4)  # fmt: skip
    solution, *_ = np.linalg.lstsq(rows[:, :3], -rows[:, 3], rcond=None)
    return solution
