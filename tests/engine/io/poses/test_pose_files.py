"""Promises of `engine.io.poses.pose_files` and the formats behind it."""

import json
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from engine.errors import PoseError
from engine.geometry import inverse, project
from engine.io.poses.colmap import quaternion_of, rotation_of
from engine.io.poses.pose_files import read_poses, write_colmap, write_transforms
from engine.types import Camera, Poses

LENS = Camera(640, 480, 500.5, 501.25, 322.5, 238.25, k1=-0.08, k2=0.02, p1=0.001, p2=-0.002)


def random_poses(seed: int, count: int = 9, camera: Camera = LENS) -> Poses:
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(count, random_state=rng).as_matrix()
    shift = rng.normal(size=(count, 3, 1)) * 3
    return Poses(
        camera, np.concatenate([rotation, shift], axis=2), np.ones(count, dtype=bool),
        rng.normal(size=(20, 3)), "unknown", 0.5,
    )  # fmt: skip


def names_of(poses: Poses) -> list[str]:
    return [f"{i:04d}.exr" for i in range(len(poses.registered))]


def metashape_xml(poses: Poses, names: list[str], extra: str = "", chunk: str = "") -> str:
    c = poses.camera
    cameras = "".join(
        f'<camera id="{i}" sensor_id="0" label="{Path(n).stem}"><transform>'
        + " ".join(repr(float(v)) for v in [*inverse(m).ravel(), 0, 0, 0, 1])
        + "</transform></camera>"
        for i, (n, m) in enumerate(zip(names, poses.cam_from_world, strict=True))
    )
    # Written from the manual: offsets from the centre, f + b1 along x, p1 and p2 the other way round.
    return f"""<?xml version="1.0"?><document version="2.0.0"><chunk label="a" enabled="true"><sensors>
      <sensor id="0" type="frame"><resolution width="{c.width}" height="{c.height}"/>
      <calibration type="frame" class="initial"><f>1.0</f></calibration>
      <calibration type="frame" class="adjusted"><resolution width="{c.width}" height="{c.height}"/>
      <f>{c.fy!r}</f><b1>{c.fx - c.fy!r}</b1><cx>{c.cx - c.width / 2!r}</cx><cy>{c.cy - c.height / 2!r}</cy>
      <k1>{c.k1!r}</k1><k2>{c.k2!r}</k2><p1>{c.p2!r}</p1><p2>{c.p1!r}</p2>{extra}</calibration>
      </sensor></sensors><cameras>{cameras}</cameras>{chunk}</chunk></document>"""


def rewritten(folder: Path, poses: Poses, names: list[str], binary: bool) -> Path:
    """The model as COLMAP itself writes it."""
    write_colmap(folder.parent / "own", poses, names)
    folder.mkdir(parents=True)
    theirs = pycolmap.Reconstruction(str(folder.parent / "own"))
    (theirs.write_binary if binary else theirs.write_text)(str(folder))
    return folder


def check_same(path: Path, poses: Poses, names: list[str]) -> None:
    found = read_poses(path, names, (poses.camera.width, poses.camera.height))
    np.testing.assert_allclose(found.cam_from_world, poses.cam_from_world, atol=1e-9)
    for field in ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"):
        assert getattr(found.camera, field) == pytest.approx(getattr(poses.camera, field), abs=1e-9)
    assert found.registered.all()


