"""What a stage made, as one small picture and the numbers that tell most; drawn in a child.

Pictures are upright, kept in the person's cache by the result's fingerprint.
"""

import contextlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from app import places, results
from app.inspect import falsecolour
from engine.geometry import inverse
from engine.io import session as sessions
from engine.light.incident import probes
from engine.orientation import turn_picture, turn_vectors, turned
from engine.pipeline import artifacts
from engine.pipeline.stage_functions import middle_view
from engine.pipeline.stages import Step
from engine.results.report import path_drawing
from engine.sampling import evenly_spaced
from engine.types import Frames, Gaussians, Lamps, Masks, Poses, Surface

Picture = UInt8[np.ndarray, "h w 4"]  # blue, green, red, alpha
Made = tuple[Picture, dict[str, float]]

EDGE_PX = 480
SHEET = (4, 3)  # photographs of a contact sheet, across and down
OUTLINE, DOT, POINT = (255, 170, 80, 255), (80, 170, 255, 255), (120, 120, 120, 255)
DIMMED = 0.35
ROWS = 96  # of the light's panorama


def show(content: Mapping[str, Any]) -> dict[str, Any]:
    """The answer to the question "made": session, stage. Answer: picture (None: the stage is not done), facts."""
    folder, stage = Path(content["session"]), content["stage"]
    steps = {step.stage.name: step for step in results.steps_of(folder)}
    step = steps[stage]
    there = _parts(stage)
    if not step.done or not all(steps[part].done for part, _, _ in there):
        return {"picture": None, "facts": {}}
    to = places.cache() / "made" / f"{stage}-{step.fingerprint}.png"
    told = to.with_suffix(".json")
    with contextlib.suppress(OSError, ValueError):
        facts = json.loads(told.read_bytes())
        if to.is_file():
            return {"picture": str(to), "facts": facts}
    flip = sessions.open_session(folder).orientation
    loaded = [turned(artifacts.load(steps[part].folder, record, kind), flip) for part, record, kind in there]
    picture, facts = DRAW[stage](step, *loaded)
    write(to, picture)
    sessions.write_atomic(told, json.dumps(facts).encode())
    return {"picture": str(to), "facts": facts}


def preview(normals: Float[np.ndarray, "h w 3"], flip: int, to: Path) -> None:
    """The normals of a solve under way as a picture."""
    upright = turn_vectors(turn_picture(normals, flip), flip)
    write(to, falsecolour.normals(upright, np.asarray(upright.any(-1)), "opengl"))


