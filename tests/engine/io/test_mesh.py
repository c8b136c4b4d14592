"""The mesh joins what is one surface, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from engine.errors import ExportError
from engine.geometry import rays, resized
from engine.io.mesh import CutParams, Mesh, from_depth, vertex_normals
from engine.results.metrics import angle_between
from engine.types import Camera
from tests.engine.ball import CAMERA, CENTRE, RADIUS, ball


def test_vertices_lie_on_the_surface_and_triangles_face_the_camera():
    mesh = from_depth(ball(), CAMERA, CutParams())
    off = np.abs(np.linalg.norm(mesh.points - CENTRE, axis=-1) - RADIUS)
    moved = np.linalg.norm(mesh.image - centres(mesh), axis=-1)
    assert off[moved < 1e-6].max() < 1e-9
    assert off.max() < 0.04 * RADIUS
    assert moved.max() < 1
    a, b, c = (mesh.points[mesh.triangles[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * a).sum(-1) < 0).all()
    assert len(np.unique(mesh.triangles)) == len(mesh.points)


def test_the_rim_is_a_curve_and_not_the_stairs_of_the_pixels():
    camera = resized(CAMERA, 256, 192)
    mesh = from_depth(ball(camera), camera, CutParams())
    edges = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs, times = np.unique(edges, axis=0, return_counts=True)
    rim = np.unique(pairs[times == 1])

    def off_circle(at: np.ndarray) -> float:
        """The spread of points about the circle that fits them best, which a ball's rim is nearly; pixels."""
        (x, y, rest), *_ = np.linalg.lstsq(np.c_[2 * at, np.ones(len(at))], (at**2).sum(1), rcond=None)
        return float((np.linalg.norm(at - [x, y], axis=1) - np.sqrt(rest + x * x + y * y)).std())

    assert off_circle(centres(mesh)[rim]) > 0.2
    assert off_circle(mesh.image[rim]) < 0.15


def centres(mesh: Mesh) -> np.ndarray:
    """x, y of the pixels that the vertices came from."""
    return mesh.pixels[:, ::-1] + 0.5


def test_a_flat_plate_uses_every_pixel_and_two_triangles_a_quad():
    surface = ball(wall=True)
    plate = replace(surface, normal=np.tile([0.0, 0.0, -1.0], (48, 64, 1)), depth=np.full((48, 64), 2.0))
    mesh = from_depth(plate, CAMERA, CutParams())
    assert len(mesh.points) == 48 * 64
    assert len(mesh.triangles) == 2 * 47 * 63
    # Pixel (0, 0) has its centre at (0.5, 0.5).
    assert mesh.points[0] == pytest.approx([2 * (0.5 - 31) / 70, 2 * (0.5 - 25) / 70, 2.0])


def test_no_triangle_joins_the_ball_to_the_wall_and_all_else_is_joined():
    on_ball = ball().mask
    mesh = from_depth(ball(wall=True), CAMERA, CutParams())
    which = on_ball[mesh.pixels[:, 0], mesh.pixels[:, 1]][mesh.triangles]
    assert (which.all(1) | ~which.any(1)).all()
    whole = sum(
        part[:-1, :-1].astype(int) + part[1:, 1:] + part[:-1, 1:] + part[1:, :-1] == 4
        for part in (on_ball, ~on_ball)
    )
    assert len(mesh.triangles) >= 2 * whole.sum()


def test_steep_but_whole_surfaces_stay_whole():
    surface = ball(resized(CAMERA, 256, 192))
    mesh = from_depth(surface, resized(CAMERA, 256, 192), CutParams())
    steep = surface.mask & ((surface.normal * rays(resized(CAMERA, 256, 192))).sum(-1) > -0.15)
    assert steep.sum() > 100
    covered = np.zeros_like(surface.mask)
    covered[mesh.pixels[:, 0], mesh.pixels[:, 1]] = True
    assert covered[surface.mask].mean() > 0.995


def test_mesh_normals_agree_with_the_sphere():
    camera = resized(CAMERA, 256, 192)
    surface = ball(camera)
    mesh = from_depth(surface, camera, CutParams())
    true = surface.normal[mesh.pixels[:, 0], mesh.pixels[:, 1]]
    inner = true[:, 2] < -0.5
    assert np.degrees(angle_between(vertex_normals(mesh), true))[inner].max() < 1.0


def test_unanswered_depth_leaves_a_hole_and_nothing_left_is_an_error():
    surface = ball()
    depth = surface.depth.copy()
    depth[20:24, 30:34] = 0
    mesh = from_depth(replace(surface, depth=depth), CAMERA, CutParams())
    assert not ((mesh.pixels >= [20, 30]) & (mesh.pixels < [24, 34])).all(1).any()
    with pytest.raises(ExportError, match="no three neighbouring pixels"):
        from_depth(replace(surface, depth=0 * depth), CAMERA, CutParams())
    with pytest.raises(ExportError, match="64 x 48 pixels but the camera 8 x 6"):
        from_depth(surface, Camera(8, 6, 9.0, 9.0, 4.0, 3.0), CutParams())
