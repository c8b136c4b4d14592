"""The light in the usual 3DGS file: what another program reads there shines as ours does."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from plyfile import PlyData

from engine.io.ply import splat_ply
from engine.light.gaussians.gaussians import Y00, from_3dgs, to_3dgs
from engine.types import Gaussians
from tests.engine.light import clouds


def coloured(count: int = 40) -> Gaussians:
    """Needles and blobs that look another colour from each side."""
    room = clouds.scattered(count)
    turns = np.random.default_rng(1).normal(size=(count, 3, 3)) * 0.5
    return replace(room, radiance=np.concatenate([room.radiance, turns], axis=1))


def columns(path: Path) -> dict[str, np.ndarray]:
    vertices = PlyData.read(path)["vertex"]
    return {item.name: np.asarray(vertices[item.name]) for item in vertices.properties}


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / "light.ply"
    path.write_bytes(splat_ply(to_3dgs(coloured())))
    return path


def test_open3d_opens_it_as_a_point_cloud(written: Path):
    cloud = o3d.io.read_point_cloud(str(written))
    np.testing.assert_allclose(np.asarray(cloud.points), coloured().means, rtol=1e-6)


def test_read_back_it_renders_the_same_picture(written: Path):
    # The file holds float32 (6e-8), and a size there is a logarithm: exponents are off by some 1e-6.
    view = clouds.view(40, 30)
    before, after = clouds.traced(coloured(), view), clouds.traced(from_3dgs(columns(written)), view)
    assert before[..., :3].std() > 0.1
    np.testing.assert_allclose(after, before, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("density", [1e-5, 0.05, 1.0, 5.0, 20.0])
def test_one_gaussian_under_the_files_own_convention_has_our_peak_and_covers_our_area(density: float):
    # Theirs: sigmoid(opacity) exp(-q / 2), sizes as exp(scale), colour 0.5 + Y00 f_dc. Ours by hand beside it.
    size, r = 0.3, np.linspace(0, 4, 200_001)
    ours = Gaussians(
        np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.full((1, 3), size), np.array([density]),
        np.full((1, 1, 3), 7.0 / Y00),
    )  # fmt: skip
    file = {name: float(values[0]) for name, values in to_3dgs(ours).items()}
    theirs = np.exp(-0.5 * (r / np.exp(file["scale_0"])) ** 2) / (1 + np.exp(-file["opacity"]))
    mine = 1 - np.exp(-density * np.exp(-((r / size) ** 2)))
    assert theirs[0] == pytest.approx(mine[0], rel=1e-5)
    assert np.trapezoid(theirs * r, r) == pytest.approx(np.trapezoid(mine * r, r), rel=1e-4)
    assert 0.5 + Y00 * file["f_dc_0"] == pytest.approx(7.0, rel=1e-6)