@settings(max_examples=12)
@given(seed=st.integers(0, 2**31))
def test_poses_survive_every_format(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    folder = tmp_path_factory.mktemp("formats")
    poses = random_poses(seed)
    names = names_of(poses)
    write_transforms(folder / "transforms.json", poses, names)
    write_colmap(folder / "model", poses, names)
    rewritten(folder / "scene" / "sparse" / "0", poses, names, binary=True)
    rewritten(folder / "text", poses, names, binary=False)
    (folder / "cameras.xml").write_text(metashape_xml(poses, names))
    for given_file in ("transforms.json", "model", "scene", "text", "cameras.xml"):
        check_same(folder / given_file, poses, names)
    np.testing.assert_allclose(
        read_poses(folder / "scene", names, (640, 480)).points, poses.points, atol=1e-12
    )


@settings(max_examples=50)
@given(seed=st.integers(0, 2**31), angle=st.sampled_from([1e-9, 1e-3, 1.0, np.pi - 1e-9, np.pi]))
def test_quaternions_are_exact_near_none_and_half_turns(seed: int, angle: float) -> None:
    axis = np.random.default_rng(seed).normal(size=3)
    rotation = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
    np.testing.assert_allclose(rotation_of(quaternion_of(rotation)), rotation, atol=1e-12)


def test_pycolmap_projects_through_our_model_as_we_do(tmp_path: Path) -> None:
    poses = random_poses(3)
    write_colmap(tmp_path, poses, names_of(poses))
    model = pycolmap.Reconstruction(str(tmp_path))
    cam_points = np.array([[0.2, -0.1, 1.5], [-0.4, 0.3, 2.0]])
    theirs = model.cameras[1].img_from_cam(cam_points)
    np.testing.assert_allclose(project(poses.camera, cam_points), theirs, atol=1e-9)
    image = next(i for i in model.images.values() if i.name == "0004.exr")
    np.testing.assert_allclose(image.cam_from_world().matrix(), poses.cam_from_world[4], atol=1e-12)


def test_opengl_hand_value(tmp_path: Path) -> None:
    """An OpenGL camera at (1, 2, 3) without rotation looks along world -z, with world +y up."""
    matrix = np.eye(4)
    matrix[:3, 3] = [1, 2, 3]
    frames = [{"file_path": "./images/a.png", "transform_matrix": matrix.tolist()}]
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({"camera_angle_x": np.pi / 2, "frames": frames}))
    found = read_poses(path, ["a"], (200, 100))
    assert (found.camera.fx, found.camera.fy) == pytest.approx((100, 100))
    assert (found.camera.cx, found.camera.cy) == (100, 50)
    ahead = found.cam_from_world[0] @ [1, 2, -7, 1]  # ten units ahead
    np.testing.assert_allclose(ahead, [0, 0, 10], atol=1e-12)
    above = found.cam_from_world[0] @ [1, 3, 3, 1]
    np.testing.assert_allclose(above, [0, -1, 0], atol=1e-12)  # our y points down


def test_rows_follow_the_asked_names_not_the_file(tmp_path: Path) -> None:
    poses = random_poses(1)
    write_transforms(tmp_path / "t.json", poses, [f"images/{n}" for n in names_of(poses)])
    found = read_poses(tmp_path / "t.json", ["0005", "0002.dng"], (640, 480))
    np.testing.assert_allclose(found.cam_from_world, poses.cam_from_world[[5, 2]], atol=1e-9)


def test_unregistered_views_are_left_out_and_come_back_as_nan(tmp_path: Path) -> None:
    full = random_poses(2)
    keep = np.arange(9) != 4
    cam_from_world = np.where(keep[:, None, None], full.cam_from_world, np.nan)
    poses = Poses(full.camera, cam_from_world, keep, full.points, "unknown", 0.5)
    write_colmap(tmp_path / "m", poses, names_of(poses))
    found = read_poses(tmp_path / "m", names_of(poses), (640, 480))
    np.testing.assert_array_equal(found.registered, keep)
    assert np.isnan(found.cam_from_world[4]).all()


def test_poses_of_other_photographs_are_refused_with_names(tmp_path: Path) -> None:
    poses = random_poses(1)
    write_transforms(tmp_path / "t.json", poses, names_of(poses))
    with pytest.raises(PoseError, match=r"t\.json: no pose for 1 of 2 .*IMG_7.*0000\.exr"):
        read_poses(tmp_path / "t.json", ["0001", "IMG_7"], (640, 480))
    write_colmap(tmp_path / "m", poses, names_of(poses))
    with pytest.raises(PoseError, match="no pose for 3 of 4"):
        read_poses(tmp_path / "m", ["0001", "a", "b", "c"], (640, 480))


def test_two_candidates_for_one_photograph_are_refused(tmp_path: Path) -> None:
    poses = random_poses(1, 2)
    write_transforms(tmp_path / "t.json", poses, ["left/a.png", "right/a.png"])
    with pytest.raises(PoseError, match=r"a could be any of left/a\.png, right/a\.png"):
        read_poses(tmp_path / "t.json", ["a"], (640, 480))


