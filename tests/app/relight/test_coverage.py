"""What of the object's light was photographed: counted with the engine's own coverage."""

from pathlib import Path

import numpy as np
import pytest

from app.inspect import runs
from app.relight import coverage as light_coverage
from app.relight import lights as light_files
from engine.geometry import fibonacci_sphere, rays
from engine.orientation import turn_vectors
from engine.pipeline import artifacts
from engine.types import Emitters, Masks
from tests.app import furnace
from tests.app.inspect.test_rerendering import Wire
from tests.engine.ball import CENTRE


def worked_out(session: Path) -> light_files.Light:
    run = runs.runs_of(session)[0]
    request = {"session": str(session), "fingerprint": run.fingerprint}
    light_coverage.serve(request, Wire())  # type: ignore[arg-type]
    found = light_files.load(run)
    assert found is not None
    return found


def test_directions_that_no_background_shows_are_guessed(tmp_path: Path) -> None:
    light = worked_out(furnace.finished(tmp_path))
    # Nine views all round, 38 degrees high: the poles never are on a photograph.
    assert light.seen[:16].mean() < 0.05
    assert light.seen[-16:].mean() < 0.05
    # What the background of a view shows is seen: from the object, 1 ahead of the camera, in its own direction.
    pose = furnace.poses().cam_from_world[
        list(furnace.photographs(furnace.surface()).names).index(light.view)
    ]
    ray = rays(furnace.CAMERA)
    at_wall = furnace.ROOM * ray - CENTRE  # the camera stands in the room's middle
    towards = at_wall / np.linalg.norm(at_wall, axis=-1, keepdims=True)
    assert np.allclose(pose[:, 3], 0)
    row = (np.arccos(-towards[..., 1]) / np.pi * 128).astype(int)
    column = ((np.arctan2(towards[..., 0], towards[..., 2]) / (2 * np.pi) + 0.5) * 256).astype(int)
    background = ~furnace.surface().mask
    background[[0, 1, -2, -1]] = background[:, [0, 1, -2, -1]] = False  # half pixels at the edge
    assert light.seen[row, column][background].mean() > 0.97
    assert not light.clipped.any()
    assert np.median(light.radiance) == pytest.approx(furnace.GLOW, rel=0.02)
    shares = light.shares()
    assert sum(share for share, _ in shares.values()) == pytest.approx(1)


def test_what_no_photograph_shows_is_as_bright_as_the_surface_found_it(tmp_path: Path) -> None:
    session = furnace.finished(tmp_path)
    gaussians, lamps = furnace.room()
    overhead = gaussians.means[:, 1] < -0.7 * furnace.ROOM  # y is down, and no view looks up there
    gaussians.radiance[overhead] *= 6
    surface = session / "stages" / "surface" / "aaaa"
    artifacts.save(surface, "emitters", Emitters(gaussians, lamps, int(overhead.sum())))
    light = worked_out(session)
    assert light.seen[:4].max() < 0.5
    assert np.median(light.radiance[:4]) == pytest.approx(6 * furnace.GLOW, rel=0.02)


def test_what_is_clipped_in_every_view_is_marked(tmp_path: Path) -> None:
    session = furnace.finished(tmp_path)
    folder = session / "stages" / "hdr" / "hhhh"
    frames = furnace.photographs(furnace.surface())
    frames.clipped[:, :8] = True  # the upper rows of all views
    artifacts.save(folder, "frames", frames)
    light = worked_out(session)
    up = np.nonzero(light.clipped.any(1))[0]
    assert len(up) > 3
    assert up.max() < 62  # all of it above the horizon
    assert (light.seen[up.min() : up.max()] > 0.5).any()


def test_the_answer_is_kept(tmp_path: Path) -> None:
    session = furnace.finished(tmp_path)
    first = worked_out(session)
    masks = furnace.surface().mask
    artifacts.save(
        session / "stages" / "segment" / "ssss", "masks", Masks(masks, np.zeros((9, *masks.shape), bool))
    )
    assert worked_out(session).shares() == first.shares()


def test_the_light_is_shown_as_the_upright_camera_has_it(tmp_path: Path) -> None:
    """The camera turned about the sensor's vertical: held on its side, what it never saw lies left and right."""
    plain, upright = (worked_out(furnace.finished(tmp_path / str(flip), flip=flip)).seen for flip in (0, 6))
    towards = fibonacci_sphere(2000)

    def at(seen: np.ndarray, way: np.ndarray) -> np.ndarray:
        row = (np.arccos(-way[:, 1]) / np.pi * 128).astype(int)
        column = ((np.arctan2(way[:, 0], way[:, 2]) / (2 * np.pi) + 0.5) * 256).astype(int) % 256
        return seen[row, column] > 0.5

    same = at(plain, towards) == at(upright, turn_vectors(towards, 6))
    assert same.mean() > 0.97
    assert upright[60:68, 60:68].mean() < 0.05
    assert upright[60:68, 188:196].mean() < 0.05
