"""PLY files: the surface with colours, and the light in the usual layout of 3D Gaussian splats.

The surface stands as meshes usually do: x right, y up, z towards the viewer (OpenGL's camera frame), in the
unit of the depth map. Binary, little endian.
"""

import io
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from plyfile import PlyData, PlyElement

from engine.geometry import opencv_from_opengl
from engine.io.mesh import Mesh
from engine.io.png import srgb, to_8_bit
from engine.types import Surface


def surface_ply(mesh: Mesh, surface: Surface, unit: str) -> bytes:
    """Vertices with recovered normals, albedo as sRGB colour, roughness and the normal's standard error; where not all is
    of paint, with specular level and metalness."""
    row, column = mesh.pixels.T
    turned = opencv_from_opengl.T
    points = mesh.points @ turned
    normals = surface.normal[row, column].astype(np.float64) @ turned
    colours = to_8_bit(srgb(surface.albedo[row, column]))
    columns: dict[str, np.ndarray] = {
        **{name: points[:, k].astype("<f4") for k, name in enumerate(("x", "y", "z"))},
        **{name: normals[:, k].astype("<f4") for k, name in enumerate(("nx", "ny", "nz"))},
        **{name: colours[:, k] for k, name in enumerate(("red", "green", "blue"))},
        "roughness": surface.roughness[row, column].astype("<f4"),
        "stderr_normal_deg": np.degrees(surface.stderr_normal[row, column]).astype("<f4"),
    }
    if surface.material is not None:
        made = surface.material[row, column].astype("<f4")
        columns |= {"specular": made[:, 0], "metalness": made[:, 1]}
    faces = np.zeros(len(mesh.triangles), dtype=[("vertex_indices", "<i4", (3,))])
    faces["vertex_indices"] = mesh.triangles
    comments = [
        "Roomlight surface: x right, y up, z towards the viewer, origin at the camera",
        f"unit of length: {unit}",
        "red green blue: albedo, sRGB-encoded",
    ]
    return _encoded([_element("vertex", columns), PlyElement.describe(faces, "face")], comments)


def splat_ply(properties: Mapping[str, Float[np.ndarray, " k"]]) -> bytes:
    """One vertex a Gaussian with the named properties, in their order."""
    columns = {name: np.asarray(values, "<f4") for name, values in properties.items()}
    return _encoded([_element("vertex", columns)], [])


def _element(name: str, columns: Mapping[str, np.ndarray]) -> PlyElement:
    first = next(iter(columns.values()))
    table = np.zeros(len(first), dtype=[(key, values.dtype) for key, values in columns.items()])
    for key, values in columns.items():
        table[key] = values
    return PlyElement.describe(table, name)


def _encoded(elements: list[PlyElement], comments: list[str]) -> bytes:
    stream = io.BytesIO()
    PlyData(elements, text=False, byte_order="<", comments=comments).write(stream)
    return stream.getvalue()
