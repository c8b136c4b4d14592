"""Import a simulated set's photographs again, all or some, with the truth's poses and mask: through the front door."""

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from engine import importing
from engine.errors import TruthError
from engine.io import png
from engine.io import session as sessions
from engine.io.ground_truth import read_truth
from engine.io.poses.pose_files import write_transforms
from engine.types import Poses


def give_truth(session: Path, truth_path: Path, to: Path, chosen: Sequence[int] | None = None) -> None:
    """Make the session `to` of the views `chosen` (all if None); it appears whole or not at all.

    Raises:
        TruthError: the truth holds no poses, or those of another set.
        RoomlightError: what `import` has to say.
    """
    truth = read_truth(truth_path)
    if truth.cam_from_world is None or truth.camera is None:
        raise TruthError(f"{truth_path}: holds no poses and camera to give; simulate the set again")
    views = sessions.shots(sessions.open_session(session))
    if len(views) != len(truth.cam_from_world):
        raise TruthError(
            f"{truth_path}: {len(truth.cam_from_world)} poses for {len(views)} views; not the same set"
        )
    chosen = list(range(len(views)) if chosen is None else chosen)
    scratch = Path(tempfile.mkdtemp(prefix="given-", dir=to.parent))
    try:
        photographs = scratch / "photographs"
        photographs.mkdir()
        names = []
        for index in chosen:
            view = views[index]
            for exposure, file in enumerate(view.files):
                (photographs / f"{index:04d}_{exposure}{file.suffix}").symlink_to(file.resolve())
            names.append(f"{index:04d}_0{view.files[0].suffix}")
        registered = np.ones(len(chosen), bool)
        cam_from_world = truth.cam_from_world[chosen]
        poses = Poses(truth.camera, cam_from_world, registered, np.zeros((0, 3)), "given", float("nan"))
        write_transforms(scratch / "transforms.json", poses, names)
        (scratch / "mask.png").write_bytes(png.encode(truth.mask.astype(np.uint8) * 255))
        importing.make_session(
            photographs, to, scratch / "transforms.json", scratch / "mask.png", len(views[0].files)
        )
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
