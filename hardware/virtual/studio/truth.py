"""Read off what is really there: the body's normals, albedo, roughness and depth at pixel centres.

A z-buffer in float64, independent of the path tracer. Camera frame; normals are the interpolated
shading normals that the reflectance model sees, facing normals have z < 0; depth is along z, metres.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from hardware.virtual.studio.objects import Body

FIELD_OF_VIEW_DEG = 62.0


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Everything a reconstruction may be compared with; zero outside `mask`."""

    normal: Float[np.ndarray, "h w 3"]
    albedo: Float[np.ndarray, "h w 3"]
    roughness: Float[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    mask: Bool[np.ndarray, "h w"]
    camera: dict[str, float]
    cam_from_world: Float[np.ndarray, "n 3 4"]
    panoramas: Float[np.ndarray, "n 128 256 3"]

    def save(self, folder: Path) -> None:
        """Write `truth.npz` and one EXR per view's panorama into `folder`."""
        import OpenEXR

        (folder / "panoramas").mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            folder / "truth.npz",
            normal=self.normal,
            albedo=self.albedo,
            roughness=self.roughness,
            depth=self.depth,
            mask=self.mask,
            camera=json.dumps(self.camera),
            cam_from_world=self.cam_from_world,
        )
        for index, panorama in enumerate(self.panoramas):
            header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
            with OpenEXR.File(header, {"RGB": np.ascontiguousarray(panorama)}) as exr:
                exr.write(str(folder / "panoramas" / f"{index:04d}.exr"))


def camera(width: int, height: int) -> dict[str, float]:
    """The studio's lens: a pinhole without distortion, fields named as calibration files name them."""
    focal = width / 2 / np.tan(np.radians(FIELD_OF_VIEW_DEG) / 2)
    lens = {
        "fx": focal,
        "fy": focal,
        "cx": width / 2,
        "cy": height / 2,
        "k1": 0.0,
        "k2": 0.0,
        "p1": 0.0,
        "p2": 0.0,
    }
    return {"width": width, "height": height, **lens}


def maps(body: Body, width: int, height: int) -> dict[str, np.ndarray]:
    """`normal`, `albedo`, `roughness`, `depth` and `mask` of `body`, at the pixel centres."""
    face, weights = visible(body, width, height)
    mask = face >= 0
    corners = body.solid.faces[np.where(mask, face, 0)]

    def at(values: np.ndarray) -> np.ndarray:
        mixed = np.einsum("hwk,hwk...->hw...", weights, values[corners])
        return np.where(mask.reshape(mask.shape + (1,) * (mixed.ndim - 2)), mixed, 0.0)

    normal = at(body.solid.normals)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    depth = at(body.solid.vertices)[..., 2]
    return {
        "normal": normal.astype(np.float32),
        "albedo": at(body.albedo).astype(np.float32),
        "roughness": at(body.roughness).astype(np.float32),
        "depth": depth.astype(np.float32),
        "mask": mask,
    }


def touched(body: Body, width: int, height: int, finer: int = 4) -> Bool[np.ndarray, "h w"]:
    """Pixels that the body covers at least in part, and one ring more to be sure."""
    face, _ = visible(body, width * finer, height * finer)
    some = (face >= 0).reshape(height, finer, width, finer).any((1, 3))
    grown = np.array(some)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            grown |= np.roll(some, (dy, dx), (0, 1))
    return grown


def visible(body: Body, width: int, height: int) -> tuple[Int[np.ndarray, "h w"], Float[np.ndarray, "h w 3"]]:
    """Nearest face behind every pixel centre (-1: none) and its perspective-correct corner weights."""
    lens = camera(width, height)
    points = body.solid.vertices
    pixels = points[:, :2] / points[:, 2:] * lens["fx"] + [lens["cx"], lens["cy"]]
    triangles = pixels[body.solid.faces]
    low = np.maximum(np.ceil(triangles.min(1) - 0.5), 0).astype(int)
    high = np.minimum(np.floor(triangles.max(1) - 0.5), [width - 1, height - 1]).astype(int)
    span = np.maximum(high - low + 1, 0)
    count = span[:, 0] * span[:, 1]
    owner = np.repeat(np.arange(len(count)), count)
    order = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    x = low[owner, 0] + order % np.maximum(span[owner, 0], 1)
    y = low[owner, 1] + order // np.maximum(span[owner, 0], 1)
    at = np.stack([x + 0.5, y + 0.5], 1)
    a, b, c = (triangles[owner, k] for k in range(3))
    area = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = (
            np.stack([_cross(c - b, at - b), _cross(a - c, at - c), _cross(b - a, at - a)], 1) / area[:, None]
        )
    inside = (flat >= 0).all(1) & (area != 0)
    owner, x, y, flat = owner[inside], x[inside], y[inside], flat[inside]
    over_z = flat / points[body.solid.faces[owner], 2]
    depth = 1 / over_z.sum(1)
    far_to_near = np.argsort(-depth, kind="stable")
    face = np.full((height, width), -1)
    weights = np.zeros((height, width, 3))
    # Later writes win, so the nearest surface is written last.
    face[y[far_to_near], x[far_to_near]] = owner[far_to_near]
    weights[y[far_to_near], x[far_to_near]] = (over_z * depth[:, None])[far_to_near]
    return face, weights


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
