"""A baked interior around the rig: what `shoot` asks of a room."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from hardware.errors import StudioError
from hardware.virtual.studio import motion, render, tracer, truth
from hardware.virtual.studio.bake import Progress
from hardware.virtual.studio.bodies import Stood
from hardware.virtual.studio.interior import gather, glow, place, proposal, read
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.order import Order


def build(
    order: Order, stood: Stood, cache: Path, progress: Progress
) -> tuple["Around", motion.Journey, list[str]]:
    """Read and bake a scene file, find the rig a place, and plan its journey; what was simplified, in words.

    Raises:
        StudioError: the scene cannot be used, or the rig fits nowhere.
    """
    progress(0.0, f"reading {order.room}")
    interior = read.read(Path(order.room))
    baked = gather.bake(interior, cache, order.device, progress)
    room = glow.Room(tracer.load(order.device), interior, baked.grid, baked.light)
    corners = interior.vertices[np.unique(interior.faces)]
    bounds = np.stack([corners.min(0), corners.max(0)])
    given = None if order.place is None else interior.world_from_scene @ np.array(order.place, float)
    calm: StudioError | None = None
    for journey, told in motion.calmer(order.motion, order.views, order.seed, stood.scale):
        needed = place.sweep(journey.world_from_cam, stood.body.solid.vertices, stood.scale)
        try:
            centre = place.choose(room, bounds, interior.eye, given, needed, order.room)
        except StudioError as fault:
            calm = fault
            continue
        spot = interior.world_from_scene.T @ centre
        notes = [f"{order.room}: simplified: {note}" for note in interior.notes]
        notes.append(f"the rig stands at --place {spot[0]:.3f} {spot[1]:.3f} {spot[2]:.3f}")
        notes += told
        key = f"{interior.key}-{baked.key}"
        return Around(interior.name, key, centre, room), motion.carried(journey, centre, 1.0), notes
    assert calm is not None
    raise calm


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """The room, with the rig's centre in the world."""

    name: str
    key: str
    centre: Float[np.ndarray, "3"]
    room: glow.Room

    def lights(self, body: Body) -> proposal.Proposal:
        return proposal.Proposal(self.room, body.solid.vertices[:: max(1, len(body.solid.vertices) // 4000)])

    def foreground(self, body: Body, touched: Bool[np.ndarray, "h w"]) -> render.Foreground:
        raise StudioError("rooms from files need libLLVM 16 or newer for Mitsuba; install libllvm19")

    def backdrop(self) -> "Backdrop":
        return Backdrop(self.room)


class Backdrop:
    """Looks at the interior without the body."""

    def __init__(self, room: glow.Room):
        self.room = room

    def look(self, world_from_cam: Float[np.ndarray, "3 4"], width: int, height: int, seed: int,
             field_deg: float = truth.FIELD_OF_VIEW_DEG, samples: int = render.BACKGROUND_SAMPLES) -> Float[np.ndarray, "h w 3"]:  # fmt: skip
        """The room as a pinhole camera sees it: means over the pixels' squares, `samples` a square number."""
        mi: Any = self.room.mi
        import drjit as dr

        side = round(samples**0.5)
        focal = width / 2 / np.tan(np.radians(field_deg) / 2)
        lane = dr.arange(mi.UInt32, width * height * samples)
        pixel, part = lane // samples, lane % samples
        a, b = mi.sample_tea_32(lane, dr.opaque(mi.UInt32, seed % 2**31))
        jitter = mi.Point2f(mi.Float(a >> 8), mi.Float(b >> 8)) * 2.0**-24
        x = mi.Float(pixel % width) + (mi.Float(part % side) + jitter.x) / side
        y = mi.Float(pixel // width) + (mi.Float(part // side) + jitter.y) / side
        aim = dr.normalize(mi.Vector3f((x - width / 2) / focal, (y - height / 2) / focal, 1.0))
        pose = mi.Transform4f(np.vstack([world_from_cam, [0, 0, 0, 1]]))
        dr.make_opaque(pose)
        origin = pose @ mi.Point3f(0.0) + dr.zeros(mi.Point3f, dr.width(lane))
        value = self.room.meet(mi.Ray3f(origin, pose @ aim)).radiance
        dr.eval(value)
        return np.array(dr.block_sum(value, samples)).T.reshape(height, width, 3).astype(np.float32) / samples
