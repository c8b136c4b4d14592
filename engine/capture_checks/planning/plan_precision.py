"""How well a plan's turns tell normals apart: the Cramer-Rao bound of a matte pixel under random rooms.

Source: Ramamoorthi and Hanrahan (2001): irradiance is a quadratic form of the normal for order-2 light. Camera and
object turn together, so the light turns in the camera's frame while the normal stays. A pixel knows its normal
(two tangents) and its albedo from one brightness per shot, each with the same relative noise; what is asked for is
the error of the normal in its worst direction. Turns about one axis leave the part of the light along that axis as it
is, and with it one combination of normal and albedo that no shot changes. Lamps whose strength is told wrong move
the normal by the least-squares answer to that error.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64

from engine.geometry import fibonacci_sphere, tangents

ROOMS, NORMALS = 30, 40
LAMPS = 3  # of each room, of about the energy of all its walls
LAMP_ERROR = 0.3  # of the lamps' strength
LOBES = (0.8, 0.35)  # spread of the first and second order of the walls' light, relative to their mean


@dataclass(frozen=True, slots=True)
class PlanPrecision:
    """Of a plan, median over rooms and normals."""

    worst: float  # error of the normal along its worst tangent, radians per unit of relative noise
    best: float  # along its best
    lamp_deg: float  # error of the normal when all lamps are told off by `LAMP_ERROR`


def certainty(cam_from_world: Float[np.ndarray, "n 3 3"], seed: int = 0) -> PlanPrecision:
    """What the turns of a plan can tell; at least three shots."""
    rng = np.random.default_rng(seed)
    normals = fibonacci_sphere(2 * NORMALS)
    normals = normals[normals[:, 2] < -0.2]
    first, second = tangents(normals)
    worst, best, off = [], [], []
    for _ in range(ROOMS):
        linear, quadratic, lamps, power = _room(rng)
        # In the camera's frame the walls' harmonics turn with the room.
        turned = np.einsum("nij,j->ni", cam_from_world, linear)
        squares = np.einsum("nij,jk,nlk->nil", cam_from_world, quadratic, cam_from_world)
        towards = np.einsum("nij,lj->nli", cam_from_world, lamps)
        facing = np.maximum(np.einsum("nli,pi->npl", towards, normals), 0)  # shot, pixel, lamp
        light = 1 + turned @ normals.T + np.einsum("nij,pi,pj->np", squares, normals, normals)
        light = np.maximum(light, 0.1) + facing @ power
        slope = turned[:, None] + 2 * np.einsum("nij,pj->npi", squares, normals)
        slope = slope + np.einsum("npl,nli,l->npi", facing > 0, towards, power)
        rows = np.stack(
            [(slope * first).sum(-1) / light, (slope * second).sum(-1) / light, np.ones_like(light)], axis=-1
        )
        information = np.einsum("npi,npj->pij", rows, rows) + 1e-9 * np.eye(3)
        inverse = np.linalg.inv(information)
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(inverse[:, :2, :2]), 0))
        error = LAMP_ERROR * (facing @ power) / light
        answer = np.einsum("pij,npj,np->pi", inverse, rows, error)
        worst.append(np.median(spread[:, 1]))
        best.append(np.median(spread[:, 0]))
        off.append(np.median(np.linalg.norm(answer[:, :2], axis=1)))
    # Beyond a right angle a linear answer means nothing but "lost".
    return PlanPrecision(
        float(np.median(worst)), float(np.median(best)), min(90.0, float(np.degrees(np.median(off))))
    )


def _room(
    rng: np.random.Generator,
) -> tuple[
    Float64[np.ndarray, " 3"],
    Float64[np.ndarray, "3 3"],
    Float64[np.ndarray, "l 3"],
    Float64[np.ndarray, " l"],
]:
    """Walls of mean irradiance 1 (linear and quadratic part), lamps' directions and their irradiance."""
    linear = LOBES[0] * rng.standard_normal(3) / np.sqrt(3)
    square = rng.standard_normal((3, 3))
    square = square + square.T
    square -= np.trace(square) / 3 * np.eye(3)
    quadratic = LOBES[1] * square / np.linalg.norm(square)
    lamps = rng.standard_normal((LAMPS, 3))
    lamps /= np.linalg.norm(lamps, axis=1, keepdims=True)
    power = rng.dirichlet(np.ones(LAMPS)) * 2
    return linear, quadratic, lamps, power
