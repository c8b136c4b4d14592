"""The bundled session from RAW files to every exported file, at a third of the size, and what a change then costs."""

import re
from pathlib import Path

import numpy as np
import OpenEXR
import plyfile
import pycolmap
import pygltflib
import pytest
import trimesh
from numba.core.event import install_listener

from app import kernels, results
from app.cli import main
from app.inspect import runs
from app.inspect.rerendering import Scene, open_run
from engine.pipeline import artifacts
from engine.progress import Progress
from engine.types import ValidationRenders
from tests.bench.kernels import Compilations
from tests.end_to_end import bundled

# A third of the pixels each way, a coarse sphere of directions, a small light: half a minute on two cores.
QUICK = (
    "hdr.long_edge_px=160",
    "light.max_gaussians=3000",
    "light.max_image_width=96",
    "light.epochs=[3,3]",
    "surface.directions=256",
    "surface.coarse_iterations=1",
    "surface.fine_iterations=1",
    "surface.gauss_newton_steps=3",
    "surface.probe_grid_xy=2",
    "surface.probe_resolution=32",
    "surface.normal_candidates=100",
    "surface.without=light_gains",
    "surface.object_distance=0.66",  # looking for it and refining the light are left to the demo
)


@pytest.fixture(scope="module")
def compiled() -> Compilations:
    """What this module's process had to compile; `python -m tests.bench.kernels` lists it."""
    return Compilations()


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory, compiled: Compilations) -> Path:
    folder = bundled.copy(bundled.DEMO, tmp_path_factory.mktemp("bundled") / "session")
    changes = [word for change in QUICK for word in ("--set", change)]
    kernels.compile_all()
    with install_listener("numba:compile", compiled):
        assert main(["process", str(folder), "--preset", "draft", "--device", "cpu", *changes]) == 0
    return folder


def test_a_run_compiles_no_kernel_that_set_up_has_not(session: Path, compiled: Compilations) -> None:
    assert compiled.found == {}


@pytest.fixture(scope="module")
def scores(session: Path, tmp_path_factory: pytest.TempPathFactory) -> results.Scores:
    return results.evaluate(session, bundled.small_truth(tmp_path_factory.mktemp("truth") / "small.npz"))


