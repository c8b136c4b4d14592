"""What a person wants captured, in words and back: brackets, shutters, places for sessions, and what is left of one.

Reads folders, so the window asks from a thread. Angles are degrees as the rig counts them.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.capture import order as capture_order
from app.capture.order import CaptureError, Order
from engine.errors import RoomlightError

MOST_EV = 12.0  # of a bracket's exposures from its middle
MOST_EXPOSURES = 15
SUFFIX = ".session"
MINUS = "\N{MINUS SIGN}"
VIRTUAL_RIG, VIRTUAL_CAMERA = "virtual:", "virtual:?room=parlour&object=blob"
USUAL_PORT = "/dev/ttyUSB0"  # which example URLs of rigs name


@dataclass(frozen=True, slots=True)
class Captured:
    """A session that was captured, and how far."""

    session: Path
    order: Order
    done: frozenset[str]  # names of its poses that have a shot

    @property
    def left(self) -> int:
        """Poses that are still to take."""
        return sum(pose.name not in self.done for pose in self.order.poses)


def captured(session: Path) -> Captured | None:
    """How far a session's capture is; None for one that was imported, or that cannot be read."""
    try:
        order = capture_order.read(session)
        names = {_name(path) for path in (session / "shots").glob("*/shot.json")}
    except (RoomlightError, OSError):
        return None
    return Captured(session, order, frozenset(pose.name for pose in order.poses) & names)


def _name(shot: Path) -> str:
    """The name a shot.json gives; "" for a damaged one, whose pose is taken again."""
    try:
        content = json.loads(shot.read_bytes())
    except ValueError:
        return ""
    return str(content.get("name", "")) if isinstance(content, dict) else ""


def free_place(folder: Path, stem: str = "capture") -> Path:
    """A session's folder that is not there yet: capture-1.session, capture-2.session, ..."""
    number = 1
    while (place := folder / f"{stem}-{number}{SUFFIX}").exists():
        number += 1
    return place


def parse_stops(text: str) -> tuple[float, ...]:
    """The exposures of a bracket from "-3 0 +3" or "-3, 0, 3", in EV.

    Raises:
        CaptureError: no such bracket; the message says what one looks like.
    """
    words = text.replace(MINUS, "-").replace(",", " ").replace("EV", " ").split()
    try:
        stops = tuple(float(word) for word in words)
    except ValueError:
        stops = ()
    if not 1 <= len(stops) <= MOST_EXPOSURES or any(not abs(stop) <= MOST_EV for stop in stops):
        raise CaptureError(
            f"{text.strip()[:40]!r} is no bracket; give 1 to {MOST_EXPOSURES} exposures in EV within {MOST_EV:g} of"
            " the middle, as in -3,0,3"
        )
    if len(set(stops)) != len(stops):
        raise CaptureError(f"{text.strip()[:40]!r} has the same exposure twice; each adds only if it differs")
    return stops


def told_stops(stops: Sequence[float]) -> str:
    """ "−3 0 +3"."""
    return " ".join("0" if stop == 0 else f"{stop:+g}".replace("-", MINUS) for stop in stops)


def told_shutter(shutter_s: float) -> str:
    """ "1/60 s", "0.5 s", "2 s"."""
    if 0 < shutter_s < 0.3:
        return f"1/{1 / shutter_s:.3g} s" if shutter_s > 0.001 else f"1/{round(1 / shutter_s)} s"
    return f"{shutter_s:.3g} s"


def told_angle(angle_deg: float | None) -> str:
    """ "−12.5°"; a dash where nobody knows."""
    if angle_deg is None or not math.isfinite(angle_deg):
        return "\N{EN DASH}"
    shown = round(angle_deg, 1) + 0.0  # no "−0"
    return f"{shown:.1f}°".replace("-", MINUS)


@dataclass(frozen=True, slots=True)
class Choice:
    """A device one may choose: its URL, its kind ("grbl", "virtual", ...), and what is known of it besides."""

    url: str
    kind: str
    about: str = ""


def rig_choices(examples: Sequence[str], ports: Sequence[Mapping[str, Any]]) -> tuple[Choice, ...]:
    """Rigs to choose from: the virtual one, those that may hang on a port that was found, then hands.

    Where no port was found, the examples stand there all the same: a port can be written into them.

    Args:
        examples: a URL of each kind.
        ports: path, description and likely kind ("" where nobody knows) of each.
    """
    by_kind = {example.partition(":")[0]: example for example in examples}
    wired = {kind: example for kind, example in by_kind.items() if USUAL_PORT in example}
    found = []
    for port in ports:
        likely = [kind for kind in wired if kind == port["likely"]] or list(wired)
        found += [
            Choice(wired[kind].replace(USUAL_PORT, str(port["path"])), kind, str(port["description"]))
            for kind in likely
        ]
    found = found or [Choice(example, kind) for kind, example in wired.items()]
    by_hand = [Choice(by_kind[kind], kind) for kind in ("manual", "none") if kind in by_kind]
    return (Choice(VIRTUAL_RIG, "virtual"), *found, *by_hand)


def camera_choices(cameras: Sequence[Mapping[str, Any]]) -> tuple[Choice, ...]:
    """Cameras to choose from, the virtual one first, a folder into which another program puts files last."""
    found = [
        Choice(str(camera["url"]), str(camera["url"]).partition(":")[0], str(camera["name"]))
        for camera in cameras
        if not str(camera["url"]).startswith("virtual:")
    ]
    watched = Choice(f"folder:{Path.home() / 'Pictures'}", "folder")
    return (Choice(VIRTUAL_CAMERA, "virtual"), *found, watched)
