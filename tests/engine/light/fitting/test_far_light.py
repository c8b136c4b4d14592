"""Light that comes through an opening is told from light of the same place by how views agree; walls are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from engine.light.fitting.far_light import FarLightConfig, openings
from engine.light.fitting.free_space import FreeSpace, unsupported
from engine.light.fitting.initialize import _open
from engine.light.fitting.training_views import Photographs, camera_centres

KNEE = 0.05
WALL_M, HALF_M = 2.5, 0.7


def sky(direction: Float[np.ndarray, "*k 3"]) -> Float[np.ndarray, "*k"]:
    """Bright above the horizon, with clouds."""
    x, y, _ = np.moveaxis(direction, -1, 0)
    return np.where(y < 0.05, 20 * np.exp(0.8 * np.sin(9 * x + 4 * y) - 2 * y), 4.0)


def painted(place: Float[np.ndarray, "*k 3"]) -> Float[np.ndarray, "*k"]:
    """The same on a screen that hangs in the wall."""
    return sky(place / WALL_M)


def looked(shows: str) -> tuple[Photographs, Float[np.ndarray, "n h w"], np.ndarray]:
    """Views of a dark wall with a bright square in it, their depth, and where the square is."""
    rng = np.random.default_rng(0)
    views, height, width, focal = 14, 96, 128, 110.0
    centres = rng.uniform(-0.4, 0.4, (views, 3))
    poses = np.concatenate([np.broadcast_to(np.eye(3), (views, 3, 3)), -centres[..., None]], 2)
    v, u = np.mgrid[0:height, 0:width] + 0.5
    ray = np.stack([(u - width / 2) / focal, (v - height / 2) / focal, np.ones_like(u)], -1)
    depth = np.repeat((WALL_M - centres[:, 2])[:, None, None], height, 1).repeat(width, 2)
    place = centres[:, None, None] + ray * depth[..., None]
    inside = (np.abs(place[..., :2]) < HALF_M).all(-1)
    direction = np.broadcast_to(ray / np.linalg.norm(ray, axis=-1, keepdims=True), place.shape)
    light = sky(direction) if shows == "sky" else painted(place)
    wall = 0.1 + 0.05 * np.sin(12 * place[..., 0]) * np.sin(9 * place[..., 1])
    radiance = np.repeat(np.where(inside, light, wall)[..., None], 3, -1).astype(np.float32)
    radiance *= rng.normal(1, 0.01, radiance.shape).astype(np.float32)
    lens = np.array([focal, focal, width / 2, height / 2])
    weight = np.ones(depth.shape, np.float32)
    return Photographs(poses, lens, radiance, weight, np.zeros(depth.shape, bool)), depth, inside


def test_sky_through_a_window_is_far_and_the_wall_is_not() -> None:
    photographs, depth, inside = looked("sky")
    far = openings(photographs, depth, KNEE)
    found = np.isfinite(far)
    light = photographs.radiance.mean(-1)
    bright = inside & (light > FarLightConfig().bright * light.mean())
    assert found[bright].mean() > 0.99
    assert not found[~inside].any()
    config = FarLightConfig()
    distance = np.median(np.linalg.norm(np.array([0, 0, WALL_M]) - camera_centres(photographs), axis=1))
    assert np.nanmedian(far) == pytest.approx(config.distance * distance, rel=0.1)


def test_the_same_light_painted_on_a_screen_is_where_it_hangs() -> None:
    photographs, depth, _ = looked("screen")
    assert not np.isfinite(openings(photographs, depth, KNEE)).any()


def test_an_even_light_stays_where_it_was_swept() -> None:
    photographs, depth, inside = looked("sky")
    even = np.where(inside[..., None], np.float32(20), photographs.radiance)
    assert not np.isfinite(openings(replace(photographs, radiance=even), depth, KNEE)).any()


def test_one_view_alone_tells_nothing() -> None:
    photographs, depth, _ = looked("sky")
    one = Photographs(
        *(
            getattr(photographs, name)[:1] if name != "lens" else photographs.lens
            for name in Photographs.__slots__
        )
    )
    assert not np.isfinite(openings(one, depth[:1], KNEE)).any()


def test_nothing_stands_in_a_pane_and_the_wall_still_stands() -> None:
    photographs, depth, _ = looked("sky")
    centres = camera_centres(photographs)
    sure = np.ones(depth.shape)
    closed = FreeSpace(
        photographs.cam_from_world, photographs.lens, depth, sure, centres, np.zeros(len(centres)), 1
    )
    opened = _open(closed, photographs, openings(photographs, depth, KNEE))
    pane, wall = np.array([[0.0, -0.3, WALL_M]]), np.array([[1.0, -0.3, WALL_M]])
    assert not unsupported(closed, pane)[0]
    assert unsupported(opened, pane)[0]
    assert not unsupported(opened, wall)[0]
