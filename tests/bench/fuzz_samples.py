"""One whole sample of every kind of file that Roomlight reads, and how it reads it; for `tests.bench.fuzz`."""

import datetime
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import trimesh
from PIL import Image

from app.capture import order
from engine import importing
from engine.hdr.linear_input import check_values
from engine.io import normal_maps, session
from engine.io.ground_truth import read_truth
from engine.io.images import read_mask, read_radiance
from engine.io.poses.pose_files import read_poses, write_colmap, write_transforms
from engine.io.raw import read_facts, read_mosaic
from engine.pipeline import artifacts, run, settings, stage_table, stages
from engine.pipeline.stage_functions import _given_poses
from engine.types import Frames
from hardware import plan
from hardware.interfaces import Bracket, Exposure
from hardware.virtual import dng, sensor
from hardware.virtual.studio import meshes
from tests.app import sessions
from tests.engine import folders, foreign_raw
from tests.engine.io.poses.test_pose_files import metashape_xml, random_poses

WIDTH, HEIGHT = folders.WIDTH, folders.HEIGHT
POSES = random_poses(0)
NAMES = [f"{i:04d}.exr" for i in range(len(POSES.registered))]
SIZE = POSES.camera.width, POSES.camera.height
MASK = np.zeros((HEIGHT, WIDTH), bool)
MASK[8:20, 10:30] = True


@dataclass(frozen=True, slots=True)
class Sample:
    """`write` makes the sample in a new folder and tells what `read` is given; both of the same path."""

    write: Callable[[Path], Path]
    read: Callable[[Path], object]
    damaged: tuple[
        str, ...
    ] = ()  # of the files beside the path, which ones are damaged; none: the path itself


def _read_raw(path: Path) -> None:
    read_facts(path)
    read_mosaic(path)


def _read_linear(path: Path) -> None:
    check_values(path, read_radiance(path))


def _write_raw(folder: Path, suffix: str) -> Path:
    folder.mkdir(parents=True)
    start, rng = datetime.datetime(2024, 5, 1), np.random.default_rng(0)
    dng.write(folder / f"a.{suffix}", sensor.bracket(folders.scene(0), 0.01, sensor.Sensor(), start, rng)[1])
    return folder / f"a.{suffix}"


def _write_foreign(name: str, write: Callable[[Path], object]) -> Callable[[Path], Path]:
    def write_in(folder: Path) -> Path:
        folder.mkdir(parents=True)
        write(folder / name)
        return folder / name

    return write_in


def _write_floats(path: Path) -> None:
    foreign_raw.write_floats(path, foreign_raw.counts().astype(np.float32) / 9000, 24, 34894, tile=(32, 32))


def _write_exr(folder: Path) -> Path:
    folder.mkdir(parents=True)
    folders.write_exr(folder / "a.exr", folders.scene(0))
    return folder / "a.exr"


def _write_with_cv2(name: str, image: np.ndarray) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        folder.mkdir(parents=True)
        cv2.imwrite(str(folder / name), image)
        return folder / name

    return write


def _write_palette(folder: Path) -> Path:
    folder.mkdir(parents=True)
    image = Image.fromarray(MASK.astype(np.uint8), "P")
    image.putpalette([0, 0, 0, 255, 255, 255])
    image.save(folder / "mask.png", transparency=0)
    return folder / "mask.png"


def _write_normals_exr(folder: Path) -> Path:
    folder.mkdir(parents=True)
    normals = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    normals[..., 2] = -1
    folders.write_exr(folder / "n.exr", normals)
    return folder / "n.exr"


def _write_normals_npz(folder: Path) -> Path:
    folder.mkdir(parents=True)
    normals = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    normals[..., 2] = -1
    np.savez(folder / "n.npz", normal=normals)
    return folder / "n.npz"


def _read_normals(path: Path) -> object:
    return normal_maps.read_normals(path, MASK, "opencv")


def _write_truth(folder: Path) -> Path:
    folder.mkdir(parents=True)
    normals = np.zeros((HEIGHT, WIDTH, 3))
    normals[..., 2] = -1
    flat = np.ones((HEIGHT, WIDTH))
    np.savez(
        folder / "truth.npz", normal=normals, albedo=normals + 1, roughness=flat / 2, depth=flat, mask=MASK
    )
    return folder / "truth.npz"


def _write_colmap_text(folder: Path) -> Path:
    write_colmap(folder, POSES, NAMES)
    if not (folder / "images.txt").exists():  # the export is binary
        pycolmap.Reconstruction(str(folder)).write_text(str(folder))
        for path in folder.glob("*.bin"):
            path.unlink()
    return folder


def _write_colmap_binary(folder: Path) -> Path:
    write_colmap(folder, POSES, NAMES)
    pycolmap.Reconstruction(str(folder)).write_binary(str(folder))
    for path in folder.glob("*.txt"):
        path.unlink()
    return folder


def _write_transforms(folder: Path) -> Path:
    folder.mkdir(parents=True)
    write_transforms(folder / "transforms.json", POSES, NAMES)
    return folder / "transforms.json"


def _write_metashape(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "cameras.xml").write_text(metashape_xml(POSES, NAMES))
    return folder / "cameras.xml"


def _read_poses(path: Path) -> object:
    return read_poses(path, NAMES, SIZE)


