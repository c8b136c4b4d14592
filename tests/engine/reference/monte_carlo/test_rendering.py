"""Pictures by Eq. (8) in views that turn: shape stays with the camera, light with the room, shadows with the shape."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from engine.geometry import rays
from engine.light.gaussians.gaussians import Y00
from engine.light.gaussians.rasterize import thread_pool
from engine.reference.monte_carlo import queries, vmf_proposal
from engine.reference.monte_carlo.rendering import Look, Scene, render
from engine.reference.monte_carlo.shadows import shadows_of
from engine.types import Camera, Gaussians
from tests.engine.box_room import look
from tests.engine.light import clouds

CAMERA = Camera(24, 4, 40.0, 40.0, 12.0, 2.0)
GLOW = 0.8
HALF_TURNED = np.stack(
    [look(2 * np.pi * i / 7, 0.5 * np.sin(2.4 * i), 0.3 * i, np.zeros(3)) for i in range(7)]
)


def even_room() -> Gaussians:
    shell = clouds.shell(GLOW, 3.0, 300)
    return replace(shell, scales=1.6 * shell.scales, density=np.full(300, 20.0))


def step() -> tuple[np.ndarray, np.ndarray]:
    """Points of a wall whose left half stands 0.1 nearer, and the mask of all."""
    per_z = rays(CAMERA) / rays(CAMERA)[..., 2:]
    depth = np.where(np.arange(CAMERA.width) < 12, 0.5, 0.6) + np.zeros((CAMERA.height, 1))
    return per_z * depth[..., None], np.ones(depth.shape, bool)


def pictures(points: np.ndarray, room: Gaussians, emitter_sampling: bool = True) -> np.ndarray:
    """A white wall that faces the camera, [n h w]."""
    mask = np.ones(points.shape[:2], bool)
    count = mask.sum()

    def there(array) -> torch.Tensor:
        return torch.tensor(np.ascontiguousarray(array), dtype=torch.float32)

    normals = np.tile([0.0, 0, -1], (count, 1))
    scene = Scene(
        there(rays(CAMERA)[mask] / rays(CAMERA)[mask][:, 2:]), there(HALF_TURNED), vmf_proposal.fit(room, 0, 16),
        queries.plant(room), 0.5, 256, emitter_sampling, False,
    )  # fmt: skip
    shape = Look(there(normals), torch.ones((count, 3)), torch.ones(count), there(points[mask][:, 2] / 0.5))
    shadows = shadows_of(points, mask, mask, normals)
    draw = torch.Generator().manual_seed(0)
    with thread_pool(2) as run:
        found = render(scene, shape, shadows, slice(0, int(count)), np.arange(7), draw, run)
    return found[..., 1].numpy().reshape(7, *mask.shape)


@pytest.mark.parametrize("emitter_sampling", [True, False])
def test_in_an_even_room_no_turn_changes_the_picture_and_a_step_shades_its_far_side(
    emitter_sampling: bool,
) -> None:
    found = pictures(step()[0], even_room(), emitter_sampling).mean(1)  # [n w], over the rows
    np.testing.assert_allclose(found, np.broadcast_to(found.mean(0), found.shape), rtol=0.1)
    near, beside, far = found[:, 4:9].mean(), found[:, 13:15].mean(), found[:, 21:].mean()
    assert near == pytest.approx(GLOW * 1.03, rel=0.03)  # white, and a few hundredths of gloss
    assert beside < 0.88 * near
    assert beside < far <= 1.01 * near


def test_light_from_one_side_of_the_room_shades_by_the_cosine_in_every_view() -> None:
    room = even_room()
    lamp = np.array([0.0, -0.6, -0.8])  # world
    level = np.where(room.means @ lamp > 0.98 * 3.0, 50.0, 0.0)
    room = replace(room, radiance=np.repeat(level[:, None, None], 3, 2) / Y00)
    wall = step()[0] / step()[0][..., 2:] * 0.5
    found = pictures(wall, room).mean((1, 2))
    to_lamp = HALF_TURNED[:, :, :3] @ (3.0 * lamp) - [0, 0, 0.5]  # camera frame, from the wall's middle
    distance = np.linalg.norm(to_lamp, axis=1)
    expected = np.maximum(-to_lamp[:, 2], 0) / distance**3  # cosine over square of the distance
    lit = expected > 0.3 * expected.max()
    assert lit.sum() >= 3
    set_ = to_lamp[:, 2] > 0.4 * distance  # all of the lamp is below the horizon
    assert set_.any()
    np.testing.assert_allclose(found[lit] / expected[lit], (found[lit] / expected[lit]).mean(), rtol=0.15)
    assert found[set_].max() < 1e-3 * found.max()
