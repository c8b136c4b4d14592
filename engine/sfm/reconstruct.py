"""Find the camera's pose in every view, and its lens, from the room behind the object.

Source: structure from motion with COLMAP (Schoenberger and Frahm 2016) on features of the background only;
the object moves with the camera and would pull every pose towards standing still. One camera for all views,
principal point at the centre, one radial term. With a rig's log believed, the world is the camera's frame at
rest, in metres. Else its origin is the mean camera, y points down on average, and the unit is a metre when a
board of known size was seen, or the median distance from the cameras to the points of the room.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from jaxtyping import Bool, Float

from engine.errors import PoseError
from engine.geometry import inverse, resized
from engine.progress import Progress
from engine.sfm import epipolar, mapping
from engine.sfm import rig_alignment as rigs
from engine.sfm import scale_board as boards
from engine.sfm.features import detect, enlargement, likely_pairs, log_floor, tone_mapped
from engine.sfm.params import PoseParams
from engine.sfm.rig_alignment import RigFit, RigLog
from engine.types import Camera, Frames, Masks, Poses

# A rig is believed when it and the photographs differ by less than this, and enough views say so.
_RIG_ROTATION_RAD = np.radians(1.0)
_RIG_AGREE_SHARE = 0.6
_SCALE_STDERR = 0.05  # a length known worse than this is no length


@dataclass(frozen=True, slots=True)
class PoseReport:
    """How the poses came about; what a person should know before trusting them."""

    views: int
    placed: int  # by the photographs themselves
    from_rig: tuple[str, ...]  # placed by the rig's log alone
    unregistered: tuple[str, ...]  # without a pose
    rejected: tuple[str, ...]  # most of their matches contradicted their pose; among the two above
    models: tuple[int, ...]  # sizes of the separate models found at first; one is best
    attempts: int  # models grown until one agreed with the matches
    agreement: float  # share of the verified matches that agree with the model; too small, it was grown anew
    judged: int  # views with enough matches to tell whether their pose is right
    off: tuple[str, ...]  # of these, the ones whose pose the photographs contradict
    off_deg: float | None  # how far their matches lie from where the poses put them, median
    told_deg: float | None  # how far from where pairs of views alone would put them
    pairs: int  # pairs of views that were compared
    points: int
    observations: float  # median number of points seen by a placed view
    reprojection_px: float  # mean over all observations
    focal_px: float
    focal_expected_px: float | None  # as asked for or as pairs of views imply
    lens_doubtful: bool  # it is not the expected one, and under another points fit nearly as well
    k1: float
    scale: str
    scale_stderr: float | None  # relative
    scale_note: str
    rig_rotation_deg: float | None  # median disagreement with the rig's log
    rig_position_m: float | None
    rig_doubtful: bool  # a larger share of the path than logs of rigs are wrong by: its geometry, the lens or the poses are off
    rig_disagrees: tuple[str, ...]  # placed views that are not where the rig says


@dataclass(frozen=True, slots=True, eq=False)
class _World:
    """Poses and points in their final frame and unit."""

    cam_from_world: Float[np.ndarray, "n 3 4"]
    points: Float[np.ndarray, "m 3"]
    scale: str
    stderr: float | None
    note: str


def find_poses(
    frames: Frames, masks: Masks, rig: RigLog | None, params: PoseParams, workdir: Path, progress: Progress
) -> tuple[Poses, PoseReport]:
    """Poses of all views that can be placed. `workdir` is an empty folder that the caller owns.

    Raises:
        PoseError: too few views can be placed, or the rig's geometry or the board is not understood.
        Cancelled: a stop was asked for.
    """
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    pycolmap.set_random_seed(params.seed)
    count, height, width = frames.dark.shape
    factor = enlargement(width, height, params.features)
    logged = None if rig is None else rigs.logged_poses(rig)
    board = boards.parse(params.board) if params.board else None

    guess = _first_guess(width * factor, height * factor, params.focal_px * factor)
    database = detect(frames, masks, guess, params.features, workdir, progress.part(0.0, 0.35))
    pairs = likely_pairs(database, count, params.features, progress.part(0.35, 0.37))
    mapping.match(database, pairs, factor, params.mapping, params.seed, progress.part(0.37, 0.7))
    focal = params.focal_px * factor or mapping.calibrate(database, params.seed)
    grown = mapping.best_grown(
        database, factor, count, focal, logged, params.mapping, params.seed, progress.part(0.7, 0.97)
    )
    if grown is None:
        raise PoseError(
            f"none of {count} views could be placed: no two show the same part of the room; {_REMEDY}"
        )
    model = grown.model

    progress.step(0.97, "checking every view")
    camera = resized(_camera(model), width, height)
    found = mapping.placed(model, count)
    rejected = grown.support < params.trusted_share
    found[rejected] = np.nan
    placed = _known(found)
    if not placed.any():
        raise PoseError(f"no pose of {count} views agrees with what pairs of views have in common; {_REMEDY}")
    points = np.array([model.points3D[i].xyz for i in sorted(model.point3D_ids())]).reshape(-1, 3)
    lens = mapping.camera_of(model)
    judgement = epipolar.judge(epipolar.verified(database, lens, found), found, lens.mean_focal_length())

    fitted = None if logged is None else rigs.fit(logged, found)
    if logged is not None and fitted is not None and _believed(fitted, placed):
        world = _on_rig(fitted, logged, found, points)
    else:
        note = "" if rig is None else "the rig's log does not fit the photographs and was not used; "
        measured = None if board is None else _measured(frames, board, camera, found, factor)
        world = _settled(found, points, measured, note + _board_words(measured, params))
    registered = _known(world.cam_from_world)

    def names(which: np.ndarray) -> tuple[str, ...]:
        return tuple(name for name, chosen in zip(frames.names, which, strict=True) if chosen)

    if registered.sum() < max(3, params.least_share * count):
        lost = names(~registered)
        raise PoseError(
            f"only {registered.sum()} of {count} views could be placed (not {', '.join(lost[:3])}"
            f"{', ...' if len(lost) > 3 else ''}); {_REMEDY}"
        )
    reprojection = float(model.compute_mean_reprojection_error()) / factor
    seen = [image.num_points3D for image in model.images.values() if image.has_pose]
    report = PoseReport(
        views=count, placed=int(placed.sum()), from_rig=names(registered & ~placed),
        unregistered=names(~registered), rejected=names(rejected), models=grown.sizes, attempts=grown.attempts,
        agreement=grown.agreement, **judgement.facts(frames.names), pairs=len(pairs),
        points=len(points), observations=float(np.median(seen)), reprojection_px=reprojection,
        focal_px=camera.fx, focal_expected_px=None if focal is None else focal / factor,
        lens_doubtful=grown.lens_doubtful, k1=camera.k1, scale=world.scale, scale_stderr=world.stderr, scale_note=world.note,
        rig_rotation_deg=None if fitted is None else float(np.degrees(fitted.rotation_rad)),
        rig_position_m=None if fitted is None else fitted.position_m,
        rig_doubtful=fitted is not None and fitted.position_share > mapping.LOG_OFF,
        rig_disagrees=() if fitted is None else names(placed & ~fitted.agree),
    )  # fmt: skip
    poses = Poses(camera, world.cam_from_world, registered, world.points, world.scale, reprojection)
    return poses, report


_REMEDY = "take more views, closer together, in a room with more texture, or import with --poses"


def _known(poses: Float[np.ndarray, "n 3 4"]) -> Bool[np.ndarray, " n"]:
    return np.asarray(np.isfinite(poses).all((1, 2)))


def _first_guess(width: int, height: int, focal_px: float) -> pycolmap.Camera:
    focal = focal_px or 1.2 * max(width, height)
    camera = pycolmap.Camera(
        model="SIMPLE_RADIAL", width=width, height=height, params=[focal, width / 2, height / 2, 0.0]
    )
    camera.has_prior_focal_length = focal_px > 0
    return camera


def _camera(model: pycolmap.Reconstruction) -> Camera:
    camera = mapping.camera_of(model)
    focal, cx, cy, k1 = (float(value) for value in camera.params)
    return Camera(camera.width, camera.height, focal, focal, cx, cy, k1=k1)


def moved(
    cam_from_world: Float[np.ndarray, "n 3 4"],
    points: Float[np.ndarray, "m 3"],
    scale: float,
    new_from_world: Float[np.ndarray, "3 4"],
) -> tuple[Float[np.ndarray, "n 3 4"], Float[np.ndarray, "m 3"]]:
    """The same scene in a world x_new = R (scale x) + t; image projections stay what they were."""
    rotation, shift = new_from_world[:, :3], new_from_world[:, 3]
    turned = cam_from_world[:, :, :3] @ rotation.T
    poses = np.concatenate([turned, scale * cam_from_world[:, :, 3:] - (turned @ shift)[..., None]], axis=2)
    return poses, scale * points @ rotation.T + shift


def _believed(fitted: RigFit, placed: np.ndarray) -> bool:
    return bool(
        fitted.rotation_rad < _RIG_ROTATION_RAD
        and fitted.scale_stderr < _SCALE_STDERR
        and fitted.agree.sum() >= _RIG_AGREE_SHARE * placed.sum()
    )


def _on_rig(fitted: RigFit, logged: np.ndarray, found: np.ndarray, points: np.ndarray) -> _World:
    """Scale and frame of the rig; views that the photographs did not place stand where the rig says."""
    cam_from_world, points = moved(found, points, fitted.scale, fitted.rig_from_world)
    cam_from_world = np.where(np.isfinite(cam_from_world), cam_from_world, logged)
    return _World(cam_from_world, points, "rig", fitted.scale_stderr, "from the rig's logged geometry")


def _measured(
    frames: Frames, board: boards.Board, camera: Camera, cam_from_world: np.ndarray, factor: int
) -> boards.BoardScale | None:
    floor = log_floor(frames)
    large = resized(camera, camera.width * factor, camera.height * factor)
    seen = [board.find(tone_mapped(radiance, floor, factor)) for radiance in frames.radiance]
    return boards.measure(board, seen, large, cam_from_world)


def _board_words(measured: boards.BoardScale | None, params: PoseParams) -> str:
    if measured is None:
        asked = f"no board ({params.board}) was seen well enough; " if params.board else ""
        return asked + "one unit is the median distance from the cameras to the room"
    if measured.stderr > _SCALE_STDERR:
        return f"the board fixes the scale only to {measured.stderr:.0%}; photograph it from further apart"
    return f"from the board seen in {measured.views} views, residual {measured.residual_px:.2f} px"


def _settled(found: np.ndarray, points: np.ndarray, measured: boards.BoardScale | None, note: str) -> _World:
    """A world that reads well: origin at the mean camera, y down on average, z where the first view looks."""
    world_from_cam = inverse(found[_known(found)])
    down = world_from_cam[:, :, 1].mean(0)
    # Cameras held every way up have no common "down"; then the first view's will do.
    down = down if np.linalg.norm(down) > 0.2 else world_from_cam[0, :, 1]
    down = down / np.linalg.norm(down)
    ahead = max(world_from_cam[:, :, 2], key=lambda z: np.linalg.norm(np.cross(down, z)) > 0.3)
    right = np.cross(down, ahead)
    right = right / np.linalg.norm(right)
    rotation = np.stack([right, down, np.cross(right, down)])
    centre = world_from_cam[:, :, 3].mean(0)
    if measured is not None and measured.stderr < _SCALE_STDERR:
        scale, word, stderr = measured.metres, "board", measured.stderr
    else:
        far = np.linalg.norm(points - centre, axis=1)
        scale, word, stderr = 1 / float(np.median(far)), "unknown", None
    cam_from_world, points = moved(
        found, points, scale, np.column_stack([rotation, -scale * rotation @ centre])
    )
    return _World(cam_from_world, points, word, stderr, note)
