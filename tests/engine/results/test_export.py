"""An export appears whole or not at all, and other programs read what we wrote."""

import errno
import json
import math
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pycolmap
import pytest
import trimesh
from PIL import Image
from plyfile import PlyData

from engine.errors import Cancelled, ExportError
from engine.geometry import inverse
from engine.io import ply
from engine.io.poses.pose_files import read_poses
from engine.light.gaussians.gaussians import from_3dgs
from engine.progress import Progress
from engine.results import export
from engine.results.params import ExportParams
from engine.types import Gaussians, Lamps, LightProvenance, Panorama, Poses
from tests.engine.ball import CAMERA, ball
from tests.engine.results.test_metrics import ring

NAMES = ("my view", "render.0001", "c", "left/d")


def gaussians(count: int = 7) -> Gaussians:
    draw = np.random.default_rng(5)
    return Gaussians(
        means=draw.normal(size=(count, 3)),
        quaternions=draw.normal(size=(count, 4)),
        scales=draw.uniform(0.1, 0.5, (count, 3)),
        density=draw.uniform(0.1, 5.0, count),
        radiance=draw.normal(size=(count, 4, 3)),
    )


def lamps(count: int = 2) -> Lamps:
    draw = np.random.default_rng(6)
    return Lamps(
        centres=draw.normal(size=(count, 3)),
        radii=draw.uniform(0.05, 0.1, count),
        radiance=draw.uniform(5, 50, (count, 3)),
        clipped=np.arange(count) % 2 == 1,
    )


def poses(scale: str = "rig") -> Poses:
    cam_from_world = ring(4)
    cam_from_world[2] = np.nan
    registered = np.array([True, True, False, True])
    return Poses(CAMERA, cam_from_world, registered, np.zeros((0, 3)), scale, 0.3)


def panorama() -> Panorama:
    radiance = np.linspace(0, 40, 8 * 16 * 3).reshape(8, 16, 3)
    return Panorama("my view", radiance, np.repeat([[1.0], [0.0]], 4, 0) * np.ones((1, 16)))


def grounds() -> LightProvenance:
    kind = np.zeros((8, 16), np.uint8)
    kind[2:4], kind[4:] = 1, 2
    return LightProvenance(kind, 0.125, 0.0625)


def write(
    to: Path,
    params: ExportParams | None = None,
    progress: Progress | None = None,
    scale: str = "rig",
    surface=None,
):
    photographs = np.tile(np.linspace(0.01, 3, 64, dtype=np.float32)[:, None], (4, 48, 1, 3))
    export.write(
        to, surface or ball(), gaussians(), lamps(), poses(scale), NAMES, panorama(), grounds(), photographs,
        params or ExportParams(), progress or Progress(),
    )  # fmt: skip


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    to = tmp_path_factory.mktemp("export") / "out"
    write(to)
    return to


def test_the_index_lists_every_file(exported):
    index = json.loads((exported / "export.json").read_text())
    there = {str(path.relative_to(exported)) for path in exported.rglob("*") if path.is_file()}
    assert there == {*index["files"], "export.json"}
    assert {
        "maps.exr",
        "surface.ply",
        "surface.glb",
        "light.ply",
        "lamps.json",
        "light.exr",
        "transforms.json",
    } <= there
    assert index["unit_of_length"] == "metre"
    assert index["camera"]["fx"] == 70.0


