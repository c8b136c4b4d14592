"""What stands under a pixel: every map's value with its unit and standard error, as text."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from app.inspect import falsecolour
from app.inspect.falsecolour import MINUS
from app.inspect.maps import RADIANCE_UNIT, Maps, photograph
from engine.types import Surface, part_of


@dataclass(frozen=True, slots=True)
class Reading:
    """One value under a pixel."""

    title: str
    text: str
    unit: str = ""
    error: str = ""  # one standard error, in the same unit unless it says otherwise


def under(maps: Maps, x: int, y: int, view: int, normal_frame: str) -> tuple[Reading, ...]:
    """Every value at column `x`, row `y`, with unit and standard error; only the photograph's outside the object."""
    s = maps.surface
    height, width = s.mask.shape
    if not (0 <= x < width and 0 <= y < height):
        return ()
    readings = []
    photographed = photograph(maps, view)
    if photographed is not None:
        assert maps.frames is not None
        state = (
            " clipped" if maps.frames.clipped[view, y, x] else " dark" if maps.frames.dark[view, y, x] else ""
        )
        readings.append(Reading("Photograph", numbers(photographed[y, x]) + state, RADIANCE_UNIT))
    if not s.mask[y, x]:
        return tuple(readings)
    if maps.renders is not None and view in maps.renders.views:
        made = maps.renders.radiance[maps.renders.views.index(view), y, x]
        readings.append(Reading("Re-rendered", numbers(made), RADIANCE_UNIT))
    normal = falsecolour.in_frame(s.normal[y, x], "camera" if normal_frame == "camera" else "opengl")
    depth = float(s.depth[y, x]) * maps.unit_factor
    readings += [
        Reading(
            "Normal", " ".join(f"{v:+.3f}".replace("-", MINUS) for v in normal),
            "camera frame" if normal_frame == "camera" else "OpenGL",
            f"{np.degrees(float(s.stderr_normal[y, x])):.2g}°",
        ),
        Reading("Albedo", " ".join(f"{v:.3f}" for v in s.albedo[y, x]), "R G B", f"{float(s.stderr_albedo[y, x]):.2g}"),
        Reading("Roughness", f"{float(s.roughness[y, x]):.3f}", _material(s, x, y), f"{float(s.stderr_roughness[y, x]):.2g}"),
        Reading("Depth", f"{depth:.5g}" if depth > 0 else "unknown", _depth_unit(maps, x, y) if depth > 0 else ""),
        Reading("Rendering error", f"{100 * float(s.residual[y, x]):.2g}", "%"),
        Reading("Flags", falsecolour.told_flags(int(s.flags[y, x]))),
    ]  # fmt: skip
    return tuple(readings)


def _depth_unit(maps: Maps, x: int, y: int) -> str:
    """With the part of the depth where it has several."""
    part = part_of(maps.surface)
    if part.max() < 2:
        return maps.unit
    stderr = maps.surface.stderr_part
    known = "" if stderr is None else f" ± {float(stderr[y, x]):.2g}"
    return f"{maps.unit}, " + (f"part {part[y, x]} of {part.max()}{known}" if part[y, x] else "a small part")


def _material(s: Surface, x: int, y: int) -> str:
    """Nothing where all is of paint."""
    if s.material is None:
        return ""
    level, metalness = map(float, s.material[y, x])
    return "metal" if metalness else f"specular {level:.2f}"


def numbers(three: Float[np.ndarray, " 3"]) -> str:
    """Three radiances with as many digits as tell them apart."""
    return " ".join(f"{float(v):.3g}" for v in three)
