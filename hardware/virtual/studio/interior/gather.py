"""Bake a room's light: irradiance at every point of the lightmap, gathered again and again until all bounces are in it.

Each round gathers, at every point, what the room as it is known so far sends from directions by the cosine and towards lamps
(two samples that share by the balance heuristic), and what comes out is known to the next points at once. The first rounds
carry light around; the last ones take many samples, each of one bounce, so that noise does not add up along paths. Light
that came by way of surfaces is averaged over neighbours that face the same way; light straight from lamps too, where they
differ by no more than noise, so that edges of shadows stay. Nothing is lost: a closed room of albedo a that glows e ends at
e / (1 - a).
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from hardware.errors import StudioError
from hardware.virtual.studio import tracer
from hardware.virtual.studio.interior import glow, lightmap
from hardware.virtual.studio.interior.read import Interior

VERSION = 1  # raise when the baked values would change
LANES = 1_500_000
FORESEE = 4  # rounds before the look ahead: what further ones add still stands out of the noise
MOST_LEFT = 0.97  # of the light of one round that the next may add
NEIGHBOURS = 12
EDGE = 8.0  # differences whose square is this many times the noise's are the room's own
ALIKE = 0.9  # cosine between the normals of neighbours

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class Quality:
    """What a bake costs."""

    points: int = 700_000
    first: tuple[int, ...] = (4,) * 12  # samples of each round that carries light around
    last: tuple[int, ...] = (32,) * 8  # of those whose mean is kept


QUALITY = Quality()


@dataclass(frozen=True, slots=True, eq=False)
class Baked:
    """A room with its light: irradiance / pi of the front and the back at every point."""

    room: Interior
    grid: lightmap.Layout
    light: Float[np.ndarray, "2 n 3"]
    key: str  # of the way it was baked


def bake(room: Interior, cache: Path, device: str, progress: Progress) -> Baked:
    """The room's light; read from `cache` when it was baked before, gone on with when that was cut off.

    Raises:
        StudioError: the device is not there, or what is kept is not of this room.
    """
    quality = QUALITY
    grid = lightmap.layout(room, quality.points)
    path = cache / f"{room.name}-{room.key}-{_digest(quality)}.npz"
    if path.exists():
        with np.load(path) as stored:
            light = stored["light"].astype(np.float32)
        # Rays would read past its end without a word.
        if light.shape != (2, grid.count, 3):
            raise StudioError(
                f"{path}: holds the light of {light.shape} points, the room has {grid.count}; remove it"
            )
        return Baked(room, grid, light, _digest(quality))
    cache.mkdir(parents=True, exist_ok=True)
    light = _Bake(room, grid, tracer.load(device), quality).run(path.with_suffix(".begun.npz"), progress)
    _store(path, light=light.astype(np.float32))
    path.with_suffix(".begun.npz").unlink(missing_ok=True)
    return Baked(room, grid, light, _digest(quality))


class _Bake:
    """One bake under way."""

    def __init__(self, room: Interior, grid: lightmap.Layout, mi: Any, quality: Quality):
        self.mi, self.grid, self.quality = mi, grid, quality
        points = lightmap.points(grid)
        corners = room.vertices[room.faces[points.face]]
        self.at = np.einsum("nk,nkc->nc", points.weights, corners)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normal = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-20)
        shading = np.einsum("nk,nkc->nc", points.weights, room.normals[room.faces[points.face]])
        length = np.linalg.norm(shading, axis=1, keepdims=True)
        shading = np.where(length > 0.1, shading / np.maximum(length, 1e-9), self.normal)
        self.shading = shading * np.where((shading * self.normal).sum(1) < 0, -1.0, 1.0)[:, None]
        self.two_sided = np.array([look.two_sided for look in room.looks])[room.look[points.face]]
        self.known = glow.Room(mi, room, grid, np.zeros((2, grid.count, 3)))

    def run(self, begun: Path, progress: Progress) -> Float[np.ndarray, "2 n 3"]:
        mi, count = self.mi, self.grid.count
        rounds = (*self.quality.first, *self.quality.last)
        done, straight, around = 0, np.zeros((2 * count, 3), np.float32), np.zeros((2 * count, 3), np.float32)
        totals = np.zeros((0, 3))  # light in the room after each of the latest rounds
        squares = np.zeros(2 * count, np.float32)  # of the lamps' part: rounds tell how noisy it is
        if begun.exists():
            with np.load(begun) as stored:
                done, straight, around = int(stored["done"]), stored["straight"], stored["around"]
                squares, totals = stored["squares"], stored["totals"]
                self.known.light = mi.Float(stored["light"])
        order = np.random.default_rng(0).permutation(2 * count).astype(np.uint32)
        order = order[self.two_sided[order % count] | (order < count)]
        cost = np.cumsum([0, *rounds])
        for turn in range(done, len(rounds)):
            samples, keeping = rounds[turn], turn >= len(self.quality.first)
            step = max(1, LANES // samples)
            for begin in range(0, len(order), step):
                some = order[begin : begin + step]
                share = (cost[turn] + samples * begin / len(order)) / cost[-1]
                progress(float(share), f"baking the light of room {begun.name.split('-')[0]}, once")
                lamp, rest = self._gathered(some, samples, turn)
                if not keeping:
                    self._tell(some, lamp + rest)
                else:
                    straight[some] += lamp * samples
                    around[some] += rest * samples
                    squares[some] += np.square(lamp.mean(1)) * samples
                    taken = cost[turn + 1] - cost[len(self.quality.first)]
                    self._tell(some, (straight[some] + around[some]) / taken)
            if not keeping:
                totals = np.concatenate([totals, [self._total()]])[-3:]
                if turn + 1 == FORESEE:
                    self._foreseen(totals)
            _store(
                begun,
                done=turn + 1,
                totals=totals,
                straight=straight,
                around=around,
                squares=squares,
                light=np.array(self.known.light),
            )
        taken, straight = sum(self.quality.last), (straight / sum(self.quality.last)).reshape(2, count, 3)
        spread = np.maximum(squares.reshape(2, count) / taken - np.square(straight.mean(-1)), 0)
        variance = spread / max(len(self.quality.last) - 1, 1)
        return self._smoothed(straight, variance) + self._smoothed(
            (around / taken).reshape(2, count, 3), None
        )

    def _total(self) -> Float[np.ndarray, "3"]:
        """Mean over all points."""
        return np.array(self.known.light).reshape(-1, 4)[:, :3].mean(0, dtype=float)

    def _foreseen(self, totals: Float[np.ndarray, "3 3"]) -> None:
        """Brighten the room as a whole by what further rounds would bring (Aitken); later rounds put it where it belongs."""
        before, latest = totals[1] - totals[0], totals[2] - totals[1]
        ratio = np.clip(latest / np.where(before > 0, before, np.inf), 0, MOST_LEFT)
        factor = 1 + latest * ratio / (1 - ratio) / np.maximum(totals[2], 1e-30)
        light = np.array(self.known.light).reshape(-1, 4)
        light[:, :3] *= np.maximum(factor, 1)
        self.known.light = self.mi.Float(light.ravel().astype(np.float32))

    def _tell(self, some: np.ndarray, light: np.ndarray) -> None:
        import drjit as dr

        mi = self.mi
        value = mi.Vector4f(*(mi.Float(light[:, k].astype(np.float32)) for k in range(3)), 0.0)
        dr.scatter(self.known.light, value, mi.UInt32(some))
        dr.eval(self.known.light)

    def _gathered(self, some: np.ndarray, samples: int, turn: int) -> tuple[np.ndarray, np.ndarray]:
        """Irradiance / pi of some points (both sides counted): from lamps and the outside, from surfaces."""
        mi = self.mi
        import drjit as dr

        point, sign = some % self.grid.count, np.where(some < self.grid.count, 1.0, -1.0)[:, None]
        normal = self.normal[point] * sign
        arrays = [self.at[point] + normal * self.known.nudge, normal, self.shading[point] * sign]
        start, flat, shading = (
            mi.Vector3f(*(mi.Float(a[:, k].astype(np.float32)) for k in range(3))) for a in arrays
        )
        lane = dr.arange(mi.UInt32, len(some) * samples)
        mine, number = lane // samples, lane % samples
        ident = dr.gather(mi.UInt32, mi.UInt32(some), mine)
        origin, up, n = (dr.gather(mi.Vector3f, a, mine) for a in (start, flat, shading))
        salt = dr.opaque(mi.UInt32, turn * 4)
        first, second = (self._strata(ident, number, samples, salt + k) for k in (0, 1))
        lamp, rest = mi.Color3f(0.0), mi.Color3f(0.0)
        local = mi.warp.square_to_cosine_hemisphere(first)
        away = mi.Frame3f(n).to_world(local)
        good = dr.dot(away, up) > 0
        met = self.known.meet(mi.Ray3f(mi.Point3f(origin), away), good)
        straight = met.density > 0
        density = local.z / dr.pi
        value = dr.select(good, met.radiance * density / dr.maximum(density + met.density, 1e-20), 0.0)
        lamp += dr.select(straight, value, 0.0)
        rest += dr.select(straight, 0.0, value)
        if self.known.lamps:
            away, distance = self.known.aim(mi.Point3f(origin), second)
            cosine = dr.dot(away, n)
            good = (cosine > 0) & (dr.dot(away, up) > 0)
            met = self.known.meet(mi.Ray3f(mi.Point3f(origin), away), good)
            good &= (met.density > 0) & (met.distance >= distance * glow.REACH)
            share = cosine / dr.pi
            lamp += dr.select(good, met.radiance * share / dr.maximum(share + met.density, 1e-20), 0.0)
        dr.eval(lamp, rest)
        return tuple(np.array(dr.block_sum(value, samples)).T / samples for value in (lamp, rest))  # type: ignore[return-value]

    def _strata(self, ident: Any, number: Any, count: int, salt: Any) -> Any:
        """A lattice of rank one, shifted for each point and round."""
        mi = self.mi
        x, y = mi.sample_tea_32(ident, salt)
        golden = mi.UInt32(np.uint32(round(0.6180339887 * 2**32) & 0xFFFFFFFF))
        x += mi.UInt32(2**32 // count) * number
        y += golden * number
        return mi.Point2f(mi.Float(x >> 8), mi.Float(y >> 8)) * 2.0**-24

    def _smoothed(
        self, light: Float[np.ndarray, "2 n 3"], variance: Float[np.ndarray, "2 n"] | None
    ) -> Float[np.ndarray, "2 n 3"]:
        """Means over the nearest points that face the same way, each side for itself; not across edges that stand out
        of the noise, where it is known.
        """
        tree = KDTree(self.at)
        out = np.empty_like(light)
        for begin in range(0, len(self.at), 200_000):
            part = slice(begin, min(begin + 200_000, len(self.at)))
            distance, near = tree.query(self.at[part], k=min(NEIGHBOURS, len(self.at)), workers=-1)
            near = near.reshape(part.stop - part.start, -1)
            distance = distance.reshape(near.shape)
            turned = np.einsum("nc,nkc->nk", self.shading[part], self.shading[near])
            reach = np.maximum(distance[:, -1:] / 2, 1e-9)
            weight = np.exp(-0.5 * (distance / reach) ** 2) * (np.abs(turned) > ALIKE)
            # A face beside it may be wound the other way: its back is then on our side.
            for side in (0, 1):
                there = np.where(turned[..., None] > 0, light[side][near], light[1 - side][near])
                dark = there.max(-1) <= 0  # nothing reaches it, or its side sends nothing
                used = np.where(dark & (distance > 0), 0.0, weight)
                if variance is not None:
                    noisy = np.where(turned > 0, variance[side][near], variance[1 - side][near])
                    noisy = noisy.mean(1, keepdims=True)  # of one point it is itself a rough estimate
                    apart = np.square(there.mean(-1) - light[side, part].mean(-1)[:, None])
                    used = used * np.exp(-apart / np.maximum(EDGE * noisy, 1e-20))
                out[side, part] = (there * used[..., None]).sum(1) / np.maximum(used.sum(1), 1e-20)[:, None]
        return np.where((light.max(-1) > 0)[..., None], out, 0.0)


def _digest(quality: Quality) -> str:
    import hashlib

    return hashlib.sha256(repr((VERSION, quality, NEIGHBOURS, ALIKE, EDGE)).encode()).hexdigest()[:8]


def _store(path: Path, **arrays: Any) -> None:
    """Appears whole or not at all."""
    partial = path.with_name(f"{path.stem}.{os.getpid()}.partial.npz")
    np.savez(partial, **arrays)
    partial.rename(path)
