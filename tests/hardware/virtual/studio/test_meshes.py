"""Mesh files become bodies: right side out, upright, at the size asked for, with normals that the truth holds."""

import numpy as np
import pytest

from hardware.errors import StudioError
from hardware.virtual.studio import bodies, meshes, objects, truth
from hardware.virtual.studio.bodies import Thing
from tests.hardware.virtual.studio.interior import scenes


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Meshes are divided, but not to the half million triangles that paint of a picture's fineness asks for."""
    monkeypatch.setattr(meshes, "DIVIDED_FACES", 20_000)


def test_truth_normals_are_those_of_the_ball(tmp_path):
    stood = bodies.stand(Thing(str(scenes.ball(tmp_path / "ball.obj", 48)), 0.3), 0)
    maps = truth.maps(stood.body, 80, 60)
    lens = truth.camera(80, 60)
    y, x = np.mgrid[:60, :80] + 0.5
    rays = np.stack([(x - lens["cx"]) / lens["fx"], (y - lens["cy"]) / lens["fy"], np.ones_like(x)], -1)
    points = rays * maps["depth"][..., None] - [0, 0, objects.DISTANCE_M * stood.scale]
    points /= np.maximum(np.linalg.norm(points, axis=-1, keepdims=True), 1e-9)
    off = np.degrees(np.arccos(np.clip((points * maps["normal"]).sum(-1), -1, 1)))[maps["mask"]]
    assert np.ptp(stood.body.solid.vertices[:, 0]) == pytest.approx(0.3, rel=0.01)
    assert np.percentile(off, 99) < 0.5
    assert (maps["normal"][..., 2][maps["mask"]] < 0).mean() > 0.99


def test_what_is_inside_out_is_turned_and_said(tmp_path):
    right = bodies.stand(Thing(str(scenes.ball(tmp_path / "a.obj"))), 0)
    wrong = bodies.stand(Thing(str(scenes.ball(tmp_path / "b.obj", inside_out=True))), 0)
    assert right.notes == ()
    assert "inside out" in wrong.notes[0]
    facing = [truth.maps(s.body, 40, 30)["normal"][15, 20, 2] for s in (right, wrong)]
    assert max(facing) < -0.9


def test_edges_stay_sharp_and_curves_smooth(tmp_path):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    mesh = meshes.read(scenes.obj(tmp_path / "cube.obj", corners, np.array(quads)), False)
    assert np.allclose(np.abs(mesh.normals).max(1), 1)


def test_what_is_open_says_how_many_edges_have_one_face(tmp_path):
    """Whatever the file repeats of its corners, and however it rounds them."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    soup = corners[np.array(quads)].reshape(-1, 3) + np.random.default_rng(0).normal(0, 1e-9, (24, 3))
    shut = meshes.read(scenes.obj(tmp_path / "soup.obj", soup, np.arange(24).reshape(6, 4)), False)
    lidless = meshes.read(scenes.obj(tmp_path / "box.obj", corners, np.array(quads[:-1])), False)
    assert shut.notes == ()
    assert lidless.notes == ("is open: 4 boundary edges; faces seen from behind are black",)


def test_a_mesh_is_forty_centimetres_where_nothing_is_said(tmp_path):
    body = bodies.stand(Thing(str(scenes.ball(tmp_path / "ball.obj"))), 0).body
    assert np.ptp(body.solid.vertices, axis=0).max() == pytest.approx(0.4)


def test_too_many_triangles_are_thinned_out_and_said(tmp_path, monkeypatch):
    monkeypatch.setattr(meshes, "MOST_FACES", 2000)
    monkeypatch.setattr(meshes, "GRID", 16)
    monkeypatch.setattr(meshes, "DIVIDED_FACES", 0)
    mesh = meshes.read(scenes.ball(tmp_path / "ball.obj", 40), False)
    assert len(mesh.faces) < 3000
    assert "19200 triangles, thinned out to" in mesh.notes[0]


def test_the_front_is_towards_the_camera_and_up_is_up(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 0.5]], float)  # tall; its tip towards +z
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    path = scenes.obj(tmp_path / "wedge.obj", corners, faces)
    body = bodies.stand(Thing(str(path), 0.2), 0).body
    top = body.solid.vertices[body.solid.vertices[:, 1].argmin()]
    tip = body.solid.vertices[body.solid.vertices[:, 2].argmin()]
    assert top[0] < 0.01
    assert np.ptp(body.solid.vertices[:, 1]) == pytest.approx(0.2)
    assert tip[2] < objects.DISTANCE_M * 0.2 / meshes.USUAL_M


@pytest.mark.parametrize("material", ["paint", "clay", "glaze", "metal", "textured"])
def test_a_material_is_seeded_and_within_what_surfaces_are(tmp_path, material):
    path = str(scenes.ball(tmp_path / "ball.obj"))
    first, again = (bodies.stand(Thing(path, None, material), 3).body for _ in range(2))
    np.testing.assert_array_equal(first.albedo, again.albedo)
    assert 0 < first.albedo.min() <= first.albedo.max() < 1
    assert 0.1 < first.roughness.min() <= first.roughness.max() < 1
    assert (first.metalness is not None) == (material == "metal")


def test_a_glb_brings_its_own_colours_roughness_and_metalness(tmp_path):
    import trimesh

    shape = trimesh.creation.icosphere(2)
    look = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[128, 64, 32, 255], roughnessFactor=0.4, metallicFactor=1.0
    )
    shape.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(shape.vertices), 2)), material=look)
    shape.export(tmp_path / "ball.glb")
    body = bodies.stand(Thing(str(tmp_path / "ball.glb"), None, "from-file"), 0).body
    np.testing.assert_allclose(body.albedo[0], np.array([128, 64, 32]) / 255, atol=0.005)
    assert body.roughness[0] == pytest.approx(0.4)
    assert body.metalness is not None
    assert body.metalness[0] == 1


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("gone.obj", None, "there is no such mesh"),
        ("body.stl", "solid", "meshes are read from .obj, .ply, .glb"),
        ("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no faces"),
        ("nan.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices are not numbers"),
        ("flat.obj", "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "none of its faces has an area"),
        ("cut.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "cannot be read as a mesh"),
        ("cut.glb", "glTF", "cannot be read as a mesh"),
    ],
)
def test_damage_is_named(tmp_path, name, content, told):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(StudioError, match=told) as refused:
        bodies.stand(Thing(str(path)), 0)
    assert str(path) in str(refused.value)


def test_a_texture_that_is_not_there_is_named(tmp_path):
    path = scenes.ball(tmp_path / "ball.obj")
    path.write_text("mtllib ball.mtl\n" + path.read_text())
    with pytest.raises(StudioError, match=r"material file ball\.mtl is not there"):
        bodies.stand(Thing(str(path), None, "from-file"), 0)
    (tmp_path / "ball.mtl").write_text("newmtl a\nKd 1 0 0\nmap_Kd gone.png\n")
    with pytest.raises(StudioError, match=r"texture gone\.png is not there"):
        bodies.stand(Thing(str(path), None, "from-file"), 0)
