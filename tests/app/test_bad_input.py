"""Bad photographs, poses and masks at the command line: exit code 2, one line with file, cause and remedy.

Faults of the session itself (schema, disk, permission, a second process) are in test_cli.py.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli import main
from hardware.virtual import dng
from hardware.virtual.sensor import Sensor, bracket
from tests.app.test_cli import digest, refused
from tests.engine.test_importing import (
    HEIGHT,
    START,
    VIEWS,
    WIDTH,
    scene,
    write_exr,
    write_mask,
    write_poses,
    write_raw_view,
)

Breaking = Callable[[Path], None]


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    for kind in ("raw", "linear"):
        (folder / kind).mkdir()
    for number in range(VIEWS):
        write_raw_view(folder / "raw", number, scene(number))
        write_exr(folder / "linear" / f"{number:04d}.exr", scene(number))
    return folder


def copied(photographs: Path, kind: str, to: Path) -> Path:
    to.mkdir()
    for path in (photographs / kind).iterdir():
        (to / path.name).write_bytes(path.read_bytes())
    return to


def truncated(folder: Path) -> None:
    path = folder / "IMG_0007.DNG"
    path.write_bytes(path.read_bytes()[:-500])


def other_camera(folder: Path) -> None:
    photograph = bracket(scene(4), 0.01, Sensor(), START, np.random.default_rng(0))[0]
    dng.write(folder / "IMG_0012.DNG", dataclasses.replace(photograph, model="Roomlight Virtual Two"))


def emptied(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def filled(content: bytes) -> Breaking:
    def breaking(folder: Path) -> None:
        (folder / "IMG_0004.DNG").write_bytes(content)

    return breaking


def other_size(folder: Path) -> None:
    write_raw_view(folder, VIEWS, scene(0, WIDTH + 2))


def incomplete(folder: Path) -> None:
    (folder / "IMG_0010.DNG").unlink()


def clipped(folder: Path) -> None:
    write_raw_view(folder, VIEWS, np.full((HEIGHT, WIDTH, 3), 1e5))


def other_image(folder: Path) -> None:
    write_exr(folder / "0005.exr", scene(0, 20, 20))


def cut_image(folder: Path) -> None:
    (folder / "0002.exr").write_bytes(b"v/1\x01")


def few(folder: Path) -> None:
    for path in sorted(folder.iterdir())[15:]:
        path.unlink()


def poisoned(value: float) -> Breaking:
    def breaking(folder: Path) -> None:
        image = scene(3)
        image[5, 7, 1] = value
        write_exr(folder / "0003.exr", image)

    return breaking


@pytest.mark.parametrize(
    ("kind", "breaking", "told"),
    [
        ("raw", emptied, ("card", "no photographs", "must hold RAW files")),
        ("raw", truncated, ("IMG_0007.DNG", "cut off", "copy the file again")),
        ("raw", filled(b"not raw" * 99), ("IMG_0004.DNG", "not a RAW file", "copy it again")),
        ("raw", filled(b""), ("IMG_0004.DNG", "cut off", "copy the file again")),
        ("raw", other_camera, ("IMG_0012.DNG", "two cameras are mixed", "of one camera")),
        ("raw", other_size, ("IMG_0024.DNG", "two sizes are mixed", "at one size")),
        ("raw", incomplete, ("IMG_0009.DNG", "incomplete bracket", "add the missing exposure")),
        ("raw", clipped, ("IMG_0024.DNG", "100% of the pixels are clipped", "a shorter one")),
        ("raw", few, ("card", "5 views of 15 files", "photograph more")),
        ("linear", poisoned(np.nan), ("0003.exr", "are NaN, the first at x 7, y 5", "fix the export")),
        ("linear", poisoned(np.inf), ("0003.exr", "are Inf, the first at x 7, y 5", "clip to")),
        ("linear", poisoned(-0.5), ("0003.exr", "are negative, the first at x 7, y 5", "clip to zero")),
        ("linear", other_image, ("0005.exr", "two sizes are mixed", "at one size")),
        ("linear", cut_image, ("0002.exr", "cut off", "export it again")),
    ],
)
def test_bad_photographs(
    photographs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    breaking: Breaking,
    told: tuple[str, ...],
) -> None:
    folder = copied(photographs, kind, tmp_path / "card")
    breaking(folder)
    line = refused(capsys, "import", folder, tmp_path / "new.session")
    assert all(part in line for part in told), line
    assert [path.name for path in tmp_path.iterdir()] == ["card"]


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        ({"name": "other_{}.exr"}, ("transforms.json", "no pose for")),
        ({"stretch": 1.2}, ("transforms.json", "not orthonormal")),
        ({"count": 5}, ("transforms.json", "no pose for 3 of 8")),
    ],
)
def test_bad_poses(
    photographs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    broken: dict,
    told: tuple[str, ...],
) -> None:
    poses = write_poses(tmp_path / "transforms.json", **broken)
    line = refused(capsys, "import", photographs / "linear", tmp_path / "new.session", "--poses", poses)
    assert all(part in line for part in (*told, ";")), line
    assert [path.name for path in tmp_path.iterdir()] == ["transforms.json"]


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        ({"width": WIDTH + 1}, ("mask.png", "the mask is 49 x 32", "48 x 32")),
        ({"white": False}, ("mask.png", "the mask is no object", ";")),
    ],
)
def test_bad_masks(
    photographs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    broken: dict,
    told: tuple[str, ...],
) -> None:
    mask = write_mask(tmp_path / "mask.png", **broken)
    line = refused(capsys, "import", photographs / "linear", tmp_path / "new.session", "--mask", mask)
    assert all(part in line for part in told), line
    assert [path.name for path in tmp_path.iterdir()] == ["mask.png"]


def test_a_mask_that_is_put_into_a_session_later_is_checked_too(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "new.session"
    assert main(["import", str(photographs / "linear"), str(session)]) == 0
    cv2.imwrite(str(session / "edits" / "mask.png"), np.full((5, 5), 255, np.uint8))
    assert main(["process", str(session), "--until", "hdr", "--device", "cpu"]) == 0
    before = digest(session)
    line = refused(capsys, "process", session, "--until", "segment", "--device", "cpu")
    assert "mask.png: the mask is 5 x 5" in line
    assert digest(session) == before
