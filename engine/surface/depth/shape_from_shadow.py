"""Heights follow the slope of the photographs' misfit, through shadows with soft edges.

Normals integrate to a depth that draws together what hangs in front of each other, and horizons, a dozen to a pixel, move
what stands apart but do not know the shape within a groove. What does is every direction of every pixel: what a height hides
from whom, it takes from that pixel's pictures, in each view as much as came from there. The misfit's derivative by all heights is a few
products of matrices, each pixel's own unknowns eliminated (variable projection: Golub and Pereyra 1973, in Kaufman's form), and
what departs from the normals' own heights costs as it does in `horizon_relaxation`. Heights go downhill by conjugate gradients, pixels are solved
anew under the same soft shadows, and so on: solved under others, such as rays tell, they fit those, and every way leads uphill.

Camera frame; heights are logarithms of z.
"""

# The stubs of scipy misstate what comes back here.
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Float, Int

from engine.parallel import abreast
from engine.progress import Progress
from engine.surface.data.observations import thinned
from engine.surface.depth.bilateral_integration import integrate
from engine.surface.depth.horizon_relaxation import Bonds, Here, Steps, descended, seams
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.object_pixels import Subject, image, subject
from engine.surface.rendering.soft_shadow_transport import Soft, SoftBlock
from engine.surface.rendering.transport import Incident, Sight, blocks
from engine.surface.tiled_solve import Picture, enlarged, smaller
from engine.surface.visibility.depth_mesh import thick
from engine.surface.visibility.horizon_map import Ground

MOST, VIEWS = 12_000, 24
"""Pixels and views, at most, that tell."""
ROUNDS, PASSES = 4, 4
"""Times that pixels are solved anew, and Gauss-Newton evaluations of the pixels."""
TEAR = 5.0
"""Squared spreads for a pixel's width of height that two neighbours stand apart otherwise than their normals tell."""
STEPS = Steps(turns=6, afresh=4, farthest=3.0, shorter=0.4, tries=7)
"""Of the heights in between, in pixel widths."""


