"""A room that is itself made of Gaussians: an opaque painted sphere with a lamp, and views from its middle."""

from dataclasses import replace

import numpy as np

from engine.light.fitting.training_views import Photographs
from engine.light.gaussians.gaussians import Y00
from engine.light.gaussians.rasterize import Pinhole, render_view
from engine.types import Camera, Frames, Gaussians, Masks, Poses
from tests.engine.box_room import look
from tests.engine.light import clouds

CAMERA = Camera(48, 36, 34.0, 34.0, 24.0, 18.0)
VIEWS, LAMPS = 16, 6


def truth() -> Gaussians:
    """Walls around 1, the LAMPS Gaussians nearest to one direction at 30."""
    sphere = clouds.shell(1.0, count=500)
    phases = np.array([0.0, 1.0, 2.0])
    paint = np.exp(0.6 * np.sin(1.3 * sphere.means[:, :1] + phases) * np.cos(1.7 * sphere.means[:, 1:2]))
    paint[np.argsort(-sphere.means @ [0.2, 0.1, 1.0])[:LAMPS]] = 30.0
    return replace(sphere, scales=1.4 * sphere.scales, radiance=paint[:, None] / Y00)


def lens() -> np.ndarray:
    return np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])


def poses() -> np.ndarray:
    rng = np.random.default_rng(0)
    return np.stack(
        [
            look(2 * np.pi * i / VIEWS, 0.3 * np.sin(2.4 * i), 0.0, rng.normal(size=3) * 0.2)
            for i in range(VIEWS)
        ]
    )


def photographs() -> Photographs:
    """All views, their left quarter hidden by the object."""
    views = poses()
    radiance = np.stack(
        [render_view(truth(), Pinhole(view, lens(), CAMERA.width, CAMERA.height))[..., :3] for view in views]
    )
    weight = np.ones(radiance.shape[:3], np.float32)
    weight[:, :, :12] = 0
    return Photographs(views, lens(), radiance, weight, np.zeros(weight.shape, bool))


def room() -> tuple[Frames, Masks, Poses]:
    """The same as a session holds it, with SfM points on the wall."""
    seen = photographs()
    background = seen.weight > 0
    seen.radiance[~background] = 400.0  # the object: nothing that supervises
    names = tuple(f"view{i}" for i in range(VIEWS))
    frames = Frames(names, seen.radiance, seen.clipped, seen.clipped, (1e-4, 1e-3))
    points = truth().means[::2]
    placed = Poses(CAMERA, seen.cam_from_world, np.ones(VIEWS, bool), points, "given", np.nan)
    return frames, Masks(~background[0], background), placed
