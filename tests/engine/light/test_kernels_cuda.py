"""The CUDA kernels against the CPU's and the reference: on a device, else in numba's simulator (test_on_cuda.py)."""

import itertools
from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from engine.light import kernels_cuda as kernel
from engine.light import on_cuda
from engine.light.cells import FACES
from engine.light.gaussians import radiance_towards
from engine.light.on_cuda import OnCuda
from engine.light.rasterise import (
    Gradients,
    Pinhole,
    Run,
    Threads,
    project,
    push_back,
    render,
    shapes,
    workers,
)
from engine.types import Gaussians
from tests.engine.light import clouds
from tests.engine.light.test_kernels_cpu import HOLLOW, KNEE, compare, differences, off

pytestmark = pytest.mark.skipif(not on_cuda.available(), reason="no CUDA device")

NEAR = 0.5


@pytest.fixture
def cpu() -> Iterator[Threads]:
    with workers(1) as run:
        assert isinstance(run, Threads)
        yield run


@pytest.fixture
def cuda(cpu: Threads) -> OnCuda:
    return OnCuda(cpu)


def awkward(count: int, seed: int, denser: float = 1.0) -> Gaussians:
    """Scattered ones, the first behind the camera, the second across the near plane."""
    gaussians = clouds.scattered(count, seed)
    gaussians.means[:2] = [[0.1, 0, -1.5], [0.2, 0.1, NEAR]]
    gaussians.scales[:2] = 0.3
    return replace(gaussians, density=denser * gaussians.density)


def judged(gaussians: Gaussians, view: Pinhole, run: Run) -> tuple[np.ndarray, Gradients]:
    """The robust loss with every term in it: lower bounds, what is left over, and air that is looked through."""
    rng, size = np.random.default_rng(7), (view.height, view.width)
    return push_back(
        shapes(gaussians), radiance_towards(gaussians, view.origin), view, NEAR,
        rng.uniform(0, 2, (*size, 3)).astype(np.float32), rng.uniform(0, 1, size).astype(np.float32),
        rng.random(size) < 0.3, KNEE, HOLLOW, rng.choice([0, 2.5], size).astype(np.float32), run,
    )  # fmt: skip


@pytest.mark.parametrize(("seed", "denser"), [(0, 1.0), (1, 1.0), (2, 20.0)])
def test_renderings_and_gradients_are_those_of_the_cpu_and_the_reference(
    cpu: Threads, cuda: OnCuda, seed: int, denser: float
) -> None:
    gaussians, view = awkward(40, seed, denser), clouds.view(21, 13, seed)
    image, ours = judged(gaussians, view, cuda)
    theirs_image, theirs = judged(gaussians, view, cpu)
    traced = clouds.traced(gaussians, view, NEAR)
    assert (traced[..., 3].min() < 1e-5) == (denser > 1)  # rays that end before their last Gaussian
    plain = render(shapes(gaussians), radiance_towards(gaussians, view.origin), view, NEAR, cuda)
    for channel in range(5):
        assert off(image[..., channel], theirs_image[..., channel]) < 1e-4
        assert off(image[..., channel], traced[..., channel]) < 1e-4
        assert off(plain[..., channel], traced[..., channel]) < 1e-4
    for name in (field.name for field in fields(Gradients)):
        assert off(getattr(ours, name), getattr(theirs, name)) < 1e-3, name


def test_gradients_are_the_finite_differences_of_the_reference(cuda: OnCuda) -> None:
    gaussians, view = clouds.scattered(8, 3), clouds.view(18, 12)
    rng = np.random.default_rng(1)
    slope = rng.normal(size=(12, 18, 3)).astype(np.float32)
    weights = rng.uniform(0.5, 1, (12, 18)).astype(np.float32)
    a, b = torch.tensor(slope).double().reshape(-1, 3), torch.tensor(weights).double().ravel()
    _, found = push_back(
        shapes(gaussians), radiance_towards(gaussians, view.origin), view, 0.0, slope, weights,
        np.zeros((12, 18), bool), 0.0, HOLLOW, np.zeros_like(weights), cuda,
    )  # fmt: skip
    compare(
        found, differences(gaussians, view, lambda radiance, left: (a * radiance).sum() + (b * left).sum())
    )


