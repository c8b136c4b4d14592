"""What the page knows: eye, style and chosen photograph, step by step."""

from dataclasses import replace

import numpy as np
import pytest

from app.viewer import orbit, showing
from app.viewer.showing import Showing
from tests.app.viewer.test_scene import whole

CONTENTS = whole().contents
ASPECT = 1.5


@pytest.fixture
def opened() -> Showing:
    return showing.opened(Showing(), CONTENTS, ASPECT)


def test_a_new_session_opens_at_its_object_as_its_camera_saw_it(opened: Showing) -> None:
    assert opened.home
    pose = showing.pose_of(CONTENTS, showing.standing(opened))
    assert pose is not None
    right, down, ahead = orbit.axes(opened.eye)
    np.testing.assert_allclose([right, down, ahead], pose[:, :3], atol=1e-9)
    np.testing.assert_allclose(
        pose[:, :3] @ opened.eye.target + pose[:, 3], [0, 0, CONTENTS.object_depth], atol=1e-9
    )


def test_before_there_is_a_surface_a_session_is_seen_from_above_its_cameras() -> None:
    bare = replace(CONTENTS, object_depth=0.0)
    begun = showing.opened(Showing(), bare, ASPECT)
    assert begun.home
    assert begun.eye.target == bare.centre
    assert begun.eye.up == bare.up
    assert np.linalg.norm(orbit.eye(begun.eye) - bare.centre) > bare.radius
    larger = replace(bare, radius=9.0, room_radius=20.0)
    assert showing.opened(begun, larger, ASPECT).eye.distance > begun.eye.distance
    arrived = showing.opened(begun, CONTENTS, ASPECT)
    assert arrived.home
    assert arrived.eye.target != begun.eye.target


def test_a_surface_with_colours_is_first_seen_in_them() -> None:
    assert (
        showing.opened(Showing(), replace(CONTENTS, surfaces=("shaded",)), ASPECT).style.surface == "shaded"
    )
    coloured = replace(CONTENTS, surfaces=("shaded", "albedo"))
    assert showing.opened(Showing(), coloured, ASPECT).style.surface == "albedo"


def test_the_same_session_again_leaves_the_eye_alone(opened: Showing) -> None:
    moved = showing.moved(showing.chose(opened, 2), orbit.turned(opened.eye, 1.0, 0.2))
    again = showing.opened(moved, replace(CONTENTS, triangles=7), ASPECT)
    assert again.eye == moved.eye
    assert (again.chosen, again.style, again.contents.triangles) == (2, moved.style, 7)


def test_another_session_forgets_eye_and_choice_but_not_the_layers(opened: Showing) -> None:
    before = showing.with_layer(showing.chose(opened, 2), "grid", True)
    after = showing.opened(before, replace(CONTENTS, folder="/other"), ASPECT)
    assert after.home
    assert (after.chosen, after.style.view) == (-1, -1)
    assert "grid" in after.style.visible


def test_a_painted_layer_that_is_gone_falls_back_to_shaded(opened: Showing) -> None:
    painted = showing.styled(opened, surface="relit")
    assert showing.opened(painted, CONTENTS, ASPECT).style.surface == "shaded"
    with_it = replace(CONTENTS, surfaces=(*CONTENTS.surfaces, "relit"))
    assert showing.opened(painted, with_it, ASPECT).style.surface == "relit"


def test_choosing_a_view_moves_the_surface_there(opened: Showing) -> None:
    chosen = showing.chose(opened, 3)
    assert (chosen.chosen, chosen.style.view, showing.standing(chosen)) == (3, 3, 3)


@pytest.mark.parametrize("view", [-1, 4, 99])
def test_a_view_without_a_pose_cannot_be_chosen(opened: Showing, view: int) -> None:
    chosen = showing.chose(showing.chose(opened, 2), view)
    assert (chosen.chosen, chosen.style.view) == (-1, 2)


def test_stepping_goes_round_the_registered_views(opened: Showing) -> None:
    seen, state = [], opened
    for _ in range(5):
        state = showing.stepped(state, 1)
        seen.append(state.chosen)
    assert seen == [0, 1, 2, 3, 0]
    assert showing.stepped(opened, -1).chosen == 3
    assert showing.stepped(Showing(), 1) == Showing()


