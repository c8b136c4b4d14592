"""The noise bound of a set: from the light that its photographs were taken in, kept beside it, of these photographs alone."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app import places, results
from app.bench import bound, given, sets
from app.bench.choices import built_in
from app.bench.information import Bound, derivatives
from app.bench.sizes import SIZES, Size
from app.bench.stored import Stored
from engine.io import session as sessions
from engine.io.ground_truth import read_truth
from engine.pipeline import run, stage_table
from engine.pipeline.settings import Settings
from engine.progress import Progress
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import geometry_with_visibility
from engine.types import Frames, Masks, Poses
from hardware.errors import StudioError
from hardware.virtual.studio import shoot, tracer
from hardware.virtual.studio import truth as studio_truth
from hardware.virtual.studio.objects import Body
from hardware.virtual.studio.order import RENDER_NOISE
from hardware.virtual.studio.solids import Solid
from tests.app.bench.synthetic import a_set, stored
from tests.app.test_studio import cheap

__all__ = ["cheap"]  # a bare room and a ball, for this file too
ROOM, THING = built_in("window"), built_in("sphere")
SMALL = replace(SIZES["quick"], views=10, width=48, height=36)


@pytest.fixture(scope="module")
def made(cheap: None, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[sets.Set, Size]]:
    """A set of one kind of files, without its light: nobody asks for that here."""
    if not tracer.is_vectorised(tracer.load("cpu")):
        pytest.skip("no libLLVM here: rays are followed one by one")
    folder, found = tmp_path_factory.mktemp("sets"), {}

    def make(files: str) -> tuple[sets.Set, Size]:
        size = replace(SMALL, files=files)
        if files not in found:
            place = sets.photographed(folder, ROOM, THING, size, size.views, 0, "cpu")
            session, truth = place / "given.session", read_truth(place / "truth")
            given.give_truth(place / "session", place / "truth", session)
            run.process(
                sessions.open_session(session),
                stage_table.stages(),
                Settings("standard", 0, {}),
                "cpu",
                "hdr",
                run.Watcher(),
            )
            assert truth.cam_from_world is not None
            assert truth.camera is not None
            frames = run.loader(results.steps_of(session))("hdr", "frames", Frames)
            everywhere = np.ones(len(truth.cam_from_world), bool)
            poses = Poses(
                truth.camera, truth.cam_from_world, everywhere, np.zeros((0, 3)), "given", float("nan")
            )
            masks = Masks(truth.mask, ~frames.clipped)
            inputs = Stored("f00d", frames, masks, poses, stored().gaussians, stored().lamps)
            found[files] = sets.Set("window", "sphere", session, inputs, truth)
        return found[files], size

    return make


@pytest.mark.parametrize("files", ["raw", "linear"])
def test_under_its_light_the_true_surface_sends_what_was_photographed(made, files: str) -> None:
    on, size = made(files)
    assert sessions.open_session(on.session).kind == files
    assert os.listdir(on.session.parent / "truth" / "panoramas") == []  # which take longest, and nobody asks
    assert all(
        len(shot.files) == (3 if files == "raw" else 1)
        for shot in sessions.shots(sessions.open_session(on.session))
    )
    params = SurfaceParams(directions=512)
    built = shoot.build(
        sets.order_of(ROOM, THING, size, 10, 0, "cpu"), places.cache() / "studio", lambda *_: None
    )
    known = bound.known_of(on, built, np.arange(10), params, (1, 1, 2), Progress())
    true = known.true_state()
    sight = geometry_with_visibility(
        known.object_pixels, true, on.truth.depth, known.light.directions, params, Progress()
    )
    problem = known.object_pixels.problem(known.light, sight, params, "cpu")
    pixels = problem.blocks[3]
    sent, _ = derivatives(problem.transport, sight, pixels, true)
    taken = on.stored.frames.radiance[:, on.truth.mask][:, pixels].transpose(1, 0, 2)
    np.testing.assert_allclose(sent.mean((0, 1)), taken.mean((0, 1)), rtol=0.1)  # of few paths each
    assert np.corrcoef(sent.mean((0, 2)), taken.mean((0, 2)))[0, 1] > 0.98
    assert known.scatter.path == RENDER_NOISE
    assert (known.scatter.shot > 0) == (files == "raw")


def test_fewer_photographs_allow_less_and_a_sensor_takes_its_share(
    made, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bound, "PARAMS", SurfaceParams(directions=512))
    monkeypatch.setattr(bound, "PROBES", (1, 1, 2))
    means = {}
    for files, count in (("raw", None), ("linear", None), ("linear", 8)):
        on, size = made(files)
        if count is not None:
            few = np.round(np.linspace(0, 9, count)).astype(int)
            frames = on.stored.frames.views(few)
            on = replace(on, stored=replace(on.stored, frames=frames))
        found = bound.of_set(on, ROOM, THING, size, 0, "cpu", count, Progress())
        assert found.normal_deg.shape == (int(found.chosen.sum()),)
        assert not (found.chosen & ~on.truth.mask).any()
        means[files, count], _ = found.over(on.truth.mask)
    assert 0.05 < means["linear", None] < means["linear", 8] < 90
    assert means["linear", None] < means["raw", None]


def test_a_bound_is_worked_out_once_and_kept_beside_its_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int | None] = []
    on = replace(a_set(), session=tmp_path / "given.session")
    mask = on.truth.mask

    def of_set(on, room, thing, size, seed, device, count, progress) -> Bound:
        asked.append(count)
        return Bound(mask, *np.full((2, int(mask.sum())), [[0.25], [0.5]]))

    monkeypatch.setattr(bound, "of_set", of_set)
    for count in (None, None, 8, 8):
        kept = bound.bounded(on, ROOM, THING, SMALL, 0, "cpu", count).bound
        assert kept is not None
        assert kept.over(mask) == (0.25, 0.5)
    monkeypatch.setattr(bound, "VERSION", 99)
    bound.bounded(on, ROOM, THING, SMALL, 0, "cpu")
    assert asked == [None, 8, None]


def test_where_no_rays_are_followed_a_set_has_no_bound_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def of_set(*_: object) -> Bound:
        raise StudioError("Mitsuba finds no libLLVM here")

    monkeypatch.setattr(bound, "of_set", of_set)
    on = bound.bounded(replace(a_set(), session=tmp_path / "given.session"), ROOM, THING, SMALL, 0, "cpu")
    assert on.bound is None
    assert "booth-blob: no noise bound: Mitsuba finds no libLLVM here" in capsys.readouterr().err


def test_a_mean_is_over_the_pixels_that_were_compared_if_they_are_enough() -> None:
    chosen = np.zeros((20, 20), bool)
    chosen[::2] = True
    known = Bound(chosen, np.repeat([1.0, 3.0], 100), np.repeat([0.5, 0.0], 100))
    upper = np.arange(20)[:, None] < 10
    assert known.over(np.ones((20, 20), bool)) == (2.0, 0.25)
    assert known.over(np.broadcast_to(upper, (20, 20))) == (1.0, 0.5)
    assert np.isnan(known.over(chosen & (np.arange(20) < 2))).all()


def test_a_ridge_within_a_pixel_is_told_as_its_blur() -> None:
    # Two planes' normals meet a quarter of a pixel into column 8, so that its mean holds a quarter of the left one's.
    width, height, depth = 16, 12, 1.0
    focal = studio_truth.camera(width, height)["fx"]
    edge, far = (8.25 - width / 2) / focal * depth, 1.0
    tilt = np.radians(20.0)
    corners = np.array([[x, y, depth] for x in (-far, edge, edge, far) for y in (-far, far)])
    normals = np.array([[side * np.sin(tilt), 0, -np.cos(tilt)] for side in (-1, -1, -1, -1, 1, 1, 1, 1)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [4, 5, 6], [5, 7, 6]])
    solid = Solid(corners, normals, faces)
    body = Body("ridge", solid, np.full((8, 3), 0.5), np.full(8, 0.5))
    found = bound.blur(body, np.ones((height, width), bool))
    expected = 20.0 - np.degrees(np.arctan(0.5 * np.tan(tilt)))
    np.testing.assert_allclose(found[:, 8], expected, atol=1e-3)
    assert np.abs(np.delete(found, 8, 1)).max() < 0.05
