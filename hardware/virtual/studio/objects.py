"""Model what is photographed: bodies with their albedo, roughness and what they are made of, in the camera's frame.

Camera frame (x right, y down, z forward), metres; the middle of each body lies on the optical axis at
`DISTANCE_M`, and it fills about a fifth of a 4:3 picture of 62 degrees. Albedo is linear Rec.709;
roughness is the Disney parameter (alpha = roughness^2), and so are metalness and specular level.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, HalfspaceIntersection

from hardware.errors import StudioError
from hardware.virtual.studio import order, solids
from hardware.virtual.studio.solids import Solid

DISTANCE_M = 0.46

Points = Float[np.ndarray, "v 3"]
Field = Callable[[Points], Float[np.ndarray, " v"]]


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A mesh and what it is made of, per vertex."""

    name: str
    solid: Solid
    albedo: Float[np.ndarray, "v 3"]
    roughness: Float[np.ndarray, " v"]
    metalness: Float[np.ndarray, " v"] | None = None  # None: nothing of it is metal
    specular: float = 0.5  # level: 0.08 of it is reflected head on, where it is not metal


def clouds(seed: int, size_m: float, octaves: int = 1, gain: float = 0.5) -> Field:
    """Smooth random field in space, zero mean, unit deviation, features about `size_m` across."""
    rng = np.random.default_rng(seed)
    waves = [
        (rng.normal(size=(24, 3)) * (2.2 * 2**k / size_m), rng.uniform(0, 2 * np.pi, 24), gain**k)
        for k in range(octaves)
    ]
    power = sum(g * g for *_, g in waves)

    def field(points: Points) -> Float[np.ndarray, " v"]:
        total = np.zeros(len(points))
        for frequency, phase, strength in waves:
            total += strength * np.cos(points @ frequency.T + phase).sum(1) / np.sqrt(12.0)
        return total / np.sqrt(power)

    return field


def step(value: Float[np.ndarray, " v"], width: float) -> Float[np.ndarray, " v"]:
    """0 to 1 where `value` passes zero, within +-`width`."""
    t = np.clip(value / (2 * width) + 0.5, 0, 1)
    return t * t * (3 - 2 * t)


def dappled(points: Points, seed: int, colours: list[tuple[float, float, float]], size_m: float) -> Points:
    """Patches of the given colours with soft edges, over a fine mottle."""
    albedo = np.broadcast_to(np.array(colours[0]), points.shape).copy()
    for k, colour in enumerate(colours[1:]):
        share = step(clouds(seed + k, size_m, 2)(points) - 0.35, 0.12)[:, None]
        albedo = albedo * (1 - share) + np.array(colour) * share
    mottle = np.exp(0.16 * clouds(seed + 50, size_m / 4, 2)(points))[:, None]
    return np.clip(albedo * mottle, 0.08, 0.82)


def two_finishes(points: Points, seed: int, smooth: float, rough: float, size_m: float) -> np.ndarray:
    """Roughness in two regions with slow drift inside each."""
    share = step(clouds(seed, size_m)(points), 0.25)
    drift = 0.04 * clouds(seed + 1, size_m)(points)
    return np.clip(smooth + (rough - smooth) * share + drift, 0.12, 0.85)


def _turned(x_deg: float, y_deg: float, z_deg: float) -> Float[np.ndarray, "3 3"]:
    """Turn about z, then x, then y."""
    (cx, cy, cz), (sx, sy, sz) = (
        np.cos(np.radians([x_deg, y_deg, z_deg])),
        np.sin(np.radians([x_deg, y_deg, z_deg])),
    )
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_y @ about_x @ about_z


# The bodies are modelled with z up; this lays them into the camera's frame, facing it.
_CAM_FROM_UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])


def _placed(solid: Solid, rotation: np.ndarray) -> Solid:
    """Turned, and with the middle of its bounding box brought to the origin."""
    turned = solids.moved(solid, rotation, np.zeros(3))
    middle = (turned.vertices.min(0) + turned.vertices.max(0)) / 2
    return solids.moved(turned, np.eye(3), -middle)


def sphere() -> Body:
    """A sphere: every normal once."""
    solid = solids.ball(170, lambda d: np.full(len(d), 0.118))
    p = solid.vertices
    albedo = dappled(p, 100, [(0.55, 0.5, 0.42), (0.62, 0.2, 0.14), (0.16, 0.3, 0.5)], 0.08)
    return Body("sphere", solid, albedo, two_finishes(p, 160, 0.3, 0.65, 0.14))


