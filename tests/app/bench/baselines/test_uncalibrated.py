"""Uncalibrated photometric stereo: how near it comes without the light, where its own assumptions hold."""

import numpy as np
import pytest

from app.bench.baselines.flat import answers
from app.bench.baselines.methods import BASELINES
from app.bench.baselines.uncalibrated import GREY, UncalibratedParams, balloon, fitted_light
from engine.geometry import fibonacci_sphere, rays
from engine.progress import Progress
from engine.surface.data.observations import observe
from engine.surface.optimize import gauss_newton
from engine.types import Camera, CapturedScene, Frames, Gaussians, Lamps, Masks, Poses

LENS = Camera(48, 40, 500.0, 500.0, 24.0, 20.0)
VIEWS = 30


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1))).mean())


def disc(radius: float) -> np.ndarray:
    y, x = np.mgrid[:40, :48] + 0.5
    return (x - 24) ** 2 + (y - 20) ** 2 < radius**2


def dented_ball() -> tuple[np.ndarray, np.ndarray]:
    """Mask, and normals of a ball with smooth dents: no balloon, but as round at the rim."""
    y, x = (np.mgrid[:40, :48] + 0.5 - np.array([20, 24])[:, None, None]) / 18
    mask = x**2 + y**2 < 0.97
    # Height h towards the camera: a hemisphere plus dents that vanish at the rim.
    rest = np.maximum(1 - x**2 - y**2, 0)
    wave, slope = 0.25 * np.sin(4 * x + 2 * y), 0.25 * np.cos(4 * x + 2 * y)
    root = np.sqrt(np.maximum(rest, 1e-3))
    dx = -x / root + 4 * slope * rest - 2 * x * wave
    dy = -y / root + 2 * slope * rest - 2 * y * wave
    normals = np.stack([-dx, -dy, -np.ones_like(dx)], -1)
    return mask, (normals / np.linalg.norm(normals, axis=-1, keepdims=True))[mask]


def soft_light(directions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Energy (d, v) of a sky with one wide glow, per view."""
    energy = []
    for _ in range(VIEWS):
        towards = rng.normal(size=3)
        cosine = directions @ (towards / np.linalg.norm(towards))
        energy.append((0.2 + np.exp(2 * cosine - 2))[:, None] * rng.uniform(0.8, 1.2, 3))
    return np.concatenate(energy, 1) * 4 * np.pi / len(directions)


def pictures() -> tuple[Frames, np.ndarray, np.ndarray, np.ndarray]:
    """Lambert pictures, summed over directions; mask, normals and albedo."""
    rng = np.random.default_rng(1)
    mask, normals = dented_ball()
    directions = fibonacci_sphere(1500)
    albedo = rng.uniform(0.2, 0.6, (len(normals), 3))
    shading = np.maximum(normals @ directions.T, 0) / np.pi @ soft_light(directions, rng)
    radiance = np.zeros((VIEWS, *mask.shape, 3), np.float32)
    radiance[:, mask] = (shading.reshape(len(normals), VIEWS, 3) * albedo[:, None]).transpose(1, 0, 2)
    nothing = np.zeros(radiance.shape[:3], bool)
    return Frames(("",) * VIEWS, radiance, nothing, nothing, (1e-6, 1e-6)), mask, normals, albedo


def test_balloon_of_a_disc_is_a_ball():
    mask = disc(18)
    y, x = np.nonzero(mask)
    x, y = (x + 0.5 - 24) / 18, (y + 0.5 - 20) / 18
    ball = np.stack([x, y, -np.sqrt(1 - x**2 - y**2)], 1)
    assert angle(balloon(LENS, mask), ball) < 4  # the rim is cut in pixels


def test_balloon_faces_each_pixels_own_line_of_sight():
    wide = Camera(48, 40, 30.0, 30.0, -30.0, 20.0)  # far off the axis
    mask = disc(18)
    middle = np.zeros_like(mask)
    middle[19:21, 23:25] = True
    ahead = rays(wide)[middle].mean(0)
    assert angle(balloon(wide, mask)[middle[mask]].mean(0), -ahead / np.linalg.norm(ahead)) < 2


def test_a_squashed_balloon_leans_less():
    flat, ball = balloon(LENS, disc(18), 0.1), balloon(LENS, disc(18))
    lean, full = (np.linalg.norm(n[:, :2], axis=1) / -n[:, 2] for n in (flat, ball))
    inner = ball[:, 2] < -0.5
    assert lean[inner] == pytest.approx(0.1 * full[inner], abs=0.05)  # rays lean up to 3 degrees


def test_light_follows_from_the_right_surface():
    frames, mask, normals, albedo = pictures()
    state = gauss_newton.initial_estimate(normals, albedo, np.full(len(normals), 0.5))
    seen = observe(frames, mask, np.arange(VIEWS), 0.02)
    told = np.tile(albedo, VIEWS) * (answers(normals) @ fitted_light(state, seen).coefficients)
    assert np.median(np.abs(told / seen.radiance - 1)) < 0.01


def test_dents_that_no_balloon_has_are_found_without_the_light():
    frames, mask, normals, albedo = pictures()
    nobody = np.zeros((0, 3))
    room = Gaussians(nobody, np.zeros((0, 4)), nobody, np.zeros(0), np.zeros((0, 1, 3)))
    dark = Lamps(nobody, np.zeros(0), nobody, np.zeros(0, bool))
    # Poses that tell nothing: the method must not look.
    poses = Poses(LENS, np.zeros((VIEWS, 3, 4)), np.ones(VIEWS, bool), nobody, "unknown", float("nan"))
    masks = Masks(mask, ~mask & np.ones((VIEWS, 1, 1), bool))
    captured = CapturedScene(frames, masks, poses, room, dark)
    answer = BASELINES["uncalibrated"].solve(captured, UncalibratedParams(), "cpu", 0, Progress())
    start, end = angle(balloon(LENS, mask), normals), angle(answer.normal[mask], normals)
    # Not nearer: the light above second order, an eighth of a glow, bends what is found.
    assert start > 12
    assert end < start / 2
    assert end < 7
    found = answer.albedo[mask]
    assert np.median(found, 0) == pytest.approx(GREY, rel=1e-3)
    ratio = found / albedo
    assert (ratio / np.median(ratio, 0)).std() < 0.1
