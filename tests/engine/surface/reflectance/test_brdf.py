"""Rows against torch, against a value by hand, against the laws of reflectance, and against Mitsuba."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.geometry import fibonacci_sphere
from engine.surface.reflectance.brdf import index_of, lobe_floor, rows
from engine.surface.reflectance.brdf_torch import rows_reference

UP = np.array([[0.0, 0.0, 1.0]])


def facing(rng: np.random.Generator, count: int) -> np.ndarray:
    v = rng.normal(size=(count, 3))
    v[:, 2] = np.abs(v[:, 2]) + 0.2
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@pytest.mark.parametrize("full_diffuse", [True, False])
@pytest.mark.parametrize("plain", [True, False])
def test_kernel_agrees_with_its_reference(full_diffuse: bool, plain: bool):
    rng = np.random.default_rng(1)
    normals, views, rough = facing(rng, 20), facing(rng, 20), rng.uniform(0.1, 1, 20)
    directions = fibonacci_sphere(300)
    material = None if plain else np.stack([rng.uniform(0.1, 1, 20), rng.integers(0, 3, 20) / 2], 1)
    diffuse, specular = rows(normals, rough, views, directions, full_diffuse, lobe_floor(300), material)
    expected = rows_reference(
        *(torch.as_tensor(x) for x in (normals, rough, views, directions)),
        full_diffuse,
        lobe_floor(300),
        None if material is None else torch.as_tensor(material),
    )
    np.testing.assert_allclose(diffuse, expected[0].numpy(), rtol=2e-4, atol=1e-6)
    np.testing.assert_allclose(specular, expected[1].numpy(), rtol=2e-3, atol=1e-5)


def test_head_on_value_by_hand():
    # n = l = v, alpha = 1/4: D = 1 / (pi alpha^2), F = 0.2^2, Smith's G = 1, so f_s = 0.04 / (4 pi alpha^2).
    diffuse, specular = rows(UP, np.array([0.5]), UP, UP, False, 0.0)
    assert specular[0, 0] == pytest.approx(0.04 * 16 / (4 * math.pi), rel=1e-5)
    assert diffuse[0, 0] == pytest.approx(1 / math.pi, rel=1e-6)


def test_fresnels_law_by_hand():
    # Mirrored at 60 degrees: sin t = sin 60 / 1.5, cos t = sqrt(2 / 3); Rs = ((0.5 - 1.5 cos t) / (0.5 + 1.5 cos t))^2 and
    # Rp = ((cos t - 0.75) / (cos t + 0.75))^2, of which Schlick's power makes 0.07 instead of their mean, 0.0892.
    # alpha = 1: D = 1 / pi, Smith's G = (2 / 3)^2 at both angles, so f_s cos = F (4 / 9) / (4 pi 0.5).
    side = math.sin(math.pi / 3)
    _, specular = rows(
        UP, np.array([1.0]), np.array([[side, 0, 0.5]]), np.array([[-side, 0, 0.5]]), False, 0.0
    )
    cos_t = math.sqrt(2 / 3)
    law = ((0.5 - 1.5 * cos_t) / (0.5 + 1.5 * cos_t)) ** 2 / 2 + ((cos_t - 0.75) / (cos_t + 0.75)) ** 2 / 2
    assert law == pytest.approx(0.0892, abs=1e-4)
    assert specular[0, 0] == pytest.approx(law * 4 / 9 / (2 * math.pi), rel=1e-4)


def test_grazing_retro_reflection_by_hand():
    # Light and camera both at 60 degrees on the same side, roughness 1: (l.h)^2 = 1, retro = 2 - 1/2,
    # Fresnel weight (1 - 1/2)^5 = 1/32, so k = (1 + 1.5 / 32)^2.
    side = np.array([[math.sin(math.pi / 3), 0.0, 0.5]])
    diffuse, _ = rows(UP, np.array([1.0]), side, side, True, 0.0)
    assert diffuse[0, 0] == pytest.approx((1 + 1.5 / 32) ** 2 / math.pi * 0.5, rel=1e-4)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.15, 1.0))
def test_reflectance_is_reciprocal(seed: int, roughness: float):
    a, b = facing(np.random.default_rng(seed), 2)
    for part in (0, 1):
        forth = rows(UP, np.array([roughness]), a[None], b[None], True, 0.0)[part][0, 0] / b[2]
        back = rows(UP, np.array([roughness]), b[None], a[None], True, 0.0)[part][0, 0] / a[2]
        assert forth == pytest.approx(back, rel=1e-3)


@pytest.mark.parametrize("roughness", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("angle_deg", [0, 40, 75])
def test_no_more_light_leaves_than_arrives(roughness: float, angle_deg: float):
    count = 20_000
    view = np.array([[math.sin(math.radians(angle_deg)), 0.0, math.cos(math.radians(angle_deg))]])
    sphere = fibonacci_sphere(count)
    diffuse, specular = rows(UP, np.array([roughness]), view, sphere, False, 0.0)
    cell = 4 * math.pi / count
    assert diffuse.sum() * cell == pytest.approx(1.0, rel=1e-3)
    assert 0 < specular.sum() * cell < 1


def test_what_is_below_the_horizon_gives_nothing():
    directions = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, -0.8]])
    diffuse, specular = rows(UP, np.array([0.5]), UP, directions, True, 0.0)
    assert (diffuse == 0).all()
    assert (specular == 0).all()


def test_level_is_an_index_by_hand():
    # 0.08 of a level: ((n - 1) / (n + 1))^2 = 0.04 at n = 1.5.
    assert index_of(np.array([0.5]))[0] == pytest.approx(1.5)
    n = index_of(np.array([1.0]))[0]
    assert ((n - 1) / (n + 1)) ** 2 == pytest.approx(0.08)


def test_metal_head_on_by_hand():
    # All of D G / 4 = 16 / (4 pi) is of the albedo's colour there, and nothing is white.
    coloured, white = rows(UP, np.array([0.5]), UP, UP, False, 0.0, np.array([[0.5, 1.0]]))
    assert coloured[0, 0] == pytest.approx(16 / (4 * math.pi), rel=1e-5)
    assert white[0, 0] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("material", [(0.5, 0.0), (1.0, 0.0), (0.2, 0.0), (0.5, 1.0), (0.8, 0.4)])
def test_full_model_is_what_mitsuba_calls_principled(material: tuple[float, float]):
    """An implementation nobody here wrote."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    rng = np.random.default_rng(3)
    light, view = facing(rng, 30), facing(rng, 30)
    for roughness in (0.3, 0.7):
        bsdf = mi.load_dict(
            {
                "type": "principled",
                "base_color": {"type": "rgb", "value": [0.5, 0.5, 0.5]},
                "roughness": roughness,
                "specular": material[0],
                "metallic": material[1],
            }
        )
        for l, v in zip(light, view, strict=True):
            interaction = mi.SurfaceInteraction3f()
            interaction.wi = mi.Vector3f(*v)
            theirs = bsdf.eval(mi.BSDFContext(), interaction, mi.Vector3f(*l))[0]
            diffuse, specular = rows(
                UP, np.array([roughness]), v[None], l[None], True, 0.0, np.array([material])
            )
            assert 0.5 * diffuse[0, 0] + specular[0, 0] == pytest.approx(theirs, rel=1e-3)
