"""Lights for relighting, made in a worker child: the recovered light of a view with its lamps apart, and panoramas.

Panoramas as in `engine.types.Panorama`; camera frame of the view. Written as files that `app/relight/files.py` reads.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from jaxtyping import Float

from app.inspect.rerendering import Solved
from app.relight import relit as relighting
from app.relight.files import keep
from app.relight.relit import LATTICE
from engine.errors import LightError
from engine.geometry import fibonacci_sphere, inverse, transform
from engine.io.images import read_radiance, srgb_decode
from engine.light.fitting.lamp_model import lamp_transmittance
from engine.light.incident import probes
from engine.light.incident.direction_grid import nearest_cells

if TYPE_CHECKING:
    from app.work.worker import Link

ROWS = 256  # of panoramas
NAMED_LAMPS = 8  # lamps with a strength of their own


def serve_panorama(request: Mapping[str, Any], link: "Link") -> Mapping[str, Any]:
    """Task "panorama": {file, to}: an equirectangular picture as a light; gives {light}."""
    path, to = Path(request["file"]), Path(request["to"])
    link.progress().step(0.1, path.name)
    radiance = read_panorama(path)
    link.progress().step(0.6, path.name)
    keep(to, {**as_light(radiance), "name": np.array(path.name), **_no_lamps()})
    return {"light": str(to)}


def panorama(path: Path) -> relighting.Light:
    """A picture as a light.

    Raises:
        LightError: no panorama (twice as wide as high), or unreadable.
        RawError: an EXR or Radiance file that cannot be read.
    """
    arrays: dict[str, Any] = {**as_light(read_panorama(path)), "name": path.name, **_no_lamps()}
    return relighting.Light(**arrays)


def recovered(solved: Solved, view: int, middle: Float[np.ndarray, " 3"]) -> dict[str, np.ndarray]:
    """The arrays of a `relighting.Light`: what arrived at the object in a view, its lamps apart."""
    lamps = solved.emitters.lamps
    pose = solved.poses.cam_from_world[view]
    origin = transform(inverse(pose), middle)
    room, _ = probes.panorama(solved.emitters.field(), origin, pose[:, :3], ROWS, fill=True)
    centres = transform(pose, lamps.centres.reshape(-1, 3))
    through = lamp_transmittance(lamps, solved.emitters.shown(), pose[None], middle)[0]
    distance = np.linalg.norm(centres - middle, axis=1)
    power = lamps.radiance.sum(1) * (lamps.radii / np.maximum(distance, 1e-9)) ** 2 * through
    first = np.argsort(-power, kind="stable")
    group = np.full(len(power), -1)
    group[first[:NAMED_LAMPS]] = np.arange(min(len(power), NAMED_LAMPS))
    return {
        **as_light(room),
        "name": np.array(solved.frames.names[view]),
        "lamp_centre": centres,
        "lamp_radius": lamps.radii,
        "lamp_radiance": lamps.radiance * through[:, None],
        "lamp_group": group,
        "lamp_clipped": lamps.clipped,
    }


def as_light(radiance: Float[np.ndarray, "h w 3"]) -> dict[str, np.ndarray]:
    """A panorama as energy from the lattice's directions, and as a picture to stand behind the object."""
    directions = fibonacci_sphere(LATTICE)
    fine = 2 * ROWS
    # Large panoramas are averaged down: a sun of many pixels keeps its energy. The pixels of small ones are parted, so
    # that every direction of the lattice gets its share.
    way = cv2.INTER_AREA if len(radiance) > fine else cv2.INTER_NEAREST
    small = cv2.resize(radiance.astype(np.float32), (2 * fine, fine), interpolation=way)
    solid = np.sin(np.pi * (np.arange(fine) + 0.5) / fine) * (np.pi / fine) ** 2
    towards = probes.panorama_directions(fine).reshape(-1, 3)
    cells = nearest_cells(directions, 256)
    face, u, v = relighting.cube_place(towards, 256)
    index = cells.index[face, v, u, 0]
    power = small.reshape(-1, 3) * np.repeat(solid, 2 * fine)[:, None]
    energy = np.stack([np.bincount(index, power[:, c], LATTICE) for c in range(3)], 1)
    picture = cv2.resize(small, (2 * ROWS, ROWS), interpolation=cv2.INTER_AREA)
    return {"energy": energy.astype(np.float32), "panorama": picture.astype(np.float32)}


def read_panorama(path: Path) -> Float[np.ndarray, "h w 3"]:
    """Linear Rec.709 radiance of an EXR, Radiance, PNG or JPEG panorama.

    Raises:
        LightError: no panorama (twice as wide as high), or unreadable.
        RawError: an EXR or Radiance file that cannot be read.
    """
    if path.suffix.lower() in (".exr", ".hdr", ".pic"):
        radiance = read_radiance(path)
    else:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
        if image is None or image.dtype not in (np.uint8, np.uint16):
            raise LightError(f"{path}: cannot be read as a picture; choose an EXR, HDR, PNG or JPEG file")
        code = image.astype(np.float32) / np.iinfo(str(image.dtype)).max
        code = code[..., :3][..., ::-1] if code.ndim == 3 else np.repeat(code[..., None], 3, 2)
        radiance = srgb_decode(code).astype(np.float32)
    height, width = radiance.shape[:2]
    if abs(width / height - 2) > 0.1:
        raise LightError(
            f"{path}: is {width} x {height}; an equirectangular panorama is twice as wide as high: choose another file"
        )
    if not np.isfinite(radiance).all() or (radiance < 0).any():
        radiance = np.clip(np.nan_to_num(radiance, nan=0.0, posinf=65504.0, neginf=0.0), 0, None)
    if not radiance.any():
        raise LightError(f"{path}: is black; choose another file")
    return radiance


def _no_lamps() -> dict[str, np.ndarray]:
    return {
        "lamp_centre": np.zeros((0, 3)), "lamp_radius": np.zeros(0), "lamp_radiance": np.zeros((0, 3)),
        "lamp_group": np.zeros(0, int), "lamp_clipped": np.zeros(0, bool),
    }  # fmt: skip
