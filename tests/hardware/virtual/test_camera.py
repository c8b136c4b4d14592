import datetime
import itertools
import math
import threading
from pathlib import Path

import numpy as np
import pytest
import rawpy

from hardware.camera import exif
from hardware.errors import (
    ExposureError,
    HardwareError,
    SettingsError,
    StoppedError,
    StoreFullError,
    StudioError,
)
from hardware.interfaces import Angles, Bracket, Exposure
from hardware.virtual import sensor
from hardware.virtual.camera import SHUTTERS_S, VirtualCamera, VirtualCameraConfig
from hardware.virtual.scenes import SPHERE_M, Card, Studio
from hardware.virtual.studio import bake, motion, truth
from tests.hardware.contracts.orders import Order

SIZE = (48, 32)
NOON = datetime.datetime(2024, 6, 1, 12, 0, 0)
METERED = Bracket(Exposure(None))


class Rig:
    """Stands where it is put."""

    angles = Angles(30.0, 10.0)

    def __call__(self) -> Angles:
        return self.angles


@pytest.fixture
def rig() -> Rig:
    return Rig()


def made(rig: Rig, now=lambda: NOON, size=SIZE, **facts) -> VirtualCamera:
    return VirtualCamera(VirtualCameraConfig(size, **facts), lambda: Card("gimbal", size), rig, now)


def counts(camera: VirtualCamera, handle: str) -> np.ndarray:
    with rawpy.imread(str(camera.card / handle)) as raw:
        return raw.raw_image_visible.astype(float)


def test_it_sees_what_lies_where_the_rig_stands(rig: Rig):
    camera = made(rig)
    one = Bracket(Exposure(1 / 30), (0.0,))
    here, again = (counts(camera, camera.expose(one)[0].handle) for _ in range(2))
    rig.angles = Angles(75.0, 10.0)
    there = counts(camera, camera.expose(one)[0].handle)
    assert np.abs(there - here).mean() > 10 * np.abs(again - here).mean()
    assert (again != here).any()  # the noise of another photograph is another
    camera.close()


def test_the_counts_are_those_of_the_scene_at_that_exposure(rig: Rig):
    camera = made(rig)
    (item,) = camera.expose(Bracket(Exposure(1 / 64), (0.0,)))
    chip = sensor.Sensor()
    radiance = Card("gimbal", SIZE).look(rig.angles, 0)
    mean = np.mean([sensor.expose(radiance, 1 / 64, chip, np.random.default_rng(k)) for k in range(30)], 0)
    off = (counts(camera, item.handle) - mean) * (mean < 0.9 * chip.white)
    assert np.abs(off).max() < 6 * np.sqrt((mean - chip.black).max() * chip.counts_per_electron())
    camera.close()


class Dimmed(Card):
    """Darker by one stop for each degree of pan."""

    def look(self, angles: Angles, seed: int):
        return super().look(Angles(0.0), seed) * np.float32(2.0**-angles.pan_deg)


def dimmed(rig: Rig) -> VirtualCamera:
    return VirtualCamera(VirtualCameraConfig(SIZE), lambda: Dimmed("gimbal", SIZE), rig)


def test_a_bracket_is_metered_once_and_stays_as_it_is(rig: Rig):
    camera, rig.angles = dimmed(rig), Angles(2.0)
    first = camera.expose(METERED)
    rig.angles = Angles(5.0)
    second = camera.expose(METERED)
    shutters = [[item.exposure.shutter_s for item in taken] for taken in (first, second)]
    assert shutters[0] == shutters[1]
    assert all(shutter_s in SHUTTERS_S for shutter_s in shutters[0])
    assert shutters[0][2] / shutters[0][0] == pytest.approx(64)
    assert 0.3 * 16383 < np.percentile(counts(camera, first[1].handle), 97) <= 16383
    camera.close()


def test_what_it_meters_leaves_room_for_the_whole_bracket(rig: Rig):
    camera, rig.angles = dimmed(rig), Angles(20.0)
    assert camera.expose(METERED)[2].exposure.shutter_s == pytest.approx(SHUTTERS_S[-1])
    camera.close()


def test_a_room_that_takes_long_to_build_can_be_stopped_and_is_built_once(rig: Rig):
    go_on, built = threading.Event(), []

    def build() -> Card:
        built.append(threading.current_thread())
        assert go_on.wait(30)
        return Card("gimbal", SIZE)

    camera = VirtualCamera(VirtualCameraConfig(SIZE), build, rig)
    order = Order(lambda: camera.expose(METERED))
    while order.is_alive():
        camera.stop()
        order.join(0.1)
    assert isinstance(order.outcome, StoppedError)
    go_on.set()
    assert len(camera.expose(METERED)) == 3
    assert len(built) == 1
    assert len(list(camera.card.rglob("*.DNG"))) == 3
    camera.close()


