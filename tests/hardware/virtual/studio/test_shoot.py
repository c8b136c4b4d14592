"""Rooms, bodies, motions and truth maps are what they say they are."""

from dataclasses import replace

import numpy as np
import pytest

from engine.geometry import inverse
from engine.sfm.rig_alignment import RigLog, angle_between, logged_poses
from hardware.errors import StudioError
from hardware.virtual.studio import (
    bake,
    materials,
    mirror,
    motion,
    objects,
    order,
    paint,
    rooms,
    shoot,
    solids,
    truth,
)
from hardware.virtual.studio import bodies as things

CENTRE = np.array([0.0, 0.0, 1.35])
SIZE = (160, 120)
FURNISHED = ("study", "lamps", "window", "polished", "leafy", "chink", "parlour")


def coarse(name: str) -> rooms.Room:
    """A room painted by the decimetre, without the leaves that would be smaller: they are what painting takes its time for."""
    leaves = paint.leaves

    def large(canvas, texel_m, rng, hues, smallest_m, largest_m, cover):
        leaves(canvas, texel_m, rng, hues, max(smallest_m, texel_m), max(largest_m, texel_m), cover)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rooms, "TEXEL_M", 0.1)
        patch.setattr(paint, "leaves", large)
        return rooms.furnish(name)


@pytest.fixture(scope="module")
def furnished():
    return {name: coarse(name) for name in FURNISHED}


