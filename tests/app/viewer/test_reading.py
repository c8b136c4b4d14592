"""Which results of a session are shown."""

from pathlib import Path

import numpy as np
import pytest

from app.viewer.reading import read, stages_of
from app.viewer.scene import compose
from engine.errors import SessionError
from engine.geometry import transform
from engine.io import session as sessions
from engine.pipeline import artifacts
from engine.types import Emitters
from tests.app.viewer import made


def test_a_whole_run_is_read(tmp_path: Path) -> None:
    results = read(made.session(tmp_path / "s"))
    assert results.names == tuple(f"view{k:04d}" for k in range(5))
    assert None not in (results.poses, results.gaussians, results.lamps, results.surface)


def test_the_light_is_the_one_that_the_surface_was_solved_under(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s")
    (surface,) = (folder / "stages" / "surface").iterdir()
    artifacts.save(surface, "emitters", Emitters(made.gaussians(30), made.lamps(), 5))
    results = read(folder)
    assert results.gaussians is not None
    np.testing.assert_array_equal(results.gaussians.means, made.gaussians(30).means)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_what_is_not_there_yet_is_none(tmp_path: Path, count: int) -> None:
    results = read(made.session(tmp_path / "s", stages=("hdr", "poses", "light", "surface")[:count]))
    assert [part is not None for part in (results.poses, results.gaussians, results.surface)] == [
        count > 1, count > 2, count > 3,
    ]  # fmt: skip


def test_without_a_surface_the_newest_light_and_what_it_was_made_from_are_read(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s", stages=("hdr", "poses", "light"))
    newer = folder / "stages" / "light" / "ffffffffffffffff"
    newer.mkdir()
    made.finish(newer, 99.0, {"hdr": f"{0:016x}", "poses": "gone"})
    assert stages_of(folder) == {"hdr": folder / "stages" / "hdr" / f"{0:016x}", "light": newer}


def test_unfinished_results_are_not_read(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s", stages=("hdr", "poses"))
    (folder / "stages" / "poses" / f"{1:016x}" / "record.json").write_text("{")
    assert set(stages_of(folder)) == {"hdr"}


def test_a_folder_that_is_no_session_is_told(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="not a session"):
        read(tmp_path)


def test_damaged_results_are_told(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s")
    (folder / "stages" / "light" / f"{2:016x}" / "gaussians.means.npy").unlink()
    with pytest.raises(SessionError, match="cannot be read back"):
        read(folder)


def test_cameras_and_surface_stand_upright_and_the_object_stays_where_it_is_in_the_room(
    tmp_path: Path,
) -> None:
    folder = made.session(tmp_path / "s")
    before = compose("", read(folder))
    opened = sessions.open_session(folder)
    sessions.describe(opened, {**opened.facts["camera"], "orientation": 6})
    after = compose("", read(folder))
    places = [
        {tuple(np.round(point, 5)) for point in transform(scene.world_from_cam(1), scene.sheets[0].points)}
        for scene in (before, after)
    ]
    assert len(places[0] & places[1]) > 0.98 * len(places[0])
    # The ring's cameras have the world's y downwards; held on the side, that is to the right of their pictures.
    assert before.contents.up == pytest.approx((0, -1, 0))
    assert after.contents.up != pytest.approx((0, -1, 0), abs=0.1)
