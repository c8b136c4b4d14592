"""A whole studio without hardware: room, object, camera lens and rig, photographed view by view.

Linear Rec.709 radiance in, nothing stored but caches: the baked room, and the pixels that the object touches,
which are the costly part and depend on nothing but their key. World z up, metres; camera frame x right, y down.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from hardware.errors import StudioError
from hardware.virtual.studio import (
    bake,
    mirror,
    motion,
    objects,
    relight,
    render,
    rooms,
    samples,
    tracer,
    truth,
)

VERSION = 4  # raise when the rendered values would change
NOISE = 0.015  # of an object pixel over the views, relative to its mean; average over the pixels
PILOT_VIEWS = 6
PLAIN_SAMPLES = 512  # a pixel and view, where Mitsuba has no vectorised variant

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class Order:
    """What to photograph, and how: names as `rooms`, `objects`, `motion` and `tracer` have them, pixels."""

    room: str
    thing: str
    views: int
    width: int
    height: int
    motion: str
    seed: int
    device: str


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One photograph before the sensor."""

    index: int
    cam_from_world: Float[np.ndarray, "3 4"]
    radiance: Float[np.ndarray, "h w 3"]
    rig: dict[str, float | str] | None


@dataclass(frozen=True, slots=True, eq=False)
class Studio:
    """Everything that is fixed for one set; see `build`."""

    order: Order
    body: objects.Body
    journey: motion.Journey
    room: rooms.Room
    atlas: bake.Atlas
    cache: Path

    def cams_from_world(self) -> Float[np.ndarray, "n 3 4"]:
        """Pose of every view."""
        rotation = self.journey.world_from_cam[:, :, :3].transpose(0, 2, 1)
        return np.concatenate([rotation, -rotation @ self.journey.world_from_cam[:, :, 3:]], 2)

    def shoot(self, progress: Progress) -> Iterator[View]:
        """The views in the order in which they are taken."""
        poses = self.cams_from_world()
        order = self.order
        touched = truth.touched(self.body, order.width, order.height)
        front = self._object_pixels(poses, touched, lambda share, note: progress(0.9 * share, note))
        back = render.Backdrop(self.room, self.atlas, order.device)
        for i, pose in enumerate(poses):
            progress(0.9 + 0.1 * i / len(poses), f"photographing the room, view {i + 1} of {len(poses)}")
            picture = back.look(self.journey.world_from_cam[i], order.width, order.height, order.seed + i)
            picture[touched] = front[i]
            yield View(i, pose, picture, self.journey.reports[i])

    def truth(self, progress: Progress) -> truth.Truth:
        """What a reconstruction is compared with."""
        order, poses = self.order, self.cams_from_world()
        back = render.Backdrop(self.room, self.atlas, order.device)
        middle = self.body.solid.vertices.mean(0)
        panoramas = []
        for i, pose in enumerate(poses):
            progress(i / len(poses), f"panorama {i + 1} of {len(poses)}")
            point = self.journey.world_from_cam[i] @ np.append(middle, 1.0)
            panoramas.append(back.panorama(pose, point, order.seed + 1000 + 6 * i))
        return truth.Truth(
            **truth.maps(self.body, order.width, order.height),
            camera=truth.camera(order.width, order.height),
            cam_from_world=poses,
            panoramas=np.stack(panoramas),
        )

    def _object_pixels(self, poses: np.ndarray, touched: np.ndarray, progress: Progress) -> np.ndarray:
        """Path-traced radiance [n p 3] of the touched pixels; read from the cache when it is there."""
        facts = [VERSION, bake.digest(self.room), self.body.name, poses.round(9).tolist(), self.order.width,
                 self.order.height, self.order.seed, NOISE]  # fmt: skip
        key = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]
        path = self.cache / f"{self.room.name}-{self.body.name}-{key}.npz"
        if path.exists():
            with np.load(path) as stored:
                return stored["radiance"].astype(np.float32)
        radiance = self._traced(poses, touched, progress)
        partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.npz")
        np.savez(partial, radiance=radiance)
        partial.rename(path)
        return radiance

    def _traced(self, poses: np.ndarray, touched: np.ndarray, progress: Progress) -> np.ndarray:
        note = f"path-tracing the object in {len(poses)} views"
        seed, device = self.order.seed, self.order.device
        if tracer.is_vectorised(tracer.load(device)):
            return self._relit(poses, touched, lambda share: progress(share, note))
        front = render.Foreground(self.room, self.atlas, self.body, touched, device)
        pixels = []
        for i, pose in enumerate(poses):
            progress(i / len(poses), note)
            pixels.append(front.look(pose, PLAIN_SAMPLES, seed + 7919 * (i + 1)))
        return np.stack(pixels)

    def _relit(
        self, poses: np.ndarray, touched: np.ndarray, progress: Callable[[float], None]
    ) -> Float[np.ndarray, "n p 3"]:
        """Each pixel by as many samples as it needs; those that say how many are used for nothing else (no bias)."""
        lit = relight.Relighter(self.room, self.atlas, self.body, touched, self.order.device)
        some = poses[:: max(1, len(poses) // PILOT_VIEWS)]
        pilot = samples.plan(self.room, samples.PILOT)
        seeds = 16 * self.order.seed  # sixteen sets of numbers, no two alike
        noise = lit.noise(some, pilot, seeds + 14, lambda share: progress(0.1 * share))
        counts = samples.needed(noise, touched, NOISE)
        radiance = np.zeros((len(poses), len(counts), 3), np.float32)
        done, total = 0, counts.sum()
        for count in np.unique(counts):
            mine = np.flatnonzero(counts == count)
            cost = int(count) * len(mine)

            def tell(share: float, done: int = done, cost: int = cost) -> None:
                progress(0.1 + 0.9 * (done + share * cost) / total)

            effort = samples.plan(self.room, int(count))
            radiance[:, mine] = lit.look(poses, effort, seeds + int(count).bit_length(), tell, mine)
            done += cost
        return radiance


def build(order: Order, cache: Path, progress: Progress) -> Studio:
    """Furnish and bake the room, set the object up, plan the journey.

    Raises:
        StudioError: unknown names, sizes that no Bayer sensor has, no views, a negative seed, or a device
            that is not there.
    """
    width, height = order.width, order.height
    if width < 16 or height < 16 or width % 2 or height % 2:
        raise StudioError(f"{width} x {height} pixels: a Bayer sensor needs even sizes of at least 16")
    if order.seed < 0:
        raise StudioError(f"seed {order.seed}: a seed is a whole number >= 0; choose another")
    furnished, body = rooms.furnish(order.room), objects.model(order.thing)
    journey = motion.travel(order.motion, order.views, furnished.centre, order.seed)
    cache.mkdir(parents=True, exist_ok=True)
    room, atlas = mirror.reflected(furnished, bake.bake(furnished, cache, order.device, progress))
    return Studio(order, body, journey, room, atlas, cache)
