"""A surface as one binary glTF file with the maps as physically based textures.

Source: glTF 2.0, Khronos 2021, Sec. 3.9.3 (material, tangent space) and 5. Frame: x right, y up, z towards
the viewer, the depth's unit; the node moves the object's middle to the origin. The BRDF is glTF's own:
alpha = roughness**2 and a normal reflectance of 0.04, or what `KHR_materials_specular` and metalness say. Texture coordinates are image coordinates.
Vertices carry the mesh's own normals, the normal texture what the photographs say beyond them. Where the two
disagree by more than `AGREE_DEG` (next to a cut the mesh knows least) the vertex takes the recovered normal,
so that the texture stays within the half space that glTF gives it.
"""

import numpy as np
import pygltflib as gl
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import distance_transform_edt

from engine.geometry import opencv_from_opengl
from engine.io import png
from engine.io.mesh import Mesh, along_columns, vertex_normals
from engine.types import Surface, material_of

AGREE_DEG = 70.0


def surface_glb(mesh: Mesh, surface: Surface, unit: str, generator: str) -> bytes:
    """The file's bytes: one mesh, one material, its textures (`_textures`), nothing outside the file."""
    height, width = surface.mask.shape
    turned = opencv_from_opengl.T
    points = (mesh.points @ turned).astype("<f4")
    normals, tangents = frames(mesh, surface)
    uv = (mesh.image / [width, height]).astype("<f4")
    textures = _textures(mesh, surface, normals, tangents)

    blobs: list[tuple[bytes, int | None]] = [
        (points.tobytes(), gl.ARRAY_BUFFER),
        (normals.astype("<f4").tobytes(), gl.ARRAY_BUFFER),
        (tangents.astype("<f4").tobytes(), gl.ARRAY_BUFFER),
        (uv.tobytes(), gl.ARRAY_BUFFER),
        (mesh.triangles.astype("<u4").tobytes(), gl.ELEMENT_ARRAY_BUFFER),
        *((image, None) for image in textures),
    ]
    views, body = [], b""
    for data, target in blobs:
        views.append(gl.BufferView(buffer=0, byteOffset=len(body), byteLength=len(data), target=target))
        body += data + b"\0" * (-len(data) % 4)
    count = len(points)
    accessors = [
        gl.Accessor(
            bufferView=0, componentType=gl.FLOAT, count=count, type=gl.VEC3,
            min=points.min(0).tolist(), max=points.max(0).tolist(),
        ),
        gl.Accessor(bufferView=1, componentType=gl.FLOAT, count=count, type=gl.VEC3),
        gl.Accessor(bufferView=2, componentType=gl.FLOAT, count=count, type=gl.VEC4),
        gl.Accessor(bufferView=3, componentType=gl.FLOAT, count=count, type=gl.VEC2),
        gl.Accessor(bufferView=4, componentType=gl.UNSIGNED_INT, count=mesh.triangles.size, type=gl.SCALAR),
    ]  # fmt: skip
    material = gl.Material(
        name="recovered",
        pbrMetallicRoughness=gl.PbrMetallicRoughness(
            baseColorTexture=gl.TextureInfo(index=0),
            metallicRoughnessTexture=gl.TextureInfo(index=1),
            metallicFactor=0.0 if surface.material is None else 1.0,
            roughnessFactor=1.0,
        ),
        normalTexture=gl.NormalMaterialTexture(index=2),
        doubleSided=True,
        alphaMode=gl.OPAQUE,
        alphaCutoff=None,
    )
    extensions = []
    if surface.material is not None:
        # Its reflectance head on is 0.04 times this colour: a level of 1 is twice that of paint.
        extensions.append("KHR_materials_specular")
        material.extensions = {
            extensions[0]: {"specularColorFactor": [2.0] * 3, "specularColorTexture": {"index": 3}}
        }
    primitive = gl.Primitive(
        attributes=gl.Attributes(POSITION=0, NORMAL=1, TANGENT=2, TEXCOORD_0=3), indices=4, material=0
    )
    middle = (points.max(0).astype(np.float64) + points.min(0)) / 2
    document = gl.GLTF2(
        asset=gl.Asset(version="2.0", generator=generator, extras={"unit": unit}),
        scene=0,
        scenes=[gl.Scene(nodes=[0])],
        nodes=[gl.Node(name="surface", mesh=0, translation=(-middle).tolist())],
        meshes=[gl.Mesh(name="surface", primitives=[primitive])],
        materials=[material],
        textures=[gl.Texture(source=k, sampler=0) for k in range(len(textures))],
        extensionsUsed=extensions,
        samplers=[
            gl.Sampler(
                magFilter=gl.LINEAR, minFilter=gl.LINEAR_MIPMAP_LINEAR,
                wrapS=gl.CLAMP_TO_EDGE, wrapT=gl.CLAMP_TO_EDGE,
            )
        ],
        images=[
            gl.Image(name=name, mimeType="image/png", bufferView=5 + k)
            for k, name in enumerate(("albedo", "roughness", "normal", "specular")[: len(textures)])
        ],
        accessors=accessors,
        bufferViews=views,
        buffers=[gl.Buffer(byteLength=len(body))],
    )  # fmt: skip
    document.set_binary_blob(body)
    return b"".join(document.save_to_bytes())


