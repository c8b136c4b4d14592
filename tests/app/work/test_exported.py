"""What of an export can be looked at: its pictures, its panorama, its mesh from aside."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.exports import FORMATS
from app.work import exported
from tests.engine.results.test_export import write


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    to = tmp_path_factory.mktemp("export") / "out"
    write(to)
    return to


def picture(folder: Path, key: str) -> np.ndarray | None:
    found = exported.show({"folder": str(folder), "format": key})["picture"]
    return None if found is None else cv2.imread(found, cv2.IMREAD_UNCHANGED)


def test_every_format_of_pictures_or_shape_is_shown_and_no_other(folder: Path) -> None:
    shown = {entry.key for entry in FORMATS if picture(folder, entry.key) is not None}
    assert shown == {entry.key for entry in FORMATS} - {"colmap", "transforms", "materials"}


def test_a_mesh_is_a_whole_shape_lit_from_the_eye(folder: Path) -> None:
    mesh = picture(folder, "ply")
    assert mesh is not None
    inside = mesh[..., 3] > 0
    assert inside.mean() > 0.3
    closed = cv2.morphologyEx(inside.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    assert inside.sum() > 0.9 * closed.sum()  # hardly a hole
    assert mesh[inside][:, :3].std() > 5