def test_maps_come_back_with_the_named_channels_frame_units_and_camera(exported):
    surface = ball()
    with OpenEXR.File(str(exported / "maps.exr"), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    asked = (
        "normal.X normal.Y normal.Z albedo.R albedo.G albedo.B roughness.Y depth.Z mask.Y stderr.normal_deg"
    )
    assert set(asked.split()) <= set(channels)
    normal = np.stack([channels[f"normal.{axis}"] for axis in "XYZ"], -1)
    assert normal == pytest.approx(surface.normal, abs=1e-6)
    albedo = np.stack([channels[f"albedo.{colour}"] for colour in "RGB"], -1)
    assert albedo == pytest.approx(surface.albedo, abs=1e-6)
    assert channels["depth.Z"] == pytest.approx(surface.depth, abs=1e-6)
    assert channels["roughness.Y"] == pytest.approx(surface.roughness, abs=1e-6)
    assert (channels["mask.Y"] == surface.mask).all()
    assert channels["stderr.normal_deg"] == pytest.approx(np.degrees(surface.stderr_normal), abs=1e-5)
    assert (channels["flags.Y"] == surface.flags).all()
    assert not channels["part.Y"].any()  # of a run that did not tell them
    assert "0 too small to be told" in header["part"]
    assert not channels["stderr.part"].any()
    assert "z forward" in header["frame"]
    assert header["unit.depth"] == "metre"
    assert json.loads(header["camera"])["cx"] == 31.0


def test_the_panorama_keeps_high_radiance_and_says_what_was_guessed(exported):
    with OpenEXR.File(str(exported / "light.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
        assert "my view" in file.header()["frame"]
    assert np.stack([channels[c] for c in "RGB"], -1) == pytest.approx(panorama().radiance, abs=1e-5)
    assert channels["seen.Y"] == pytest.approx(panorama().seen)


def test_the_coverage_picture_and_the_index_say_what_the_light_rests_on(exported):
    image = Image.open(exported / "coverage.png")
    image.load()
    shown = np.asarray(image)
    assert shown.shape == (8, 16, 3)
    for rows, name, colour in (
        (slice(0, 2), "photographed", (0, 158, 115)),
        (slice(2, 4), "clipped", (240, 228, 66)),
        (slice(4, 8), "guessed", (213, 94, 0)),
    ):
        assert (shown[rows] == colour).all()
        assert f"{name}: sRGB {' '.join(map(str, colour))}" in image.info["Description"]
    index = json.loads((exported / "export.json").read_text())
    assert index["light_on_the_object"] == {"guessed": 0.125, "lower_bound": 0.0625}


def normals_of(path: Path, green_down: bool) -> np.ndarray:
    samples = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1].astype(float)
    shown = samples / (65535 if samples.max() > 255 else 255) * 2 - 1
    return shown * [1, 1 if green_down else -1, -1]


@pytest.mark.parametrize("convention", ["opengl", "directx"])
def test_the_normal_picture_says_its_convention_and_keeps_it(tmp_path, convention):
    write(tmp_path / "out", ExportParams(normal_png=convention))
    surface = ball()
    for name, within in (("normal_16.png", 1e-4), ("normal.png", 0.009)):
        decoded = normals_of(tmp_path / "out" / name, convention == "directx")
        assert decoded[surface.mask] == pytest.approx(surface.normal[surface.mask], abs=within)
        image = Image.open(tmp_path / "out" / name)
        image.load()
        assert ("up (OpenGL" if convention == "opengl" else "down (DirectX") in image.info["Description"]


def test_the_top_of_the_ball_is_green_in_opengl(exported):
    surface = ball()
    top = np.nonzero(surface.mask)[0].min()
    column = int(np.nonzero(surface.mask[top])[0].mean())
    red, green, _ = cv2.imread(str(exported / "normal.png"))[top, column, ::-1]
    assert green > 220
    assert abs(int(red) - 128) < 25


def test_depth_and_roughness_pictures_decode_to_the_maps(exported):
    surface = ball()
    image = Image.open(exported / "depth_16.png")
    image.load()
    near, far = float(image.info["near"]), float(image.info["far"])
    samples = cv2.imread(str(exported / "depth_16.png"), cv2.IMREAD_UNCHANGED).astype(float)
    assert ((samples == 0) == ~surface.mask).all()
    depth = near + (samples - 1) / 65534 * (far - near)
    assert depth[surface.mask] == pytest.approx(surface.depth[surface.mask], abs=(far - near) / 65534)
    rough = cv2.imread(str(exported / "roughness_16.png"), cv2.IMREAD_UNCHANGED) / 65535
    assert rough == pytest.approx(surface.roughness, abs=1e-5)
    linear = cv2.imread(str(exported / "albedo_linear_16.png"), cv2.IMREAD_UNCHANGED)[..., ::-1] / 65535
    assert linear == pytest.approx(surface.albedo, abs=1e-5)


@pytest.mark.parametrize("plain", [True, False])
def test_materials_are_written_as_maps_and_where_not_all_is_of_paint_as_pictures(tmp_path, plain):
    surface = ball()
    made = np.zeros((*surface.mask.shape, 2), np.float32)
    made[surface.mask] = [0.75, 0.0]
    made[surface.mask & (np.arange(64) >= 32)] = [0.5, 1.0]
    if not plain:
        surface = replace(surface, material=made)
    write(tmp_path / "out", surface=surface)
    with OpenEXR.File(str(tmp_path / "out" / "maps.exr"), separate_channels=True) as exr:
        level, metalness = (exr.channels()[name].pixels for name in ("specular.Y", "metalness.Y"))
    expected = np.where(surface.mask[..., None], [0.5, 0.0], 0) if plain else made
    np.testing.assert_allclose(np.stack([level, metalness], -1), expected)
    there = {name: tmp_path / "out" / f"{name}_16.png" for name in ("specular", "metalness")}
    assert all(path.exists() != plain for path in there.values())
    told = json.loads((tmp_path / "out" / "export.json").read_text())["png"]
    assert {"albedo", "albedo_linear_16", "roughness_16"} <= set(told)
    assert ({"specular_16", "metalness_16"} <= set(told)) != plain
    assert all((tmp_path / "out" / f"{name}.png").exists() for name in told)
    if not plain:
        for k, path in enumerate(there.values()):
            np.testing.assert_allclose(
                cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 65535, made[..., k], atol=1e-4
            )


def test_meshes_poses_and_light_open_in_other_programs(exported):
    assert len(trimesh.load(exported / "surface.glb").to_geometry().faces) > 1000
    assert len(PlyData.read(exported / "surface.ply")["face"]) > 1000
    back = from_3dgs({item.name: PlyData.read(exported / "light.ply")["vertex"][item.name]
                      for item in PlyData.read(exported / "light.ply")["vertex"].properties})  # fmt: skip
    assert back.means == pytest.approx(gaussians().means, abs=1e-5)
    assert back.radiance == pytest.approx(gaussians().radiance, abs=1e-4)
    model = pycolmap.Reconstruction(str(exported / "colmap"))
    shown = ["left/d.jpg", "my view.jpg", "render.0001.jpg"]
    assert sorted(image.name for image in model.images.values()) == shown
    first = next(image for image in model.images.values() if image.name == "my view.jpg")
    assert first.cam_from_world().matrix() == pytest.approx(poses().cam_from_world[0], abs=1e-9)
    listed = json.loads((exported / "transforms.json").read_text())["frames"]
    assert sorted(frame["file_path"] for frame in listed) == [f"images/{name}" for name in shown]
    for name in shown:
        assert cv2.imread(str(exported / "images" / name)).shape == (CAMERA.height, CAMERA.width, 3)
    world_from_gl = np.array(listed[0]["transform_matrix"])
    assert world_from_gl[:3, :3] @ np.diag([1, -1, -1]) == pytest.approx(
        inverse(poses().cam_from_world[0])[:, :3]
    )


def test_exported_poses_are_imported_again_with_the_photographs(exported):
    for made in ("transforms.json", "colmap"):
        found = read_poses(exported / made, [f"{name}.dng" for name in NAMES], (CAMERA.width, CAMERA.height))
        assert found.registered.tolist() == [True, True, False, True]
        assert found.cam_from_world[found.registered] == pytest.approx(
            poses().cam_from_world[[0, 1, 3]], abs=1e-9
        )
        assert found.camera.fx == CAMERA.fx


def test_pictures_of_views_are_all_exposed_alike(exported):
    pictures = [cv2.imread(str(exported / "images" / f"{NAMES[i]}.jpg")).astype(int) for i in (0, 1, 3)]
    exposed = cv2.imread(str(exported / "photograph.png")).astype(int)
    for picture in pictures:
        assert abs(picture - exposed).max() <= 4  # of JPEG
    assert pictures[0].max() == 255


def test_a_view_whose_name_leads_elsewhere_is_refused(tmp_path, monkeypatch):
    monkeypatch.setitem(globals(), "NAMES", ("my view", "../../out of here", "c", "d"))
    with pytest.raises(ExportError, match=r"out of here\.jpg: a view's name leads out of the export"):
        write(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_scale_is_said_so(tmp_path):
    write(tmp_path / "out", scale="unknown")
    assert json.loads((tmp_path / "out" / "export.json").read_text())["unit_of_length"] == "unknown"


def test_an_earlier_export_is_replaced_and_nothing_else_is(tmp_path):
    to = tmp_path / "out"
    write(to)
    write(to, ExportParams(normal_png="directx"))
    assert json.loads((to / "export.json").read_text())["png"]["normal"]["green"] == "down"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    (to / "my notes.txt").write_text("keep me")
    with pytest.raises(ExportError, match=r"holds my notes\.txt, which no export wrote"):
        write(to)
    assert (to / "my notes.txt").read_text() == "keep me"
    with pytest.raises(ExportError, match="not a plain folder"):
        write(to / "my notes.txt")


def test_a_stop_half_way_leaves_the_earlier_export_and_no_litter(tmp_path):
    to = tmp_path / "out"
    write(to)
    before = (to / "export.json").read_bytes()
    asked = iter([False, False, False, True])
    with pytest.raises(Cancelled):
        write(to, progress=Progress(cancelled=lambda: next(asked)))
    assert (to / "export.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("moment", ["out", ".out.partial"])
def test_a_stop_between_the_renames_loses_no_export(tmp_path, monkeypatch, moment):
    to, rename = tmp_path / "out", Path.rename
    write(to)
    before = (to / "export.json").read_bytes()

    def stopped(self: Path, target: Path) -> Path:
        if self.name == moment:
            if moment == "out":
                rename(self, target)
            raise KeyboardInterrupt
        return rename(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", stopped)
        with pytest.raises(KeyboardInterrupt):
            write(to, ExportParams(normal_png="directx"))
    assert (to / "export.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_export_that_a_killed_run_moved_away_is_put_back_before_anything_is_wiped(tmp_path):
    to = tmp_path / "out"
    write(to)
    before = (to / "export.json").read_bytes()
    to.rename(tmp_path / ".out.old")
    with pytest.raises(Cancelled):
        write(to, progress=Progress(cancelled=lambda: True))
    assert (to / "export.json").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("file/out", "another place"),
        ("file/a/out", "another place"),
        ("n" * 300, "shorter name"),
        ("n" * 250, "shorter name"),
    ],
)
def test_a_place_that_cannot_be_is_one_line_with_a_remedy(tmp_path, place, told):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ExportError, match=told):
        write(tmp_path / place)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_litter_of_a_killed_run_is_wiped(tmp_path):
    (tmp_path / ".out.partial").mkdir()
    (tmp_path / ".out.partial" / "half").write_text("")
    write(tmp_path / "out")
    assert not (tmp_path / "out" / "half").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("code", "remedy"),
    [(errno.ENOSPC, "free space"), (errno.EACCES, "may write to"), (errno.EIO, "check the disk")],
)
def test_a_refusal_of_the_system_is_one_line_with_a_remedy(tmp_path, monkeypatch, code, remedy):
    to = tmp_path / "out"
    write(to)
    before = sorted(path.name for path in to.rglob("*"))

    def refuse(*_args):
        partial = str(tmp_path / ".out.partial" / "surface.ply")
        raise OSError(code, os.strerror(code), "/session/surface.ply", None, partial)

    monkeypatch.setattr(ply, "surface_ply", refuse)
    with pytest.raises(ExportError, match=remedy) as told:
        write(to)
    assert str(told.value).startswith(f"{to / 'surface.ply'}: ")
    assert "\n" not in str(told.value)
    assert sorted(path.name for path in to.rglob("*")) == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_full_disk_while_writing_exr_is_told(tmp_path):
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full here")
    with pytest.raises(OSError, match="No space left"):
        export._write_exr(full, {"Y": np.zeros((64, 64))}, {})


def test_a_copy_of_an_export_is_the_same_files(exported, tmp_path):
    export.copy(exported, tmp_path / "there")
    assert (tmp_path / "there" / "surface.glb").read_bytes() == (exported / "surface.glb").read_bytes()
    assert (tmp_path / "there" / "colmap").is_dir()


@pytest.mark.parametrize("index", [None, b"", b"{}"])
def test_an_export_without_its_index_says_how_to_get_one(tmp_path, index):
    folder = tmp_path / "stages" / "export" / "0123"
    folder.mkdir(parents=True)
    if index is not None:
        (folder / "export.json").write_bytes(index)
    with pytest.raises(ExportError, match=rf"holds no export\.json .* remove {folder} and process again"):
        export.copy(folder, tmp_path / "elsewhere")


@pytest.mark.parametrize(
    ("made", "turned", "green"), [("opengl", "directx", "down"), ("directx", "opengl", "up")]
)
def test_a_copy_turns_green_as_if_it_had_been_made_so(tmp_path, made, turned, green):
    write(tmp_path / "made", ExportParams(normal_png=made))
    write(tmp_path / "wanted", ExportParams(normal_png=turned))
    export.copy(tmp_path / "made", tmp_path / "copied", green)
    inside = ball().mask
    for name in ("normal.png", "normal_16.png"):
        got, wanted = (
            cv2.imread(str(tmp_path / place / name), cv2.IMREAD_UNCHANGED).astype(int)
            for place in ("copied", "wanted")
        )
        # Halves are rounded the other way when a channel is turned round.
        assert abs(got - wanted).max() <= 1
        assert (got[inside] != cv2.imread(str(tmp_path / "made" / name), cv2.IMREAD_UNCHANGED)[inside]).any()
        assert Image.open(tmp_path / "copied" / name).text == Image.open(tmp_path / "wanted" / name).text
    assert json.loads((tmp_path / "copied" / "export.json").read_text())["png"]["normal"] == {"green": green}
    for name in ("albedo.png", "maps.exr", "surface.glb"):
        assert (tmp_path / "copied" / name).read_bytes() == (tmp_path / "made" / name).read_bytes()


def test_a_copy_with_green_as_it_is_changes_nothing(exported, tmp_path):
    export.copy(exported, tmp_path / "there", "up")
    for name in (*json.loads((exported / "export.json").read_text())["files"], "export.json"):
        assert (tmp_path / "there" / name).read_bytes() == (exported / name).read_bytes()


def test_a_copy_of_some_files_lists_those_and_can_be_replaced(exported, tmp_path):
    export.copy(exported, tmp_path / "there", files={"normal.png", "colmap/cameras.bin"})
    there = {
        str(path.relative_to(tmp_path / "there"))
        for path in (tmp_path / "there").rglob("*")
        if path.is_file()
    }
    assert there == {"normal.png", "colmap/cameras.bin", "export.json"}
    export.copy(exported, tmp_path / "there", files={"albedo.png"})
    stopped = Progress(cancelled=lambda: True)
    with pytest.raises(Cancelled):
        export.copy(exported, tmp_path / "there", progress=stopped)
    assert (tmp_path / "there" / "albedo.png").is_file()
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []
    assert not (tmp_path / "there" / "normal.png").exists()


@pytest.mark.parametrize(
    ("wish", "told"), [({"green": "left"}, "choose up"), ({"files": {"a.obj"}}, "holds no a.obj")]
)
def test_a_copy_that_cannot_be_meant_writes_nothing(exported, tmp_path, wish, told):
    with pytest.raises(ExportError, match=told):
        export.copy(exported, tmp_path / "there", **wish)
    assert not (tmp_path / "there").exists()


def test_the_same_result_gives_the_same_bytes(exported, tmp_path):
    write(tmp_path / "again")
    for name in json.loads((exported / "export.json").read_text())["files"]:
        assert (tmp_path / "again" / name).read_bytes() == (exported / name).read_bytes(), name


def test_unknown_choices_are_refused(tmp_path):
    with pytest.raises(ExportError, match="give opengl or directx"):
        write(tmp_path / "out", ExportParams(normal_png="blender"))
    assert list(tmp_path.iterdir()) == []


def test_a_surface_without_depth_is_refused_before_anything_appears(tmp_path):
    flat = replace(ball(), depth=np.zeros((48, 64)))
    with pytest.raises(ExportError, match="no three neighbouring"):
        export.write(tmp_path / "out", flat, gaussians(), lamps(), poses(), NAMES, panorama(), grounds(),
                     np.ones((4, 48, 64, 3)), ExportParams(), Progress())  # fmt: skip
    assert list(tmp_path.iterdir()) == []
    assert not math.isnan(flat.depth.sum())