@pytest.mark.parametrize(
    ("spoil", "cause"),
    [
        (lambda m: m[:3, :3].__imul__(1.1), "not orthonormal"),
        (lambda m: m[:3, 0].__imul__(-1), "mirrors"),
        (lambda m: m.__setitem__((0, 3), np.nan), "NaN"),
    ],
)
def test_matrices_that_are_not_rigid_are_refused(tmp_path: Path, spoil, cause: str) -> None:
    path = tmp_path / "t.json"
    poses = random_poses(1)
    write_transforms(path, poses, names_of(poses))
    table = json.loads(path.read_text())
    matrix = np.array(table["frames"][3]["transform_matrix"])
    spoil(matrix)
    table["frames"][3]["transform_matrix"] = matrix.tolist()
    path.write_text(json.dumps(table))
    with pytest.raises(PoseError, match=rf"t\.json: 0003\.exr: .*{cause}"):
        read_poses(path, names_of(poses), (640, 480))


def test_intrinsics_scale_to_the_photographs_only_at_the_same_aspect(tmp_path: Path) -> None:
    poses = random_poses(1)
    write_colmap(tmp_path, poses, names_of(poses))
    half = read_poses(tmp_path, names_of(poses), (320, 240))
    assert half.camera.fx == pytest.approx(LENS.fx / 2)
    assert half.camera.cy == pytest.approx(LENS.cy / 2)
    assert half.notes == ("intrinsics rescaled from 640 x 480 to 320 x 240",)
    with pytest.raises(PoseError, match="640 x 480 but the photographs are 480 x 640, another aspect"):
        read_poses(tmp_path, names_of(poses), (480, 640))


def test_metashape_chunk_transform_sets_the_world(tmp_path: Path) -> None:
    poses = random_poses(5)
    turn = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
    chunk = (
        f"<transform><rotation>{' '.join(map(repr, turn.ravel().tolist()))}</rotation>"
        "<translation>1 2 3</translation><scale>2.5</scale></transform>"
    )
    (tmp_path / "c.xml").write_text(metashape_xml(poses, names_of(poses), chunk=chunk))
    found = read_poses(tmp_path / "c.xml", names_of(poses), (640, 480))
    centres = inverse(found.cam_from_world)[..., 3]
    chunk_centres = inverse(poses.cam_from_world)[..., 3]
    np.testing.assert_allclose(centres, 2.5 * chunk_centres @ turn.T + [1, 2, 3], atol=1e-9)
    assert found.scale == "given"


def test_a_third_radial_term_is_folded_in_when_two_can_say_the_same(tmp_path: Path) -> None:
    poses = random_poses(5)
    (tmp_path / "c.xml").write_text(metashape_xml(poses, names_of(poses), extra="<k3>0.005</k3>"))
    camera = read_poses(tmp_path / "c.xml", names_of(poses), (640, 480)).camera
    assert camera.k2 != LENS.k2
    x = np.array([[0.5, 0.3, 1.0]])
    r2 = 0.34
    moved = project(camera, x) - project(LENS, x)
    assert np.linalg.norm(moved - 0.005 * r2**3 * x[:, :2] * LENS.fx) < 0.1
    (tmp_path / "d.xml").write_text(metashape_xml(poses, names_of(poses), extra="<k3>0.5</k3>"))
    with pytest.raises(PoseError, match="needs more terms"):
        read_poses(tmp_path / "d.xml", names_of(poses), (640, 480))


def test_only_adjusted_metashape_calibration_counts(tmp_path: Path) -> None:
    poses = random_poses(5)
    text = metashape_xml(poses, names_of(poses)).replace('class="adjusted"', 'class="initial"')
    (tmp_path / "c.xml").write_text(text)
    with pytest.raises(PoseError, match="no calibration of class adjusted"):
        read_poses(tmp_path / "c.xml", names_of(poses), (640, 480))


