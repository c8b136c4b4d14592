"""What `gauss_newton` asks of every pixel, on a CUDA device: many blocks at a time, in torch.

Threads of the processor gather what reaches the blocks; rows, products and normal equations of a batch of blocks are some
hundred launches on the device, which else would wait for each block in turn. All pixels of a batch go through all passes, and
all that `gauss_newton` keeps over small steps is told anew beside it: picking out those that do not need it costs more than it brings.
Nothing is added where it falls, so that the same device finds the same bits.
"""

import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from engine.errors import SurfaceError
from engine.parallel import abreast
from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.optimize import gauss_newton
from engine.surface.reflectance.brdf import PAINT
from engine.surface.reflectance.brdf_torch import lobes_reference, rows_reference
from engine.surface.rendering.transport import LightTransport, SurfaceGeometry

ROWS = 2**24
"""Entries of the rows of a batch, at most: 64 MB, of which the reflectance keeps some twenty copies for a moment."""
THROWN = 2**27
"""Entries of the light that comes from hidden directions to the pixels that are summed at once: half a gigabyte."""


@dataclass(frozen=True, slots=True, eq=False)
class _Gathered:
    """What reaches a batch of blocks, padded to one size with each block's first pixel. `p` counts the pixels of all blocks."""

    pixels: Int[np.ndarray, " p"]
    own: Bool[np.ndarray, " p"]  # of the padding false
    geometry: SurfaceGeometry
    mixing: Float[np.ndarray, "b w m"]  # of the probes: to the shared light, and to the ways it differs in
    apart: Float[np.ndarray, "b s r"]  # how far each pixel's does so in each
    lamps: Float[np.ndarray, "p n l"]  # the share of each that each pixel sees
    direction: Int[np.ndarray, "p e"]  # hidden from each; padded with one more than there are
    source: Int[np.ndarray, "p e"]  # what is seen there instead, a row of `_Scene.thrown`
    observations: Observations


def _gather(
    problem: gauss_newton.PixelProblem, transport: LightTransport, blocks: list[Int[np.ndarray, " _"]]
) -> _Gathered:
    side, geometry = max(map(len, blocks)), problem.geometry
    own = np.arange(side) < np.array([len(part) for part in blocks])[:, None]
    pixels = np.array([np.append(part, np.full(side - len(part), part[0])) for part in blocks]).ravel()
    at, nothing = geometry.part(pixels), len(transport.photographed) + len(transport.walls)
    hidden, entries = at.visibility, np.zeros((len(pixels), 0), bool)
    if hidden is not None:
        lengths = np.diff(hidden.start)
        entries = np.arange(lengths.max(initial=0)) < lengths[:, None]
    direction = np.full(entries.shape, len(transport.incident.directions), np.int32)
    source = np.full(entries.shape, nothing, np.int32)
    if hidden is not None:
        direction[entries] = hidden.direction
        if transport.bounce:
            source[entries] = np.where(hidden.occluder < 0, nothing, hidden.occluder)
    shares = [transport.incident.shares(geometry.points[part]) for part in blocks]
    most = max(len(share.modes) for share in shares)
    mixing = np.zeros((len(blocks), 1 + most, shares[0].mean.shape[-1]), np.float32)
    apart = np.zeros((len(blocks), side, most), np.float32)
    for i, share in enumerate(shares):
        count = len(share.modes)
        mixing[i, 0], mixing[i, 1 : 1 + count] = share.mean, share.modes
        apart[i, : len(share.coefficients), :count] = share.coefficients
    lamps = transport.incident.area_lights.visible(at.points, hidden)
    seen = problem.observations.part(pixels)
    return _Gathered(pixels, own.ravel(), at, mixing, apart, lamps, direction, source, seen)