def blob() -> Body:
    """A smooth lump with bulges and dents."""
    bulge = clouds(201, 1.15)
    solid = solids.ball(180, lambda d: 0.112 * np.exp(0.17 * bulge(d)))
    solid = _placed(solid, _turned(20, 35, 0))
    p = solid.vertices
    albedo = dappled(p, 210, [(0.3, 0.45, 0.35), (0.65, 0.55, 0.3), (0.45, 0.18, 0.3)], 0.07)
    return Body("blob", solid, albedo, two_finishes(p, 260, 0.28, 0.7, 0.12))


def vase() -> Body:
    """A vase with deep flutes: grooves that shade themselves and bounce light."""
    t = np.linspace(0, 1, 420)
    height = 0.125 - 0.25 * t
    outer = (
        0.058 + 0.042 * np.sin(np.pi * (0.12 + 0.88 * t) ** 1.3) - 0.02 * np.exp(-(((t - 0.14) / 0.09) ** 2))
    )
    end = 30
    lid = np.stack([np.linspace(0, outer[0], end, endpoint=False), np.full(end, height[0])], 1)
    foot = np.stack([np.linspace(outer[-1], 0, end + 1)[1:], np.full(end, height[-1])], 1)
    profile = np.concatenate([lid, np.stack([outer, height], 1), foot])

    def flutes(r: np.ndarray, angle: np.ndarray) -> np.ndarray:
        groove = 0.5 - 0.5 * np.cos(13 * angle)
        return r * (1 - 0.24 * groove**0.9)

    solid = solids.lathe(profile, 720, flutes, crease_deg=45.0)
    solid = _placed(solid, _turned(-14, 0, 8) @ _CAM_FROM_UPRIGHT)
    p = solid.vertices
    albedo = dappled(p, 310, [(0.6, 0.52, 0.45), (0.25, 0.4, 0.55), (0.7, 0.42, 0.25)], 0.09)
    return Body("vase", solid, albedo, two_finishes(p, 360, 0.25, 0.6, 0.13))


def relief() -> Body:
    """A carved tile: blocks, pyramids, a ridge, a bowl, a groove and a stair, all with sharp edges.

    Each part is a body of its own that is sunk into the tile: on a common grid of heights, walls that run across it
    would be serrated finer than a pixel, and the normal at a pixel's centre would be that of a tooth.
    """
    width, height, sunk = 0.26, 0.21, -0.01
    sides = np.array(
        [[1, 0, 0, -width / 2], [-1, 0, 0, -width / 2], [0, 1, 0, -height / 2], [0, -1, 0, -height / 2]]
    )

    def body(cx: float, cy: float, deg: float, corners: list[tuple[float, float, float]]) -> Solid:
        """Convex, turned, set on the tile and cut off where the tile ends."""
        at = np.array(corners) @ _turned(0, 0, deg).T + [cx, cy, 0]
        planes = np.concatenate([ConvexHull(at).equations, sides])
        inside = np.append(at[:, :2].mean(0), sunk / 2)
        return solids.hull(HalfspaceIntersection(planes, inside).intersections, 0.002)

    def cone(a: float, b: float, top: float, ridge: float) -> list[tuple[float, float, float]]:
        """Rises from half sides a, b at z = 0 to a ridge along b."""
        wide = a * (1 - sunk / top)
        far = b + (b - ridge) * -sunk / top
        base = [(x, y, sunk) for x in (-wide, wide) for y in (-far, far)]
        return [*base, (0.0, -ridge, top), (0.0, ridge, top)]

    def box(
        a: tuple[float, float], b: float, top: float, slope: float = 0.0
    ) -> list[tuple[float, float, float]]:
        return [(x, y, z) for x in a for y in (-b, b) for z in (sunk, top + slope * x)]

    parts = [
        body(-0.08, -0.055, 20, cone(0.042, 0.042, 0.038, 0.0)),  # pyramid
        body(0.0, -0.06, -15, box((-0.03, 0.03), 0.026, 0.026, 0.25)),  # block with a bevelled top
        body(-0.075, 0.05, -35, cone(0.03, 0.045, 0.03, 0.045)),  # roof ridge
    ]
    for k in range(4):  # stair
        parts.append(
            body(0.005, 0.055, 10, box((-0.032 + 0.016 * k, -0.016 + 0.016 * k), 0.035, 0.008 * (k + 1)))
        )
    # A bowl sunk into a drum.
    r = np.linspace(0, 0.03, 40)
    hollow = np.stack([r, 0.0357 - np.sqrt(0.033**2 - r**2)], 1)
    rim = np.stack([np.linspace(0.03, 0.036, 7)[1:-1], np.full(5, 0.022)], 1)
    side = np.stack([np.full(30, 0.036), np.linspace(0.022, sunk, 30)], 1)
    under = np.stack([np.linspace(0.036, 0, 20)[1:], np.full(19, sunk)], 1)
    drum = solids.lathe(
        np.concatenate([hollow, rim, side, under]), 360, lambda r, angle: r + 0 * angle, crease_deg=30.0
    )
    parts.append(solids.moved(drum, np.eye(3), np.array([0.085, -0.055, 0])))
    # A V groove whose ends slope as its sides do.
    y, x = np.meshgrid(
        np.linspace(-height / 2, height / 2, 380), np.linspace(-width / 2, width / 2, 470), indexing="ij"
    )
    a, b, _ = _turned(0, 0, -25) @ np.stack([x.ravel() - 0.08, y.ravel() - 0.05, 0 * x.ravel()])
    deep = 0.026 * np.minimum(1 - np.abs(a) / 0.022, (0.04 - np.abs(b)) / 0.022)
    parts.append(
        solids.terrain(-np.maximum(deep, 0).reshape(x.shape), width, height, base=-0.04, crease_deg=30.0)
    )
    solid = solids.join(parts)
    # The carved side (z up) faces the camera; tilted, so that side walls are seen.
    facing = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
    solid = _placed(solid, _turned(12, 14, 6) @ facing)
    p = solid.vertices
    albedo = dappled(p, 410, [(0.62, 0.6, 0.55), (0.5, 0.3, 0.2), (0.3, 0.42, 0.3)], 0.07)
    return Body("relief", solid, albedo, two_finishes(p, 460, 0.32, 0.7, 0.1))


