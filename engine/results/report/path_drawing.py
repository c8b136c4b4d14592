"""The way of the camera and the object through the room as a drawing: plan and side view, SVG.

World frame, turned so that "up" is the cameras' mean up direction or, where they turned every way, the
direction in which the path extends least. Colours come from the page (CSS classes): it suits light and dark.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from engine.color import luminance
from engine.geometry import inverse
from engine.light.gaussians.gaussians import Y00
from engine.types import Gaussians, Poses

SIZE = 420.0  # side of one drawing, SVG units
ROOM_ALLOWANCE = 1.5  # the drawing reaches this many path extents around the path to show sparse points,
LAMP_ALLOWANCE = 3.0  # and this many to show lamps


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Where things are: columns are right, up, towards the reader of the plan; world units."""

    cameras: Float[np.ndarray, "n 3"]
    looks: Float[np.ndarray, "n 3"]  # unit viewing directions
    objects: Float[np.ndarray, "o 3"]  # the object's middle in each view; none if unknown
    points: Float[np.ndarray, "m 3"]
    lamps: Float[np.ndarray, "k 3"]
    lamp_shares: Float[np.ndarray, " k"]  # of the whole light's energy
    lamps_beyond: int  # too far away to be drawn
    low: Float[np.ndarray, " 3"]
    high: Float[np.ndarray, " 3"]


def survey(
    poses: Poses, gaussians: Gaussians | None, object_cam: Float[np.ndarray, " 3"] | None
) -> Plan | None:
    """Lay out the path; None when no view is registered."""
    seen = poses.cam_from_world[poses.registered].astype(np.float64)
    if len(seen) == 0:
        return None
    world_from_cam = inverse(seen)
    centres = world_from_cam[:, :, 3]
    up = -world_from_cam[:, :, 1].mean(0)
    if np.linalg.norm(up) <= 0.3:
        # Held every way up, cameras have none in common; then their path is seen from its flattest side.
        up = np.linalg.svd(centres - centres.mean(0), full_matrices=True)[2][-1]
    up = up / np.linalg.norm(up)
    look = world_from_cam[:, :, 2].mean(0)
    right = np.cross(look, up)
    if np.linalg.norm(right) < 0.1:
        right = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    right /= np.linalg.norm(right)
    plan_from_world = np.stack([right, up, np.cross(right, up)])
    middles = np.zeros((0, 3)) if object_cam is None else world_from_cam[:, :, :3] @ object_cam + centres

    lamps, shares = _lamps(gaussians) if gaussians is not None else (np.zeros((0, 3)), np.zeros(0))
    body = np.concatenate([centres, middles]) @ plan_from_world.T
    low, high = body.min(0), body.max(0)
    reach = ROOM_ALLOWANCE * max(float((high - low).max()), 1e-6)
    points, lamps = poses.points.astype(np.float64) @ plan_from_world.T, lamps @ plan_from_world.T
    near = points[((points > low - reach) & (points < high + reach)).all(1)]
    far = LAMP_ALLOWANCE / ROOM_ALLOWANCE * reach
    within = ((lamps > low - far) & (lamps < high + far)).all(1)
    if len(near):
        low, high = np.minimum(low, np.percentile(near, 2, 0)), np.maximum(high, np.percentile(near, 98, 0))
    if within.any():
        low, high = np.minimum(low, lamps[within].min(0)), np.maximum(high, lamps[within].max(0))
    margin = 0.06 * float((high - low).max()) + 1e-9
    return Plan(
        cameras=centres @ plan_from_world.T,
        looks=world_from_cam[:, :, 2] @ plan_from_world.T,
        objects=middles @ plan_from_world.T,
        points=points,
        lamps=lamps[within],
        lamp_shares=shares[within],
        lamps_beyond=int((~within).sum()),
        low=low - margin,
        high=high + margin,
    )


def draw(plan: Plan, from_above: bool, unit: str) -> str:
    """One view as SVG: from above (up is away) or from the side (up is up)."""
    across, along = 0, 2 if from_above else 1
    extent = float(max((plan.high - plan.low)[[0, 1, 2]].max(), 1e-9))
    scale = SIZE / extent
    middle = (plan.high + plan.low) / 2

    def at(points: np.ndarray) -> np.ndarray:
        x = (points[:, across] - middle[across]) * scale + SIZE / 2
        y = (points[:, along] - middle[along]) * scale * (1 if from_above else -1) + SIZE / 2
        return np.stack([x, y], axis=-1)

    def inside(xy: np.ndarray) -> np.ndarray:
        return np.all((xy >= 0) & (xy <= SIZE), axis=1)

    parts = []
    points = at(plan.points)
    for x, y in points[inside(points)][:: max(1, len(points) // 1500)]:
        parts.append(f'<circle class="point" cx="{x:.1f}" cy="{y:.1f}" r="1"/>')
    for (x, y), share in zip(at(plan.lamps), plan.lamp_shares, strict=True):
        radius = 3 + 22 * float(np.sqrt(share))
        parts.append(f'<circle class="lamp" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"/>')
    cameras = at(plan.cameras)
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in cameras)
    parts.append(f'<polyline class="way" points="{line}"/>')
    tips = at(plan.cameras + plan.looks * 0.05 * extent)
    for (x, y), (u, v) in zip(cameras, tips, strict=True):
        parts.append(f'<path class="look" d="M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}"/>')
        parts.append(f'<circle class="camera" cx="{x:.1f}" cy="{y:.1f}" r="2.6"/>')
    for x, y in at(plan.objects):
        parts.append(f'<circle class="object" cx="{x:.1f}" cy="{y:.1f}" r="2.2"/>')
    length = _round_length(extent / 4)
    parts.append(f'<path class="scale" d="M12 {SIZE - 12:.0f}h{length * scale:.1f}"/>')
    parts.append(f'<text class="scale-text" x="12" y="{SIZE - 18:.0f}">{length:g} {unit}</text>')
    label = "from above" if from_above else "from the side"
    return (
        f'<svg viewBox="0 0 {SIZE:.0f} {SIZE:.0f}" role="img" aria-label="camera path {label}">'
        + "".join(parts)
        + "</svg>"
    )


def _lamps(
    gaussians: Gaussians, share: float = 0.5, most: int = 40
) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, " k"]]:
    """The strongest Gaussians, with their shares of the emitted energy (radiance times area).

    As many as carry `share` of it together, but not more than `most`.
    """
    emitted = np.maximum(luminance(gaussians.radiance[:, 0] * Y00), 0)
    sizes = np.sort(gaussians.scales, axis=1)
    energy = emitted * sizes[:, 1] * sizes[:, 2] * -np.expm1(-gaussians.density)
    if energy.sum() <= 0:
        return np.zeros((0, 3)), np.zeros(0)
    order = np.argsort(-energy)
    count = int(np.searchsorted(np.cumsum(energy[order]), share * energy.sum())) + 1
    chosen = order[: min(count, most)]
    return gaussians.means[chosen].astype(np.float64), energy[chosen] / energy.sum()


def _round_length(length: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above `length`."""
    power = 10.0 ** np.floor(np.log10(max(length, 1e-12)))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)))
