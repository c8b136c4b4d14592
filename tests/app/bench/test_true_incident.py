"""The studio's light at a probe is what the studio's panoramas show there."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.bench.true_incident import incident_of
from engine.geometry import sphere_solid_angle
from engine.light.incident.probes import panorama_directions
from engine.progress import Progress
from engine.surface.rendering.transport import ProbeGrid
from hardware.virtual.studio import render, tracer
from hardware.virtual.studio.bake import pack
from hardware.virtual.studio.interior.around import Around
from hardware.virtual.studio.rooms import Panel
from tests.hardware.virtual.studio.test_relight import POSES, nook

AT, CELLS = np.array([0.05, -0.02, 0.4]), 256
"""x / z, y / z, z of the one probe."""


@pytest.fixture(autouse=True)
def rays_in_bundles() -> None:
    if not tracer.is_vectorised(tracer.load("cpu")):
        pytest.skip("no libLLVM here: rays are followed one by one")


def around(room: Any, atlas: Any) -> Any:
    """What of a built-in room is asked."""
    return SimpleNamespace(room=room, atlas=atlas, device="cpu")


def test_light_and_where_it_comes_from_are_those_of_the_panoramas() -> None:
    light = incident_of(around(*nook()), POSES, ProbeGrid(AT, AT, (1, 1, 1)), CELLS, 2.0, 0, Progress())
    (point,), (globe,) = light.probe_grid.points(), nook()[0].globes
    rows, columns = render.PANORAMA
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    omega = ((edges[:-1] - edges[1:]) * 2 * np.pi / columns)[:, None]
    fine, back = panorama_directions(rows), render.Backdrop(*nook(), "cpu")
    for view, pose in enumerate(POSES):
        there = pose[:, :3].T @ (point - pose[:, 3])
        want = 2.0 * omega[..., None] * render.panorama(back, pose, there, 7)
        mine = light.energy[0].reshape(CELLS, -1, 3)[:, view]
        to_globe = light.area_lights.centres[view, 0] - point
        distance = float(np.linalg.norm(to_globe))
        sine = globe.radius_m / distance
        sent = light.area_lights.radiance[view, 0]
        amount = mine.sum(0) + sphere_solid_angle(globe.radius_m, distance) * sent
        vector = light.directions.T @ mine + np.outer(to_globe / distance, np.pi * sine**2 * sent)
        np.testing.assert_allclose(amount, want.sum((0, 1)), rtol=0.005)
        np.testing.assert_allclose(
            vector, np.einsum("hwi,hwc->ic", fine, want), atol=0.005 * float(want.sum((0, 1)).max())
        )


def test_a_globe_shines_as_it_does_in_the_studio_unless_it_is_boxed_in() -> None:
    room, atlas = nook()
    (globe,) = room.globes
    walls = []
    for axis in (*np.eye(3), *-np.eye(3)):
        right = np.roll(axis, 1) * 0.2
        down = np.cross(axis, right)
        corner = globe.centre + 0.1 * axis - (right + down) / 2
        walls.append(Panel(corner, right, down, np.ones((2, 2, 3))))
    boxed = replace(room, panels=(*room.panels, *walls))
    pictures = [panel.albedo.astype(np.float32) for panel in boxed.panels]
    lattice = ProbeGrid(AT, AT, (1, 1, 1))
    for each, lit, want in ((room, atlas, 2 * globe.radiance), (boxed, pack(boxed.panels, pictures), 0.0)):
        near = incident_of(around(each, lit), POSES, lattice, CELLS, 2.0, 0, Progress()).area_lights
        np.testing.assert_allclose(near.radiance[:, 0], np.broadcast_to(want, (2, 3)), rtol=1e-6)
        away = np.linalg.norm(near.centres[:, 0] - POSES[:, :, 3], axis=1)
        np.testing.assert_allclose(away, np.linalg.norm(globe.centre))


def test_a_room_out_of_a_file_sends_what_its_rays_meet_turned_into_the_cameras_frame() -> None:
    mi = tracer.load("cpu")

    class Upwards:
        """Brighter the higher one looks."""

        def __init__(self) -> None:
            self.mi = mi

        def meet(self, ray: Any) -> Any:
            return SimpleNamespace(radiance=mi.Color3f(2.0 + ray.d.z))

    room = Around("upwards", "", np.zeros(3), Upwards())
    light = incident_of(room, POSES, ProbeGrid(AT, AT, (1, 1, 1)), CELLS, 3.0, 0, Progress())
    for view, pose in enumerate(POSES):
        energy = light.energy[0].reshape(CELLS, -1, 3)[:, view, 0]
        assert energy.sum() == pytest.approx(3 * 2 * 4 * np.pi, rel=0.002)
        up = pose[:, 2]  # world z in the camera's frame
        np.testing.assert_allclose(light.directions.T @ energy, 3 * 4 * np.pi / 3 * up, atol=0.1)
    assert not len(light.area_lights.radii)