def test_what_a_scene_cannot_show_is_told_to_who_asked(rig: Rig):
    camera = VirtualCamera(VirtualCameraConfig(SIZE), lambda: Card("crane", SIZE), rig)
    for _ in range(2):
        with pytest.raises(StudioError, match="crane"):
            camera.expose(METERED)
    camera.close()


def test_shutters_are_thirds_from_an_eight_thousandth_to_half_a_minute():
    assert SHUTTERS_S[0] == pytest.approx(1 / 8192)
    assert SHUTTERS_S[-1] == pytest.approx(32)
    assert all(two / one == pytest.approx(2 ** (1 / 3)) for one, two in itertools.pairwise(SHUTTERS_S))


@pytest.mark.parametrize(
    "base",
    [
        Exposure(0.01, 200),
        Exposure(0.01, 100, 5.6),
        Exposure(0.0),
        Exposure(-1.0),
        Exposure(math.nan),
        Exposure(20.0),
    ],
)
def test_what_it_does_not_offer_is_refused_before_anything_is_seen(rig: Rig, base):
    camera = VirtualCamera(VirtualCameraConfig(SIZE), lambda: pytest.fail("looked"), rig)
    with pytest.raises(SettingsError):
        camera.expose(Bracket(base))
    camera.close()


def test_files_tell_time_by_the_cameras_clock_one_after_the_other(rig: Rig):
    times = iter([NOON, NOON, NOON, NOON + datetime.timedelta(seconds=60)])
    camera = made(rig, lambda: next(times))
    told = [
        exif.read(camera.card / item.handle)
        for _ in range(2)
        for item in camera.expose(Bracket(Exposure(4.0), (0.0, 1.0)))
    ]
    begins = [one.time_s or 0.0 for one in told]
    noon_s = NOON.replace(tzinfo=datetime.UTC).timestamp()
    assert (begins[0], begins[-1]) == (noon_s, noon_s + 60)
    for one, two, begin, end in zip(told, told[1:], begins, begins[1:], strict=False):
        assert end >= begin + (one.shutter_s or 0.0)
        assert two.camera == one.camera
    camera.close()


def test_exposures_take_time_where_they_are_let(rig: Rig):
    waited: list[float] = []
    camera = VirtualCamera(VirtualCameraConfig(SIZE), lambda: Card("gimbal", SIZE), rig, pause=waited.append)
    camera.expose(Bracket(Exposure(1.0), (-1.0, 0.0, 1.0)))
    assert waited == pytest.approx([0.5 + sensor.READOUT_S, 1.0 + sensor.READOUT_S, 2.0 + sensor.READOUT_S])
    camera.close()


def test_names_on_a_card_that_is_kept_go_on_where_they_ended(rig: Rig, tmp_path: Path):
    camera = made(rig, card=tmp_path)
    assert camera.expose(METERED)[-1].handle == "DCIM/100ROOML/IMG_0003.DNG"
    camera.forget(camera.expose(METERED))
    camera.close()
    assert len(list(tmp_path.rglob("*.DNG"))) == 6
    camera = made(rig, card=tmp_path)
    assert camera.expose(METERED)[0].handle == "DCIM/100ROOML/IMG_0007.DNG"
    camera.close()


def test_after_the_last_number_comes_the_next_folder(rig: Rig, tmp_path: Path):
    folder = tmp_path / "DCIM" / "100ROOML"
    folder.mkdir(parents=True)
    (folder / "IMG_9998.DNG").touch()
    camera = made(rig, card=tmp_path)
    names = [item.handle for item in camera.expose(METERED)]
    assert names == ["DCIM/100ROOML/IMG_9999.DNG", "DCIM/101ROOML/IMG_0001.DNG", "DCIM/101ROOML/IMG_0002.DNG"]
    camera.close()


def test_a_card_of_its_own_is_freed_and_removed(rig: Rig):
    camera = made(rig)
    camera.forget(camera.expose(METERED)[:2])
    assert len(list(camera.card.rglob("*.DNG"))) == 1
    camera.close()
    assert not camera.card.exists()


def test_a_transfer_cut_short_is_made_again(rig: Rig, tmp_path: Path):
    camera = made(rig)
    (item,) = camera.expose(Bracket(Exposure(None), (0.0,)))
    camera.faults.cut = 2
    frame = camera.download(item, tmp_path / "a.dng")
    assert frame.path.read_bytes() == (camera.card / item.handle).read_bytes()
    assert camera.faults.cut == 0
    camera.faults.cut = 3
    with pytest.raises(ExposureError, match="bytes arrived"):
        camera.download(item, tmp_path / "b.dng")
    camera.close()


@pytest.mark.parametrize("fault", ["busy", "lost"])
def test_a_passing_fault_passes(rig: Rig, fault):
    camera = made(rig)
    setattr(camera.faults, fault, 2)
    for _ in range(2):
        with pytest.raises(ExposureError):
            camera.expose(METERED)
    assert len(camera.expose(METERED)) == 3
    camera.close()


