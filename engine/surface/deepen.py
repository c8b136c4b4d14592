"""Heights follow the slope of the photographs' misfit, through shadows with soft edges.

Normals integrate to a depth that draws together what hangs in front of each other, and horizons, a dozen to a pixel, move
what stands apart but do not know the shape within a groove. What does is every direction of every pixel: what a height hides
from whom, it takes from that pixel's pictures, in each view as much as came from there. The misfit's derivative by all heights is a few
products of matrices, each pixel's own unknowns eliminated (variable projection: Golub and Pereyra 1973, in Kaufman's form), and
what departs from the normals' own heights costs as it does in `relax`. Heights go downhill by conjugate gradients, pixels are solved
anew under what the new depth hides, and so on.

Camera frame; heights are logarithms of z.
"""

# The stubs of scipy and numba misstate what comes back here.
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

from dataclasses import dataclass, replace
from typing import no_type_check

import numba
import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int

from engine.progress import Progress
from engine.surface import newton
from engine.surface.abreast import abreast
from engine.surface.brdf import of_pixels, rows
from engine.surface.clearance import AZIMUTHS, Ground, Rims
from engine.surface.detail import Picture, enlarged, smaller
from engine.surface.integrate import integrate
from engine.surface.observations import thinned
from engine.surface.pixels import Subject, SurfaceParams, image, sight_of, subject
from engine.surface.relax import Here, Steps, descended, seams
from engine.surface.transport import Incident, Responses, Sight, blocks

MOST, VIEWS = 12_000, 24
"""Pixels and views, at most, that tell."""
ROUNDS, PASSES = 5, 4
"""Times that pixels are solved anew, and Gauss-Newton evaluations of the pixels."""
EDGE = 0.35
"""Half-width of a shadow's edge, in radii of a direction's cell; with twice as much a vase comes out alike."""
STEPS = Steps(turns=6, afresh=4, farthest=3.0, shorter=0.4, tries=7)
"""Of the heights in between, in pixel widths."""


def deepened(
    picture: Picture,
    fitted: Int[np.ndarray, " n"],
    drift: Float[np.ndarray, " n"],
    material: Float[np.ndarray, "p 2"] | None,
    state: newton.State,
    depth: Float[np.ndarray, "h w"],
    light: Incident,
    distance: float,
    params: SurfaceParams,
    progress: Progress,
) -> Float[np.ndarray, "h w"]:
    """The depth of a picture whose pixels' state is nearly known, found again from how it hides the room from them; its mean is
    `distance`.

    A smaller picture in some of the `fitted` views, whose `light` it is, tells by how much heights are off.
    """
    small, take = smaller(picture, MOST)
    views = thinned(np.arange(len(fitted)), VIEWS)
    who = subject(small.frames, small.mask, small.camera, fitted[views], params).exposed(drift[views])
    share = 1 / np.bincount(take)
    first = np.unique(take, return_index=True)[1]

    def means(x: Float[np.ndarray, "p k"]) -> Float[np.ndarray, "q k"]:
        return np.stack([np.bincount(take, column) * share for column in x.T], 1)

    normals = means(state.normals)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    begun = newton.begin(normals, means(state.albedo), means(state.roughness[:, None])[:, 0])
    before = means(np.log(depth[picture.mask])[:, None])[:, 0]
    who = replace(who, material=of_pixels(material, first))
    after = _found(who, begun, before, light.views(views), distance, replace(params, walls=False), progress)
    change = enlarged(small.mask, image(small.mask, after - before), picture.mask)
    z = depth * np.exp(change) * picture.mask
    return z * (distance / z[picture.mask].mean())


