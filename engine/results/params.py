"""What a person may ask of the exported files, and between which bounds."""

from dataclasses import dataclass

from engine.errors import ExportError
from engine.validation import MORE, check

GREEN = {"opengl": "up", "directx": "down"}
BOUNDS = {"cut_footprints": (0.0, MORE), "cut_share": (0.0, MORE)}
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class ExportParams:
    """What a person may choose about the files.

    Raises:
        ExportError: what is asked lies outside `BOUNDS`, or is no convention of normal maps.
    """

    normal_png: str = "opengl"  # green of the PNG normal map: "opengl" up, "directx" down
    cut_footprints: float = 3.0  # depth step that neither normal explains, in pixel widths on the surface
    cut_share: float = 1.0  # the same step as a share of the one predicted

    def __post_init__(self) -> None:
        check(self, "export", ExportError, BOUNDS, {"normal_png": tuple(GREEN)})
