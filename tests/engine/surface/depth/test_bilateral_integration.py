"""Depth from true normals of shapes whose depth is known."""

import numpy as np
import pytest

from engine.errors import SurfaceError
from engine.geometry import rays
from engine.progress import Progress
from engine.surface.depth import graph_laplacian
from engine.surface.depth.bilateral_integration import integrate
from engine.types import Camera
from tests.engine.surface.landscapes import blob, camera_of, on_plate, plate

CAMERA = Camera(160, 120, 150.0, 150.0, 80.0, 60.0)


def sphere(centre, radius):
    r = rays(CAMERA)
    b = r @ centre
    disc = b * b - (centre @ centre - radius**2)
    mask = disc > 1e-4
    points = r * (b - np.sqrt(np.maximum(disc, 0)))[..., None]
    return mask, np.where(mask[..., None], (points - centre) / radius, 0.0), points[..., 2]


def test_sphere_comes_back_within_two_per_mille():
    mask, normals, z = sphere(np.array([0.02, 0.01, 0.6]), 0.18)
    depth = integrate(CAMERA, normals, mask, float(z[mask].mean()), Progress())
    assert (np.abs(depth - z)[mask] / z[mask]).mean() < 0.002


def test_tilted_plane_is_exact():
    n = np.array([0.3, -0.2, -0.9])
    n /= np.linalg.norm(n)
    q = rays(CAMERA)
    q = q / q[..., 2:]
    z = -0.5 / (q @ n)
    mask = np.zeros(z.shape, bool)
    mask[20:100, 30:130] = True
    depth = integrate(CAMERA, np.broadcast_to(n, q.shape).copy(), mask, float(z[mask].mean()), Progress())
    assert (np.abs(depth - z)[mask] / z[mask]).max() < 5e-4


def test_each_island_keeps_its_own_mean():
    mask = np.zeros((120, 160), bool)
    mask[10:50, 10:50] = mask[60:110, 80:150] = True
    normals = np.zeros((120, 160, 3))
    normals[..., 2] = -1
    depth = integrate(CAMERA, normals, mask, 2.0, Progress())
    assert depth[10:50, 10:50].mean() == pytest.approx(2.0, rel=1e-6)
    assert depth[60:110, 80:150].mean() == pytest.approx(2.0, rel=1e-6)


def test_empty_mask_is_refused():
    with pytest.raises(SurfaceError, match="empty"):
        integrate(CAMERA, np.zeros((120, 160, 3)), np.zeros((120, 160), bool), 1.0, Progress())


def test_a_blob_is_exact_to_two_per_mille() -> None:
    camera = camera_of(160, 132)
    mask, normals, z = blob(camera)
    depth = integrate(camera, normals, mask, float(z[mask].mean()), Progress())
    off = np.abs(depth - z)[mask] / z[mask]
    assert off.mean() < 0.002
    assert np.quantile(off, 0.99) < 0.005


def test_on_either_side_of_a_tear_the_depth_is_exact_to_two_per_mille() -> None:
    """How high the step is, normals do not say; but it must not bend what lies on its two sides."""
    camera = camera_of(160, 132)
    mask, normals, z = plate(camera)
    depth = integrate(camera, normals, mask, 1.0, Progress())
    for side in (mask & on_plate(camera), mask & ~on_plate(camera)):
        off = np.log(depth[side] / z[side])
        assert np.abs(off - np.median(off)).mean() < 0.002


@pytest.mark.parametrize("shape", [blob, plate])
def test_multigrid_and_the_factorisation_find_the_same_depth(monkeypatch: pytest.MonkeyPatch, shape) -> None:
    camera = camera_of(96, 80)
    mask, normals, _ = shape(camera)
    direct = integrate(camera, normals, mask, 1.0, Progress())
    monkeypatch.setattr(graph_laplacian, "DIRECT", int(mask.sum()) - 1)
    large = integrate(camera, normals, mask, 1.0, Progress())
    np.testing.assert_allclose(large[mask], direct[mask], rtol=1e-4)


def test_multigrid_that_does_not_settle_is_an_error_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = camera_of(96, 80)
    mask, normals, _ = blob(camera)
    monkeypatch.setattr(graph_laplacian, "DIRECT", 0)
    monkeypatch.setattr(graph_laplacian, "TURNS", 1)
    with pytest.raises(SurfaceError, match=r"not settled after 1 turns: .*long_edge_px"):
        integrate(camera, normals, mask, 1.0, Progress())
