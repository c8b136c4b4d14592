"""Relighting in real time agrees with the project's own reflectance, and turns the light the way it says."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import OpenEXR
import pytest
import torch

from app.inspect import runs
from app.relight import files as relighting_files
from app.relight import relit as relighting
from app.relight import sources as light_sources
from app.relight import transfer as light_transfer
from app.relight.relit import CELLS, LATTICE, Light, Setting, Transfer, relit
from engine.errors import LightError, SessionError
from engine.geometry import fibonacci_sphere, rays
from engine.light.incident.direction_grid import face_directions
from engine.light.incident.probes import panorama_directions
from engine.progress import Progress
from engine.surface.reflectance.brdf import lobe_floor, rows
from engine.surface.reflectance.brdf_torch import rows_reference
from tests.app import furnace

CAMERA = furnace.CAMERA


@cache
def small() -> light_transfer.Small:
    return light_transfer.shrunk(furnace.surface(), CAMERA)


@cache
def arrays() -> dict[str, np.ndarray]:
    return light_transfer.build(small(), True, Progress())


@pytest.fixture
def transfer(tmp_path: Path) -> Transfer:
    relighting_files.keep(tmp_path / "transfer.npz", arrays())
    return relighting_files.load_transfer(tmp_path / "transfer.npz")


def light_of(radiance: np.ndarray) -> Light:
    """A light from a panorama, without lamps."""
    made = light_sources.as_light(radiance)
    none = np.zeros((0, 3))
    nobody = np.zeros(0, int)
    return Light(
        "test", made["energy"], made["panorama"], none, np.zeros(0), none, nobody, nobody.astype(bool)
    )


def sky() -> np.ndarray:
    """Bright from one side and above, of different colour."""
    towards = panorama_directions(64)
    glow = np.exp(3 * (towards @ np.array([-0.6, -0.5, -0.62]) - 1))
    return (0.2 + glow[..., None] * [3.0, 2.0, 1.0]).astype(np.float32)


def with_lamp(
    light: Light, centre: tuple[float, float, float], radius: float = 0.05, group: int = 0
) -> Light:
    return replace(
        light, lamp_centre=np.array([centre]), lamp_radius=np.array([radius]), lamp_radiance=np.full((1, 3), 50.0),
        lamp_group=np.array([group]), lamp_clipped=np.array([False]),
    )  # fmt: skip


def exactly(energy: np.ndarray) -> np.ndarray:
    """The ball's pixels under cells of energy, by the plain reference of the BRDF; a ball hides nothing of itself."""
    s = small()
    mask = s.mask
    normal, away = (torch.from_numpy(v[mask].astype(float)) for v in (s.normal, -rays(s.camera)))
    cells = torch.from_numpy(fibonacci_sphere(CELLS))
    rough = torch.from_numpy(s.roughness[mask].astype(float))
    diffuse, specular = (
        answer.numpy() for answer in rows_reference(normal, rough, away, cells, True, lobe_floor(CELLS))
    )
    return s.albedo[mask] * (diffuse @ energy) + specular @ energy


def test_relit_agrees_with_the_brdf(transfer: Transfer) -> None:
    light = light_of(sky())
    for setting in (Setting(), Setting(yaw_deg=130, pitch_deg=-35, roll_deg=20)):
        energy = relighting.cell_energy(transfer, light.energy, setting.turn())
        expected, found = exactly(energy), relit(transfer, light, setting)
        relative = np.abs(found / expected - 1)
        assert np.median(relative) < 0.01
        assert np.percentile(relative, 90) < 0.05  # the rim's facets hide each other a little


def test_an_even_light_is_the_same_however_it_is_turned(transfer: Transfer) -> None:
    light = light_of(np.ones((64, 128, 3), np.float32))
    first = relit(transfer, light, Setting())
    for setting in (Setting(yaw_deg=77), Setting(pitch_deg=50, roll_deg=-120)):
        off = np.abs(relit(transfer, light, setting) / first - 1)
        assert np.median(off) < 0.002
        assert np.percentile(off, 95) < 0.01