def deepened(
    picture: Picture,
    fitted: Int[np.ndarray, " n"],
    drift: Float[np.ndarray, " n"],
    material: Float[np.ndarray, "p 2"] | None,
    state: gauss_newton.State,
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
    begun = gauss_newton.begin(normals, means(state.albedo), means(state.roughness[:, None])[:, 0])
    before = means(np.log(depth[picture.mask])[:, None])[:, 0]
    who = replace(who, material=of_pixels(material, first))
    after = _found(who, begun, before, light.views(views), distance, params, progress)
    change = enlarged(small.mask, image(small.mask, after - before), picture.mask)
    z = depth * np.exp(change) * picture.mask
    return z * (distance / z[picture.mask].mean())


def _found(
    who: Subject,
    state: gauss_newton.State,
    height: Float[np.ndarray, " p"],
    light: Incident,
    distance: float,
    params: SurfaceParams,
    progress: Progress,
) -> Float[np.ndarray, " p"]:
    """The heights of one size."""
    mask, ground = who.mask, Ground(who.camera, who.mask)
    bonds = seams(mask, np.zeros(mask.shape), TEAR)
    steps = replace(STEPS, farthest=STEPS.farthest * who.pitch)
    for turn in range(ROUNDS):
        span = progress.part(turn / ROUNDS, (turn + 1) / ROUNDS)
        sight = who.at(np.exp(height))
        deep = thick(image(mask, sight.points), mask)
        soft = Soft(who.responses(light, params, "cpu"), ground, height, deep, state.normals)
        state = gauss_newton.iterate(
            state, soft, sight, blocks(mask), who.seen, PASSES, span.part(0, 0.3), anew=True
        )
        own = integrate(who.camera, image(mask, state.normals), mask, distance, span.part(0.3, 0.35))
        cost = _Cost(who, state, soft, sight, np.log(own[mask]), bonds)
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
    block: SoftBlock
    diffuse: Float[np.ndarray, "b e"]  # rows, albedo and bare sky taken for granted
    specular: Float[np.ndarray, "b e"]
    colour: Float[np.ndarray, "b v"]
    alone: Float[np.ndarray, "b 1"]  # share of what is photographed that the object sends
    beside: Float[np.ndarray, "b v"]  # the rest of it, and eps
    own: Float[np.ndarray, "b v 7"]  # how the logarithm of what it sends follows its own unknowns
    known: Float[np.ndarray, "b v"]  # weight of a residual, per squared spread
    weight: Float[np.ndarray, "b v"]  # the same, less of those that are far off
    inverse: Float[np.ndarray, "b 7 7"]  # of their system

    def followed(self, pull: Float[np.ndarray, "b v"]) -> Float[np.ndarray, "b v"]:
        """What its own unknowns make of the logarithms of what is sent, when residuals so weighed pull at them."""
        moved = np.einsum("bij,bj->bi", self.inverse, np.einsum("bvi,bv->bi", self.own, pull))
        return np.einsum("bvi,bi->bv", self.own, moved)


class _Cost:
    """What shadows and departures from the normals' own heights cost together, in squared spreads of the residuals.

    Each residual costs what it does in `gauss_newton`, so that what the model does not know weighs here no more than there.
    """

    def __init__(self, who: Subject, state, soft: Soft, sight: Sight, own, bonds: Bonds) -> None:
        self.who, self.state, self.soft, self.sight = who, state, soft, sight
        self.normal_height, self.bonds, self.pitch = own, bonds, who.pitch
        self.told = list(abreast(self._tell, blocks(who.mask)))

    def _tell(self, pixels) -> _Told:
        state, seen, soft = self.state, self.who.seen, self.soft
        n, a, r = state.normals[pixels], state.albedo[pixels], state.roughness[pixels]
        leaning, rough, inward = gauss_newton.variants(n, r)
        block, eps = soft.block(self.sight, pixels), seen.eps[pixels]
        base, own = gauss_newton.slopes(*soft(block, leaning, rough), a, inward, eps)
        own = np.concatenate([own, np.zeros((*base.shape, 1))], 2)
        alone, beside = np.ones((len(pixels), 1)), np.tile(eps[:, None], base.shape[1])
        rim = np.nonzero(seen.row[pixels] >= 0)[0]
        share = state.share[pixels[rim], None]
        other = seen.beside[seen.row[pixels[rim]]]
        alone[rim] -= share
        beside[rim] += share * other
        whole = alone * (base - eps[:, None]) + beside
        own *= (alone * base / whole)[..., None]
        own[rim, :, 6] = (other + eps[rim, None] - base[rim]) / whole[rim]
        e = np.log((seen.radiance[pixels] + eps[:, None]) / whole)
        known = seen.weight[pixels] / state.spread[pixels][:, None] ** 2
        weight = known / (1 + known * (e / seen.cauchy) ** 2)
        firm = np.diag([0.0, 0, 0, 0, 0, gauss_newton.GLOSS[1] ** -2, gauss_newton.SHARE_SPREAD**-2])
        system = gauss_newton.regular(np.einsum("bvi,bv,bvj->bij", own, weight, own, optimize=True) + firm)
        colour = np.tile(a, base.shape[1] // 3)
        bare = soft.bare(block, n[:, None], r[:, None])
        floats = (x.astype(np.float32) for x in (colour, alone, beside, own, known, weight))
        return _Told(pixels, block, *bare, *floats, np.linalg.inv(system))

    def at(self, height: Float[np.ndarray, " p"]) -> Here:
        """At some heights."""
        count, seen, soft = len(height), self.who.seen, self.soft

        def of(told: _Told) -> tuple[float, Float[np.ndarray, " p"]]:
            pixels = told.pixels
            block = soft.under(told.block, soft.ground.rims(height, soft.deep, pixels))
            diffuse, specular = soft.lit(block, told.diffuse, told.specular)
            model = told.alone * np.maximum(told.colour * diffuse + specular, 0) + told.beside
            e = np.log((seen.radiance[pixels] + seen.eps[pixels][:, None]) / model)
            left = e - told.followed(told.weight * e)
            off = told.known * (left / seen.cauchy) ** 2
            pulled = told.known * left / (1 + off)
            pulled -= told.weight * told.followed(pulled)
            rise = (-2 * pulled * told.alone / model).astype(np.float32)  # of the misfit with what is sent
            turned = soft.turned(block, told.diffuse, told.specular, rise * told.colour, rise)
            return float(seen.cauchy**2 * np.log1p(off).sum()), block.rims.pull(turned, pixels, count)

        total, slope = 0.0, np.zeros(count)
        for misfit, pull in abreast(of, self.told):
            total += misfit
            slope += pull
        torn, pull, hold = self.bonds.torn((height - self.normal_height) / self.pitch)
        return Here(total + torn, slope + pull / self.pitch, hold)

    def stiffness(self, hold: Float[np.ndarray, " e"]) -> sparse.csc_matrix:
        """What resists a step."""
        return self.bonds.stiffness(hold / self.pitch**2)