@pytest.mark.parametrize("model", ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"])
@pytest.mark.parametrize("binary", [False, True])
def test_every_supported_colmap_lens_reads_as_pycolmap_sees_it(
    tmp_path: Path, model: str, binary: bool
) -> None:
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_cameras_per_rig=1, num_frames_per_rig=5, num_points3D=30, camera_width=640,
        camera_height=480, camera_model_id=getattr(pycolmap.CameraModelId, model),
        camera_params={"SIMPLE_PINHOLE": [400, 320, 240], "PINHOLE": [400, 410, 320, 240],
                       "SIMPLE_RADIAL": [400, 320, 240, 0.1], "RADIAL": [400, 320, 240, 0.1, -0.02],
                       "OPENCV": [400, 410, 320, 240, 0.1, -0.02, 0.001, 0.002]}[model],
    )  # fmt: skip
    theirs = pycolmap.synthesize_dataset(options)
    (theirs.write_binary if binary else theirs.write_text)(str(tmp_path))
    images = sorted(theirs.images.values(), key=lambda image: image.name)
    found = read_poses(tmp_path, [image.name for image in images], (640, 480))
    for row, image in zip(found.cam_from_world, images, strict=True):
        np.testing.assert_allclose(row, image.cam_from_world().matrix(), atol=1e-9)
    x = np.array([[0.3, -0.2, 1.0]])
    np.testing.assert_allclose(project(found.camera, x), theirs.cameras[1].img_from_cam(x), atol=1e-6)
    assert len(found.points) == theirs.num_points3D()


def test_unsupported_lenses_are_named(tmp_path: Path) -> None:
    poses = random_poses(1)
    rewritten(tmp_path / "m", poses, names_of(poses), binary=False)
    (tmp_path / "m" / "cameras.txt").write_text("1 OPENCV_FISHEYE 640 480 1 2 3 4 5 6 7 8\n")
    with pytest.raises(PoseError, match="OPENCV_FISHEYE is not supported"):
        read_poses(tmp_path / "m", names_of(poses), (640, 480))
    write_transforms(tmp_path / "t.json", poses, names_of(poses))
    text = (tmp_path / "t.json").read_text().replace('"OPENCV"', '"OPENCV_FISHEYE"')
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(PoseError, match="OPENCV_FISHEYE is not supported"):
        read_poses(tmp_path / "t.json", names_of(poses), (640, 480))


def test_damaged_files_are_refused_by_name(tmp_path: Path) -> None:
    poses = random_poses(1)
    names = names_of(poses)
    write_colmap(tmp_path / "bin", poses, names)
    whole = (tmp_path / "bin" / "images.bin").read_bytes()
    for length in (4, 100, len(whole) - 4):
        (tmp_path / "bin" / "images.bin").write_bytes(whole[:length])
        with pytest.raises(PoseError, match=r"bin: the COLMAP model cannot be read"):
            read_poses(tmp_path / "bin", names, (640, 480))
    (tmp_path / "t.json").write_text('{"frames": [{"file_path": ')
    (tmp_path / "e.json").write_text('{"frames": []}')
    (tmp_path / "c.xml").write_text("<document><chunk>")
    (tmp_path / "n.csv").write_text("")
    for name in ("t.json", "e.json", "c.xml", "n.csv", "nothing"):
        with pytest.raises(PoseError, match=name):
            read_poses(tmp_path / name, names, (640, 480))


@pytest.mark.parametrize(
    ("broken", "cause"),
    [
        ({"fl_x": None, "camera_angle_x": 0}, "camera_angle_x is 0"),
        ({"fl_x": None, "camera_angle_x": 3.2}, "camera_angle_x is 3.2"),
        ({"fl_x": None, "fl_y": None, "camera_angle_y": 0}, "camera_angle_y is 0"),
        ({"fl_x": 0, "camera_angle_x": None}, "no focal length"),
        ({"fl_y": -1}, "no focal length"),
        ({"w": 0}, "no size"),
    ],
)
def test_transforms_of_no_camera_are_refused(tmp_path: Path, broken: dict, cause: str) -> None:
    poses = random_poses(1)
    path = tmp_path / "t.json"
    write_transforms(path, poses, names_of(poses))
    table = json.loads(path.read_text()) | broken
    path.write_text(json.dumps({key: value for key, value in table.items() if value is not None}))
    with pytest.raises(PoseError, match=rf"t\.json: .*{cause}"):
        read_poses(path, names_of(poses), (640, 480))


