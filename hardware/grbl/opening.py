"""Open a rig on a GRBL 1.1 or FluidNC controller: is it one, which version, and is it set up as configured?

Source: GRBL 1.1 documentation, "Interface" (start-up message, `$I`, `$$`); FluidNC wiki, "GRBL compatibility" (not
every `$` setting is told). An Arduino may be reset by opening the port and then boots for 2 s; otherwise it does not
greet, but answers `?`. After a limit alarm it keeps silent until it is reset.
"""

import contextlib
import re
import time
from collections.abc import Callable

from hardware.errors import HardwareError, ReplyError, SettingsError, WrongDeviceError
from hardware.grbl.config import GrblConfig
from hardware.grbl.link import POLL_S, QUERY, GrblLink, Reply
from hardware.grbl.rig import Grbl
from hardware.grbl.status import Banner, Feedback, Noise, Setting, heard
from hardware.grbl.travel import NAMES, Found
from hardware.interfaces import Motion
from hardware.line import Line

__all__ = ["GrblConfig", "open_grbl"]

OPEN_S = 6.0
ASK_S = 0.25  # between two `?`
WAKE_S = 3.0  # nothing heard for so long: reset it
_FEED_100 = b"\x90"  # ends a feed override set at the machine
_NEITHER = "give the port of a GRBL 1.1 or FluidNC controller, and its baud rate"


def open_grbl(config: GrblConfig, clock: Callable[[], float] = time.monotonic) -> Motion:
    """Open the port and make sure of what is behind it; nothing moves, and the rig is not homed.

    Raises:
        AbsentError, AccessError, BusyError: as `Line` says.
        WrongDeviceError: no GRBL 1.1 or FluidNC answers; the message says what does.
        SettingsError: its steps per degree are not those configured.
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
    """Wait until it greets or reports; returns its name and version."""
    begin = clock()
    ask, woken, noise = begin, False, b""
    while (now := clock()) < begin + OPEN_S:
        if now >= ask:
            link.request(QUERY)
            ask = now + ASK_S
        if now >= begin + WAKE_S and not noise and not woken:
            link.resets_due, woken = 1, True
            link.request(b"\x18")
        reply = link.read(min(ask, begin + OPEN_S))
        if isinstance(reply, Banner):
            _must_be_known(reply.version, reply.protocol, link.port)
        if isinstance(reply, Noise) and reply.data:
            noise += reply.data + b" "
        elif reply is not None and not isinstance(reply, Noise):
            return _introduced(link, clock)
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


def _listen(reply: Reply | None) -> None:
    """Nothing is known yet that could be lost."""


def _introduced(link: GrblLink, clock: Callable[[], float]) -> str:
    """Name and version as `$I` tells them, of a controller that moves nothing."""
    for _ in range(3):  # it may greet meanwhile, and then has forgotten what it was asked
        _calm(link, clock)
        told = [reply for reply in link.exchange(["$I"], 3.0, _listen) if isinstance(reply, Feedback)]
        for reply in told:
            found = re.match(r"v?(\d+\.\d+\w?)(?:\.\d+)?(?: (FluidNC v?[\w.+-]+))?", reply.text)
            if reply.kind == "VER" and found:
                name = found[2] or found[1]
                _must_be_known(name, found[1], link.port)
                return name if found[2] else f"GRBL {name}"
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
            if report.state not in ("Run", "Jog", "Home") and report.sub != 1:
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
