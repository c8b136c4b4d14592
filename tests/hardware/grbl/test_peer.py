"""A host that nobody here wrote drives the GRBL emulator: grbl-streamer (GPL, used in tests only)."""

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from hardware.virtual.grbl.firmware import GrblFirmware
from hardware.virtual.grbl.motion import Mechanics
from hardware.virtual.wire import Wire
from tests.hardware.contracts.grbl_rigs import SWITCHED
from tests.hardware.contracts.orders import wait

grbl_streamer = pytest.importorskip("grbl_streamer")

ENDS = Mechanics((-185.0, -50.0, None), (185.0, 50.0, None), start=(-170.0, -40.0, 0.0))


class Peer:
    """The host, connected, and all that it called back."""

    def __init__(self, port: str):
        self._lock = threading.Lock()
        self.events: list[tuple[str, tuple[Any, ...]]] = []
        self.host = grbl_streamer.GrblStreamer(self._called)
        self.host.poll_interval = 0.02
        self.host.cnect(port, 115200)

    def _called(self, event: str, *data: Any) -> None:
        with self._lock:
            self.events.append((event, data))

    def told(self, event: str) -> list[tuple[Any, ...]]:
        with self._lock:
            return [data for name, data in self.events if name == event]

    def forget(self) -> None:
        with self._lock:
            self.events.clear()

    def run(self, lines: list[str]) -> None:
        """Stream a job and wait until every line is answered; it polls nothing meanwhile, which would miscount."""
        self.host.poll_stop()
        time.sleep(0.05)
        self.forget()
        self.host.job_new()
        self.forget()
        self.host.write(lines)
        self.host.job_run()
        wait(lambda: bool(self.told("on_job_completed") or self.told("on_error")), "the job never ended")
        self.host.poll_start()

    def place(self, found: Callable[[tuple[float, ...]], bool]) -> None:
        wait(lambda: self.host.cmode == "Idle" and found(self.host.cmpos), f"stands at {self.host.cmpos}")

    def close(self) -> None:
        self.host.connected = True  # otherwise it would leave its threads behind
        self.host.disconnect()


@pytest.fixture
def rig() -> Iterator[tuple[Peer, GrblFirmware]]:
    firmware = GrblFirmware(SWITCHED, ENDS)
    wire = Wire(firmware, lambda: 20 * time.monotonic())
    peer = Peer(wire.port)
    try:
        wait(peer.host.is_connected, "never connected")
        peer.host.poll_start()
        yield peer, firmware
    finally:
        peer.close()
        wire.close()


def homed(peer: Peer) -> None:
    peer.host.homing()
    peer.place(lambda place: place == (-370.0, -100.0, 0.0))


def test_it_connects_reads_the_alarm_state_and_the_settings(rig: tuple[Peer, GrblFirmware]):
    peer, _ = rig
    wait(lambda: peer.host.cmode == "Alarm", "with homing it starts locked")
    assert peer.told("on_boot")
    read = [line for (line,) in peer.told("on_read")]
    assert "Grbl 1.1h ['$' for help]" in read
    wait(lambda: ("$110=3600.000",) in peer.told("on_read"), "settings never came")
    wait(lambda: bool(peer.told("on_hash_stateupdate")[1:]), "offsets never came")
    assert peer.host.settings_hash["G54"] == (0.0, 0.0, 0.0)


def test_it_homes(rig: tuple[Peer, GrblFirmware]):
    peer, firmware = rig
    homed(peer)
    assert firmware.angles().pan_deg == pytest.approx(-184.0, abs=0.01)
    assert firmware.angles().tilt_deg == pytest.approx(-49.0, abs=0.01)


def test_it_streams_a_program_by_counting_characters_and_settles(rig: tuple[Peer, GrblFirmware]):
    peer, firmware = rig
    homed(peer)
    lines = [f"G1 X{-360 + 2 * step}.250 Y{-90 + step} F3600" for step in range(50)]
    peer.run(["G21 G90 G94", *lines, "G4 P0.01"])
    place = firmware.angles()  # the last `ok` came after all motion
    assert place.pan_deg == pytest.approx(-262.25 + 186.0, abs=0.01)
    assert place.tilt_deg == pytest.approx(-41.0 + 51.0, abs=0.01)
    assert not peer.told("on_error")
    assert len(peer.told("on_processed_command")) == len(peer.host.buffer)
    assert max(percent for (percent,) in peer.told("on_rx_buffer_percent")) <= 100
    peer.place(lambda at: at == (-262.25, -41.0, 0.0))


def test_it_streams_line_by_line_too(rig: tuple[Peer, GrblFirmware]):
    peer, _ = rig
    homed(peer)
    peer.host.incremental_streaming = True
    peer.run(["G91", *["G1 X1 F3600"] * 20, "G90", "G4 P0.01"])
    peer.place(lambda at: at[0] == -350.0)


def test_it_holds_and_resumes(rig: tuple[Peer, GrblFirmware]):
    peer, _ = rig
    homed(peer)
    peer.host.send_immediately("G1 X-10 F900")
    wait(lambda: peer.host.cmode == "Run", "it never ran")
    peer.host.hold()
    wait(lambda: peer.host.cmode == "Hold:0", "it was never held")
    assert -370.0 < peer.host.cmpos[0] < -10.0
    peer.host.set_feed_override(False)
    peer.host.resume()
    peer.place(lambda at: at[0] == -10.0)


def test_it_is_told_errors_and_alarms(rig: tuple[Peer, GrblFirmware]):
    peer, firmware = rig
    homed(peer)
    peer.run(["G1 X-300 F3600", "G10 L3 P1 X0", "G1 X-290"])
    assert peer.told("on_error")[0][0] == "error:20"
    firmware.hit_limit()
    wait(lambda: ("ALARM:1",) in peer.told("on_alarm"), "the alarm was never told")

    def booted() -> bool:
        peer.host.softreset()  # GRBL overhears it for half a second after the alarm
        return bool(peer.told("on_boot"))

    wait(booted, "it never booted")
