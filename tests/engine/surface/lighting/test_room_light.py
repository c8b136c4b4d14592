"""A room that is open somewhere: closed, grouped, and the same light however it is asked for."""

from dataclasses import replace

import numpy as np
import pytest

from app.bench.alike import under
from app.bench.stored import Stored
from engine.geometry import inverse
from engine.light.fitting.lamp_model import with_lamps, without_lamps
from engine.light.gaussians.gaussians import part
from engine.progress import Progress
from engine.surface.data.scene import Picture, build_scene
from engine.surface.estimate import known
from engine.surface.lighting.emitter_groups import FILLED, KNOWN, UNSEEN, EmitterGroupsConfig
from engine.surface.lighting.light_calibration import CalibrationConfig, prior_light, split_groups
from engine.surface.lighting.room_light import (
    RoomLight,
    build_room_light,
    gather_grouped_light,
    gather_incident_light,
)
from engine.surface.params import SurfaceParams
from engine.surface.rendering.transport import ProbeGrid
from engine.surface.schedule import run, schedule
from engine.surface.solve import initial_state
from tests.engine.reference.lit_room import lambert, scene

LATTICE = ProbeGrid(np.array([-0.1, -0.1, 0.9]), np.array([0.1, 0.1, 1.1]), (2, 2, 2))
VIEWS, CELLS, FACE = np.array([0, 5, 9]), 400, 32
UNSEEN_PER_VIEW, PARTS = CalibrationConfig().unseen_per_view, EmitterGroupsConfig().parts


def opened() -> Stored:
    """The lit room without its part within 50 degrees of one direction."""
    stored = Stored("f00d", *scene(lambert).given)
    middle = inverse(stored.poses.cam_from_world)[..., 3].mean(0)
    field = without_lamps(stored.gaussians, stored.lamps)
    away = field.means - middle
    kept = away[:, 1] < np.cos(np.radians(50)) * np.linalg.norm(away, axis=1)
    return replace(stored, gaussians=with_lamps(part(field, kept), stored.lamps))


def room_of(stored: Stored) -> RoomLight:
    return build_room_light(stored.captured, SurfaceParams(without=("view_exposures", "lamp_directions")), 0)


@pytest.fixture(scope="module")
def stored() -> Stored:
    return opened()


def test_groups_come_in_order_the_photographed_the_unseen_the_lamps(stored: Stored):
    room = room_of(stored)
    lamps = len(stored.lamps.radii)
    assert lamps > 0
    unseen = np.nonzero(room.kind == UNSEEN)[0]
    assert 5 < len(unseen) < 25
    assert unseen.tolist() == list(range(len(room.kind) - lamps - len(unseen), len(room.kind) - lamps))
    assert room.group.max() == unseen[-1]
    known = len(without_lamps(stored.gaussians, stored.lamps).means)
    assert (room.group[:known] < unseen[0]).all()
    assert (room.group[known:] >= unseen[0]).all()
    assert len(room.emitters.shown().means) == known


def test_a_gain_moves_its_own_patches_and_lamp_alone(stored: Stored):
    room = room_of(stored)
    gain = np.ones((len(room.kind), 3))
    one = int(np.nonzero(room.kind == UNSEEN)[0][2])
    gain[one], gain[-1] = 7.0, 3.0
    lit = room.with_gains(gain)
    field = lit.field()
    ratio = field.radiance[:, 0, 0] / room.emitters.field().radiance[:, 0, 0]
    np.testing.assert_allclose(ratio, np.where(room.group == one, 7, 1), rtol=1e-6)
    np.testing.assert_allclose(lit.lamps.radiance[-1], 3 * stored.lamps.radiance[-1])
    np.testing.assert_allclose(lit.gaussians.radiance[-1], 3 * stored.gaussians.radiance[-1], rtol=1e-6)
    away = field.means[room.group == one] - field.means[room.group == one].mean(0)
    assert np.linalg.norm(away, axis=1).max() < 0.5 * np.linalg.norm(field.means, axis=1).max()


def test_the_light_is_the_same_by_parts_at_once_and_handed_on(stored: Stored):
    room = room_of(stored)
    gain = np.ones((len(room.kind), 3))
    gain[room.kind == UNSEEN] = [4.0, 3.0, 0.5]
    there = stored.poses.cam_from_world[VIEWS]
    by_parts = gather_grouped_light(LATTICE, room, VIEWS, CELLS, FACE, Progress())
    dark = np.append(gain, np.ones((1, 3)), 0)
    assert 0.1 < by_parts.unseen_share(dark) < 0.95
    light = by_parts.with_gains(dark).energy.sum(1)
    at_once = gather_incident_light(
        LATTICE, room.with_gains(gain), there, CELLS, FACE, Progress()
    ).energy.sum(1)
    # A cell counts as one group's, so that at the rim of what shines four times brighter parts are a little off.
    np.testing.assert_allclose(light, at_once, rtol=0.12)
    ones = np.ones_like(dark)
    plain = gather_incident_light(LATTICE, room.emitters, there, CELLS, FACE, Progress()).energy.sum(1)
    np.testing.assert_allclose(by_parts.with_gains(ones).energy.sum(1), plain, rtol=0.01)
    handed = room_of(under(stored, room.with_gains(gain)))
    assert not (handed.kind == UNSEEN).any()
    assert (handed.kind == KNOWN).all()
    again = gather_incident_light(LATTICE, handed.emitters, there, CELLS, FACE, Progress()).energy.sum(1)
    np.testing.assert_allclose(again, at_once, rtol=1e-3)


