"""Records survive the disk, and equal records give equal bytes."""

import errno
import hashlib
import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from engine.errors import SessionError
from engine.pipeline import artifacts
from engine.types import Camera, Emitters, Frames, Gaussians, Lamps, Poses

CAMERA = Camera(8, 6, 10.0, 10.0, 4.0, 3.0)


def frames(seed: int = 0) -> Frames:
    rng = np.random.default_rng(seed)
    radiance = rng.random((3, 6, 8, 3)).astype(np.float32)
    return Frames(
        ("a", "b", "c"), radiance, radiance[..., 0] > 0.9, radiance[..., 1] < 0.1, (0.01, float("inf"))
    )


def poses() -> Poses:
    matrices = np.full((3, 3, 4), np.nan)
    matrices[0] = np.eye(3, 4)
    return Poses(CAMERA, matrices, np.array([True, False, False]), np.zeros((0, 3)), "given", float("nan"))


def digest(folder: Path) -> str:
    content = b"".join(path.name.encode() + path.read_bytes() for path in sorted(folder.iterdir()))
    return hashlib.sha256(content).hexdigest()


def test_frames_come_back_exactly_and_read_only(tmp_path: Path) -> None:
    before = frames()
    artifacts.save(tmp_path, "frames", before)
    after = artifacts.load(tmp_path, "frames", Frames)
    assert after.names == before.names
    assert after.noise == before.noise
    for name in ("radiance", "clipped", "dark"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
        assert getattr(after, name).dtype == getattr(before, name).dtype
        with pytest.raises(ValueError, match="read-only"):
            getattr(after, name)[0] = 0


def test_nested_records_empty_arrays_and_nan_come_back(tmp_path: Path) -> None:
    artifacts.save(tmp_path, "poses", poses())
    after = artifacts.load(tmp_path, "poses", Poses)
    assert after.camera == CAMERA
    assert after.points.shape == (0, 3)
    assert np.isnan(after.reprojection_px)
    np.testing.assert_array_equal(after.cam_from_world, poses().cam_from_world)


def test_a_record_of_records_of_arrays_comes_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    gaussians = Gaussians(*(rng.random(shape) for shape in ((5, 3), (5, 4), (5, 3), (5,), (5, 1, 3))))
    lamps = Lamps(rng.random((1, 3)), rng.random(1), rng.random((1, 3)), np.array([True]))
    artifacts.save(tmp_path, "emitters", Emitters(gaussians, lamps, 2))
    after = artifacts.load(tmp_path, "emitters", Emitters)
    assert after.patches == 2
    np.testing.assert_array_equal(after.gaussians.means, gaussians.means)
    np.testing.assert_array_equal(after.shown().radiance, gaussians.radiance[:2])
    np.testing.assert_array_equal(after.field().density, gaussians.density[:4])
    assert after.lamps.clipped.tolist() == [True]
    (tmp_path / "emitters.lamps.json").unlink()
    with pytest.raises(SessionError, match=r"emitters\.lamps\.json"):
        artifacts.load(tmp_path, "emitters", Emitters)


def test_equal_records_give_equal_bytes_whatever_the_memory_layout(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.mkdir(), two.mkdir()
    artifacts.save(one, "frames", frames())
    again = frames()
    turned = Frames(again.names, np.asfortranarray(again.radiance), again.clipped, again.dark, again.noise)
    artifacts.save(two, "frames", turned)
    assert digest(one) == digest(two)
    artifacts.save(two, "frames", frames(1))
    assert digest(one) != digest(two)


def test_an_array_that_grew_in_its_place_is_left_there_with_the_same_bytes(tmp_path: Path) -> None:
    one, two, before = tmp_path / "one", tmp_path / "two", frames()
    one.mkdir(), two.mkdir()
    artifacts.save(one, "frames", before)
    placed = artifacts.place(two, "frames.radiance", before.radiance.shape)
    placed[:] = before.radiance
    inode = (two / "frames.radiance.npy").stat().st_ino
    artifacts.save(two, "frames", replace(before, radiance=placed))
    assert (two / "frames.radiance.npy").stat().st_ino == inode
    assert digest(one) == digest(two)


def test_a_disk_without_room_for_an_array_is_told_before_it_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(SessionError, match=r"frames\.radiance\.npy.*(?i:space|full)"):
        artifacts.place(tmp_path, "frames.radiance", (3, 4))


@dataclass(frozen=True, slots=True)
class Fit:
    ratio: float
    label: str | None


@dataclass(frozen=True, slots=True)
class Report:
    fits: tuple[Fit, ...]
    by_name: dict[str, float]
    flags: dict[str, int]
    pair: tuple[int, float]
    best: Fit | None
    notes: list[str]


def test_reports_come_back_as_what_they_were(tmp_path: Path) -> None:
    report = Report(
        (Fit(1.0, None), Fit(float("nan"), "x")),
        {"a": float("-inf")},
        {"b": 2},
        (1, 2.0),
        Fit(3.0, "y"),
        ["n"],
    )
    artifacts.save(tmp_path, "report", report)
    after = artifacts.load(tmp_path, "report", Report)
    assert repr(after) == repr(report)


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    artifacts.save(tmp_path, "frames", frames())
    (tmp_path / "frames.radiance.npy").write_bytes(b"\x93NUMPY")
    with pytest.raises(SessionError, match=r"frames\.json"):
        artifacts.load(tmp_path, "frames", Frames)


@pytest.mark.parametrize("content", [None, "", "[]", "{}", "{"])
def test_a_value_that_cannot_be_read_names_the_folder_to_remove(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "export.json").write_text(content)
    with pytest.raises(SessionError, match=rf"export\.json: .*; remove the folder {tmp_path} and process"):
        artifacts.load_value(tmp_path / "export.json", "files")


def packed(folder: Path, shape: list[int]) -> None:
    """`frames` as sessions had them at first: booleans as bits."""
    artifacts.save(folder, "frames", frames())
    np.save(folder / "frames.clipped.npy", np.packbits(frames().clipped))
    content = json.loads((folder / "frames.json").read_bytes())
    content["arrays"]["clipped"]["shape"] = shape
    (folder / "frames.json").write_text(json.dumps(content))


def test_booleans_packed_to_bits_are_read(tmp_path: Path) -> None:
    packed(tmp_path, [3, 6, 8])
    clipped = artifacts.load(tmp_path, "frames", Frames).clipped
    np.testing.assert_array_equal(clipped, frames().clipped)


def test_a_shape_that_no_array_has_is_damage_too(tmp_path: Path) -> None:
    packed(tmp_path, [3, 6, 10**30])
    with pytest.raises(SessionError, match=r"frames\.json"):
        artifacts.load(tmp_path, "frames", Frames)
