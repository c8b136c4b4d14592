"""How far parts stand behind one another: a plate before a dome that its own model photographed, and made-up likelihoods."""

from dataclasses import replace

import numpy as np
import pytest

from engine.progress import Progress
from engine.surface.depth.normal_integration import IntegratedDepth
from engine.surface.depth.part_offsets import CONFIG, DepthParts, likelihood_of, place
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import geometry_with_visibility, observe_object
from engine.surface.rendering.transport import LightTransport, pixel_blocks, predict
from engine.types import Frames
from tests.engine.surface import landscapes
from tests.engine.surface.rendering.test_object_pixels import light_of_lamps

CAMERA = landscapes.camera_of(96, 72)
MASK, NORMALS, Z = landscapes.plate(CAMERA, 0.9)
PLATE = landscapes.on_plate(CAMERA)[MASK]
NEARER = 16 / CAMERA.fx
"""By how much the plate stands before its place in the landscape, log z."""
VIEWS = 16
PARAMS = SurfaceParams(directions=400, without=("interreflections",))
HALVES = np.repeat([[0, 1]], 6, axis=1)
TWO = DepthParts(
    IntegratedDepth(np.ones((1, 12)), (HALVES + 1).astype(np.int16)),
    HALVES,
    np.zeros(2),
    np.full(2, 0.64),
    100.0,
)


def gap(depth: np.ndarray) -> float:
    """From the plate to the dome, in pixel widths."""
    log = np.log(depth[MASK] / Z[MASK])
    return CAMERA.fx * float(np.median(log[~PLATE]) - np.median(log[PLATE]))


def test_parts_go_where_what_they_hide_says():
    z = np.where(landscapes.on_plate(CAMERA), Z * np.exp(-NEARER), Z) * MASK
    light = light_of_lamps(np.random.default_rng(1), VIEWS, PARAMS.directions)
    count = int(MASK.sum())
    state = gauss_newton.initial_estimate(NORMALS[MASK], np.full((count, 3), 0.5), np.full(count, 0.5))
    blank = np.zeros((VIEWS, *MASK.shape), bool)
    radiance = np.zeros((*blank.shape, 3), np.float32)
    frames = Frames(tuple(map(str, range(VIEWS))), radiance, blank, blank, (1e-6, 1e-6))
    seen = observe_object(frames, MASK, CAMERA, np.arange(VIEWS), PARAMS)
    geometry = geometry_with_visibility(seen, state, z, light.directions, PARAMS, Progress())
    transport = LightTransport(light, np.zeros((count, 3 * VIEWS), np.float32), True, False, "cpu")
    blocks = pixel_blocks(MASK)
    for pixels, answer in predict(transport, geometry, blocks, state.normals, state.albedo, state.roughness):
        v, u = np.argwhere(MASK)[pixels].T
        radiance[:, v, u] = answer.transpose(1, 0, 2)
    seen = observe_object(frames, MASK, CAMERA, np.arange(VIEWS), PARAMS)
    state = gauss_newton.update_residual_scale(state, seen.problem(light, geometry, PARAMS, "cpu"))
    together = DepthParts.of(CAMERA, MASK, state.normals, float(z[MASK].mean()), None, Progress())
    assert len(together.offset) == 2
    assert gap(z) - gap(together.placed) > 16
    likelihood = likelihood_of(seen, state, light, PARAMS)
    placed = place(together, likelihood, 0, Progress())
    assert gap(placed.placed) == pytest.approx(gap(z), abs=4)
    assert placed.placed[MASK].mean() == pytest.approx(z[MASK].mean())
    assert max(together.stderr_px) == pytest.approx(64)
    assert max(placed.stderr_px) <= 12.5
    # They stay there, also when nothing is known of how well they stand, and begin there when the normals are integrated again.
    np.testing.assert_array_equal(place(placed, likelihood, 0, Progress()).offset, placed.offset)
    again = DepthParts.of(CAMERA, MASK, state.normals, float(z[MASK].mean()), placed.told, Progress())
    np.testing.assert_allclose(again.placed, placed.placed)


def test_where_one_part_turns_out_to_be_two_nobody_knows_yet_how_far_they_stand_apart():
    mask, normals, z = landscapes.blob(CAMERA)
    one = DepthParts.of(CAMERA, mask, normals[mask], float(z[mask].mean()), None, Progress())
    assert len(one.offset) == 1
    two = DepthParts.of(CAMERA, MASK, NORMALS[MASK], float(Z[MASK].mean()), one.told, Progress())
    assert two.stderr_px == pytest.approx((64, 64))


def liking(best: float, noise: float):
    """Pixels that like a gap of so many pixel widths between the halves of `TWO`, each in its own way."""
    own = noise * np.random.default_rng(0).normal(size=12)

    def likelihood(depth: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        away = np.log(depth[0, -1] / depth[0, 0]) * 100 - best
        return -((away / 40) ** 2) + own[pixels] * away

    return likelihood


@pytest.mark.parametrize(("best", "found"), [(0, 0), (5, 4), (-17, -16), (31, 32)])
def test_the_likeliest_place_is_taken(best: float, found: float):
    placed = place(TWO, liking(best, 0.0), 0, Progress())
    assert 100 * (placed.offset[1] - placed.offset[0]) == pytest.approx(found)
    assert all(2 <= error <= 16 for error in placed.stderr_px)


def test_a_part_of_which_the_photographs_say_nothing_plainly_stays():
    placed = place(TWO, liking(8, 0.2), 0, Progress())
    np.testing.assert_array_equal(placed.offset, TWO.offset)
    assert placed.stderr_px == pytest.approx((64, 64))  # not determined
    one = replace(TWO, part=np.zeros_like(TWO.part), offset=np.zeros(1))
    assert place(one, liking(8, 0.0), 0, Progress()) is one
    assert CONFIG.sigmas >= 2
