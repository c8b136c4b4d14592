"""Open Zaber stages: say where they are plugged in, find that they are what was meant, and what a degree is to them.

One or two axes, on one controller or on two of a chain. Source: Zaber "ASCII Protocol Reference Manual", firmware 7,
section Settings. `hardware.zaber.rig` moves them. Angles are degrees, times seconds. In a device URL:

    zaber:///dev/ttyUSB0?axes=1.1,1.2&tilt=-40..60&zero=0,90&serial=81234
"""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from hardware.errors import RefusedError, ReplyError, SettingsError, WrongDeviceError
from hardware.interfaces import Motion
from hardware.line import Line
from hardware.urls import Word, one_of, pair, read_words, span, whole
from hardware.zaber import messages
from hardware.zaber.link import Link
from hardware.zaber.rig import Stage, Zaber, count

SPEED_UNIT = 1.6384  # `maxspeed` is this many per microstep/s (manual, section Speed and Acceleration Units)
BAUD = 115200  # of every device as it leaves the works
OLDEST = 6.06  # firmware that speaks ASCII


@dataclass(frozen=True, slots=True)
class ZaberAxis:
    """Which axis of which device, and what its counts mean.

    `steps_per_deg` is asked of the device (`limit.cycle.dist`) if None; negative if the stage turns the other
    way. `zero_deg` is what the stage itself calls the angle that the rig calls 0. Travel is what the rig allows
    within the device's own limits.
    """

    address: int = 1
    number: int = 1
    steps_per_deg: float | None = None
    zero_deg: float = 0.0
    lowest_deg: float | None = None
    highest_deg: float | None = None


@dataclass(frozen=True, slots=True)
class ZaberConfig:
    """A port and what is on it; `serial` is the number printed on the device, None to take any."""

    port: str
    baud: int = BAUD
    pan: ZaberAxis = ZaberAxis()
    tilt: ZaberAxis | None = None
    serial: int | None = None
    homing: str = "sensors"  # "none": the place where the rig is homed becomes zero
    reply_s: float = 0.5  # longest wait for an answer
    home_s: float = 180.0  # longest time that homing may take

    @classmethod
    def from_query(cls, port: str, query: Mapping[str, str]) -> "ZaberConfig":
        """From the words after `?` of a device URL; pairs are pan, tilt.

        Raises:
            SettingsError: a word that is not known, or a value that cannot be meant.
        """
        read = read_words("zaber", query, WORDS)
        places = read.get("axes", ((1, 1),))
        axes = []
        for index, (name, (address, number)) in enumerate(zip(("pan", "tilt"), places, strict=False)):
            steps, zero = (read[word][index] if word in read else None for word in ("steps", "zero"))
            lowest, highest = read.get(name, (None, None))
            axes.append(ZaberAxis(address, number, steps, zero or 0.0, lowest, highest))
        if "tilt" in read and len(axes) < 2:
            raise SettingsError("zaber: tilt= was given but only one axis; write it like axes=1.1,1.2")
        tilt = axes[1] if len(axes) > 1 else None
        homing = read.get("homing", "sensors")
        return cls(port, read.get("baud", BAUD), axes[0], tilt, read.get("serial"), homing)


def _axes(text: str) -> tuple[tuple[int, int], ...]:
    found = [re.fullmatch(r"([1-9]\d?)\.([1-9])", part) for part in text.split(",")]
    if not 1 <= len(found) <= 2 or None in found:
        raise ValueError
    places = tuple((int(match[1]), int(match[2])) for match in found if match)
    if len(set(places)) != len(places):
        raise ValueError
    return places


def _steps(text: str) -> tuple[float, float]:
    both = pair(text)
    if 0.0 in both:
        raise ValueError
    return both


WORDS = {
    "axes": Word(_axes, "1.1,1.2 (device.axis of pan, of tilt)"),
    "baud": Word(whole(1, 10_000_000), "115200"),
    "homing": Word(one_of("sensors", "none"), "sensors or homing=none"),
    "pan": Word(span, "-180..180"),
    "serial": Word(whole(1, 2**32), "81234 (as printed on the device)"),
    "steps": Word(
        _steps, "4266.667 or steps=4266.667,-800 (microsteps per degree; negative turns the other way)"
    ),
    "tilt": Word(span, "-40..60"),
    "zero": Word(pair, "0,90 (what the stages call the angles that the rig calls 0)"),
}


