"""A ball in a dim even room with a few lamps: pictures summed lamp by lamp, with no code of the engine's light.

Camera frame x right, y down, z ahead. The reflectances are Lambert and the paper's (9)-(11) with Disney's diffuse
lobe, written out here anew.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from engine.geometry import rays
from engine.light.gaussians.gaussians import Y00
from engine.types import Camera, CapturedScene, Frames, Gaussians, Lamps, Masks, Poses
from tests.engine.light import clouds

CAMERA = Camera(36, 30, 45.0, 45.0, 18.0, 15.0)  # the ball has 410 pixels
FINER = Camera(48, 40, 60.0, 60.0, 24.0, 20.0)  # and here 729
DISTANCE, RADIUS, WALL = 0.6, 0.15, 400.0
AMBIENT = 0.3


@dataclass(frozen=True)
class Scene:
    """What a baseline is given, and the truth."""

    given: tuple[Frames, Masks, Poses, Gaussians, Lamps]
    normals: np.ndarray  # p 3
    albedo: np.ndarray  # p 3
    points: np.ndarray  # p 3

    @property
    def captured(self) -> CapturedScene:
        return CapturedScene(*self.given)


def ball(camera: Camera = CAMERA) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mask (h w), normals and points (of the mask's pixels)."""
    ray, centre = rays(camera), np.array([0.01, -0.005, DISTANCE])
    along = ray @ centre
    root = along**2 - centre @ centre + RADIUS**2
    mask = root > 0.03 * RADIUS**2  # without the last grazing pixels
    points = ray * (along - np.sqrt(np.maximum(root, 0)))[..., None]
    return mask, ((points - centre) / RADIUS)[mask], points[mask]


def paint(points: np.ndarray) -> np.ndarray:
    """A smooth albedo between 0.2 and 0.7."""
    x, y, _ = (points / RADIUS).T
    return 0.45 + 0.25 * np.stack([np.sin(3 * x), np.cos(3 * y), np.sin(2 * (x + y))], 1)


def lambert(n: np.ndarray, v: np.ndarray, light: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Reflected share times cosine, p 3."""
    return albedo / np.pi * np.maximum((n * light).sum(1, keepdims=True), 0)


def facets(
    n: np.ndarray, v: np.ndarray, light: np.ndarray, roughness: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """D G / (4 n.v) of GGX, which Fresnel's reflectance makes a highlight with its cosine; and n.l, n.v, l.h."""
    half = (light + v) / np.linalg.norm(light + v, axis=1, keepdims=True)
    nl, nv, nh, lh = (
        np.maximum((a * b).sum(1, keepdims=True), 1e-4)
        for a, b in ((n, light), (n, v), (n, half), (light, half))
    )
    a2 = roughness**4
    spread = a2 / (np.pi * (nh**2 * (a2 - 1) + 1) ** 2)
    masking = np.prod([2 * x / (x + np.sqrt(a2 + (1 - a2) * x**2)) for x in (nl, nv)], axis=0)
    return spread * masking / (4 * nv), nl, nv, lh


def glossy(roughness: float):
    """The paper's reflectance with Disney's diffuse lobe and F0 = 0.04."""

    def reflect(n: np.ndarray, v: np.ndarray, light: np.ndarray, albedo: np.ndarray) -> np.ndarray:
        highlight, nl, nv, lh = facets(n, v, light, roughness)
        fresnel = 0.04 + 0.96 * (1 - lh) ** 5
        retro = 2 * roughness * lh**2 - 0.5
        diffuse = albedo / np.pi * (1 + retro * (1 - nl) ** 5) * (1 + retro * (1 - nv) ** 5)
        lit = (n * light).sum(1, keepdims=True) > 0
        return np.where(lit, diffuse * nl + highlight * fresnel, 0)

    return reflect


def metal(roughness: float):
    """A highlight of the albedo's colour, by Schlick's power white at grazing, and nothing else."""

    def reflect(n: np.ndarray, v: np.ndarray, light: np.ndarray, albedo: np.ndarray) -> np.ndarray:
        highlight, _, _, lh = facets(n, v, light, roughness)
        lit = (n * light).sum(1, keepdims=True) > 0
        return np.where(lit, highlight * (albedo + (1 - albedo) * (1 - lh) ** 5), 0)

    return reflect


def turns(views: int, rng: np.random.Generator, shift: float) -> np.ndarray:
    """Cameras turned anyhow, about the origin."""
    rotation = Rotation.from_quat(rng.normal(size=(views, 4))).as_matrix()
    return np.concatenate([rotation, shift * rng.normal(size=(views, 3, 1))], axis=2)


def scene(
    reflect=lambert, lamp_distance: float = 40.0, ambient: float = AMBIENT, views: int = 16, lamps: int = 5,
    camera: Camera = CAMERA,
) -> Scene:  # fmt: skip
    """The ball under lamps of one apparent size at about `lamp_distance`."""
    rng = np.random.default_rng(3)
    mask, normals, points = ball(camera)
    albedo, away = paint(points), -rays(camera)[mask]
    poses = turns(views, rng, 0.1)
    towards = rng.normal(size=(lamps, 3))
    centres = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    centres *= lamp_distance * rng.uniform(0.9, 1.3, (lamps, 1))
    lit = Lamps(
        centres, np.full(lamps, 0.06 * lamp_distance), rng.uniform(60, 200, (lamps, 3)), np.zeros(lamps, bool)
    )
    radiance = np.zeros((views, *mask.shape, 3), np.float32)
    for i, pose in enumerate(poses):
        total = ambient * albedo
        for centre, radius, colour in zip(lit.centres, lit.radii, lit.radiance, strict=True):
            way = pose[:, :3] @ centre + pose[:, 3] - points
            far = np.linalg.norm(way, axis=1, keepdims=True)
            solid = np.pi * (radius / far) ** 2
            total = total + reflect(normals, away, way / far, albedo) * solid * colour
        radiance[i, mask] = total
    nothing = np.zeros(radiance.shape[:3], bool)
    frames = Frames(tuple(map(str, range(views))), radiance, nothing, nothing, (1e-6, 1e-6))
    placed = Poses(camera, poses, np.ones(views, bool), np.zeros((0, 3)), "given", float("nan"))
    return Scene(
        (frames, Masks(mask, ~mask & ~nothing), placed, room(lit, ambient), lit), normals, albedo, points
    )


def room(lamps: Lamps, ambient: float) -> Gaussians:
    """An even wall all around, and the lamps, which are the last."""
    wall = clouds.shell(ambient, WALL, 500)
    count = len(lamps.radii)
    turned = np.tile([1.0, 0, 0, 0], (count, 1))
    return Gaussians(
        np.concatenate([wall.means, lamps.centres]),
        np.concatenate([wall.quaternions, turned]),
        np.concatenate([1.6 * wall.scales, np.repeat(lamps.radii[:, None], 3, 1)]),
        np.concatenate([np.full(500, 8.0), np.full(count, 8.0)]),
        np.concatenate([wall.radiance, lamps.radiance[:, None] / Y00]),
    )
