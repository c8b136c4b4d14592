"""The bundled session for tests: copies of it, whole or thinned, and its truth at a third of the size."""

import shutil
from pathlib import Path

import cv2
import numpy as np

from app import demo
from engine.importing import encode_poses
from engine.io import session as sessions
from engine.io.ground_truth import read_truth
from engine.io.poses.pose_files import GivenPoses

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "demo" / "session"
TRUTH = ROOT / "demo" / "truth"
SMALLER = 3
CAPTURE = ROOT / "tests" / "captures" / "blob-by-hand"
"""Another session and its truth: 48 brackets of 320 x 240 by hand in the built-in room `study`, for checks of single shots."""


def copy(source: Path, to: Path, views: int | None = None) -> Path:
    """Photographs and facts of a session, no results; the first `views` of them."""
    demo.copy(source, to)
    shots = sorted((to / "shots").iterdir())
    for shot in shots[len(shots) if views is None else views :]:
        shutil.rmtree(shot)
    return to


def give_truth(folder: Path) -> float:
    """Mask and poses of the truth as given inputs; returns the distance of the object, in their unit."""
    truth = read_truth(TRUTH)
    assert truth.camera is not None
    assert truth.cam_from_world is not None
    session = sessions.open_session(folder)
    views = sessions.shots(session)
    rows = [int(view.folder.name) for view in views]
    poses = truth.cam_from_world[rows]
    given = GivenPoses(truth.camera, poses, np.ones(len(rows), bool), np.zeros((0, 3)), "given", ())
    sessions.write_edit(session, "poses.json", encode_poses(given, [view.name for view in views]))
    _, png = cv2.imencode(".png", truth.mask.astype(np.uint8) * 255)
    sessions.write_edit(session, "mask.png", png.tobytes())
    return float(np.median(truth.depth[truth.mask]))


def small_truth(to: Path) -> Path:
    """The truth for photographs averaged down by `SMALLER`, as an .npz."""
    truth, n = read_truth(TRUTH), SMALLER
    height, width = truth.mask.shape[0] // n, truth.mask.shape[1] // n

    def blocks(image: np.ndarray) -> np.ndarray:
        return image.reshape(height, n, width, n, -1).mean((1, 3))

    share = blocks(truth.mask[..., None])

    def averaged(image: np.ndarray) -> np.ndarray:
        return blocks(image * truth.mask[..., None]) / np.maximum(share, 1 / n**2)

    normal = averaged(truth.normal)
    np.savez(
        to,
        normal=normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9),
        albedo=averaged(truth.albedo),
        roughness=averaged(truth.roughness[..., None])[..., 0],
        depth=averaged(truth.depth[..., None])[..., 0],
        mask=share[..., 0] >= 0.5,
        cam_from_world=truth.cam_from_world,
    )
    return to
