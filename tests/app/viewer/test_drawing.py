"""From wishes to pictures: quick while moving, better and better at rest, interrupted at once."""

from dataclasses import replace

import numpy as np
import pytest

from app.viewer import orbit, splats
from app.viewer.drawing import ASIDE, TOLD, Drawing, Drawn
from app.viewer.orbit import Orbit
from app.viewer.pace import AIM_MS
from app.viewer.parts import LEVELS
from app.viewer.protocol import Look, Style
from tests.app.viewer.fake_canvas import SEEN_DEPTH, FakeCanvas
from tests.app.viewer.test_scene import whole

EYE = Orbit((0.0, 0.0, 0.0), 3.0, 0.4, 0.2)
PLAIN = Style(("surface",))


class Clock:
    """Every picture takes as long as it is told."""

    def __init__(self) -> None:
        self.now, self.step = 0.0, 0.001

    def __call__(self) -> float:
        self.now += self.step
        return self.now


def drawing(clock: Clock | None = None) -> tuple[Drawing, FakeCanvas]:
    canvas = FakeCanvas()
    made = Drawing(canvas, clock or Clock())
    made.load(whole())
    return made, canvas


def look(number: int = 1, moving: bool = False, style: Style = PLAIN, eye: Orbit = EYE) -> Look:
    return Look(number, eye, 80, 60, moving, style)


def finish(made: Drawing) -> list[Drawn]:
    drawn = []
    while made.pending:
        drawn.append(made.step())
    return [picture for picture in drawn if picture is not None]


def test_nothing_is_drawn_before_it_is_asked_for() -> None:
    made, canvas = drawing()
    assert not made.pending
    assert made.step() is None
    assert canvas.drawn == []


def test_a_moving_eye_gets_one_picture() -> None:
    made, canvas = drawing()
    made.look(look(moving=True))
    (picture,) = finish(made)
    assert (picture.pixels.shape, picture.last) == ((60, 80, 4), True)
    assert len(canvas.drawn) == 1
    np.testing.assert_allclose(canvas.drawn[0][1].cam_from_world, orbit.cam_from_world(EYE))


def test_a_resting_eye_gets_better_pictures_until_the_last() -> None:
    made, canvas = drawing()
    made.look(look())
    pictures = finish(made)
    assert [picture.samples for picture in pictures] == list(TOLD)
    assert [picture.last for picture in pictures] == [False] * (len(TOLD) - 1) + [True]
    assert len(canvas.drawn) == len(ASIDE)


def test_the_pictures_of_a_resting_eye_lie_within_a_pixel_of_one_another() -> None:
    made, canvas = drawing()
    made.look(look())
    finish(made)
    point = np.array([0.3, -0.2, 0.4])
    places = []
    for _, eye in canvas.drawn:
        x, y, z = eye.cam_from_world[:, :3] @ point + eye.cam_from_world[:, 3]
        places.append((eye.focal * x / z, eye.focal * y / z))
    spread = np.ptp(np.array(places), axis=0)
    assert (spread > 0.5).all()
    assert (spread < 1.0).all()
    np.testing.assert_allclose(np.mean(places, axis=0), places[0], atol=0.02)


def test_a_new_wish_interrupts_at_the_next_step() -> None:
    made, _ = drawing()
    made.look(look(1))
    made.step()
    made.look(look(2, moving=True))
    assert made.number == 2
    assert len(finish(made)) == 1


def test_a_slow_machine_draws_less_while_the_eye_moves() -> None:
    clock = Clock()
    made, canvas = drawing(clock)
    clock.step = 3 * AIM_MS / 1e3
    for number in range(20):
        made.look(look(number, moving=True))
        finish(made)
    level, eye = canvas.drawn[-1]
    assert level == 1
    assert (eye.width, eye.height) == (26, 20)
    made.look(look(99))
    assert finish(made)[-1].pixels.shape == (60, 80, 4)  # at rest all of it again


def test_hidden_layers_are_not_handed_to_the_canvas() -> None:
    made, canvas = drawing()
    made.look(look(style=Style(("cameras", "axes"))))
    made.step()
    assert canvas.shown[0] == {"cameras", "axes"}


def test_emitters_between_eye_and_cameras_are_left_out_if_wanted() -> None:
    """From outside the room: with the front open, fewer dots than with it closed."""
    made, _ = drawing()
    eye = Orbit((0.0, 0.0, 0.0), 9.0, 0.4, 0.2)
    shown = {}
    for opened in (True, False):
        style = Style(("emitters",), open_front=opened)
        made.look(look(style=style, eye=eye))
        picture = made.step()
        assert picture is not None
        right = picture.pixels[:, 40:, :3].astype(int)  # nothing of the canvas's is there
        shown[opened] = int((abs(right - right[:1, :1]).max(-1) > 30).sum())
    assert 0 < shown[True] < shown[False]


def test_ellipsoids_are_drawn_apart_with_a_cut_of_their_own() -> None:
    made, canvas = drawing()
    made.look(look(style=Style(("emitters",), emitters="ellipsoids"), eye=replace(EYE, distance=9.0)))
    made.step()
    (level, plain), (bodies, cut) = canvas.drawn
    assert (level, bodies) == (0, LEVELS)
    assert canvas.shown[LEVELS] == {"ellipsoids"}
    assert cut.near > plain.near


def test_splats_come_in_bands_and_end_fine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(splats, "BAND", 20)
    made, _ = drawing()
    made.look(look(style=Style(("emitters",), emitters="splats")))
    pictures, silent = [], 0
    while made.pending:
        picture = made.step()
        silent += picture is None
        if picture is not None:
            pictures.append(picture)
    assert silent >= 3  # the bands: 60 rows
    assert pictures[0].samples == 1
    assert pictures[-1].last
    assert (pictures[0].pixels != pictures[-1].pixels).any()
    assert np.ptp(pictures[-1].pixels[:, 40:, :3].astype(int)) > 50


def test_a_probe_finds_the_point_under_a_pixel() -> None:
    made, canvas = drawing()
    assert made.probe(0.5, 0.5) == ()
    made.look(look())
    made.step()
    point = np.array(made.probe(0.25, 0.75))
    x, y, z = orbit.project(EYE, point, 80, 60)
    assert (x, y, z) == pytest.approx((20, 45, SEEN_DEPTH))
    assert made.probe(0.9, 0.5) == ()


def test_a_probe_just_beside_a_thin_thing_still_finds_it() -> None:
    made, _ = drawing()
    made.look(look())
    made.step()
    point = np.array(made.probe(0.515, 0.5))  # one pixel to the right of where depth ends
    assert orbit.project(EYE, point, 80, 60)[2] == pytest.approx(SEEN_DEPTH)


def test_without_a_scene_the_ground_is_drawn() -> None:
    made = Drawing(FakeCanvas())
    made.look(look())
    assert finish(made)[-1].last


def test_a_scene_that_arrives_draws_the_wish_again() -> None:
    made, _ = drawing()
    made.look(look())
    finish(made)
    assert not made.pending
    made.load(whole())
    assert made.pending


def test_splats_that_must_be_compiled_first_are_announced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(splats, "compiled", lambda: False)
    said: list[str] = []
    made = Drawing(FakeCanvas(), note=said.append)
    made.load(whole())
    for number in (1, 2):
        made.look(look(number, moving=True, style=Style(("emitters",), emitters="splats")))
        finish(made)
    assert len(said) == 1
