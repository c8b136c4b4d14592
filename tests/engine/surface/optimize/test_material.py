"""A ball of several materials, photographed by Mitsuba's own reflectance, is told for what it is; paint stays paint."""

from dataclasses import replace

import numpy as np
import pytest

from engine.progress import Progress
from engine.surface.optimize import gauss_newton, material
from engine.surface.reflectance.brdf import PAINT
from engine.surface.rendering.object_pixels import ObjectPixels, observe_object, search_initial_normals
from engine.surface.rendering.transport import IncidentLight
from engine.types import Frames
from tests.engine.surface.rendering.test_object_pixels import CAMERA, PARAMS, ball, light_of_lamps

VIEWS, CELLS = 24, 400


def photographed(light: IncidentLight, made: np.ndarray, albedo: np.ndarray, rough: float) -> ObjectPixels:
    """The ball under the light by Mitsuba's principled reflectance, direction by direction; `made` of each pixel."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb" if "llvm_ad_rgb" in mi.variants() else "scalar_rgb")
    mask, normals, points = ball()
    energy = light.energy[0].reshape(CELLS, VIEWS, 3)
    up, towards = normals[mask], -points[mask] / np.linalg.norm(points[mask], axis=1, keepdims=True)
    flat = np.zeros((len(up), VIEWS, 3))
    for kind in np.unique(made, axis=0):
        of = np.nonzero((made == kind).all(1))[0]
        bsdf = mi.load_dict({
            "type": "principled", "specular": float(kind[0]), "metallic": float(kind[1]), "roughness": rough,
            "base_color": {"type": "rgb", "value": albedo[of[0]].tolist()},
        })  # fmt: skip
        pair, cell = np.nonzero(up[of] @ light.directions.T > 0)
        at = mi.SurfaceInteraction3f()
        frame = mi.Frame3f(mi.Normal3f(np.ascontiguousarray(up[of][pair].T, np.float32)))
        at.wi = frame.to_local(mi.Vector3f(np.ascontiguousarray(towards[of][pair].T, np.float32)))
        out = frame.to_local(mi.Vector3f(np.ascontiguousarray(light.directions[cell].T, np.float32)))
        sent = np.zeros((len(of), CELLS, 3))
        sent[pair, cell] = np.array(bsdf.eval(mi.BSDFContext(), at, out)).T
        flat[of] = np.einsum("pdc,dvc->pvc", sent, energy)
    radiance = np.zeros((VIEWS, *mask.shape, 3), np.float32)
    radiance[:, mask] = flat.transpose(1, 0, 2)
    nothing = np.zeros(radiance.shape[:3], bool)
    frames = Frames(tuple(map(str, range(VIEWS))), radiance, nothing, nothing, (1e-6, 1e-6))
    return observe_object(frames, mask, CAMERA, np.arange(VIEWS), PARAMS)


def halves(left: tuple[float, float], right: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Material and albedo of a ball whose halves differ; and which pixels are far enough from the seam to be told apart."""
    mask, normals, _ = ball()
    lies_right = normals[mask][:, 0] > 0
    made = np.where(lies_right[:, None], right, left)
    return made, np.where(lies_right[:, None], [0.85, 0.6, 0.3], [0.3, 0.35, 0.4])


def asked(
    left: tuple[float, float], right: tuple[float, float], known: bool = False
) -> tuple[np.ndarray | None, np.ndarray]:
    """What the pixels of such a ball say they are, begun as paint or as what they are `known` to be; and what they are."""
    light = light_of_lamps(np.random.default_rng(0), VIEWS, CELLS)
    made, albedo = halves(left, right)
    object_pixels = photographed(light, made, albedo, 0.5)
    object_pixels = replace(object_pixels, material=made) if known else object_pixels
    geometry = object_pixels.geometry_at(0.5)
    problem = object_pixels.problem(light, geometry, PARAMS, "cpu")
    state = search_initial_normals(object_pixels, light, geometry, PARAMS, Progress())
    state = gauss_newton.update_residual_scale(state, problem)
    state = gauss_newton.minimize(state, problem, 6, Progress())
    return material.classify(object_pixels, state, light, geometry, True, PARAMS, 0, Progress()), made


def test_paint_stays_paint():
    found, _ = asked(PAINT, PAINT)
    assert found is None


@pytest.mark.parametrize("known", [False, True])
def test_metal_is_told_from_paint_pixel_by_pixel(known: bool):
    """Also when it is asked a second time, which begins at what the first found."""
    found, made = asked(PAINT, (0.5, 1.0), known)
    assert found is not None
    assert (found[:, 1] == made[:, 1]).mean() > 0.97


def test_a_coat_that_mirrors_more_is_told_for_the_whole():
    found, _ = asked((1.0, 0.0), (1.0, 0.0))
    assert found is not None
    assert (found[:, 1] == 0).all()
    np.testing.assert_allclose(found[:, 0], 1.0, rtol=0.15)


@pytest.mark.parametrize("level", [0.25, 0.5, 0.7, 1.0])
def test_the_level_is_the_middle_of_a_parabola(level: float):
    """Log likelihoods that fall with the square of the logarithm from the truth on."""
    steps = np.log2(np.array(material.CONFIG.specular_levels) / level)
    said = np.repeat(-0.3 * steps[None] ** 2, 60, 0)
    found = material.levels(said, np.zeros(60, int), 1)
    assert found[0] == pytest.approx(level, rel=1e-6)


def test_regions_are_heard_only_where_they_speak_plainly():
    rng = np.random.default_rng(1)
    said = np.zeros((300, 3))
    said[:, [0, 2]] = -0.1 + rng.normal(0, 0.02, (300, 2))
    region = np.repeat(np.arange(6), 50)
    said[region == 4, 2] = 0.3
    said[region == 5, 2] = rng.normal(0.02, 0.3, 50)  # no more than chance
    found = material.levels(said, region, 7)  # of the last, nobody was asked
    np.testing.assert_allclose(found, [0.5] * 4 + [1.0] + [0.5] * 2)


def test_a_region_of_paint_stays_paint_where_all_together_stand_between():
    """Half of a coat, half of paint: together .7 or so, which neither is."""
    region = np.repeat([0, 1], 60)
    truth = np.where(region == 0, 0.5, 1.0)[:, None]
    said = -0.3 * np.log2(np.array(material.CONFIG.specular_levels) / truth) ** 2
    np.testing.assert_allclose(material.levels(said, region, 2), [0.5, 1.0], rtol=1e-6)


def test_few_pixels_are_not_heard():
    said = np.tile([-1.0, 0.0, 1.0], (material.CONFIG.least_pixels - 1, 1))
    assert material.levels(said, np.zeros(len(said), int), 1)[0] == PAINT[0]
