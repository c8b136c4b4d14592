"""A front is half as deep as it is wide: behind a block's edge is more of the block, behind a wire's there is a gap."""

import numpy as np
import pytest

from engine.geometry import rays
from engine.progress import Progress
from engine.surface.rendering.transport import direction_cells
from engine.surface.visibility.depth_mesh import depth_mesh, halves, widths
from engine.surface.visibility.hidden_surfaces import faces_of
from engine.surface.visibility.ray_visibility import trace_occlusion
from engine.types import Camera

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
MASK = np.ones((48, 64), bool)
PITCH = 1 / 60
NEAR, FAR = 0.5, 0.75
CELLS = direction_cells(2000)


def strip(first: int, last: int, far: float = FAR) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of columns that face the camera before a wall that does."""
    q = rays(CAMERA)
    column = np.arange(64)
    z = np.where((column >= first) & (column < last), NEAR, far)
    return q / q[..., 2:] * z[None, :, None], np.tile([0.0, 0.0, -1.0], (48, 64, 1))


def test_a_front_is_as_wide_as_it_reaches_and_its_corners_too() -> None:
    """To the next jump back, not to one nearer; a corner that a diagonal cuts off is no thinner."""
    points, _ = strip(20, 26)
    wide = widths(points[..., 2], MASK, 8 * PITCH)
    np.testing.assert_allclose(wide[10:-10, 20:26], 6 * np.sqrt(2))
    block = np.where(np.pad(np.ones((20, 30), bool), ((14, 14), (17, 17))), NEAR, FAR)
    np.testing.assert_allclose(widths(block, MASK, 8 * PITCH)[14, 17], 20)


def test_a_jump_that_is_less_than_the_front_is_deep_is_closed() -> None:
    points, _ = strip(0, 32, NEAR + 0.1)
    mesh = depth_mesh(points, MASK)
    np.testing.assert_array_equal(mesh.triangles[: 2 * 47 * 63], halves(MASK))
    # Beyond those of the grid all hang from the picture's border.
    hanging = mesh.pixels[2 * 47 * 63 :]
    v, u = np.divmod(hanging, 64)
    assert ((v == 0) | (v == 47) | (u == 0) | (u == 63)).all()
    assert len(hanging) == 2 * 2 * (47 + 63)


def test_a_plane_however_steep_ends_nowhere() -> None:
    q = rays(CAMERA)
    normal = np.array([np.sin(np.radians(70)), 0, -np.cos(np.radians(70))])
    mask = np.zeros(MASK.shape, bool)
    mask[:, 28:36] = True
    q = q / q[..., 2:]
    z = 0.6 * normal[2] / np.where(mask, q @ normal, normal[2])
    mesh = depth_mesh(q * z[..., None], mask)
    assert len(mesh.vertices) == mask.sum()
    assert not mesh.deep.any()


@pytest.mark.parametrize(("wide", "wall"), [(1, True), (4, True), (4, False)])
def test_a_wires_sides_end_half_as_far_back_as_it_is_wide(wide: int, wall: bool) -> None:
    """Before a wall and, where nothing else is in the picture but for some rows, before nothing."""
    points, _ = strip(30, 30 + wide)
    mask = MASK.copy()
    if not wall:
        mask[10:, :30] = mask[10:, 30 + wide :] = False
    mesh = depth_mesh(points, mask)
    u = np.nonzero(mask)[1][mesh.pixels]
    sides = ((u >= 30) & (u < 30 + wide)).all(1) & (mesh.triangles >= mask.sum()).any(1)
    assert sides.sum() >= 2 * 47 * (2 if wide > 1 else 1)
    ends = mesh.vertices[mesh.triangles[sides]][..., 2].max(1)
    deep = max(wide * np.sqrt(2) / 2, 2.0)
    assert ends.max() <= NEAR * (1 + PITCH * deep) + 1e-9
    assert ends.max() > NEAR * (1 + PITCH * min(wide / 2, deep)) - 1e-9


def test_every_wall_looks_away_from_what_it_hangs_from() -> None:
    """Though it hangs along the viewing rays, where no sign of a number that is nearly zero may say so."""
    points, _ = strip(28, 34)
    mask = MASK.copy()
    mask[:6], mask[40:, :30] = False, False
    mesh = depth_mesh(points, mask)
    hanging = (mesh.triangles >= mask.sum()).any(1)
    faces, _ = faces_of(mesh.vertices, mesh.triangles)
    assert (faces[~hanging] @ [0, 0, 1] < 0).all()
    v, u = np.stack(np.nonzero(mask))[:, mesh.pixels[hanging]].astype(int)
    front = np.pad(np.where(mask, points[..., 2], np.inf), 1, constant_values=np.inf)
    for face, rows, columns in zip(faces[hanging], v, u, strict=True):
        step = 0.75 * face[[1, 0]] / np.hypot(face[0], face[1])
        middle = [(rows.min() + rows.max()) / 2, (columns.min() + columns.max()) / 2]
        beside = [front[tuple(np.rint(middle + step + way).astype(int) + 1)] for way in (-0.1, 0.1)]
        assert np.abs(np.array(beside) - points[rows, columns, 2].max()).max() > 0.1


def test_light_comes_in_behind_a_wire_but_not_behind_a_block() -> None:
    """A point of the wall, as it looks past the strip's back towards the other side."""
    pixel = 24 * 64 + 18
    slope = np.array([1.0, 0.0, -0.4])
    way = int(np.argmax(CELLS @ (slope / np.linalg.norm(slope))))
    seen = {}
    for name, (first, last, far) in {"wire": (30, 33, FAR), "block": (22, 64, FAR)}.items():
        points, normals = strip(first, last, far)
        found = trace_occlusion(points, normals, MASK, CELLS, Progress())
        seen[name] = way not in found.part(np.array([pixel])).direction
    assert seen == {"wire": True, "block": False}


def test_the_back_of_a_wire_is_its_mirror_image_and_is_lit_as_a_wall_is() -> None:
    """Rays from the wall behind it that strike its front from within meet its back: of its paint, looking away."""
    points, normals = strip(28, 34)
    albedo = np.where((np.arange(64) >= 28) & (np.arange(64) < 34), 0.7, 0.2)[None, :, None]
    albedo = np.broadcast_to(albedo, (48, 64, 3))[MASK]
    found = trace_occlusion(points, normals, MASK, CELLS, Progress(), albedo=albedo)
    assert found.hidden_surfaces is not None
    one = found.part(np.array([24 * 64 + 26]))
    backs = one.occluder - MASK.sum()
    away = found.hidden_surfaces.normals[:, 2] > 0.9
    met = backs[(backs >= 0)]
    met = met[away[met]]
    assert len(met) > 3
    np.testing.assert_allclose(found.hidden_surfaces.albedo[met], 0.7)
    z = found.hidden_surfaces.points[met, 2]
    assert ((z > NEAR) & (z < NEAR * (1 + 10 * PITCH))).all()
    assert (CELLS[one.direction] @ [0, 0, -1] > -0.5).all()
