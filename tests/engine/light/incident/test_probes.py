"""Light at a point: energy is kept, whatever collects it, and what nobody saw is said to be unseen."""

from pathlib import Path

import numpy as np
import pytest

from engine.geometry import fibonacci_sphere
from engine.light.gaussians.gaussians import isotropic_gaussians, joined, part
from engine.light.incident.direction_grid import interpolated_cells, nearest_cells, pixel_solid_angles
from engine.light.incident.inpainting import inpaint, neighbourhood
from engine.light.incident.probes import gather_probes, panorama, panorama_directions
from engine.types import Gaussians
from tests.bench.kernel import room
from tests.engine import kept
from tests.engine.light import clouds

RADIANCE = 2.5
AHEAD = np.eye(3, 4)[None]
PLACES = np.array([[0.0, 0, 0], [0.5, -0.3, 0.8]])


def holed() -> Gaussians:
    """The shell without its part within 50 degrees of -z."""
    whole = clouds.shell(RADIANCE)
    return part(whole, whole.means[:, 2] > -3 * np.cos(np.radians(50)))


def test_inside_a_shell_of_one_radiance_every_direction_and_the_irradiance_have_it() -> None:
    directions = fibonacci_sphere(600)
    energy = gather_probes(clouds.shell(RADIANCE), AHEAD, PLACES, directions, face=32, fill=False).energy
    np.testing.assert_allclose(energy.sum(2), 4 * np.pi * RADIANCE, rtol=2e-3)
    for normal in np.concatenate([np.eye(3), -np.eye(3)]):
        irradiance = np.maximum(directions @ normal, 0) @ energy
        np.testing.assert_allclose(irradiance, np.pi * RADIANCE, rtol=1e-2)


def test_light_comes_from_where_its_gaussians_are_the_bright_ones_above_all() -> None:
    directions = fibonacci_sphere(400)
    room = clouds.shell(RADIANCE)
    lamp = joined(room, part(room, slice(1)))
    lamp.means[-1], lamp.scales[-1], lamp.density[-1] = (0, 0, 1.5), 0.1, 20.0
    lamp.radiance[-1] *= 300
    turned = np.column_stack([np.diag([-1.0, 1, -1]), [0.3, 0.2, -0.1]])[None]
    found = gather_probes(lamp, turned, PLACES[1:], directions, face=32, fill=False)
    origin = (PLACES[1] - turned[0, :, 3]) @ turned[0, :, :3]
    places = found.places[0, 0].astype(float)
    away = places - origin
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    towards = directions @ turned[0, :, :3]
    assert np.median((away * towards).sum(1)) > np.cos(np.radians(2.0))
    at = (towards @ ((lamp.means[-1] - origin) / np.linalg.norm(lamp.means[-1] - origin))).argmax()
    np.testing.assert_allclose(places[at], lamp.means[-1], atol=0.1)
    elsewhere = np.linalg.norm(places - lamp.means[-1], axis=1) > 1.5
    radius = np.linalg.norm(room.means, axis=1).mean()
    np.testing.assert_allclose(np.linalg.norm(places[elsewhere], axis=1), radius, rtol=0.1)


def test_a_panorama_inside_the_shell_is_its_radiance() -> None:
    radiance, seen = panorama(clouds.shell(RADIANCE), PLACES[1], np.eye(3), 24)
    np.testing.assert_allclose(radiance, RADIANCE, rtol=5e-3)
    assert seen.min() > 0.99


def test_turning_the_camera_turns_the_light() -> None:
    directions = fibonacci_sphere(400)
    about_y = np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]])
    turned = np.column_stack([about_y, np.zeros(3)])[None]
    energy = gather_probes(holed(), AHEAD, PLACES[:1], directions, face=32, fill=False).energy
    other = gather_probes(holed(), turned, PLACES[:1], directions, face=32, fill=False).energy
    assert energy[0, 0][directions[:, 2] < -0.9].sum() < 0.05 * energy[0, 0][directions[:, 2] > 0.9].sum()
    assert other[0, 0][directions[:, 2] > 0.9].sum() < 0.05 * other[0, 0][directions[:, 2] < -0.9].sum()


