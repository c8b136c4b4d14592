"""The promises of `Camera`, kept by every camera: subclass `CameraPromises` with a fixture `made`.

`made` is a camera just opened, with the facts that a test needs of it (`Made`). A promise that does not apply to a camera
(nobody can unplug it, it has no room to fill, ...) is skipped for it where its maker gives no way to try.
"""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from hardware.camera import exif
from hardware.camera.transfer import file_sha256
from hardware.errors import (
    BatteryError,
    DisconnectedError,
    ExposureError,
    HardwareError,
    SettingsError,
    StoppedError,
    StoreFullError,
)
from hardware.interfaces import Bracket, Camera, Taken
from tests.hardware.contracts.orders import PATIENCE_S, Order


@dataclass(frozen=True, slots=True)
class Made:
    """A camera under test and ways to make trouble."""

    camera: Camera
    bracket: Bracket  # three exposures that it offers
    single: Bracket
    stored: Callable[[Taken], bytes]  # what truly lies on the camera
    count: Callable[[], int]  # how many photographs it has taken
    told: bool = True  # its files tell their exposure
    impossible: Bracket | None = None  # something in it is not offered
    hang: Callable[[], None] | None = None  # from now on no photograph comes
    heal: Callable[[], None] | None = None  # ... and again they do
    damage: Callable[[int], None] | None = None  # so many of the next transfers arrive damaged
    lose: Callable[[Taken], None] | None = None  # takes a photograph off the camera
    fill: Callable[[], None] | None = None  # no more room
    drain: Callable[[], None] | None = None  # the battery is low
    pull: Callable[[], None] | None = None  # unplugs it


