"""Pixels solved by torch, many blocks at a time, against the processor's kernels: torch's own CPU device runs it without a GPU."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from engine.errors import SurfaceError
from engine.geometry import angle_between, rays
from engine.progress import Progress
from engine.surface.data.observations import observe
from engine.surface.optimize import gauss_newton, gauss_newton_cuda
from engine.surface.optimize.gauss_newton import PixelProblem
from engine.surface.rendering.area_lights import AreaLights
from engine.surface.rendering.interreflection import radiance_of_hidden_patches
from engine.surface.rendering.transport import (
    IncidentLight,
    LightTransport,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
    pixel_blocks,
    predict,
    probe_grid_around,
)
from engine.surface.visibility.ray_visibility import trace_occlusion
from engine.types import Camera, Frames

CAMERA = Camera(48, 40, 45.0, 45.0, 24.0, 20.0)
VIEWS, CELLS = 20, 300  # more views than the kernels take the logarithm of at once
DEVICES = [
    "cpu:0",
    pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")),
]


def room(rng: np.random.Generator, mask: np.ndarray) -> IncidentLight:
    """Soft light from near by that differs from probe to probe, and two lamps; other places in every view."""
    lattice = probe_grid_around(CAMERA, mask, (0.4, 0.6), (3, 3, 2))
    directions, points = direction_cells(CELLS), lattice.points()
    energy = np.full((len(points), CELLS, VIEWS, 3), 0.2)
    for n in range(VIEWS):
        away = rng.normal(size=3) * [0.6, 0.6, 0.2] - [0, 0, 0.1] - points
        far = np.linalg.norm(away, axis=1, keepdims=True)
        energy[:, :, n] += (np.exp(9 * (away / far @ directions.T - 1)) / far**2)[..., None] * [3, 2, 1]
    energy = (energy * 4 * np.pi / CELLS).reshape(len(points), CELLS, -1).astype(np.float32)
    lamps = rng.normal(size=(VIEWS, 2, 3)) * [0.7, 0.7, 0.2] - [0, 0, 0.2]
    near = AreaLights(
        lamps, np.array([0.03, 0.08]), np.full((VIEWS, 2, 3), [30.0, 20, 10], np.float32), CELLS
    )
    return IncidentLight(lattice, directions, energy, near)


def scene() -> tuple[gauss_newton.PixelEstimate, PixelProblem]:
    """A step with paint and metal on it, as the processor says it looks; and a start some degrees off."""
    rng = np.random.default_rng(2)
    mask = np.zeros((40, 48), bool)
    mask[4:37, 5:43] = True
    q = rays(CAMERA) / rays(CAMERA)[..., 2:]
    points = q * np.where(np.arange(48) < 20, 0.45, 0.5)[:, None]
    normals = np.zeros((40, 48, 3))
    normals[mask] = rng.normal(0, 0.15, (mask.sum(), 3)) - [0, 0, 1]
    normals /= np.linalg.norm(normals, axis=2, keepdims=True).clip(1e-9)
    light, count = room(rng, mask), int(mask.sum())
    albedo, roughness = rng.uniform(0.2, 0.7, (count, 3)), rng.uniform(0.3, 0.8, count)
    hidden = trace_occlusion(points, normals, mask, light.directions, Progress(), albedo=albedo)
    made = np.where(np.arange(count)[:, None] % 3 == 0, [0.5, 1.0], [0.4, 0.0])
    geometry = SurfaceGeometry(points[mask], -rays(CAMERA)[mask], hidden, material=made)
    assert geometry.visibility is not None
    assert geometry.visibility.hidden_surfaces is not None
    photographed = rng.uniform(0.1, 0.4, (count, 3 * VIEWS)).astype(np.float32)
    transport = LightTransport(
        light, photographed, True, True, "cpu", radiance_of_hidden_patches(geometry, light, photographed)
    )
    radiance, nothing = np.full((VIEWS, 40, 48, 3), 0.3, np.float32), np.zeros((VIEWS, 40, 48), bool)
    parts = pixel_blocks(mask)
    for pixels, sent in predict(transport, geometry, parts, normals[mask], albedo, roughness):
        v, u = np.argwhere(mask)[pixels].T
        radiance[:, v, u] = sent.transpose(1, 0, 2) * rng.normal(1, 0.01, sent.transpose(1, 0, 2).shape)
    nothing[0, ::3, ::2] = True
    frames = Frames(tuple("x" * VIEWS), radiance, nothing, np.zeros_like(nothing), (1e-6, 1e-6))
    seen = observe(frames, mask, np.arange(VIEWS), 0.02)
    assert (seen.row >= 0).any()
    off = gauss_newton.rotate_normals(normals[mask], rng.normal(0, 0.03, (count, 2)))
    start = gauss_newton.initial_estimate(off, albedo * rng.uniform(0.9, 1.1, albedo.shape), roughness + 0.03)
    walls = radiance_of_hidden_patches(geometry, light, seen.radiance)
    transport = LightTransport(light, seen.radiance, True, True, "cpu", walls)
    return start, PixelProblem(transport, geometry, parts, seen)


def on(device: str, problem: PixelProblem) -> PixelProblem:
    assert isinstance(problem.transport, LightTransport)
    return replace(problem, transport=replace(problem.transport, device=device))


@pytest.mark.parametrize("device", DEVICES)
def test_torchs_equations_are_the_kernels(device: str):
    """With lamps, walls, metal, light that differs within a block, views that are lost, and a rim that holds background."""
    start, problem = scene()
    here, there = (
        gauss_newton.minimize(start, on(where, problem), 1, Progress(), reset_scale=True)
        for where in ("cpu", device)
    )
    np.testing.assert_allclose(there.residual_scale, here.residual_scale, rtol=2e-3)
    np.testing.assert_allclose(there.cost, here.cost, rtol=2e-3)
    largest = np.abs(here.hessian).max((1, 2), keepdims=True)
    np.testing.assert_allclose(there.hessian / largest, here.hessian / largest, atol=2e-3)
    steepest = np.sqrt(here.cost[:, None] * largest[:, :, 0])
    np.testing.assert_allclose(there.gradient / steepest, here.gradient / steepest, atol=2e-3)


@pytest.mark.parametrize("device", DEVICES)
def test_torchs_path_and_the_cpus_agree_to_a_twentieth_of_a_degree(
    device: str, monkeypatch: pytest.MonkeyPatch
):
    """In more than one batch, and what stands before hidden directions summed some pixels at a time."""
    start, problem = scene()
    parts = problem.blocks
    monkeypatch.setattr(gauss_newton_cuda, "ROWS", 2 * 2 * 4 * max(map(len, parts)) * CELLS)
    monkeypatch.setattr(gauss_newton_cuda, "THROWN", 2**22)
    parts = [parts[0][:7], *parts[1:]]  # blocks are of many sizes; who is in none stays as he is
    problem = replace(problem, blocks=parts)
    here, there = (
        gauss_newton.minimize(start, on(where, problem), 4, Progress(), reset_scale=True)
        for where in ("cpu", device)
    )
    apart = np.degrees(angle_between(here.normals, there.normals))
    assert np.degrees(angle_between(here.normals, start.normals)).mean() > 1
    assert apart.mean() < 0.05
    assert np.median(apart) < 0.002
    assert np.abs(here.albedo - there.albedo).mean() < 1e-3
    assert np.abs(here.background_fraction - there.background_fraction).max() < 0.05
    left_out = np.setdiff1d(np.arange(len(apart)), np.concatenate(parts))
    np.testing.assert_array_equal(there.normals[left_out], start.normals[left_out])


@pytest.mark.parametrize("device", DEVICES)
def test_stretches_of_views_weigh_the_same(device: str):
    start, problem = scene()
    state, here = gauss_newton.hessians_by_view_group(start, problem, 3, Progress())
    other, there = gauss_newton.hessians_by_view_group(start, on(device, problem), 3, Progress())
    np.testing.assert_allclose(other.residual_scale, state.residual_scale, rtol=2e-3)
    for one, two in ((here.hessian, there.hessian), (here.gradient, there.gradient)):
        np.testing.assert_allclose(two, one, atol=2e-3 * np.abs(one).max())


def test_nothing_hidden_and_one_light_for_all_is_the_same_too():
    start, problem = scene()
    assert isinstance(problem.transport, LightTransport)
    light = problem.transport.incident
    at = light.probe_grid.points().mean(0)
    alone = ProbeGrid(at, at, (1, 1, 1))
    light = IncidentLight(alone, light.directions, light.energy[:1], AreaLights.none(VIEWS, CELLS))
    geometry = replace(problem.geometry, visibility=None, material=None)
    transport = LightTransport(light, problem.transport.photographed, False, False, "cpu")
    problem = replace(problem, transport=transport, geometry=geometry)
    here, there = (
        gauss_newton.minimize(start, on(where, problem), 3, Progress(), reset_scale=True)
        for where in ("cpu", "cpu:0")
    )
    assert np.degrees(angle_between(here.normals, there.normals)).mean() < 0.01


@pytest.mark.parametrize(
    "error",
    [torch.OutOfMemoryError("CUDA out of memory"), RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED")],
)
def test_a_device_without_memory_says_what_to_do(error: RuntimeError, monkeypatch: pytest.MonkeyPatch):
    start, problem = scene()

    def full(*_: object) -> None:
        raise error

    monkeypatch.setattr(gauss_newton_cuda, "rows_reference", full)
    with pytest.raises(SurfaceError, match=r"too little memory.*--device cpu"):
        gauss_newton.minimize(start, on("cpu:0", problem), 2, Progress())
