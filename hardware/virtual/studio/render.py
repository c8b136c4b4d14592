"""Photograph the room and the body: what each pixel of each view receives, as linear radiance.

Two pictures make a view. Pixels that the body touches are path-traced, in the camera's frame, where body and
camera stay and the room moves; the room's panels are emitters that carry the baked light. They are found
by following the reflectance only, while lamps are also aimed at. All other pixels look straight at the
baked room. A pixel is the mean over its own square in both, so edges blend.
"""

import functools
from typing import Any, Protocol

import numpy as np
from jaxtyping import Bool, Float

from hardware.virtual.studio import tracer
from hardware.virtual.studio.bake import Atlas
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.rooms import Room
from hardware.virtual.studio.truth import FIELD_OF_VIEW_DEG

PANORAMA = (128, 256)  # rows, columns
BACKGROUND_SAMPLES = 16
_FACE = 256  # pixels of a cube face: 0.35 degrees, a quarter of a panorama's pixel


class Back(Protocol):
    """A room without the body, from anywhere."""

    def look(self, world_from_cam: Float[np.ndarray, "3 4"], width: int, height: int, seed: int,
             field_deg: float = FIELD_OF_VIEW_DEG, samples: int = BACKGROUND_SAMPLES) -> Float[np.ndarray, "h w 3"]:  # fmt: skip
        """The room as a pinhole camera sees it."""
        ...


class Backdrop:
    """Looks at the baked room without the body."""

    def __init__(self, room: Room, atlas: Atlas, device: str):
        self.mi = mi = tracer.load(device)
        glow = {"type": "area", "radiance": tracer.texture(mi, atlas.picture, "bilinear")}
        self.scene = mi.load_dict({
            "type": "scene", "room": tracer.room_mesh(mi, room.panels, atlas, tracer.BLACK, glow),
            **tracer.lamps(mi, room), "integrator": {"type": "path", "max_depth": 1},
        })  # fmt: skip
        self.lenses: dict[tuple[float, int, int], Any] = {}

    def look(self, world_from_cam: Float[np.ndarray, "3 4"], width: int, height: int, seed: int,
             field_deg: float = FIELD_OF_VIEW_DEG, samples: int = BACKGROUND_SAMPLES) -> Float[np.ndarray, "h w 3"]:  # fmt: skip
        """The room as a pinhole camera sees it."""
        key = (field_deg, width, height)
        if key not in self.lenses:
            self.lenses[key] = self.mi.load_dict(tracer.lens(self.mi, width, height, field_deg))
        sensor = self.lenses[key]
        tracer.place(self.mi, sensor, world_from_cam)
        return np.array(self.mi.render(self.scene, sensor=sensor, spp=samples, seed=seed), dtype=np.float32)


def panorama(back: Back, cam_from_world: Float[np.ndarray, "3 4"], world_point: Float[np.ndarray, "3"],
             seed: int) -> Float[np.ndarray, "128 256 3"]:  # fmt: skip
    """Radiance that reaches a point from every direction, equirectangular in the camera's frame.

    Column u and row v look along azimuth 2 pi (u + 0.5) / W - pi and polar angle pi (v + 0.5) / H from -y.
    """
    faces = np.stack([
        back.look(np.column_stack([cam_from_world[:, :3].T @ turn, world_point]), _FACE, _FACE, seed + k, 90.0, 4)
        for k, turn in enumerate(_FACES)
    ])  # fmt: skip
    face, row, column = _cube_lookup()
    rows, columns = PANORAMA
    finer = len(face) // (rows * columns)
    return faces[face, row, column].reshape(rows, columns, finer, 3).mean(2)


# Six cameras, as camera-frame rotations (columns: right, down, forward).
_FACES = tuple(
    np.stack([np.cross(down, forward), down, forward], 1).astype(float)
    for forward, down in (
        ((0, 0, 1), (0, 1, 0)), ((1, 0, 0), (0, 1, 0)), ((0, 0, -1), (0, 1, 0)),
        ((-1, 0, 0), (0, 1, 0)), ((0, -1, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, -1)),
    )
)  # fmt: skip


@functools.cache
def _cube_lookup(finer: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cube face, row and column behind `finer`^2 equal parts of every panorama pixel."""
    rows, columns = PANORAMA
    part = (np.arange(finer) + 0.5) / finer
    # Equal steps of the cosine inside a pixel are equal areas on the sphere.
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    up = edges[:-1, None] * (1 - part) + edges[1:, None] * part
    azimuth = 2 * np.pi * (np.arange(columns)[:, None] + part) / columns - np.pi
    up, azimuth = (
        a.reshape(-1) for a in np.broadcast_arrays(up[:, None, :, None], azimuth[None, :, None, :])
    )
    flat = np.sqrt(1 - up * up)
    directions = np.stack([flat * np.sin(azimuth), -up, flat * np.cos(azimuth)], 1)
    local = np.stack([directions @ f for f in _FACES])
    face = local[:, :, 2].argmax(0)
    right, down, forward = local[face, np.arange(len(face))].T
    column = np.clip(((right / forward + 1) / 2 * _FACE).astype(int), 0, _FACE - 1)
    row = np.clip(((down / forward + 1) / 2 * _FACE).astype(int), 0, _FACE - 1)
    return face, row, column


class Foreground:
    """Path-traces the pixels that the body touches."""

    def __init__(self, room: Room, atlas: Atlas, body: Body, touched: Bool[np.ndarray, "h w"], device: str):
        self.mi = mi = tracer.load(device)
        self.room, self.touched = room, touched
        rows, columns = np.nonzero(touched.any(1))[0], np.nonzero(touched.any(0))[0]
        self.crop = (columns[0], rows[0], columns[-1] - columns[0] + 1, rows[-1] - rows[0] + 1)
        height, width = touched.shape
        glow = {
            "type": "area", "radiance": tracer.texture(mi, atlas.picture, "bilinear"), "sampling_weight": 0.0,
        }  # fmt: skip
        self.scene = mi.load_dict({
            "type": "scene", "body": tracer.body_mesh(mi, body),
            "room": tracer.room_mesh(mi, room.panels, atlas, tracer.BLACK, glow), **tracer.lamps(mi, room),
            "integrator": {"type": "path", "max_depth": 8, "rr_depth": 6},
            "sensor": tracer.lens(mi, width, height, FIELD_OF_VIEW_DEG, self.crop),
        })  # fmt: skip
        self.corners = tracer.quad_corners(room.panels)
        self.params = mi.traverse(self.scene)

    def look(
        self, cam_from_world: Float[np.ndarray, "3 4"], samples: int, seed: int
    ) -> Float[np.ndarray, "p 3"]:
        """Radiance of the touched pixels, row by row."""
        tracer.move_room(self.mi, self.params, self.room, self.corners, cam_from_world)
        picture = np.array(self.mi.render(self.scene, spp=samples, seed=seed))
        x, y, w, h = self.crop
        return picture[self.touched[y : y + h, x : x + w]].astype(np.float32)
