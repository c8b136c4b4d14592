"""Depth from true normals of shapes whose depth is known."""

import numpy as np
import pytest

from engine.errors import SurfaceError
from engine.geometry import rays
from engine.progress import Progress
from engine.surface.integrate import integrate
from engine.types import Camera

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
