"""Sessions that look processed: a room of Gaussians, a lamp, a ring of cameras, a bump in front of them.

Nothing is computed: the records are written as the stages would leave them.
"""

import json
from pathlib import Path

import numpy as np

from engine.io import session as sessions
from engine.pipeline import artifacts
from engine.types import Camera, Frames, Gaussians, Lamps, Poses, Surface

DEPTH = 0.5  # of the object, in front of the camera
ROOM = 2.0  # half the side of the room
INPUTS = {"hdr": (), "poses": ("hdr",), "light": ("hdr", "poses"), "surface": ("hdr", "poses", "light")}


def camera(side: int) -> Camera:
    return Camera(side, side, 1.2 * side, 1.2 * side, side / 2, side / 2)


def poses(views: int, side: int, scale: str = "rig") -> Poses:
    """On a ring about the world's y, looking along its tangent; world y is down. The last one is not registered."""
    turn = np.linspace(0, 2 * np.pi, views, endpoint=False)
    c, s, z, o = np.cos(turn), np.sin(turn), np.zeros(views), np.ones(views)
    rotation = np.stack([np.stack([c, z, -s], 1), np.stack([z, o, z], 1), np.stack([s, z, c], 1)], 1)
    centres = 0.2 * np.stack([s, z, c], 1)
    matrices = np.concatenate([rotation, -np.einsum("nij,nj->ni", rotation, centres)[:, :, None]], 2)
    registered = np.ones(views, bool)
    registered[-1] = False
    matrices[-1] = np.nan
    rng = np.random.default_rng(1)
    return Poses(camera(side), matrices, registered, rng.uniform(-ROOM, ROOM, (64, 3)), scale, 0.5)


def gaussians(count: int) -> Gaussians:
    """On the walls of a cube; one in fifty is a bright window."""
    rng = np.random.default_rng(2)
    means = rng.uniform(-ROOM, ROOM, (count, 3))
    axis = rng.integers(0, 3, count)
    means[np.arange(count), axis] = ROOM * np.sign(means[np.arange(count), axis])
    radiance = rng.uniform(0.05, 0.4, (count, 1, 3))
    radiance[::50] = 20.0
    size = np.full((count, 3), 0.03) * rng.uniform(0.5, 1.5, (count, 3))
    unit = np.tile([1.0, 0, 0, 0], (count, 1))
    return Gaussians(
        *(a.astype(np.float32) for a in (means, unit, size, np.ones(count), radiance / 0.2820948))
    )


def lamps() -> Lamps:
    return Lamps(
        np.array([[0.6, -0.8, 0.9]]), np.array([0.06]), np.array([[30.0, 20.0, 8.0]]), np.array([False])
    )


def surface(side: int) -> Surface:
    """A round bump, in all pixels but a rim."""
    v, u = (np.mgrid[:side, :side] + 0.5) / side * 2 - 1
    mask = np.maximum(abs(u), abs(v)) < 0.97
    depth = np.where(mask, DEPTH + 0.15 * (u * u + v * v), 0).astype(np.float32)
    slope = 0.3 / (DEPTH / 1.2) * 2
    normal = np.stack([slope * u, slope * v, -np.ones_like(u)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    part = mask[..., None]
    albedo = np.where(part, np.stack([0.5 + 0.4 * u, 0.5 + 0.4 * v, np.full_like(u, 0.4)], -1), 0)
    flat = np.where(mask, 0.01 + 0.02 * abs(u), 0).astype(np.float32)
    return Surface(
        mask, (normal * part).astype(np.float32), albedo.astype(np.float32), (0.5 * mask).astype(np.float32),
        depth, flat, flat, flat, flat, np.zeros(mask.shape, np.uint8),
    )  # fmt: skip


def session(
    folder: Path,
    views: int = 5,
    side: int = 24,
    emitters: int = 400,
    stages: tuple[str, ...] = ("hdr", "poses", "light", "surface"),
    scale: str = "rig",
) -> Path:
    """A session with the results of these stages."""
    facts = {"make": "", "model": "", "width": side, "height": side}
    sessions.create(folder, "linear", facts)
    names = tuple(f"view{k:04d}" for k in range(views))
    blank = np.zeros((views, side, side), bool)
    radiance = np.linspace(0, 1, views * side * side * 3, dtype=np.float32).reshape(views, side, side, 3)
    records = {
        "hdr": {"frames": Frames(names, radiance, blank, blank, (0.01, 0.001))},
        "poses": {"poses": poses(views, side, scale)},
        "light": {"gaussians": gaussians(emitters), "lamps": lamps()},
        "surface": {"surface": surface(side)},
    }
    for order, stage in enumerate(stages):
        place = folder / "stages" / stage / f"{order:016x}"
        place.mkdir(parents=True)
        for name, record in records[stage].items():
            artifacts.save(place, name, record)
        finish(place, order, {name: f"{stages.index(name):016x}" for name in INPUTS[stage] if name in stages})
    return folder


def finish(place: Path, when: float, inputs: dict[str, str]) -> None:
    """The record that says a stage is done."""
    record = {
        "stage": place.parent.name, "version": 1, "params": {}, "inputs": inputs, "finished": float(when),
        "seconds": 1.0, "device": "cpu",
    }  # fmt: skip
    (place / "record.json").write_text(json.dumps(record))
