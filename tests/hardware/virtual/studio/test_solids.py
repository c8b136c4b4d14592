"""The virtual studio's bodies: hulls are closed and flat, and walls are not serrated at pixels."""

import numpy as np
import pytest

from hardware.virtual.studio import objects, solids, truth


def test_a_hull_of_a_cube_is_a_closed_cube() -> None:
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], float) * 0.1

    cube = solids.hull(corners, grain=0.03)

    a, b, c = (cube.vertices[cube.faces[:, k]] for k in range(3))
    assert np.einsum("fi,fi->", a, np.cross(b, c)) / 6 == pytest.approx(1e-3)  # outwards, and nothing missing
    assert np.linalg.norm(np.concatenate([b - a, c - b, a - c]), axis=1).max() <= 0.03
    assert np.allclose(np.sort(np.abs(cube.normals), axis=1), [0, 0, 1], atol=1e-6)


def test_the_reliefs_walls_are_flat() -> None:
    """No pixel stands alone: between two neighbours that agree, the normal agrees with both."""
    seen = truth.maps(objects.model("relief"), 512, 384)
    normal, mask = seen["normal"], seen["mask"]

    def agree(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return (a * b).sum(-1) > np.cos(np.radians(10))

    alone = np.zeros_like(mask)
    for axis in (0, 1):
        before, after = np.roll(normal, 1, axis), np.roll(normal, -1, axis)
        alone |= agree(before, after) & ~agree(before, normal) & mask

    assert alone.sum() < 0.002 * mask.sum()
