"""Maps made elsewhere begin the solve in place of the search: to the same answer, or not at all."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.bench.baselines.known_light import solve_and_expect_roughness
from engine.errors import SurfaceError
from engine.geometry import angle_between
from engine.pipeline import stage_table
from engine.pipeline.stages import counted_params
from engine.progress import Progress
from engine.surface import passes
from engine.surface.data import initial_maps
from engine.surface.data.scene import Picture
from engine.surface.optimize.gauss_newton import PixelProblem
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import image, observe_object, search_initial_normals
from engine.surface.solve import solve
from tests.engine.reference.lit_room import lambert, scene
from tests.engine.surface.rendering.test_object_pixels import (
    CAMERA,
    PARAMS,
    ball,
    light_of_lamps,
    pictures_of_a_ball,
)

LIT = scene(lambert)
MASK = LIT.given[1].object
NORMAL = image(MASK, LIT.normals)


def png(path: Path, normals: np.ndarray) -> str:
    """As networks write it: y up, z towards the camera, 16 bits, black where there is nothing."""
    code = np.where(MASK[..., None], (normals * [1, -1, -1] + 1) / 2, 0)
    assert cv2.imwrite(str(path), np.rint(code * 65535).astype(np.uint16)[..., ::-1])
    return str(path)


def test_begun_from_normals_that_are_about_right_the_pixels_end_where_the_search_leads() -> None:
    rng = np.random.default_rng(0)
    light = light_of_lamps(rng, 24, 400)
    frames, mask = pictures_of_a_ball(rng, 24, light)
    object_pixels = observe_object(frames, mask, CAMERA, np.arange(24), PARAMS)
    geometry, truth = object_pixels.geometry_at(0.5), ball()[1][mask]
    lean = truth + rng.normal(0, 0.08, truth.shape)
    lean /= np.linalg.norm(lean, axis=1, keepdims=True)
    maps = initial_maps.InitialMaps(mask, lean, None, None)
    problem = object_pixels.problem(light, geometry, PARAMS, "cpu")
    begun = initial_maps.estimate_from_maps(maps, problem, Progress())
    found = search_initial_normals(object_pixels, light, geometry, PARAMS, Progress())
    one, other = (
        solve_and_expect_roughness(object_pixels, each, light, geometry, PARAMS, "cpu", Progress())
        for each in (begun, found)
    )
    apart = np.degrees(angle_between(one.normals, other.normals))
    assert np.degrees(angle_between(begun.normals, truth)).mean() > 5
    assert np.median(apart) < 0.05
    assert np.quantile(apart, 0.95) < 0.5
    assert np.quantile(np.abs(one.albedo - other.albedo), 0.95) < 0.01
    assert np.quantile(np.abs(one.roughness - other.roughness), 0.95) < 0.02


class Begun(Exception):
    """Raised in place of a first surface."""


def test_a_networks_map_takes_the_place_of_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def begun(maps: initial_maps.InitialMaps, problem: PixelProblem, *_: object) -> None:
        off = np.degrees(angle_between(maps.normals, LIT.normals))
        raise Begun(f"{np.median(off):.1f} {len(maps.normals) == len(problem.geometry.points)}")

    monkeypatch.setattr(passes, "search_initial_normals", None)
    monkeypatch.setattr(initial_maps, "estimate_from_maps", begun)
    asked = SurfaceParams(
        coarse_views=8, directions=64, object_distance=0.6, probe_resolution=8,
        initial_normals=png(tmp_path / "normal.png", NORMAL), normals_frame="opengl",
    )  # fmt: skip
    with pytest.raises(Begun, match=r"^0\.0 True$"):
        solve(LIT.captured, asked, "cpu", 0, Progress())


def test_albedo_and_roughness_are_what_explains_the_photographs() -> None:
    rng = np.random.default_rng(0)
    light = light_of_lamps(rng, 24, 400)
    frames, mask = pictures_of_a_ball(rng, 24, light)
    object_pixels = observe_object(frames, mask, CAMERA, np.arange(24), PARAMS)
    count = int(mask.sum())
    maps = initial_maps.InitialMaps(mask, ball()[1][mask], np.full(count, 0.45), None)
    problem = object_pixels.problem(light, object_pixels.geometry_at(0.5), PARAMS, "cpu")
    state = initial_maps.estimate_from_maps(maps, problem, Progress())
    assert np.median(np.abs(state.albedo - [0.6, 0.4, 0.3])) < 0.01
    np.testing.assert_allclose(state.roughness, 0.45)
    untold = replace(maps, roughness=None)
    state = initial_maps.estimate_from_maps(untold, problem, Progress())
    assert (state.roughness == 0.5).mean() > 0.9  # of those tried, the nearest to 0.45


def test_at_half_the_size_normals_are_those_of_the_pixels_behind_and_of_length_one() -> None:
    rng = np.random.default_rng(1)
    mask, normals, _ = ball()
    mask = mask.copy()
    mask[:, ::7] = False
    frames, _ = pictures_of_a_ball(rng, 8, light_of_lamps(rng, 8, 400))
    maps = initial_maps.InitialMaps(mask, normals[mask], np.nonzero(mask)[1] / 64, None)
    half, small = (
        getattr(Picture(frames, mask, CAMERA, maps).downsampled(), x) for x in ("initial_maps", "mask")
    )
    assert half is not None
    np.testing.assert_allclose(np.linalg.norm(half.normals, axis=1), 1)
    sums = np.where(mask[..., None], normals, 0).reshape(24, 2, 32, 2, 3).sum((1, 3))[small]
    cosine = (half.normals * sums).sum(1) / np.linalg.norm(sums, axis=1)
    assert cosine.min() > 1 - 1e-9
    assert half.roughness is not None
    assert np.abs(half.roughness * 64 - (2 * np.nonzero(small)[1] + 0.5)).max() <= 0.5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"normal": NORMAL[1:]}, ("29 x 36 x 3", "30 x 36 x 3", "resize")),
        ({"normal": NORMAL * [1, -1, -1]}, ("look away", '"opengl"')),
        ({"normal": NORMAL * 0.7}, ("unit length", "0.70")),
        ({"normal": NORMAL * np.nan}, ("NaN", "zeros")),
        ({"normal": NORMAL * (np.arange(36) < 18)[:, None]}, ("have no normal", "mask")),
        ({"roughness": np.full(MASK.shape, 7.0)}, ("roughness", "[0, 1]")),
        ({"roughness": np.zeros(3)}, ("roughness is of shape 3",)),
    ],
)
def test_maps_that_do_not_fit_are_refused_in_one_clear_line(
    tmp_path: Path, change: dict[str, np.ndarray], words: tuple[str, ...]
) -> None:
    path = tmp_path / "maps.npz"
    np.savez(path, **({"normal": NORMAL} | change))
    with pytest.raises(SurfaceError) as fault:
        initial_maps.requested(SurfaceParams(initial_normals=str(path)), MASK)
    said = str(fault.value)
    assert said.startswith(f"start maps: {path}")
    assert "\n" not in said
    assert all(word in said for word in words)


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(SurfaceError, match=r"start maps: nowhere\.exr: no such file"):
        initial_maps.requested(SurfaceParams(initial_normals="nowhere.exr"), MASK)


def test_what_makes_no_sense_is_refused_as_it_is_asked() -> None:
    with pytest.raises(SurfaceError, match=r'^surface\.normals_frame is "maya"; give opencv or opengl$'):
        SurfaceParams(normals_frame="maya")
    with pytest.raises(SurfaceError, match=r"give surface\.initial_normals too"):
        SurfaceParams(initial_roughness="roughness.png")


def test_another_content_of_the_same_file_is_another_result(tmp_path: Path) -> None:
    (stage,) = [stage for stage in stage_table.stages() if stage.name == "surface"]
    normal, roughness = tmp_path / "n.npy", tmp_path / "r.npy"
    asked = SurfaceParams(initial_normals=str(normal), initial_roughness=str(roughness))
    found = []
    for turn in range(3):
        np.save(normal, NORMAL * (1 if turn else -1))
        np.save(roughness, np.full(MASK.shape, 0.2 if turn < 2 else 0.4))
        found.append(str(counted_params(stage, asked, 0, False)))
    assert len(set(found)) == 3
