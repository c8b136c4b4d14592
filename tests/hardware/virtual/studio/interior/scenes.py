"""Little scenes and meshes that tests write."""

from pathlib import Path

import numpy as np

from hardware.virtual.studio import solids

FACES = {"+x": "0 90", "-x": "0 -90", "+z": "0 0", "-z": "0 180"}


def scene(path: Path, inner: str) -> Path:
    path.write_text(f'<scene version="3.0.0">{inner}</scene>')
    return path


def box(half: float, bsdf: str, glow: str = "") -> str:
    """A cube that is seen from inside."""
    light = f'<emitter type="area"><rgb name="radiance" value="{glow}"/></emitter>' if glow else ""
    return (
        f'<shape type="cube"><boolean name="flip_normals" value="true"/><transform name="to_world"><scale value="{half}"/>'
        f"</transform>{bsdf}{light}</shape>"
    )


def matte(albedo: str) -> str:
    return f'<bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf>'


def lamp(height: float, half: float, radiance: str) -> str:
    """A square under the ceiling that glows downwards (y is up)."""
    return (
        f'<shape type="rectangle"><transform name="to_world"><scale value="{half}"/><rotate x="1" angle="90"/>'
        f'<translate y="{height}"/></transform>{matte("0")}<emitter type="area"><rgb name="radiance" value="{radiance}"/>'
        "</emitter></shape>"
    )


def ball(path: Path, cells: int = 12, inside_out: bool = False) -> Path:
    solid = solids.ball(cells, lambda d: np.full(len(d), 1.0))
    faces = solid.faces[:, ::-1] if inside_out else solid.faces
    return obj(path, solid.vertices, faces)


def obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    lines = ["v " + " ".join(f"{x:.9g}" for x in v) for v in vertices]
    lines += ["f " + " ".join(str(k + 1) for k in f) for f in faces]
    path.write_text("\n".join(lines) + "\n")
    return path
