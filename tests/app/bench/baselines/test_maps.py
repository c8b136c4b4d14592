"""Maps computed elsewhere: read right in either frame, refused with the file, the cause and the remedy."""

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from app.bench.baselines.maps import MapFiles, read_maps
from engine.errors import ImportFault
from engine.io.png import srgb
from engine.progress import Progress
from tests.engine.ball import CAMERA, ball

BALL = ball()
TURNED = BALL.normal * [1, -1, -1]  # y up, z towards the camera


def read(files: MapFiles):
    return read_maps(files, CAMERA, BALL.mask, 0.9, Progress())


def saved(path: Path, values: np.ndarray) -> Path:
    np.save(path, values)
    return path


def png(path: Path, values: np.ndarray, kind: type = np.uint16) -> Path:
    code = np.rint(np.clip(values, 0, 1) * np.iinfo(kind).max).astype(kind)
    assert cv2.imwrite(str(path), code[..., ::-1] if code.ndim == 3 else code)
    return path


def off(normals: np.ndarray) -> float:
    cosine = (normals * BALL.normal).sum(-1)[BALL.mask]
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).max())


def test_npy_in_our_frame_comes_back_as_it_is(tmp_path: Path):
    surface = read(MapFiles(saved(tmp_path / "n.npy", BALL.normal), frame="opencv"))
    assert off(surface.normal) < 0.1
    assert np.array_equal(surface.mask, BALL.mask)
    assert np.isnan(surface.albedo[BALL.mask]).all()
    assert np.isnan(surface.roughness[BALL.mask]).all()
    assert not surface.albedo[~BALL.mask].any()


def test_png_of_a_network_is_decoded_and_turned_to_our_frame(tmp_path: Path):
    files = MapFiles(
        png(tmp_path / "n.png", np.where(BALL.mask[..., None], (TURNED + 1) / 2, 0), np.uint8),
        png(tmp_path / "a.png", srgb(BALL.albedo)),
        png(tmp_path / "r.png", BALL.roughness),
    )
    surface = read(files)
    assert off(surface.normal) < 1
    assert surface.albedo[BALL.mask] == pytest.approx(BALL.albedo[BALL.mask], abs=1e-3)
    assert surface.roughness[BALL.mask] == pytest.approx(BALL.roughness[BALL.mask], abs=1e-3)
    # The depth is that of the normals.
    ratio = surface.depth[BALL.mask] / BALL.depth[BALL.mask]
    assert ratio.std() / ratio.mean() < 0.02


def test_npz_and_exr_are_read_by_name(tmp_path: Path):
    np.savez(tmp_path / "all.npz", normal=TURNED, roughness=BALL.roughness)
    header = {"type": OpenEXR.scanlineimage}
    planes = {name: BALL.albedo[..., i].astype(np.float32).copy() for i, name in enumerate("RGB")}
    with OpenEXR.File(header, planes) as file:
        file.write(str(tmp_path / "a.exr"))
    both = tmp_path / "all.npz"
    surface = read(MapFiles(both, tmp_path / "a.exr", both))
    assert off(surface.normal) < 0.1
    assert surface.albedo[BALL.mask] == pytest.approx(BALL.albedo[BALL.mask], abs=1e-6)
    assert surface.roughness[BALL.mask] == pytest.approx(BALL.roughness[BALL.mask], abs=1e-6)


def test_pixels_a_network_left_out_are_left_out(tmp_path: Path):
    holes = BALL.normal.copy()
    holes[:20] = 0
    surface = read(MapFiles(saved(tmp_path / "n.npy", holes), frame="opencv"))
    assert not surface.mask[:20].any()
    assert np.array_equal(surface.mask[20:], BALL.mask[20:])


@pytest.mark.parametrize(
    ("values", "frame", "words"),
    [
        (BALL.normal[:-1], "opencv", ("47 x 64 x 3", "48 x 64 x 3", "resize")),
        (BALL.normal * 0.8, "opencv", ("unit length", "0.80", "(n + 1) / 2")),
        (BALL.normal * np.nan, "opencv", ("NaN", "zeros")),
        (BALL.normal * 0, "opencv", ("no normal", "uncropped")),
        (BALL.normal, "opengl", ("look away", '"opencv"')),
        (TURNED, "opencv", ("look away", '"opengl"')),
        (TURNED, "blender", ("blender", '"opencv" or "opengl"')),
        ((TURNED * 9).astype(int), "opengl", ("int64", "floats")),
    ],
)
def test_unfit_normals_are_refused(tmp_path: Path, values: np.ndarray, frame: str, words: tuple[str, ...]):
    with pytest.raises(ImportFault) as fault:
        read(MapFiles(saved(tmp_path / "n.npy", values), frame=frame))
    assert all(word in str(fault.value) for word in words)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("gone.npy", None, ("gone.npy", "no such file")),
        ("n.tif", b"", ("n.tif", ".exr", "convert")),
        ("n.png", b"not", ("n.png", "write it again")),
        ("n.exr", b"not", ("n.exr", "write it again")),
        ("n.npy", b"not", ("n.npy", "numpy.save")),
        ("n.npz", b"not", ("n.npz", "numpy.save")),
    ],
)
def test_unreadable_files_are_named(tmp_path: Path, name: str, content: bytes | None, words: tuple[str, ...]):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ImportFault) as fault:
        read(MapFiles(tmp_path / name))
    assert all(word in str(fault.value) for word in words)


def test_albedo_beyond_one_is_refused(tmp_path: Path):
    normal = saved(tmp_path / "n.npy", BALL.normal)
    albedo = saved(tmp_path / "a.npy", 3 * BALL.albedo)
    with pytest.raises(ImportFault, match=r"a\.npy: albedo .* \[0, 1\]"):
        read(MapFiles(normal, albedo, frame="opencv"))
