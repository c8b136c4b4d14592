"""Rooms out of scene files: their light is what physics says, objects in it are lit without bias, and what cannot be is refused."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hardware.errors import StudioError
from hardware.virtual.studio import meshes, objects, relight, shoot, solids, tracer, truth
from hardware.virtual.studio.interior import gather, glow, place, proposal, read
from hardware.virtual.studio.samples import Effort
from tests.hardware.virtual.studio.interior import scenes

SMALL = gather.Quality(300, (4,) * 10, (16,) * 4)
BARE = gather.Quality(100, (4,) * 2, (4,))


@pytest.fixture(scope="module")
def mi():
    mi = tracer.load("cpu")
    if not tracer.is_vectorised(mi):
        pytest.skip("no libLLVM here: rooms from files are refused")
    return mi


def baked(mi, path: Path, monkeypatch, quality: gather.Quality = SMALL) -> tuple[gather.Baked, glow.Room]:
    monkeypatch.setattr(gather, "QUALITY", quality)
    made = gather.bake(read.read(path), path.parent / "cache", "cpu", lambda share, note: None)
    return made, glow.Room(mi, made.room, made.grid, made.light)


def seen(mi, room: glow.Room, directions: np.ndarray) -> np.ndarray:
    ray = mi.Ray3f(mi.Point3f(0.0, 0.0, 0.0), mi.Vector3f(directions.T.astype(np.float32)))
    return np.array(room.meet(ray).radiance).T


def all_around(count: int) -> np.ndarray:
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_a_furnace_glows_as_all_its_bounces_say(mi, tmp_path, monkeypatch):
    path = scenes.scene(tmp_path / "furnace.xml", scenes.box(1.0, scenes.matte("0.7, 0.5, 0.2"), "1, 2, 3"))
    _, room = baked(mi, path, monkeypatch)
    radiance = seen(mi, room, all_around(2000))
    np.testing.assert_allclose(radiance.mean(0), [1 / 0.3, 2 / 0.5, 3 / 0.8], rtol=0.006)
    assert (radiance.std(0) < 0.03 * radiance.mean(0)).all()


def test_a_floor_under_an_even_sky_is_as_bright_as_its_albedo(mi, tmp_path, monkeypatch):
    down = '<transform name="to_world"><rotate x="1" angle="-90"/><translate y="-1"/></transform>'
    floor = f'<shape type="rectangle">{down}{scenes.matte("0.5")}</shape>'
    sky = '<emitter type="constant"><rgb name="radiance" value="1, 2, 4"/></emitter>'
    _, room = baked(mi, scenes.scene(tmp_path / "yard.xml", floor + sky), monkeypatch)
    np.testing.assert_allclose(seen(mi, room, np.array([[0, 0, -1.0]]))[0], [0.5, 1, 2], rtol=0.02)
    np.testing.assert_allclose(seen(mi, room, np.array([[0, 0, 1.0]]))[0], [1, 2, 4], rtol=1e-4)


def test_what_was_simplified_is_said_with_its_share(tmp_path, mi):
    mirror = '<bsdf type="conductor"/>'
    glass = '<shape type="sphere"><float name="radius" value="0.1"/><bsdf type="dielectric"/></shape>'
    room = read.read(
        scenes.scene(tmp_path / "odd.xml", scenes.box(1.0, mirror) + glass + scenes.lamp(0.9, 0.2, "1"))
    )
    assert any("mirrors, made diffuse (9" in note for note in room.notes)
    assert any("glass" in note and "left out" in note for note in room.notes)
    assert len(room.faces) == 12 + 2  # the glass ball is gone


def test_a_bake_that_was_cut_off_goes_on_and_ends_the_same(mi, tmp_path, monkeypatch):
    path = scenes.scene(
        tmp_path / "box.xml", scenes.box(1.0, scenes.matte("0.5")) + scenes.lamp(0.9, 0.3, "5")
    )
    whole, _ = baked(mi, path, monkeypatch, gather.Quality(100, (4,) * 6, (4,) * 2))
    room = read.read(path)

    def stop(share: float, note: str) -> None:
        if share > 0.8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gather.bake(room, tmp_path / "other", "cpu", stop)
    assert [p.name for p in (tmp_path / "other").glob("*.begun.npz")]
    again = gather.bake(room, tmp_path / "other", "cpu", lambda share, note: None)
    np.testing.assert_array_equal(again.light, whole.light)
    assert not list((tmp_path / "other").glob("*.begun.npz"))
    (kept,) = (tmp_path / "other").glob("*.npz")
    np.savez(kept, light=whole.light[:, 1:])
    with pytest.raises(
        StudioError, match=r"box-.*\.npz: holds the light of .* points, the room has \d+; remove it"
    ):
        gather.bake(room, tmp_path / "other", "cpu", lambda share, note: None)


def test_an_object_is_lit_as_a_plain_path_trace_says(mi, tmp_path, monkeypatch):
    """Walls of their own colours that reflect nothing, a small lamp, and a dent in the body that lights itself."""
    colours = ("2, .5, .3", ".2, .9, .4", ".3, .4, 1.2", "1, 1, .2", ".1, .1, .1", ".6, .2, .9")
    turns = ('y="1" angle="90"', 'y="1" angle="-90"', 'x="1" angle="90"', 'x="1" angle="-90"', 'y="1" angle="0"',
             'y="1" angle="180"')  # fmt: skip
    walls = "".join(
        f'<shape type="rectangle"><transform name="to_world"><translate z="-1"/><rotate {turn}/></transform>'
        f'{scenes.matte("0")}<emitter type="area"><rgb name="radiance" value="{colour}"/></emitter></shape>'
        for turn, colour in zip(turns, colours, strict=True)
    )
    inner = walls + scenes.lamp(0.8, 0.25, "10, 8, 7")
    made, room = baked(mi, scenes.scene(tmp_path / "walls.xml", inner), monkeypatch)
    t = np.linspace(0, np.pi / 2, 24)
    outer = np.stack([0.1 * np.sin(t), 0.1 * np.cos(t)], 1)
    dent = np.stack([0.085 * np.sin(t[::-1]), 0.085 * np.cos(t[::-1])], 1)
    cup = solids.lathe(np.concatenate([outer, dent]), 48, lambda r, _: r + 0 * _, crease_deg=50.0)
    cup = solids.moved(cup, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.45]))
    count = len(cup.vertices)
    body = objects.Body("cup", cup, np.full((count, 3), 0.7), np.full(count, 0.35))
    mask = truth.maps(body, 24, 18)["mask"]
    cam_from_world = np.column_stack([made.room.world_from_scene.T, [0.05, 0.0, 0.45]])
    lit = relight.Relighter(proposal.Proposal(room, cup.vertices), body, mask)
    fast = np.stack(
        [lit.look(cam_from_world[None], Effort(256, 256, (512,)), s, lambda _: None)[0] for s in range(4)]
    )
    world = made.room.world_from_scene
    plain = mi.load_file(str(tmp_path / "walls.xml"), optimize=False)
    to_scene = np.eye(4)
    to_scene[:3, :3], to_scene[:3, 3] = (
        (cam_from_world[:, :3] @ world).T,
        -(cam_from_world[:, :3] @ world).T @ cam_from_world[:, 3],
    )
    moved = solids.moved(cup, to_scene[:3, :3], to_scene[:3, 3])
    there = objects.Body("cup", moved, body.albedo, body.roughness)
    whole = mi.load_dict({
        "type": "scene", "integrator": {"type": "path", "max_depth": 8}, "body": tracer.body_mesh(mi, there),
        **{f"wall{k}": shape for k, shape in enumerate(plain.shapes())},
        "sensor": tracer.lens(mi, 24, 18, truth.FIELD_OF_VIEW_DEG),
    })  # fmt: skip
    tracer.place(mi, whole.sensors()[0], to_scene[:3])
    slow = np.stack([np.array(mi.render(whole, spp=4096, seed=s))[mask] for s in range(4)])
    bias = fast.mean((0, 1)) / slow.mean((0, 1)) - 1
    assert np.abs(bias).max() < 0.003
    error = np.sqrt((fast.var(0, ddof=1) + slow.var(0, ddof=1)) / 4)
    assert (np.abs(fast.mean(0) - slow.mean(0)) < 6 * error + 0.01 * slow.mean(0)).mean() > 0.97


def order(room: Path, thing: Path, **changes: object) -> shoot.Order:
    facts = {"room": str(room), "thing": str(thing), "views": 3, "width": 32, "height": 24, "motion": "gimbal",
             "seed": 0, "device": "cpu"} | changes  # fmt: skip
    return shoot.Order(**facts)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def furnished(tmp_path_factory, mi) -> Iterator[tuple[Path, Path]]:
    """A scene, baked once, and a mesh."""
    folder = tmp_path_factory.mktemp("furnished")
    inner = scenes.box(1.5, scenes.matte("0.5")) + scenes.lamp(1.4, 0.4, "5")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gather, "QUALITY", BARE)
        patch.setattr(meshes, "DIVIDED_FACES", 20_000)
        yield scenes.scene(folder / "box.xml", inner), scenes.ball(folder / "ball.obj")


def build(wanted: shoot.Order) -> shoot.Studio:
    return shoot.build(wanted, Path(wanted.room).parent / "cache", lambda share, note: None)


def test_a_place_is_found_where_camera_and_object_meet_nothing(furnished):
    studio = build(order(*furnished, views=12))
    poses = studio.journey.world_from_cam
    there = np.einsum("nij,pj->npi", poses[:, :, :3], studio.body.solid.vertices) + poses[:, None, :, 3]
    assert np.abs(there).max() < 1.5
    assert any("the rig stands at --place" in note for note in studio.notes)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"object_size": 2.0}, "the rig fits nowhere in this room"),
        ({"place": (1.4, 0.0, 0.0)}, "a surface stands 0.1"),
        ({"place": (40.0, 0.0, 0.0)}, "nearly no surface is seen from there"),
        ({"object_size": 1e-4}, "an object is 0.01 to 10 metres across"),
        ({"material": "velvet"}, "no material called 'velvet'; choose one of paint"),
        ({"material": "from-file"}, "says nothing of its colours"),
    ],
)
def test_what_cannot_stand_there_is_refused(furnished, changes, told):
    with pytest.raises(StudioError, match=told):
        build(order(*furnished, **changes))


@pytest.mark.parametrize(
    ("inner", "told"),
    [
        ("<shape", "Mitsuba cannot load this scene"),
        ('<shape type="teapot"/>', "Mitsuba cannot load this scene"),
        ('<shape type="obj"><string name="filename" value="gone.obj"/></shape>', "gone.obj"),
        ('<shape type="cube"><bsdf type="diffuse"><texture name="reflectance" type="bitmap">'
         '<string name="filename" value="gone.png"/></texture></bsdf></shape>', "gone.png"),
        ("", "holds no surface"),
        (scenes.box(1.0, scenes.matte("0.5")), "no emitter that gives light"),
        (scenes.box(2000.0, scenes.matte("0.5"), "1"), "4e\\+03 metres across"),
        (scenes.box(0.0005, scenes.matte("0.5"), "1"), "0.001 metres across"),
        (scenes.box(1.0, scenes.matte("0.5")) + '<emitter type="spot"/>', "SpotLight, which cannot be baked"),
    ],
)  # fmt: skip
def test_a_scene_that_cannot_be_a_room_is_refused_by_name(tmp_path, mi, inner, told):
    path = scenes.scene(tmp_path / "bad.xml", inner)
    with pytest.raises(StudioError, match=told) as refused:
        read.read(path)
    assert str(path) in str(refused.value)


def test_a_sweep_reaches_as_far_as_what_it_holds():
    poses = np.eye(4)[None, :3]
    reach = place.sweep(poses, np.array([[0.0, 0.0, 2.0]]), 1.0)
    assert reach.reach[reach.directions[:, 2].argmax()] == pytest.approx(2.0)
    assert reach.reach.min() == pytest.approx(1.0)