def write(to: Path, picture: Picture) -> None:
    with sessions.told(to):
        to.parent.mkdir(parents=True, exist_ok=True)
    coded = cv2.imencode(".png", np.ascontiguousarray(picture), [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
    sessions.write_atomic(to, coded.tobytes())


def _parts(stage: str) -> list[tuple[str, str, type]]:
    """Records that its picture is drawn of: stage, name, kind."""
    frames, masks = ("hdr", "frames", Frames), ("segment", "masks", Masks)
    poses, surface = ("poses", "poses", Poses), ("surface", "surface", Surface)
    lights = [("light", "gaussians", Gaussians), ("light", "lamps", Lamps)]
    return {
        "hdr": [frames], "segment": [masks, frames], "poses": [poses], "light": [*lights, poses], "surface": [surface],
        "export": [surface],
    }[stage]  # fmt: skip


def _small(picture: np.ndarray, edge_px: int = EDGE_PX) -> np.ndarray:
    by = max(picture.shape[:2]) / edge_px
    size = (max(1, round(picture.shape[1] / by)), max(1, round(picture.shape[0] / by)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def _hdr(step: Step, frames: Frames) -> Made:
    across, down = SHEET
    chosen = evenly_spaced(len(frames.names), across * down)
    small = [_small(np.asarray(frames.radiance[i], np.float32), EDGE_PX // across) for i in chosen]
    white = float(np.percentile(np.stack(small), 90)) or 1.0
    tiles = [falsecolour.radiance(picture, white, 0.0, "srgb") for picture in small]
    tiles += [np.zeros_like(tiles[0])] * (across * down - len(tiles))
    rows = [np.concatenate(tiles[across * k : across * (k + 1)], 1) for k in range(down)]
    height, width = frames.dark.shape[1:]
    return np.concatenate(rows), {"views": len(frames.names), "width": width, "height": height}


def _segment(step: Step, masks: Masks, frames: Frames) -> Made:
    photograph = np.asarray(frames.radiance[len(frames.names) // 2], np.float32)
    white = float(np.percentile(photograph, 98)) or 1.0
    inside = np.asarray(masks.object)
    picture = falsecolour.radiance(
        np.where(inside[..., None], photograph, DIMMED * photograph), white, 0.0, "srgb"
    )
    edges = cv2.findContours(inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    cv2.drawContours(
        picture := np.ascontiguousarray(picture), edges, -1, OUTLINE, max(1, len(picture) // EDGE_PX)
    )
    return _small(picture), {"share": float(inside.mean())}


def _poses(step: Step, poses: Poses) -> Made:
    """The way of the cameras, seen from above."""
    facts = {
        "placed": int(poses.registered.sum()),
        "views": len(poses.registered),
        "off_px": poses.reprojection_px,
    }
    canvas = np.zeros((2 * EDGE_PX // 3, EDGE_PX, 4), np.uint8)
    plan = path_drawing.survey(poses, None, None)
    if plan is None:
        return canvas, facts
    flat = np.array([0, 2])
    low, high = plan.low[flat], plan.high[flat]
    by = 0.9 * min(canvas.shape[1] / (high - low)[0], canvas.shape[0] / (high - low)[1])
    middle = np.array([canvas.shape[1], canvas.shape[0]]) / 2

    def at(points: Float[np.ndarray, "n 3"]) -> list[tuple[int, int]]:
        return [(int(x), int(y)) for x, y in (points[:, flat] - (low + high) / 2) * by + middle]

    for point in at(plan.points):
        cv2.circle(canvas, point, 1, POINT, -1)
    ahead = plan.cameras + plan.looks * (20 / by)
    for camera, look in zip(at(plan.cameras), at(ahead), strict=True):
        cv2.line(canvas, camera, look, DOT, 1, cv2.LINE_AA)
        cv2.circle(canvas, camera, 3, DOT, -1, cv2.LINE_AA)
    return canvas, facts


def _light(step: Step, gaussians: Gaussians, lamps: Lamps, poses: Poses) -> Made:
    """What arrives where the cameras are, as a panorama."""
    pose = poses.cam_from_world[middle_view(poses)]
    around, _ = probes.panorama(gaussians, inverse(pose)[:, 3], pose[:, :3], ROWS, fill=True)
    picture = falsecolour.radiance(around, float(np.percentile(around, 99.5)) or 1.0, 0.0, "log")
    large = cv2.resize(picture, (EDGE_PX, EDGE_PX // 2), interpolation=cv2.INTER_LINEAR)
    return large, {"gaussians": len(gaussians.means), "lamps": len(lamps.radii)}


def _surface(step: Step, surface: Surface) -> Made:
    """Normals beside albedo."""
    rows, columns = (np.nonzero(surface.mask.any(axis))[0] for axis in (1, 0))
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    both = [
        falsecolour.normals(surface.normal, surface.mask, "opengl"),
        falsecolour.colour(surface.albedo, surface.mask),
    ]
    error = float(np.degrees(np.median(surface.stderr_normal[surface.mask])))
    picture = np.concatenate([part[box] for part in both], 1)
    return _small(picture), {"pixels": int(surface.mask.sum()), "stderr_deg": error}


def _export(step: Step, surface: Surface) -> Made:
    files = artifacts.load_value(step.folder / "export.json", "files")
    picture = cv2.imread(str(step.folder / "photograph.png"), cv2.IMREAD_COLOR)
    shown = np.zeros((2, 2, 3), np.uint8) if picture is None else picture
    return _small(cv2.cvtColor(shown, cv2.COLOR_BGR2BGRA)), {"files": len(files)}


DRAW: Mapping[str, Callable[..., Made]] = {
    "hdr": _hdr, "segment": _segment, "poses": _poses, "light": _light, "surface": _surface, "export": _export,
}  # fmt: skip