@pytest.fixture(scope="module")
def bodies():
    """All of them, of a quarter to a sixteenth of their triangles: still several to a pixel of `SIZE`."""
    ball, lathe, hull, terrain = solids.ball, solids.lathe, solids.hull, solids.terrain
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solids, "ball", lambda cells, radius: ball(cells // 4, radius))
        patch.setattr(
            solids, "lathe", lambda profile, around, *how, **ways: lathe(profile, around // 4, *how, **ways)
        )
        patch.setattr(solids, "hull", lambda corners, grain: hull(corners, 4 * grain))
        patch.setattr(
            solids, "terrain", lambda heights, *how, **ways: terrain(heights[::3, ::3], *how, **ways)
        )
        return {name: objects.model(name) for name in objects.OBJECTS}


@pytest.mark.parametrize("name", FURNISHED)
def test_a_room_is_built_the_same_every_time(furnished, name):
    room = furnished[name]
    assert bake.digest(room) == bake.digest(coarse(name))
    for panel in room.panels:
        assert abs(panel.right @ panel.down) < 1e-9
        assert panel.albedo.min() >= 0
        assert panel.albedo.max() < 1
    assert room.globes or room.sheets


def test_the_room_that_ships_baked_needs_no_baking(monkeypatch, tmp_path):
    def refuse(*args):
        raise AssertionError("baked anew: `python -m hardware.virtual.studio.bake parlour` makes what ships")

    monkeypatch.setattr(bake, "_irradiance", refuse)
    room = rooms.furnish("parlour")
    atlas = bake.bake(room, tmp_path, "cpu", lambda share, note: None)
    assert not list(tmp_path.iterdir())
    paint = bake.pack(room.panels, [panel.albedo for panel in room.panels]).picture
    lit = atlas.picture[paint > 0] / paint[paint > 0]  # irradiance / pi
    assert 0.05 < np.median(lit) < 2.0
    # Another paint is another light.
    panel = replace(room.panels[0], albedo=0.9 * room.panels[0].albedo)
    with pytest.raises(AssertionError, match="baked anew"):
        bake.bake(replace(room, panels=(panel, *room.panels[1:])), tmp_path, "cpu", lambda share, note: None)


def test_baked_light_is_kept_and_laid_over_the_paint(tmp_path):
    """Half a panel in light of 2, half in 4: what leaves it is that times its paint, with a ramp over one block."""
    albedo = np.random.default_rng(3).uniform(0.2, 0.8, (8, 16, 3)).astype(np.float32)
    panel = rooms.Panel(np.zeros(3), np.array([1.6, 0, 0]), np.array([0, 0.8, 0]), albedo)
    room = rooms.Room("panel", (panel,), (), (), np.zeros(3))
    light = np.ones((2, 4, 3)) * np.array([2.0, 2.0, 4.0, 4.0])[:, None]
    bake.keep(tmp_path / f"panel-{bake.digest(room)}.npz", room, [light])
    atlas = bake.bake(room, tmp_path, "cpu", lambda share, note: None)
    top = bake.GUTTER
    lit = atlas.picture[top : top + 8, top : top + 16] / albedo
    np.testing.assert_allclose(lit[:, :6], 2.0, rtol=1e-6)
    np.testing.assert_allclose(lit[:, 6:10, 0].mean(0), [2.25, 2.75, 3.25, 3.75], rtol=1e-6)
    np.testing.assert_allclose(lit[:, 10:], 4.0, rtol=1e-6)


def test_rooms_are_lit_as_promised(furnished):
    assert not furnished["lamps"].sheets
    window = furnished["window"]
    assert not window.globes
    assert len(window.sheets) == 1
    poses = motion.handheld(96, CENTRE, 1).world_from_cam
    to_object = poses[:, :, 2] * objects.DISTANCE_M + poses[:, :, 3]
    lamp = furnished["study"].globes[0].centre
    assert np.linalg.norm(to_object - lamp, axis=1).min() < 1.0


@pytest.mark.parametrize("name", FURNISHED)
def test_nothing_stands_where_the_rig_moves(furnished, name):
    room = furnished[name]
    for quad in (*room.panels, *room.sheets):
        off = room.centre - quad.corner
        across, down = (np.clip(off @ edge / (edge @ edge), 0, 1) * edge for edge in (quad.right, quad.down))
        assert np.linalg.norm(off - across - down) > rooms.FREE_M
    for globe in room.globes:
        assert np.linalg.norm(room.centre - globe.centre) - globe.radius_m > rooms.FREE_M


def test_an_atlas_gives_every_panel_its_own_picture(furnished):
    room = furnished["window"]
    atlas = bake.pack(room.panels, [np.full_like(p.albedo, k) for k, p in enumerate(room.panels)])
    h, w = atlas.picture.shape[:2]
    for k in range(len(room.panels)):
        (x0, y0), (x1, y1) = (
            np.rint(atlas.low[k] * [w, h]).astype(int),
            np.rint(atlas.high[k] * [w, h]).astype(int),
        )
        # One texel around belongs to it too, for interpolation.
        assert (atlas.picture[y0 - 1 : y1 + 1, x0 - 1 : x1 + 1] == k).all()


@pytest.mark.parametrize("name", list(objects.OBJECTS))
def test_truth_maps_describe_one_surface_seen_from_the_camera(bodies, name):
    body = bodies[name]
    w, h = SIZE
    maps = truth.maps(body, w, h)
    mask, normal, depth = maps["mask"], maps["normal"], maps["depth"]
    np.testing.assert_allclose(np.linalg.norm(normal[mask], axis=-1), 1, atol=1e-5)
    assert not normal[~mask].any()
    lens = truth.camera(w, h)
    y, x = np.mgrid[:h, :w] + 0.5
    rays = np.stack([(x - lens["cx"]) / lens["fx"], (y - lens["cy"]) / lens["fy"], np.ones_like(x)], -1)
    facing = (normal * rays).sum(-1) / np.linalg.norm(rays, axis=-1)
    # Shading normals may turn away at the very rim of a mesh.
    assert (facing[mask] < 0).mean() > 0.985
    points = rays * depth[..., None]
    across = points[1:-1, 2:] - points[1:-1, :-2]
    down = points[2:, 1:-1] - points[:-2, 1:-1]
    inner = mask[1:-1, 2:] & mask[1:-1, :-2] & mask[2:, 1:-1] & mask[:-2, 1:-1] & mask[1:-1, 1:-1]
    steep = np.maximum(np.abs(across[..., 2]), np.abs(down[..., 2])) > 0.01
    flat = np.cross(down, across)
    flat /= np.maximum(np.linalg.norm(flat, axis=-1, keepdims=True), 1e-12)
    off = np.degrees(np.arccos(np.clip((flat * normal[1:-1, 1:-1]).sum(-1), -1, 1)))[inner & ~steep]
    assert np.median(off) < 4
    assert (maps["albedo"][mask] > 0).all()
    assert (maps["roughness"][mask] >= 0.1).all()


@pytest.mark.parametrize("name", list(objects.OBJECTS))
def test_a_body_fits_into_the_picture(bodies, name):
    body = bodies[name]
    touched = truth.touched(body, *SIZE, finer=2)
    assert not touched[[0, -1]].any()
    assert not touched[:, [0, -1]].any()
    assert 0.08 < truth.maps(body, *SIZE)["mask"].mean() < 0.4
    assert len(body.albedo) == len(body.roughness) == len(body.solid.vertices)
    np.testing.assert_allclose(np.linalg.norm(body.solid.normals, axis=1), 1, atol=1e-6)


def test_objects_are_glossy_and_matte(bodies):
    assert bodies["duo"].roughness.min() < 0.25
    assert bodies["duo"].roughness.max() > 0.55
    assert all(np.ptp(body.roughness) > 0.1 and np.ptp(body.albedo) > 0.2 for body in bodies.values())


@pytest.mark.parametrize("kind", ["turntable", "gimbal"])
def test_a_rig_reports_where_it_is_up_to_its_encoders_noise(kind):
    journey = motion.travel(kind, 96, CENTRE, 3)
    reports = [r for r in journey.reports if r is not None]
    assert journey.geometry is not None
    log = RigLog(
        kind,
        np.array([r["pan_deg"] for r in reports]),
        np.array([r["tilt_deg"] for r in reports]),
        journey.geometry,
    )
    logged, real = logged_poses(log), inverse(journey.world_from_cam)
    # Both worlds are rigid; the first view ties them together.
    tie = inverse(real[:1])[0]
    rig_from_cam = inverse(logged)
    world_from_rig = tie[:, :3] @ logged[0][:, :3]
    turned = np.degrees(
        angle_between(world_from_rig @ rig_from_cam[:, :, :3], journey.world_from_cam[:, :, :3])
    )
    # The noise of the first view and of each other one, two axes each: sigma times sqrt(4) at most.
    assert turned.max() < 4 * motion.REPORT_NOISE_DEG * 2
    assert np.sqrt((turned**2).mean()) > 0.2 * motion.REPORT_NOISE_DEG
    shift = tie[:, 3] - world_from_rig @ rig_from_cam[0][:, 3]
    off = rig_from_cam[:, :, 3] @ world_from_rig.T + shift - journey.world_from_cam[:, :, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.002


@pytest.mark.parametrize("kind", order.MOTIONS)
def test_the_rig_stays_in_the_free_space_and_repeats(kind):
    journey = motion.travel(kind, 48, CENTRE, 7)
    again = motion.travel(kind, 48, CENTRE, 7)
    assert (journey.world_from_cam == again.world_from_cam).all()
    assert len(journey.reports) == len(journey.world_from_cam) == 48
    for pose in journey.world_from_cam:
        np.testing.assert_allclose(pose[:, :3] @ pose[:, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.norm(pose @ [0, 0, objects.DISTANCE_M, 1] - CENTRE) + 0.15 < rooms.FREE_M
        assert np.linalg.norm(pose[:, 3] - CENTRE) < rooms.FREE_M


def test_hands_report_nothing():
    journey = motion.travel("handheld", 8, CENTRE, 1)
    assert journey.geometry is None
    assert set(journey.reports) == {None}


def test_what_may_be_ordered_is_what_there_is():
    assert set(order.ROOMS) == set(rooms.ROOMS)
    assert set(order.OBJECTS) == set(objects.OBJECTS)
    assert set(order.MOTIONS) == set(motion.FREE) | set(motion.RIGS)
    assert set(order.MATERIALS) == {*materials.MATERIALS, materials.FROM_FILE}


@pytest.mark.parametrize("kind", ["handheld", "random"])
def test_larger_objects_wander_less_in_a_built_in_room_and_that_is_said(kind):
    """And never beyond its free space; what fits nowhere is refused."""
    told = {}
    for size in (0.25, 0.4, 0.55, 1.2):
        scale = size / 0.25
        ball = solids.ball(8, lambda towards, radius=size / 2: np.full(len(towards), radius))
        ball = solids.moved(ball, np.eye(3), np.array([0, 0, objects.DISTANCE_M * scale]))
        count = len(ball.vertices)
        stood = things.Stood(objects.Body("ball", ball, np.ones((count, 3)), np.ones(count)), scale)
        asked = order.Order("booth", "ball", 24, motion=kind, object_size=size)
        if size == 1.2:
            with pytest.raises(StudioError, match=r"from the room's centre, where 0\.98 m are free; choose"):
                shoot._journey(asked, stood, CENTRE)
            continue
        journey, told[size] = shoot._journey(asked, stood, CENTRE)
        poses = journey.world_from_cam
        there = np.einsum("nij,pj->npi", poses[:, :, :3], stood.body.solid.vertices) + poses[:, None, :, 3]
        assert np.linalg.norm(there - CENTRE, axis=-1).max() < rooms.FREE_M
    assert told[0.25] == ()
    assert "no more is free" in told[0.55][0]


@pytest.mark.parametrize(("changes", "said"), [
    ({"turn_deg": float("nan")}, "--turn nan"), ({"turn_deg": float("inf")}, "--turn inf"),
    ({"object_size": float("nan")}, "--object-size nan"), ({"place": (0.0, float("nan"), 1.0)}, "--place 0.0 nan 1.0"),
    ({"place": (0.0, 0.0, 1.0)}, "in a built-in room is fixed"),
])  # fmt: skip
def test_what_is_no_number_is_refused(tmp_path, changes, said):
    with pytest.raises(StudioError, match=said):
        shoot.build(order.Order("booth", "sphere", **changes), tmp_path, lambda share, note: None)


def test_numbers_of_the_booth_change_what_they_say():
    usual, near = rooms.furnish("booth"), rooms.furnish("booth:lamp=0.5")
    (lamp,), (far,) = near.globes, usual.globes
    away = np.linalg.norm(lamp.centre - near.centre)
    assert away == pytest.approx(0.5)
    assert lamp.radius_m / away == pytest.approx(far.radius_m / np.linalg.norm(far.centre - usual.centre))
    large = rooms.furnish("booth:side=28")
    np.testing.assert_allclose(large.panels[0].right, 10 * usual.panels[0].right)
    np.testing.assert_allclose(
        large.sheets[0].corner - large.centre, 10 * (usual.sheets[0].corner - usual.centre)
    )
    assert rooms.furnish("booth:texture=0").panels[0].albedo.std() < 1e-6
    even = rooms.furnish("booth:glow=0.1")
    assert even.globes == ()
    assert 0 < np.concatenate([sheet.radiance for sheet in even.sheets]).std() < 0.1


def test_numbers_of_materials_and_the_bowl_change_what_they_say():
    chalk = things.stand(things.Thing("sphere", material="clay:specular=0:roughness=0.5"), 0).body
    assert chalk.specular == 0
    assert set(chalk.roughness) == {0.5}
    deep = [np.ptp(objects.model(f"bowl:deep={deep}").solid.vertices[:, 2]) for deep in (0.5, 2)]
    assert deep[1] > 2 * deep[0]


@pytest.mark.parametrize(
    "asked",
    ["booth:lamp=0.2", "booth:side=1", "booth:lamps=2", "booth:lamp", "study:side=4", "booth:glow=nan"],
)
def test_a_number_that_a_room_does_not_take_is_refused(asked):
    with pytest.raises(StudioError, match=asked):
        rooms.furnish(asked)


def test_unknown_names_say_what_there_is():
    with pytest.raises(StudioError, match="study"):
        rooms.furnish("cellar")
    with pytest.raises(StudioError, match="vase"):
        objects.model("bust")
    with pytest.raises(StudioError, match="gimbal"):
        motion.travel("crane", 3, CENTRE, 0)
    with pytest.raises(StudioError, match="at least 1"):
        motion.travel("gimbal", 0, CENTRE, 0)


def test_a_polished_floor_shows_the_room_upside_down():
    """Every point of a panel has its image below the floor: the same picture there, darker, seen from above."""
    floor = rooms.Panel(
        np.array([-2.0, 2.0, 0.0]), np.array([4.0, 0, 0]), np.array([0, -4.0, 0]), np.ones((2, 2, 3))
    )
    rng = np.random.default_rng(3)
    wall = rooms.Panel(
        np.array([-2.0, 2.0, 2.5]), np.array([4.0, 0, 0]), np.array([0, 0, -2.5]), rng.random((5, 8, 3))
    )
    globe = rooms.Globe(np.array([0.5, 1.0, 1.5]), 0.1, np.array([30.0, 20.0, 10.0]))
    room = rooms.Room("hall", (floor, wall), (globe,), (), CENTRE, polish=0.25)
    both, atlas = mirror.reflected(room, bake.pack(room.panels, [floor.albedo, wall.albedo]))
    assert len(both.panels) == 2
    np.testing.assert_allclose(both.globes[1].centre, [0.5, 1.0, -1.5])
    np.testing.assert_allclose(both.globes[1].radiance, 0.25 * globe.radiance)
    image = both.panels[1]
    np.testing.assert_allclose(
        np.cross(image.down, image.right), np.cross(wall.down, wall.right) * [1, 1, -1]
    )
    size = np.array(atlas.picture.shape[1::-1])
    (x0, y0), (x1, y1) = np.rint(atlas.low[1] * size).astype(int), np.rint(atlas.high[1] * size).astype(int)
    picture = atlas.picture[y0:y1, x0:x1]
    for down, right in ((0.1, 0.3), (0.9, 0.8)):
        at = wall.corner + right * wall.right + down * wall.down
        away = at * [1, 1, -1] - image.corner
        u, v = away @ image.right / (image.right @ image.right), away @ image.down / (image.down @ image.down)
        np.testing.assert_allclose(
            picture[int(5 * v), int(8 * u)], 0.25 * wall.albedo[int(5 * down), int(8 * right)], rtol=1e-6
        )


def test_a_floor_without_polish_changes_nothing(furnished):
    room = furnished["window"]
    atlas = bake.pack(room.panels, [p.albedo for p in room.panels])
    assert mirror.reflected(room, atlas) == (room, atlas)
