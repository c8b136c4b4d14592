"""The methods that a reader would hold ours against, by name: the rows beside it in every table.

All take what `engine/surface/solve.py:solve` takes, with parameters of their own, and answer with a `Surface`.
Maps that were computed elsewhere are one more row: `maps.py`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from app.bench.baselines.known_light import KnownLightParams, far_field, harmonics, lambert, one_panorama
from app.bench.baselines.uncalibrated import UncalibratedParams, uncalibrated
from engine.types import Surface


@dataclass(frozen=True, slots=True)
class Baseline:
    """One method: its function, the class of its parameters (all have defaults), and a line that says what it is."""

    solve: Callable[..., Surface]
    params: type[KnownLightParams] | type[UncalibratedParams]
    line: str


BASELINES: Mapping[str, Baseline] = MappingProxyType(
    {
        "far_field": Baseline(
            far_field,
            KnownLightParams,
            "our solver under one panorama per view taken at the object's place, without parallax",
        ),
        "one_panorama": Baseline(
            one_panorama,
            KnownLightParams,
            "our solver under one panorama of the room that only turns from view to view",
        ),
        "harmonics": Baseline(
            harmonics,
            KnownLightParams,
            "Lambert under the background's second-order spherical harmonics, no shadows",
        ),
        "uncalibrated": Baseline(
            uncalibrated,
            UncalibratedParams,
            "background masked out: Lambert and unknown second-order light solved in turns",
        ),
        "lambert": Baseline(
            lambert, KnownLightParams, "Lambert under our near-field light, with shadows, without highlights"
        ),
    }
)
