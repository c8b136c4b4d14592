"""Emitter by emitter: how much of each lamp's and window's light arrives, from where, and where our lamps stand.

True emitters are those the studio furnished the room with: globes are lamps, sheets are windows, screens and
ceiling lights. Only globes are held against our lamps: the light knows no other kind.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from app.bench.markdown import markdown
from engine.color import luminance
from engine.geometry import angle_between, transform
from engine.types import Lamps
from hardware.virtual.studio.rooms import Globe
from tests.bench import incident
from tests.bench.light_sets import Light, Set

RIM = np.radians(3.0)
"""Around an emitter's outline: what of our light is meant for it may lie that far off."""


@dataclass(frozen=True, slots=True)
class Lamp:
    """The lamp of ours that a globe is."""

    corners_mean_deg: float  # over views and corners of the object's box
    corners_worst_deg: float
    off_cm: float  # after the similarity of the camera centres
    radius: float  # ours over true
    radiance: float  # luminance, ours over true
    clipped: bool  # our radiance is a lower bound


@dataclass(frozen=True, slots=True)
class Emitter:
    """One globe or sheet; energies are sums over views within its outline and RIM, walls behind included."""

    kind: str
    place: tuple[float, float, float]  # true world, metres
    share: float  # of all true energy, percent
    ratio: float  # of energy, ours over true
    off_deg: float  # between the light's mean directions, median over views
    lamp: Lamp | None


def emitters_of(
    s: Set, light: Light, ours: Float[np.ndarray, "n d 3"], true: Float[np.ndarray, "n d 3"], directions: Float[np.ndarray, "d 3"]
) -> tuple[Emitter, ...]:  # fmt: skip
    """The room's globes, then its sheets."""
    found = []
    for globe, lamp in zip(s.room.globes, _lamps(s, light.lamps), strict=True):
        found.append(_emitter("globe", globe.centre[None], globe.radius_m, lamp, s, ours, true, directions))
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 24)] * 2), -1).reshape(-1, 2)
    for sheet in s.room.sheets:
        points = sheet.corner + grid @ np.stack([sheet.right, sheet.down])
        found.append(_emitter("sheet", points, 0.0, None, s, ours, true, directions))
    return tuple(found)


def _lamps(s: Set, lamps: Lamps) -> list[Lamp | None]:
    """Which of our lamps every globe is."""
    globes, vertices = s.room.globes, s.body.solid.vertices
    if not globes or not len(lamps.radii):
        return [None] * len(globes)
    corners = np.stack(np.meshgrid(*zip(vertices.min(0), vertices.max(0), strict=True)), -1).reshape(-1, 3)
    centres = np.stack([globe.centre for globe in globes])
    angles = incident.lamp_angles(
        centres, lamps.centres, s.true_cam_from_world, s.cam_from_world, s.scale, corners
    )
    placed = transform(s.true_from_ours, s.scale * lamps.centres)
    found: list[Lamp | None] = []
    for globe, turns, mine in zip(globes, angles, incident.matched(angles), strict=True):
        found.append(None if mine < 0 else _lamp(s, lamps, globe, turns[mine], placed[mine], mine))
    return found


def _lamp(s: Set, lamps: Lamps, globe: Globe, turns: np.ndarray, placed: np.ndarray, mine: int) -> Lamp:
    shines = s.session_per_studio * float(luminance(globe.radiance))
    return Lamp(
        float(turns.mean()), float(turns.max()), float(100 * np.linalg.norm(placed - globe.centre)),
        float(s.scale * lamps.radii[mine] / globe.radius_m),
        float(luminance(lamps.radiance[mine].astype(np.float64))) / shines, bool(lamps.clipped[mine]),
    )  # fmt: skip


def _emitter(
    kind: str, points: np.ndarray, radius: float, lamp: Lamp | None, s: Set, ours: np.ndarray, true: np.ndarray, directions: np.ndarray
) -> Emitter:  # fmt: skip
    middle = s.body.solid.vertices.mean(0)
    sums, ways = np.zeros(2), []
    for pose, a, b in zip(s.true_cam_from_world, ours, true, strict=True):
        towards = transform(pose, points) - middle
        reach = radius / float(np.linalg.norm(towards, axis=1).min()) + RIM
        there = incident.within(directions, towards, reach)
        sums += a[there].sum(), b[there].sum()
        ways.append([incident.centroid(light[there], directions[there]) for light in (a, b)])
    off = np.degrees(angle_between(*np.swapaxes(ways, 0, 1)))
    x, y, z = points.mean(0).tolist()
    share = 100 * sums[1] / true.sum()
    return Emitter(kind, (x, y, z), float(share), float(sums[0] / sums[1]), float(np.median(off)), lamp)


def told(emitters: Sequence[Emitter]) -> str:
    """A Markdown table, one row per emitter."""
    lines = [[
        "emitter at m", "% of true energy", "energy ours/true", "off deg", "corners mean deg", "corners worst deg",
        "off cm", "radius ours/true", "radiance ours/true", "clipped",
    ]]  # fmt: skip
    for e in emitters:
        cells = ["-"] * 6 if e.kind == "sheet" else ["none", *["-"] * 5]
        if e.lamp is not None:
            cells = [
                f"{e.lamp.corners_mean_deg:.2f}", f"{e.lamp.corners_worst_deg:.2f}", f"{e.lamp.off_cm:.1f}",
                f"{e.lamp.radius:.3f}", f"{e.lamp.radiance:.3f}", "yes" if e.lamp.clipped else "no",
            ]  # fmt: skip
        place = " ".join(f"{x:.2f}" for x in e.place)
        lines.append([f"{e.kind} {place}", f"{e.share:.1f}", f"{e.ratio:.3f}", f"{e.off_deg:.2f}", *cells])
    return markdown(lines)
