"""What the window's commands mean: plans, exposures and brackets from JSON.

A plan is {"kind": "turntable", "poses": n}, {"kind": "gimbal", "poses": n, "lowest": deg, "highest": deg} (from -70 to
70 if not said), {"kind": "free", "poses": n}, {"kind": "suited", "poses": n} (what makes most of the rig's axes) or
{"kind": "file", "path": p}; see `hardware/plan.py`. Null in an exposure: as the camera has it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hardware import plan as plans
from hardware.errors import SettingsError
from hardware.interfaces import Bracket, Exposure, MotionFeatures
from hardware.plan import Plan


def plan(content: Mapping[str, Any], features: MotionFeatures | None) -> Plan:
    """The plan as it is written, not yet fitted to a rig.

    Args:
        features: of the rig that is open, if one is.

    Raises:
        SettingsError: no such plan, or its file is wrong.
    """
    match content["kind"]:
        case "file":
            return plans.read_plan(Path(content["path"]))
        case "turntable":
            return plans.turntable(int(content["poses"]))
        case "gimbal":
            lowest, highest = (
                content.get("lowest", plans.LOWEST_DEG),
                content.get("highest", plans.HIGHEST_DEG),
            )
            return plans.gimbal(int(content["poses"]), float(lowest), float(highest))
        case "free":
            return plans.free(int(content["poses"]))
        case "suited" if features is not None:
            return plans.suited(int(content["poses"]), features)
        case "suited":
            raise SettingsError(
                "no rig is open whose axes a plan could suit; open one, or choose another plan"
            )
        case other:
            raise SettingsError(f"there is no plan of the kind {other!r}; choose another")


def exposure(content: Mapping[str, Any]) -> Exposure:
    shutter_s, iso, aperture = content["shutter"], content["iso"], content["aperture"]
    return Exposure(
        None if shutter_s is None else float(shutter_s),
        None if iso is None else int(iso),
        None if aperture is None else float(aperture),
    )


def bracket(content: Mapping[str, Any]) -> Bracket:
    """
    Raises:
        SettingsError: no exposures, or one twice.
    """
    stops = tuple(float(stop) for stop in content["bracket"])
    if not stops or len(set(stops)) < len(stops):
        raise SettingsError(f"a bracket of {list(stops)} EV; give exposures that differ, as in -3, 0, 3")
    return Bracket(exposure(content), stops)