@pytest.mark.parametrize(
    "broken",
    [
        ('width="640"', 'width="0"'),
        ('height="480"', 'height="0"'),
        ("<f>501.25", "<f>0"),
        ("<k1>-0.08", "<k1>nan"),
    ],
)
@pytest.mark.parametrize("extra", ["", "<k3>0.005</k3>"])
def test_a_metashape_calibration_of_no_camera_is_refused(
    tmp_path: Path, broken: tuple[str, str], extra: str
) -> None:
    poses = random_poses(5)
    text = metashape_xml(poses, names_of(poses), extra=extra)
    assert broken[0] in text
    (tmp_path / "c.xml").write_text(text.replace(*broken))
    with pytest.raises(PoseError, match=r"c\.xml: not a Metashape camera file .*not (positive|finite)"):
        read_poses(tmp_path / "c.xml", names_of(poses), (640, 480))


def transforms(path: Path, poses: Poses, names: list[str], spoil=lambda table: None) -> Path:
    write_transforms(path, poses, names)
    table = json.loads(path.read_text())
    spoil(table)
    path.write_text(json.dumps(table))
    return path


def model_text(folder: Path, lines: list[str], cameras: str = "1 PINHOLE 640 480 500 500 320 240\n") -> Path:
    folder.mkdir()
    (folder / "cameras.txt").write_text(cameras)
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    return folder


def image_lines(poses: Poses, names: list[str], camera: int = 1, length: float = 1.0) -> list[str]:
    return [
        " ".join(map(repr, [i, *(length * quaternion_of(m[:, :3])).tolist(), *m[:, 3].tolist(), camera]))
        + " "
        + name
        for i, (name, m) in enumerate(zip(names, poses.cam_from_world, strict=True))
    ]


def test_only_what_belongs_to_the_photographs_is_looked_at(tmp_path: Path) -> None:
    """A broken matrix, another camera, a lens we lack or a fisheye of an image that is none of ours."""
    poses = random_poses(4)
    ours, names = names_of(poses)[:7], [*names_of(poses)[:7], "other/x.jpg", "y.jpg"]

    def spoil(table: dict) -> None:
        table["frames"][7] |= {"fl_x": 3.0, "camera_model": "OPENCV_FISHEYE"}
        table["frames"][8] |= {"transform_matrix": [[0, 0, 0]]}
        table["frames"] += [
            {"file_path": "z.png"},
            {"transform_matrix": 1},
            "nothing",
            {"file_path": "z.png"},
        ]

    files = [transforms(tmp_path / "t.json", poses, names, spoil)]
    lines = image_lines(poses, names)
    lines[7] = lines[7].replace(" 1 other", " 2 other")
    lines[8] = "9 0 0 0 0 nan 0 0 3 y.jpg"
    lenses = "1 PINHOLE 640 480 500 500 320 240\n2 OPENCV_FISHEYE 9 9 1 1 1 1 0 0 0 0\n"
    files.append(model_text(tmp_path / "m", lines, lenses))
    text = metashape_xml(poses, names, chunk='<sensors><sensor id="1" type="fisheye"/></sensors>')
    text = text.replace('sensor_id="0" label="x"', 'sensor_id="1" label="x"')
    text = text.replace('label="y"><transform>', 'label="y"><transform>nan ')
    files.append(tmp_path / "c.xml")
    files[-1].write_text(text)
    for file in files:
        found = read_poses(file, ours, (640, 480))
        np.testing.assert_allclose(found.cam_from_world, poses.cam_from_world[:7], atol=1e-9)
        with pytest.raises(PoseError, match=file.name):
            read_poses(file, [*ours, "x.dng"], (640, 480))
        with pytest.raises(PoseError, match=file.name):
            read_poses(file, [*ours, "y.dng"], (640, 480))


