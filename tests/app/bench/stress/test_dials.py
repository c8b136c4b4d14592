"""Every dial makes a capture worse in its own way, more with every step, and leaves the rest as it was."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.bench.choices import Choice, built_in, picked
from app.bench.record import BenchError
from app.bench.stored import Stored
from app.bench.stress.dials import DIALS, joined_halves
from engine.types import Masks
from hardware.virtual.studio import bodies, rooms
from tests.app.bench.synthetic import stored


@pytest.fixture(scope="module")
def clean() -> Stored:
    """With forty views that turn about the up axis."""
    one = stored()
    count, frames = 40, one.frames
    turns = Rotation.from_rotvec(np.radians(np.linspace(0, 350, count))[:, None] * [0, 1, 0]).as_matrix()
    placed = np.concatenate([turns, np.broadcast_to([[0], [0], [1]], (count, 3, 1))], 2)
    many = np.arange(count) % len(frames.names)
    radiance = (
        np.random.default_rng(3).uniform(0.2, 1, (count, *frames.radiance.shape[1:])).astype(np.float32)
    )
    return replace(
        one,
        frames=replace(
            frames.views(many), radiance=radiance, names=tuple(f"view{i:02d}" for i in range(count))
        ),
        masks=Masks(one.masks.object, np.broadcast_to(~one.masks.object, radiance.shape[:3]).copy()),
        poses=replace(one.poses, cam_from_world=placed, registered=np.ones(count, bool)),
    )


def change(clean: Stored, worse: Stored) -> float:
    """How much of a capture is otherwise: views gone, poses, lens, masks, radiance; 0 for the same."""
    gone = 1 - len(worse.frames.names) / len(clean.frames.names)
    if gone:
        return gone
    lens = abs(worse.poses.camera.fx / clean.poses.camera.fx - 1)
    poses = float(np.abs(worse.poses.cam_from_world - clean.poses.cam_from_world).mean())
    masks = float((worse.masks.object ^ clean.masks.object).mean())
    masks += float((worse.masks.background ^ clean.masks.background).mean())
    light = float(np.abs(np.log1p(worse.frames.radiance) - np.log1p(clean.frames.radiance)).mean())
    return lens + poses + masks + light


@pytest.mark.parametrize("name", [name for name, dial in DIALS.items() if dial.scene is None])
def test_a_dial_makes_it_worse_with_every_step_and_the_same_with_the_same_seed(
    clean: Stored, name: str
) -> None:
    amounts = [change(clean, DIALS[name].at(clean, step, 7)) for step in range(1, 6)]
    assert amounts[0] > 0
    assert amounts[-1] > amounts[0]
    assert sorted(amounts) == pytest.approx(amounts, rel=0.35)  # chance, of few views
    again = DIALS[name].at(clean, 3, 7)
    assert change(again, DIALS[name].at(clean, 3, 7)) == 0
    assert again.gaussians is clean.gaussians


def test_poses_are_off_by_the_degrees_that_are_said(clean: Stored) -> None:
    worse = DIALS["pose_noise"].at(clean, 4, 1)
    turned = worse.poses.cam_from_world[:, :, :3] @ clean.poses.cam_from_world[:, :, :3].transpose(0, 2, 1)
    apart = Rotation.from_matrix(turned)
    assert np.degrees(apart.magnitude()).mean() == pytest.approx(1.6, rel=0.2)  # of three normal draws of 1
    meant = np.einsum("nij,nj->ni", turned, clean.poses.cam_from_world[:, :, 3])
    shift = np.linalg.norm(worse.poses.cam_from_world[:, :, 3] - meant, axis=1)
    assert shift.mean() == pytest.approx(0.025 * 1.6, rel=0.2)


def test_one_axis_keeps_the_views_that_stand_upright(clean: Stored) -> None:
    number = np.arange(40)
    tilt_deg = np.where(number % 4 == 0, 0, 30 * (-1) ** number)
    tilts = Rotation.from_rotvec(np.radians(tilt_deg)[:, None] * [1, 0, 0])
    placed = clean.poses.cam_from_world.copy()
    placed[:, :, :3] = tilts.as_matrix() @ placed[:, :, :3]
    tilted = replace(clean, poses=replace(clean.poses, cam_from_world=placed))
    kept = DIALS["one_axis"].at(tilted, 5, 0).frames.names
    assert len(kept) == 9
    assert set(kept) < {f"view{i:02d}" for i in range(0, 40, 4)}


def test_motion_smears_the_room_and_not_the_object_that_moves_along(clean: Stored) -> None:
    worse, inside = DIALS["shaken"].at(clean, 4, 0), clean.masks.object
    assert np.array_equal(worse.frames.radiance[:, inside], clean.frames.radiance[:, inside])
    assert worse.frames.radiance[:, ~inside].std() < 0.6 * clean.frames.radiance[:, ~inside].std()


def test_a_light_that_changes_half_way_leaves_the_first_half_as_it_was(clean: Stored) -> None:
    dark = replace(clean, frames=replace(clean.frames, radiance=0.5 * clean.frames.radiance))
    both = joined_halves(clean, dark, 4.0).frames.radiance
    assert np.array_equal(both[:20], clean.frames.radiance[:20])
    assert np.array_equal(both[20:], 4 * dark.frames.radiance[20:])


def test_a_cap_of_the_room_is_shown_by_no_photograph(clean: Stored) -> None:
    worse = DIALS["unseen"].at(clean, 4, 2)
    assert worse.masks.background.mean() < 0.75 * clean.masks.background.mean()
    assert not (worse.masks.background & ~clean.masks.background).any()


def test_what_is_clipped_is_marked_and_a_lower_bound(clean: Stored) -> None:
    worse = DIALS["clipped"].at(clean, 5, 0)
    assert worse.frames.clipped.mean() == pytest.approx(0.1, abs=0.01)
    assert (worse.frames.radiance <= clean.frames.radiance).all()


def test_the_camera_knows_of_the_sensors_noise(clean: Stored) -> None:
    worse, inside = DIALS["noise"].at(clean, 3, 0), clean.masks.object
    off = (worse.frames.radiance - clean.frames.radiance)[:, inside]
    shot, floor = worse.frames.noise
    told = np.sqrt(shot * clean.frames.radiance[:, inside] + floor**2)
    assert (off / told).std() == pytest.approx(1, rel=0.05)


@pytest.mark.parametrize("name", [name for name, dial in DIALS.items() if dial.scene is not None])
def test_a_dial_of_the_scene_photographs_another_one_with_every_step(name: str) -> None:
    dial, booth, blob = DIALS[name], built_in("booth"), built_in("blob")
    assert dial.scene is not None
    scenes = [dial.scene(booth, blob, amount, 0) for amount in dial.amounts]
    assert len({(room.key, thing.key) for room, thing in filter(None, scenes)}) == 5
    for room, thing in filter(None, scenes):  # the studio knows them
        rooms.furnish(room.asked)
        bodies.stand(bodies.Thing(thing.asked, material=thing.material), 0)


def test_a_dial_of_the_booth_is_none_of_another_room() -> None:
    scene, study = DIALS["near_lamp"].scene, Choice("study", "study", "study")
    assert scene is not None
    assert scene(study, built_in("blob"), 0.5, 0) is None


def test_a_dial_that_is_none_is_refused_with_those_there_are() -> None:
    assert picked("--dials", (), DIALS) == tuple(DIALS)
    assert picked("--dials", ("focal", "views"), DIALS) == ("views", "focal")
    with pytest.raises(BenchError, match="none called 'fog'; choose of views, narrow"):
        picked("--dials", ("fog",), DIALS)