def thin() -> Body:
    """A knotted wire, a ring and three leaves a few millimetres thick."""
    s = np.linspace(0, 2 * np.pi, 1201)[:-1]
    r = 0.07 + 0.032 * np.cos(3 * s)
    knot = np.stack([r * np.cos(2 * s), r * np.sin(2 * s), 0.04 * np.sin(3 * s)], 1)
    ring = 0.116 * np.stack([np.cos(s), np.sin(s), 0.12 * np.sin(2 * s)], 1)
    parts = [solids.tube(knot, 0.0085, 56), solids.tube(ring, 0.0055, 36)]
    angle = np.linspace(0, 2 * np.pi, 361)[:-1]
    leaf = np.stack([0.022 * np.cos(angle), 0.05 * np.sin(angle) * (1 + 0.25 * np.sin(angle))], 1)
    plate = solids.slab(leaf, 0.0025, 40)
    for turn_deg, tilt_deg in ((15, 40), (135, -35), (255, 55)):
        out = _turned(0, 0, turn_deg)
        parts.append(solids.moved(plate, out @ _turned(tilt_deg, 25, 0), out @ np.array([0.0, 0.062, 0.0])))
    solid = _placed(solids.join(parts), _turned(-18, 24, 10) @ np.diag([1.0, -1.0, -1.0]))
    p = solid.vertices
    albedo = dappled(p, 510, [(0.55, 0.35, 0.2), (0.6, 0.58, 0.5), (0.2, 0.42, 0.4)], 0.06)
    return Body("thin", solid, albedo, two_finishes(p, 560, 0.3, 0.6, 0.1))