def test_turns_go_the_way_they_say() -> None:
    ahead, right, up = np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), np.array([0, -1.0, 0])
    assert relighting.rotation(90, 0, 0) @ ahead == pytest.approx(right)
    assert relighting.rotation(0, 90, 0) @ ahead == pytest.approx(up)
    assert relighting.rotation(0, 0, 90) @ up == pytest.approx(right)  # clockwise


def test_light_from_the_right_lights_the_right_side(transfer: Transfer) -> None:
    picture = np.full((64, 128, 3), 0.01, np.float32)
    picture[28:36, 94:98] = 40.0  # azimuth +90 degrees: to the right
    light = light_of(picture)
    mask = small().mask
    _, column = np.nonzero(mask)
    right = column > np.median(column)
    level = relit(transfer, light, Setting()).sum(1) / small().albedo[mask].sum(1)
    assert level[right].mean() > 3 * level[~right].mean()
    level = relit(transfer, light, Setting(yaw_deg=180)).sum(1) / small().albedo[mask].sum(1)
    assert level[~right].mean() > 3 * level[right].mean()


def test_turning_keeps_all_the_energy(transfer: Transfer) -> None:
    light = light_of(sky())
    for setting in (Setting(), Setting(yaw_deg=33, pitch_deg=12)):
        cells = relighting.cell_energy(transfer, light.energy, setting.turn())
        assert cells.sum(0) == pytest.approx(light.energy.sum(0), rel=1e-4)
        where = fibonacci_sphere(CELLS).T @ cells / cells.sum(0)
        was = setting.turn() @ (fibonacci_sphere(LATTICE).T @ light.energy / light.energy.sum(0))
        assert where == pytest.approx(was, abs=0.01)


def test_a_direction_is_found_in_the_cube_of_the_engine() -> None:
    side = 8
    towards = face_directions(side).reshape(-1, 3)
    face, u, v = relighting.cube_place(towards, side)
    expected = np.indices((6, side, side)).reshape(3, -1)
    assert np.array_equal(np.stack([face, v, u]), expected)


def test_strengths_scale_their_own_light_and_add_up(transfer: Transfer) -> None:
    light = with_lamp(light_of(sky()), (0.6, -0.3, 0.2))
    room = relit(transfer, light, Setting(lamps=(0.0,)))
    lamp = relit(transfer, light, Setting(room=0.0))
    assert room.max() > 0
    assert lamp.max() > 0
    both = relit(transfer, light, Setting(room=2.0, lamps=(0.5,)))
    # Less what compressing loses: negative rests are cut off in each picture by itself.
    assert both == pytest.approx(2 * room + 0.5 * lamp, rel=0.01)
    assert relit(transfer, with_lamp(light, (0.6, -0.3, 0.2), group=-1), Setting(room=0.0)).max() == 0


def test_a_near_lamp_falls_off_with_the_square_of_its_distance(transfer: Transfer) -> None:
    dark = light_of(np.full((64, 128, 3), 1e-9, np.float32))
    mask = small().mask
    middle = np.abs(np.argwhere(mask) - [15, 19.5]).max(1) < 3

    def level(away: float) -> float:
        lamp = with_lamp(dark, (0.0, 0.0, 0.8 - away))
        return float(relit(transfer, lamp, Setting())[middle].mean())

    assert level(2.0) / level(4.0) == pytest.approx(4, rel=0.1)
    assert level(2.0) == pytest.approx(level(4.0) * 4, rel=0.1)
    # Turned half round, it stands behind the ball.
    behind = relit(transfer, with_lamp(dark, (0.0, 0.0, -1.2)), Setting(yaw_deg=180))
    assert behind[middle].max() < 0.02 * level(2.0)


