"""Normals become depth: components within which the surface is continuous are integrated exactly, then joined.

Source: Milano et al., ICCV 2025 (arXiv 2507.06075) and WACV 2026 (arXiv 2510.11508); the sigmoid weights of edges
between components are those of Cao, Santo, Shi, Okura, Matsushita, "Bilateral Normal Integration", ECCV 2022. Departs from them
in which components merge first: those whose border agrees on one offset, instead of those with the one best edge.

Two neighbours each carry a plane, and both planes cut the ray half-way between them at one depth:
log z_a - log z_b = log w, w = (n_b.t_b)(n_a.t_m) / ((n_a.t_a)(n_b.t_m)), t = (x, y, 1) the ray on the ideal image plane, t_m the mean
of t_a and t_b. Camera frame; depth is along z, up to one factor for each connected part of the mask, fixed by the caller.
How far a part stands behind another that it does not touch, normals do not tell: the depth draws such parts together, and
`part` tells which pixels hang together.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from jaxtyping import Bool, Float, Int, Int16, Shaped
from scipy.sparse.csgraph import connected_components
from scipy.special import expit

from engine.errors import SurfaceError
from engine.geometry import angle_between, unproject
from engine.progress import Progress
from engine.surface.data.observations import connected_regions, shifted_neighbours
from engine.surface.depth.graph_laplacian import laplacian, solve_system
from engine.types import Camera


@dataclass(frozen=True, slots=True)
class IntegrationConfig:
    """Lengths are widths of a pixel on the surface."""

    smooth_deg: float = 3.5  # neighbours whose normals differ by more need not be one component
    tear_px: float = 2.0  # inside one: an edge that is not smooth and that the depth misses by more is torn
    rounds: int = 5  # of reweighting between two merges; the first weighs edges alike,
    least_facing: float = 0.001  # but by half one of whose normals has so little of -n.t, less beyond
    sharpness: float = 2.0  # of the one-sided weights: larger tears more readily
    inlier_px: float = 0.04  # an edge that the depth misses by so much counts .98,
    outlier_px: float = 3.8  # and by so much .02
    agreement_px: float = 0.05  # edges of a border agree on its offset that lie so close to it
    continuous_px: float = 0.1  # a border is a jump unless edges that lie so close
    continuous_share: float = 0.5  # are such a share of it
    least_share: float = 0.01  # of the pixels: smaller parts are not told


CONFIG = IntegrationConfig()


@dataclass(frozen=True, slots=True, eq=False)
class IntegratedDepth:
    """What normals tell of depth."""

    depth: Float[np.ndarray, "h w"]  # along z, scene units; 0 off the mask
    part: Int16[np.ndarray, "h w"]  # that no jump divides, 1 the largest; 0: too small, or off the mask

    @property
    def shares(self) -> tuple[float, ...]:
        """Of the pixels, part by part."""
        return tuple(map(float, np.bincount(self.part[self.part > 0])[1:] / np.count_nonzero(self.depth)))


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """Every two of the mask's pixels that touch, at a side or a corner."""

    a: Int[np.ndarray, " e"]
    b: Int[np.ndarray, " e"]
    before: Int[np.ndarray, " e"]  # the pixel on the other side of `a`; -1: none
    beyond: Int[np.ndarray, " e"]  # on the other side of `b`
    ratio: Float[np.ndarray, " e"]  # log w: by how much log z of `a` is more than of `b`
    facing_a: Float[np.ndarray, " e"]  # (f n.t)^2 of `a`: little where the surface grazes the ray
    facing_b: Float[np.ndarray, " e"]
    turn: Float[np.ndarray, " e"]  # angle between the two normals, radians
    focal: float  # pixels: times a difference of log z, widths of a pixel

    def some(self, which: Bool[np.ndarray, " e"]) -> "_Edges":
        """A part of them."""
        return _Edges(
            self.a[which], self.b[which], self.before[which], self.beyond[which], self.ratio[which],
            self.facing_a[which], self.facing_b[which], self.turn[which], self.focal,
        )  # fmt: skip

    def missed(self, log_depth: Float[np.ndarray, " p"]) -> Float[np.ndarray, " e"]:
        """By how much log z of `a` should be more than it is."""
        return self.ratio - (log_depth[self.a] - log_depth[self.b])


@dataclass(frozen=True, slots=True, eq=False)
class _Borders:
    """Every two components that touch."""

    one: Int[np.ndarray, " k"]
    other: Int[np.ndarray, " k"]
    continuous: Float[np.ndarray, " k"]  # share of the border's edges that nearly agree with the depth
    evidence: Float[np.ndarray, " k"]  # for joining the two: the share of those that agree times their number


