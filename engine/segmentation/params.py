"""What a person may ask of the segmentation, and between which bounds."""

from dataclasses import dataclass

from engine.errors import MaskError
from engine.validation import MORE, check

BOUNDS = {
    "margin_px": (0, MORE), "fewest_views": (2, MORE), "most_views": (2, MORE), "search_edge_px": (32, MORE),
    "search_rounds": (1, MORE), "refine_rounds": (0, MORE), "rank": (1, MORE), "smoothness": (0.0, MORE),
    "unary_limit": (0.0, MORE), "unary_weight": (0.0, 1.0), "border_penalty": (0.0, MORE), "min_contrast": (0.0, MORE),
    "same_share": (0.0, 1.0), "speck_share": (0.0, 1.0),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class SegmentParams:
    """How to tell the object from the room.

    Raises:
        MaskError: what is asked lies outside `BOUNDS`.
    """

    margin_px: int = 3  # kept clear around the object: lens blur and demosaicing
    fewest_views: int = 8  # fewer histories tell nothing
    most_views: int = 96  # evenly chosen; more add time, not certainty
    search_edge_px: int = 192  # long edge at which first guesses are compared
    search_rounds: int = 3  # of learning the populations and cutting
    refine_rounds: int = 2  # the same at full size
    rank: int = 8  # patterns of light that explain the object's shading
    smoothness: float = 6.0  # most that a link between like neighbours may cost, in units of pull
    unary_limit: float = 0.6  # most that one pixel's own evidence weighs
    unary_weight: float = 0.1  # of a pixel's log odds that counts; neighbours' odds are not independent
    border_penalty: float = 10.0  # against guesses that run along the image border
    min_contrast: float = 2.0  # logs of how much more changes across the outline than within and outside
    same_share: float = 0.9  # of union: a guess so like an earlier answer is not followed up
    speck_share: float = 2e-4  # of the image: smaller islands and holes are noise

    def __post_init__(self) -> None:
        check(self, "segment", MaskError, BOUNDS)