def test_a_panorama_keeps_its_energy_and_its_sun() -> None:
    even = light_sources.as_light(np.ones((300, 600, 3), np.float32))
    assert even["energy"].sum(0) == pytest.approx(4 * np.pi, rel=1e-4)
    sun = np.zeros((512, 1024, 3), np.float32)
    sun[100:103, 700:703] = 1000.0
    light = light_sources.as_light(sun)
    solid = np.sin(np.pi * 101.5 / 512) * (np.pi / 512) ** 2
    assert light["energy"].sum(0) == pytest.approx(9 * 1000 * solid, rel=0.02)
    towards = fibonacci_sphere(LATTICE)[light["energy"][:, 0].argmax()]
    assert np.degrees(np.arccos(towards @ panorama_directions(512)[101, 701])) < 2


def test_panoramas_are_read_linear(tmp_path: Path) -> None:
    code = np.full((8, 16, 3), 188, np.uint8)
    code[..., 0] = 0  # blue, as OpenCV has it
    cv2.imwrite(str(tmp_path / "a.png"), code)
    assert light_sources.read_panorama(tmp_path / "a.png")[3, 3] == pytest.approx([0.5, 0.5, 0], abs=0.01)
    channels = {
        name: np.full((8, 16), level, np.float32) for name, level in zip("RGB", (3, 2, 1), strict=True)
    }
    with OpenEXR.File({"type": OpenEXR.scanlineimage}, channels) as file:
        file.write(str(tmp_path / "b.exr"))
    assert light_sources.read_panorama(tmp_path / "b.exr")[0, 0] == pytest.approx([3, 2, 1])
    cv2.imwrite(str(tmp_path / "c.hdr"), np.full((8, 16, 3), 7.0, np.float32))
    assert light_sources.read_panorama(tmp_path / "c.hdr")[0, 0] == pytest.approx(7, rel=0.02)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        (
            "square.png",
            np.full((8, 8, 3), 9, np.uint8),
            "8 x 8; an equirectangular panorama is twice as wide",
        ),
        ("black.png", np.zeros((8, 16, 3), np.uint8), "is black"),
        ("half.png", None, "cannot be read as a picture"),
    ],
)
def test_what_is_no_panorama_is_refused(tmp_path: Path, name: str, content, told: str) -> None:
    path = tmp_path / name
    if content is None:
        path.write_bytes(b"\x89PNG half")
    else:
        cv2.imwrite(str(path), content)
    with pytest.raises(LightError, match=told):
        light_sources.read_panorama(path)


def test_compressed_rows_keep_the_table() -> None:
    rng = np.random.default_rng(0)
    table = (rng.normal(size=(80, 5)) @ rng.normal(size=(5, 300))).astype(np.float32)
    chances = rng.normal(size=(300, 256)).astype(np.float32)
    share, rows = light_transfer.leading(table, chances)
    assert len(rows) <= 5
    assert np.linalg.norm(share @ rows - table) <= 1.01 * light_transfer.LOST * np.linalg.norm(table)
    noisy = table + 0.003 * np.abs(table).max() * rng.normal(size=table.shape).astype(np.float32)
    share, rows = light_transfer.leading(noisy, chances)
    assert np.linalg.norm(share @ rows - noisy) <= 1.01 * light_transfer.LOST * np.linalg.norm(noisy)


