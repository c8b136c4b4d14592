"""What a pixel's unknowns vary by, as horizons that hide the room from it may be misplaced.

Where photographs overrule the depth's horizons they show how wrong the depth is thereabouts. Those beside them, which
nothing contradicts loudly enough, may be as far off, in every sector by itself; and the pixel's normal, albedo and
roughness follow. Camera frame; horizons in the rings of `horizon_search`.
"""

from dataclasses import dataclass
from functools import partial
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter

from engine.parallel import each
from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.optimize.gauss_newton import LONGEST, State, regular, slopes, variants
from engine.surface.optimize.horizon_search import LEVELS, beside, compass
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import of_pixels, rows
from engine.surface.rendering.object_pixels import Subject, as_photographed
from engine.surface.rendering.transport import Incident, Responses, Sight, blocks
from engine.surface.visibility.ray_visibility import SECTORS

ROUND = 7
"""Pixels across the square whose overruled horizons speak for the one in its middle."""


@dataclass(frozen=True, slots=True, eq=False)
class Misplaced:
    """How far every pixel's horizons may be off, and what would then be seen past them."""

    square: Float[np.ndarray, " p"]  # the mean over its sectors, rings
    beside: Int[np.ndarray, "p s"]  # as `horizon_search.beside` has it, of the pixels that are photographed

    def variance(
        self,
        state: State,
        responses: Responses,
        sight: Sight,
        parts: list[Int[np.ndarray, " _"]],
        seen: Observations,
        progress: Progress,
    ) -> Float[np.ndarray, "p 6"]:
        """What the pixels' unknowns vary by: to first order their steps towards photographs in which one sector's horizon lies
        elsewhere, each sector's by itself."""
        found = np.zeros((len(self.square), 6))
        directions = responses.incident.directions

        def doubt(block: Int[np.ndarray, " _"]) -> None:
            pixels = block[self.square[block] > 0]
            if len(pixels):
                around, few = compass(directions, sight.middle(block)), state.part(pixels)
                level = standing(sight, pixels, few.normals, directions, around)
                step = self._steps(few, responses, sight, pixels, seen.part(pixels), level, around)
                # A longer one is beyond what slopes tell.
                found[pixels] = (np.clip(step, -LONGEST[:6], LONGEST[:6]) ** 2).sum(1)

        each(doubt, parts, progress, "doubting what hides the room")
        return found

    def _steps(self, state, responses, sight, pixels, seen, level, around):
        leaning, rough, inward = variants(state.normals, state.roughness)
        answers = responses(responses.block(sight, pixels), leaning, rough)
        base, own = slopes(answers[0], answers[1], state.albedo, inward, seen.eps)
        off = np.log((seen.radiance + seen.eps[:, None]) / base)
        towards = np.linalg.solve(regular(state.system), own.transpose(0, 2, 1))
        single = partial(np.asarray, dtype=np.float32)
        directions = responses.incident.directions
        everything = np.ones((len(pixels), len(directions)), np.uint8)
        diffuse, specular = rows(
            state.normals, state.roughness, sight.views[pixels], directions, everything,
            responses.full_diffuse, responses.floor, of_pixels(sight.material, pixels),
        )  # fmt: skip
        sector, ring = around
        step = np.empty((len(pixels), SECTORS, 6), np.float32)
        _foretold(
            diffuse, specular, single(state.albedo), level, sector, ring,
            responses.whole_energy(sight, pixels), np.float32(responses.cell * responses.bounce),
            self.beside[pixels], responses.photographed, single(np.sqrt(self.square[pixels])), single(base),
            single(off), single(seen.weight), single(state.spread) ** 2, np.float32(seen.cauchy**2),
            single(towards), step,
        )  # fmt: skip
        return step


def unsure(
    who: Subject,
    state: State,
    light: Incident,
    sight: Sight,
    params: SurfaceParams,
    progress: Progress,
) -> Float[np.ndarray, "p 6"] | None:
    """What the unknowns of a state vary by, given what the depth says hides the room (`sight`); None where all horizons stand as the
    depth has them."""
    seeing = as_photographed(who, state, sight, light.directions)
    horizons = misplaced(sight, seeing, state, who.mask, light.directions, progress.part(0, 0.2))
    if horizons is None:
        return None
    responses, parts = who.responses(light, params, "cpu", seeing), blocks(who.mask)
    return horizons.variance(state, responses, seeing, parts, who.seen, progress.part(0.2, 1))


