"""How far in front of the camera the object stands, in the report's words: with its standard error, or not known.

Camera and object are fixed to one another, so that only near light's parallax tells it, and only in a room whose scale
is known does it mean a length.
"""

import math
from collections.abc import Mapping

WHAT = "from the camera to the object"


def told(found: object, unit: str, scaled: bool, per_unit: float = 1.0) -> list[tuple[str, str]]:
    """(the number, what it is) for the head of the page; nothing before a surface has reported a distance.

    `found` is what the stage stored of its `Distance`, of whose unit `per_unit` of `unit` are one; `scaled`: whether that is a known one.
    """
    if not isinstance(found, Mapping):
        return []
    value, stderr = _number(found.get("value")), _number(found.get("stderr"))
    if value is None:
        return []
    value, stderr = per_unit * value, None if stderr is None else per_unit * stderr
    length = f"{value:.4g} {'m' if unit == 'metres' else unit}"
    if found.get("source") == "given":
        return [(length, f"{WHAT} (given)")]
    if stderr is None:
        return [("not known", f"{WHAT}: the light does not tell it (solved as if {length})")]
    if not scaled:
        return [
            ("not known", f"{WHAT}: the scene's scale is unknown ({value:.4g} ± {stderr:.2g} scene units)")
        ]
    return [(f"{length} ± {stderr:.2g}", f"{WHAT}, with one standard error (from the light's parallax)")]


def _number(value: object) -> float | None:
    """None for what is no finite number; artefacts store such as text."""
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else None
