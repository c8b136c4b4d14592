"""Heights that photographs pull at through shadows: the slope by central differences, and a valley found as deep as it is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import angle_between
from engine.progress import Progress
from engine.surface.depth.graph_laplacian import solver_of
from engine.surface.depth.horizon_relaxation import seams
from engine.surface.depth.shape_from_shadow import _Cost, deepened
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import depth_of, image, sight_of, subject
from engine.surface.rendering.soft_shadow_transport import Soft
from engine.surface.rendering.transport import blocks, predict
from engine.surface.solve import until_still
from engine.surface.tiled_solve import Picture
from engine.surface.visibility.depth_mesh import thick
from engine.surface.visibility.horizon_map import Ground
from engine.types import Camera, Frames
from tests.engine.surface.rendering.test_object_pixels import light_of_lamps

CAMERA = Camera(60, 48, 400.0, 400.0, 30.0, 24.0)
MASK = np.zeros((48, 60), bool)
MASK[4:44, 4:56] = True
VIEWS, DISTANCE = 12, 0.5
PARAMS = SurfaceParams(directions=400, walls=False)
V, U = np.indices(MASK.shape)


def ridges(height: float) -> np.ndarray:
    """Depth of a plate with two ridges, steep on the inside."""
    far = np.minimum(np.abs(U - 18), np.abs(U - 42))
    return np.where(MASK, DISTANCE - height * np.exp(-((far / 5.0) ** 2)), 0)


def normals_of(depth: np.ndarray) -> np.ndarray:
    """By central differences of its points."""
    x, y = (U + 0.5 - CAMERA.cx) / CAMERA.fx, (V + 0.5 - CAMERA.cy) / CAMERA.fy
    points = np.stack([x, y, np.ones_like(x)], -1) * np.where(MASK, depth, DISTANCE)[..., None]
    across = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return (across * -np.sign(across[..., 2:]))[MASK]


class Scene:
    """Two ridges as photographed, with what rays cast at their own depth hide; and the state of who knows all but that."""

    def __init__(self, height: float) -> None:
        self.depth, self.light = ridges(height), light_of_lamps(np.random.default_rng(2), VIEWS, 400)
        count = int(MASK.sum())
        self.state = gauss_newton.begin(normals_of(self.depth), np.full((count, 3), 0.5), np.full(count, 0.6))
        nothing = np.zeros((VIEWS, *MASK.shape), bool)
        picture = np.full((*nothing.shape, 3), 0.1, np.float32)
        names = tuple(f"{n}" for n in range(VIEWS))
        dark = Frames(names, picture, nothing, nothing, (1e-6, 1e-6))
        who = subject(dark, MASK, CAMERA, np.arange(VIEWS), PARAMS)
        sight = sight_of(who, self.state, self.depth, self.light.directions, PARAMS, Progress())
        unlit = replace(PARAMS, bounce=False)
        for pixels, answer in predict(
            who.responses(self.light, unlit, "cpu"), sight, blocks(MASK), self.state.normals, self.state.albedo,
            self.state.roughness,
        ):  # fmt: skip
            rows = np.argwhere(MASK)[pixels]
            picture[:, rows[:, 0], rows[:, 1]] = answer.transpose(1, 0, 2)
        self.frames = replace(dark, radiance=picture)
        self.who = subject(self.frames, MASK, CAMERA, np.arange(VIEWS), PARAMS)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(0.012)


def test_ridges_are_found_as_high_as_they_stand(scene: Scene) -> None:
    """From half their height. What normals integrate to is right here; what they leave open, a ridge as a whole, is not moved."""
    half = ridges(0.006)
    fitted = np.arange(VIEWS)
    unlit = replace(PARAMS, bounce=False)
    found = deepened(
        Picture(scene.frames, MASK, CAMERA), fitted, np.zeros(VIEWS), None, scene.state, half, scene.light, DISTANCE,
        unlit, Progress(),
    )  # fmt: skip

    def off(depth: np.ndarray) -> float:
        apart = np.log(depth[MASK] / scene.depth[MASK])
        return float(apart.std())

    assert off(found) < 0.35 * off(half)
    assert found[MASK].mean() == pytest.approx(DISTANCE)
    assert not found[~MASK].any()


@pytest.mark.parametrize("bounce", [False, True])
def test_the_slope_is_that_of_the_cost(scene: Scene, bounce: bool) -> None:
    """By central differences; of bounced light only where it comes from the same pixels."""
    who, params = scene.who, replace(PARAMS, bounce=bounce)
    v, u = np.nonzero(MASK)
    height = np.log(ridges(0.009)[MASK])
    sight = who.at(np.exp(height))
    deep = thick(image(MASK, sight.points), MASK)
    soft = Soft(
        who.responses(scene.light, params, "cpu"), Ground(CAMERA, MASK), height, deep, scene.state.normals
    )
    state = gauss_newton.respread(scene.state, soft, sight, blocks(MASK), who.seen)
    cost = _Cost(who, state, soft, sight, height - 1e-3, seams(MASK, np.zeros(MASK.shape)))
    here = cost.at(height)
    _, solve = solver_of(cost.stiffness(here.hold), len(height))
    uphill = solve(here.slope)
    wave = np.sin(u / 9) * np.cos(v / 13)
    for along in (uphill, uphill * (1 + wave), uphill * (1 - wave)):
        step = 1e-4 * along / np.abs(along).max()
        rise = cost.at(height + step).total - cost.at(height - step).total
        assert here.slope @ (2 * step) == pytest.approx(rise, rel=0.1 if bounce else 0.03)


def test_heights_that_are_right_stay(scene: Scene) -> None:
    unlit = replace(PARAMS, bounce=False)
    found = deepened(
        Picture(scene.frames, MASK, CAMERA), np.arange(VIEWS), np.zeros(VIEWS), None, scene.state, scene.depth,
        scene.light, DISTANCE, unlit, Progress(),
    )  # fmt: skip
    apart = np.log(found[MASK] / scene.depth[MASK]) / scene.who.pitch
    assert apart.std() < 0.5


def test_the_last_word_on_the_depth_stands_and_pixels_are_solved_under_it(scene: Scene) -> None:
    params = replace(PARAMS, bounce=False, rounds=1, passes=2, ask=False, gloss=False, accord=False)
    half = ridges(0.006)
    sight = sight_of(scene.who, scene.state, half, scene.light.directions, params, Progress())
    asked = []

    def deeper(state: gauss_newton.State, depth: np.ndarray, progress: Progress) -> np.ndarray:
        asked.append(depth)
        return scene.depth

    def solved(last: Callable[..., np.ndarray] | None) -> tuple[gauss_newton.State, np.ndarray]:
        return until_still(
            scene.who, scene.state, half, sight, scene.light, DISTANCE, params, "cpu", Progress(), last
        )[:2]

    state, depth = solved(deeper)
    np.testing.assert_array_equal(depth, scene.depth)
    assert len(asked) == 1
    other, _ = solved(None)
    true = scene.state.normals

    def off(found: gauss_newton.State) -> float:
        return float(angle_between(found.normals, true).mean())

    assert off(state) < 0.7 * off(other)
    # The lift is what sets it apart from the normals' own depth.
    own = depth_of(scene.who, replace(state, lift=np.zeros(len(state.lift))), DISTANCE, Progress())
    np.testing.assert_allclose(own[MASK] * np.exp(-state.lift), scene.depth[MASK], rtol=1e-6)