def duo() -> Body:
    """An acorn: a glossy glazed nut in a rough cup."""
    bulge = clouds(601, 1.6)
    nut = solids.ball(150, lambda d: 0.098 * (1 + 0.13 * d[:, 2]) * np.exp(0.035 * bulge(d)))
    nut = Solid(nut.vertices + [0, 0, 0.022], nut.normals, nut.faces)
    t = np.linspace(0, 1, 260)
    outside = np.stack(
        [0.115 * np.sin(0.5 * np.pi * t[::-1]) ** 0.8, -0.105 + 0.115 * (1 - np.cos(0.5 * np.pi * t[::-1]))],
        1,
    )
    outside[-1, 0] = 0.0
    inside = np.stack([np.linspace(0, outside[0, 0], 80, endpoint=False), np.full(80, outside[0, 1])], 1)

    def scales(r: np.ndarray, angle: np.ndarray) -> np.ndarray:
        return r * (1 + 0.022 * np.cos(9 * angle) * np.minimum(r / 0.05, 1))

    cup = solids.lathe(np.concatenate([inside, outside]), 600, scales, crease_deg=50.0)
    facing = _turned(24, 0, -20) @ _CAM_FROM_UPRIGHT
    both = _placed(solids.join([nut, cup]), facing)
    is_nut = np.arange(len(both.vertices)) < len(nut.vertices)
    p = both.vertices
    glaze = dappled(p, 610, [(0.5, 0.16, 0.1), (0.62, 0.42, 0.16), (0.22, 0.12, 0.12)], 0.08)
    clay = dappled(p, 640, [(0.42, 0.46, 0.36), (0.62, 0.56, 0.46)], 0.05)
    glossy = np.clip(0.2 + 0.03 * clouds(660, 0.12)(p), 0.15, 0.25)
    matte = np.clip(0.7 + 0.06 * clouds(661, 0.1)(p), 0.55, 0.82)
    albedo = np.where(is_nut[:, None], glaze, clay)
    return Body("duo", both, albedo, np.where(is_nut, glossy, matte))


def gilded() -> Body:
    """The blob, a quarter of it gilded: satin metal between paint."""
    body = blob()
    p = body.solid.vertices
    gold = step(clouds(701, 0.16)(p) - 0.3, 0.02)
    leaf = np.exp(0.05 * clouds(702, 0.03)(p))[:, None] * [0.9, 0.66, 0.3]
    satin = np.clip(0.42 + 0.06 * clouds(703, 0.1)(p), 0.3, 0.55)
    albedo = body.albedo + (np.clip(leaf, 0, 0.95) - body.albedo) * gold[:, None]
    return Body("gilded", body.solid, albedo, body.roughness + (satin - body.roughness) * gold, gold)


def lacquered() -> Body:
    """The blob in a coat that mirrors twice as much as paint does."""
    body = blob()
    return Body("lacquered", body.solid, body.albedo, body.roughness, None, 1.0)


def bowl(deep: float = 1.0) -> Body:
    """An open bowl that looks at the camera, `deep` times as deep as half its width: what it hides from itself of the room."""
    quarter = np.linspace(0, np.pi / 2, 160)
    inside = 0.09 * np.stack([np.sin(quarter), -deep * np.cos(quarter)], 1)
    outside = np.stack([0.1 * np.cos(quarter), -(0.09 * deep + 0.012) * np.sin(quarter)], 1)
    outside[-1, 0] = 0.0
    profile = np.concatenate([inside, outside])
    solid = solids.lathe(profile, 480, lambda r, angle: r + 0 * angle, crease_deg=40.0)
    solid = _placed(solid, _turned(12, 16, 0) @ np.diag([1.0, -1.0, -1.0]))
    p = solid.vertices
    albedo = dappled(p, 810, [(0.6, 0.54, 0.44), (0.3, 0.42, 0.5), (0.6, 0.3, 0.2)], 0.07)
    return Body("bowl", solid, albedo, two_finishes(p, 860, 0.35, 0.65, 0.12))


OBJECTS: dict[str, Callable[..., Body]] = {
    "sphere": sphere, "blob": blob, "vase": vase, "relief": relief, "thin": thin, "duo": duo,
    "gilded": gilded, "lacquered": lacquered, "bowl": bowl,
}  # fmt: skip


def is_built_in(asked: str) -> bool:
    """Whether an object is one of these rather than a mesh file."""
    return asked.partition(":")[0] in OBJECTS


def model(asked: str) -> Body:
    """The body of that name, in the camera's frame; of the bowl also "bowl:deep=2".

    Raises:
        StudioError: no such object, or a number that it does not take.
    """
    if not is_built_in(asked):
        raise StudioError(f"there is no object called {asked!r}; choose one of {', '.join(OBJECTS)}")
    name, changes = order.changed(asked, *(("deep",) if asked.startswith("bowl:") else ()))
    body = OBJECTS[name](**changes)
    body = replace(body, name=asked.replace(":", "-"))
    away = solids.moved(body.solid, np.eye(3), np.array([0.0, 0.0, DISTANCE_M]))
    return replace(body, solid=away)
