"""The photographs of a session as the window lists them, without Qt: exposures, time, pose placed or not, left out or not.

What their pixels tell is worked out by a child (`app/work/photograph.py`) and kept in this person's cache, by what the files
hold: the same photograph in another session need not be looked at again.
"""

import datetime
import hashlib
import json
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app import places
from app.capture import aside
from app.capture.order import folder as order_folder
from app.mask_files import newest
from engine.errors import SessionError
from engine.io import left_out
from engine.io import session as sessions
from engine.pipeline import artifacts
from engine.types import Poses

THUMBNAIL_EDGE_PX = 360
SHARP_PX = 0.5
_writing = threading.Lock()  # the window's own threads wait for one another; other processes are told
LOOKED = 1  # raised when what a look tells of the same files changes


@dataclass(frozen=True, slots=True)
class Look:
    """What the pixels of a photograph tell."""

    blur_px: float | None  # width of its sharpest edges, in pixels of the sensor; None where nothing tells
    clipped: float  # share, in every exposure
    dark: float  # share below noise in every exposure


@dataclass(frozen=True, slots=True)
class Photograph:
    """One view."""

    name: str
    number: int  # from 1
    shot: str  # its folder's name
    exposures: tuple[Mapping[str, Any], ...]  # facts of each file, shortest exposure first
    rig: Mapping[str, Any] | None
    placed: bool | None  # whether the latest run gave it a pose; None where none ran
    kept: Path  # where its small picture and its look are kept, without suffix


@dataclass(frozen=True, slots=True)
class Listing:
    """All photographs of a session."""

    session: Path
    camera: str
    photographs: tuple[Photograph, ...]
    left_out: frozenset[str]
    captured: bool  # with Roomlight: its poses can be taken again


def read(session: Path) -> Listing:
    """List a session's photographs.

    Raises:
        SessionError: the session is damaged.
    """
    opened = sessions.open_session(session)
    shots = sessions.shots(opened)
    placed = _placed(session, len(shots))
    made = [
        Photograph(
            shot.name,
            number,
            shot.folder.name,
            tuple(sorted(shot.exposures, key=lambda facts: facts.get("shutter_s") or 0.0)),
            shot.rig,
            found,
            kept(shot.fingerprint, opened.orientation),
        )
        for number, (shot, found) in enumerate(zip(shots, placed, strict=True), 1)
    ]
    model = opened.facts["camera"].get("model")
    captured = (order_folder(session) / "order.json").is_file()
    return Listing(session, str(model or ""), tuple(made), left_out.read(opened), captured)


def kept(fingerprint: str, flip: int) -> Path:
    """Where what was seen of a photograph is kept between starts."""
    key = hashlib.sha256(f"{fingerprint} {flip} {THUMBNAIL_EDGE_PX} {LOOKED}".encode()).hexdigest()[:24]
    return places.cache() / "photographs" / key


def look(kept: Path) -> Look | None:
    """What was seen of a photograph; None where nobody looked yet."""
    try:
        return look_of(json.loads(kept.with_name(kept.name + ".json").read_bytes()))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def look_of(facts: Mapping[str, Any]) -> Look:
    """The child's answer."""
    return Look(facts["blur_px"], float(facts["clipped"]), float(facts["dark"]))


def leave_out(listing: Listing, names: frozenset[str]) -> None:
    """Leave exactly these photographs out.

    Raises:
        RoomlightError: a run is under way, none would be left, or the disk refuses.
    """
    views = [photograph.name for photograph in listing.photographs]
    with _writing:
        left_out.write(sessions.open_session(listing.session), names & set(views), views)


def take_again(listing: Listing, photograph: Photograph) -> Path:
    """Put a captured photograph aside, so that the capture, when it goes on, takes its pose again; returns where it is kept.

    Raises:
        RoomlightError: a run is under way, or the disk refuses.
    """
    session = sessions.open_session(listing.session)
    with _writing:
        out = left_out.read(session)
        if photograph.name in out:  # that was said of this photograph, not of the next one
            left_out.write(session, out - {photograph.name}, ())
        return aside.take_again(session, photograph.shot)


def bring_back(listing: Listing, photograph: Photograph, kept: Path) -> None:
    """Undo `take_again`.

    Raises:
        RoomlightError: the pose has been taken again, a run is under way, or the disk refuses.
    """
    with _writing:
        aside.bring_back(sessions.open_session(listing.session), kept, photograph.shot)


def _placed(session: Path, count: int) -> Sequence[bool | None]:
    """Of the latest poses found; what they do not tell is not known."""
    found = newest(session / "stages" / "poses")
    try:
        registered = [] if found is None else artifacts.load(found, "poses", Poses).registered.tolist()
    except SessionError:
        registered = []  # who needs the poses says so
    return [*registered[:count], *[None] * (count - len(registered))]


def told_blur(look: Look) -> str:
    """Width of the sharpest edges; "" where nothing tells. What is sharper than half a pixel cannot be told apart."""
    if look.blur_px is None:
        return ""
    return f"{look.blur_px:.1f} px" if look.blur_px >= SHARP_PX else f"< {SHARP_PX} px"


def told_camera(photograph: Photograph) -> str:
    """ISO and f-number; of a bracket that varies them, of the middle exposure."""
    facts = photograph.exposures[len(photograph.exposures) // 2]
    iso, aperture = facts.get("iso"), facts.get("aperture")
    told = [f"ISO {iso:g}"] if iso else []
    return "  ".join([*told, f"f/{aperture:g}"] if aperture else told)


def told_time(photograph: Photograph) -> str:
    """When it was taken, by the camera's clock; "" where no file tells."""
    times = [facts["time_s"] for facts in photograph.exposures if facts.get("time_s")]
    if not times:
        return ""
    return f"{datetime.datetime.fromtimestamp(min(times), datetime.UTC):%Y-%m-%d  %H:%M:%S}"
