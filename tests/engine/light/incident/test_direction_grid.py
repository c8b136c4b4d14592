"""Light sorted into direction cells: what shading makes of it."""

import numpy as np

from engine.geometry import fibonacci_sphere
from engine.light.incident.direction_grid import (
    deconvolve,
    face_directions,
    interpolated_cells,
    pixel_solid_angles,
)


def test_sharpened_light_shades_as_the_light_itself_does():
    rng = np.random.default_rng(0)
    cells = fibonacci_sphere(512)
    fine = face_directions(64).reshape(-1, 3)
    omega = np.broadcast_to(pixel_solid_angles(64), (6, 64, 64)).ravel()
    normals = fibonacci_sphere(300)
    shading = np.maximum(normals @ cells.T, 0)
    shared = interpolated_cells(cells, 64)
    before, after = [], []
    for _ in range(10):
        middle = rng.normal(size=3)
        panel = fine @ (middle / np.linalg.norm(middle)) > 0.95  # 18 degrees to each side
        light = omega * (1 + 50 * panel)
        energy = np.zeros(512)
        np.add.at(energy, shared.index.reshape(-1, 3), shared.share.reshape(-1, 3) * light[:, None])
        energy = np.repeat(energy[None, :, None], 3, axis=2).astype(np.float32)
        again = deconvolve(energy, cells)
        np.testing.assert_allclose(again.sum(1), energy.sum(1), rtol=1e-5)
        true = np.maximum(normals @ fine.T, 0) @ light
        for kept, e in ((before, energy), (after, again)):
            off = (shading @ e[0, :, 0]) / true - 1
            kept.append((off[true > np.quantile(true, 0.67)].mean(), off.std()))
    before, after = (np.abs(x).mean(0) for x in (before, after))
    assert after[0] < 0.5 * before[0]  # what faces the panel was too dark
    assert after[1] < before[1]


def test_as_many_cells_as_may_be_asked_for_all_have_light():
    count = 65536
    even = np.full((1, count, 3), 4 * np.pi / count, np.float32)
    again = deconvolve(even, fibonacci_sphere(count))
    assert np.isfinite(again).all()
    np.testing.assert_allclose(again.sum(1, float), 4 * np.pi, rtol=1e-4)
