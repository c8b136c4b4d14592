"""What came from the camera, looked at before it counts: whole, of this camera, and the exposures that were asked for.

Only headers are read: that the bytes are whole was checked on arrival (`Camera.download`), the pixels are for the
live checks. EV are powers of two of light gathered.
"""

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.capture.order import CaptureError, Pose
from engine import conventions
from engine.errors import RawError
from engine.importing import RAW_SUFFIXES
from engine.io.raw import Facts, read_facts
from hardware.errors import ExposureError
from hardware.interfaces import Frame

# Cameras round shutter times to thirds of a stop, at both ends of a step.
MIXED_UP_EV = 0.7


@dataclass(frozen=True, slots=True)
class Checked:
    """One exposure that may enter the session."""

    frame: Frame
    name: str  # in the session
    light_ev: float  # light gathered by its own account
    facts: Mapping[str, Any]  # for its line in shot.json
    camera: Mapping[str, Any]  # model, width, height, and orientation where it is not 0


def check_suffix(suffix: str, model: str) -> None:
    """
    Raises:
        CaptureError: no RAW file; the merge needs counts in proportion to light.
    """
    if suffix.lower() not in RAW_SUFFIXES:
        raise CaptureError(
            f"{model} writes {suffix or 'files without a suffix'}, which `roomlight process` cannot use: set the"
            " camera to RAW, or say --any-format to keep such photographs all the same"
        )


def check(
    pose: Pose, frames: Sequence[Frame], exposures: int, known: set[str], any_format: bool
) -> list[Checked]:
    """The bracket of one pose, shortest exposure first.

    Args:
        exposures: how many were asked for.
        known: hashes of all photographs that the session has.

    Raises:
        ExposureError: damaged, incomplete, mixed up or handed over before; taking the pose again helps.
        CaptureError: not RAW; taking it again does not help.
    """
    if len(frames) != exposures:
        raise ExposureError(f"{pose.name}: the camera handed over {len(frames)} of {exposures} exposures")
    checked = [_checked(pose, frame, any_format) for frame in frames]
    # Noise makes every RAW file another; of other kinds we promise nothing.
    hashes = [item.frame.sha256 for item in checked if item.camera["model"] is not None]
    if known & set(hashes):
        raise ExposureError(
            f"{pose.name}: the camera handed over a photograph again, which an earlier pose has already"
        )
    if len(set(hashes)) < len(hashes):
        raise ExposureError(f"{pose.name}: the camera handed over one photograph twice")
    checked.sort(key=lambda item: item.frame.taken.ev)
    for one, two in itertools.pairwise(checked):
        asked = two.frame.taken.ev - one.frame.taken.ev
        told = two.light_ev - one.light_ev
        if abs(asked - told) > MIXED_UP_EV:
            raise ExposureError(
                f"{pose.name}: {one.frame.original} and {two.frame.original} are {told:+.1f} EV apart by their own"
                f" account, {asked:+.1f} EV were asked: they are of different brackets"
            )
    if len({(item.camera["model"], item.camera["width"], item.camera["height"]) for item in checked}) > 1:
        raise ExposureError(f"{pose.name}: the photographs of one bracket are of several cameras or sizes")
    return _named(pose, checked)


def base_shutter_s(exposures: Sequence[Mapping[str, Any]]) -> float | None:
    """The shutter time of 0 EV that a shot's exposures were taken about; None where they do not tell."""
    middle = min(exposures, key=lambda facts: abs(facts["ev"]))
    shutter_s = middle["shutter_s"]
    return None if shutter_s is None else shutter_s / 2.0 ** middle["ev"]


def _checked(pose: Pose, frame: Frame, any_format: bool) -> Checked:
    try:
        size = frame.path.stat().st_size
    except FileNotFoundError:
        raise ExposureError(f"{pose.name}: {frame.original} was downloaded but is not there") from None
    if size != frame.bytes:
        raise ExposureError(
            f"{pose.name}: {frame.original} arrived damaged ({size} bytes here, {frame.bytes} were sent)"
        )
    suffix = frame.path.suffix or Path(frame.original).suffix
    if not any_format:
        check_suffix(suffix, "the camera")
    if suffix.lower() not in RAW_SUFFIXES:
        return Checked(
            frame, "", frame.taken.ev, _told(frame), {"model": None, "width": None, "height": None}
        )
    try:
        facts = read_facts(frame.path)
    except RawError as error:
        raise ExposureError(f"{pose.name}: {frame.original} is unreadable ({error})") from error
    try:
        conventions.check(facts.orientation, frame.original)
    except RawError as error:
        raise CaptureError(f"{pose.name}: {error}") from error
    camera = {"model": facts.camera, "width": facts.width, "height": facts.height}
    camera |= {"orientation": facts.orientation} if facts.orientation else {}
    return Checked(frame, "", math.log2(facts.exposure()), _facts(frame, facts), camera)


def _facts(frame: Frame, facts: Facts) -> dict[str, Any]:
    """As an imported photograph has them, and what was asked for."""
    return {
        "source": frame.original,
        "ev": frame.taken.ev,
        "shutter_s": facts.shutter_s,
        "iso": facts.iso,
        "aperture": None if math.isnan(facts.aperture) else facts.aperture,
        "time_s": None if math.isnan(facts.time_s) else facts.time_s,
        "orientation": facts.orientation,
    }


def _told(frame: Frame) -> dict[str, Any]:
    """Of a photograph whose header we do not read: the camera's word."""
    taken = frame.taken
    return {
        "source": frame.original,
        "ev": taken.ev,
        "shutter_s": taken.exposure.shutter_s,
        "iso": taken.exposure.iso,
        "aperture": taken.exposure.aperture,
        "time_s": None,
    }


def _named(pose: Pose, checked: Sequence[Checked]) -> list[Checked]:
    """`pose0007_ev-3_IMG_0412.CR3`; a camera that calls all its files alike has them numbered."""
    taken: set[str] = set()
    named = []
    for index, item in enumerate(checked):
        original = re.sub(r"[^A-Za-z0-9._-]", "_", Path(item.frame.original).name).lstrip(".") or "unnamed"
        name = f"{pose.name}_ev{_ev(item.frame.taken.ev)}_{original}"
        if name.lower() in taken:
            name = f"{pose.name}_ev{_ev(item.frame.taken.ev)}_{index}_{original}"
        taken.add(name.lower())
        named.append(replace(item, name=name))
    return named


def _ev(ev: float) -> str:
    """-3, 0, +3, -2.67"""
    rounded = round(ev, 2)
    return "0" if rounded == 0 else f"{rounded:+g}"
