"""Zaber firmware 7 on a two-axis controller: what it answers, how its stages move, and what may go wrong with it.

Source: Zaber "ASCII Protocol Reference Manual", firmware 7. Numbers of products are those of a real controller and
rotary stage, speeds and travel are ours. Where the manual leaves a choice the harsher one is taken: an axis without
a reference moves, from a zero that is not its own. Methods may be called from any thread; times are seconds.
"""

import re
import threading
from collections.abc import Callable, Iterator, Sequence

from hardware.interfaces import Angles
from hardware.virtual.zaber.axis import SPEED_UNIT, Axis, Refused, Stage, whole, works_settings
from hardware.zaber.messages import FLAGS, LONGEST_PACKET, checksum

PAN = Stage()
TILT = Stage(lowest_deg=-90.0, highest_deg=90.0, fastest_deg_s=25.0, accel_deg_s2=90.0)
BOOT_S = 0.6  # after power comes back the processor says and hears nothing for so long
HELP = ("get SETTING", "set SETTING VALUE", "move abs|rel|vel|min|max", "home", "stop", "warnings [clear]")

_READ_ONLY = frozenset({"deviceid", "device.id", "system.serial", "version", "version.build", "system.axiscount",
                        "system.uptime", "peripheral.id", "peripheralid", "comm.packet.size.max", "driver.enabled",
                        "comm.word.size.max", "comm.command.packets.max"})  # fmt: skip