def test_a_large_surface_is_averaged_down_over_its_own_pixels() -> None:
    s = furnace.surface()
    half = light_transfer.shrunk(s, CAMERA, side=16)
    by = CAMERA.width // half.camera.width
    assert half.camera.width * by == CAMERA.width
    assert half.camera.fx == pytest.approx(CAMERA.fx / by)
    row, column = np.argwhere(half.mask)[len(np.argwhere(half.mask)) // 2]
    cell = np.s_[row * by : (row + 1) * by, column * by : (column + 1) * by]
    inside = s.mask[cell]
    assert half.albedo[row, column] == pytest.approx(s.albedo[cell][inside].mean(0), rel=1e-5)
    assert np.linalg.norm(half.normal[half.mask], axis=-1) == pytest.approx(1)
    left, top, right, bottom = half.box
    assert half.mask[top:bottom, left:right].sum() == half.mask.sum()


def test_what_hides_the_room_throws_its_own_light(tmp_path: Path) -> None:
    """A floor and a wall at a right angle: pixels in the corner see the other side where they miss the room."""
    camera = replace(CAMERA, width=32, height=32, cx=16.0, cy=16.0, fx=40.0, fy=40.0)
    q = rays(camera)
    q = q / q[..., 2:]
    flat = q[..., 1:2] < 0
    normal = np.where(flat, [0, 0, -1.0], [0, -0.8, -0.6])
    wall = 1.0 / q[..., 2]
    slope = 0.8 / (0.8 * q[..., 1] + 0.6 * q[..., 2]) * 0.75
    depth = np.where(flat[..., 0], wall, np.minimum(wall, slope))
    mask = np.ones((32, 32), bool)
    scene = light_transfer.Small(
        camera, mask, normal, np.full((32, 32, 3), 0.8), np.full((32, 32), 1.0), depth, (0, 0, 32, 32)
    )
    relighting_files.keep(tmp_path / "t.npz", light_transfer.build(scene, False, Progress()))
    transfer = relighting_files.load_transfer(tmp_path / "t.npz")
    light = light_of(np.ones((64, 128, 3), np.float32))
    together = relit(transfer, light, Setting()).reshape(32, 32, 3)[..., 0]
    silent = transfer.basis.copy()
    silent[:, CELLS:] = 0
    alone = relit(replace(transfer, basis=silent), light, Setting()).reshape(32, 32, 3)[..., 0]
    gain = together / alone - 1
    corner, far = gain[13:19, 8:24].mean(), gain[1:4, 8:24].mean()
    assert corner > 0.02
    assert corner > 3 * max(far, 1e-3)
    # No more comes back than an even room would have given with nothing in the way.
    views = -rays(camera).reshape(-1, 3)
    diffuse, specular = rows(
        normal.reshape(-1, 3),
        np.ones(32 * 32),
        views,
        fibonacci_sphere(CELLS),
        False,
        lobe_floor(CELLS),
    )
    free = ((0.8 * diffuse + specular).sum(1) * 4 * np.pi / CELLS).reshape(32, 32)
    assert (alone / free)[13:19, 8:24].min() < 0.9
    assert (together / free).max() < 1.02


def test_the_light_stands_behind_the_object_where_it_comes_from(transfer: Transfer) -> None:
    picture = np.full((64, 128, 3), 0.1, np.float32)
    picture[:, 64:70] = 5.0  # just right of the middle: ahead of the camera
    light = light_of(picture)
    ground = relighting.behind(transfer, light, Setting())
    assert ground.shape == (*transfer.size, 3)
    assert ground.max() > 3
    assert relighting.behind(transfer, light, Setting(yaw_deg=180)).max() < 0.2
    over = relighting.overview(light, transfer.middle, Setting(yaw_deg=90), 5.0, rows=32)
    assert over[16, 32:64, 0].argmax() + 32 == pytest.approx(48, abs=3)  # turned to the right
    lamp = with_lamp(light_of(np.full((64, 128, 3), 0.1, np.float32)), (0.02, -0.01, 5.0), radius=0.5)
    assert relighting.behind(transfer, lamp, Setting()).max() == pytest.approx(50, rel=0.2)
    assert relighting.behind(transfer, lamp, Setting(lamps=(0.0,))).max() < 0.2


def test_the_picture_shows_the_object_before_the_light(transfer: Transfer) -> None:
    light = light_of(sky())
    pixels = relit(transfer, light, Setting())
    white = relighting.white_of(pixels)
    bare = relighting.drawn(transfer, light, Setting(), white, 0.0, "srgb", False)
    full = relighting.drawn(transfer, light, Setting(), white, 0.0, "srgb", True)
    left, top, right, bottom = transfer.box
    inside = transfer.mask[top:bottom, left:right]
    assert np.array_equal(bare[inside], full[inside])
    assert (bare[~inside] == 0).all()
    assert (full[..., 3] == 255).all()


def test_saved_pictures_are_linear_with_the_mask_as_alpha(tmp_path: Path) -> None:
    picture = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    inside = np.array([[True, False, True, True], [False, True, True, True]])
    relighting_files.save_exr(tmp_path / "a.exr", picture, inside, "view00, as photographed")
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
        assert file.header()["light"] == "view00, as photographed"
    assert np.array_equal(np.stack([channels[c] for c in "RGB"], -1), picture)
    assert np.array_equal(channels["A"], inside.astype(np.float32))
    with pytest.raises(SessionError, match="could not be written"):
        relighting_files.save_exr(tmp_path / "no" / "a.exr", picture, inside, "")


def test_damaged_files_are_told(tmp_path: Path) -> None:
    (tmp_path / "t.npz").write_bytes(b"PK half")
    with pytest.raises(SessionError, match="it is made again"):
        relighting_files.load_transfer(tmp_path / "t.npz")


def test_the_recovered_light_of_an_even_room_is_even(tmp_path: Path) -> None:
    from tests.app.inspect.test_rerendering import Wire

    session = furnace.finished(tmp_path)
    run = runs.runs_of(session)[0]
    request = {"session": str(session), "fingerprint": run.fingerprint, "view": 4}
    assert light_transfer.serve(request, Wire()) == {"view": 4}  # type: ignore[arg-type]
    assert relighting_files.lights_of(run) == (4,)
    light = relighting_files.load_light(relighting_files.light_file(run, 4))
    assert light.name == "view04"
    assert light.lamps == 0
    assert light.energy.sum(0) == pytest.approx(4 * np.pi * furnace.GLOW, rel=0.02)
    assert np.median(light.panorama) == pytest.approx(furnace.GLOW, rel=0.02)
    transfer = relighting_files.load_transfer(relighting_files.transfer_file(run))
    ratio = relit(transfer, light, Setting()).mean(1) / furnace.surface().albedo[transfer.mask].mean(1)
    assert np.median(ratio) == pytest.approx(furnace.GLOW * 1.12, rel=0.08)  # diffuse, and some specular


def test_a_panorama_becomes_a_light_file(tmp_path: Path) -> None:
    from tests.app.inspect.test_rerendering import Wire

    cv2.imwrite(str(tmp_path / "a.png"), np.full((64, 128, 3), 188, np.uint8))
    to = tmp_path / "made" / "light.npz"
    light_sources.serve_panorama({"file": str(tmp_path / "a.png"), "to": str(to)}, Wire())  # type: ignore[arg-type]
    light = relighting_files.load_light(to)
    assert light.name == "a.png"
    assert light.energy.sum(0) == pytest.approx(4 * np.pi * 0.503, rel=0.01)


def test_a_preview_on_the_maps_grid_covers_the_object_to_its_rim() -> None:
    transfer = SimpleNamespace(mask=np.zeros((4, 5), bool))
    transfer.mask[1:3, 1:4] = True
    pixels = np.arange(18, dtype=np.float32).reshape(6, 3)
    whole = relighting.on_maps(transfer, pixels, (13, 16))  # type: ignore[arg-type]
    assert whole.shape == (13, 16, 3)
    assert (whole[3, 3] == pixels[0]).all()
    assert (whole[8, 11] == pixels[5]).all()
    assert (whole[5, 13] == pixels[2]).all()  # beside the rim
    assert (whole[12] == whole[11]).all()  # the row that did not make a whole cell