def test_looking_through_is_the_photographs_pose(opened: Showing) -> None:
    seen = showing.looking_through(showing.chose(opened, 1))
    np.testing.assert_allclose(
        orbit.cam_from_world(seen.eye), np.reshape(CONTENTS.poses[1], (3, 4)), atol=1e-9
    )
    assert seen.eye.fov == pytest.approx(CONTENTS.fov)
    assert not seen.home


def test_riding_along_passes_every_camera_in_order_and_the_surface_stays_before_the_eye(
    opened: Showing,
) -> None:
    poses = [np.array(pose).reshape(3, 4) for pose in CONTENTS.poses if pose]
    ride = showing.ride(opened, 2 * len(poses) - 1)  # one between each two
    for eye, style in ride:
        np.testing.assert_allclose(np.array(style.pose).reshape(3, 4), orbit.cam_from_world(eye), atol=1e-12)
        assert not {"cameras", "axes"} & set(style.visible)
    for pose, (eye, _) in zip(poses, ride[::2], strict=True):
        np.testing.assert_allclose(orbit.cam_from_world(eye), pose, atol=1e-9)
    one = showing.opened(Showing(), replace(CONTENTS, poses=CONTENTS.poses[:1]), ASPECT)
    assert len({eye for eye, _ in showing.ride(one, 3)}) == 1


def test_a_turn_about_the_object_keeps_its_photograph_upright(opened: Showing) -> None:
    pose = showing.pose_of(CONTENTS, showing.standing(opened))
    assert pose is not None
    for eye in (opened.eye, orbit.turned(opened.eye, 0.7, 0.2)):
        begun = showing.around(replace(opened, eye=eye))
        np.testing.assert_allclose(orbit.cam_from_world(begun), orbit.cam_from_world(eye), atol=1e-9)
        across = [orbit.axes(replace(begun, azimuth=begun.azimuth + k))[2] @ pose[1, :3] for k in range(6)]
        np.testing.assert_allclose(across, across[0], atol=1e-9)
    assert showing.around(Showing()) == Showing().eye


def test_the_object_is_framed_where_it_stands(opened: Showing) -> None:
    framed = showing.framed(showing.chose(opened, 2), showing.OBJECT, ASPECT)
    pose = np.reshape(CONTENTS.poses[2], (3, 4))
    np.testing.assert_allclose(
        pose[:, :3] @ framed.eye.target + pose[:, 3], [0, 0, CONTENTS.object_depth], atol=1e-9
    )
    assert showing.framed(opened, showing.EVERYTHING, ASPECT).eye.target == CONTENTS.room


def test_without_a_surface_the_cameras_are_framed() -> None:
    state = showing.opened(Showing(), replace(CONTENTS, object_depth=0.0), ASPECT)
    assert showing.framed(state, showing.OBJECT, ASPECT).eye.target == CONTENTS.centre


def test_layers_are_shown_and_hidden(opened: Showing) -> None:
    hidden = showing.with_layer(opened, "lamps", False)
    assert "lamps" not in hidden.style.visible
    assert sorted(showing.with_layer(hidden, "lamps", True).style.visible) == sorted(opened.style.visible)
    assert showing.with_layer(opened, "lamps", True).style.visible.count("lamps") == 1


def test_pyramids_follow_the_registered_views() -> None:
    points, known = showing.pyramids(Showing(CONTENTS))
    assert points.shape == (5, 5, 3)
    assert list(known) == [True, True, True, True, False]
    assert showing.pyramids(Showing())[0].shape == (0, 5, 3)


@pytest.mark.parametrize(
    ("length", "unit", "told"),
    [(2.0, "m", ("2", "m")), (0.5, "m", ("50", "cm")), (0.02, "m", ("2", "cm")), (0.005, "m", ("5", "mm")),
     (0.0002, "m", ("200", "µm")), (0.5, "", ("0.5", "")), (200.0, "", ("200", ""))],
)  # fmt: skip
def test_lengths_are_told_in_a_fitting_unit(length: float, unit: str, told: tuple[str, str]) -> None:
    assert showing.length_text(length, unit) == told
