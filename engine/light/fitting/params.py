"""What a person may ask of the light's fit, and between which bounds."""

from dataclasses import dataclass

from engine.errors import LightError
from engine.validation import MORE, check

BOUNDS = {
    "max_gaussians": (1, MORE), "max_image_width": (32, MORE), "epochs": (1, MORE), "epoch_views": (1, MORE),
    "validation_every": (0, MORE), "camera_clearance": (0.0, MORE), "opacity_weight": (0.0, MORE),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class LightParams:
    """How the light is fitted.

    Raises:
        LightError: what is asked lies outside `BOUNDS`.
    """

    max_gaussians: int = (
        6000  # Gaussians at most; fewer hurt the irradiance, more only sharpen views (decision 30)
    )
    max_image_width: int = 256  # widest picture trained on, pixels
    epochs: tuple[int, ...] = (6, 8, 6)  # over the views, per picture size, each twice as wide as the last
    epoch_views: int = 96  # in each, at most, drawn anew; lamps and bright colours are told by as many
    validation_every: int = 8  # every so many-th view only judges; 0: none
    # Radius around each camera centre without Gaussians, scene units; None: derived.
    camera_clearance: float | None = None
    opacity_weight: float = 1.0  # weight of transmittance left over, in units of log radiance

    def __post_init__(self) -> None:
        check(self, "light", LightError, BOUNDS)
