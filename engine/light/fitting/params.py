"""What a person may ask of the light's fit, and between which bounds."""

from dataclasses import dataclass

from engine.errors import LightError
from engine.validation import MORE, check

BOUNDS = {
    "budget": (1, MORE), "width": (32, MORE), "passes": (1, MORE), "holdout": (0, MORE), "keep_out": (0.0, MORE),
    "hollow": (0.0, MORE),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class LightParams:
    """How the light is fitted.

    Raises:
        LightError: what is asked lies outside `BOUNDS`.
    """

    budget: int = 6000  # Gaussians at most; fewer hurt the irradiance, more only sharpen views (decision 30)
    width: int = 256  # widest picture trained on, pixels
    passes: tuple[int, ...] = (6, 8, 6)  # over all views, per picture size, each twice as wide as the last
    holdout: int = 8  # every so many-th view only judges; 0: none
    # Radius around each camera centre without Gaussians, scene units; None: derived.
    keep_out: float | None = None
    hollow: float = 1.0  # weight of transmittance left over, in units of log radiance

    def __post_init__(self) -> None:
        check(self, "light", LightError, BOUNDS)
