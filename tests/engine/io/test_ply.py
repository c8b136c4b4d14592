"""PLY bytes as plyfile and Open3D read them."""

import io
from dataclasses import replace

import numpy as np
import open3d
import pytest
from plyfile import PlyData

from engine.io.mesh import CutParams, from_depth
from engine.io.ply import splat_ply, surface_ply
from tests.engine.ball import CAMERA, CENTRE, RADIUS, ball


def test_surface_opens_elsewhere_upright_with_normals_and_colours(tmp_path):
    surface = ball()
    mesh = from_depth(surface, CAMERA, CutParams())
    (tmp_path / "surface.ply").write_bytes(surface_ply(mesh, surface, "metre"))
    read = open3d.io.read_triangle_mesh(str(tmp_path / "surface.ply"))
    points = np.asarray(read.vertices)
    centre = CENTRE * [1, -1, -1]
    inner = np.abs(mesh.image % 1 - 0.5).max(1) < 1e-6  # at the centres of pixels; the rim is smoothed
    assert np.linalg.norm(points - centre, axis=-1)[inner] == pytest.approx(RADIUS, abs=1e-6)
    assert np.asarray(read.vertex_normals)[inner] == pytest.approx(
        ((points - centre) / RADIUS)[inner], abs=1e-5
    )
    assert (np.asarray(read.triangles) == mesh.triangles).all()
    read.compute_triangle_normals()
    assert (np.asarray(read.triangle_normals)[:, 2] > 0).all()
    # Albedo's green falls with the image row, so it must rise with y.
    green = np.asarray(read.vertex_colors)[:, 1]
    assert np.corrcoef(points[:, 1], green)[0, 1] > 0.95


def test_extra_properties_keep_their_units():
    surface = ball()
    mesh = from_depth(surface, CAMERA, CutParams())
    read = PlyData.read(io.BytesIO(surface_ply(mesh, surface, "metre")))
    assert read["vertex"]["stderr_normal_deg"] == pytest.approx(np.degrees(0.02), abs=1e-5)
    assert any("metre" in comment for comment in read.comments)
    assert not read.text


def test_what_is_not_all_of_paint_says_its_material_at_every_vertex():
    plain = ball()
    made = np.zeros((*plain.mask.shape, 2), np.float32)
    made[plain.mask] = [0.75, 0.0]
    made[plain.mask & (np.arange(plain.mask.shape[1]) >= 32)] = [0.5, 1.0]
    mesh = from_depth(plain, CAMERA, CutParams())
    read = PlyData.read(io.BytesIO(surface_ply(mesh, replace(plain, material=made), "metre")))["vertex"]
    row, column = mesh.pixels.T
    np.testing.assert_array_equal(np.stack([read["specular"], read["metalness"]], -1), made[row, column])
    without = PlyData.read(io.BytesIO(surface_ply(mesh, plain, "metre")))["vertex"]
    assert "specular" not in [item.name for item in without.properties]


def test_splats_keep_names_and_order():
    names = ["x", "y", "z", "f_dc_0", "opacity", "rot_0"]
    read = PlyData.read(io.BytesIO(splat_ply({name: np.arange(5.0) + k for k, name in enumerate(names)})))
    assert [item.name for item in read["vertex"].properties] == names
    assert read["vertex"]["opacity"] == pytest.approx(np.arange(5) + 4)
