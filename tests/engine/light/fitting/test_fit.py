"""The fit on a room that is a painted sphere: it predicts views it never saw, and does so twice alike."""

from dataclasses import replace

import numpy as np
import pytest

from engine.errors import LightError
from engine.light.fitting import fit as fitting
from engine.light.fitting.fit import LightReport, evaluate, fit, split_views
from engine.light.fitting.params import LightParams
from engine.light.fitting.training_views import resample
from engine.light.gaussians.rasterize import thread_pool
from engine.progress import Progress
from engine.types import Frames, Gaussians, Masks, Poses
from tests.engine.light import clouds as lights
from tests.engine.light.painted import CAMERA, RADIUS, VIEWS, clouds, photographed, poses

PARAMS = LightParams(max_gaussians=1500, max_image_width=64, epochs=(4, 6), validation_every=8)


def paint(points: np.ndarray) -> np.ndarray:
    """Radiance of the wall: coloured clouds, and a lamp thirty times as bright."""
    lamp = np.linalg.norm(points / RADIUS - np.array([0.6, -0.64, 0.48]), axis=-1) < 0.2
    return np.where(lamp[..., None], 15.0, clouds(points))


@pytest.fixture(scope="module")
def room() -> tuple[Frames, Masks, Poses]:
    cam_from_world = poses()
    radiance, _ = photographed(cam_from_world, paint)
    thing = np.zeros((48, 64), bool)
    thing[14:34, 22:42] = True
    nowhere = np.zeros((VIEWS, 48, 64), bool)
    # The object's pixels hold what no wall has: the fit must not look there.
    radiance[:, thing] = 400.0
    names = tuple(f"view{i}" for i in range(VIEWS))
    frames = Frames(names, radiance, nowhere, nowhere, (1e-4, 1e-3))
    masks = Masks(thing, np.broadcast_to(~thing, nowhere.shape).copy())
    registered = np.ones(VIEWS, bool)
    return frames, masks, Poses(CAMERA, cam_from_world, registered, np.zeros((0, 3)), "given", np.nan)


@pytest.fixture(scope="module")
def fitted(room: tuple[Frames, Masks, Poses]) -> tuple[Gaussians, LightReport]:
    gaussians, lamps, report = fit(*room, PARAMS, 0, Progress())
    assert report.lamps == len(lamps.radii) == 0  # painted walls hold none
    return gaussians, report


def test_views_that_were_kept_out_are_predicted(
    room: tuple[Frames, Masks, Poses], fitted: tuple[Gaussians, LightReport]
) -> None:
    _, report = fitted
    frames, masks, _ = room
    wall = np.log(report.knee + frames.radiance[masks.background].astype(np.float64))
    guess = float(np.abs(wall - np.median(wall)).mean())
    assert guess > 0.2
    assert report.heldout_log_l1 < 0.4 * guess
    assert report.heldout_energy == pytest.approx(1, abs=0.1)
    assert (report.views_used, report.views_heldout) == (35, 5)


def test_the_budget_and_the_keep_out_hold(fitted: tuple[Gaussians, LightReport]) -> None:
    gaussians, report = fitted
    assert report.count == len(gaussians.means) <= PARAMS.max_gaussians
    assert np.linalg.norm(gaussians.means, axis=1).min() > report.keep_out * 0.5
    assert (gaussians.radiance >= 0).all()


def test_the_same_seed_gives_the_same_bits_and_kept_out_views_teach_nothing(
    room: tuple[Frames, Masks, Poses], fitted: tuple[Gaussians, LightReport]
) -> None:
    frames, masks, poses = room
    radiance = frames.radiance.copy()
    radiance[4::8] = 0.001
    again, *_ = fit(replace(frames, radiance=radiance), masks, poses, PARAMS, 0, Progress())
    for name in ("means", "quaternions", "scales", "density", "radiance"):
        assert getattr(again, name).tobytes() == getattr(fitted[0], name).tobytes()


def test_of_many_views_some_tell_lamps_and_colours(
    room: tuple[Frames, Masks, Poses], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sharp pictures for the lamps, and the rows of the colours, took 7 GB of a thousand views."""
    looked = []
    rows, lamps = fitting.linear_renders, fitting.find_lamps

    def spied_rows(geometry, photographs, run):
        looked.append(len(photographs.weight))
        return rows(geometry, photographs, run)

    def spied_lamps(photographs):
        looked.append(len(photographs.weight))
        return lamps(photographs)

    monkeypatch.setattr(fitting, "linear_renders", spied_rows)
    monkeypatch.setattr(fitting, "find_lamps", spied_lamps)
    _, _, report = fit(*room, replace(PARAMS, epoch_views=20), 0, Progress())
    assert looked == [20, 20]
    assert report.views_used == 35
    assert report.heldout_energy == pytest.approx(1, abs=0.1)


def test_too_few_views_are_refused(room: tuple[Frames, Masks, Poses]) -> None:
    frames, masks, poses = room
    few = replace(poses, registered=np.arange(VIEWS) < 3)
    with pytest.raises(LightError, match="3 views are registered"):
        fit(frames, masks, few, PARAMS, 0, Progress())


def test_holding_every_view_out_is_refused(room: tuple[Frames, Masks, Poses]) -> None:
    with pytest.raises(LightError, match="leaves 0 of"):
        split_views(room[2], 1)


def test_keeping_free_more_than_the_room_is_refused(room: tuple[Frames, Masks, Poses]) -> None:
    with pytest.raises(LightError, match=r"lower `light\.camera_clearance`"):
        fit(*room, replace(PARAMS, camera_clearance=1e6), 0, Progress())


def test_a_pixel_far_below_black_leaves_a_score(room: tuple[Frames, Masks, Poses]) -> None:
    frames, masks, poses = room
    photographs = resample(frames, masks, poses, np.arange(4), 32)
    dark = photographs.radiance.copy()
    dark[0, 0, 0, 0] = -1e3
    with thread_pool() as run:
        told = evaluate(lights.shell(1.0, count=40), replace(photographs, radiance=dark), 0.3, run)
    assert np.isfinite(list(told.values())).all()
