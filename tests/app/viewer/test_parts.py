"""What is handed to the renderer for each style, and that nothing is made twice."""

from dataclasses import replace

import numpy as np
import pytest

from app.viewer import shades, solids
from app.viewer.parts import Lines, Parts, Triangles
from app.viewer.protocol import LAYERS, Style
from engine.geometry import transform
from tests.app.viewer.test_scene import whole

ALL = Style(LAYERS)


@pytest.fixture(scope="module")
def parts() -> Parts:
    return Parts(whole())


def test_every_layer_is_shown_and_hidden_by_its_name(parts: Parts) -> None:
    assert set(parts.solid(ALL, 0)) == {"surface", "lamps", "cameras", "axes", "grid"}
    assert parts.emitters(ALL, 0) is not None
    assert parts.points(ALL, 0) is not None
    assert parts.glows(ALL) is not None
    for layer in LAYERS:
        style = replace(ALL, visible=tuple(name for name in LAYERS if name != layer))
        hidden = [
            layer in parts.solid(style, 0), layer == "emitters" and parts.emitters(style, 0) is not None,
            layer == "points" and parts.points(style, 0) is not None,
            layer == "lamps" and parts.glows(style) is not None,
        ]  # fmt: skip
        assert not any(hidden), layer


def test_a_part_is_made_once(parts: Parts) -> None:
    again = parts.solid(replace(ALL, emitters="splats"), 0)
    for name, part in parts.solid(ALL, 0).items():
        assert again[name] is part


def test_a_part_is_made_anew_when_what_it_shows_changes(parts: Parts) -> None:
    before = parts.solid(ALL, 0)["surface"]
    for style in (replace(ALL, surface="albedo"), replace(ALL, view=2)):
        assert parts.solid(style, 0)["surface"] is not before
    dots = parts.emitters(ALL, 0)
    assert parts.emitters(replace(ALL, exposure_ev=1.0), 0) is not dots


def test_the_surface_moves_with_the_view(parts: Parts) -> None:
    there = {view: parts.solid(replace(ALL, view=view), 0)["surface"] for view in (0, 2)}
    sheet = parts.scene.sheets[0]
    for view, part in there.items():
        np.testing.assert_allclose(part.points, transform(parts.scene.world_from_cam(view), sheet.points))
    aside = np.eye(3, 4) + [[0, 0, 0, 2.0], [0, 0, 0, 0], [0, 0, 0, 0]]
    part = parts.solid(replace(ALL, pose=tuple(aside.ravel().tolist())), 0)["surface"]
    np.testing.assert_allclose(part.points, sheet.points - [2.0, 0, 0])


def test_only_the_shaded_surface_has_normals_to_be_lit_by(parts: Parts) -> None:
    for name in ("shaded", "albedo", "confidence"):
        part = parts.solid(replace(ALL, surface=name), 0)["surface"]
        assert isinstance(part, Triangles)
        assert (part.normals is not None) == (name == "shaded")


def test_an_unknown_layer_shows_the_shaded_surface(parts: Parts) -> None:
    part = parts.solid(replace(ALL, surface="relit"), 0)["surface"]
    assert isinstance(part, Triangles)
    assert part.normals is not None


def test_a_painted_layer_is_shown_until_painted_again() -> None:
    parts = Parts(whole())
    style = replace(ALL, surface="relit")
    for value in (0.0, 1.0):
        parts.paint("relit", shades.painted(np.full((24, 24, 3), value)))
        assert (parts.solid(style, 0)["surface"].colours == 255 * value).all()


def test_ellipsoids_replace_the_brightest_dots_and_splats_all(parts: Parts) -> None:
    style = replace(ALL, emitters="ellipsoids")
    bodies = parts.ellipsoids(style, 0)["ellipsoids"]
    dots = parts.emitters(style, 0)
    assert dots is not None
    assert len(dots.points) == max(len(parts.scene.emitters or ()) - 1500, 0)
    assert len(bodies.points) == 400 * 42
    assert parts.ellipsoids(ALL, 0) == {}
    assert parts.emitters(replace(ALL, emitters="splats"), 0) is None


def test_brighter_emitters_are_larger_and_lighter(parts: Parts) -> None:
    dots = parts.emitters(ALL, 0)
    assert dots is not None
    window, wall = 0, len(dots.points) - 1
    assert dots.least[window] > dots.least[wall]
    assert dots.colours[window].min() > dots.colours[wall].max()


def test_the_darkest_emitters_can_still_be_told_from_the_ground(parts: Parts) -> None:
    for way in ("points", "ellipsoids"):
        style = replace(ALL, exposure_ev=-12.0, emitters=way)
        shown = parts.emitters(style, 0) if way == "points" else parts.ellipsoids(style, 0)["ellipsoids"]
        assert shown is not None
        assert shown.colours.max(axis=1).min() >= 30


def test_exposure_moves_the_tone(parts: Parts) -> None:
    dark, light = (parts.emitters(replace(ALL, exposure_ev=ev), 0) for ev in (-3.0, 3.0))
    assert dark is not None
    assert light is not None
    assert (light.colours[-50:].astype(int) > dark.colours[-50:]).all()


def test_lamps_are_balls_of_their_size(parts: Parts) -> None:
    lamps = parts.scene.lamps
    assert lamps is not None
    points = parts.solid(ALL, 0)["lamps"].points
    np.testing.assert_allclose(np.linalg.norm(points - lamps.centres[0], axis=1), lamps.radii[0], rtol=1e-6)


def test_each_registered_camera_is_drawn_once(parts: Parts) -> None:
    cameras = parts.solid(ALL, 0)["cameras"]
    assert isinstance(cameras, Lines)
    assert len(cameras.pairs) == 8 * 4
    assert cameras.pairs.max() == len(cameras.points) - 1
    larger = parts.solid(replace(ALL, frusta=2.0), 0)["cameras"]
    np.testing.assert_allclose(
        larger.points[1] - larger.points[0], 2 * (cameras.points[1] - cameras.points[0])
    )


def test_a_ball_is_closed_and_round() -> None:
    points, faces = solids.ball(2)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert len(points) - len(edges) / 2 + len(faces) == 2  # Euler


def test_an_ellipsoid_has_the_half_axes_it_was_given() -> None:
    halves = np.diag([0.5, 1.0, 2.0])[None]
    points, _, _ = solids.ellipsoids(
        np.array([[1.0, 2, 3]]), halves, np.array([[9, 9, 9]], np.uint8), np.array([0.0, -1, 0])
    )
    offset = (points - [1, 2, 3]) / [0.5, 1, 2]
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), 1, rtol=1e-9)


def test_the_grid_lies_level_under_everything(parts: Parts) -> None:
    points, _, fade = solids.grid(parts.scene)
    up = np.array(parts.scene.contents.up)
    heights = points @ up
    assert np.ptp(heights) < 1e-9
    assert parts.scene.emitters is not None
    assert heights[0] <= np.percentile(parts.scene.emitters.gaussians.means @ up, 2)
    assert (fade >= 0).all()
    assert (fade <= 1).all()