def _found(
    who: Subject,
    state: newton.State,
    height: Float[np.ndarray, " p"],
    light: Incident,
    distance: float,
    params: SurfaceParams,
    progress: Progress,
) -> Float[np.ndarray, " p"]:
    """The heights of one size."""
    mask, ground = who.mask, Ground(who.camera, who.mask)
    bonds, steps = seams(mask, np.zeros(mask.shape)), replace(STEPS, farthest=STEPS.farthest * who.pitch)
    for turn in range(ROUNDS):
        span = progress.part(turn / ROUNDS, (turn + 1) / ROUNDS)
        sight = sight_of(
            who, state, image(mask, np.exp(height)), light.directions, params, span.part(0, 0.05)
        )
        responses = who.responses(light, params, "cpu", sight)
        state = newton.iterate(
            state, responses, sight, blocks(mask), who.seen, PASSES, span.part(0.05, 0.3), anew=True
        )
        own = integrate(who.camera, image(mask, state.normals), mask, distance, span.part(0.3, 0.35))
        cost = _Cost(who, state, responses, sight, ground, height, np.log(own[mask]), bonds)
        before = height
        doing = "heights that shadows tell"
        height, _ = descended(cost, height, cost.at(height), steps, span.part(0.35, 1), doing)
        if before is height:
            break
    return height


@dataclass(frozen=True, slots=True, eq=False)
class _Told:
    """A block of pixels as its own unknowns stand."""

    pixels: Int[np.ndarray, " b"]
    way: Int[np.ndarray, " d"]  # of every direction
    angle: Float[np.ndarray, "b d"]  # to each
    diffuse: Float[np.ndarray, "b d"]  # rows, albedo and bare sky taken for granted
    specular: Float[np.ndarray, "b d"]
    energy: Float[np.ndarray, "d v"]
    colour: Float[np.ndarray, "b v"]
    rest: Float[np.ndarray, "b v"]  # of what the pixel sends, what hard shadows and its own place make of it
    eps: Float[np.ndarray, "b 1"]
    own: Float[np.ndarray, "b v 6"]  # how the logarithm of what it sends follows its own unknowns
    weight: Float[np.ndarray, "b v"]  # per squared spread
    inverse: Float[np.ndarray, "b 6 6"]  # of their system


