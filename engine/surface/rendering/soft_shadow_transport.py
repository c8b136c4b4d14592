"""How pixels answer a light that the object's own heights hide from them with soft edges, and how the answer follows the heights.

What `Responses` is to rays that are cast at a mesh, this is to the ends of what stands in the way (`horizon_map`): a direction may be
open in part, and every pixel's answer has a derivative by where these ends are. Camera frame.
"""

# The stubs of numba misstate what comes back here.
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

from dataclasses import dataclass, replace
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Int

from engine.surface.reflectance.brdf import of_pixels, rows
from engine.surface.rendering.transport import Block, Incident, Responses, Sight
from engine.surface.visibility.horizon_map import Ground, Rims
from engine.surface.visibility.ray_visibility import BELOW

EDGE = 0.35
"""Half-width of a shadow's edge, in radii of a direction's cell."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SoftBlock(Block):
    """A block under shadows with soft edges; its light is told for the directions that some of its pixels may see."""

    kept: Int[np.ndarray, " e"]  # these directions
    way: Int[np.ndarray, " e"]  # on which of `Ground`'s each lies
    angle: Float[np.ndarray, "p e"]  # to each
    rims: Rims
    open_to: Float[np.ndarray, "p e"]
    source: Int[np.ndarray, "p e"]  # the pixel that stands in it; -1: none, or it looks away

    def part(self, pixels: Int[np.ndarray, " k"]) -> "SoftBlock":
        """The same of a few of them, whose rims nobody asks for any more."""
        return replace(
            self, points=self.points[pixels], views=self.views[pixels], apart=self.apart[pixels],
            lamps=self.lamps[pixels], material=of_pixels(self.material, pixels), angle=self.angle[pixels],
            open_to=self.open_to[pixels], source=self.source[pixels],
        )  # fmt: skip


class Soft:
    """Diffuse and specular responses under some heights; `Rows` of the solver.

    All of a block's pixels share its light, lamps included. What hides throws what was photographed, as in `Responses`.
    """

    def __init__(
        self,
        hard: Responses,
        ground: Ground,
        height: Float[np.ndarray, " p"],
        deep: Float[np.ndarray, " p"],
        normals: Float[np.ndarray, "p 3"],
    ):
        """`deep` as `Ground.rims` has it; `normals` tell which way what hides looks, and who sees which directions."""
        self.hard, self.ground, self.height, self.deep = hard, ground, height, deep
        self.normals = normals.astype(np.float32)
        self.directions = hard.incident.directions
        self.edge = np.float32(EDGE * np.sqrt(4 / len(self.directions)))

    @property
    def incident(self) -> Incident:
        """The light."""
        return self.hard.incident

    def block(self, sight: Sight, pixels: Int[np.ndarray, " p"]) -> SoftBlock:
        """What reaches a block of pixels under the heights."""
        kept = np.nonzero((self.normals[pixels] @ self.directions.T).max(0) > -BELOW)[0]
        energy = self.hard.whole_energy(sight, pixels)[kept].astype(np.float32)
        nothing = np.zeros((len(pixels), 0), np.float32)
        way, angle = self.ground.seen(pixels, self.directions[kept])
        rims = self.ground.rims(self.height, self.deep, pixels)
        open_to, source = self._opened(rims, kept, way, angle)
        return SoftBlock(
            sight.points[pixels], sight.views[pixels], energy, np.zeros((0, *energy.shape), np.float32), nothing, None,
            nothing[..., None], of_pixels(sight.material, pixels), kept=kept, way=way, angle=angle, rims=rims,
            open_to=open_to, source=source,
        )  # fmt: skip

    def under(self, block: SoftBlock, rims: Rims) -> SoftBlock:
        """The block when other things stand in its way."""
        open_to, source = self._opened(rims, block.kept, block.way, block.angle)
        return replace(block, rims=rims, open_to=open_to, source=source)

    def _opened(self, rims, kept, way, angle):
        return _opened(
            rims.angle, rims.first, rims.second, rims.share, way, angle, self.normals,
            self.directions[kept].astype(np.float32), self.edge,
        )  # fmt: skip

    def bare(
        self, block: SoftBlock, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "r e"], Float[np.ndarray, "r e"]]:
        """(diffuse, specular) rows under an open sky, `r` = p k."""
        variants, hard = roughness.shape[1], self.hard
        everything = np.ones((roughness.size, len(block.kept)), np.uint8)
        material = None if block.material is None else np.repeat(block.material, variants, 0)
        return rows(
            normals.reshape(-1, 3), roughness.ravel(), np.repeat(block.views, variants, 0),
            self.directions[block.kept], everything, hard.full_diffuse, hard.floor, material,
        )  # fmt: skip

    def lit(
        self, block: SoftBlock, diffuse: Float[np.ndarray, "r e"], specular: Float[np.ndarray, "r e"]
    ) -> tuple[Float[np.ndarray, "r v"], Float[np.ndarray, "r v"]]:
        """What rows make of the light that comes in and of what stands in its way."""
        variants = len(diffuse) // len(block.views)
        open_to, source = (np.repeat(x, variants, 0) for x in (block.open_to, block.source))
        let_in = diffuse * open_to, specular * open_to
        sent = let_in[0] @ block.energy, let_in[1] @ block.energy
        if self.hard.bounce:
            _bounced(
                diffuse - let_in[0],
                specular - let_in[1],
                source,
                self.hard.photographed,
                self.hard.cell,
                *sent,
            )
        return sent

    def __call__(
        self, block: Block, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "p k v"], Float[np.ndarray, "p k v"]]:
        """(diffuse, specular) of `k` variants of each pixel of one of its own blocks; no albedo applied."""
        assert isinstance(block, SoftBlock)
        diffuse, specular = self.lit(block, *self.bare(block, normals, roughness))
        shape = (*roughness.shape, -1)
        return diffuse.reshape(shape), specular.reshape(shape)

    def turned(
        self,
        block: SoftBlock,
        diffuse: Float[np.ndarray, "p e"],
        specular: Float[np.ndarray, "p e"],
        by_diffuse: Float[np.ndarray, "p v"],
        by_specular: Float[np.ndarray, "p v"],
    ) -> Float[np.ndarray, "p k m 2"]:
        """From how a cost rises with what either kind of rows sends, to how it does with every radian of an end."""
        slope = diffuse * (by_diffuse @ block.energy.T) + specular * (by_specular @ block.energy.T)
        photographed = self.hard.photographed if self.hard.bounce else np.zeros((0, 0), np.float32)
        return _turned(
            slope, diffuse, specular, by_diffuse, by_specular, block.rims.angle, block.rims.first, block.angle,
            block.open_to, block.source, photographed, self.hard.cell, self.edge, block.way,
        )  # fmt: skip


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy", inline="always")
@no_type_check
def _part(x):
    """Logistic."""
    return np.float32(1) / (np.float32(1) + np.exp(-min(max(x, np.float32(-30)), np.float32(30))))


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _opened(ends, first, second, share, way, angle, normals, directions, edge):
    """How far every direction is open, and which pixel stands in it: -1 if that is none, or looks away."""
    open_to, source = np.empty(angle.shape, np.float32), np.empty(angle.shape, np.int32)
    for b in range(angle.shape[0]):
        for d in range(angle.shape[1]):
            k = way[d]
            source[b, d] = -1
            left, most, piece = np.float32(1), np.float32(0), -1
            for m in range(ends.shape[2]):
                if first[b, k, m, 0] < 0:
                    break
                into = (angle[b, d] - np.float32(ends[b, k, m, 0])) / edge
                out = (np.float32(ends[b, k, m, 1]) - angle[b, d]) / edge
                if into < -9 or out < -9:
                    continue
                covered = _part(into) * _part(out)
                left *= np.float32(1) - covered
                if covered > most:
                    most, piece = covered, m
            open_to[b, d] = left
            if piece >= 0:
                q = first[b, k, piece, 0] if share[b, k, piece, 0] > 0.5 else second[b, k, piece, 0]
                away = np.float32(0)
                for i in range(3):
                    away += normals[q, i] * directions[d, i]
                if away < 0:
                    source[b, d] = q
    return open_to, source


@numba.njit(nogil=True, fastmath=True, cache=True)
@no_type_check
def _bounced(diffuse, specular, source, photographed, cell, to_diffuse, to_specular):
    """Add what is photographed where directions are hidden, each by its rows."""
    for b in range(source.shape[0]):
        for d in range(source.shape[1]):
            q, one, two = source[b, d], diffuse[b, d] * cell, specular[b, d] * cell
            if q < 0 or one + two < 1e-6:
                continue
            for v in range(photographed.shape[1]):
                to_diffuse[b, v] += one * photographed[q, v]
                to_specular[b, v] += two * photographed[q, v]


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _turned(
    slope, diffuse, specular, by_diffuse, by_specular, ends, first, angle, open_to, source, photographed, cell,
    edge, way,
):  # fmt: skip
    """From what the misfit rises by as directions open, without what hides them, to what it does with every radian of an end."""
    turned = np.zeros(ends.shape)
    for b in range(slope.shape[0]):
        for d in range(slope.shape[1]):
            k, gain, known = way[d], np.float32(0), False
            for m in range(ends.shape[2]):
                if first[b, k, m, 0] < 0:
                    break
                into = (angle[b, d] - np.float32(ends[b, k, m, 0])) / edge
                out = (np.float32(ends[b, k, m, 1]) - angle[b, d]) / edge
                if into < -9 or out < -9 or (into > 9 and out > 9):
                    continue
                one, two = _part(into), _part(out)
                others = open_to[b, d] / max(np.float32(1) - one * two, np.float32(1e-6))
                begins, stops = others * one * (1 - one) * two / edge, others * one * two * (1 - two) / edge
                if max(begins, stops) < 1e-3:
                    continue
                if not known:
                    q, by_paint, by_gloss = source[b, d], np.float32(0), np.float32(0)
                    if q >= 0:
                        for v in range(photographed.shape[1]):
                            by_paint += by_diffuse[b, v] * photographed[q, v]
                            by_gloss += by_specular[b, v] * photographed[q, v]
                    gain = slope[b, d] - cell * (diffuse[b, d] * by_paint + specular[b, d] * by_gloss)
                    known = True
                turned[b, k, m, 0] += gain * begins
                turned[b, k, m, 1] -= gain * stops
    return turned
