"""Re-renderings on demand: what an even room must give, in every view, and what a child tells of it."""

from pathlib import Path

import numpy as np
import pytest

from app.inspect import maps, rerendering, runs
from app.inspect.rerendering import Scene, find, open_run
from engine.errors import Cancelled, SessionError
from engine.geometry import fibonacci_sphere, rays
from engine.progress import Progress
from engine.surface.reflectance.brdf import lobe_floor, rows
from tests.app import furnace


class Wire:
    """A link to nobody, that remembers what was told."""

    def __init__(self, stop_after: int = 10**9) -> None:
        self.told: list[dict] = []
        self.hears: dict = {}
        self._stop_after = stop_after

    def emit(self, event: str, **facts) -> None:
        self.told.append({"event": event, **facts})

    def hear(self, command: str, handler) -> None:
        self.hears[command] = handler

    def progress(self) -> Progress:
        return Progress(cancelled=lambda: len(self.told) >= self._stop_after)


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return furnace.finished(tmp_path)


def in_an_even_room() -> np.ndarray:
    """Radiance of the ball's pixels where GLOW comes from everywhere, summed over the rows; nothing hides anything."""
    s = furnace.surface()
    count = furnace.PARAMS["directions"]
    cells = fibonacci_sphere(count)
    away = -rays(furnace.CAMERA)[s.mask]
    diffuse, specular = rows(s.normal[s.mask], s.roughness[s.mask], away, cells, False, lobe_floor(count))
    share = 4 * np.pi / count
    return furnace.GLOW * share * (s.albedo[s.mask] * diffuse.sum(1)[:, None] + specular.sum(1)[:, None])


def test_an_even_room_lights_the_ball_alike_in_every_view(session: Path) -> None:
    scene = Scene(open_run(runs.runs_of(session)[0]), Progress())
    found = scene.rendered((1, 5), Progress())
    expected = in_an_even_room()
    for view in found:
        relative = view / expected
        assert np.median(relative) == pytest.approx(1, abs=0.01)
        # Rim pixels see a little of the ball itself, which throws light back.
        assert np.percentile(np.abs(relative - 1), 95) < 0.08


def test_every_view_is_rendered_once_and_told_the_wanted_one_first(session: Path) -> None:
    run = runs.runs_of(session)[0]
    request = {"session": str(session), "fingerprint": run.fingerprint, "view": 7}
    wire = Wire()
    rerendering.serve(request, wire)  # type: ignore[arg-type]
    views = [event["view"] for event in wire.told]
    assert views[0] == 7
    assert sorted(views) == list(range(furnace.VIEWS))
    shown = maps.load(run)
    made = [maps.rendering(shown, view) for view in range(furnace.VIEWS)]
    assert all(picture is not None for picture in made)
    assert not list(shown.rerendered.glob("*partial*"))
    written = {path: path.stat().st_mtime_ns for path in shown.rerendered.iterdir()}
    again = Wire()
    rerendering.serve(request, again)  # type: ignore[arg-type]
    assert {path: path.stat().st_mtime_ns for path in shown.rerendered.iterdir()} == written
    assert len(again.told) == furnace.VIEWS


def test_stopped_in_between_it_keeps_what_it_has(session: Path) -> None:
    run = runs.runs_of(session)[0]
    wire = Wire(stop_after=1)
    with pytest.raises(Cancelled):
        rerendering.serve({"session": str(session), "fingerprint": run.fingerprint, "view": 3}, wire)  # type: ignore[arg-type]
    assert [path.name for path in maps.rerendered_folder(run).iterdir()] == ["0003.npy"]


def test_a_result_whose_photographs_overruled_its_depth_is_an_older_versions(session: Path) -> None:
    run = runs.runs_of(session)[0]
    (run.folder("surface") / "horizons.json").write_text("{}")
    with pytest.raises(SessionError, match="older version"):
        open_run(run)


def test_results_of_an_older_version_say_so(session: Path) -> None:
    (session / "stages" / "surface" / "aaaa" / "emitters.json").unlink()
    with pytest.raises(SessionError, match="older version"):
        open_run(runs.runs_of(session)[0])


def test_a_result_that_is_gone_is_told(session: Path) -> None:
    with pytest.raises(SessionError, match="is gone"):
        find(session, "bbbb")


def test_views_are_re_rendered_as_the_sensor_lies_and_shown_upright(tmp_path: Path) -> None:
    plain, upright = (furnace.finished(tmp_path / str(flip), flip=flip) for flip in (0, 6))
    shown = []
    for session in (plain, upright):
        (run,) = runs.runs_of(session)
        rerendering.serve({"session": str(session), "fingerprint": run.fingerprint, "view": 0}, Wire())
        shown.append(maps.rendering(maps.load(run), 0))
    np.testing.assert_array_equal(shown[1], np.rot90(shown[0], -1))
