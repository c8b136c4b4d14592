"""What a capture is to do: poses, bracket and devices, written once into `SESSION/capture/order.json`.

A pose is known by its place in the plan, `pose0007`, in every name and message; the shot of that name in the
session is that pose finished. Angles are degrees as the rig counts them, geometry is in metres.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from engine.errors import RoomlightError, SessionError, reason
from engine.io.session import write_atomic
from hardware.interfaces import Angles, Bracket, Exposure, Geometry
from hardware.plan import Place, Plan, fitted
from hardware.rig import Rig

SCHEMA = 1


class CaptureError(RoomlightError):
    """A capture cannot start, or stopped; the session keeps what was finished."""


@dataclass(frozen=True, slots=True)
class Pose:
    """One place of the plan; `angles` None: wherever the person holds it; `label` as the plan's file calls it."""

    index: int
    angles: Angles | None
    label: str = ""

    @property
    def name(self) -> str:
        return f"pose{self.index:04d}"


@dataclass(frozen=True, slots=True)
class Order:
    """What was asked for; frozen for the life of the session."""

    rig: str  # device URL
    camera: str  # device URL
    kind: str  # "turntable", "gimbal" or "handheld", as the session's log calls it
    poses: tuple[Pose, ...]
    bracket: Bracket
    geometry: Geometry | None = None
    settle_s: float | None = None  # None: as the rig has it
    any_format: bool = False  # keep photographs that `roomlight process` cannot use


def folder(session: Path) -> Path:
    """Where a session keeps its capture's own state."""
    return session / "capture"


def poses_of(plan: Plan) -> tuple[Pose, ...]:
    """A plan's places, numbered."""
    return tuple(Pose(index, place.angles, place.name) for index, place in enumerate(plan))


def plan_of(poses: Sequence[Pose]) -> Plan:
    return tuple(Place(pose.angles, pose.label) for pose in poses)


def kind_of(poses: Sequence[Pose]) -> str:
    """What the session's log calls a plan: "handheld" without angles, "turntable" when one tilt serves all."""
    angles = [pose.angles for pose in poses if pose.angles is not None]
    if not angles:
        return "handheld"
    return "turntable" if len({place.tilt_deg for place in angles}) == 1 else "gimbal"


def planned(
    plan: Plan, rig: Rig, urls: tuple[str, str], bracket: Bracket, settle_s: float | None, any_format: bool
) -> Order:
    """The order of a plan for a rig that is open.

    Args:
        urls: of rig and camera, to open them again.

    Raises:
        LimitError: places that the rig cannot reach.
    """
    poses = poses_of(fitted(plan, rig.motion.features))
    return Order(*urls, kind_of(poses), poses, bracket, rig.geometry, settle_s, any_format)


def write(session: Path, order: Order) -> None:
    """Keep the order in a session that holds none.

    Raises:
        SessionError: the disk refuses.
    """
    poses = [
        {"label": pose.label, "angles": None if pose.angles is None else asdict(pose.angles)}
        for pose in order.poses
    ]
    place = folder(session)
    place.mkdir(parents=True, exist_ok=True)
    write_atomic(
        place / "order.json",
        json.dumps({"schema": SCHEMA, **asdict(order), "poses": poses}, indent=1).encode(),
    )


def read(session: Path) -> Order:
    """The order of a captured session.

    Raises:
        CaptureError: it was not captured, or by a newer version.
        SessionError: the order is damaged.
    """
    path = folder(session) / "order.json"
    try:
        content = json.loads(path.read_bytes())
        if content["schema"] != SCHEMA:
            raise CaptureError(
                f"{path}: has schema {content['schema']}, this roomlight reads {SCHEMA}; install a newer roomlight"
            )
        return _order(content)
    except (FileNotFoundError, NotADirectoryError):
        raise CaptureError(
            f"{session}: no capture to resume (no capture/order.json); start one with `roomlight capture --rig"
            " URL --camera URL --poses N SESSION`"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SessionError(f"{path}: damaged ({reason(error)}); restore it from a copy") from None


def _order(content: Mapping[str, Any]) -> Order:
    poses = tuple(
        Pose(index, _angles(pose["angles"]), str(pose["label"]))
        for index, pose in enumerate(content["poses"])
    )
    bracket, geometry, settle_s = content["bracket"], content["geometry"], content["settle_s"]
    if not poses or content["kind"] not in ("turntable", "gimbal", "handheld"):
        raise ValueError(f"{len(poses)} poses of kind {content['kind']!r}")
    return Order(
        str(content["rig"]),
        str(content["camera"]),
        content["kind"],
        poses,
        Bracket(Exposure(**bracket["base"]), tuple(_number(stop) for stop in bracket["stops"])),
        None if geometry is None else Geometry(**{name: _place(value) for name, value in geometry.items()}),
        None if settle_s is None else _number(settle_s),
        bool(content["any_format"]),
    )


def _angles(content: Mapping[str, Any] | None) -> Angles | None:
    return None if content is None else Angles(_number(content["pan_deg"]), _number(content["tilt_deg"]))


def _place(value: Sequence[Any]) -> tuple[float, float, float]:
    x, y, z = map(_number, value)
    return x, y, z


def _number(value: Any) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} is no angle or length")
    return number
