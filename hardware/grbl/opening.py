"""Open a rig on a GRBL 1.1, grblHAL or FluidNC controller: is it one, which version, is it set up as configured?

Source: GRBL 1.1 documentation, "Interface" (start-up message, `$I`, `$$`); FluidNC wiki, "GRBL compatibility" (not
every `$` setting is told); grblHAL, report.c (`$I`). What greets may be any text or none, so a controller is known by
its state and by `$I`. An Arduino may be reset by opening the port and then boots for 2 s, an ESP32 for longer, telling
of it; otherwise it is silent, but answers `?`. After a limit alarm GRBL keeps silent until it is reset.
"""

import contextlib
import re
import time
from collections.abc import Callable

from hardware.errors import HardwareError, ReplyError, SettingsError, WrongDeviceError
from hardware.grbl import codes as grbl_codes
from hardware.grbl.config import GrblConfig
from hardware.grbl.link import POLL_S, QUERY, GrblLink, Reply
from hardware.grbl.rig import Grbl
from hardware.grbl.status import Alarm, Banner, Feedback, Noise, Report, Setting, heard, parse
from hardware.grbl.travel import NAMES, Found
from hardware.interfaces import Motion
from hardware.line import Line

__all__ = ["GrblConfig", "open_grbl"]

OPEN_S = 6.0  # nothing more heard of it
BOOT_S = 30.0  # an ESP32 looks for its network first
ASK_S = 0.25  # between two `?`
WAKE_S = 3.0  # nothing heard for so long: reset it
_FEED_100 = b"\x90"  # ends a feed override set at the machine
_NEITHER = "give the port of a GRBL 1.1, grblHAL or FluidNC controller, and its baud rate"
_GRBLHAL = {"FIRMWARE", "DRIVER", "NEWOPT", "AXS"}  # only grblHAL tells of these in `$I`


def open_grbl(config: GrblConfig, clock: Callable[[], float] = time.monotonic) -> Motion:
    """Open the port and make sure of what is behind it; nothing moves, and the rig is not homed.

    Raises:
        AbsentError, AccessError, BusyError: as `Line` says.
        WrongDeviceError: no GRBL 1.1, grblHAL or FluidNC answers; the message says what does.
        SettingsError: its axes or steps per degree are not those configured.
        HardwareError: it stopped answering.
    """
    line = Line(config.port, config.baud, clock)
    try:
        link = GrblLink(line, clock, len(config.axes))
        version = _acquainted(link, clock)
        return Grbl(config, link, _found(link, config, version), clock)
    except HardwareError:
        line.close()
        raise


def _acquainted(link: GrblLink, clock: Callable[[], float]) -> str:
    """Wait until it tells its state or an alarm; returns its name and version."""
    ask = begin = since = clock()  # `since`: last heard of it
    woken, noise = False, b""
    while (now := clock()) < min(since + OPEN_S, begin + BOOT_S):
        if now >= ask:
            link.request(QUERY)
            ask = now + ASK_S
        if now >= since + WAKE_S and not noise and not woken:
            link.resets_due, woken = 1, True
            link.request(b"\x18")
        reply = link.read(ask)
        if isinstance(reply, Banner):
            _must_be_known(reply.version, reply.protocol, link.port)
        if isinstance(reply, Report | Alarm):
            return _introduced(link, clock)
        if isinstance(reply, Noise):
            _must_have_axes(reply, link)
            noise += reply.data and reply.data + b" "
        elif reply is not None:
            since = now
    noise += link.line.unfinished
    said = f"heard {heard(noise)}" if noise else "nothing answers; is it powered?"
    raise WrongDeviceError(f"{link.port}: this is no GRBL: {said}; {_NEITHER}")


def _must_be_known(name: str, protocol: str, port: str) -> None:
    major, minor = (int(number) for number in re.findall(r"\d+", protocol)[:2])
    fluidnc = name.startswith("FluidNC")
    if (fluidnc and major < 3) or (not fluidnc and (major, minor) < (1, 1)):
        raise WrongDeviceError(
            f"{port}: has {'' if fluidnc else 'GRBL '}{name}; install GRBL 1.1 or FluidNC 3 on the controller"
        )


