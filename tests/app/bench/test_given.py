"""The benchmark gives a session the truth through the front door."""

import json

import numpy as np
import OpenEXR

from app.bench.given import give_truth
from engine import importing
from engine.io import session as sessions
from tests.engine.ball import CAMERA, ball
from tests.engine.results.test_metrics import ring


def test_the_truths_poses_and_mask_arrive_in_the_second_session(tmp_path):
    photographs, truth = tmp_path / "photographs", ball()
    photographs.mkdir()
    for k in range(8):
        image = np.full((CAMERA.height, CAMERA.width, 3), 0.1 * (k + 1), np.float32)
        with OpenEXR.File({"type": OpenEXR.scanlineimage}, {"RGB": image}) as file:
            file.write(str(photographs / f"v{k}.exr"))
    importing.make_session(photographs, tmp_path / "session")
    true = ring(8)
    facts = {name: getattr(CAMERA, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    maps = {name: getattr(truth, name) for name in ("normal", "albedo", "roughness", "depth", "mask")}
    np.savez(tmp_path / "truth.npz", **maps, cam_from_world=true, camera=json.dumps(facts))
    give_truth(tmp_path / "session", tmp_path / "truth.npz", tmp_path / "given.session")
    given = sessions.open_session(tmp_path / "given.session")
    assert [len(shot.files) for shot in sessions.shots(given)] == [1] * 8
    poses = json.loads((given.folder / "edits" / "poses.json").read_text())
    assert np.allclose(list(poses["views"].values()), true, atol=1e-9)
    assert (given.folder / "edits" / "mask.png").is_file()
    assert not list(tmp_path.glob("given-*"))
