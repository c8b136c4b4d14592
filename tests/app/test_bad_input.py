"""Bad photographs, poses and masks at the command line: exit code 2, one line with file, cause and remedy.

Faults of the session itself (schema, disk, permission, a second process) are in test_cli.py.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli import main
from tests.app.calls import digest, refused
from tests.app.sessions import small
from tests.engine import folders, foreign_raw

THERE = "the first at x 7, y 5"  # where `folders.poisoned` puts its value


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("photographs")
    folders.write_raw(folder / "raw")
    folders.write_linear(folder / "linear")
    return folder


@pytest.mark.parametrize(
    ("kind", "breaking", "told"),
    [
        ("raw", folders.emptied, ("card", "no photographs", "must hold RAW files")),
        ("raw", folders.truncated, ("IMG_0007.DNG", "cut off", "copy the file again")),
        ("raw", folders.truncated_beside_a_gap, ("IMG_0007.DNG", "cut off", "copy the file again")),
        ("raw", folders.filled(b"not raw" * 99), ("IMG_0004.DNG", "not a RAW file", "copy it again")),
        ("raw", folders.filled(b""), ("IMG_0004.DNG", "cut off", "copy the file again")),
        ("raw", folders.other_camera, ("IMG_0012.DNG", "two cameras are mixed", "of one camera")),
        ("raw", folders.other_size, ("IMG_0024.DNG", "two sizes are mixed", "at one size")),
        ("raw", folders.incomplete, ("IMG_0009.DNG", "no whole bracket", "photograph more")),
        ("raw", folders.clipped, ("IMG_0024.DNG", "100% of the pixels are clipped", "a shorter one")),
        ("raw", folders.few, ("card", "5 views of 15 files", "photograph more")),
        ("linear", folders.poisoned(np.nan), ("0003.exr", f"are NaN, {THERE}", "fix the export")),
        ("linear", folders.poisoned(np.inf), ("0003.exr", f"are Inf, {THERE}", "clip to")),
        ("linear", folders.poisoned(-5.0), ("0003.exr", f"are negative, {THERE}", "clip to zero")),
        ("linear", folders.other_image, ("0005.exr", "two sizes are mixed", "at one size")),
        ("linear", folders.cut_image, ("0002.exr", "cut off", "export it again")),
    ],
)
def test_bad_photographs(
    photographs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kind: str,
    breaking: folders.Breaking,
    told: tuple[str, ...],
) -> None:
    folder = shutil.copytree(photographs / kind, tmp_path / "card")
    breaking(folder)
    line = refused(capsys, "import", folder, tmp_path / "new.session")
    assert all(part in line for part in told), line
    assert [path.name for path in tmp_path.iterdir()] == ["card"]


def test_libraries_write_nothing_beside_our_one_line(
    photographs: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for number in range(8):
        mosaic = foreign_raw.counts(96, 128, seed=number)
        path = foreign_raw.write_raf(tmp_path / f"DSCF{number}.RAF", "GFX 50S", mosaic, 1022)
    path.write_bytes(
        path.read_bytes()[:-900]
    )  # of which LibRaw says on stderr that the file ends unexpectedly
    assert main(["import", str(tmp_path), str(tmp_path / "new.session")]) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "DSCF7.RAF: its pixels cannot be decoded, the file is cut off" in lines[0]


@pytest.mark.parametrize(
    ("option", "write", "broken", "told"),
    [
        ("--poses", folders.write_poses, {"name": "other_{}.exr"}, ("no pose for",)),
        ("--poses", folders.write_poses, {"stretch": 1.2}, ("not orthonormal",)),
        ("--poses", folders.write_poses, {"count": 4}, ("no pose for 4 of 8",)),
        ("--mask", folders.write_mask, {"width": 49}, ("the mask is 49 x 32", "48 x 32")),
        ("--mask", folders.write_mask, {"white": False}, ("the mask is no object",)),
    ],
)
def test_bad_poses_and_masks(
    photographs: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    option: str,
    write: Callable[..., Path],
    broken: dict,
    told: tuple[str, ...],
) -> None:
    name = {"--poses": "transforms.json", "--mask": "mask.png"}[option]
    given = write(tmp_path / name, **broken)
    line = refused(capsys, "import", photographs / "linear", tmp_path / "new.session", option, given)
    assert all(part in line for part in (f"{name}: ", *told, ";")), line
    assert [path.name for path in tmp_path.iterdir()] == [name]


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


LONG = "n" * 300  # a name may have 255 letters
SHOT = ("--room", "window", "--object", "blob", "--device", "cpu")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("report", "small/a.session", "--to", "folder"), "folder: is a folder; name a file"),
        (("report", "small/a.session", "--to", "file/x.html"), "file: exists already; choose another name"),
        (("report", "small/a.session", "--to", "file/a/x.html"), "a part of this path is a file"),
        (("report", "small/a.session", "--to", f"{LONG}/x.html"), "choose a shorter one"),
        (("import", "small/renders", "file/s"), "file: exists already; choose another name"),
        (("import", "small/renders", LONG), "choose a shorter one"),
        (("import", "small/renders", "n" * 250), "choose a shorter one"),
        (("simulate", "file", *SHOT), "a part of this path is a file"),
        (("simulate", LONG, *SHOT), "choose a shorter one"),
        (("demo", "--to", "file"), "a part of this path is a file"),
        (("demo", "--to", LONG), "choose a shorter one"),
        (("plan", LONG), "choose a shorter one"),
    ],
)
def test_a_place_that_cannot_be_is_told(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    told: str,
) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    small(tmp_path / "small")
    before = digest(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert told in refused(capsys, *words)
    assert digest(tmp_path) == before


def test_what_may_not_be_opened_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Permissions do not bind root, who runs the tests in a container: the system's answer is put in its mouth.
    locked = tmp_path / "locked" / "session"

    def closed(self: Path, **_: object) -> bool:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "exists", closed)
    words = ["simulate", locked.parent, "--room", "study", "--object", "blob"]
    assert f"{locked}: no permission to open" in refused(capsys, *words)