def integrate_normals(
    camera: Camera,
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    mean_depth: float,
    progress: Progress,
) -> Float[np.ndarray, "h w"]:
    """Depth z (scene units, zero outside `mask`) whose mean over each connected part of the mask is `mean_depth`.

    Across a jump the two sides are drawn together.

    Raises:
        SurfaceError: the mask is empty, or multigrid does not converge.
    """
    # Where jumps must wait, DiLiGenT's harvest comes out at 1.6 instead of 1.0 mm.
    return integrate_parts(camera, normals, mask, mean_depth, progress, continuous_share=0.0).depth


def integrate_parts(
    camera: Camera,
    normals: Float[np.ndarray, "h w 3"],
    mask: Bool[np.ndarray, "h w"],
    mean_depth: float,
    progress: Progress,
    continuous_share: float = CONFIG.continuous_share,
) -> IntegratedDepth:
    """The same, and the parts that nothing but jumps separates; these are joined last, so that no part has a jump inside.

    Raises:
        SurfaceError: the mask is empty, or multigrid does not converge.
    """
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    doing = "integrating normals to depth"
    progress.step(0, doing)
    size = int(mask.sum())
    edges = _edges(camera, normals, mask)
    log_depth, component = _continuous(edges, size)
    edges = edges.some(component[edges.a] != component[edges.b])
    count = first_count = int(component.max()) + 1
    parts = None
    while len(edges.a):
        progress.step(1 - 0.5 * np.log(count) / np.log(first_count), doing)
        log_depth = _aligned(edges, log_depth, component, count)
        borders = _borders(edges, log_depth, component, count)
        open_ = borders.continuous >= (continuous_share if parts is None else 0)
        if not open_.any():
            parts, open_ = component, np.ones_like(open_)
        best = np.zeros(count)
        for side in (borders.one, borders.other):
            np.maximum.at(best, side[open_], borders.evidence[open_])
        evidence = borders.evidence
        chosen = open_ & ((evidence == best[borders.one]) | (evidence == best[borders.other]))
        count, merged = _joined(borders.one[chosen], borders.other[chosen], count)
        component = merged[component]
        edges = edges.some(component[edges.a] != component[edges.b])
    parts = _numbered(component if parts is None else parts)
    return IntegratedDepth(_scaled(mask, log_depth, mean_depth), _image(mask, parts, 0))


def _numbered(component: Int[np.ndarray, " p"]) -> Int16[np.ndarray, " p"]:
    """Components by size, the largest 1; 0 where one is too small."""
    size = np.bincount(component)
    rank = np.argsort(np.argsort(-size, kind="stable"))
    return np.where(size >= CONFIG.least_share * len(component), rank + 1, 0).astype(np.int16)[component]


def _continuous(edges: _Edges, size: int) -> tuple[Float[np.ndarray, " p"], Int[np.ndarray, " p"]]:
    """Depth within components, and every pixel's component.

    Around a tear that closes somewhere both sides are one component. So the smooth edges have the first word; of those across
    which normals turn, only what then nearly agrees is taken in: it makes a curved surface exact, and a tear is left open.
    """
    kept = edges.turn <= np.radians(CONFIG.smooth_deg)
    _, component = _joined(edges.a[kept], edges.b[kept], size)
    inside = component[edges.a] == component[edges.b]
    log_depth = np.zeros(size)
    for _ in range(2):
        within = edges.some(kept)
        weight = 0.5 * (within.facing_a + within.facing_b)
        log_depth = _least_squares(within.a, within.b, weight, within.ratio, size)
        agrees = edges.focal * np.abs(edges.missed(log_depth)) <= CONFIG.tear_px
        kept = kept | (inside & agrees)
    return log_depth, component


def _scaled(
    mask: Bool[np.ndarray, "h w"], log_depth: Float[np.ndarray, " p"], mean_depth: float
) -> Float[np.ndarray, "h w"]:
    """Depth whose mean over each connected part of the mask is `mean_depth`."""
    island, _ = connected_regions(mask, corners=True)
    size = np.bincount(island)
    z = np.exp(log_depth - (np.bincount(island, log_depth) / size)[island])
    return _image(mask, z * (mean_depth * size / np.bincount(island, z))[island], 0.0)


def _image(
    mask: Bool[np.ndarray, "h w"], values: Shaped[np.ndarray, " p"], elsewhere
) -> Shaped[np.ndarray, "h w"]:
    picture = np.full(mask.shape, elsewhere, values.dtype)
    picture[mask] = values
    return picture