def misplaced(
    depth: Sight,
    seeing: Sight,
    state: State,
    mask: Bool[np.ndarray, "h w"],
    directions: Float[np.ndarray, "d 3"],
    progress: Progress,
) -> Misplaced | None:
    """As far as horizons around a pixel are off in the sight that the `depth` told, as those say that are overruled in `seeing`;
    None where all stand as the depth has them."""
    if depth.occlusion is None or not state.level.any():
        return None
    off, parts = np.zeros(state.level.shape, np.int32), blocks(mask)

    def compare(block: Int[np.ndarray, " _"]) -> None:
        around, normals = compass(directions, depth.middle(block)), state.normals[block]
        told, known = (standing(sight, block, normals, directions, around) for sight in (depth, seeing))
        off[block] = known - told

    each(compare, parts, progress, "doubting what hides the room")
    square = np.zeros(mask.shape)
    square[mask] = np.where(state.level > 0, off**2, 0).mean(1)
    around = uniform_filter(square, ROUND)[mask] / uniform_filter(mask.astype(float), ROUND)[mask]
    return Misplaced(np.maximum(around, 0), beside(mask))


def standing(
    sight: Sight,
    pixels: Int[np.ndarray, " k"],
    normals: Float[np.ndarray, "k 3"],
    directions: Float[np.ndarray, "d 3"],
    around: tuple[Int[np.ndarray, " d"], Int[np.ndarray, " d"]],
) -> Int[np.ndarray, "k s"]:
    """The level of every sector that comes nearest to what is hidden there, by cosines; the least hiding of equal ones. `around`
    is the compass of the pixels' block."""
    if sight.occlusion is None:
        return np.full((len(pixels), SECTORS), LEVELS - 1, np.int32)
    start, direction, _ = sight.occlusion.of(pixels)
    cosine = np.maximum(normals @ directions.T, 0).astype(np.float32)
    return _standing(cosine, start, direction, *around)


@numba.njit(nogil=True, cache=True)
@no_type_check
def _standing(cosine, start, direction, sector, ring):
    count, rings = len(cosine), LEVELS - 1
    found = np.empty((count, SECTORS), np.int32)
    for p in range(count):
        # Of every ring what is open and what is hidden.
        light = np.zeros((SECTORS, rings, 2))
        for d in range(cosine.shape[1]):
            light[sector[d], ring[d], 0] += cosine[p, d]
        for k in range(start[p], start[p + 1]):
            d = direction[k]
            light[sector[d], ring[d], 0] -= cosine[p, d]
            light[sector[d], ring[d], 1] += cosine[p, d]
        for s in range(SECTORS):
            # Level l is wrong about what is hidden below it, and about what is open from it on.
            wrong = light[s, 0, 1]
            for r in range(1, rings):
                wrong += light[s, r, 0]
            least = np.inf
            for l in range(1, rings + 1):
                if wrong <= least + 1e-6:
                    least = min(wrong, least)
                    found[p, s] = l
                if l < rings:
                    wrong += light[s, l, 1] - light[s, l, 0]
    return found


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _foretold(
    diffuse, specular, albedo, level, sector, ring, energy, cell, instead, photographed, rings, base, off, weight,
    squares, wide, towards, found,
):  # fmt: skip
    """The steps (p s 6) of the unknowns for each sector whose horizon is `rings` elsewhere."""
    size = energy.shape[1]
    for p in range(len(found)):
        sent = np.zeros((SECTORS, size), np.float32)
        for d in range(len(sector)):
            s = sector[d]
            # Of the two rings beside a horizon the mean.
            if not level[p, s] - 1 <= ring[d] <= level[p, s] or ring[d] < 1 or diffuse[p, d] <= 0:
                continue
            thrown = photographed[instead[p, s]]
            for c in range(3):
                by = np.float32(0.5) * (albedo[p, c] * diffuse[p, d] + specular[p, d])
                for v in range(c, size, 3):
                    sent[s, v] += by * (energy[d, v] - cell * thrown[v])
        for s in range(SECTORS):
            more = np.float32(0)
            for v in range(size):
                sent[s, v] *= rings[p] / base[p, v]
                more += weight[p, v] * sent[s, v] * sent[s, v]
            # Views that would then misfit count for less, but all that misfit would be measured anew.
            square = squares[p] + more / np.float32(size)
            before, after = np.float32(1e-30), np.float32(1e-30)
            for v in range(size):
                # Nearer and farther are as likely.
                e, own, w = sent[s, v], off[p, v] * off[p, v], weight[p, v]
                robust = w / (np.float32(1) + w * (e * e + own) / (wide * square))
                before += w / (np.float32(1) + w * own / (wide * squares[p]))
                after += robust
                sent[s, v] = robust * e
            for i in range(6):
                total = np.float32(0)
                for v in range(size):
                    total += towards[p, i, v] * sent[s, v]
                found[p, s, i] = total * before / after
