"""The GLB as trimesh and pygltflib read it; normals decoded as the glTF specification says."""

import io
from dataclasses import replace

import numpy as np
import pygltflib
import pytest
import trimesh
from PIL import Image

from engine.io.gltf import surface_glb
from engine.io.mesh import CutParams, from_depth
from engine.results.metrics import angle_between
from engine.types import Surface
from tests.engine.ball import CAMERA, CENTRE, RADIUS, ball


def glb(surface: Surface) -> bytes:
    return surface_glb(from_depth(surface, CAMERA, CutParams()), surface, "metre", "test")


def accessor(document: pygltflib.GLTF2, index: int) -> np.ndarray:
    """An accessor's values, read by hand from the binary chunk."""
    item = document.accessors[index]
    view = document.bufferViews[item.bufferView]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[item.type]
    kind = {5126: "<f4", 5125: "<u4"}[item.componentType]
    data = document.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    return np.frombuffer(data, kind).reshape(-1, width)[: item.count]


def texture(document: pygltflib.GLTF2, index: int) -> np.ndarray:
    image = document.images[document.textures[index].source]
    view = document.bufferViews[image.bufferView]
    data = document.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    return np.asarray(Image.open(io.BytesIO(data)))


def sampled(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Nearest texel; glTF's uv has its origin at the top left corner of the first texel."""
    height, width = image.shape[:2]
    return image[np.floor(uv[:, 1] * height).astype(int), np.floor(uv[:, 0] * width).astype(int)]


def within(uv: np.ndarray) -> np.ndarray:
    """Vertices at the centre of a pixel, which those of the rim are not."""
    return np.abs(uv * [64, 48] % 1 - 0.5).max(1) < 1e-3


def test_materials_are_said_where_not_all_is_of_paint():
    plain = ball()
    document = pygltflib.GLTF2.load_from_bytes(glb(plain))
    assert document.extensionsUsed == []
    assert document.materials[0].pbrMetallicRoughness.metallicFactor == 0
    assert len(document.images) == 3
    metal = np.arange(plain.mask.shape[1]) >= 32
    made = np.stack([np.full(plain.mask.shape, 0.8), np.broadcast_to(metal, plain.mask.shape)], -1)
    document = pygltflib.GLTF2.load_from_bytes(glb(replace(plain, material=made.astype(np.float32))))
    material = document.materials[0]
    packed = texture(document, material.pbrMetallicRoughness.metallicRoughnessTexture.index)
    assert material.pbrMetallicRoughness.metallicFactor == 1
    assert (packed[plain.mask][:, 2] == 255 * np.broadcast_to(metal, plain.mask.shape)[plain.mask]).all()
    said = material.extensions["KHR_materials_specular"]
    encoded = texture(document, said["specularColorTexture"]["index"])[plain.mask] / 255
    linear = ((encoded + 0.055) / 1.055) ** 2.4
    # 0.04 times factor times texture: what is reflected head on.
    np.testing.assert_allclose(0.04 * said["specularColorFactor"][0] * linear, 0.08 * 0.8, rtol=0.02)


@pytest.mark.parametrize("turn_deg", [0.0, 25.0, 90.0])
def test_mesh_frame_and_texture_together_give_the_recovered_normals(turn_deg):
    # Turning the recovered normals away from the mesh's own tests what the texture carries.
    surface = ball()
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turned = surface.normal @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    document = pygltflib.GLTF2.load_from_bytes(glb(replace(surface, normal=turned)))
    attributes = document.meshes[0].primitives[0].attributes
    normal, tangent, uv = (
        accessor(document, k) for k in (attributes.NORMAL, attributes.TANGENT, attributes.TEXCOORD_0)
    )
    texel = sampled(texture(document, document.materials[0].normalTexture.index), uv) / 255 * 2 - 1
    bitangent = np.cross(normal, tangent[:, :3]) * tangent[:, 3:]
    decoded = tangent[:, :3] * texel[:, :1] + bitangent * texel[:, 1:2] + normal * texel[:, 2:]
    row, column = from_depth(replace(surface, normal=turned), CAMERA, CutParams()).pixels.T
    expected = turned[row, column] * [1, -1, -1]  # OpenCV's camera frame to glTF's
    assert np.degrees(angle_between(decoded.astype(float), expected))[within(uv)].max() < 1.0
    assert texel[:, 2].min() > 0


def test_frames_are_unit_and_square():
    document = pygltflib.GLTF2.load_from_bytes(glb(ball()))
    normal, tangent = accessor(document, 1), accessor(document, 2)
    assert np.linalg.norm(normal, axis=-1) == pytest.approx(1, abs=1e-5)
    assert np.linalg.norm(tangent[:, :3], axis=-1) == pytest.approx(1, abs=1e-5)
    assert (normal * tangent[:, :3]).sum(-1) == pytest.approx(0, abs=1e-5)
    assert set(tangent[:, 3]) == {1.0}


def test_trimesh_sees_the_ball_upright_facing_the_viewer_and_centred():
    scene = trimesh.load(io.BytesIO(glb(ball())), file_type="glb")
    mesh = scene.to_geometry()
    points = np.asarray(mesh.vertices)
    assert (points.max(0) + points.min(0)) == pytest.approx([0, 0, 0], abs=1e-5)
    assert (mesh.face_normals[:, 2] > 0).all()
    # The middle of the ball bulges towards +z.
    middle = np.linalg.norm(points[:, :2] - 0, axis=-1) < 0.05
    assert points[middle, 2].mean() > points[:, 2].mean()
    (name,) = scene.geometry
    off = np.linalg.norm(scene.geometry[name].vertices - CENTRE * [1, -1, -1], axis=-1) - RADIUS
    assert np.median(np.abs(off)) < 1e-5
    assert np.abs(off).max() < 0.04 * RADIUS  # at the smoothed rim


def test_textures_hold_albedo_and_roughness_where_gltf_wants_them():
    surface = ball()
    document = pygltflib.GLTF2.load_from_bytes(glb(surface))
    material = document.materials[0].pbrMetallicRoughness
    uv = accessor(document, 3)
    column, row = np.floor(uv * [64, 48]).astype(int).T
    known = surface.mask[row, column]  # smoothing carries some of the rim beyond it
    assert known.mean() > 0.99
    base = sampled(texture(document, material.baseColorTexture.index), uv) / 255
    linear = np.where(base <= 0.04045, base / 12.92, ((base + 0.055) / 1.055) ** 2.4)
    assert linear[known] == pytest.approx(surface.albedo[row, column][known], abs=0.006)
    packed = sampled(texture(document, material.metallicRoughnessTexture.index), uv)
    assert packed[known, 1] / 255 == pytest.approx(surface.roughness[row, column][known], abs=0.003)
    assert (packed[:, 2] == 0).all()
    assert material.metallicFactor == 0
    assert material.roughnessFactor == 1


def test_no_dark_rim_outside_the_mask():
    document = pygltflib.GLTF2.load_from_bytes(glb(ball()))
    assert texture(document, 0).min() > 60


@pytest.mark.parametrize(
    ("towards", "colour"),
    [((0.5, 0, -(0.75**0.5)), (191, 128, 238)), ((0, -0.5, -(0.75**0.5)), (128, 191, 238))],
    ids=["right is red", "up is green"],
)
def test_on_a_plate_that_faces_the_camera_the_texture_has_the_values_worked_out_by_hand(towards, colour):
    plate = replace(
        ball(wall=True), normal=np.tile(towards, (48, 64, 1)).astype(float), depth=np.full((48, 64), 2.0)
    )
    document = pygltflib.GLTF2.load_from_bytes(glb(plate))
    assert np.abs(texture(document, 2).astype(int) - colour).max() <= 1
    assert accessor(document, 1) == pytest.approx(np.tile([0, 0, 1], (48 * 64, 1)), abs=1e-6)
    assert accessor(document, 2) == pytest.approx(np.tile([1, 0, 0, 1], (48 * 64, 1)), abs=1e-6)
