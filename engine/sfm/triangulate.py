"""Points of the room, where the poses were given without any: the light starts from them.

Source: triangulation from known poses as in COLMAP (Schoenberger and Frahm 2016). Features, pairs and matches are those
of `reconstruct`; the poses stay what they are, and what the matches say of them is reported.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pycolmap
from jaxtyping import Float

from engine.geometry import resized
from engine.progress import Progress
from engine.sfm import epipolar, mapping
from engine.sfm.features import detect, enlargement, likely_pairs, view_name
from engine.sfm.params import PoseParams
from engine.types import Camera, Frames, Masks, Poses


@dataclass(frozen=True, slots=True)
class GivenReport:
    """What the photographs say of poses that were given."""

    views: int
    placed: int  # that have a pose
    pairs: int  # pairs of views that were compared
    matches: int  # verified, between views that have poses
    points: int
    reprojection_px: float  # mean over all observations; NaN without points
    judged: int  # views with enough matches to tell whether their pose is right
    off: tuple[str, ...]  # of these, the ones whose pose the photographs contradict
    off_deg: float | None  # how far their matches lie from where the poses put them, median
    told_deg: float | None  # how far from where pairs of views alone would put them


def triangulate(
    frames: Frames, masks: Masks, poses: Poses, params: PoseParams, workdir: Path, progress: Progress
) -> tuple[Float[np.ndarray, "m 3"], GivenReport]:
    """Points of the room in the world of `poses`, none where the views have nothing in common; `workdir` is empty.

    Raises:
        Cancelled: a stop was asked for.
    """
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    pycolmap.set_random_seed(params.seed)
    count, height, width = frames.dark.shape
    factor = enlargement(width, height, params.features)
    lens = _lens(resized(poses.camera, width * factor, height * factor))
    database = detect(frames, masks, lens, params.features, workdir, progress.part(0.0, 0.45))
    pairs = likely_pairs(database, count, params.features, progress.part(0.45, 0.5))
    mapping.match(database, pairs, factor, params.mapping, params.seed, progress.part(0.5, 0.95))
    progress.step(0.95, "points of the room")
    out = workdir / "triangulated"
    out.mkdir()
    model = pycolmap.triangulate_points(
        _posed(database, poses), database, workdir, out,
        options=mapping.options_of(factor, params.mapping, params.seed),
    )  # fmt: skip
    points = np.array([model.points3D[i].xyz for i in sorted(model.point3D_ids())]).reshape(-1, 3)
    off = float(model.compute_mean_reprojection_error()) / factor if len(points) else float("nan")
    lens = mapping.camera_of(model)
    shared = epipolar.verified(database, lens, poses.cam_from_world)
    judgement = epipolar.judge(shared, poses.cam_from_world, lens.mean_focal_length())
    matches, placed = sum(len(pair.a) for pair in shared), int(poses.registered.sum())
    report = GivenReport(
        count, placed, len(pairs), matches, len(points), off, **judgement.facts(frames.names)
    )
    return points, report


def _lens(camera: Camera) -> pycolmap.Camera:
    values = [
        camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2
    ]  # fmt: skip
    lens = pycolmap.Camera(model="OPENCV", width=camera.width, height=camera.height, params=values)
    lens.has_prior_focal_length = True
    return lens


def _posed(database: Path, poses: Poses) -> pycolmap.Reconstruction:
    """The database's views where they were said to be, without points."""
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as opened:
        (lens,) = opened.read_all_cameras()
        model.add_camera_with_trivial_rig(lens)
        ids = {image.name: image.image_id for image in opened.read_all_images()}
    for row in np.flatnonzero(poses.registered):
        name, pose = view_name(int(row)), poses.cam_from_world[row]
        image = pycolmap.Image(name=name, camera_id=lens.camera_id, image_id=ids[name])
        rotation = pycolmap.Rotation3d(np.ascontiguousarray(pose[:, :3]))
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, pose[:, 3]))
    return model
