"""The pixel solver on pictures from its own model: it must undo what it can do.

Own pictures test the machinery only (search, steps, visibility, bounce); accuracy is claimed from path-traced
sets elsewhere.
"""

import numpy as np
import pytest

from engine.geometry import rays
from engine.progress import Progress
from engine.surface.pixels import SurfaceParams, solve_pixels
from engine.surface.transport import (
    Incident,
    Lattice,
    Responses,
    Sight,
    blocks,
    direction_cells,
    lattice_around,
    predict,
)
from engine.surface.visibility import occlusion
from engine.types import Camera, Frames

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)


def light_of_lamps(rng: np.random.Generator, views: int, d: int) -> Incident:
    """Every view sees a dim room and three soft lamps somewhere else."""
    directions = direction_cells(d)
    energy = np.full((1, d, views, 3), 0.2)
    for n in range(views):
        for _ in range(3):
            lamp = rng.normal(size=3)
            lamp /= np.linalg.norm(lamp)
            energy[0, :, n] += np.exp(20 * (directions @ lamp - 1))[:, None] * rng.uniform(2, 6, 3)
    lattice = Lattice(np.array([0, 0, 1.0]), np.array([0, 0, 1.0]), (1, 1, 1))
    energy = (energy * 4 * np.pi / d).reshape(1, d, -1).astype(np.float32)
    return Incident(lattice, directions, energy)


def ball() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r, centre, radius = rays(CAMERA), np.array([0, 0, 0.6]), 0.17
    b = r @ centre
    disc = b * b - (centre @ centre - radius**2)
    mask = disc > 2e-3
    points = r * (b - np.sqrt(np.maximum(disc, 0)))[..., None]
    return mask, (points - centre) / radius, points


@pytest.mark.parametrize("device", ["cpu", "meta-cpu"])
def test_solver_undoes_its_own_pictures(device: str):
    # Any torch device but "cpu" takes the torch path; torch's own CPU device runs it without a GPU.
    device = "cpu:0" if device == "meta-cpu" else "cpu"
    rng = np.random.default_rng(0)
    mask, normals, points = ball()
    light = light_of_lamps(rng, 24, 400)
    count = int(mask.sum())
    albedo = np.tile([0.6, 0.4, 0.3], (count, 1))
    roughness = np.full(count, 0.45)
    sight = Sight(points[mask], -rays(CAMERA)[mask], None)
    responses = Responses(light, np.zeros((count, 72), np.float32), True, False, "cpu")
    flat = np.zeros((count, 24, 3), np.float32)
    for pixels, answer in predict(responses, sight, blocks(mask), normals[mask], albedo, roughness):
        flat[pixels] = answer
    radiance = np.zeros((24, 48, 64, 3), np.float32)
    radiance[:, mask] = flat.transpose(1, 0, 2)
    nothing = np.zeros(radiance.shape[:3], bool)
    frames = Frames(tuple("abcdefghijklmnopqrstuvwx"), radiance, nothing, nothing, (1e-6, 1e-6))
    params = SurfaceParams(directions=400, rounds=2, visibility=False, bounce=False, candidates=150)
    surface, _, _, _ = solve_pixels(
        frames, mask, CAMERA, light, np.arange(24), 0.5, params, device, Progress()
    )
    cosine = (surface.normal * normals).sum(-1)[mask]
    error = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert np.median(error) < 0.2
    assert np.median(np.abs(surface.albedo[mask] - albedo)) < 0.01
    assert np.median(np.abs(surface.roughness[mask] - 0.45)) < 0.02


def test_a_step_hides_the_sky_beside_it_and_names_what_hides_it():
    mask = np.ones((48, 64), bool)
    q = rays(CAMERA)
    q = q / q[..., 2:]
    z = np.where(np.arange(64) < 32, 0.5, 0.505)[None].repeat(48, 0)
    z[:, 32:] = 0.52
    # The riser itself is seen as one column of strongly tilted facets.
    points = q * z[..., None]
    normals = np.zeros((48, 64, 3))
    normals[..., 2] = -1
    directions = direction_cells(500)
    hidden = occlusion(points, normals, mask, directions, Progress(), 0.1)
    share = hidden.share.reshape(48, 64)
    assert share[24, 33] > 0.03
    assert share[24, 60] < 0.3 * share[24, 33]
    assert share[24, 5] < 1e-3
    start, direction, source = hidden.of(np.array([24 * 64 + 33]))
    assert start[-1] == len(direction)
    above = directions[direction][:, 2] < 0
    assert (directions[direction][above, 0] < 0).mean() > 0.9
    assert ((source[above] % 64) <= 33).all()
    # Just below the horizon of flat ground there is ground.
    _, direction, _ = hidden.of(np.array([24 * 64 + 16]))
    below = np.flatnonzero((directions[:, 2] > 0.2) & (directions[:, 2] < 0.5))
    assert np.isin(below, direction).all()
    assert not (directions[direction][:, 2] > 0.5).any()


def test_lattice_weights_sum_to_one_and_interpolate_log_depth_exactly():
    mask = np.zeros((48, 64), bool)
    mask[10:40, 20:50] = True
    lattice = lattice_around(CAMERA, mask, (0.4, 0.6), (3, 3, 2))
    points = lattice.points()
    for point in ([0.0, 0.0, 0.5], [0.02, -0.03, 0.45]):
        weights = lattice.weights(np.array(point))
        assert weights.sum() == pytest.approx(1)
        assert weights @ np.log(points[:, 2]) == pytest.approx(np.log(point[2]))


def test_blocks_cover_every_pixel_once():
    mask, _, _ = ball()
    together = np.concatenate(blocks(mask))
    np.testing.assert_array_equal(np.sort(together), np.arange(mask.sum()))
