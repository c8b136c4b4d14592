"""What the window and the drawing process say to each other, one JSON object a line.

The window says `Memory`, `Load`, `Look`, `Probe`, `Paint`, `Ping` on the child's stdin; the child says the rest
on its stdout. Every `Look` says all that a picture depends on besides the session, so that a fresh child needs
`Memory`, `Load` and one `Look` to be where the last one was. Pictures go through shared memory (frames.py).
"""

import json
from dataclasses import dataclass, field
from typing import Any

from app.viewer.orbit import Orbit, Vector
from engine.pipeline.artifacts import plain, revive

LAYERS = ("surface", "emitters", "lamps", "cameras", "points", "axes", "grid")
Colour = tuple[int, int, int]  # sRGB, 0 to 255
AXES: tuple[Colour, Colour, Colour] = ((222, 84, 74), (122, 176, 66), (74, 134, 222))
"""Of x, y and z, everywhere."""


@dataclass(frozen=True, slots=True)
class Style:
    """What is shown and how."""

    visible: tuple[str, ...] = ("surface", "emitters", "lamps", "cameras", "axes")  # of LAYERS
    surface: str = "shaded"  # of `Contents.surfaces`: those of app/viewer/shades.py, and painted layers
    emitters: str = "points"  # or "ellipsoids", "splats"
    exposure_ev: float = 0.0  # of the emitters and lamps, relative to what suits the room
    view: int = -1  # the surface stands where it was in this view; -1: the first registered one
    pose: tuple[float, ...] = ()  # or where it is for this camera, 12 numbers as in `Contents.poses`
    frusta: float = 1.0  # length of the cameras, as a share of `Contents.frustum`
    open_front: bool = True  # emitters between the eye and the cameras are left out
    top: Colour = (40, 42, 46)  # the ground's colours
    bottom: Colour = (18, 19, 21)
    line: Colour = (150, 156, 166)  # cameras and grid


@dataclass(frozen=True, slots=True)
class Memory:
    """Frames go here from now on."""

    name: str
    slot_bytes: int


@dataclass(frozen=True, slots=True)
class Load:
    """Show this session."""

    folder: str


@dataclass(frozen=True, slots=True)
class Look:
    """Draw this; while `moving` quickly, else as well as possible, better and better."""

    number: int
    orbit: Orbit
    width: int
    height: int
    moving: bool
    style: Style = field(default_factory=Style)


@dataclass(frozen=True, slots=True)
class Probe:
    """What point in space is under this pixel of the picture drawn last?"""

    number: int
    x: float  # as a share of the width
    y: float


@dataclass(frozen=True, slots=True)
class Paint:
    """Let the surface layer `layer` have the colours of a .npy file, h w 3, linear radiance, 1 is white."""

    layer: str
    path: str


@dataclass(frozen=True, slots=True)
class Ping:
    number: int


@dataclass(frozen=True, slots=True)
class Ready:
    """The child can draw; what with."""

    renderer: str


@dataclass(frozen=True, slots=True)
class Unable:
    """This machine cannot draw in 3D; trying again changes nothing."""

    reason: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Note:
    """A sign of life during long work."""

    text: str


@dataclass(frozen=True, slots=True)
class Legend:
    """What a surface layer's colours mean; `colours` is a scale of app.inspect.falsecolour."""

    colours: str
    low: float
    high: float
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Contents:
    """What a session has to show."""

    folder: str
    unit: str  # "m" or "" where the scale is unknown
    names: tuple[str, ...] = ()  # of the views
    poses: tuple[
        tuple[float, ...], ...
    ] = ()  # 12 numbers a view, cam_from_world by rows; none: not registered
    aspect: float = 1.5  # of the photographs, width over height
    fov: float = 0.8  # vertical, radians
    frustum: float = 0.1  # length to draw, scene units
    object_depth: float = 0.0  # how far in front of the camera the object is; 0: unknown
    up: Vector = (0.0, -1.0, 0.0)
    front: Vector = (0.0, 0.0, 1.0)
    centre: Vector = (0.0, 0.0, 0.0)  # of cameras and object
    radius: float = 1.0  # of a ball around them
    room: Vector = (0.0, 0.0, 0.0)  # the middle of the room, and the radius of nearly all of it
    room_radius: float = 1.0
    emitters: int = 0
    lamps: int = 0
    triangles: int = 0
    points: int = 0
    surfaces: tuple[str, ...] = ()
    legends: dict[str, Legend] = field(default_factory=dict)
    missing: tuple[str, ...] = ()  # of "poses", "light", "surface"


@dataclass(frozen=True, slots=True)
class Loaded:
    contents: Contents


@dataclass(frozen=True, slots=True)
class Refused:
    """The session cannot be shown."""

    reason: str


@dataclass(frozen=True, slots=True)
class Frame:
    """A picture is in the shared memory; `last` when it gets no better."""

    number: int  # of its Look
    slot: int
    stamp: int
    width: int
    height: int
    samples: int
    last: bool
    milliseconds: float


@dataclass(frozen=True, slots=True)
class Probed:
    """The point, world frame; empty where there is nothing."""

    number: int
    point: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Pong:
    number: int


_KINDS: dict[str, type] = {
    kind.__name__.lower(): kind
    for kind in (
        Memory, Load, Look, Probe, Paint, Ping, Ready, Unable, Note, Loaded, Refused, Frame, Probed, Pong,
    )
}  # fmt: skip


class ProtocolError(Exception):
    """A line that is no message."""


def encode(message: Any) -> bytes:
    """One line."""
    content = {"is": type(message).__name__.lower(), "what": plain(message)}
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"


def decode(line: bytes) -> Any:
    """The message of a line.

    Raises:
        ProtocolError: it holds none.
    """
    try:
        content = json.loads(line)
        return revive(content["what"], _KINDS[content["is"]])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ProtocolError(f"not a message of the 3D view: {line[:80]!r} ({error})") from None
