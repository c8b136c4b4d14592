"""What a simulated capture is asked for: the options of the command line, and what the window's dialog sends, without Qt."""

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hardware.errors import StudioError
from hardware.virtual.studio.order import (
    DEVICES,
    MATERIALS,
    MESH_SIZE_M,
    MOTIONS,
    OBJECTS,
    RENDER_NOISE,
    ROOMS,
    Order,
    called,
)

USUAL = Order("", "")
"""What is taken where nothing is said."""


@dataclass(frozen=True, slots=True)
class Request:
    """One simulation: `out` gets `session` and `truth`."""

    out: Path
    order: Order
    vignetting: float = 0.0

    def content(self) -> Mapping[str, Any]:
        """For the task "simulate"."""
        return {
            "out": str(self.out.expanduser()), "order": asdict(self.order), "vignetting": self.vignetting
        }  # fmt: skip


def request_of(content: Mapping[str, Any]) -> Request:
    """The inverse of `Request.content`, whose tuples JSON made lists."""
    said = dict(content["order"])
    said["place"] = said["place"] and tuple(said["place"])
    return Request(Path(content["out"]), Order(**said), content["vignetting"])


def asked(args: Namespace) -> Request:
    """What a command line asks for."""
    width, height = args.size
    order = Order(
        args.room, args.object, args.views, width, height, args.motion, args.seed, args.device, args.object_size,
        args.place and tuple(args.place), args.material, args.turn or 0.0,
        args.noise,
    )  # fmt: skip
    return Request(args.out, order, args.vignetting)


def parse_place(text: str) -> tuple[float, float, float] | None:
    """Three numbers as a person writes them, metres; None of an empty text.

    Raises:
        StudioError: it is something else.
    """
    if not text.strip():
        return None
    try:
        x, y, z = (float(word) for word in text.replace(",", " ").split())
    except ValueError:
        raise StudioError(
            f"place {text!r}: is not three numbers; write X Y Z in metres, as in 0.5 1.2 -2"
        ) from None
    return x, y, z


def proposed(folder: Path, room: str, thing: str) -> Path:
    """A folder named after room and object that is not taken yet."""
    name = "-".join(called(Path(file.strip() or "simulated")) for file in (room, thing))
    place, number = folder / name, 2
    while place.exists():
        place, number = folder / f"{name}-{number}", number + 1
    return place


def add_options(parser: ArgumentParser) -> None:
    """Of `roomlight simulate`."""
    parser.add_argument("out", type=Path)
    parser.add_argument("--room", required=True, help=f"{', '.join(ROOMS)}, or a Mitsuba 3 scene.xml")
    parser.add_argument("--object", required=True, help=f"{', '.join(OBJECTS)}, or a mesh: OBJ, PLY, GLB")
    add_object_options(parser, "a built-in object's own, or")
    parser.add_argument("--views", type=int, default=USUAL.views)
    parser.add_argument("--size", type=int, nargs=2, default=(USUAL.width, USUAL.height), metavar=("W", "H"))
    parser.add_argument(
        "--motion", choices=MOTIONS, default=USUAL.motion,
        help="by hand, at random every way (poses for giving, not for finding), or on a rig",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=USUAL.seed)
    parser.add_argument("--vignetting", type=float, default=0.0, help="share of light lost in the corners")
    parser.add_argument("--device", default=USUAL.device, choices=DEVICES)


def add_object_options(parser: ArgumentParser, otherwise: str) -> None:
    """How the object stands there and what it is made of: of `simulate` and `bench` alike."""
    parser.add_argument(
        "--object-size", type=float, metavar="M",
        help=f"its largest extent; {otherwise} {MESH_SIZE_M:g} m for a mesh, if left out",
    )  # fmt: skip
    parser.add_argument(
        "--place", type=float, nargs=3, metavar=("X", "Y", "Z"),
        help="where the rig stands, in the scene file's frame; searched if left out",
    )  # fmt: skip
    parser.add_argument(
        "--material", metavar="KIND",
        help=f"{', '.join(MATERIALS)}; {otherwise} paint for a mesh, if left out",
    )  # fmt: skip
    parser.add_argument("--turn", type=float, metavar="DEG", help="turn the object about the vertical")
    parser.add_argument(
        "--noise", type=float, default=RENDER_NOISE, metavar="SHARE",
        help=f"that the path tracer may leave on the object, {RENDER_NOISE:g}; twice the noise takes a third of the time",
    )  # fmt: skip