def test_a_cone_without_gaussians_is_not_seen_and_filled_from_around_it() -> None:
    directions = fibonacci_sphere(600)
    away = directions[:, 2] < -np.cos(np.radians(25))
    found = gather_probes(holed(), AHEAD, PLACES[:1], directions, face=32)
    energy, seen = found.energy, found.seen
    assert seen[0, 0][away].max() < 0.02
    assert seen[0, 0][directions[:, 2] > 0].min() > 0.9
    np.testing.assert_allclose(energy[0, 0][away].sum(0), RADIANCE * 4 * np.pi * away.mean(), rtol=0.05)


def test_a_small_lamp_keeps_its_energy_between_the_pixels() -> None:
    room = clouds.shell(0.01)
    lamp = np.array([0.31, -0.44, 2.0])
    one = isotropic_gaussians(
        lamp[None], room.quaternions[:1], np.full((1, 3), 0.03), 5.0, np.full((1, 3), 1000.0), 1
    )
    bright = joined(room, one)
    directions = fibonacci_sphere(600)
    sums = []
    for face in (48, 80):
        energy = gather_probes(bright, AHEAD, PLACES[:1], directions, face=face, fill=False).energy
        sums.append(energy[0, 0].sum(0))
    np.testing.assert_allclose(sums[0], sums[1], rtol=0.02)


@pytest.mark.parametrize("build", [nearest_cells, interpolated_cells])
def test_cells_share_out_the_whole_sphere(build) -> None:
    directions = fibonacci_sphere(300)
    solid_angles = np.broadcast_to(pixel_solid_angles(64), (6, 64, 64))
    assert solid_angles.sum() == pytest.approx(4 * np.pi, rel=1e-12)
    cells = build(directions, 64)
    np.testing.assert_allclose(cells.share.sum(-1), 1, rtol=1e-5)
    share = np.zeros(300)
    np.add.at(share, cells.index.ravel(), (cells.share * solid_angles[..., None]).ravel())
    assert share.sum() == pytest.approx(4 * np.pi, rel=1e-5)
    np.testing.assert_allclose(share, 4 * np.pi / 300, rtol=0.3)


def test_panorama_directions_worked_by_hand() -> None:
    directions = panorama_directions(2)
    # Row 0 is 45 degrees above the horizon; column 0 is azimuth -135 degrees.
    np.testing.assert_allclose(directions[0, 0], [-0.5, -np.sqrt(0.5), -0.5], atol=1e-12)
    np.testing.assert_allclose(directions[1, 2], [0.5, np.sqrt(0.5), 0.5], atol=1e-12)


def test_filling_keeps_what_is_trusted_and_stays_within_it() -> None:
    directions = fibonacci_sphere(500)
    values = directions[:, :1] + 2
    trust = (directions[:, 2] > -0.3).astype(float)
    filled = inpaint(values, trust, neighbourhood(directions))
    np.testing.assert_allclose(filled[trust == 1], values[trust == 1])
    assert 1 <= filled.min() <= filled.max() <= 3
    assert np.corrcoef(filled[trust == 0, 0], values[trust == 0, 0])[0, 1] > 0.7


def probed() -> tuple[np.ndarray, ...]:
    found = gather_probes(room(3000, np.random.default_rng(0)), AHEAD, PLACES, fibonacci_sphere(500), face=48)
    return found.energy, found.seen, found.places


def test_a_kernel_compiled_among_kernels_kept_from_before_gives_the_same_bits(tmp_path: Path) -> None:
    ours = kept.digest(*probed())  # compiled together, or all kept, whichever it was
    kept.copied(tmp_path, without="probes._probe*")
    assert list(tmp_path.rglob("tiles.touching*.nbc"))
    assert not list(tmp_path.rglob("probes._probe*"))
    assert kept.answer(__name__, tmp_path).strip() == ours
    assert list(tmp_path.rglob("probes._probe*.nbc"))


if __name__ == "__main__":
    kept.tell(*probed())