def test_what_is_bright_where_no_photograph_looked_is_divided_and_the_light_stays(stored: Stored):
    room = room_of(stored)
    parts = gather_grouped_light(LATTICE, room, np.arange(16), CELLS, FACE, Progress())
    setting = prior_light(parts, 1.0)
    bright = int(np.nonzero(parts.unseen)[0][1])
    gain = setting.gain.copy()
    gain[bright] = [9.0, 7.0, 2.0]
    setting = replace(setting, gain=gain)
    made = split_groups(parts, setting)
    assert made is not None
    finer, after = made
    assert parts.unseen.sum() < finer.unseen.sum() <= UNSEEN_PER_VIEW * 16
    np.testing.assert_array_equal(finer.with_gains(after.gain).energy, parts.with_gains(setting.gain).energy)
    assert finer.patches is not None
    same = room.with_patches_split(finer.patches)
    assert (np.append(same.kind, FILLED) == finer.kind).all()
    np.testing.assert_array_equal(
        same.with_gains(after.gain[:-1]).gaussians.radiance,
        room.with_gains(setting.gain[:-1]).gaussians.radiance,
    )
    again = gather_grouped_light(LATTICE, same, VIEWS, CELLS, FACE, Progress())
    np.testing.assert_array_equal(again.group, finer.group[:, :, VIEWS])
    # Each part's belief counts for as much less as it is smaller: together they are believed as the whole was.
    (of,) = np.nonzero((after.gain == [9.0, 7.0, 2.0]).all(1))
    assert len(of) == PARTS
    extent = finer.patches.extent(len(finer.kind))
    whole = room.patches()
    assert whole is not None
    assert extent[of].sum() == pytest.approx(whole.extent(len(room.kind))[bright], rel=0.15)


def test_there_are_as_many_parts_as_the_views_can_tell_apart(stored: Stored):
    room = room_of(stored)
    parts = gather_grouped_light(LATTICE, room, VIEWS[:1], CELLS, FACE, Progress())
    gain = prior_light(parts, 1.0).gain
    gain[parts.unseen] = 100
    setting, times = replace(prior_light(parts, 1.0), gain=gain), 0
    while (made := split_groups(parts, setting)) is not None:
        (parts, setting), times = made, times + 1
    assert times > 0
    assert UNSEEN_PER_VIEW - PARTS + 1 < parts.unseen.sum() <= UNSEEN_PER_VIEW


def test_parts_of_the_unseen_get_smaller_down_to_single_patches(stored: Stored):
    patches = room_of(stored).patches()
    assert patches is not None
    groups = np.unique(patches.group)
    widest = []
    for _ in range(8):
        numbers = np.unique(patches.group)
        assert (numbers == np.arange(groups[0], numbers[-1] + 1)).all()
        width = [
            np.degrees(np.arccos(np.clip(here @ here.mean(0) / np.linalg.norm(here.mean(0)), -1, 1))).max()
            for here in (patches.towards[patches.group == one] for one in numbers)
        ]
        widest.append(max(width))
        patches = replace(patches, group=patches.split(numbers))
    assert np.all(np.diff(widest) <= 0)
    assert widest[1] < 0.85 * widest[0]
    assert len(np.unique(patches.group)) == len(patches.group)


@pytest.mark.parametrize("relight", [True, False])
def test_a_given_distance_stays_as_given_while_the_unseen_is_looked_for(stored: Stored, relight: bool):
    params = replace(
        SurfaceParams(),
        coarse_views=8,
        coarse_iterations=2,
        directions=400,
        object_distance=1.1,
        without=() if relight else ("light_gains",),
        probe_grid_xy=1,
        probe_grid_z=1,
        probe_resolution=32,
    )
    room = room_of(stored)
    picture = Picture(stored.frames, stored.masks.object, stored.poses.camera)
    seen = build_scene(picture, stored.poses, np.arange(1, 16), (), params, "cpu", 0)
    coarse = [one for one in schedule(params, True) if one.name in ("initialise", "coarse", "place", "full")]
    found = run(seen, initial_state(seen, room), coarse, Progress())
    assert (found.distance.value, found.distance.source) == (1.1, "given")
    assert (found.room_light.kind == UNSEEN).sum() >= (room.kind == UNSEEN).sum()
    unseen = np.append(found.room_light.kind == UNSEEN, False)
    assert (known(found.light_parameters).gain[unseen] == 1).all() != relight
