"""What one view shows and the others do not is doubted; what all show, or only one can, is not."""

from dataclasses import replace

import numpy as np
import pytest

from engine.light.doubt import believed
from engine.light.gaussians import radiance_towards
from engine.light.photographs import Photographs
from engine.light.rasterise import render, shapes, workers
from engine.types import Gaussians
from tests.engine.light import clouds
from tests.engine.light.painted import CAMERA, VIEWS, poses

KNEE = 0.3
PERSON = (slice(14, 34), slice(20, 40))
VIEW = 7


@pytest.fixture(scope="module")
def room() -> tuple[Gaussians, Photographs]:
    """A shell of even radiance, photographed as it renders."""
    wall, where = clouds.shell(1.0), poses()
    lens = np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy])
    weight = np.ones((VIEWS, CAMERA.height, CAMERA.width), np.float32)
    blank = Photographs(where, lens, np.zeros((*weight.shape, 3), np.float32), weight, weight > 2)
    with workers() as run:
        pictures = [
            render(shapes(wall), radiance_towards(wall, p.origin), p, 0.0, run)[..., :3]
            for p in map(blank.pinhole, range(VIEWS))
        ]
    return wall, replace(blank, radiance=np.stack(pictures))


def doubted(wall: Gaussians, photographs: Photographs) -> np.ndarray:
    with workers() as run:
        colours = radiance_towards(wall, np.zeros(3)).astype(np.float64)
        return believed(photographs, shapes(wall), colours, KNEE, run).weight


def with_person(photographs: Photographs, clipped: bool = False) -> Photographs:
    radiance, cut = photographs.radiance.copy(), photographs.clipped.copy()
    radiance[(VIEW, *PERSON)] *= 0.2
    cut[(VIEW, *PERSON)] = clipped
    return replace(photographs, radiance=radiance, clipped=cut)


def test_a_clean_room_keeps_its_weights_bit_for_bit(room):
    wall, photographs = room
    assert doubted(wall, photographs).tobytes() == photographs.weight.tobytes()


def test_somebody_in_one_view_loses_weight_there_and_nowhere_else(room):
    wall, photographs = room
    weight = doubted(wall, with_person(photographs))
    assert weight[VIEW, 18:30, 24:36].max() < 0.1
    assert (np.delete(weight, VIEW, 0) == 1).all()
    away = np.ones((CAMERA.height, CAMERA.width), bool)
    away[8:40, 14:46] = False
    assert (weight[VIEW][away] == 1).all()


def test_lower_bounds_are_not_doubted(room):
    wall, photographs = room
    assert (doubted(wall, with_person(photographs, clipped=True))[(VIEW, *PERSON)] == 1).all()


def test_what_is_wrong_in_all_views_alike_is_not_doubted(room):
    wall, photographs = room
    assert (doubted(wall, replace(photographs, radiance=0.3 * photographs.radiance)) == 1).all()


def test_a_place_that_only_one_view_shows_is_not_doubted(room):
    wall, photographs = room
    alone = with_person(photographs)
    one = Photographs(
        alone.cam_from_world[[VIEW]],
        alone.lens,
        alone.radiance[[VIEW]],
        alone.weight[[VIEW]],
        alone.clipped[[VIEW]],
    )
    assert (doubted(wall, one) == 1).all()