@pytest.fixture(scope="module")
def exported(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    to = tmp_path_factory.mktemp("exported") / "result"
    assert main(["export", str(session), "--to", str(to)]) == 0
    return to


@pytest.mark.parametrize(
    ("room", "score", "least", "most"),
    [
        # Few directions, few Gaussians and a light that is not calibrated, in a room lit through windows.
        ("surface", "normal_mean_deg", 0.1, 8.5),
        ("surface", "coverage", 0.98, 1.0),
        ("surface", "albedo_psnr_db", 12.0, 60.0),
        ("surface", "roughness_mae", 0.0, 0.2),
        ("surface", "depth_relief_median", 0.0, 0.1),
        ("mask", "iou", 0.95, 1.0),
        ("poses", "registered_share", 0.95, 1.0),
        ("poses", "rotation_median_deg", 0.0, 0.5),
        ("poses", "position_median_percent", 0.0, 1.5),
    ],
)
def test_the_answer_is_near_the_truth(
    scores: results.Scores, room: str, score: str, least: float, most: float
) -> None:
    value = scores[room][score]
    assert value is not None
    assert least <= value <= most


def test_every_view_and_channel_is_in_the_maps(exported: Path) -> None:
    channels = OpenEXR.File(str(exported / "maps.exr"), separate_channels=True).channels()
    wanted = {f"normal.{axis}" for axis in "XYZ"} | {f"albedo.{colour}" for colour in "RGB"}
    wanted |= {"roughness.Y", "depth.Z", "mask.Y", "stderr.normal_deg"}
    assert wanted <= set(channels)
    pixels = {name: np.asarray(channels[name].pixels, np.float64) for name in wanted}
    assert pixels["mask.Y"].shape == (120, 160)
    inside = pixels["mask.Y"] > 0.5
    length = np.sqrt(sum(pixels[f"normal.{axis}"][inside] ** 2 for axis in "XYZ"))
    np.testing.assert_allclose(length, 1, atol=2e-3)
    assert (pixels["depth.Z"][inside] > 0).all()


def test_the_light_opens_as_a_panorama_and_as_a_point_cloud(exported: Path) -> None:
    channels = OpenEXR.File(str(exported / "light.exr")).channels()
    (panorama,) = [channel.pixels for name, channel in channels.items() if name.startswith("RGB")]
    assert panorama.shape[1] == 2 * panorama.shape[0]
    assert (panorama[..., :3] > 0).all()
    vertices = plyfile.PlyData.read(str(exported / "light.ply"))["vertex"]
    assert len(vertices) > 1000
    assert {"x", "f_dc_0", "opacity", "scale_2", "rot_3"} <= {item.name for item in vertices.properties}


def test_the_mesh_opens_in_two_formats_with_the_same_triangles(exported: Path) -> None:
    ply = trimesh.load(exported / "surface.ply", force="mesh", process=False)
    glb = trimesh.load(exported / "surface.glb", force="mesh", process=False)
    assert len(ply.faces) == len(glb.faces) > 3000
    material = pygltflib.GLTF2().load(str(exported / "surface.glb")).materials[0]
    assert material.normalTexture is not None
    assert material.pbrMetallicRoughness.baseColorTexture is not None


def test_colmap_opens_its_model_with_every_view(exported: Path) -> None:
    model = pycolmap.Reconstruction(str(exported / "colmap"))
    assert len(model.images) == model.num_reg_images() == 46
    assert len(model.points3D) > 200
    (camera,) = model.cameras.values()
    assert (camera.width, camera.height) == (160, 120)


def test_a_view_rendered_again_is_the_solvers_own_picture(session: Path) -> None:
    solved = open_run(runs.runs_of(session)[0])
    own = artifacts.load(solved.run.folder("surface"), "renders", ValidationRenders)
    again = Scene(solved, Progress()).rendered(own.views, Progress())
    first = own.radiance[:, solved.surface.mask]
    # What is stored is rounded: of 360 000 rays that meet the object one or two fall on the other side of an edge.
    np.testing.assert_allclose(again, first, rtol=1e-3, atol=1e-6)
    assert np.isclose(again, first, rtol=1e-4, atol=1e-6).mean() > 0.999


def test_the_report_needs_no_other_file(session: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    assert main(["report", str(session), "--to", str(page)]) == 0
    text = page.read_text()
    links = re.findall(r"""(?:src|href)\s*=\s*["']([^"']*)|url\(["']?([^)"']*)""", text)
    assert len(links) >= 5
    assert all((one or other).startswith(("data:", "#")) for one, other in links)
    for part in ("normal", "albedo", "roughness", "view00"):
        assert part in text


def plan(session: Path, capsys: pytest.CaptureFixture[str], *changes: str) -> dict[str, str]:
    capsys.readouterr()
    assert main(["plan", str(session), *(word for change in changes for word in ("--set", change))]) == 0
    lines = capsys.readouterr().out.splitlines()
    return {line.split()[0]: line.split(maxsplit=2)[2] for line in lines}


def test_a_changed_surface_parameter_is_named_and_reruns_surface_and_export_only(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert set(plan(session, capsys).values()) == {"done"}
    done = {path: path.stat().st_mtime_ns for path in session.glob("stages/*/*/record.json")}
    asked = plan(session, capsys, "surface.gauss_newton_steps=1")
    assert asked["surface"] == "will run because params.gauss_newton_steps 3 -> 1"
    assert asked["export"] == "will run because input surface changed"
    assert [asked[name] for name in ("hdr", "segment", "poses", "light")] == ["done"] * 4
    assert main(["process", str(session), "--device", "cpu", "--set", "surface.gauss_newton_steps=1"]) == 0
    assert "surface, export done" in capsys.readouterr().out.splitlines()[-1]
    after = {path: path.stat().st_mtime_ns for path in session.glob("stages/*/*/record.json")}
    assert {path: after[path] for path in done} == done
    assert sorted(path.parts[-3] for path in after.keys() - done.keys()) == ["export", "surface"]
    assert main(["process", str(session)]) == 0
    assert "nothing to do" in capsys.readouterr().out