class _Cost:
    """What shadows and departures from the normals' own heights cost together, in squared spreads of the residuals."""

    def __init__(self, who, state, responses: Responses, sight: Sight, ground, height, own, bonds) -> None:
        self.who, self.state, self.responses, self.sight, self.ground = who, state, responses, sight, ground
        self.normal_height, self.bonds, self.pitch = own, bonds, who.pitch
        self.directions = responses.incident.directions
        self.edge = EDGE * np.sqrt(4 / len(self.directions))
        self.normals = state.normals.astype(np.float32)
        self.told = list(abreast(lambda pixels: self._tell(height, pixels), blocks(who.mask)))

    def _tell(self, height, pixels) -> _Told:
        state, seen, responses = self.state, self.who.seen, self.responses
        n, a, r = state.normals[pixels], state.albedo[pixels], state.roughness[pixels]
        leaning, rough, inward = newton.variants(n, r)
        answers = responses(responses.block(self.sight, pixels), leaning, rough)
        base, own = newton.slopes(*answers, a, inward, seen.eps[pixels])
        open_sky = np.ones((len(pixels), len(self.directions)), np.uint8)
        made = of_pixels(self.sight.material, pixels)
        diffuse, specular = rows(
            n, r, self.sight.views[pixels], self.directions, open_sky, responses.full_diffuse, responses.floor, made
        )  # fmt: skip
        e = np.log((seen.radiance[pixels] + seen.eps[pixels][:, None]) / base)
        spread = state.spread[pixels][:, None]
        weight = seen.weight[pixels]
        weight = weight / (1 + weight * (e / (seen.cauchy * spread)) ** 2) / spread**2
        firm = np.diag([0.0, 0, 0, 0, 0, newton.GLOSS[1] ** -2])
        system = newton.regular(np.einsum("bvi,bv,bvj->bij", own, weight, own, optimize=True) + firm)
        eps = seen.eps[pixels][:, None].astype(np.float32)
        energy = responses.whole_energy(self.sight, pixels).astype(np.float32)
        colour = np.tile(a, energy.shape[1] // 3).astype(np.float32)
        nothing = np.zeros_like(colour)
        told = _Told(
            pixels, *self.ground.seen(pixels, self.directions), diffuse, specular, energy, colour, nothing, eps,
            own.astype(np.float32), weight.astype(np.float32), np.linalg.inv(system),
        )  # fmt: skip
        sent, *_ = self._sent(told, self.ground.rims(height, pixels))
        return replace(told, rest=(base - eps - sent).astype(np.float32))

    def _sent(self, told: _Told, rims: Rims):
        """What the block sends under soft shadows; how far each direction is open, and which pixel stands in it."""
        open_to, source = _opened(
            rims.angle, rims.first, rims.second, rims.share, told.way, told.angle, self.normals,
            self.directions.astype(np.float32), np.float32(self.edge),
        )  # fmt: skip
        bare_diffuse, bare_specular = told.diffuse * open_to, told.specular * open_to
        lit = bare_diffuse @ told.energy, bare_specular @ told.energy
        if self.responses.bounce:
            cell, photographed = self.responses.cell, self.responses.photographed
            _bounced(
                told.diffuse - bare_diffuse, told.specular - bare_specular, source, photographed, cell, *lit
            )
        return told.colour * lit[0] + lit[1], open_to, source

    def at(self, height: Float[np.ndarray, " p"]) -> Here:
        """At some heights."""
        count = len(height)

        def of(told: _Told) -> tuple[float, Float[np.ndarray, " p"]]:
            rims = self.ground.rims(height, told.pixels)
            sent, open_to, source = self._sent(told, rims)
            seen, pixels = self.who.seen, told.pixels
            model = np.maximum(sent + told.rest, 0) + told.eps
            e = np.log((seen.radiance[pixels] + told.eps) / model)
            pulled = np.einsum("bvi,bv,bv->bi", told.own, told.weight, e, optimize=True)
            left = e - np.einsum("bvi,bi->bv", told.own, np.einsum("bij,bj->bi", told.inverse, pulled))
            rise = (-2 * told.weight * left / model).astype(np.float32)  # of the misfit with what is sent
            coloured = rise * told.colour
            slope = told.diffuse * (coloured @ told.energy.T) + told.specular * (rise @ told.energy.T)
            photographed = (
                self.responses.photographed if self.responses.bounce else np.zeros((0, 0), np.float32)
            )
            turned = _sloped(
                slope, told.diffuse, told.specular, coloured, rise, open_to, source, photographed, self.responses.cell,
                np.float32(self.edge), told.way, AZIMUTHS,
            )  # fmt: skip
            return float((told.weight * left**2).sum()), rims.pull(turned, pixels, count)

        total, slope = 0.0, np.zeros(count)
        for misfit, pull in abreast(of, self.told):
            total += misfit
            slope += pull
        torn, pull, hold = self.bonds.torn((height - self.normal_height) / self.pitch)
        return Here(total + torn, slope + pull / self.pitch, hold)

    def stiffness(self, hold: Float[np.ndarray, " e"]) -> sparse.csc_matrix:
        return self.bonds.stiffness(hold / self.pitch**2)


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _opened(horizon, first, second, share, way, angle, normals, directions, edge):
    """How far every direction is open, and which pixel stands in it: -1 if that is none, or looks away."""
    open_to, source = np.empty(angle.shape, np.float32), np.empty(angle.shape, np.int32)
    for b in range(angle.shape[0]):
        for d in range(angle.shape[1]):
            k = way[d]
            clear = (np.float32(horizon[b, k]) - angle[b, d]) / edge
            source[b, d] = -1
            if clear > 9:
                open_to[b, d] = 1
                continue
            open_to[b, d] = np.float32(1) / (np.float32(1) + np.exp(-max(clear, np.float32(-30))))
            q = first[b, k] if share[b, k] > 0.5 else second[b, k]
            if q >= 0:
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
def _sloped(slope, diffuse, specular, coloured, rise, open_to, source, photographed, cell, edge, way, ways):
    """From what the misfit rises by as directions open, without what hides them, to what it does with every radian of horizon."""
    turned = np.zeros((slope.shape[0], ways))
    for b in range(slope.shape[0]):
        for d in range(slope.shape[1]):
            steep = open_to[b, d] * (1 - open_to[b, d]) / edge
            if steep < 1e-3:
                continue
            q, one, two = source[b, d], np.float32(0), np.float32(0)
            if q >= 0:
                for v in range(photographed.shape[1]):
                    one += coloured[b, v] * photographed[q, v]
                    two += rise[b, v] * photographed[q, v]
            thrown = cell * (diffuse[b, d] * one + specular[b, d] * two)
            turned[b, way[d]] += (slope[b, d] - thrown) * steep
    return turned
