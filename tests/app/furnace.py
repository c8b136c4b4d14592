"""A finished session in which everything is known: a ball in a room that shines evenly, written as the stages would.

Every Gaussian of the room has the same radiance, so that a convex surface must come out as its albedo (and a known
specular share) times that radiance in every view. Small: 40 x 30 pixels, nine views.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from engine.geometry import fibonacci_sphere
from engine.light.gaussians.gaussians import Y00
from engine.pipeline import artifacts
from engine.types import Camera, Emitters, Frames, Gaussians, Lamps, Masks, Poses, Surface, ValidationRenders
from tests.engine.ball import ball

CAMERA = Camera(40, 30, 44.0, 44.0, 19.5, 15.5)
VIEWS = 9
HELD_OUT = (2, 6)
GLOW = 0.8  # radiance of the room
ROOM = 3.0  # its radius, scene units
PARAMS = {
    "directions": 600, "probe_grid_xy": 1, "probe_grid_z": 1, "probe_resolution": 24, "diffuse": "lambert",
    "light_groups": 2, "without": ["lamp_directions"], "seed": 0,
}  # fmt: skip


def surface() -> Surface:
    """The ball, matt."""
    made = ball(CAMERA)
    as_they_are = {name: getattr(made, name) for name in ("mask", "flags", "material", "part", "stderr_part")}
    return Surface(
        **{name: np.asarray(getattr(made, name), np.float32) for name in Surface.__slots__} | as_they_are
    )


def room() -> tuple[Gaussians, Lamps]:
    """An even shell of Gaussians around the world's origin, of the type that is stored; without lamps."""
    means = ROOM * fibonacci_sphere(500)
    count = len(means)
    fields = (
        means, np.tile([1.0, 0, 0, 0], (count, 1)), np.full((count, 3), 0.35), np.full(count, 20.0),
        np.full((count, 1, 3), GLOW / Y00),
    )  # fmt: skip
    gaussians = Gaussians(*(np.asarray(field, np.float32) for field in fields))
    none = np.zeros((0, 3))
    return gaussians, Lamps(none, np.zeros(0), none, np.zeros(0, bool))


def poses() -> Poses:
    """The camera turns on the spot, the object (1 ahead of it) with it."""
    turns = []
    for angle in 2 * np.pi * np.arange(VIEWS) / VIEWS:
        c, s = np.cos(angle), np.sin(angle)
        turns.append([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0]])
    everyone = np.ones(VIEWS, bool)
    return Poses(CAMERA, np.array(turns, float), everyone, np.zeros((0, 3)), "unknown", float("nan"))


def photographs(shape: Surface, off: float = 1.0) -> Frames:
    """What the room and the ball look like, about: the ball as its albedo times the glow times `off`."""
    picture = np.full((CAMERA.height, CAMERA.width, 3), GLOW, np.float32)
    picture[shape.mask] = off * GLOW * shape.albedo[shape.mask]
    nothing = np.zeros((VIEWS, CAMERA.height, CAMERA.width), bool)
    names = tuple(f"view{i:02d}" for i in range(VIEWS))
    return Frames(names, np.repeat(picture[None], VIEWS, 0), nothing, nothing, (1e-6, 1e-4))


def finished(
    session: Path,
    fingerprint: str = "aaaa",
    finished_at: float = 1e9,
    with_export: bool = True,
    flip: int = 0,
    **changes,
) -> Path:
    """Write a run; `changes` replace fields of its surface.

    Its photographs stand upright turned by `flip`. Several runs may share a session.
    """
    shape = replace(surface(), **changes)
    frames = photographs(surface())
    gaussians, lamps = room()
    inside = shape.mask[None] | np.zeros((VIEWS, 1, 1), bool)
    inputs = {"hdr": "hhhh", "segment": "ssss", "poses": "pppp", "light": "llll"}
    lying = {"orientation": str(flip)} if flip else {}
    _write(session, "hdr", "hhhh", {}, 2.0, frames=frames)
    _write(session, "segment", "ssss", {}, 1.0, masks=Masks(surface().mask, ~inside))
    _write(session, "poses", "pppp", {}, 3.0, poses=poses())
    _write(session, "light", "llll", {}, 4.0, gaussians=gaussians, lamps=lamps)
    made = np.where(shape.mask[..., None], 1.1 * frames.radiance[list(HELD_OUT)], 0).astype(np.float32)
    folder = _write(
        session,
        "surface",
        fingerprint,
        inputs | lying,
        10.0,
        finished_at,
        surface=shape,
        renders=ValidationRenders(HELD_OUT, made),
        emitters=Emitters(gaussians, lamps, 0),
    )
    report = {
        "held_out_error": 0.1,
        "residual": 1.5,
        "stderr_normal_deg": 1.1,
        "history": [
            {
                "phase": phase, "passes": ["solve_pixels"], "pixels": 81, "residual": residual,
                "turned_deg": None, "validation_error": None, "kept": True,
            }
            for phase, residual in (("initialise", None), ("coarse", 3.0), ("place", 1.5))
        ],
        "distance": {"value": 0.8, "stderr": 0.01, "source": "light", "tried": [0.4, 0.8, 1.6], "misfit": [9.0, 2.0, 7.0]},
        "probe_reach": [0.7, 0.9],
        "probes": [1, 1, 1],
        "directions": PARAMS["directions"],
    }  # fmt: skip
    artifacts.save_json(folder / "report.json", {"arrays": {}, "values": report})
    if with_export:
        export = _write(
            session, "export", f"e{fingerprint}", {"surface": fingerprint, **inputs}, 1.0, finished_at
        )
        latest = session / "exports" / "latest"
        latest.parent.mkdir(exist_ok=True)
        latest.unlink(missing_ok=True)
        latest.symlink_to(export)
    return session


def _write(
    session: Path,
    stage: str,
    fingerprint: str,
    inputs: dict[str, str],
    seconds: float,
    finished_at: float = 1e9,
    **records,
) -> Path:
    folder = session / "stages" / stage / fingerprint
    folder.mkdir(parents=True, exist_ok=True)
    for name, record in records.items():
        artifacts.save(folder, name, record)
    record = {
        "stage": stage, "version": 1, "params": PARAMS if stage == "surface" else {}, "inputs": inputs,
        "seconds": seconds, "finished": finished_at, "device": "cpu",
    }  # fmt: skip
    (folder / "record.json").write_text(json.dumps(record))
    return folder
