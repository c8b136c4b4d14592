"""Rooms and objects out of files: which names tables show, and that their content names their sets."""

from pathlib import Path

import pytest

from app.bench import choices, sets
from app.bench.record import BenchError
from app.bench.sizes import SIZES
from hardware.errors import StudioError
from hardware.virtual.studio import meshes, tracer
from hardware.virtual.studio.interior import read

ROOM = """<scene version="3.0.0">
<shape type="cube"><transform name="to_world"><scale value="2"/></transform>
<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{albedo}"/></bsdf></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><scale value=".5"/><rotate x="1" angle="90"/><translate y="1.9"/></transform>
<emitter type="area"><rgb name="radiance" value="10"/></emitter></shape></scene>"""
MESH = "v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setattr(
        meshes, "DIVIDED_FACES", 20_000
    )  # paint as fine as a picture shows is not looked at here


@pytest.fixture(autouse=True)
def rays_in_bundles() -> None:
    if not tracer.is_vectorised(tracer.load("cpu")):
        pytest.skip("no libLLVM here: scene files cannot be read")


def a_room(folder: Path, name: str = "scene.xml", albedo: float = 0.5) -> str:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(ROOM.format(albedo=albedo))
    return str(folder / name)


def a_mesh(folder: Path, name: str = "bust.obj", size: float = 1) -> str:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(MESH.format(size=size))
    return str(folder / name)


def test_our_own_rooms_and_objects_are_named_and_kept_as_ever() -> None:
    (room,), (thing,) = choices.rooms(("booth",)), choices.objects(("blob",), None, 0)
    assert (room, thing) == (choices.built_in("booth"), choices.built_in("blob"))
    assert (room.name, room.key, thing.material) == ("booth", "booth", None)


def test_files_are_named_by_their_stems_beside_ours_and_a_scene_by_its_folder(tmp_path: Path) -> None:
    asked = ("booth", a_room(tmp_path / "grey white-room"), a_room(tmp_path, "attic.xml"))
    assert [each.name for each in choices.rooms(asked)] == ["booth", "grey_white-room", "attic"]
    things = choices.objects((a_mesh(tmp_path), "blob"), "clay", 0)
    assert [(each.name, each.material) for each in things] == [("bust-clay", "clay"), ("blob", None)]


def test_files_of_one_name_are_told_apart_by_the_folders_above(tmp_path: Path) -> None:
    asked = (a_mesh(tmp_path / "a"), a_mesh(tmp_path / "b", size=2), a_mesh(tmp_path, "blob.obj"), "blob")
    names = [each.name for each in choices.objects(asked, None, 0)]
    assert names == ["a-bust", "b-bust", f"{tmp_path.name}-blob", "blob"]


def test_what_is_in_the_files_names_the_set_and_not_where_they_lie(tmp_path: Path) -> None:
    rooms = (
        a_room(tmp_path, "r.xml"),
        a_room(tmp_path / "moved", "r.xml"),
        a_room(tmp_path / "lighter", "r.xml", 0.6),
    )
    here, moved, lighter = (choices.rooms((each,))[0].key for each in rooms)
    assert here == moved != lighter
    things = (a_mesh(tmp_path), a_mesh(tmp_path / "moved"), a_mesh(tmp_path / "larger", size=2))
    here, moved, larger = (choices.objects((each,), None, 0)[0].key for each in things)
    assert here == moved != larger
    keys = {choices.objects((things[0],), *how)[0].key for how in ((None, 0), ("clay", 0), (None, 1))}
    assert len(keys) == 3
    assert not any(set(key) & set("/ ") for key in keys)


def test_a_place_a_size_and_a_turn_make_another_set_and_say_so(tmp_path: Path) -> None:
    scene, mesh = a_room(tmp_path / "attic"), a_mesh(tmp_path)
    (plain,), (placed,) = choices.rooms((scene,)), choices.rooms((scene,), (0.5, -1.0, 2.0))
    assert (placed.name, placed.key) == ("attic-at-0.5_-1_2", f"{plain.key}-at-0.5_-1_2")
    (usual, _), (small, ours), (turned, _) = (
        choices.objects((mesh, "blob"), "clay", 0, *how) for how in ((), (0.2,), (None, 180.0))
    )
    assert [each.name for each in (usual, small, turned)] == [
        "bust-clay",
        "bust-clay-0.2m",
        "bust-clay-180deg",
    ]
    assert len({each.key for each in (usual, small, turned)}) == 3
    assert ours == choices.built_in("blob")
    order = sets.order_of(placed, small, SIZES["quick"], 8, 1, "cpu")
    assert (order.place, order.object_size, order.turn_deg, order.material) == (
        (0.5, -1.0, 2.0),
        0.2,
        0.0,
        "clay",
    )
    assert sets.order_of(plain, turned, SIZES["quick"], 8, 1, "cpu").turn_deg == 180
    with pytest.raises(StudioError, match=r"an object is 0\.01 to 10 metres across"):
        choices.objects((mesh,), None, 0, 0.0)


def test_a_place_is_in_one_scene_file(tmp_path: Path) -> None:
    scenes = a_room(tmp_path / "a"), a_room(tmp_path / "b")
    for asked in (scenes, (scenes[0], "booth"), ("booth",)):
        with pytest.raises(
            BenchError, match=r"--place: is a place in one scene file, and --rooms names .*; name one"
        ):
            choices.rooms(asked, (0.0, 0.0, 0.0))


def test_a_known_room_is_not_loaded_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = a_room(tmp_path / "attic")
    known = choices.rooms((scene,))
    monkeypatch.setattr(read, "read", lambda path: pytest.fail("was loaded again"))
    assert choices.rooms((scene,)) == known


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("gone.xml", None, "there is no such scene file"),
        ("broken.xml", "<scene", "Mitsuba cannot load this scene"),
        ("dark.xml", ROOM.format(albedo=0.5).replace('value="10"', 'value="0"'), "no emitter"),
    ],
)
def test_a_room_that_cannot_be_used_is_refused_before_any_work(
    name: str, text: str | None, why: str, tmp_path: Path
) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(StudioError, match=why):
        choices.rooms((str(tmp_path / name),))


def test_one_file_named_twice_is_refused(tmp_path: Path) -> None:
    mesh = Path(a_mesh(tmp_path))
    with pytest.raises(BenchError, match="names one object twice"):
        choices.objects((str(mesh), str(mesh.parent / "." / ".." / tmp_path.name / mesh.name)), None, 0)


def test_a_material_is_for_meshes(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="is for mesh files"):
        choices.objects(("blob",), "clay", 0)
    with pytest.raises(StudioError, match="no material called 'wood'"):
        choices.objects((a_mesh(tmp_path),), "wood", 0)
