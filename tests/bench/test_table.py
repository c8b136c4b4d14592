"""The benchmark adds up right, and gives a session the truth through the front door."""

import json

import numpy as np
import OpenEXR

from app.bench.given import give_truth
from engine import importing
from engine import session as sessions
from tests.bench.table import Row, table, times
from tests.engine.ball import CAMERA, ball
from tests.engine.test_metrics import ring


def row(name: str, normal: float, albedo: float, registered: float) -> Row:
    scores = {
        "surface": {"normal_mean_deg": normal, "albedo_psnr_db": albedo, "roughness_in_band": albedo / 40},
        "poses": {"registered_share": registered},
    }
    return Row(name, scores, {"hdr": 10.0, "surface": 20.5}, 2_500_000_000)


def cells(text: str, first: str) -> list[str]:
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {first} ")]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_mean_and_worst_are_of_the_right_end():
    text = table([row("study-vase", 2.0, 30.0, 1.0), row("lamps-duo", 4.0, 26.0, 0.9)])
    heads = [cell.strip() for cell in text.splitlines()[0].strip("|").split("|")]
    at = {
        name: heads.index(name) for name in ("normal mean deg", "albedo dB", "registered %", "mask IoU", "s")
    }
    mean, worst = cells(text, "mean"), cells(text, "worst")
    assert (mean[at["normal mean deg"]], worst[at["normal mean deg"]]) == ("3.00", "4.00")
    assert (mean[at["albedo dB"]], worst[at["albedo dB"]]) == ("28.0", "26.0")
    assert (mean[at["registered %"]], worst[at["registered %"]]) == ("95.0", "90.0")
    assert mean[at["mask IoU"]] == "-"
    band = heads.index("roughness in band %")
    assert (mean[band], worst[band], mean[band - 1]) == ("70", "65", "-")
    assert mean[at["s"]] == "30"
    assert len({len(line) for line in text.splitlines()}) == 1


def test_times_are_told_by_stage():
    line = cells(times([row("study-vase", 2.0, 30.0, 1.0)]), "study-vase")
    assert line == ["study-vase", "10.0", "20.5", "30.5", "2.50"]


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
