"""Lamps apart from the fit: as bright as they were photographed, whole, and where nothing stands in front."""

from dataclasses import replace

import numpy as np
import pytest

from app.bench.baselines.flat import sorted_into_cells
from engine.geometry import fibonacci_sphere, sphere_solid_angle
from engine.light.fitting.lamp_detection import find_lamps
from engine.light.fitting.lamp_model import (
    insert_lamps,
    lamp_transmittance,
    mask_lamps,
    measure_lamps,
    with_lamps,
    without_lamps,
)
from engine.light.fitting.training_views import Photographs
from engine.light.gaussians.gaussians import Y00
from engine.light.incident.probes import gather_probes
from engine.surface.rendering.area_lights import area_lights_of
from engine.types import Gaussians, Lamps
from tests.engine.light import clouds
from tests.engine.light.fitting.test_lamp_detection import LAMPS, RADIUS, views

NOWHERE = np.eye(3, 4)[None]


def dim_or_clipped(clipped: bool) -> Photographs:
    photographs = views(16, 0)
    return photographs if clipped else replace(photographs, clipped=np.zeros_like(photographs.clipped))


def lamp(at: tuple[float, float, float], radius: float) -> Lamps:
    return Lamps(np.array([at]), np.array([radius]), np.array([[9.0, 6.0, 3.0]]), np.array([False]))


@pytest.mark.parametrize("clipped", [False, True])
def test_a_lamps_power_is_what_the_photographs_count(clipped: bool):
    photographs = dim_or_clipped(clipped)
    _, found = measure_lamps(find_lamps(photographs), photographs)
    assert (found.clipped == clipped).all()
    # Painted as discs of one radiance, which off axis cover a little less than a sphere does.
    power = found.radiance * found.radii[:, None] ** 2
    np.testing.assert_allclose(power, 20 * RADIUS**2, rtol=0.15)


def test_a_lamp_that_no_view_shows_a_pixel_of_is_none():
    photographs = views(16, 0)
    sightings = find_lamps(photographs)
    hidden = replace(sightings, shown=sightings.shown & (np.arange(len(sightings.radii)) > 0)[:, None])
    kept, lamps = measure_lamps(hidden, photographs)
    np.testing.assert_array_equal(kept.centres, sightings.centres[1:])
    assert len(lamps.radii) == len(lamps.radiance) == len(lamps.clipped) == len(sightings.radii) - 1


@pytest.mark.parametrize("clipped", [False, True])
def test_a_lamp_nowhere_whole_is_as_bright_as_its_middle(clipped: bool):
    photographs = dim_or_clipped(clipped)
    sightings = find_lamps(photographs)
    # Half the picture unknown a pixel beside each lamp's middle: none is whole, all show some of it.
    weight = photographs.weight.copy()
    _, height, width = weight.shape
    for centre in sightings.centres:
        at, _ = photographs.image_of(centre)
        for view, (u, v) in enumerate(at):
            if np.isfinite(u) and 0 <= u < width and 0 <= v < height:
                weight[view, int(v), int(u) + 1 : int(u) + 8] = 0
    _, lamps = measure_lamps(sightings, replace(photographs, weight=weight))
    assert (lamps.clipped == clipped).all()
    np.testing.assert_allclose(lamps.radiance, 20, rtol=0.15)


def test_every_view_of_a_lamp_is_cut_out_and_little_else():
    photographs = views(16, 0)
    cut = mask_lamps(photographs, measure_lamps(find_lamps(photographs), photographs)[1])
    assert not ((cut.weight > 0) & (photographs.radiance[..., 0] > 10)).any()
    assert (cut.weight > 0).sum() > 0.95 * (photographs.weight > 0).sum()


def test_lamps_are_the_last_gaussians_and_nothing_hides_them():
    photographs = views(16, 0)
    sightings, lamps = measure_lamps(find_lamps(photographs), photographs)
    fog = 0.7 * LAMPS[:1]  # before the first lamp for a camera at the origin
    room = Gaussians(
        np.concatenate([fog, [[0.0, 0, 5.0]]]), np.tile([1.0, 0, 0, 0], (2, 1)), np.full((2, 3), 0.25),
        np.full(2, 1.0), np.full((2, 1, 3), 0.1 / Y00),
    )  # fmt: skip
    joined = insert_lamps(room, lamps, sightings, photographs)
    assert len(joined.means) == 1 + 3
    np.testing.assert_allclose(joined.means[0], [0, 0, 5.0])
    np.testing.assert_allclose(joined.means[1:], lamps.centres)
    np.testing.assert_allclose(without_lamps(joined, lamps).means, joined.means[:1])


def test_the_gaussian_of_a_lamp_sends_what_the_sphere_does():
    bulb = lamp((0.3, -0.2, 1.4), 0.08)
    sightings = find_lamps(views(4, 9))
    none = replace(sightings, shown=np.zeros((1, 4), bool), centres=bulb.centres, radii=bulb.radii)
    room = insert_lamps(clouds.shell(0.0), bulb, none, views(4, 9))
    directions = fibonacci_sphere(500)
    energy = gather_probes(room, NOWHERE, np.zeros((1, 3)), directions, 48, False).energy
    exact = area_lights_of(bulb, clouds.shell(0.0), NOWHERE, np.zeros(3), 500).levels(np.zeros((1, 3)))
    np.testing.assert_allclose(energy[0, 0].sum(0), exact[0], rtol=0.04)


@pytest.mark.parametrize(("density", "share"), [(0.2, 1.0), (0.7, 0.7), (9.0, 0.0)])
def test_what_is_solid_hides_a_lamp_and_haze_does_not(density: float, share: float):
    bulb = lamp((0.0, 0.0, 1.5), 0.05)
    wall = Gaussians(
        np.array([[0.0, 0, 0.8], [0.0, 0, 2.5]]), np.tile([1.0, 0, 0, 0], (2, 1)), np.full((2, 3), 0.1),
        np.array([density, 50.0]), np.zeros((2, 1, 3)),
    )  # fmt: skip
    assert lamp_transmittance(bulb, wall, NOWHERE, np.zeros(3))[0, 0] == pytest.approx(share, abs=0.1)
    assert lamp_transmittance(bulb, clouds.shell(0.0), NOWHERE, np.zeros(3))[0, 0] == 1


def test_energy_at_the_object_is_the_same_whole_and_with_the_lamps_apart():
    """The Gaussian that a lamp leaves in the room holds what `AreaLights` sends from its sphere, and hides what that hides."""
    cells, here = fibonacci_sphere(1024), np.zeros((1, 3))
    lamps = Lamps(
        np.array([[1.2, -0.6, 0.8], [-0.5, 1.1, 1.0]]), np.array([0.12, 0.2]),
        np.array([[60.0, 40, 20], [30, 30, 30]]), np.zeros(2, bool),
    )  # fmt: skip
    whole = with_lamps(clouds.shell(1.0), lamps)
    rest = without_lamps(whole, lamps)
    together = gather_probes(whole, NOWHERE, here, cells, 64, False).energy[0, 0].sum(0)
    room = gather_probes(rest, NOWHERE, here, cells, 64, False).energy[0, 0].sum(0)
    sent = sorted_into_cells(area_lights_of(lamps, rest, NOWHERE, here[0], len(cells)), here[0]).sum(0)
    assert (sent > 0.1 * room).all()
    # A sphere added to the room also has the wall behind it: radiance 1 over its solid angle.
    behind = np.sum(sphere_solid_angle(lamps.radii, np.linalg.norm(lamps.centres, axis=1)))
    np.testing.assert_allclose(room + sent - behind, together, rtol=0.01)
