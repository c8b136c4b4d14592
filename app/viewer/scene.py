"""What a session has to show in space: its light, lamps, cameras, sparse points and surface, as far as they are there.

World frame except for the surface, which stays in the camera frame: it moves with the camera.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from app.viewer import frusta
from app.viewer.protocol import Contents, Legend
from app.viewer.reading import Results, read
from app.viewer.shades import Layer, layers
from engine.color import luminance
from engine.errors import ExportError
from engine.geometry import inverse, transform
from engine.io import mesh
from engine.light.gaussians.gaussians import radiance_towards, rotations
from engine.types import Camera, Gaussians, Lamps, Poses, Surface

Vectors = Float[np.ndarray, "n 3"]

MOST_TRIANGLES = 800_000
MOVING_TRIANGLES = 25_000
MOVING_EMITTERS = 50_000
BRIGHTEST = 0.1
"""Share of the emitters that are kept first when not all are drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class Emitters:
    """The Gaussians; in an order in which any beginning is a fair choice, the brightest first."""

    gaussians: Gaussians
    radiance: Vectors  # as seen from the middle of the cameras
    axes: Float[np.ndarray, "n 3 3"]  # columns: the half axes, scene units

    def __len__(self) -> int:
        return len(self.radiance)


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A surface as a mesh; vertices know their pixel (row, column) of the maps."""

    points: Vectors  # camera frame
    normals: Vectors  # recovered, camera frame
    triangles: Int[np.ndarray, "t 3"]
    pixels: Int[np.ndarray, "v 2"]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything; None and empty where it is not there."""

    contents: Contents
    poses: Poses | None = None
    emitters: Emitters | None = None
    lamps: Lamps | None = None
    sheets: tuple[Sheet, ...] = ()  # full, then for while the eye moves
    layers: dict[str, Layer] | None = None
    white: float = 1.0  # radiance to show as bright, session scale

    def world_from_cam(self, view: int) -> Float[np.ndarray, "3 4"]:
        """Of a view, or of the first registered one."""
        if self.poses is None:
            return np.eye(3, 4)
        usable = np.nonzero(self.poses.registered)[0]
        if len(usable) == 0:
            return np.eye(3, 4)
        if not (0 <= view < len(self.poses.registered) and self.poses.registered[view]):
            view = int(usable[0])
        return inverse(np.asarray(self.poses.cam_from_world[view], np.float64))


def load(folder: Path, note: Callable[[str], None]) -> Scene:
    """All that a session has; `note` hears what is being done.

    Raises:
        SessionError: no session, or damaged.
    """
    note("reading the results")
    results = read(folder)
    note("building the scene")
    return compose(str(folder), results)


def compose(folder: str, results: Results) -> Scene:
    """The scene of these results."""
    poses, surface = results.poses, results.surface
    placed = poses.cam_from_world[poses.registered] if poses is not None else np.zeros((0, 3, 4))
    eyes = inverse(np.asarray(placed, np.float64))[:, :, 3]
    middle = eyes.mean(0) if len(eyes) else np.zeros(3)
    emitters = _emitters(results.gaussians, middle) if results.gaussians is not None else None
    sheets = _sheets(surface, poses.camera) if surface is not None and poses is not None else ()
    coloured = layers(surface) if surface is not None and sheets else None
    parts = (("poses", poses), ("light", results.gaussians), ("surface", surface))
    scene = Scene(
        Contents(
            folder,
            "m" if poses is not None and poses.metric else "",
            results.names,
            missing=tuple(name for name, part in parts if part is None),
        ),
        poses, emitters, results.lamps, sheets, coloured, _white(emitters),
    )  # fmt: skip
    return replace(scene, contents=_described(scene, eyes, middle))


def _emitters(gaussians: Gaussians, seen_from: Float[np.ndarray, " 3"]) -> Emitters:
    radiance = radiance_towards(gaussians, seen_from).astype(np.float32)
    halves = np.asarray(gaussians.scales, np.float64)
    shown = luminance(radiance) * -np.expm1(-np.asarray(gaussians.density, np.float64))
    order = np.random.default_rng(0).permutation(len(radiance))
    bright = np.argsort(-shown, kind="stable")[: int(BRIGHTEST * len(order))]
    order = np.concatenate([bright, order[~np.isin(order, bright)]])
    axes = rotations(np.asarray(gaussians.quaternions, np.float64)[order]) * halves[order][:, None, :]
    picked = Gaussians(
        gaussians.means[order], gaussians.quaternions[order], gaussians.scales[order],
        gaussians.density[order], gaussians.radiance[order],
    )  # fmt: skip
    return Emitters(picked, radiance[order], axes)


def _white(emitters: Emitters | None) -> float:
    """Half as bright again as three of four emitters: lit walls, whatever share of the room is window or night."""
    if emitters is None or len(emitters) == 0:
        return 1.0
    return 1.5 * float(np.percentile(luminance(emitters.radiance), 75)) or 1.0


