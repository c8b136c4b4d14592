"""A set and solvers that cost nothing: a ball, and methods that know it up to a lean of the normals."""

from pathlib import Path

import numpy as np

from app.bench.rows import Answer, Method
from app.bench.sets import Set
from app.bench.stored import Stored
from engine.io.ground_truth import Truth
from engine.types import Frames, Gaussians, Lamps, Masks, Poses, Surface
from tests.engine.ball import CAMERA, ball

VIEWS, GAUSSIANS, LAMPS = 12, 40, 2


def stored(fingerprint: str = "f00d") -> Stored:
    mask = ball().mask
    grid = (VIEWS, CAMERA.height, CAMERA.width)
    rng = np.random.default_rng(0)
    names = tuple(f"v{i}" for i in range(VIEWS))
    radiance = np.broadcast_to(np.arange(VIEWS, dtype=np.float32)[:, None, None, None], (*grid, 3))
    none = np.zeros(grid, bool)
    poses = np.tile(np.eye(4)[:3], (VIEWS, 1, 1))
    poses[:, 0, 3] = np.arange(VIEWS)
    marks = np.arange(GAUSSIANS, dtype=float)
    return Stored(
        fingerprint,
        Frames(names, radiance, none, none, (0.0, 0.0)),
        Masks(mask, ~none),
        Poses(CAMERA, poses, np.ones(VIEWS, bool), np.zeros((0, 3)), "given", float("nan")),
        Gaussians(
            rng.normal(size=(GAUSSIANS, 3)), np.tile([1.0, 0, 0, 0], (GAUSSIANS, 1)), np.ones((GAUSSIANS, 3)),
            marks, np.ones((GAUSSIANS, 1, 3)),
        ),
        Lamps(np.zeros((LAMPS, 3)), np.ones(LAMPS), np.ones((LAMPS, 3)), np.zeros(LAMPS, bool)),
    )  # fmt: skip


def a_set(room: str = "booth", thing: str = "blob", fingerprint: str = "f00d") -> Set:
    true = ball()
    truth = Truth(true.normal, true.albedo, true.roughness, true.depth, true.mask, None, CAMERA)
    return Set(room, thing, Path("nowhere"), stored(fingerprint), truth)


def leaning(degrees: float, mask: np.ndarray | None = None) -> Surface:
    """The ball with every normal turned so far, and albedo and roughness off by a hundredth per degree."""
    true = ball()
    mask = true.mask if mask is None else mask
    inside = mask[..., None]
    axis = np.array([1.0, 0.0, 0.0]) + 0 * true.normal
    across = axis - (axis * true.normal).sum(-1, keepdims=True) * true.normal
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    angle = np.radians(degrees)
    normal = np.cos(angle) * true.normal + np.sin(angle) * across
    zero = np.zeros(mask.shape)
    return Surface(
        mask, np.where(inside, normal, 0), np.where(inside, true.albedo + 0.01 * degrees, 0),
        np.where(mask, true.roughness + 0.01 * degrees, 0), np.where(mask, true.depth, 0), zero, zero, zero, zero,
        zero.astype(np.uint8),
    )  # fmt: skip


def method(
    key: str,
    degrees: float,
    seconds: float,
    kind: str = "ours",
    calls: list[str] | None = None,
    **facts: object,
) -> Method:
    """Leans its normals by `degrees`; notes in `calls` that it was run."""

    def solve(given, device, seed, progress) -> Answer:
        if calls is not None:
            calls.append(key)
        return Answer(leaning(degrees), seconds, kind == "reference", 0.01 * degrees)

    return Method(key, f"ours, {key}" if kind == "ours" else key, kind, solve, facts)
