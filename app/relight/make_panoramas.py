"""Work out the lights that ship, from plain shapes and nothing else: `python -m app.relight.make_panoramas` writes them anew.

Frames as in `engine.types.Panorama`; radiance, linear Rec.709, a white wall is about 1.
"""

from collections.abc import Callable

import numpy as np
import OpenEXR
from jaxtyping import Float

from app.relight.panoramas import FOLDER, file
from engine.light.incident.probes import panorama_directions

ROWS = 128
FINE = 3  # a pixel is the mean over its area

Directions = Float[np.ndarray, "h w 3"]
Radiance = Float[np.ndarray, "h w 3"]


def _towards(yaw_deg: float, up_deg: float) -> np.ndarray:
    """Camera frame (x right, y down, z away); yaw 0 is behind the camera, positive to the right."""
    yaw, up = np.radians([yaw_deg, up_deg])
    return np.array([np.sin(yaw) * np.cos(up), -np.sin(up), -np.cos(yaw) * np.cos(up)])


def _glow(
    ways: Directions, yaw_deg: float, up_deg: float, width_deg: float, colour: tuple[float, float, float]
) -> Radiance:
    """A round light with a soft rim."""
    off = np.degrees(np.arccos(np.clip(ways @ _towards(yaw_deg, up_deg), -1, 1)))
    return np.clip((width_deg - off) / (0.25 * width_deg) + 0.5, 0, 1)[..., None] * np.array(colour)


def _box(
    ways: Directions,
    yaw_deg: float,
    up_deg: float,
    size: tuple[float, float],
    colour: tuple[float, float, float],
) -> Radiance:
    """An upright rectangle of so many degrees across and up."""
    ahead = _towards(yaw_deg, up_deg)
    right = np.cross(np.array([0.0, -1.0, 0.0]), ahead)
    right /= np.linalg.norm(right)
    depth = ways @ ahead
    with np.errstate(divide="ignore", invalid="ignore"):
        across, up = (np.abs(ways @ axis) / depth for axis in (right, np.cross(ahead, right)))
    half = np.tan(np.radians(size) / 2)
    inside = np.clip((half[0] - across) / 0.04 + 0.5, 0, 1) * np.clip((half[1] - up) / 0.04 + 0.5, 0, 1)
    return np.where((depth > 0)[..., None], inside[..., None] * np.array(colour), 0.0)


def _sky(
    ways: Directions,
    zenith: tuple[float, float, float],
    horizon: tuple[float, float, float],
    ground: tuple[float, float, float],
) -> Radiance:
    height = -ways[..., 1:2]
    sky = np.array(horizon) + np.clip(height, 0, 1) ** 0.6 * (np.array(zenith) - horizon)
    share = np.clip(height / 0.06 + 0.5, 0, 1)
    return share * sky + (1 - share) * np.array(ground)


def _softboxes(ways: Directions) -> Radiance:
    return (
        0.06
        + _box(ways, 55, 25, (50, 70), (9.0, 8.8, 8.5))
        + _box(ways, -70, 10, (40, 80), (2.4, 2.6, 2.9))
        + _box(ways, 165, 35, (60, 30), (3.0, 3.0, 3.0))
    )


def _overcast(ways: Directions) -> Radiance:
    return _sky(ways, (1.5, 1.55, 1.6), (0.7, 0.74, 0.8), (0.18, 0.17, 0.15))


def _sunset(ways: Directions) -> Radiance:
    sun = _glow(ways, -65, 9, 2.5, (900.0, 520.0, 220.0)) + _glow(ways, -65, 9, 25, (1.5, 0.8, 0.35))
    return _sky(ways, (0.18, 0.26, 0.5), (0.75, 0.5, 0.38), (0.07, 0.06, 0.05)) + sun


def _window(ways: Directions) -> Radiance:
    walls = np.broadcast_to(np.array([0.09, 0.085, 0.08]), ways.shape)
    return walls + _box(ways, 75, 18, (44, 62), (7.5, 8.2, 9.0))


def _ring(ways: Directions) -> Radiance:
    colours = [
        (60.0, 14.0, 10.0),
        (60.0, 46.0, 12.0),
        (14.0, 56.0, 20.0),
        (12.0, 40.0, 60.0),
        (44.0, 16.0, 60.0),
    ]
    lamps = [_glow(ways, -80 + 40 * k, 28, 7, colour) for k, colour in enumerate(colours)]
    return 0.05 + np.sum(lamps, 0)


MAKE: dict[str, Callable[[Directions], Radiance]] = {
    "softboxes": _softboxes, "overcast": _overcast, "sunset": _sunset, "window": _window, "ring": _ring,
}  # fmt: skip


def main() -> None:
    ways = panorama_directions(ROWS * FINE)
    FOLDER.mkdir(exist_ok=True)
    for name, make in MAKE.items():
        radiance = make(ways).reshape(ROWS, FINE, 2 * ROWS, FINE, 3).mean((1, 3)).astype(np.float16)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "license": "CC0-1.0"}
        with OpenEXR.File(header, {"RGB": np.ascontiguousarray(radiance)}) as written:
            written.write(str(file(name)))


if __name__ == "__main__":
    main()
