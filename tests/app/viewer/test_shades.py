"""Colours of radiance and of the surface's layers."""

import numpy as np
import pytest

from app.inspect.falsecolour import table
from app.viewer import shades
from engine.io.png import srgb
from tests.app.viewer import made


def test_white_becomes_middle_grey_and_twice_as_bright_is_brighter() -> None:
    values = np.array([[0.0] * 3, [0.4] * 3, [0.8] * 3, [400.0] * 3])
    shown = shades.toned(values, white=0.4)[:, 0].astype(int)
    assert shown[0] == 0
    assert shown[1] == pytest.approx(255 * srgb(np.array(0.5)), abs=1)
    assert shown[1] < shown[2] < shown[3]
    assert shown[3] >= 254


def test_a_red_lamp_stays_red_until_it_blinds() -> None:
    r, g, b = shades.toned(np.array([0.5, 0.05, 0.05]), white=0.5).astype(int)
    assert r > 2 * g
    assert g == b
    assert shades.toned(np.array([5000.0, 500.0, 500.0]), white=0.5).min() > 240


def test_negative_radiance_is_black() -> None:
    assert shades.toned(np.array([-1.0, -1.0, -1.0]), 1.0).max() == 0


def test_layers_show_what_their_names_say() -> None:
    surface = made.surface(24)
    found = shades.layers(surface)
    middle = (12, 12)
    np.testing.assert_array_equal(
        found["albedo"].colours[middle], np.rint(255 * srgb(surface.albedo[middle].astype(float)))
    )
    right, up, towards = found["normals"].colours[middle].astype(int)
    assert towards > 250  # it faces the camera
    assert abs(right - 128) < 12
    assert abs(up - 128) < 12
    assert found["shaded"].lit
    assert not found["albedo"].lit
    np.testing.assert_array_equal(found["roughness"].colours[middle], table("viridis")[128])


def test_normals_are_coloured_as_in_the_exported_map() -> None:
    """Green up: above the bump's middle the surface faces up, where y is negative."""
    colours = shades.layers(made.surface(24))["normals"].colours.astype(int)
    assert colours[4, 12, 1] > 140 > 118 > colours[20, 12, 1]
    assert colours[12, 20, 0] > 140 > 118 > colours[12, 4, 0]


def test_the_legend_ends_at_a_round_number_that_covers_nearly_all() -> None:
    surface = made.surface(24)
    legend = shades.layers(surface)["confidence"].legend
    assert legend is not None
    top = np.degrees(np.percentile(surface.stderr_normal[surface.mask], 98))
    assert legend.high >= top
    assert (legend.high, legend.unit, legend.colours) == (2.0, "°", "magma")