def open_zaber(
    config: ZaberConfig,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Motion:
    """The rig on `config.port`.

    Raises:
        AbsentError, AccessError, BusyError: the port.
        WrongDeviceError: what answers is no Zaber device in ASCII at this speed, or not the one named.
        SettingsError: an axis whose steps per degree are not known.
    """
    line = Line(config.port, config.baud, clock)
    try:
        line.drop_input()
        link = Link(line, config.reply_s, clock)
        wanted = [("pan", config.pan)] + ([("tilt", config.tilt)] if config.tilt else [])
        addresses = tuple(dict.fromkeys(axis.address for _, axis in wanted))
        name = _greet(config, link, addresses)
        _demand_checksums(link, addresses)
        stages = [_found(name, axis, link) for name, axis in wanted]
        return Zaber(name, link, stages, config.homing == "sensors", config.home_s, clock, sleep)
    except BaseException:
        line.close()
        raise


def _greet(config: ZaberConfig, link: Link, addresses: Sequence[int]) -> str:
    """The name of what answers, after checking that it is what was named."""
    told = []
    for address in addresses:
        version = messages.number(_first(config, link, address).data)
        if version < OLDEST:
            raise WrongDeviceError(
                f"{config.port}: the device at address {address} has firmware {version}; {OLDEST} or newer is needed"
            )
        model, serial = (link.ask(address, 0, f"get {name}").data for name in ("deviceid", "system.serial"))
        if config.serial is not None and address == config.pan.address and serial != str(config.serial):
            raise WrongDeviceError(
                f"{config.port}: the device there has serial number {serial}, not {config.serial}; "
                "plug in the one that is meant or correct serial= in the device URL"
            )
        told.append(f"Zaber {model} (firmware {version}, serial number {serial})")
    return f"{' and '.join(told)} at {config.port}"


def _first(config: ZaberConfig, link: Link, address: int) -> messages.Message:
    """The first answer on this port: if none comes, something else is plugged in, or it is set up otherwise."""
    try:
        return link.ask(address, 0, "get version", tries=3)
    except ReplyError as error:
        raise WrongDeviceError(
            f"{config.port}: nothing there answers as a Zaber device with address {address} in ASCII at {config.baud} "
            "baud; check its power, baud= and axes= in the device URL, and that it is not another kind of device"
        ) from error


def _demand_checksums(link: Link, addresses: Sequence[int]) -> None:
    """Have answers end with checksums where the firmware can: a disturbed digit must not pass for a position."""
    try:
        for address in addresses:
            link.ask(address, 0, "set comm.checksum 1")
    except RefusedError:
        return
    link.checked = True


def _found(name: str, axis: ZaberAxis, link: Link) -> Stage:
    """Scale and travel of an axis, from the device where the configuration leaves them open."""
    where = f"{link.port}, device {axis.address} axis {axis.number}"
    axes = messages.number(link.ask(axis.address, 0, "get system.axiscount").data)
    if not 1 <= axis.number <= axes:
        raise SettingsError(f"{where}: the device has {axes:g} of them; correct axes= in the device URL")

    def get(setting: str) -> float:
        return count(link.ask(axis.address, axis.number, f"get {setting}"))

    steps = axis.steps_per_deg
    try:
        steps = get("limit.cycle.dist") / 360 if steps is None else steps
    except (RefusedError, ReplyError):
        steps = 0.0
    if not steps:
        raise SettingsError(
            f"{where}: does not tell how many microsteps a turn has; say steps= in the device URL"
        )
    ends = sorted(get(setting) / steps - axis.zero_deg for setting in ("limit.min", "limit.max"))
    lowest = ends[0] if axis.lowest_deg is None else max(axis.lowest_deg, ends[0])
    highest = ends[1] if axis.highest_deg is None else min(axis.highest_deg, ends[1])
    if lowest >= highest:
        raise SettingsError(
            f"{where}: no travel is left between {lowest:g} and {highest:g} degrees; correct {name}= in the "
            "device URL"
        )
    speed = max(get("maxspeed") / SPEED_UNIT / abs(steps), 1e-3)
    return Stage(name, axis.address, axis.number, steps, axis.zero_deg, lowest, highest, speed)
