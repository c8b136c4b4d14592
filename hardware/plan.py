"""Where a capture stands still: plans of poses made here or read from a file, fitted to what a rig can reach.

A plan file is CSV with the header `pan_deg,tilt_deg` or `pan_deg,tilt_deg,name`; empty lines and lines that begin
with # say nothing. Angles are degrees as the rig counts them.
"""

import csv
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hardware.errors import LimitError, SettingsError
from hardware.interfaces import Angles, Axis, MotionFeatures

HEADERS = (["pan_deg", "tilt_deg"], ["pan_deg", "tilt_deg", "name"])
MOST = 10_000  # poses of a plan; more is a mistake in a file
LOWEST_DEG, HIGHEST_DEG = -70.0, 70.0  # tilts that a gimbal is sent to unless it reaches less


@dataclass(frozen=True, slots=True)
class Place:
    """One place of a plan; `angles` None: wherever the person holds it."""

    angles: Angles | None
    name: str = ""


Plan = tuple[Place, ...]


def turntable(poses: int) -> Plan:
    """Even steps of a full circle, at tilt 0.

    Raises:
        SettingsError: fewer than one pose, or too many.
    """
    _check_number(poses)
    return tuple(Place(Angles(360.0 * i / poses)) for i in range(poses))


def gimbal(poses: int, lowest_deg: float = LOWEST_DEG, highest_deg: float = HIGHEST_DEG) -> Plan:
    """Rows of pan angles at tilts from lowest to highest, back and forth, thinner towards the poles.

    Raises:
        SettingsError: fewer than one pose or too many, or tilts that are no range within -90 to 90.
    """
    _check_number(poses)
    if not -90 <= lowest_deg < highest_deg <= 90:
        raise SettingsError(
            f"tilts from {lowest_deg:g} to {highest_deg:g}: give a lowest and a higher one, within -90 to 90 degrees"
        )
    rows = max(2, round(np.sqrt(poses / 2.2)))
    tilts = np.linspace(lowest_deg, highest_deg, rows)
    weight = np.cos(np.radians(tilts))
    ends = np.round(np.cumsum(weight) / weight.sum() * poses).astype(int)
    places: list[Place] = []
    for row, (begin, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        angles = 360.0 * (np.arange(end - begin) + 0.5 * (row % 2)) / max(1, end - begin)
        angles = angles if row % 2 == 0 else angles[::-1]
        places += [Place(Angles(float(pan), float(tilts[row]))) for pan in angles]
    return tuple(places)


def free(poses: int) -> Plan:
    """Handheld: wherever the person holds it.

    Raises:
        SettingsError: fewer than one pose, or too many.
    """
    _check_number(poses)
    return (Place(None),) * poses


def suited(poses: int, features: MotionFeatures) -> Plan:
    """The plan that makes most of a rig's axes: a grid over its tilt, even steps of its pan, or free.

    Raises:
        SettingsError: fewer than one pose, or too many.
    """
    tilts = [axis for axis in features.axes if axis.name == "tilt"]
    if tilts:
        lowest, highest = tilts[0].lowest_deg, tilts[0].highest_deg
        lowest = LOWEST_DEG if lowest is None else max(lowest, LOWEST_DEG)
        highest = HIGHEST_DEG if highest is None else min(highest, HIGHEST_DEG)
        if lowest < highest:
            return gimbal(poses, lowest, highest)
    return turntable(poses) if features.axes else free(poses)


def read_plan(path: Path) -> Plan:
    """The plan in a file.

    Raises:
        SettingsError: it cannot be read; the message gives line and reason.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise SettingsError(
            f"{path}: is no text file; a plan is CSV with the line pan_deg,tilt_deg first"
        ) from None
    except OSError as error:
        raise SettingsError(
            f"{path}: cannot be read ({error.strerror}); check the name of the plan file"
        ) from None
    told = [
        (number, line)
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not told:
        raise SettingsError(
            f"{path}: is empty; a plan has the line pan_deg,tilt_deg first, then one pose a line"
        )
    first, header = told[0]
    columns = [word.strip() for word in header.split(",")]
    if columns not in HEADERS:
        raise SettingsError(
            f"{path}, line {first}: {header.strip()[:60]!r} should be pan_deg,tilt_deg or pan_deg,tilt_deg,name, "
            "with commas between"
        )
    if not 1 <= len(told) - 1 <= MOST:
        raise SettingsError(f"{path}: has {len(told) - 1} poses; a plan has 1 to {MOST}")
    places, seen = [], {}
    for number, line in told[1:]:
        try:
            place = _place(line, len(columns))
            if place.name and place.name in seen:
                raise ValueError(f"the name {place.name!r} was given in line {seen[place.name]} already")
        except (ValueError, csv.Error) as error:
            raise SettingsError(f"{path}, line {number}: {error}") from None
        seen[place.name] = number
        places.append(place)
    return tuple(places)


def _place(line: str, columns: int) -> Place:
    """
    Raises:
        ValueError, csv.Error: with the reason.
    """
    fields = [field.strip() for field in next(csv.reader([line], strict=True))]
    if len(fields) != columns:
        raise ValueError(f"{len(fields)} values where the header names {columns}: {line.strip()[:60]!r}")
    angles = []
    for column, text in zip(HEADERS[0], fields, strict=False):
        try:
            angle = float(text)
        except ValueError:
            angle = math.nan
        if not math.isfinite(angle):
            raise ValueError(f"{column} {text[:30]!r} is no number of degrees; write it as in -12.5")
        angles.append(angle)
    name = fields[2] if columns == 3 else ""
    if not re.fullmatch(r"[A-Za-z0-9_ -]{0,40}", name):
        raise ValueError(f"{name[:40]!r} is no name; use up to 40 letters, digits, spaces, - and _")
    return Place(Angles(*angles), name)


def fitted(plan: Plan, features: MotionFeatures) -> Plan:
    """The same places in angles that this rig can reach: a pan may be said a full turn further or back.

    Raises:
        LimitError: places that it cannot reach, or that need an axis it lacks; all of them are named.
    """
    axes = {axis.name: axis for axis in features.axes}
    places, bad = [], []
    for index, place in enumerate(plan):
        if place.angles is None or not axes:
            if place.angles not in (None, Angles(0.0)):
                bad.append(f"pose {index} needs a rig that turns")
            places.append(place)
            continue
        pan, tilt = _reached(place.angles.pan_deg, axes["pan"]), place.angles.tilt_deg
        if pan is None:
            bad.append(f"pose {index} has pan {place.angles.pan_deg:g}, {_travel(axes['pan'])}")
            continue
        if "tilt" not in axes and abs(tilt) > 1e-6:
            bad.append(f"pose {index} has tilt {tilt:g}, and this rig has no tilt axis")
        elif "tilt" in axes and not _inside(tilt, axes["tilt"]):
            bad.append(f"pose {index} has tilt {tilt:g}, {_travel(axes['tilt'])}")
        places.append(replace(place, angles=Angles(pan, tilt)))
    if bad:
        more = f"; and {len(bad) - 3} more" if len(bad) > 3 else ""
        raise LimitError(
            f"{'; '.join(bad[:3])}{more}; nothing was moved; change the plan or the rig's travel"
        )
    return tuple(places)


def _reached(pan_deg: float, axis: Axis) -> float | None:
    """The pan itself, or the same direction within travel; None if there is none."""
    options = [pan_deg] + [pan_deg + 360.0 * turns for turns in (-1, 1, -2, 2)]
    return next((option for option in options if _inside(option, axis)), None)


def _inside(angle_deg: float, axis: Axis) -> bool:
    slack = axis.resolution_deg / 2
    low = -math.inf if axis.lowest_deg is None else axis.lowest_deg - slack
    high = math.inf if axis.highest_deg is None else axis.highest_deg + slack
    return low <= angle_deg <= high


def _travel(axis: Axis) -> str:
    return f"beyond {axis.lowest_deg:g} to {axis.highest_deg:g} degrees"


def _check_number(poses: int) -> None:
    if not 1 <= poses <= MOST:
        raise SettingsError(f"{poses} poses: give a number from 1 to {MOST}")