def test_a_second_run_and_other_batches_give_the_same_bits(cpu: Threads, cuda: OnCuda) -> None:
    gaussians, view = awkward(20, 5), clouds.view(16, 12)
    answers = [
        judged(gaussians, view, run) for run in (cuda, cuda, OnCuda(cpu, rows=1), OnCuda(cpu, rows=30))
    ]
    for image, found in answers[1:]:
        assert image.tobytes() == answers[0][0].tobytes()
        for name in (field.name for field in fields(Gradients)):
            assert getattr(found, name).tobytes() == getattr(answers[0][1], name).tobytes(), name


def test_no_tile_writes_where_another_remembers() -> None:
    """Blocks run at the same time on a device, one after the other in the simulator."""
    gaussians, view = clouds.scattered(12, 5), clouds.view(16, 8)
    _, packed, (tile_start, members, _, _) = project(shapes(gaussians), np.ones((12, 3)), view)
    there = [kernel.cuda.to_device(array) for array in (packed, tile_start, members, view.lens)]
    columns = [kernel.cuda.to_device(np.zeros((len(members), 64), np.float32)) for _ in range(2)]
    order = kernel.cuda.to_device(np.full((len(members), 64), -1, np.int32))
    image = kernel.cuda.to_device(np.zeros((8, 16, 5), np.float32))
    kernel.forward[2, 64](*there, np.float32(0), 0, *columns, order, image)
    for begin, end in itertools.pairwise(tile_start):
        rows = order.copy_to_host()[begin:end]
        assert set(np.unique(rows)) - {-1} <= set(range(begin, end))
        assert (rows >= 0).any()


def test_tiles_and_views_without_gaussians_are_empty(cpu: Threads, cuda: OnCuda) -> None:
    view = clouds.view(24, 16)
    gaussians = clouds.scattered(2, 1)
    gaussians.means[:] = [[-0.6, -0.4, 2.0], [0.0, 0.0, -3.0]]
    gaussians.scales[:] = 0.05
    colours = radiance_towards(gaussians, view.origin)
    _, _, (tile_start, *_) = project(shapes(gaussians), colours, view)
    assert (np.diff(tile_start) == 0).any()
    assert (np.diff(tile_start) > 0).any()
    image = render(shapes(gaussians), colours, view, 0.0, cuda)
    np.testing.assert_array_equal(image[8:, 16:], np.broadcast_to([0, 0, 0, 1, 0], (8, 8, 5)))
    assert image[..., 3].min() < 1
    gaussians.means[0, 2] = -2
    image, found = judged(gaussians, view, cuda)
    np.testing.assert_array_equal(image, np.broadcast_to([0, 0, 0, 1, 0], (16, 24, 5)))
    assert len(found.index) == 0


def test_the_faces_of_a_probe_are_those_of_the_cpu(cpu: Threads, cuda: OnCuda) -> None:
    gaussians, origin = clouds.scattered(30, 6), np.array([0.1, -0.2, 2.5])
    geometry, colours = shapes(gaussians), radiance_towards(gaussians, origin)
    for face, side in [(0, 8), (1, 8), (2, 8), (3, 8), (4, 8), (5, 16)]:
        pose = np.concatenate([FACES[face], -(FACES[face] @ origin)[:, None]], axis=1)
        view = Pinhole(pose, np.full(4, side / 2), side, side)
        assert off(*(render(geometry, colours, view, 0.0, run) for run in (cuda, cpu))) < 1e-4


def test_chores_stay_on_the_cpu(cuda: OnCuda) -> None:
    done = []
    cuda(lambda mark, part, parts: done.append((mark, part, parts)), ("here",))
    assert sorted(done) == [("here", part, 8) for part in range(8)]


def test_a_device_is_taken_only_when_named() -> None:
    with workers(1) as plain, workers(1, "cuda") as named:
        assert isinstance(plain, Threads)
        assert isinstance(named, OnCuda)
