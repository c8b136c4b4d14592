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
    bodies,
    motion,
    objects,
    relight,
    render,
    rooms,
    samples,
    surroundings,
    truth,
)
from hardware.virtual.studio.bodies import Thing
from hardware.virtual.studio.interior import around, place
from hardware.virtual.studio.order import Order
from hardware.virtual.studio.surroundings import Surroundings

VERSION = 4  # raise when the rendered values would change
PILOT_VIEWS = 6
PLAIN_SAMPLES = 512  # a pixel and view, where Mitsuba has no vectorised variant

Progress = Callable[[float, str], None]


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
    around: Surroundings
    cache: Path
    notes: tuple[str, ...] = ()  # what was done to room and object, for the person to know

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
        back = self.around.backdrop()
        for i, pose in enumerate(poses):
            progress(0.9 + 0.1 * i / len(poses), f"photographing the room, view {i + 1} of {len(poses)}")
            picture = back.look(self.journey.world_from_cam[i], order.width, order.height, order.seed + i)
            picture[touched] = front[i]
            yield View(i, pose, picture, self.journey.reports[i])

    def truth(self, progress: Progress, panoramas: bool = True) -> truth.Truth:
        """What a reconstruction is compared with; the light at the object, which takes longest, only with `panoramas`."""
        order, poses = self.order, self.cams_from_world()
        back = self.around.backdrop()
        middle = self.body.solid.vertices.mean(0)
        seen = np.zeros((len(poses) if panoramas else 0, *render.PANORAMA, 3), np.float32)
        for i in range(len(seen)):
            progress(i / len(poses), f"panorama {i + 1} of {len(poses)}")
            point = self.journey.world_from_cam[i] @ np.append(middle, 1.0)
            seen[i] = render.panorama(back, poses[i], point, order.seed + 1000 + 6 * i)
        return truth.Truth(
            **truth.maps(self.body, order.width, order.height),
            camera=truth.camera(order.width, order.height),
            cam_from_world=poses,
            panoramas=seen,
        )

    def _object_pixels(self, poses: np.ndarray, touched: np.ndarray, progress: Progress) -> np.ndarray:
        """Path-traced radiance [n p 3] of the touched pixels; read from the cache when it is there."""
        facts = [VERSION, self.around.key, self.body.name, poses.round(9).tolist(), self.order.width,
                 self.order.height, self.order.seed, self.order.noise]  # fmt: skip
        key = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]
        path = self.cache / f"{self.around.name}-{self.body.name}-{key}.npz"
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
        seed, lights = self.order.seed, self.around.lights(self.body)
        if lights is not None:
            return self._relit(lights, poses, touched, lambda share: progress(share, note))
        front = self.around.foreground(self.body, touched)
        pixels = []
        for i, pose in enumerate(poses):
            progress(i / len(poses), note)
            pixels.append(front.look(pose, PLAIN_SAMPLES, seed + 7919 * (i + 1)))
        return np.stack(pixels)

    def _relit(
        self,
        lights: relight.Lights,
        poses: np.ndarray,
        touched: np.ndarray,
        progress: Callable[[float], None],
    ) -> Float[np.ndarray, "n p 3"]:
        """Each pixel by as many samples as it needs; those that say how many are used for nothing else (no bias)."""
        lit = relight.Relighter(lights, self.body, touched)
        some = poses[:: max(1, len(poses) // PILOT_VIEWS)]
        pilot = lights.effort(samples.PILOT)
        seeds = 16 * self.order.seed  # sixteen sets of numbers, no two alike
        noise = lit.noise(some, pilot, seeds + 14, lambda share: progress(0.1 * share))
        counts = samples.needed(noise, touched, self.order.noise)
        radiance = np.zeros((len(poses), len(counts), 3), np.float32)
        done, total = 0, counts.sum()
        for count in np.unique(counts):
            mine = np.flatnonzero(counts == count)
            cost = int(count) * len(mine)

            def tell(share: float, done: int = done, cost: int = cost) -> None:
                progress(0.1 + 0.9 * (done + share * cost) / total)

            effort = lights.effort(int(count))
            radiance[:, mine] = lit.look(poses, effort, seeds + int(count).bit_length(), tell, mine)
            done += cost
        return radiance


def build(order: Order, cache: Path, progress: Progress) -> Studio:
    """Furnish and bake the room, set the object up, plan the journey.

    Raises:
        StudioError: unknown names, sizes that no Bayer sensor has, no views, a negative seed, what is no number, or a device
            that is not there.
    """
    width, height = order.width, order.height
    if width < 16 or height < 16 or width % 2 or height % 2:
        raise StudioError(f"{width} x {height} pixels: a Bayer sensor needs even sizes of at least 16")
    if not 0.001 <= order.noise <= 1:
        raise StudioError(f"--noise {order.noise:g}: give a share between 0.001 and 1")
    if order.seed < 0:
        raise StudioError(f"seed {order.seed}: a seed is a whole number >= 0; choose another")
    if order.place is not None and not np.isfinite(order.place).all():
        raise StudioError(f"--place {' '.join(map(str, order.place))}: give three numbers, in metres")
    cache.mkdir(parents=True, exist_ok=True)
    stood = bodies.stand(Thing(order.thing, order.object_size, order.material, order.turn_deg), order.seed)
    if _is_file(order.room):
        room, journey, notes = around.build(order, stood, cache, progress)
        return Studio(order, stood.body, journey, room, cache, (*notes, *stood.notes))
    if order.place is not None:
        raise StudioError("--place: the rig's place in a built-in room is fixed; give one with a scene file")
    room = surroundings.BuiltIn(order.room, cache, order.device, progress)
    journey, told = _journey(order, stood, room.centre)
    return Studio(order, stood.body, journey, room, cache, (*told, *stood.notes))


def _is_file(room: str) -> bool:
    """Whether a scene file is meant rather than a built-in room."""
    return not rooms.is_built_in(room) and ("/" in room or Path(room).suffix != "")


def _journey(
    order: Order, stood: bodies.Stood, centre: Float[np.ndarray, "3"]
) -> tuple[motion.Journey, tuple[str, ...]]:
    """In a built-in room, whose free space is known; and what to say of it."""
    if stood.scale == 1:
        return motion.travel(order.motion, order.views, centre, order.seed), ()
    reach = np.inf
    for journey, told in motion.calmer(order.motion, order.views, order.seed, stood.scale):
        reach = place.sweep(journey.world_from_cam, stood.body.solid.vertices, stood.scale).reach.max()
        if reach <= rooms.FREE_M:
            return motion.carried(journey, centre, 1.0), told
    raise StudioError(
        f"{order.thing}: camera and object reach {reach:.2f} m from the room's centre, where {rooms.FREE_M:g} m are free;"
        " choose a smaller --object-size"
    )