@pytest.mark.parametrize("kind", ["t.json", "m", "c.xml"])
def test_a_file_may_lack_the_smaller_part_of_the_views_and_they_are_named(tmp_path: Path, kind: str) -> None:
    full = random_poses(2)

    def made(count: int) -> Path:
        to = tmp_path / str(count) / kind
        to.parent.mkdir()
        kept = Poses(
            full.camera, full.cam_from_world[:count], full.registered[:count], full.points, "given", 0.0
        )
        names = names_of(full)[:count]
        if kind == "m":
            write_colmap(to, kept, names)
        elif kind == "t.json":
            write_transforms(to, kept, names)
        else:
            to.write_text(metashape_xml(kept, names))
        return to

    found = read_poses(made(5), names_of(full), (640, 480))
    assert found.registered.tolist() == [True] * 5 + [False] * 4
    assert found.notes == ("no pose for 4 of 9 photographs: 0005.exr, 0006.exr, 0007.exr, ...",)
    with pytest.raises(PoseError, match=r"no pose for 5 of 9 photographs \(0004\.exr, 0005\.exr"):
        read_poses(made(4), names_of(full), (640, 480))


@pytest.mark.parametrize(
    ("theirs", "photograph"),
    [
        ("./images/render.0001", "render.0001.exr"),
        ("render.0001.PNG", "render.0001.exr"),
        ("render.0001", "RENDER.0001.EXR"),
        ("C:\\shots\\left\\my view 1.jpg", "left/my view 1.dng"),
        ("images/caf\u00e9.jpg", "cafe\u0301.NEF"),
        ("IMG_1.dng.jpg", "IMG_1.dng"),
        ("scan.v2", "scan.v2.dng"),
        ("a%20b.png", "a%20b.dng"),
    ],
)  # fmt: skip
def test_names_agree_whatever_their_suffix_folder_and_case(
    tmp_path: Path, theirs: str, photograph: str
) -> None:
    poses = random_poses(1, 3)
    # Others that are alike: no photograph of ours is meant by them.
    path = transforms(tmp_path / "t.json", poses, [theirs, "render.0002", "right/my view 1.5.jpg"])
    found = read_poses(path, [photograph], (640, 480))
    np.testing.assert_allclose(found.cam_from_world[0], poses.cam_from_world[0], atol=1e-9)


@pytest.mark.parametrize(
    ("theirs", "photographs", "cause"),
    [
        (["a.png", "a.jpg"], ["a.dng"], "a.dng could be any of a.png, a.jpg"),
        (["a.png", "a.png"], ["a.dng"], "a.dng could be any of a.png, a.png"),
        (["a.png"], ["left/a.dng", "right/a.dng"], "a.png could be left/a.dng or right/a.dng"),
        (["render.png"], ["render.0001.exr", "render.0002.exr"], "no pose for 2 of 2"),
        (["render.0001", "render.0002"], ["render.exr"], "no pose for 1 of 1"),
    ],
)
def test_a_name_that_fits_two_is_never_guessed(
    tmp_path: Path, theirs: list[str], photographs: list[str], cause: str
) -> None:
    path = transforms(tmp_path / "t.json", random_poses(1, len(theirs)), theirs)
    with pytest.raises(PoseError, match=cause):
        read_poses(path, photographs, (640, 480))


def test_folders_tell_like_names_apart_even_where_one_is_missing(tmp_path: Path) -> None:
    poses = random_poses(1, 5)
    theirs = [
        "images/right/a.png",
        "images/left/b.png",
        "images/right/b.png",
        "images/left/c.png",
        "images/right/c.png",
    ]
    path = transforms(tmp_path / "t.json", poses, theirs)
    ours = [f"{side}/{name}.dng" for name in "abc" for side in ("left", "right")]
    found = read_poses(path, ours, (640, 480))
    np.testing.assert_allclose(found.cam_from_world[1:], poses.cam_from_world, atol=1e-9)
    assert found.notes == ("no pose for 1 of 6 photographs: left/a.dng",)


def test_a_view_is_known_by_any_of_its_exposures_and_the_first_with_a_pose_counts(tmp_path: Path) -> None:
    poses = random_poses(1, 3)
    path = transforms(tmp_path / "t.json", poses, ["IMG_2.jpg", "IMG_3.jpg", "IMG_4.jpg"])
    found = read_poses(path, [("IMG_1.dng", "IMG_2.dng"), ("IMG_3.dng", "IMG_4.dng")], (640, 480))
    np.testing.assert_allclose(found.cam_from_world, poses.cam_from_world[:2], atol=1e-9)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_read_in_every_text_format(tmp_path: Path, encoding: str) -> None:
    poses = random_poses(1)
    write_transforms(tmp_path / "t.json", poses, names_of(poses))
    text = metashape_xml(poses, names_of(poses)).replace(
        'version="1.0"', f'version="1.0" encoding="{encoding[:6]}"'
    )
    (tmp_path / "c.xml").write_text(text.replace('"utf-8-"', '"utf-8"'))
    rewritten(tmp_path / "m", poses, names_of(poses), binary=False)
    for file in (tmp_path / "t.json", tmp_path / "c.xml", *(tmp_path / "m").glob("*.txt")):
        file.write_text(file.read_text(), encoding=encoding)
    for file in ("t.json", "c.xml", "m"):
        check_same(tmp_path / file, poses, names_of(poses))


