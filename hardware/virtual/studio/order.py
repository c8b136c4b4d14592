"""What to photograph, and how: an order to the studio, and the names that it may hold.

Loads nothing, so that a command line or a window may offer all of it at once. `rooms`, `objects`, `materials` and `motion`
hold what is behind the names.
"""

import math
from dataclasses import dataclass
from pathlib import Path

from hardware.errors import StudioError

ROOMS = ("study", "lamps", "window", "plain", "polished", "leafy", "chink", "booth", "parlour")
OBJECTS = ("sphere", "blob", "vase", "relief", "thin", "duo", "gilded", "lacquered", "bowl")
MATERIALS = ("paint", "clay", "glaze", "metal", "textured", "from-file")
MOTIONS = ("handheld", "random", "turntable", "gimbal")
DEVICES = ("auto", "cpu", "cuda")
SCENE_KINDS = (".xml",)
MESH_KINDS = (".obj", ".ply", ".glb")
RENDER_NOISE = 0.015  # of an object pixel over the views, relative to its mean; average over the pixels
MESH_SIZE_M = 0.4  # largest extent of a mesh, where none is asked for


@dataclass(frozen=True, slots=True)
class Order:
    """One set of photographs; sizes in pixels.

    A room may also be a Mitsuba 3 scene file, `place` then is in its own frame (None: one is searched), an object a mesh.
    """

    room: str
    thing: str
    views: int = 96
    width: int = 512
    height: int = 384
    motion: str = "handheld"
    seed: int = 0
    device: str = "auto"
    object_size: float | None = None  # largest extent, metres; None: the object's own, or MESH_SIZE_M
    place: tuple[float, float, float] | None = None  # of the rig's centre
    material: str | None = None  # None: the object's own, or paint
    turn_deg: float = 0.0
    noise: float = RENDER_NOISE  # that the path tracer may leave


def changed(asked: str, *known: str) -> tuple[str, dict[str, float]]:
    """A name and the numbers that are asked of it: "booth:lamp=0.5:side=4".

    Raises:
        StudioError: it is written otherwise, or asks for other than the `known`.
    """
    name, *words = asked.split(":")
    try:
        numbers = {key: float(value) for key, value in (word.split("=") for word in words)}
    except ValueError:
        numbers = {"": math.nan}
    if not (set(numbers) <= set(known) and all(0 <= value < math.inf for value in numbers.values())):
        takes = f"{', '.join(known)}, as in {name}:{known[0]}=0.5" if known else "no numbers"
        raise StudioError(f"{asked}: {name} takes {takes}")
    return name, numbers


def called(file: Path) -> str:
    """What a room or an object is called: a file after its stem, a `scene.xml` after its folder."""
    return file.parent.name if file.stem == "scene" and file.parent.name else file.stem