def _write_session(folder: Path) -> Path:
    """Imported with poses and a mask, merged, and with parameters of its own."""
    folder.mkdir(parents=True)
    place = sessions.photographs(folder)
    rows = [f"{i:04d}.exr" for i in range(sessions.VIEWS)]
    poses = random_poses(
        1, len(rows), POSES.camera.__class__(sessions.WIDTH, sessions.HEIGHT, 50.0, 50.0, 16.0, 12.0)
    )
    write_transforms(folder / "transforms.json", poses, rows)
    made = importing.make_session(
        place, folder / "a.session", poses=folder / "transforms.json", mask=folder / "mask.png"
    )
    asked = settings.Settings("draft", 3, {"surface": {"fine_iterations": 2}})
    run.process(made, stage_table.stages(), asked, "cpu", "hdr")
    hdr = next((folder / "a.session/stages/hdr").iterdir())
    for path in hdr.iterdir():  # under a name that can be told beforehand
        (folder / path.name).write_bytes(path.read_bytes())
    return folder / "a.session"


def _read_session(path: Path) -> None:
    opened = session.open_session(path)
    stages.plan(opened, stage_table.stages(), settings.from_toml(session.read_params(opened)))
    for shot in session.shots(opened):
        session.verify(shot)
    _given_poses(opened, artifacts.load(path.parent, "frames", Frames))
    read_mask(path / "edits/mask.png", sessions.HEIGHT, sessions.WIDTH)


def _write_order(folder: Path) -> Path:
    folder.mkdir(parents=True)
    poses = order.poses_of(plan.gimbal(6))
    bracket = Bracket(Exposure(0.01, 100, 8.0), (-3.0, 0.0, 3.0))
    order.write(folder, order.Order("virtual:", "virtual:", "gimbal", poses, bracket, None, 0.5, False))
    return folder


def _write_mesh(suffix: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        folder.mkdir(parents=True)
        trimesh.creation.icosphere(2).export(folder / f"ball.{suffix}")
        return folder / f"ball.{suffix}"

    return write


def _read_mesh(path: Path) -> object:
    return meshes.stand(meshes.read(path, False), 0.2, 0.0)


def _write_plan(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "plan.csv").write_text("pan_deg,tilt_deg,name\n0,0,front\n10.5,-20,\n# turned\n20,0,side\n")
    return folder / "plan.csv"


PAINTED = (MASK * 255).astype(np.uint8)
KINDS: dict[str, Sample] = {
    "raw": Sample(lambda folder: _write_raw(folder, "nef"), _read_raw),
    "dng": Sample(lambda folder: _write_raw(folder, "dng"), _read_raw),
    "maker's raw": Sample(
        _write_foreign(
            "a.nef", lambda path: foreign_raw.write_maker(path, "NIKON CORPORATION", "NIKON D850", exif=foreign_raw.nikon_note(600))
        ),
        _read_raw,
    ),
    "orf": Sample(_write_foreign("a.orf", lambda path: foreign_raw.write_orf(path, "E-M1MarkII", foreign_raw.counts() % 4096)), _read_raw),
    "raf": Sample(
        _write_foreign("a.raf", lambda path: foreign_raw.write_raf(path, "GFX 50S", foreign_raw.counts(), 512)), _read_raw
    ),
    "dng of floats": Sample(_write_foreign("a.dng", _write_floats), _read_raw),
    "exr": Sample(_write_exr, _read_linear),
    "hdr": Sample(_write_with_cv2("a.hdr", folders.scene(0).astype(np.float32)), _read_linear),
    "mask": Sample(_write_with_cv2("mask.png", PAINTED), lambda path: read_mask(path, HEIGHT, WIDTH)),
    "palette mask": Sample(_write_palette, lambda path: read_mask(path, HEIGHT, WIDTH)),
    "normals png": Sample(
        _write_with_cv2("n.png", np.full((HEIGHT, WIDTH, 3), (255, 128, 128), np.uint8)),
        lambda path: normal_maps.read_normals(path, MASK, "opengl"),
    ),
    "normals exr": Sample(_write_normals_exr, _read_normals),
    "normals npz": Sample(_write_normals_npz, _read_normals),
    "truth": Sample(_write_truth, read_truth),
    "colmap text": Sample(_write_colmap_text, _read_poses, ("cameras.txt", "images.txt", "points3D.txt")),
    "colmap binary": Sample(_write_colmap_binary, _read_poses, ("cameras.bin", "images.bin", "points3D.bin")),
    "transforms.json": Sample(_write_transforms, _read_poses),
    "metashape": Sample(_write_metashape, _read_poses),
    "session": Sample(
        _write_session,
        _read_session,
        (
            "a.session/session.json", "a.session/params.toml", "a.session/shots/0003/shot.json",
            "a.session/edits/poses.json", "a.session/edits/mask.png", "frames.json", "frames.radiance.npy",
        ),
    ),
    "capture order": Sample(_write_order, order.read, ("capture/order.json",)),
    "mesh obj": Sample(_write_mesh("obj"), _read_mesh),
    "mesh ply": Sample(_write_mesh("ply"), _read_mesh),
    "mesh glb": Sample(_write_mesh("glb"), _read_mesh),
    "capture plan": Sample(_write_plan, plan.read_plan),
}  # fmt: skip