def _sheets(surface: Surface, camera: Camera) -> tuple[Sheet, ...]:
    """The full mesh, and a coarse one if the full one is too much for a picture that moves."""
    count = 2 * int(surface.mask.sum())
    fine = max(int(np.ceil((count / MOST_TRIANGLES) ** 0.5)), 1)
    coarse = max(int(np.ceil((count / MOVING_TRIANGLES) ** 0.5)), fine)
    try:
        return tuple(_sheet(surface, camera, stride) for stride in dict.fromkeys((fine, coarse)))
    except ExportError:
        return ()  # no three neighbours joined: nothing to show


def _sheet(surface: Surface, camera: Camera, stride: int) -> Sheet:
    """Of every `stride`-th pixel in both directions."""
    cut = (slice(None, None, stride), slice(None, None, stride))
    thinned = Surface(
        *(
            np.asarray(getattr(surface, name))[cut]
            for name in (
                "mask", "normal", "albedo", "roughness", "depth", "stderr_normal", "stderr_albedo",
                "stderr_roughness", "residual", "flags",
            )
        )
    )  # fmt: skip
    height, width = thinned.mask.shape
    grid = replace(
        camera, width=width, height=height, fx=camera.fx / stride, fy=camera.fy / stride,
        cx=(camera.cx - 0.5) / stride + 0.5, cy=(camera.cy - 0.5) / stride + 0.5,
    )  # fmt: skip
    made = mesh.from_depth(thinned, grid, mesh.CutParams())
    row, column = made.pixels.T
    return Sheet(
        made.points,
        thinned.normal[row, column].astype(np.float64),
        made.triangles.astype(np.int32),
        made.pixels * stride,
    )


def _described(scene: Scene, eyes: Vectors, middle: Float[np.ndarray, " 3"]) -> Contents:
    """The facts that the window needs: where things are and how large."""
    poses = scene.poses
    told: dict[str, Any] = {}
    near, depth = eyes, 0.0
    if scene.sheets:
        points = scene.sheets[-1].points
        depth = float(np.median(points[:, 2]))
        near = np.concatenate([eyes, transform(scene.world_from_cam(-1), points)])
    if poses is not None and poses.registered.any():
        camera, turned = poses.camera, poses.cam_from_world[poses.registered]
        up = _unit(-turned[:, 1, :3].mean(0), np.array([0.0, -1.0, 0.0]))
        ahead = turned[:, 2, :3].mean(0)
        front = ahead - (ahead @ up) * up
        front = _unit(front if np.linalg.norm(front) > 0.1 else _across(up), _across(up))
        told = {
            "poses": tuple(
                tuple(map(float, pose.ravel())) if known else ()
                for pose, known in zip(poses.cam_from_world, poses.registered, strict=True)
            ),
            "aspect": camera.width / camera.fx / (camera.height / camera.fy),
            "fov": 2 * float(np.arctan(camera.height / 2 / camera.fy)),
            "frustum": frusta.size(turned, depth or None),
            "up": _vector(up),
            "front": _vector(front),
            "points": len(poses.points),
        }
    if len(near):
        low, high = near.min(0), near.max(0)
        middle = (low + high) / 2
        told |= {"centre": _vector(middle), "radius": float(np.linalg.norm(high - low) / 2) or 1.0}
    around = scene.emitters.gaussians.means if scene.emitters is not None and len(scene.emitters) else near
    if len(around):
        # Strays far outside, up to one in ten on any side, do not make the room larger.
        least, low, high, most = np.percentile(np.asarray(around, np.float64), [0.5, 10, 90, 99.5], axis=0)
        low, high = np.maximum(low - (high - low) / 8, least), np.minimum(high + (high - low) / 8, most)
        told |= {
            "room": _vector((low + high) / 2),
            "room_radius": float(np.linalg.norm(high - low) / 2) or 1.0,
        }
        if not len(near):
            told |= {"centre": told["room"], "radius": told["room_radius"]}
    legends: dict[str, Legend] = {
        name: layer.legend for name, layer in (scene.layers or {}).items() if layer.legend is not None
    }
    return replace(
        scene.contents,
        object_depth=depth,
        emitters=0 if scene.emitters is None else len(scene.emitters),
        lamps=0 if scene.lamps is None else len(scene.lamps.radii),
        triangles=len(scene.sheets[0].triangles) if scene.sheets else 0,
        surfaces=tuple(scene.layers or ()),
        legends=legends,
        **told,
    )


def _unit(vector: Float[np.ndarray, " 3"], otherwise: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Of length 1; `otherwise` where the vector has no direction worth the name."""
    length = np.linalg.norm(vector)
    return vector / length if length > 1e-3 else otherwise


def _across(up: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """The world's z, or else its x, made level."""
    axis = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    level = axis - (axis @ up) * up
    return level / np.linalg.norm(level)


def _vector(values: Float[np.ndarray, " 3"]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