def _edges(camera: Camera, normals: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> _Edges:
    focal = float(np.sqrt(camera.fx * camera.fy))
    v, u = np.nonzero(mask)
    xy = unproject(camera, np.stack([u + 0.5, v + 0.5], -1))
    ray = np.concatenate([xy, np.ones((len(xy), 1))], 1)
    unit = normals[mask].astype(float)
    # A normal may lean away until its plane passes through the neighbour's ray, no farther: beyond, both are never at one depth.
    excess = np.maximum((unit * ray).sum(1) + 1 / focal, 0)
    normal = unit - (excess / (ray**2).sum(1))[:, None] * ray
    steps = np.array([(0, 1), (1, 0), (1, 1), (1, -1)])
    ahead, behind = shifted_neighbours(mask, steps), shifted_neighbours(mask, -steps)
    a, way = np.nonzero(ahead >= 0)
    b = ahead[a, way]
    middle = (ray[a] + ray[b]) / 2
    own = (normal * ray).sum(1)
    across_a, across_b = ((normal[i] * middle).sum(1) for i in (a, b))
    ratio = np.log(own[b] * across_a / (own[a] * across_b))
    facing = (focal * own) ** 2
    turn = angle_between(unit[a], unit[b])
    return _Edges(a, b, behind[a, way], ahead[b, way], ratio, facing[a], facing[b], turn, focal)


def _joined(
    one: Int[np.ndarray, " e"], other: Int[np.ndarray, " e"], count: int
) -> tuple[int, Int[np.ndarray, " p"]]:
    """How many components the graph of these edges has, and which one each of the `count` nodes is in."""
    graph = sparse.coo_matrix((np.ones(len(one), bool), (one, other)), (count, count))
    number, label = connected_components(graph, directed=False)
    return number, label.astype(int)


def _least_squares(
    one: Int[np.ndarray, " e"],
    other: Int[np.ndarray, " e"],
    weight: Float[np.ndarray, " e"],
    difference: Float[np.ndarray, " e"],
    count: int,
) -> Float[np.ndarray, " p"]:
    """x with x[one] - x[other] nearest to the `difference`; 0 at the first node of each component."""
    if not len(one):
        return np.zeros(count)
    _, label = _joined(one, other, count)
    pinned = np.zeros(count)
    pinned[np.unique(label, return_index=True)[1]] = weight.mean()
    pull = weight * difference
    right = np.bincount(one, pull, count) - np.bincount(other, pull, count)
    return solve_system(laplacian(one, other, weight, count, pinned), right)


def _aligned(
    edges: _Edges,
    log_depth: Float[np.ndarray, " p"],
    component: Int[np.ndarray, " p"],
    count: int,
) -> Float[np.ndarray, " p"]:
    """The components moved, each as a whole, to where the edges between them agree best."""
    one, other = component[edges.a], component[edges.b]
    facing = np.minimum(edges.facing_a, edges.facing_b)
    first = facing / (facing + (CONFIG.least_facing * edges.focal) ** 2)
    for turn in range(CONFIG.rounds):
        left = edges.missed(log_depth)
        weight = _weights(edges, log_depth, left) if turn else first
        log_depth = log_depth + _least_squares(one, other, weight, left, count)[component]
    return log_depth


def _weights(
    edges: _Edges,
    log_depth: Float[np.ndarray, " p"],
    left: Float[np.ndarray, " e"],
) -> Float[np.ndarray, " e"]:
    """Little for an edge on whose other side the depth changes less, and for one that is missed by far."""
    apart = (log_depth[edges.a] - log_depth[edges.b]) ** 2

    def one_sided(pixel, opposite, facing):
        # Off the mask nothing changes.
        beside = np.where(opposite >= 0, (log_depth[opposite] - log_depth[pixel]) ** 2, 0)
        return facing * expit(CONFIG.sharpness * facing * (beside - apart))

    middle = (CONFIG.inlier_px + CONFIG.outlier_px) / 2
    slope = np.log(0.98 / 0.02) / (CONFIG.outlier_px - middle)
    near = expit(slope * (middle - edges.focal * np.abs(left)))
    weight = one_sided(edges.a, edges.before, edges.facing_a) + one_sided(
        edges.b, edges.beyond, edges.facing_b
    )
    # So much is left that a component with bad edges alone still has a place.
    return np.maximum(weight * near, 1e-9 * (edges.facing_a + edges.facing_b))


def _borders(
    edges: _Edges,
    log_depth: Float[np.ndarray, " p"],
    component: Int[np.ndarray, " p"],
    count: int,
) -> _Borders:
    one, other = np.sort([component[edges.a], component[edges.b]], axis=0)
    pair, border = np.unique(one * count + other, return_inverse=True)
    left, length = edges.focal * edges.missed(log_depth), np.bincount(border)
    agreeing, continuous = (
        np.bincount(border, np.exp(-0.5 * (left / within) ** 2))
        for within in (CONFIG.agreement_px, CONFIG.continuous_px)
    )
    evidence = np.maximum(agreeing / length * agreeing, 1e-300)
    return _Borders(pair // count, pair % count, continuous / length, evidence)