class CameraPromises:
    """Subclass me with a fixture `made`."""

    def test_features_can_be_meant(self, made: Made):
        features = made.camera.features
        assert made.camera.name
        assert features.model
        assert list(features.shutters_s) == sorted(set(features.shutters_s))
        assert all(shutter_s > 0 for shutter_s in features.shutters_s)
        assert features.sets_exposure == bool(features.shutters_s)
        assert features.suffix == "" or (features.suffix.startswith(".") and features.suffix.islower())

    def test_status_tells_that_it_is_ready(self, made: Made):
        status = made.camera.status()
        assert status.ready, status.message
        assert status.battery is None or 0 <= status.battery <= 1
        assert status.free_shots is None or status.free_shots > 0

    def test_a_bracket_is_told_in_the_order_it_was_asked_for(self, made: Made):
        taken = made.camera.expose(made.bracket)
        assert tuple(item.ev for item in taken) == made.bracket.stops
        assert len({item.handle for item in taken}) == len(taken)
        assert made.count() == len(taken)

    def test_more_light_is_asked_for_where_more_is_told(self, made: Made):
        taken = made.camera.expose(made.bracket)
        for one, two in itertools.pairwise(sorted(taken, key=lambda item: item.ev)):
            if one.exposure.shutter_s is not None and two.exposure.shutter_s is not None:
                assert two.exposure.shutter_s > 1.5 * one.exposure.shutter_s

    def test_what_is_downloaded_is_what_was_stored(self, made: Made, tmp_path: Path):
        for index, item in enumerate(made.camera.expose(made.bracket)):
            frame = made.camera.download(item, tmp_path / f"{index}{Path(item.handle).suffix}")
            assert frame.path.read_bytes() == made.stored(item)
            assert frame.bytes == frame.path.stat().st_size > 0
            assert frame.sha256 == file_sha256(frame.path)
            assert frame.original == Path(item.handle).name
            assert frame.taken == item
        assert len(list(tmp_path.iterdir())) == len(made.bracket.stops)

    def test_a_file_tells_the_exposure_that_the_camera_told(self, made: Made, tmp_path: Path):
        if not made.told:
            pytest.skip("its files tell nothing")
        for item in made.camera.expose(made.bracket):
            told = exif.read(made.camera.download(item, tmp_path / Path(item.handle).name).path)
            assert told.shutter_s == pytest.approx(item.exposure.shutter_s, rel=0.1)

    def test_it_stays_on_the_camera_until_it_is_forgotten(self, made: Made, tmp_path: Path):
        (item,) = made.camera.expose(made.single)
        first = made.camera.download(item, tmp_path / "first.dng")
        again = made.camera.download(item, tmp_path / "again.dng")
        assert first.sha256 == again.sha256
        made.camera.forget([item])
        made.camera.forget([])

    def test_a_download_replaces_what_was_there(self, made: Made, tmp_path: Path):
        (item,) = made.camera.expose(made.single)
        (tmp_path / "a.dng").write_bytes(b"of an earlier try")
        assert made.camera.download(item, tmp_path / "a.dng").path.read_bytes() == made.stored(item)

    def test_no_photograph_is_handed_out_twice(self, made: Made):
        handles = [item.handle for _ in range(3) for item in made.camera.expose(made.bracket)]
        assert len(set(handles)) == 9 == made.count()

    def test_what_is_not_offered_takes_nothing(self, made: Made):
        if made.impossible is None:
            pytest.skip("offers everything")
        with pytest.raises(SettingsError):
            made.camera.expose(made.impossible)
        assert made.count() == 0
        made.camera.expose(made.bracket)

    def test_a_disk_that_refuses_is_told(self, made: Made, tmp_path: Path):
        (item,) = made.camera.expose(made.single)
        with pytest.raises(HardwareError, match="cannot be written"):
            made.camera.download(item, tmp_path / "no such folder" / "a.dng")

    def test_a_damaged_transfer_is_made_again(self, made: Made, tmp_path: Path):
        if made.damage is None:
            pytest.skip("nobody can damage it")
        (item,) = made.camera.expose(made.single)
        made.damage(1)
        assert made.camera.download(item, tmp_path / "a.dng").path.read_bytes() == made.stored(item)

    def test_what_never_arrives_whole_leaves_nothing(self, made: Made, tmp_path: Path):
        if made.damage is None:
            pytest.skip("nobody can damage it")
        (item,) = made.camera.expose(made.single)
        made.damage(1000)
        with pytest.raises(ExposureError):
            made.camera.download(item, tmp_path / "a.dng")
        assert not list(tmp_path.iterdir())

    def test_a_photograph_that_is_gone_is_told(self, made: Made, tmp_path: Path):
        if made.lose is None:
            pytest.skip("nobody can take one away")
        (item,) = made.camera.expose(made.single)
        made.lose(item)
        with pytest.raises(ExposureError):
            made.camera.download(item, tmp_path / "a.dng")
        assert not list(tmp_path.iterdir())

    def test_stop_ends_the_wait_for_a_photograph(self, made: Made):
        if made.hang is None or made.heal is None:
            pytest.skip("never lets one wait")
        made.hang()
        order = Order(lambda: made.camera.expose(made.single))
        time.sleep(0.1)
        assert order.is_alive()
        begin = time.monotonic()
        while order.is_alive():  # a stop counts for an order under way: one too early must be made again
            made.camera.stop()
            order.join(0.5)
            assert time.monotonic() - begin < PATIENCE_S
        assert isinstance(order.outcome, StoppedError)
        made.heal()
        assert len(made.camera.expose(made.bracket)) == 3

    def test_status_is_told_while_it_waits(self, made: Made):
        if made.hang is None or made.heal is None:
            pytest.skip("never lets one wait")
        made.hang()
        order = Order(lambda: made.camera.expose(made.single))
        time.sleep(0.1)
        begin = time.monotonic()
        made.camera.status()
        assert time.monotonic() - begin < 2.0  # promised are 0.5 s; this machine may be busy
        while order.is_alive():
            made.camera.stop()
            order.join(0.5)

    def test_stop_at_rest_does_no_harm(self, made: Made):
        made.camera.stop()
        assert len(made.camera.expose(made.bracket)) == 3
        made.camera.stop()
        made.camera.stop()
        assert len(made.camera.expose(made.bracket)) == 3

    def test_no_more_room_is_told(self, made: Made):
        if made.fill is None:
            pytest.skip("has room for ever")
        made.fill()
        for _ in range(2):
            with pytest.raises(StoreFullError):
                made.camera.expose(made.bracket)

    def test_a_low_battery_is_told_before_anything_is_taken(self, made: Made):
        if made.drain is None:
            pytest.skip("does not tell")
        made.drain()
        status = made.camera.status()
        assert not status.ready
        assert "battery" in status.message
        with pytest.raises(BatteryError):
            made.camera.expose(made.bracket)
        assert made.count() == 0

    def test_a_pulled_cable_is_told(self, made: Made, tmp_path: Path):
        if made.pull is None:
            pytest.skip("has no cable")
        (item,) = made.camera.expose(made.single)
        made.pull()
        with pytest.raises(DisconnectedError):
            made.camera.expose(made.bracket)
        with pytest.raises(DisconnectedError):
            made.camera.download(item, tmp_path / "a.dng")
        status = made.camera.status()
        assert not status.ready
        assert status.message
        assert not list(tmp_path.iterdir())

    def test_close_may_be_called_twice_and_ends_the_work(self, made: Made, tmp_path: Path):
        (item,) = made.camera.expose(made.single)
        made.camera.close()
        made.camera.close()
        with pytest.raises(HardwareError):
            made.camera.expose(made.single)
        with pytest.raises(HardwareError):
            made.camera.download(item, tmp_path / "a.dng")
        assert not made.camera.status().ready

    def test_close_ends_the_wait_for_a_photograph(self, made: Made):
        if made.hang is None:
            pytest.skip("never lets one wait")
        made.hang()
        order = Order(lambda: made.camera.expose(made.single))
        time.sleep(0.1)
        made.camera.close()
        assert isinstance(order.finished(), HardwareError)