def frames(mesh: Mesh, surface: Surface) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 4"]]:
    """Normal and tangent (with handedness) of each vertex, glTF's frame; tangents follow the image's x."""
    row, column = mesh.pixels.T
    turned = opencv_from_opengl.T
    recovered = surface.normal[row, column].astype(np.float64) @ turned
    own = vertex_normals(mesh) @ turned
    agree = (own * recovered).sum(-1) >= np.cos(np.radians(AGREE_DEG))
    normals = np.where(agree[:, None], own, recovered)
    tangents = along_columns(mesh) @ turned
    tangents -= (tangents * normals).sum(-1, keepdims=True) * normals
    length = np.linalg.norm(tangents, axis=-1, keepdims=True)
    # Where the normal lies along the image's x there is no such tangent: any direction across it will do.
    across = np.cross([0.0, 1.0, 0.0], normals)
    tangents = np.where(length > 1e-9, tangents, across)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    # w = 1: the image's up is cross(normal, tangent), as a facing surface with y up has it.
    return normals, np.concatenate([tangents, np.ones_like(tangents[:, :1])], axis=-1)


def _textures(
    mesh: Mesh,
    surface: Surface,
    normals: Float[np.ndarray, "v 3"],
    tangents: Float[np.ndarray, "v 4"],
) -> list[bytes]:
    """Base colour (sRGB), occlusion-roughness-metal (linear), tangent-space normals (green is up); where it is not all of
    paint, the specular level (sRGB)."""
    row, column = mesh.pixels.T
    known = np.zeros(surface.mask.shape, bool)
    known[row, column] = True
    recovered = surface.normal[row, column].astype(np.float64) @ opencv_from_opengl.T
    tangent = tangents[:, :3]
    local = np.stack(
        [(recovered * axis).sum(-1) for axis in (tangent, np.cross(normals, tangent), normals)], -1
    )
    local_map = np.tile([0.0, 0.0, 1.0], (*surface.mask.shape, 1))
    local_map[row, column] = local
    rough = png.to_8_bit(surface.roughness)
    made = material_of(surface)
    packed = np.stack([np.full_like(rough, 255), rough, png.to_8_bit(made[..., 1])], axis=-1)
    pictures = [
        png.encode(_spread(png.to_8_bit(png.srgb(surface.albedo)), known), "srgb"),
        png.encode(_spread(packed, known)),
        png.encode(_spread(png.to_8_bit(local_map * 0.5 + 0.5), known)),
    ]
    if surface.material is not None:
        level = np.repeat(made[..., :1], 3, axis=-1)
        pictures.append(png.encode(_spread(png.to_8_bit(png.srgb(level)), known), "srgb"))
    return pictures


def _spread(image: UInt8[np.ndarray, "h w 3"], known: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """Unknown texels take their nearest known one, so that filtering draws no dark rim."""
    nearest = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    return image[nearest[0], nearest[1]]