def test_the_card_fills_up_in_the_middle_of_a_bracket(rig: Rig):
    camera = made(rig)
    camera.faults.room = 4
    camera.expose(METERED)
    assert camera.status().free_shots == 1
    with pytest.raises(StoreFullError):
        camera.expose(METERED)
    assert camera.status().free_shots == 0
    camera.close()


def test_a_card_that_cannot_be_written_is_told(rig: Rig, tmp_path: Path):
    (tmp_path / "DCIM").touch()
    camera = made(rig, card=tmp_path)
    with pytest.raises(HardwareError, match="cannot be written"):
        camera.expose(METERED)


@pytest.mark.parametrize("facts", [{"size": (47, 32)}, {"size": (8, 8)}, {"seed": -1}])
def test_what_cannot_be_built_is_refused_at_once(rig: Rig, facts):
    with pytest.raises(SettingsError):
        made(rig, **facts)


def test_a_place_in_the_cards_surroundings_looks_the_same_from_everywhere():
    size = (320, 240)
    card, lens = Card("gimbal", size), truth.camera(*size)
    places = (Angles(20.0, 15.0), Angles(34.0, 6.0))
    pictures = [card.look(angles, 0) for angles in places]
    poses = [motion.pose_of("gimbal", np.zeros(3), angles.pan_deg, angles.tilt_deg) for angles in places]
    rows, columns = np.mgrid[4:236:3, 4:316:3]
    rays = np.stack(
        [
            (columns + 0.5 - lens["cx"]) / lens["fx"],
            (rows + 0.5 - lens["cy"]) / lens["fy"],
            np.ones(rows.shape),
        ],
        -1,
    )
    rays = rays.reshape(-1, 3) @ poses[0][:, :3].T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    along, place = rays @ poses[0][:, 3], poses[0][:, 3]
    points = place + rays * (-along + np.sqrt(along**2 - place @ place + SPHERE_M**2))[:, None]
    local = (points - poses[1][:, 3]) @ poses[1][:, :3]
    x, y = (local[:, :2] / local[:, 2:]).T * lens["fx"] + [[lens["cx"]], [lens["cy"]]]
    clear = np.hypot(columns - 160, rows - 120).ravel() > 80
    seen = (
        clear
        & (local[:, 2] > 0)
        & (x > 4)
        & (x < 316)
        & (y > 4)
        & (y < 236)
        & (np.hypot(x - 160, y - 120) > 80)
    )
    assert seen.sum() > 1000
    first = pictures[0][rows, columns].reshape(-1, 3)[seen]
    second = pictures[1][y[seen].astype(int), x[seen].astype(int)]
    # Within half a pixel the pattern changes by some percent; elsewhere on the sphere it is another.
    assert np.median(np.abs(np.log(second / first))) < 0.08
    assert np.median(np.abs(np.log(np.roll(second, 777, 0) / first))) > 0.4


def test_the_cards_object_stays_and_its_shading_turns_with_the_lamps():
    card = Card("gimbal", SIZE)
    here, there = card.look(Angles(0.0), 0), card.look(Angles(90.0), 0)
    middle = (slice(13, 19), slice(21, 27))
    assert np.ptp(here[middle][..., 0]) > 0.05
    ratio = there[middle] / here[middle]
    np.testing.assert_allclose(ratio[..., 0], ratio[..., 2], rtol=1e-5)  # another light, the same paint
    assert np.abs(ratio - 1).max() > 0.05


@pytest.fixture
def unbaked(monkeypatch):
    """Rooms with coarse paint that shine by themselves, so that nothing has to be baked."""
    monkeypatch.setattr("hardware.virtual.studio.rooms.TEXEL_M", 0.03)
    monkeypatch.setattr(
        bake,
        "bake",
        lambda room, cache, device, progress: bake.pack(room.panels, [p.albedo for p in room.panels]),
    )


def test_the_studio_is_seen_from_the_rigs_pose_with_the_object_before_it(unbaked, tmp_path: Path):
    size = (32, 24)
    scene = Studio("plain", "sphere", "gimbal", size, 4, tmp_path, lambda share, note: None)
    angles = Angles(40.0, 20.0)
    pose = scene.pose(angles)
    np.testing.assert_allclose(pose, motion.pose_of("gimbal", np.array([0.0, 0.0, 1.35]), 40.0, 20.0))
    picture = scene.look(angles, 3)
    alone = scene._back.look(pose, *size, 3)
    touched = truth.touched(scene.body, *size)
    np.testing.assert_array_equal(picture[~touched], alone[~touched])
    assert np.abs(picture[touched] - alone[touched]).mean() > 0.02
    told = scene.truth([angles], lambda share, note: None)
    assert told.cam_from_world.shape == (1, 3, 4)
    assert told.panoramas.shape == (1, 128, 256, 3)
    both = np.vstack([told.cam_from_world[0], [0, 0, 0, 1]]) @ np.vstack([pose, [0, 0, 0, 1]])
    np.testing.assert_allclose(both, np.eye(4), atol=1e-12)
    assert told.mask.shape == size[::-1]
