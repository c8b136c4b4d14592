"""Gaussians and views for tests of the light; world frame."""

import numpy as np
import torch

from engine.geometry import fibonacci_sphere
from engine.light.gaussians import raytrace_reference
from engine.light.gaussians.gaussians import Y00, radiance_towards
from engine.light.gaussians.rasterize import Pinhole
from engine.types import Gaussians


def scattered(count: int, seed: int = 0) -> Gaussians:
    """Needles and blobs of all sizes, 1 to 4 in front of the origin along z."""
    rng = np.random.default_rng(seed)
    return Gaussians(
        means=rng.uniform([-1.5, -1.2, 1.0], [1.5, 1.2, 4.0], (count, 3)),
        quaternions=rng.normal(size=(count, 4)),
        scales=rng.uniform(0.05, 0.4, (count, 3)),
        density=rng.uniform(0.2, 3.0, count),
        radiance=rng.uniform(0.1, 2.0, (count, 1, 3)) / Y00,
    )


def shell(radiance: float, radius: float = 3.0, count: int = 1500) -> Gaussians:
    """An opaque sphere of one radiance around the origin."""
    return Gaussians(
        means=fibonacci_sphere(count) * radius,
        quaternions=np.tile([1.0, 0, 0, 0], (count, 1)),
        scales=np.full((count, 3), 0.12 * radius),
        density=np.full(count, 3.0),
        radiance=np.full((count, 1, 3), radiance / Y00),
    )


def view(width: int, height: int, seed: int = 0) -> Pinhole:
    """A camera near the origin that looks along z, a little turned."""
    rng = np.random.default_rng(seed)
    turn = raytrace_reference.rotation_of(
        torch.tensor([[1.0, *rng.normal(size=3) * 0.05]], dtype=torch.float64)
    )[0]
    pose = np.column_stack([turn.numpy(), rng.normal(size=3) * 0.1])
    return Pinhole(
        pose, np.array([0.8 * width, 0.8 * width, width / 2 + 0.3, height / 2 - 0.2]), width, height
    )


def rays(view: Pinhole) -> tuple[torch.Tensor, torch.Tensor]:
    """Origins and world directions of all pixels; a direction reaches z = 1 in the camera's frame."""
    x = (np.arange(view.width) + 0.5 - view.lens[2]) / view.lens[0]
    y = (np.arange(view.height) + 0.5 - view.lens[3]) / view.lens[1]
    x, y = np.meshgrid(x, y)
    directions = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3) @ view.cam_from_world[:, :3]
    return torch.tensor(np.tile(view.origin, (len(directions), 1))), torch.tensor(directions)


def traced(gaussians: Gaussians, view: Pinhole, near: float = 0.0) -> np.ndarray:
    """The reference's rendering [h w 5], float64."""
    fields = (gaussians.means, gaussians.quaternions, gaussians.scales, gaussians.density)
    colours = radiance_towards(gaussians, view.origin)
    tensors = [torch.tensor(np.asarray(field, np.float64)) for field in (*fields, colours)]
    radiance, left, far = raytrace_reference.trace(*tensors, *rays(view), near)
    image = torch.cat([radiance, left[:, None], far[:, None]], 1)
    return image.reshape(view.height, view.width, 5).numpy()
