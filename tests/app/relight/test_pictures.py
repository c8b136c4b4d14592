"""Relit pictures, videos and pages as files: what was asked for, by whoever asked."""

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.inspect import runs
from app.relight import files, page, panoramas, pictures, sources
from app.relight.pictures import Wish
from app.relight.relit import Setting, Transfer, relit, spot_direction
from app.relight.transfer import build, shrunk
from engine.errors import Cancelled, SessionError
from engine.io.gltf import surface_glb
from engine.io.mesh import CutParams, from_depth
from engine.progress import Progress
from tests.app import furnace
from tests.app.calls import refused
from tests.app.relight.test_relit import arrays, light_of, sky, transfer  # noqa: F401
from tests.engine.results.report.test_report_seen import BROWSER, LONG_S


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Finished and prepared for relighting."""
    made = furnace.finished(tmp_path_factory.mktemp("pictures") / "lion.session")
    run = runs.runs_of(made)[0]
    files.keep(files.transfer_file(run), arrays())
    light = light_of(sky())
    files.keep(
        files.light_file(run, 4), {name: np.asarray(getattr(light, name)) for name in type(light).__slots__}
    )
    return made


def test_a_lamp_lights_the_side_it_stands_on(transfer: Transfer) -> None:  # noqa: F811
    dark = light_of(np.zeros((64, 128, 3), np.float32))
    column = np.nonzero(transfer.mask)[1]
    left, right = column < np.quantile(column, 0.3), column > np.quantile(column, 0.7)
    lit = relit(transfer, dark, Setting(spot=(0.9, 0.0), spot_energy=np.pi)).mean(1)
    assert lit[right].mean() > 5 * lit[left].mean()
    # White paint that faces the lamp is white: the ball's paint, where it looks at the viewer and the lamp stands there too.
    ahead = relit(transfer, dark, Setting(spot=(0.0, 0.0), spot_energy=np.pi))
    assert np.percentile(ahead / transfer.albedo, 90) == pytest.approx(1.0, rel=0.25)
    np.testing.assert_allclose(spot_direction((3.0, 4.0)), [0.6, -0.8, 0.0], atol=1e-6)


def test_a_still_is_clear_around_the_object(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = pictures.make(Wish(str(session), str(tmp_path / "a.png")), Progress())
    picture = cv2.imread(str(still), cv2.IMREAD_UNCHANGED)
    mask = furnace.surface().mask
    assert (picture[..., 3] > 0).sum() == mask.sum()
    other = pictures.make(
        Wish(str(session), str(tmp_path / "b.png"), str(panoramas.file("ring"))), Progress()
    )
    assert not np.array_equal(picture, cv2.imread(str(other), cv2.IMREAD_UNCHANGED))
    assert "none of .png" in refused(capsys, "relight", session, tmp_path / "a.gif")
    with pytest.raises(SessionError, match="no finished surface"):
        pictures.make(Wish(str(tmp_path), str(tmp_path / "a.png")), Progress())


def test_a_still_has_the_photographs_own_size_where_the_preview_has_not(
    session: Path, tmp_path: Path
) -> None:
    other = Path(shutil.copytree(session, tmp_path / "lion.session", symlinks=True))
    run = runs.runs_of(other)[0]
    half = shrunk(furnace.surface(), furnace.CAMERA, side=12)
    files.keep(files.transfer_file(run), build(half, True, Progress()))
    wish = Wish(str(other), str(tmp_path / "a.png"))
    picture = cv2.imread(str(pictures.make(wish, Progress())), cv2.IMREAD_UNCHANGED)
    assert half.mask.sum() < furnace.surface().mask.sum() / 2
    assert (picture[..., 3] > 0).sum() == furnace.surface().mask.sum()


def test_the_light_goes_round_in_a_video_or_a_folder(session: Path, tmp_path: Path) -> None:
    wish = Wish(
        str(session),
        str(tmp_path / "turn.mp4"),
        setting={"spot": [0.8, 0.1], "room": 0.1},
        spot=1.0,
        seconds=0.2,
    )
    video = cv2.VideoCapture(str(pictures.make(wish, Progress())))
    frames = [video.read()[1] for _ in range(6)]
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 6
    assert np.abs(frames[0].astype(int) - frames[3]).mean() > 2
    folder = pictures.make(Wish(str(session), str(tmp_path / "frames"), seconds=0.1), Progress())
    assert sorted(path.name for path in folder.iterdir()) == ["0000.png", "0001.png", "0002.png"]
    assert cv2.imread(str(folder / "0000.png"), cv2.IMREAD_UNCHANGED).shape[2] == 4


def test_a_folder_of_frames_that_is_stopped_leaves_nothing(session: Path, tmp_path: Path) -> None:
    told: list[str] = []
    progress = Progress(
        lambda fraction, note: told.append(note), lambda: any("frame 3" in note for note in told)
    )
    with pytest.raises(Cancelled):
        pictures.make(Wish(str(session), str(tmp_path / "frames"), seconds=0.2), progress)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", panoramas.NAMES)
def test_every_light_that_ships_is_a_panorama_of_moderate_strength(name: str) -> None:
    radiance = sources.read_panorama(panoramas.file(name))
    assert radiance.shape == (128, 256, 3)
    polar = np.pi * (np.arange(128) + 0.5) / 128
    mean = (radiance.mean((1, 2)) * np.sin(polar)).sum() / np.sin(polar).sum()
    assert 0.1 < mean < 3


def test_the_pages_room_is_the_panorama_in_the_meshs_frame() -> None:
    """three.js finds a direction at u = atan2(z, x) / 2 pi + 1/2, v = asin(y) / pi + 1/2, rows from below."""
    light = np.full((64, 128, 3), 0.1, np.float32)
    light[16:24, 96:104] = 5.0  # above, to the camera's right: azimuth 90 degrees is u = 3/4
    room = page.surroundings(light)[..., 0]
    row, column = np.unravel_index(room.argmax(), room.shape)
    u, v = 2 * np.pi * ((column + 0.5) / 128 - 0.5), np.pi * ((row + 0.5) / 64 - 0.5)
    way = np.array([np.cos(v) * np.cos(u), np.sin(v), np.cos(v) * np.sin(u)])
    assert way[0] > 0.6  # right in both frames
    assert way[1] > 0.3  # up is -y of the camera
    assert 0 <= way[2] < 0.4  # a little behind the camera, which is towards the viewer


def test_a_page_holds_all_it_needs(tmp_path: Path) -> None:
    surface = furnace.surface()
    glb = surface_glb(from_depth(surface, furnace.CAMERA, CutParams()), surface, "scene units", "test")
    text = page.page(glb, np.ones((8, 16, 3), np.float32), "</title>lion & bear")
    assert "<h1>&lt;/title&gt;lion &amp; bear</h1>" in text
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=", text)
    data = json.loads(re.search(r'id="data">(.*?)</script>', text)[1])  # type: ignore[index]
    assert all(
        base64.b64decode(data[name]).startswith(b"\x89PNG") for name in ("albedo", "material", "normals")
    )
    vertices = np.frombuffer(base64.b64decode(data["position"]), "<f4").reshape(-1, 3)
    assert np.frombuffer(base64.b64decode(data["index"]), "<u4").max() == len(vertices) - 1
    assert (data["width"], data["height"]) == (128, 64)
    assert "three.js" in text
    if BROWSER is not None:
        # Without WebGL a browser says so: the page was read and its program ran.
        (tmp_path / "page.html").write_text(text)
        words = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-3d-apis",
                 f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", (tmp_path / "page.html").as_uri()]  # fmt: skip
        seen = subprocess.run(words, capture_output=True, check=True, timeout=LONG_S).stdout.decode()
        assert "This browser cannot draw the object" in seen.split('id="said">')[1][:200]