def _must_have_axes(noise: Noise, link: GrblLink) -> None:
    """A report that `read` takes for noise lacks axes that the rig has."""
    if isinstance(report := parse(noise.data), Report):
        raise SettingsError(
            f"{link.port}: the controller has {len(report.place)} axis, axes= in the device URL names more;"
            " correct it, or configure the axis in the controller"
        )


def _listen(reply: Reply | None) -> None:
    """Nothing is known yet that could be lost."""


def _introduced(link: GrblLink, clock: Callable[[], float]) -> str:
    """Name and version as `$I` tells them, of a controller that moves nothing."""
    for _ in range(3):  # it may greet meanwhile, and then has forgotten what it was asked
        _calm(link, clock)
        try:
            told = [reply for reply in link.exchange(["$I"], 3.0, _listen) if isinstance(reply, Feedback)]
        except ReplyError:
            # In an alarm that wants a reset FluidNC and grblHAL tell their state, but take no lines.
            link.reset(_listen)
            continue
        for reply in told:
            found = re.match(r"v?(\d+\.\d+\w?)(?:\.\d+)?(?: (FluidNC v?[\w.+-]+))?", reply.text)
            if reply.kind == "VER" and found:
                _must_be_known(found[2] or found[1], found[1], link.port)
                if found[2]:
                    link.firmware = grbl_codes.FLUIDNC
                elif _GRBLHAL & {reply.kind for reply in told}:
                    link.firmware = grbl_codes.GRBLHAL
                return found[2] or f"{link.firmware} {found[1]}"
    raise WrongDeviceError(f"{link.port}: does not tell its version ($I); {_NEITHER}")


def _calm(link: GrblLink, clock: Callable[[], float]) -> None:
    """Stop what somebody else set in motion; an idle or locked controller is left as it is."""
    with contextlib.suppress(ReplyError):  # silent after a limit alarm: a reset makes it talk
        if link.look(_listen).state in ("Idle", "Alarm"):
            return
        link.hold()
        end = clock() + OPEN_S
        while clock() < end:
            report = link.look(_listen)
            if not report.moving:
                break
            link.listen(POLL_S, _listen)
    link.reset(_listen)
    link.cleared(link.stops)


def _found(link: GrblLink, config: GrblConfig, version: str) -> Found:
    replies = link.exchange(["$$"], 5.0, _listen)
    settings = {reply.number: reply.value for reply in replies if isinstance(reply, Setting)}
    link.unit = 25.4 if settings.get(13) else 1.0
    link.request(_FEED_100)
    notes = []
    for axis, name in enumerate(NAMES[: len(config.axes)]):
        steps, rate = settings.get(100 + axis), settings.get(110 + axis)
        wanted = config.steps_per_deg[axis] if config.steps_per_deg else steps
        if steps is not None and wanted is not None and abs(steps / wanted - 1) > 1e-3:
            raise SettingsError(
                f"{link.port}: {name} has {steps:g} steps per degree (${100 + axis}), configured are {wanted:g};"
                f" set ${100 + axis}={wanted:g} or correct steps= in the device URL"
            )
        if rate is not None and rate < config.feed_deg_min:
            notes.append(
                f"{name} turns at most {rate:g} deg/min (${110 + axis}), not the configured"
                f" {config.feed_deg_min:g}"
            )
        travel = config.pan if axis == 0 else config.tilt
        room = settings.get(130 + axis)
        if settings.get(20) and room is not None and (travel is None or travel[1] - travel[0] > room):
            wide = "endless" if travel is None else f"{travel[1] - travel[0]:g} deg"
            notes.append(
                f"{name} has {room:g} deg of travel in the controller (${130 + axis}), not the configured {wide}"
            )
    return Found(version, settings, tuple(notes))
