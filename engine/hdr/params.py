"""What a person may ask of the merge, and between which bounds."""

from dataclasses import dataclass

from engine.errors import HdrError
from engine.validation import MORE, check

BOUNDS = {
    "saturation_share": (0.0, 1.0), "dark_sigmas": (0.0, MORE), "ratio_tolerance": (0.0, MORE),
    "hopeless_share": (0.0, 1.0), "learning_views": (1, MORE), "long_edge_px": (8, MORE),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class HdrParams:
    """How to merge.

    Raises:
        HdrError: what is asked lies outside `BOUNDS`.
    """

    saturation_share: float = 0.98  # of black to white; sites above count as saturated
    dark_sigmas: float = 2.0  # noise floors; luminance below counts as dark
    ratio_tolerance: float = 0.10  # share by which pixels and EXIF may disagree before a view is suspect
    hopeless_share: float = 0.90  # of a view clipped, or dark, in every exposure: the view is refused
    learning_views: int = 8  # views that tell the sensor's noise and the usual exposure steps
    long_edge_px: int = 2048  # larger photographs are averaged down by a whole factor

    def __post_init__(self) -> None:
        check(self, "hdr", HdrError, BOUNDS)