class ZaberFirmware:
    """One controller. `angles()` is where its stages truly stand, axis 1 as pan and axis 2 as tilt."""

    def __init__(self, stages: Sequence[Stage] = (PAN, TILT), address: int = 1, serial: int = 81234,
                 device: int = 30222, version: str = "7.38"):  # fmt: skip
        self._lock = threading.Lock()
        self._out = bytearray()
        self._heard = bytearray()
        self._unfinished: dict[tuple[str, str, str], str] = {}  # commands whose next packet is awaited
        self._dead_until: float | None = None  # while the processor starts
        self._infos: tuple[str, ...] = ()  # to be said after the reply
        self._to_all = False  # the command in hand was for every device on the cable
        self._estop = False
        self._now = 0.0
        self.place = 1  # on the cable, 1 nearest to the computer
        self._device: dict[str, int | str] = {
            "deviceid": device, "device.id": device, "system.serial": serial, "version": version,
            "version.build": 15942, "system.axiscount": len(stages), "system.access": 1,
            "device.hw.modified": 0, "system.voltage": "24.1",
            "comm.address": address, "comm.alert": 0, "comm.checksum": 0, "comm.rs232.baud": 115200,
            "comm.rs232.protocol": 2, "comm.protocol": 2, "comm.next.owner": 0,
            "comm.packet.size.max": LONGEST_PACKET, "comm.word.size.max": 50, "comm.command.packets.max": 2,
        }  # fmt: skip
        self.axes = [Axis(stage, works_settings(stage)) for stage in stages]
        for axis in self.axes:
            axis.position = axis.stage.stands_deg * axis.stage.steps_per_deg
            axis.power_up()

    # ---- the wire

    def receive(self, data: bytes, now: float) -> None:
        with self._lock:
            self._pass(now)
            if self._dead_until is not None:
                return
            self._heard += data
            while (end := _line_end(self._heard)) >= 0:
                packet = bytes(self._heard[:end])
                del self._heard[: end + 1]
                self._packet(packet)
            if len(self._heard) > 10 * LONGEST_PACKET:
                self._heard.clear()

    def advance(self, now: float) -> bytes:
        with self._lock:
            self._pass(now)
            out = bytes(self._out)
            self._out.clear()
            return out

    def _pass(self, now: float) -> None:
        self._now = max(self._now, now)
        if self._dead_until is not None and self._now >= self._dead_until:
            self._dead_until = None
        for number, axis in enumerate(self.axes, 1):
            if axis.advance(self._now) and self._device["comm.alert"] and self._dead_until is None:
                self._say("!", number, "", f"IDLE {self._worst([axis])}")

    # ---- packets

    def _packet(self, packet: bytes) -> None:
        start = packet.find(b"/")
        if start < 0 or len(packet) - start >= LONGEST_PACKET:
            return
        body = packet[start + 1 :]
        if summed := re.fullmatch(rb"(.*):([0-9A-Fa-f]{2})", body, re.DOTALL):
            body = summed[1]
            if checksum(body).encode() != summed[2].upper():
                return  # the manual: a message whose checksum does not fit is ignored
        try:
            text = body.decode("ascii")
        except UnicodeDecodeError:
            return
        words = text.split()
        address = words.pop(0) if words and words[0].isdecimal() else "0"
        axis = words.pop(0) if words and words[0].isdecimal() else "0"
        id = words.pop(0) if words and (words[0].isdecimal() or words[0] == "--") else ""
        if int(address) not in (0, int(self._device["comm.address"])):
            return
        if id.isdecimal() and int(id) > 99:
            return self._reply(0, "", False, "BADMESSAGEID")
        id = id if id in ("", "--") else f"{int(id):02d}"
        command = self._assembled((address, axis, id), words)
        if command is None:
            return None
        self._infos, self._to_all = (), int(address) == 0
        try:
            accepted, data = True, self._obey(int(axis), command)
        except Refused as reason:
            accepted, data = False, str(reason)
        self._reply(int(axis), id, accepted, data)

    def _assembled(self, whose: tuple[str, str, str], words: list[str]) -> list[str] | None:
        """All words of a command that may have come in several packets; None while more are to come."""
        if words[:1] == ["cont"]:
            words = (self._unfinished.pop(whose, "") + " " + " ".join(words[2:])).split()
        if words and words[-1].endswith("\\"):
            self._unfinished = {whose: " ".join(words)[:-1]}
            return None
        return words

    def _reply(self, axis: int, id: str, accepted: bool, data: str) -> None:
        if id == "--":  # the sender wants no answer
            return
        about = self._about(axis) if 0 < axis <= len(self.axes) else self.axes
        status = "BUSY" if any(one.busy for one in about) else "IDLE"
        self._say("@", axis, id, f"{'OK' if accepted else 'RJ'} {status} {self._worst(about)} {data or '0'}")
        for line in self._infos:
            self._say("#", axis, id, line)

    def _say(self, kind: str, axis: int, id: str, rest: str) -> None:
        head = f"{int(self._device['comm.address']):02d} {axis}" + (f" {id}" if id else "")
        room = LONGEST_PACKET - len(head) - 8
        for packet, goes_on in _packets(rest, room):
            body = f"{head} {packet}" + ("\\" if goes_on else "")
            footer = f":{checksum(body.encode())}" if self._device["comm.checksum"] else ""
            self._out += f"{kind}{body}{footer}\r\n".encode("ascii")
            kind = "#"

    def _worst(self, axes: Sequence[Axis]) -> str:
        return next((flag for flag in FLAGS if any(flag in axis.flags for axis in axes)), "--")

    def _about(self, number: int) -> list[Axis]:
        if number > len(self.axes):
            raise Refused("BADAXIS")
        return [self.axes[number - 1]] if number else self.axes

    # ---- commands

    def _obey(self, number: int, words: list[str]) -> str:
        """Carry a command out; returns the data of its reply.

        Raises:
            Refused: with the reason that the reply names.
        """
        axes = self._about(number)
        if not words:
            return ""
        if len(max(words, key=len)) > 50:
            raise Refused("LONGWORD")
        orders: dict[str, Callable[[int, list[Axis], list[str]], str]] = {
            "get": self._get, "set": self._set, "move": self._move, "home": self._home, "stop": self._stop,
            "estop": self._stop, "warnings": self._warnings, "driver": self._driver, "tools": self._tools,
            "renumber": self._renumber, "system": self._system, "help": self._help,
        }  # fmt: skip
        if words[0] not in orders:
            raise Refused("BADCOMMAND")
        return orders[words[0]](number, axes, words)

    def _get(self, number: int, axes: list[Axis], words: list[str]) -> str:
        if len(words) != 2:
            raise Refused("BADDATA" if len(words) > 2 else "BADCOMMAND")
        name = words[1]
        if name in self._device or name == "system.uptime":
            if number:
                raise Refused("DEVICEONLY")
            return str(int(1000 * self._now) if name == "system.uptime" else self._device[name])
        return " ".join(str(axis.get(name)) for axis in axes)

    def _set(self, number: int, axes: list[Axis], words: list[str]) -> str:
        if len(words) < 2 or words[1] in _READ_ONLY:
            raise Refused("BADCOMMAND")
        name = words[1]
        value = whole(words[2:])
        if name in self._device:
            if number:
                raise Refused("DEVICEONLY")
            low, high = {"comm.address": (1, 99), "comm.alert": (0, 1), "comm.checksum": (0, 1)}.get(
                name, (0, 921600)
            )
            if not low <= value <= high:
                raise Refused("BADDATA")
            self._device[name] = value
            return ""
        for axis in axes:
            axis.set(name, value)
        return ""

    def _move(self, number: int, axes: list[Axis], words: list[str]) -> str:
        how = words[1] if len(words) > 1 else ""
        if how not in ("abs", "rel", "vel", "min", "max"):
            raise Refused("BADCOMMAND")
        self._powered(axes)
        value = 0 if how in ("min", "max") else whole(words[2:])
        goals = []
        for axis in axes:
            low, high = axis.settings["limit.min"], axis.settings["limit.max"]
            goal = {"abs": value, "rel": round(axis.position) + value, "min": low, "max": high,
                    "vel": high if value > 0 else low}[how]  # fmt: skip
            if not low <= goal <= high:
                raise Refused("BADDATA")
            goals.append(goal)
        for axis, goal in zip(axes, goals, strict=True):
            if how == "vel" and value == 0:
                axis.stop()
            else:
                axis.go(goal, abs(value) / SPEED_UNIT if how == "vel" else None)
        return ""

    def _home(self, number: int, axes: list[Axis], words: list[str]) -> str:
        self._powered(axes)
        for axis in axes:
            axis.home()
        return ""

    def _stop(self, number: int, axes: list[Axis], words: list[str]) -> str:
        for axis in axes:
            if axis.busy:
                axis.stop() if words[0] == "stop" else axis.halt()
        return ""

    def _warnings(self, number: int, axes: list[Axis], words: list[str]) -> str:
        if words[1:] not in ([], ["clear"]):
            raise Refused("BADDATA")
        shown = [flag for flag in FLAGS if any(flag in axis.flags for axis in axes)]
        if words[1:]:
            for axis in axes:
                axis.flags &= {"WR", "WH", "FH"}  # what still holds cannot be cleared
        return " ".join([f"{len(shown):02d}", *shown])

    def _driver(self, number: int, axes: list[Axis], words: list[str]) -> str:
        if words[1:] not in (["enable"], ["disable"]):
            raise Refused("BADCOMMAND")
        for axis in axes:
            if words[1] == "disable":
                axis.driver_off("FO")
            elif not self._estop:
                axis.driver = True
                axis.flags -= {"FO", "FH"}
        return ""

    def _tools(self, number: int, axes: list[Axis], words: list[str]) -> str:
        if words[1:2] != ["echo"]:
            raise Refused("BADCOMMAND")
        return " ".join(words[2:])

    def _renumber(self, number: int, axes: list[Axis], words: list[str]) -> str:
        if number:
            raise Refused("DEVICEONLY")
        address = whole(words[1:]) if len(words) > 1 else 1
        address += self.place - 1 if self._to_all else 0
        if not 1 <= address <= 99:
            raise Refused("BADDATA")
        self._device["comm.address"] = address
        return ""

    def _system(self, number: int, axes: list[Axis], words: list[str]) -> str:
        if words[1:] != ["reset"]:
            raise Refused("BADCOMMAND")
        if number:
            raise Refused("DEVICEONLY")
        self._restart(self._now)
        return ""

    def _help(self, number: int, axes: list[Axis], words: list[str]) -> str:
        self._infos = HELP
        return ""

    def _powered(self, axes: list[Axis]) -> None:
        if not all(axis.driver for axis in axes):
            raise Refused("DRIVERDISABLED")

    # ---- what happens to it

    def angles(self) -> Angles:
        """Where its stages truly stand, whatever it says."""
        with self._lock:
            pan = self.axes[0].angle_deg
            return Angles(pan, self.axes[1].angle_deg if len(self.axes) > 1 else 0.0)

    def stall(self, number: int = 1) -> None:
        """Something is in the way of an axis: the motion under way, or else the next one, ends in FS."""
        with self._lock:
            self.axes[number - 1].stuck = True

    def encoder_error(self, number: int = 1) -> None:
        """FQ: the axis stops, and its count cannot be believed."""
        with self._lock:
            self.axes[number - 1].halt()
            self.axes[number - 1].flags |= {"FQ", "WR"}

    def press_estop(self) -> None:
        """The red button: the drivers lose their current until it is released and they are enabled again."""
        with self._lock:
            self._estop = True
            for axis in self.axes:
                axis.driver_off("FH")

    def release_estop(self) -> None:
        with self._lock:
            self._estop = False

    def turn_knob(self, number: int = 1, degrees: float = 5.0) -> None:
        """A person turns the knob: the axis goes by itself, and shows NC."""
        with self._lock:
            axis = self.axes[number - 1]
            axis.go(axis.position + degrees * axis.stage.steps_per_deg)
            axis.flags.add("NC")

    def brown_out(self) -> None:
        """Power sags: the processor starts anew and has lost its reference; the stages stay where they are."""
        with self._lock:
            self._restart(self._now)

    def _restart(self, now: float) -> None:
        for axis in self.axes:
            axis.power_up()
        self._heard.clear()
        self._unfinished = {}
        self._dead_until = now + BOOT_S


def _packets(text: str, room: int) -> Iterator[tuple[str, bool]]:
    """The parts of a message, cut between words, and whether more follow; the reader puts the spaces back."""
    words, packet = text.split(" "), ""
    for word in words:
        if packet and len(packet) + 1 + len(word) > room:
            yield packet, True
            packet = "cont"
        packet += " " + word if packet else word
    yield packet, False


def _line_end(heard: bytearray) -> int:
    """Where the first line ends; -1 if none does. Either of CR and LF ends a line."""
    return next((i for i, byte in enumerate(heard) if byte in b"\r\n"), -1)


class Chain:
    """Several controllers on one cable, the first nearest to the computer."""

    def __init__(self, devices: Sequence[ZaberFirmware]):
        self.devices = tuple(devices)
        for place, device in enumerate(self.devices, 1):
            device.place = place

    def receive(self, data: bytes, now: float) -> None:
        for device in self.devices:
            device.receive(data, now)

    def advance(self, now: float) -> bytes:
        return b"".join(device.advance(now) for device in self.devices)