LAYOUTS = {
    "empty lines": lambda i, line: [line, ""],
    "features": lambda i, line: [line, "12.5 3.25 -1 1e2 -4E-1 7 0 0 12"],
    "no second line": lambda i, line: [line],
    "features of some": lambda i, line: [line] + [["1.5 2.5 3"], []][i % 2],
    "comments and carriage returns": lambda i, line: ["# an image", line + "\r", "\r"],
    "blank lines between": lambda i, line: [line, "", "", ""],
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("name", ["view {}.jpg", "my view {} of 9", "{}.jpg"])
def test_colmap_text_is_read_in_any_layout(tmp_path: Path, layout: str, name: str) -> None:
    poses = random_poses(6)
    poses.cam_from_world[0] = np.eye(3, 4)  # "1 0 0 0 0 0 0", all of whole numbers
    names = [name.format(i) for i in range(9)]
    lines = [
        x for i, line in enumerate(image_lines(poses, names, length=4.9)) for x in LAYOUTS[layout](i, line)
    ]
    found = read_poses(model_text(tmp_path / "m", lines), names, (640, 480))
    np.testing.assert_allclose(found.cam_from_world, poses.cam_from_world, atol=1e-9)


@pytest.mark.parametrize(("length", "right"), [(1e-200, True), (1e200, True), (-3.0, True), (0.0, False)])
def test_quaternions_of_any_length_but_zero_are_turned_to_unit_length(
    tmp_path: Path, length: float, right: bool
) -> None:
    poses = random_poses(6)
    folder = model_text(tmp_path / "m", image_lines(poses, names_of(poses), length=length))
    if right:
        found = read_poses(folder, names_of(poses), (640, 480))
        np.testing.assert_allclose(found.cam_from_world, poses.cam_from_world, atol=1e-9)
        return
    with pytest.raises(PoseError, match=r"quaternion of 0000\.exr is zero"):
        read_poses(folder, names_of(poses), (640, 480))


def test_names_with_spaces_and_dots_are_the_same_to_colmap_and_to_us(tmp_path: Path) -> None:
    poses, names = random_poses(3), [f"left/my view.{i:04d}" for i in range(9)]
    write_colmap(tmp_path, poses, [f"{name}.jpg" for name in names])
    theirs = {image.name: image for image in pycolmap.Reconstruction(str(tmp_path)).images.values()}
    assert sorted(theirs) == [f"{name}.jpg" for name in names]
    check_same(tmp_path, poses, [f"{name}.exr" for name in names])


def test_a_binary_model_with_a_false_count_is_refused_at_once(tmp_path: Path) -> None:
    poses, names = random_poses(1), names_of(random_poses(1))
    for file, at in (("cameras.bin", 0), ("images.bin", 0), ("points3D.bin", 0), ("images.bin", 8 + 64 + 9)):
        write_colmap(tmp_path / "m", poses, names)
        data = bytearray((tmp_path / "m" / file).read_bytes())
        data[at : at + 8] = (2**62).to_bytes(8, "little")
        (tmp_path / "m" / file).write_bytes(data)
        with pytest.raises(PoseError, match=r"m: the COLMAP model cannot be read"):
            read_poses(tmp_path / "m", names, (640, 480))


def component(number: int, shift: str, scale: float, cameras: str = "") -> str:
    return (
        f'<component id="{number}"><transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>{shift}'
        f"</translation><scale>{scale}</scale></transform><partition><camera_ids>{cameras}</camera_ids></partition>"
        "</component>"
    )


@pytest.mark.parametrize("listed", [False, True])
def test_metashape_places_the_active_component_and_names_cameras_of_others(
    tmp_path: Path, listed: bool
) -> None:
    poses = random_poses(5)
    other, active = ("7 8", "0 1 2 3 4 5 6") if listed else ("", "")
    chunk = f'<components active_id="4">{component(0, "9 9 9", 7, other)}{component(4, "1 2 3", 2.5, active)}</components>'
    text = metashape_xml(poses, names_of(poses), chunk=chunk)
    if not listed:
        for i in range(9):
            text = text.replace(f'<camera id="{i}"', f'<camera id="{i}" component_id="{0 if i > 6 else 4}"')
    (tmp_path / "c.xml").write_text(text)
    found = read_poses(tmp_path / "c.xml", names_of(poses), (640, 480))
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    centres = 2.5 * inverse(poses.cam_from_world)[:7, :, 3] @ turn.T + [1, 2, 3]
    np.testing.assert_allclose(inverse(found.cam_from_world[:7])[..., 3], centres, atol=1e-9)
    assert found.registered.tolist() == [True] * 7 + [False] * 2
    assert "0007.exr (component 0 is not the active one)" in found.notes[0]
    (tmp_path / "c.xml").write_text(text.replace(' active_id="4"', ""))
    with pytest.raises(PoseError, match="2 components, none of them marked as the active one"):
        read_poses(tmp_path / "c.xml", names_of(poses), (640, 480))


def test_metashape_fixed_calibrations_groups_chunks_and_disabled_cameras(tmp_path: Path) -> None:
    poses, names = random_poses(5), names_of(random_poses(5))
    text = metashape_xml(poses, names)
    fixed = text.replace('class="initial"', 'class="old"').replace('class="adjusted"', 'class="initial"')
    fixed = fixed.replace('type="frame"><res', 'type="frame"><property name="fixed" value="true"/><res', 1)
    grouped = text.replace("<cameras>", '<cameras><group id="0" label="card">').replace(
        "</cameras>", "</group></cameras>"
    )
    empty = '<chunk id="3"><cameras/></chunk>'
    several = text.replace('<document version="2.0.0">', f'<document active_id="5">{empty}')
    several = several.replace('<chunk label="a"', '<chunk id="5" label="a"')
    for said in (fixed, grouped, several):
        (tmp_path / "c.xml").write_text(said)
        check_same(tmp_path / "c.xml", poses, names)
    (tmp_path / "c.xml").write_text(several.replace(' active_id="5"', ""))
    with pytest.raises(PoseError, match="2 chunks, none of them marked as the active one"):
        read_poses(tmp_path / "c.xml", names, (640, 480))
    (tmp_path / "c.xml").write_text(text.replace('<camera id="4"', '<camera id="4" enabled="false"'))
    found = read_poses(tmp_path / "c.xml", names, (640, 480))
    assert found.registered.tolist() == [i != 4 for i in range(9)]
    assert found.notes == ("no pose for 1 of 9 photographs: 0004.exr (disabled)",)


@pytest.mark.parametrize(
    "content",
    [
        '{"frames": ' + "[" * 100_000,
        "[1, 2]",
        '{"frames": 3}',
        '{"fl_x": ' + "9" * 400 + ', "frames": [{"file_path": "0000", "transform_matrix": [[1]]}]}',
        '{"fl_x": 1, "frames": [{"file_path": "0000", "transform_matrix": [[' + "9" * 400 + "]]}]}",
        '{"fl_x": 1e-300, "k3": 1, "frames": [{"file_path": "0000", "transform_matrix": [[1]]}]}',
        '{"fl_x": 9, "frames": [{"file_path": "0000", "transform_matrix": {"a": 1}}]}',
        '{"fl_x": 9, "frames": [{"file_path": "0000", "transform_matrix": '
        "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 6, 7, 1]]}]}",
    ],
)
def test_a_transforms_json_of_anything_else_is_one_line(tmp_path: Path, content: str) -> None:
    (tmp_path / "t.json").write_text(content)
    with pytest.raises(PoseError, match=r"t\.json: ") as fault:
        read_poses(tmp_path / "t.json", ["0000.exr"], (640, 480))
    assert "\n" not in str(fault.value)
    assert len(str(fault.value)) < 600
