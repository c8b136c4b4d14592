"""Lamps are found where rays of bright discs meet, also when few views see them whole."""

import numpy as np

from engine.light.fitting.lamp_detection import find_lamps
from engine.light.fitting.training_views import Photographs

LAMPS = np.array([[1.0, 0.1, 1.2], [-0.6, -0.3, 1.6], [0.1, 0.6, 1.4]])
RADIUS = 0.07
WIDTH, HEIGHT, FOCAL = 160, 120, 130.0


def views(count: int, seed: int, lamps: np.ndarray = LAMPS, radius: float = RADIUS) -> Photographs:
    """Cameras that look about a dim room with globes; a corner is masked out."""
    rng = np.random.default_rng(seed)
    poses, pictures = [], []
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    for _ in range(count):
        eye = rng.uniform(-0.3, 0.3, 3)
        forward = rng.normal(size=3) * [0.5, 0.3, 0] + [0, 0, 1]
        forward /= np.linalg.norm(forward)
        right = np.cross([0, 1.0, 0], forward)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        pose = np.column_stack([rotation, -rotation @ eye])
        picture = np.full((HEIGHT, WIDTH, 3), 0.2, np.float32) * rng.uniform(0.5, 1.5, (HEIGHT, WIDTH, 1))
        for lamp in lamps:
            cam = pose[:, :3] @ lamp + pose[:, 3]
            if cam[2] > 0:
                disc = np.hypot(
                    u - FOCAL * cam[0] / cam[2] - WIDTH / 2, v - FOCAL * cam[1] / cam[2] - HEIGHT / 2
                )
                picture[disc < FOCAL * radius / cam[2]] = 20.0
        poses.append(pose), pictures.append(picture.astype(np.float32))
    weight = np.ones((count, HEIGHT, WIDTH), np.float32)
    weight[:, 90:, :50] = 0
    radiance = np.stack(pictures)
    lens = np.array([FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2])
    return Photographs(np.stack(poses), lens, radiance, weight, radiance[..., 0] > 10)


def test_every_lamp_is_found_within_a_tenth_of_its_size():
    found = find_lamps(views(16, 0))
    gap = np.linalg.norm(found.centres[:, None] - LAMPS, axis=2)
    assert len(found.centres) == 3
    assert sorted(gap.argmin(1)) == [0, 1, 2]
    assert gap.min(1).max() < 0.3 * RADIUS
    np.testing.assert_allclose(found.radii, RADIUS, rtol=0.1)


def test_a_lamp_too_far_for_parallax_is_a_lamp():
    """As the sun is, or a street lamp through the window: its direction and how large it looks are known."""
    far = np.array([20.0, 10.0, 150.0])
    found = find_lamps(views(16, 0, far[None], 6.0))
    assert len(found.centres) == 1
    away = np.linalg.norm(found.centres[0])
    assert away > 30
    assert found.centres[0] / away @ far / np.linalg.norm(far) > np.cos(np.radians(0.5))
    np.testing.assert_allclose(found.radii[0] / away, 6 / np.linalg.norm(far), rtol=0.1)


def test_a_spot_of_one_view_alone_is_no_lamp():
    photographs = views(6, 1)
    alone = photographs.radiance.copy()
    alone[1:][alone[1:] > 10] = 0.2
    clipped = photographs.clipped.copy()
    clipped[1:] = False
    lonely = Photographs(photographs.cam_from_world, photographs.lens, alone, photographs.weight, clipped)
    assert len(find_lamps(lonely).centres) == 0


def test_a_window_is_no_lamp():
    photographs = views(6, 2)
    radiance = np.full_like(photographs.radiance, 0.2)
    radiance[:, 30:80, 40:120] = 20.0
    bright = Photographs(
        photographs.cam_from_world, photographs.lens, radiance, photographs.weight, radiance[..., 0] > 10
    )
    assert len(find_lamps(bright).centres) == 0
