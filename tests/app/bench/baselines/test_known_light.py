"""The baselines that know the light: right where their assumption holds, wrong where it breaks."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from app.bench.baselines.flat import answers, projected
from app.bench.baselines.known_light import KnownLightParams
from app.bench.baselines.methods import BASELINES
from engine.geometry import fibonacci_sphere
from engine.progress import Progress
from engine.types import Surface
from tests.engine.reference import lit_room

PARAMS = KnownLightParams(
    object_distance=float(lit_room.ball()[2][:, 2].mean()), directions=400, probe_face_px=12, candidates=80,
    rounds=2, passes=4, visibility=False,
)  # fmt: skip
SCENES = {
    "far matt": lambda: lit_room.scene(),
    "far paper": lambda: lit_room.scene(lit_room.glossy(0.5)),
    "far glossy": lambda: lit_room.scene(lit_room.glossy(0.25)),
    "near matt": lambda: lit_room.scene(lamp_distance=1.4),
    "near paper": lambda: lit_room.scene(lit_room.glossy(0.5), lamp_distance=1.4),
}


@cache
def solved(name: str, scene: str) -> tuple[Surface, lit_room.Scene]:
    known = SCENES[scene]()
    return BASELINES[name].solve(known.captured, PARAMS, "cpu", 0, Progress()), known


def degrees_off(name: str, scene: str) -> float:
    surface, known = solved(name, scene)
    cosine = (surface.normal[surface.mask] * known.normals).sum(1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())


def albedo_off(name: str, scene: str) -> float:
    surface, known = solved(name, scene)
    return float(np.abs(surface.albedo[surface.mask] / known.albedo - 1).mean())


def test_harmonics_of_even_light_light_a_white_surface_as_the_sky_does():
    directions = fibonacci_sphere(20000)
    energy = np.full((20000, 1), 4 * np.pi / 20000)
    light = projected(directions, energy).coefficients
    assert light[0, 0] == pytest.approx(2 * np.sqrt(np.pi), rel=1e-4)
    assert np.abs(light[1:]).max() < 1e-3
    assert (answers(directions[::500]) @ light)[:, 0] == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_each_degree_of_light_is_answered_by_its_share_of_the_cosine_lobe(axis: int):
    # By hand: the cosine lobe over pi keeps 2/3 of w . e and 1/4 of (3 (w . e)^2 - 1) / 2.
    directions = fibonacci_sphere(20000)
    cosine = directions[:, axis]
    energy = np.stack([cosine, (3 * cosine**2 - 1) / 2], 1) * 4 * np.pi / 20000
    normals = fibonacci_sphere(50)
    answer = answers(normals) @ projected(directions, energy).coefficients
    n = normals[:, axis]
    assert answer[:, 0] == pytest.approx(2 / 3 * n, abs=1e-3)
    assert answer[:, 1] == pytest.approx((3 * n**2 - 1) / 8, abs=1e-3)


def test_lambert_finds_a_matt_ball_under_near_lamps():
    assert degrees_off("lambert", "near matt") < 0.5
    assert albedo_off("lambert", "near matt") < 0.02


def test_lambert_mistakes_highlights_for_shape():
    assert degrees_off("lambert", "far glossy") > 2.5 * degrees_off("lambert", "far matt")


def test_a_panorama_is_enough_for_far_lamps():
    assert degrees_off("far_field", "far paper") < 1.5
    assert albedo_off("far_field", "far paper") < 0.08


def test_panoramas_fail_under_near_lamps_and_one_for_all_views_fails_worse():
    per_view = degrees_off("far_field", "near paper")
    assert per_view > 2 * degrees_off("far_field", "far paper")
    assert degrees_off("one_panorama", "near paper") > 2 * per_view


def test_harmonics_come_near_but_lamps_are_sharper_than_second_order():
    assert 5 * degrees_off("lambert", "far matt") < degrees_off("harmonics", "far matt") < 4
    assert albedo_off("harmonics", "far matt") < 0.03


def test_every_baseline_answers_on_the_photographs_grid_with_matt_roughness():
    for name in ("harmonics", "lambert"):
        surface, known = solved(name, "far matt")
        assert surface.depth[surface.mask].mean() == pytest.approx(PARAMS.object_distance, rel=1e-5)
        assert np.all(surface.roughness[surface.mask] == 0.5)
        assert np.array_equal(surface.mask, known.given[1].object)


def test_a_brighter_light_makes_a_darker_object():
    captured, before = lit_room.scene().captured, solved("harmonics", "far matt")[0]
    brighter, lit = (replace(x, radiance=2 * x.radiance) for x in (captured.gaussians, captured.lamps))
    captured = replace(captured, gaussians=brighter, lamps=lit)
    after = BASELINES["harmonics"].solve(captured, PARAMS, "cpu", 0, Progress())
    ratio = after.albedo[before.mask] / before.albedo[before.mask]
    assert np.median(ratio) == pytest.approx(0.5, rel=1e-3)
