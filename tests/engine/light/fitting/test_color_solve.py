"""The colour solve: its rows render what the kernel renders, and both objectives end where they should."""

import numpy as np
import pytest

from engine.light.fitting.color_solve import (
    LinearRenders,
    is_bright,
    linear_renders,
    otsu_threshold,
    render_rows,
    rows_of_free,
    solve_colours,
)
from engine.light.fitting.training_views import Photographs
from engine.light.gaussians.gaussians import radiance_towards
from engine.light.gaussians.rasterize import render_view, shapes, thread_pool
from tests.engine.light import clouds


def rows(matrix: np.ndarray, photographed: np.ndarray) -> LinearRenders:
    """A dense matrix as rows; the photographs are grey."""
    columns = [np.flatnonzero(row) for row in matrix]
    counts = np.array([len(column) for column in columns])
    return LinearRenders(
        np.cumsum(counts) - counts,
        counts,
        np.concatenate(columns).astype(np.int32),
        matrix[matrix > 0].astype(np.float32),
        np.repeat(photographed[:, None], 3, axis=1),
        np.ones(len(matrix)),
    )


def solved(given: LinearRenders, start: np.ndarray, objective, free: np.ndarray | None = None) -> np.ndarray:
    free = np.ones(len(start), bool) if free is None else free
    with thread_pool() as run:
        colours = solve_colours(given, np.repeat(start[:, None], 3, axis=1), free, objective, run)
    assert np.ptp(colours, axis=1).max() < 1e-9
    return colours[:, 0]


def test_otsu_splits_two_clusters_worked_by_hand() -> None:
    # Between classes: 1 * 3 * (1 - 19 / 3)^2 = 85, 2 * 2 * (1.5 - 8.5)^2 = 196, 3 * 1 * (11 / 3 - 9)^2 = 85.
    assert otsu_threshold(np.array([9.0, 1.0, 8.0, 2.0])) == 5.0


def test_lamps_are_the_bright_ones() -> None:
    colours = np.random.default_rng(0).lognormal(0, 0.3, (200, 3))
    colours[:7] *= 40
    np.testing.assert_array_equal(is_bright(colours), np.arange(200) < 7)


def test_rows_times_colours_is_the_rendering_of_the_trusted_pixels() -> None:
    gaussians, view = clouds.scattered(60, 3), clouds.view(40, 24, 3)
    weight = np.random.default_rng(0).integers(0, 2, (1, 24, 40)).astype(np.float32)
    blank = np.zeros((1, 24, 40, 3), np.float32)
    photographs = Photographs(view.cam_from_world[None], view.lens, blank, weight, weight > 2)
    with thread_pool() as run:
        found = linear_renders(shapes(gaussians), photographs, run)
    matrix = np.zeros((len(found.begins), 60))
    for row, begin, count in zip(matrix, found.begins, found.counts, strict=True):
        row[found.columns[begin : begin + count]] = found.values[begin : begin + count]
    image = render_view(gaussians, view)[..., :3][weight[0] > 0]
    # Weights up to 2e-4 are left out of the rows.
    np.testing.assert_allclose(matrix @ radiance_towards(gaussians, view.origin), image, atol=0.01)


def test_energy_takes_the_mean_and_eq_6_the_median() -> None:
    # One lamp alone in seven pixels: relative to itself, squares end at 11 / 7, absolute values at 1.
    given = rows(np.ones((7, 1)), np.array([1.0, 1.1, 0.9, 5.0, 1.0, 1.05, 0.95]))
    assert solved(given, np.array([1.5]), "energy")[0] == pytest.approx(11 / 7, rel=0.02)
    assert solved(given, np.array([1.0]), "relative")[0] == pytest.approx(1.0, rel=0.02)


def mixed() -> tuple[np.ndarray, np.ndarray]:
    """Compositing weights of 5 Gaussians in 400 pixels, and the colours."""
    rng = np.random.default_rng(0)
    matrix = rng.uniform(0, 1, (400, 5)) * (rng.uniform(size=(400, 5)) < 0.5)
    return matrix / np.maximum(matrix.sum(1, keepdims=True), 1), np.array([0.5, 3.0, 1.0, 20.0, 2.0])


@pytest.mark.parametrize("objective", ["energy", "relative"])
def test_colours_that_fit_every_pixel_are_found(objective: str) -> None:
    matrix, true = mixed()
    found = solved(rows(matrix, matrix @ true), 0.7 * true, objective)
    np.testing.assert_allclose(found, true, rtol=0.03)


def test_eq_6_does_not_mind_pixels_that_show_something_else() -> None:
    matrix, true = mixed()
    photographed = matrix @ true
    photographed[::5] *= 3
    found = solved(rows(matrix, photographed), 0.7 * true, "relative")
    np.testing.assert_allclose(found, true, rtol=0.03)
    assert solved(rows(matrix, photographed), 0.7 * true, "energy").mean() > 1.2 * true.mean()


def test_what_is_not_free_stays_and_nothing_turns_negative() -> None:
    matrix = np.array([[0.5, 0.5], [0.5, 0.5], [0.0, 1.0]])
    found = solved(
        rows(matrix, np.array([0.2, 0.2, 1.0])), np.array([1.0, 1.0]), "energy", np.array([True, False])
    )
    assert found[1] == 1.0
    assert 0 <= found[0] < 0.05


def test_what_is_fixed_needs_no_rows_of_its_own() -> None:
    rng = np.random.default_rng(3)
    matrix = rng.uniform(0, 0.4, (50, 6)) * (rng.uniform(size=(50, 6)) < 0.4)
    matrix[matrix.sum(1) == 0, 0] = 0.2
    free = np.array([False, True, False, False, True, False])
    with thread_pool() as run:
        left, touched = rows_of_free(rows(matrix, np.ones(50)), free, run)
        out = np.empty((len(left.begins), 3))
        colours = rng.uniform(1, 2, (6, 3))
        render_rows(left, colours, out, run)
    np.testing.assert_array_equal(touched, matrix[:, free].any(1))
    np.testing.assert_allclose(out, (matrix[:, free] @ colours[free])[touched], rtol=1e-6)
