"""What each stage made, as a picture and numbers."""

import json
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from app.inspect import runs
from app.work import stage_picture
from engine.pipeline import artifacts
from tests.app import furnace


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return furnace.finished(tmp_path_factory.mktemp("made") / "lion.session")


def drawn(session: Path, stage: str, step: object = None) -> stage_picture.Made:
    run = runs.runs_of(session)[0]
    loaded = [
        artifacts.load(run.folder(part), record, kind) for part, record, kind in stage_picture._parts(stage)
    ]
    return stage_picture.DRAW[stage](step, *loaded)  # type: ignore[arg-type]


def test_photographs_become_a_contact_sheet(session: Path) -> None:
    sheet, facts = drawn(session, "hdr")
    assert facts == {"views": 9, "width": 40, "height": 30}
    assert sheet.shape == (3 * 90, 4 * 120, 4)
    assert sheet[:90].any()
    assert not sheet[200:, 200:].any()  # nine of twelve places


def test_the_mask_stands_out_of_a_photograph(session: Path) -> None:
    picture, facts = drawn(session, "segment")
    mask = furnace.surface().mask
    assert facts["share"] == pytest.approx(mask.mean(), abs=0.05)
    assert (picture == stage_picture.OUTLINE).all(-1).any() or picture.shape[1] != mask.shape[1]


def test_poses_are_seen_from_above(session: Path) -> None:
    picture, facts = drawn(session, "poses")
    assert (facts["placed"], facts["views"]) == (9, 9)
    assert (picture[..., :3] == stage_picture.DOT[:3]).all(-1).sum() > 20


def test_the_surface_is_normals_beside_albedo(session: Path) -> None:
    picture, facts = drawn(session, "surface")
    assert facts["pixels"] == furnace.surface().mask.sum()
    assert facts["stderr_deg"] > 0
    left, right = np.split(picture[..., :3].astype(int), [picture.shape[1] // 2], 1)
    assert np.ptp(left, -1).mean() > np.ptp(right, -1).mean()


def test_an_export_is_counted(session: Path, tmp_path: Path) -> None:
    (tmp_path / "export.json").write_text(json.dumps({"files": ["a.png", "b.png"]}))
    _, facts = drawn(session, "export", SimpleNamespace(folder=tmp_path))
    assert facts == {"files": 2}


def test_a_preview_stands_upright(tmp_path: Path) -> None:
    """A sensor on its side: what looks to its right looks down in the upright picture (flip 6)."""
    normals = np.zeros((20, 10, 3), np.float32)
    normals[2:6, 3:9] = [0.8, 0.0, -0.6]
    stage_picture.preview(normals, 6, tmp_path / "so-far.png")
    shown = cv2.imread(str(tmp_path / "so-far.png"), cv2.IMREAD_UNCHANGED)
    assert shown.shape == (10, 20, 4)
    blue, green, red = shown[shown[..., 3] > 0][0][:3]
    assert (int(red), int(green)) == (128, round(255 * (0.5 - 0.5 * 0.8)))
    assert blue == round(255 * 0.8)


def test_what_was_drawn_is_drawn_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    step = SimpleNamespace(stage=SimpleNamespace(name="export"), done=True, fingerprint="f", folder=tmp_path)
    surface = SimpleNamespace(stage=SimpleNamespace(name="surface"), done=True, folder=tmp_path)
    drawn_of: list[object] = []

    def draw(step: object, *records: object) -> stage_picture.Made:
        drawn_of.append(step)
        return np.zeros((2, 2, 4), np.uint8), {"files": 3}

    monkeypatch.setattr(stage_picture.results, "steps_of", lambda folder: (surface, step))
    monkeypatch.setattr(stage_picture.sessions, "open_session", lambda folder: SimpleNamespace(orientation=0))
    monkeypatch.setattr(stage_picture.artifacts, "load", lambda folder, record, kind: furnace.surface())
    monkeypatch.setattr(stage_picture, "DRAW", {"export": draw})
    first, second = (stage_picture.show({"session": str(tmp_path), "stage": "export"}) for _ in range(2))
    assert (
        first == second == {"picture": str(tmp_path / "roomlight/made/export-f.png"), "facts": {"files": 3}}
    )
    assert drawn_of == [step]