class _Scene:
    """Light and what throws it, on the device; all batches share it."""

    def __init__(self, transport: LightTransport):
        incident, near = transport.incident, transport.incident.area_lights
        self.device, self.full_diffuse = transport.device, transport.full_diffuse
        self.floor, self.cell = transport.floor, float(transport.cell)
        self.directions = self.there(incident.directions)
        # One direction more, from which nothing comes.
        self.energy = torch.nn.functional.pad(self.there(incident.energy), (0, 0, 0, 1))
        nothing = np.zeros((1, transport.photographed.shape[1]), np.float32)
        walls = transport.walls.reshape(-1, nothing.shape[1])
        self.thrown = self.there(np.concatenate([transport.photographed, walls, nothing]))
        self.centres = self.there(near.centres, torch.float64)
        self.radii, self.radiance = self.there(near.radii), self.there(near.radiance)

    def there(self, array: np.ndarray, kind: torch.dtype = torch.float32) -> Tensor:
        """A copy on the device."""
        return torch.as_tensor(np.ascontiguousarray(array)).to(self.device, kind)


class _Batch:
    """A batch of blocks on the device, and what its pixels answer."""

    def __init__(self, scene: _Scene, gathered: _Gathered):
        there, at, seen = scene.there, gathered.geometry, gathered.observations
        self.scene, self.pixels, self.own = scene, gathered.pixels, gathered.own
        self.points, self.views = there(at.points, torch.float64), there(at.views, torch.float64)
        self.lamps, self.cauchy = there(gathered.lamps), seen.cauchy
        self.material = there(np.tile(PAINT, (len(at.points), 1)) if at.material is None else at.material)
        b, r, m = gathered.mixing.shape
        mixed = there(gathered.mixing).reshape(b * r, m) @ scene.energy.reshape(m, -1)
        self.light = mixed.reshape(b, r, *scene.energy.shape[1:])
        self.apart = there(gathered.apart)
        self.direction = there(gathered.direction, torch.int64)
        self.source = there(gathered.source, torch.int64)
        self.radiance, self.weight, self.eps = map(there, (seen.radiance, seen.weight, seen.eps[:, None]))
        self.beside = torch.full_like(self.radiance, math.nan)
        self.beside[there(seen.row, torch.int64) >= 0] = there(seen.beside)
        self.mixed = self.beside.isfinite().any(1)[:, None]

    def answers(
        self, normals: Float[Tensor, "p k 3"], roughness: Float[Tensor, "p k"]
    ) -> tuple[Float[Tensor, "2 p k v"], Float[Tensor, "2 p v"]]:
        """`LightTransport` of every pixel's variants, diffuse and specular; and the first to the light that its block shares."""
        scene, (p, k), d = self.scene, roughness.shape, len(self.scene.directions)
        blocks, v = len(self.light), self.light.shape[-1]
        leaning, rough = normals.float(), roughness.float()
        rows = rows_reference(
            leaning.reshape(-1, 3), rough.reshape(-1), self.views.float().repeat_interleave(k, 0),
            scene.directions, scene.full_diffuse, scene.floor, self.material.repeat_interleave(k, 0),
        )  # fmt: skip
        table = rough.new_zeros(blocks, p // blocks, 2, k, d + 1)
        for half, row in enumerate(rows):
            table[:, :, half, :, :d] = row.reshape(blocks, p // blocks, k, d)
        by_pixel = table.reshape(p, 2 * k, d + 1)
        thrown = self._bounced(by_pixel)
        out = (table.reshape(blocks, -1, d + 1) @ self.light[:, 0]).reshape(p, 2, k, v)
        if thrown is not None:
            out += thrown.reshape(p, 2, k, v)
        out = out.transpose(0, 1).contiguous()
        if len(scene.radii):
            out += self._shone(leaning, rough)
        shared = out[:, :, 0].clone()
        if self.apart.shape[2]:
            first = table[:, :, :, 0].reshape(blocks, 1, -1, d + 1)
            ways = (first @ self.light[:, 1:]).reshape(blocks, -1, p // blocks, 2, v)
            out += torch.einsum("brsxv,bsr->xbsv", ways, self.apart).reshape(2, p, 1, v)
        return out, shared

    def _bounced(self, table: Float[Tensor, "p x d"]) -> Float[Tensor, "p x v"] | None:
        """What stands before hidden directions throws, whose rows in the table become 0."""
        if not self.direction.shape[1]:
            return None
        at = self.direction[:, None].expand(-1, table.shape[1], -1)
        share = table.gather(2, at) * self.scene.cell
        table.scatter_(2, at, 0.0)
        few = max(1, THROWN // (self.direction.shape[1] * self.scene.thrown.shape[1]))
        parts = (slice(begin, begin + few) for begin in range(0, len(table), few))
        return torch.cat([share[part] @ self.scene.thrown[self.source[part]] for part in parts])

    def _shone(
        self, normals: Float[Tensor, "p k 3"], roughness: Float[Tensor, "p k"]
    ) -> Float[Tensor, "2 p k v"]:
        """`area_lights.Near.add`: what all lamps send."""
        scene, views = self.scene, self.views.float()
        way = scene.centres - self.points[:, None, None]
        far = way.norm(dim=3)
        towards, sine = (way / far[..., None]).float(), (scene.radii / far.float()).clamp(max=0.99)
        solid = 2 * math.pi * sine**2 / (1 + (1 - sine**2).sqrt()) * self.lamps
        nl = torch.einsum("pnlx,pkx->pknl", towards, normals)
        lv = torch.einsum("pnlx,px->pnl", towards, views)[:, None]
        nv = torch.einsum("pkx,px->pk", normals, views).clamp(min=1e-3)[..., None, None]
        sine = sine[:, None]
        t = (nl / sine).clamp(-1, 1)
        part = t * (math.pi / 2 + t.asin()) + (1 - t**2).sqrt() * (2 + t**2) / 3
        nl = torch.where(nl < sine, (sine * part / math.pi).clamp(min=0), nl)
        rough = roughness[..., None, None]
        level, metal = (x[:, None, None, None] for x in self.material.T)
        unit = lobes_reference(nl, nv, lv, rough, rough**4 + sine**2 / 8, scene.full_diffuse, level, metal)
        shape = *roughness.shape, -1
        return torch.stack([
            torch.einsum("pknl,nlc->pknc", x * solid[:, None], scene.radiance).reshape(shape) for x in unit
        ])  # fmt: skip

    def spread(
        self, answers: Float[Tensor, "2 p k v"], at: "_Standing", config: gauss_newton.GaussNewtonConfig
    ) -> Float[Tensor, " p"]:
        """`gauss_newton._residual_scale`, by the first of the answers."""
        model = at.albedo.float().repeat(1, answers.shape[3] // 3) * answers[0, :, 0] + answers[1, :, 0]
        model = torch.where(
            self.mixed, model + at.background_fraction.float()[:, None] * (self.beside - model), model
        )
        logs = ((self.radiance + self.eps) / (model.clamp(min=0) + self.eps)).log()
        known = self.weight > 0
        residual = torch.where(known, (logs * self.weight.sqrt()).abs(), math.inf).sort(dim=1)[0]
        count = known.sum(1)
        middle = torch.stack([(count - 1) // 2, count // 2], 1).clamp(min=0)
        spread = gauss_newton.OF_MEDIAN * residual.gather(1, middle).double().mean(1)
        return torch.where(count > 0, spread, 1.0).clamp(min=config.least_residual_scale)

    def equations(
        self, answers: Float[Tensor, "2 p k v"], at: "_Standing", spread: Float[Tensor, " p"],
        columns: slice = slice(None), prior: float = 1.0,
    ) -> "_Equations":  # fmt: skip
        """`gauss_newton._normal_equations` of some of the columns."""
        (diffuse, specular), share = answers[..., columns], at.background_fraction.float()[:, None]
        radiance, weight, beside = (x[:, columns] for x in (self.radiance, self.weight, self.beside))
        colour = at.albedo.float().repeat(1, diffuse.shape[2] // 3)
        width = (self.cauchy * spread) ** 2
        model = colour * diffuse[:, 0] + specular[:, 0]
        other = torch.where(self.mixed, beside - model, 0.0)
        over = 1 / ((model + share * other).clamp(min=0) + self.eps)
        e = ((radiance + self.eps) * over).log()
        ratio = weight * e**2 / width.float()[:, None]
        robust = weight / (1 + ratio)
        own = over * (1 - share)
        moved = colour[:, None] * (diffuse[:, 1:] - diffuse[:, :1]) + specular[:, 1:] - specular[:, :1]
        steps = torch.stack([torch.full_like(at.inward, gauss_newton.STEP)] * 2 + [at.inward], 1).float()
        first, second, rougher = (moved * own[:, None] / steps[:, :, None]).unbind(1)
        channels = torch.eye(3, device=own.device).repeat(1, own.shape[1] // 3)
        tints = (colour * diffuse[:, 0] * own)[:, None] * channels
        slopes = torch.cat(
            [torch.stack([first, second], 1), tints, torch.stack([rougher, other * over], 1)], 1
        )
        weighted = slopes * robust[:, None]
        system = (weighted @ slopes.transpose(1, 2)).double()
        slope = (weighted @ e[:, :, None])[..., 0].double()
        misfit = width * ratio.log1p().sum(1, dtype=torch.float64)
        expected = (
            (5, at.roughness - at.roughness_prior[:, 0], at.roughness_prior[:, 1]),
            (6, at.background_fraction, gauss_newton.SHARE_SPREAD),
        )
        for unknown, off, wide in expected:
            tight = prior * (spread / wide) ** 2
            misfit = misfit + tight * off**2
            slope[:, unknown] -= tight * off
            system[:, unknown, unknown] += tight
        return _Equations(misfit, system, slope)


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """`gauss_newton.NormalEquations` on the device; double precision."""

    cost: Float[Tensor, " p"]
    hessian: Float[Tensor, "p 7 7"]
    gradient: Float[Tensor, "p 7"]


@dataclass(frozen=True, slots=True, eq=False)
class _Standing:
    """Where the pixels of a batch stand, or try to; double precision, on the device."""

    normals: Float[Tensor, "p 3"]
    albedo: Float[Tensor, "p 3"]
    roughness: Float[Tensor, " p"]
    background_fraction: Float[Tensor, " p"]
    roughness_prior: Float[Tensor, "p 2"]

    @property
    def inward(self) -> Float[Tensor, " p"]:
        """The signed step of the rougher variant, as `gauss_newton.perturbed` has it."""
        step = gauss_newton.STEP
        return torch.where(self.roughness + step > gauss_newton.ROUGHNESS[1], -step, step).to(self.roughness)

    def variants(self) -> tuple[Float[Tensor, "p 4 3"], Float[Tensor, "p 4"]]:
        """`gauss_newton.perturbed`."""
        n, r = self.normals, self.roughness
        first, second = _tangents(n)
        leaning = torch.stack([n, n + gauss_newton.STEP * first, n + gauss_newton.STEP * second, n], 1)
        leaning = leaning / leaning.norm(dim=2, keepdim=True)
        return leaning, torch.stack([r, r, r, r + self.inward], 1)

    def moved(
        self, move: Float[Tensor, "p 7"], views: Float[Tensor, "p 3"], grazing_cosine: float
    ) -> "_Standing":
        """Where a step leads to, within bounds and facing the camera."""
        first, second = _tangents(self.normals)
        n = self.normals + first * move[:, :1] + second * move[:, 1:2]
        n = n / n.norm(dim=1, keepdim=True)
        n = n + views * (grazing_cosine - (n * views).sum(1, keepdim=True)).clamp(min=0)
        return replace(
            self,
            normals=n / n.norm(dim=1, keepdim=True),
            albedo=(self.albedo * move[:, 2:5].exp()).clamp(*gauss_newton.ALBEDO),
            roughness=(self.roughness + move[:, 5]).clamp(*gauss_newton.ROUGHNESS),
            background_fraction=(self.background_fraction + move[:, 6]).clamp(*gauss_newton.SHARE),
        )

    def far(self, before: "_Standing", step: float) -> Bool[Tensor, " p"]:
        """Which pixels have moved so far that what `gauss_newton` keeps over small steps holds no more."""
        far = (self.normals - before.normals).norm(dim=1) > step
        return far | ((self.roughness - before.roughness).abs() > step) | (self.inward != before.inward)

    def taking(self, better: Bool[Tensor, " p"], other: "_Standing") -> "_Standing":
        """The other's where it is better."""
        return _Standing(*(
            torch.where(better.reshape(-1, *[1] * (x.ndim - 1)), y, x)
            for x, y in ((getattr(self, name), getattr(other, name)) for name in _Standing.__slots__)
        ))  # fmt: skip


def _tangents(normals: Float[Tensor, "p 3"]) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"]]:
    """`geometry.tangents`."""
    x, y, z = normals.T
    sign = torch.where(z >= 0, 1.0, -1.0).to(z)
    a = -1 / (sign + z)
    b = x * y * a
    return torch.stack([1 + sign * x * x * a, sign * b, -sign * x], 1), torch.stack(
        [b, sign + y * y * a, -y], 1
    )


@contextmanager
def _within_memory() -> Iterator[None]:
    """Say in our words that the device has too little."""
    try:
        yield
    except RuntimeError as error:
        # A device that is full from the start refuses even its context, and the library of products its handle.
        told = any(sign in str(error) for sign in ("out of memory", "ALLOC_FAILED"))
        if not isinstance(error, torch.OutOfMemoryError) and not told:
            raise
        raise SurfaceError(
            "the GPU has too little memory free to solve pixels; close what else uses it, or use --device cpu"
        ) from error


def _batches(
    state: gauss_newton.PixelEstimate,
    problem: gauss_newton.PixelProblem,
    transport: LightTransport,
    progress: Progress,
    doing: str,
) -> Iterator[tuple[_Batch, _Standing]]:
    """Batch by batch, and where its pixels stand."""
    if not problem.blocks:
        return
    transport.check(problem.geometry)
    # Blocks of a size side by side: all of a batch are padded to its largest.
    blocks = sorted(problem.blocks, key=len)
    lamps = transport.incident.area_lights.centres
    wide = max(len(transport.incident.directions), lamps.shape[0] * lamps.shape[1])
    few = max(1, ROWS // (2 * 4 * len(blocks[-1]) * wide))
    groups = [blocks[begin : begin + few] for begin in range(0, len(blocks), few)]
    scene = _Scene(transport)
    for i, gathered in enumerate(abreast(lambda group: _gather(problem, transport, group), groups)):
        progress.step(i / len(groups), doing)
        batch, pixels = _Batch(scene, gathered), gathered.pixels
        values = (getattr(state, name)[pixels] for name in _Standing.__slots__)
        yield batch, _Standing(*(scene.there(x, torch.float64) for x in values))


@_within_memory()
def minimize(
    state: gauss_newton.PixelEstimate, problem: gauss_newton.PixelProblem, transport: LightTransport, steps: int, progress: Progress,
    reset_scale: bool, config: gauss_newton.GaussNewtonConfig,
) -> gauss_newton.PixelEstimate:  # fmt: skip
    """`gauss_newton.minimize`.

    Raises:
        SurfaceError: the device has too little memory.
    """
    kept = state.copy()
    names = ("residual_scale", "lm_lambda", "cost", "hessian", "gradient")
    for batch, stand in _batches(state, problem, transport, progress, "solving pixels"):
        there, pixels = batch.scene.there, batch.pixels
        rest = there(np.array(config.step_tolerance), torch.float64)
        spread, damping, misfit, system, slope = (
            there(getattr(state, name)[pixels], torch.float64) for name in names
        )
        # The row of the share, which the systems that others see have eliminated; and its slope.
        tie, tie_slope = system.new_zeros(len(pixels), 7), system.new_zeros(len(pixels))
        best, tried, active = stand, stand, there(batch.own, torch.bool)
        answers, shared = batch.answers(*tried.variants())
        for turn in range(steps):
            if reset_scale and turn == 0:
                spread = batch.spread(answers, tried, config)
                misfit = torch.full_like(spread, math.inf)
            now = batch.equations(answers, tried, spread)
            whole, better = now.hessian, active & (now.cost <= misfit)
            best, misfit = best.taking(better, tried), torch.where(better, now.cost, misfit)
            ties = whole[:, :6, 6] / whole[:, 6:, 6]
            system[better] = (whole[:, :6, :6] - ties[:, :, None] * whole[:, 6:, :6])[better]
            slope[better] = (now.gradient[:, :6] - ties * now.gradient[:, 6:])[better]
            tie[better], tie_slope[better] = whole[better, 6], now.gradient[better, 6]
            eased = (damping * config.lambda_down).clamp(min=config.lambda_bounds[0])
            stiffened = (damping * config.lambda_up).clamp(max=config.lambda_bounds[1])
            damping = torch.where(better, eased, torch.where(active, stiffened, damping))
            if turn + 1 == steps:
                break
            move = _damped_step(system, slope, damping, torch.column_stack([tie, tie_slope]), config)
            active &= (move.abs() > rest).any(1)
            if not active.any():
                break
            before, tried = tried, best.moved(move, batch.views, config.grazing_cosine)
            far = tried.far(before, config.jacobian_reuse_step)
            answers, shared = _followed(
                answers, shared, *batch.answers(*tried.variants()), far, config.max_light_ratio
            )
        found = dict(zip(names, (spread, damping, misfit, system, slope), strict=True))
        found |= {
            name: getattr(best, name) for name in ("normals", "albedo", "roughness", "background_fraction")
        }
        for name, values in found.items():
            getattr(kept, name)[pixels[batch.own]] = values.cpu().numpy()[batch.own]
    return kept


def _followed(
    answers: Float[Tensor, "2 p k v"], shared: Float[Tensor, "2 p v"], now: Float[Tensor, "2 p k v"],
    shared_now: Float[Tensor, "2 p v"], far: Bool[Tensor, " p"], max_light_ratio: float,
) -> tuple[Float[Tensor, "2 p k v"], Float[Tensor, "2 p v"]]:  # fmt: skip
    """`gauss_newton._update_evaluations`: of pixels that went far what they answer now, of others as far as their first variant tells."""
    times = torch.where(shared > 0, answers[:, :, 0] / shared, 1.0).clamp(max=max_light_ratio)
    near = answers + ((shared_now - shared) * times)[:, :, None]
    return torch.where(far[:, None, None], now, near), shared_now


@_within_memory()
def hessians_by_view_group(
    state: gauss_newton.PixelEstimate, problem: gauss_newton.PixelProblem, transport: LightTransport, ends: Int[np.ndarray, " e"],
    found: gauss_newton.NormalEquations, progress: Progress, doing: str,
) -> None:  # fmt: skip
    """`gauss_newton.hessians_by_view_group` into what is `found`, and the spreads into the state; stretches end at these columns.

    Raises:
        SurfaceError: as `minimize`.
    """
    share = 1 / (len(ends) - 1)
    for batch, stand in _batches(state, problem, transport, progress, doing):
        answers, _ = batch.answers(*stand.variants())
        wide, own = batch.spread(answers, stand, gauss_newton.CONFIG), batch.pixels[batch.own]
        state.residual_scale[own] = wide.cpu().numpy()[batch.own]
        for k, (begin, end) in enumerate(itertools.pairwise(ends)):
            told = batch.equations(answers, stand, wide, slice(begin, end), share)
            for name in gauss_newton.NormalEquations.__slots__:
                getattr(found, name)[own, k] = getattr(told, name).cpu().numpy()[batch.own]


def _damped_step(
    system: Float[Tensor, "p 6 6"], slope: Float[Tensor, "p 6"], damping: Float[Tensor, " p"],
    tie: Float[Tensor, "p 8"], config: gauss_newton.GaussNewtonConfig,
) -> Float[Tensor, "p 7"]:  # fmt: skip
    """`gauss_newton._damped_step`; of the share its row and its slope."""
    longest = torch.tensor(config.max_step, dtype=slope.dtype, device=slope.device)
    stiffer = system.diagonal(dim1=1, dim2=2) * damping[:, None] + config.ridge
    move = torch.linalg.solve_ex(system + stiffer.diag_embed(), slope[..., None])[0][..., 0]
    move = move.clamp(-longest[:6], longest[:6])
    stiff = torch.where(tie[:, 6] > 0, tie[:, 6], math.inf)
    shift = (tie[:, 7] - (tie[:, :6] * move).sum(1)) / stiff
    return torch.cat([move, shift[:, None]], 1).clamp(-longest, longest)
