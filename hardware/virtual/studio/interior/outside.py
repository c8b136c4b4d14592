"""What lies behind a room's windows: one picture of radiance by direction, from any of Mitsuba's endless emitters.

Equirectangular in the world: row v looks along polar angle pi (v + .5) / H from +z, column u along azimuth 2 pi (u + .5) / W
from +x towards +y; constant within a texel. Lamps that are points or beams of no width cannot be seen: a sun of parallel
light gets half a degree, a point a ball of `BALL_M`; spots and projectors are refused.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from hardware.errors import StudioError
from hardware.virtual.studio.interior.looks import Look

if TYPE_CHECKING:
    from hardware.virtual.studio.interior.read import Interior

ROWS, COLUMNS = 1024, 2048
SAMPLES, MORE = 4, 256  # of a texel; of one that stands out from its neighbours, as the sun does
SUN_DEG = 0.27  # half of the angle that parallel light gets
BALL_M = 0.02

Ball = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]  # where, scene frame, and radiance


def image(
    mi: Any, scene: Any, turn: Float[np.ndarray, "3 3"], path: Path
) -> tuple[Float[np.ndarray, "h w 3"], list[Ball]]:
    """The picture, and balls for what lamps have no size.

    Raises:
        StudioError: a kind of lamp that nothing here can stand for.
    """
    picture, balls = np.zeros((ROWS, COLUMNS, 3), np.float32), []
    surroundings = scene.environment()
    if surroundings is not None:
        picture += _seen(mi, surroundings, turn)
    for emitter in scene.emitters():
        if emitter.is_environment() or mi.has_flag(emitter.flags(), mi.EmitterFlags.Surface):
            continue
        kind = str(emitter).split("[")[0]
        params = mi.traverse(emitter)
        pose = np.array(emitter.world_transform().matrix, float).reshape(-1, 4, 4)[0]
        if kind == "DirectionalEmitter":
            towards = turn @ -pose[:3, 2] / np.linalg.norm(pose[:3, 2])
            cap = directions() @ towards > np.cos(np.radians(SUN_DEG))
            solid = (areas() * cap.sum(1)).sum()
            picture[cap] += _rgb(params["irradiance.value"]) / max(solid, 1e-12)
        elif kind == "PointLight":
            place = np.array(params["position"], float).ravel()[:3]
            balls.append((place, _rgb(params["intensity.value"]) / (np.pi * BALL_M**2)))
        else:
            raise StudioError(
                f"{path}: emitter {emitter.id()!r} is of kind {kind}, which cannot be baked; make it an area emitter"
            )
    return picture, balls


def directions() -> Float[np.ndarray, "h w 3"]:
    """Through the middle of every texel."""
    polar = np.pi * (np.arange(ROWS) + 0.5) / ROWS
    azimuth = 2 * np.pi * (np.arange(COLUMNS) + 0.5) / COLUMNS
    across = np.sin(polar)[:, None]
    return np.stack(
        [
            across * np.cos(azimuth),
            across * np.sin(azimuth),
            np.broadcast_to(np.cos(polar)[:, None], (ROWS, COLUMNS)),
        ],
        -1,
    )


def areas(rows: int = ROWS, columns: int = COLUMNS) -> Float[np.ndarray, " h"]:
    """Solid angle of a texel of each row."""
    return -np.diff(np.cos(np.pi * np.arange(rows + 1) / rows)) * 2 * np.pi / columns


def with_balls(room: "Interior", balls: list[Ball]) -> "Interior":
    """The room with a glowing ball for each point light."""
    if not balls:
        return room
    from hardware.virtual.studio import solids

    ball = solids.ball(12, lambda d: np.full(len(d), BALL_M))
    looks, vertices, normals, faces, look = (
        list(room.looks),
        [room.vertices],
        [room.normals],
        [room.faces],
        [room.look],
    )
    count = len(room.vertices)
    for place, radiance in balls:
        vertices.append(ball.vertices + room.world_from_scene @ place)
        normals.append(ball.normals)
        faces.append(ball.faces + count)
        look.append(np.full(len(ball.faces), len(looks)))
        looks.append(
            Look(
                np.zeros((1, 1, 3)), radiance.reshape(1, 1, 3), np.zeros(2), np.ones(2), True, two_sided=False
            )
        )
        count += len(ball.vertices)
    uv = np.concatenate([room.uv, np.zeros((count - len(room.uv), 2))])
    note = f"{len(balls)} point light(s), made glowing balls of {100 * BALL_M:g} cm"
    return replace(
        room, vertices=np.concatenate(vertices), normals=np.concatenate(normals), uv=uv,
        faces=np.concatenate(faces), look=np.concatenate(look), looks=tuple(looks), notes=(*room.notes, note),
    )  # fmt: skip


def _seen(mi: Any, emitter: Any, turn: np.ndarray) -> Float[np.ndarray, "h w 3"]:
    """Means over texels, the finer where they stand out."""
    every = np.arange(ROWS * COLUMNS)
    picture = _means(mi, emitter, turn, every, SAMPLES).reshape(ROWS, COLUMNS, 3)
    level = picture.mean(-1)
    around = np.median([np.roll(level, k, 1) for k in (-8, -6, 6, 8)], axis=0)
    bright = np.flatnonzero(level.ravel() > np.maximum(3 * around.ravel(), 1e-9))
    some = bright[np.argsort(-level.ravel()[bright])][:4096]
    grown = np.unique(
        np.concatenate([(some + dy * COLUMNS + dx) % len(every) for dy in (-1, 0, 1) for dx in (-1, 0, 1)])
    )
    picture.reshape(-1, 3)[grown] = _means(mi, emitter, turn, grown, MORE)
    return picture.astype(np.float32)


def _means(
    mi: Any, emitter: Any, turn: np.ndarray, texels: np.ndarray, count: int
) -> Float[np.ndarray, "n 3"]:
    import drjit as dr

    side = round(count**0.5)
    values = np.zeros((len(texels), 3))
    step = 4_000_000 // count
    frame = mi.Matrix3f(turn.T)
    for begin in range(0, len(texels), step):
        some = mi.UInt32(texels[begin : begin + step].astype(np.uint32))
        lane = dr.arange(mi.UInt32, dr.width(some) * count)
        texel, part = dr.gather(mi.UInt32, some, lane // count), lane % count
        row, column = texel // COLUMNS, texel % COLUMNS
        # Equal steps of the cosine are equal areas.
        low, high = dr.cos(dr.pi * mi.Float(row) / ROWS), dr.cos(dr.pi * mi.Float(row + 1) / ROWS)
        z = low + (high - low) * (mi.Float(part // side) + 0.5) / side
        azimuth = dr.two_pi * (mi.Float(column) + (mi.Float(part % side) + 0.5) / side) / COLUMNS
        across = dr.safe_sqrt(1 - z * z)
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(lane))
        si.wi = -(frame @ mi.Vector3f(across * dr.cos(azimuth), across * dr.sin(azimuth), z))
        value = mi.Color3f(emitter.eval(si)) + dr.zeros(mi.Color3f, dr.width(lane))
        dr.eval(value)
        values[begin : begin + step] = np.array(dr.block_sum(value, count)).T / count
    return values


def _rgb(value: Any) -> Float[np.ndarray, "3"]:
    return (
        np.broadcast_to(np.array(value, float).ravel(), 3)
        if np.size(value) == 1
        else np.array(value, float).ravel()[:3]
    )
