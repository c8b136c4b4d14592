"""What stands before the virtual camera: linear Rec.709 radiance of every pixel, for the angles of its rig.

`Studio` path-traces a room and an object of the virtual studio; `Card` is worked out in a millisecond from cosines, for
captures of hundreds of poses. World z up, metres; camera frame x right, y down, z forward; `motion.pose_of` turns.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float

from hardware.interfaces import Angles, Geometry
from hardware.virtual.studio import bake, mirror, motion, objects, render, rooms, truth

Progress = Callable[[float, str], None]
Picture = Float[np.ndarray, "h w 3"]

SPHERE_M = 2.0  # radius of the card's surroundings
DISC = 0.22  # radius of the card's object, as a share of the picture's width
WAVES = 40
FINEST = 140.0  # per radian: the highest wave number of the pattern, so features of a degree or two


class Scene(Protocol):
    """What the camera looks at."""

    geometry: Geometry  # of the rig it stands on

    def look(self, angles: Angles, seed: int) -> Picture:
        """The picture before the sensor; `seed` places the samples, if it takes any."""
        ...


class Studio:
    """A room and an object as `hardware.virtual.studio.shoot` has them, one pose at a time.

    At 320 x 240 a pose of 64 samples takes 3.5 s of one core and leaves 6 % of noise in an object's pixel.
    """

    def __init__(self, room: str, thing: str, rig: str, size: tuple[int, int], samples: int, cache: Path,
                 progress: Progress, device: str = "cpu"):  # fmt: skip
        """Furnishes and, the first time, bakes the room, which takes minutes; the one that ships baked is there in seconds.

        Raises:
            StudioError: no such room, object or rig.
        """
        progress(0.0, f"furnishing room {room}")
        self._rig, self._size, self._samples = rig, size, samples
        self.geometry = motion.geometry_of(rig)
        with ThreadPoolExecutor(1) as beside:
            made = beside.submit(_body, thing, size)
            furnished = rooms.furnish(room)
            self.body, self._touched = made.result()
        cache.mkdir(parents=True, exist_ok=True)
        furnished, atlas = mirror.reflected(furnished, bake.bake(furnished, cache, device, progress))
        self._centre = furnished.centre
        self._back = render.Backdrop(furnished, atlas, device)
        self._front = render.Foreground(furnished, atlas, self.body, self._touched, device)

    def look(self, angles: Angles, seed: int) -> Picture:
        pose = self.pose(angles)
        picture = self._back.look(pose, *self._size, seed)
        picture[self._touched] = self._front.look(_inverse(pose), self._samples, seed)
        return picture

    def pose(self, angles: Angles) -> Float[np.ndarray, "3 4"]:
        """world_from_cam."""
        return motion.pose_of(self._rig, self._centre, angles.pan_deg, angles.tilt_deg)

    def truth(self, places: list[Angles], progress: Progress) -> truth.Truth:
        """What a session of these poses is compared with."""
        poses = np.stack([_inverse(self.pose(angles)) for angles in places])
        middle = np.append(self.body.solid.vertices.mean(0), 1.0)
        panoramas = []
        for i, pose in enumerate(poses):
            progress(i / len(poses), f"panorama {i + 1} of {len(poses)}")
            panoramas.append(render.panorama(self._back, pose, _inverse(pose) @ middle, 1000 + 6 * i))
        maps = truth.maps(self.body, *self._size)
        return truth.Truth(
            **maps, camera=truth.camera(*self._size), cam_from_world=poses, panoramas=np.stack(panoramas)
        )


def _body(thing: str, size: tuple[int, int]) -> tuple[objects.Body, Bool[np.ndarray, "h w"]]:
    """An object, and the pixels of a picture that it touches."""
    body = objects.model(thing)
    return body, truth.touched(body, *size)


class Card:
    """A patterned sphere around the rig with two lamps on it, and a disc that moves with the camera."""

    def __init__(self, rig: str, size: tuple[int, int], seed: int = 0):
        """
        Raises:
            StudioError: no such rig.
        """
        self.geometry = motion.geometry_of(rig)
        self._rig = rig
        rng = np.random.default_rng(seed)
        width, height = size
        lens = truth.camera(width, height)
        y, x = np.mgrid[:height, :width] + 0.5
        rays = np.stack([(x - lens["cx"]) / lens["fx"], (y - lens["cy"]) / lens["fy"], np.ones_like(x)], -1)
        self._rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        directions = rng.normal(size=(WAVES, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self._waves = directions * np.geomspace(2.0, FINEST, WAVES)[:, None]
        self._phases = rng.uniform(0, 2 * np.pi, (WAVES, 1))
        self._hues = rng.normal(size=(WAVES, 3)) * 0.07 + 0.13
        self._lamps = np.array([[0.5, 0.6, 0.62], [-0.7, -0.1, 0.7]])
        self._lamps /= np.linalg.norm(self._lamps, axis=1, keepdims=True)
        across = np.stack([x - width / 2, y - height / 2], -1) / (DISC * width)
        self._disc = (across**2).sum(-1) < 1
        flat = across[self._disc]
        # Normals of a dome, so that its shading tells where the lamps are.
        self._normals = np.column_stack([flat, -np.sqrt(1 - (flat**2).sum(-1))])
        self._albedo = 0.45 + 0.25 * np.sign(np.sin(9 * flat[:, :1]) * np.sin(9 * flat[:, 1:])) * [
            1.0,
            0.6,
            0.3,
        ]

    def look(self, angles: Angles, seed: int) -> Picture:
        pose = motion.pose_of(self._rig, np.zeros(3), angles.pan_deg, angles.tilt_deg)
        rotation, place = pose[:, :3], pose[:, 3]
        rays = self._rays.reshape(-1, 3) @ rotation.T
        along = rays @ place
        reach = -along + np.sqrt(along**2 - place @ place + SPHERE_M**2)
        points = (place + rays * reach[:, None]) / SPHERE_M
        picture = np.exp(np.cos(points @ self._waves.T + self._phases.T) @ self._hues) * 0.5
        for lamp in self._lamps:
            picture += 150.0 * np.exp(-(1 - points @ lamp) * 800.0)[:, None]
        picture = picture.reshape(self._rays.shape)
        lit = np.maximum(self._normals @ (self._lamps @ rotation).T, 0.0).sum(1, keepdims=True)
        picture[self._disc] = self._albedo * (0.35 + 1.2 * lit)
        return picture.astype(np.float32)


def _inverse(a_from_b: Float[np.ndarray, "3 4"]) -> Float[np.ndarray, "3 4"]:
    rotation = a_from_b[:, :3].T
    return np.column_stack([rotation, -rotation @ a_from_b[:, 3]])
