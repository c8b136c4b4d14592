"""Adam on the losses of the paper's inverse renderer, a batch of views at a time.

Source: the paper, Eq. (13) and "Implementation details" of Sec. 4; Adam as torch has it, with its defaults. Camera frame.
"""

import time
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from engine.light.gaussians.rasterize import ThreadPool
from engine.progress import Progress
from engine.reference import losses
from engine.reference.monte_carlo.rendering import Look, Scene, render
from engine.reference.monte_carlo.shadows import Shadows
from engine.reference.params import ReferenceParams

AT_ONCE = {"cpu": 2**17, "cuda": 2**21}
"""Samples held at the same time."""


@dataclass(frozen=True, slots=True, eq=False)
class Unknowns:
    """What Adam steps, of the `p` pixels solved."""

    normals: Float[Tensor, "p 3"]
    albedo: Float[Tensor, "p 3"]  # logit
    roughness: Float[Tensor, " p"]  # logit
    depth: Float[Tensor, " p"]  # z / distance

    def look(self) -> Look:
        """The surface they stand for."""
        unit = torch.nn.functional.normalize(self.normals, dim=1)
        return Look(unit, self.albedo.sigmoid(), self.roughness.sigmoid(), self.depth)


@dataclass(frozen=True, slots=True, eq=False)
class Told:
    """What one epoch came to: means over its steps; `misfit` is each pixel's term of Eq. (14)."""

    colour: float
    normal: float
    smooth: float
    misfit: Float[np.ndarray, " p"]


def slices(count: int, samples: int, device: str) -> list[slice]:
    """Pixels that are rendered together."""
    size = max(1, AT_ONCE.get(device, AT_ONCE["cpu"]) // samples)
    return [slice(i, min(i + size, count)) for i in range(0, count, size)]


class Descent:
    """Adam on Eq. (13)."""

    def __init__(
        self, scene: Scene, unknowns: Unknowns, photographed: Float[Tensor, "n p 3"], unit: float,
        beside: Int[Tensor, "p 4"], params: ReferenceParams,
    ) -> None:  # fmt: skip
        """`photographed` counts in `unit`s of radiance."""
        self._scene, self._unknowns, self._params = scene, unknowns, params
        self._photographed, self._unit, self._beside = photographed, unit, beside
        self._rates = (params.normal_rate, params.albedo_rate, params.roughness_rate, params.depth_rate)
        leaves = (unknowns.normals, unknowns.albedo, unknowns.roughness, unknowns.depth)
        self._adam = torch.optim.Adam([{"params": [leaf], "lr": 0.0} for leaf in leaves])
        self._begun = time.perf_counter()

    def epoch(
        self, epoch: int, order: Int[np.ndarray, " f"], shadows: Shadows, draw: torch.Generator, run: ThreadPool,
        progress: Progress,
    ) -> Told:  # fmt: skip
        """All views once, a batch at a time."""
        params, steps = self._params, -(-len(order) // self._params.batch_views)
        for group, rate in zip(
            self._adam.param_groups, rates(self._rates, epoch, params.halve_every), strict=True
        ):
            group["lr"] = rate
        weight = params.smoothness if epoch < params.smooth_epochs else 0.0
        misfit = torch.zeros_like(self._unknowns.depth, requires_grad=False)
        sums = np.zeros(3)
        for step in range(steps):
            done = (epoch + step / steps) / params.epochs
            progress.step(done, f"epoch {epoch + 1} of {params.epochs}{self._left(done)}")
            views = order[step * params.batch_views : (step + 1) * params.batch_views]
            self._adam.zero_grad()
            loss, terms = self._colour(views, shadows, draw, run)
            bent, uneven = self._shape()
            (bent + weight * uneven).backward()
            self._adam.step()
            with torch.no_grad():
                self._unknowns.normals.div_(self._unknowns.normals.norm(dim=1, keepdim=True))
            misfit += terms / len(order)
            sums += loss, float(bent.detach()), float(uneven.detach())
        colour, normal, smooth = (float(total / steps) for total in sums)
        return Told(colour, normal, smooth, misfit.cpu().numpy())

    def _colour(
        self, views: Int[np.ndarray, " b"], shadows: Shadows, draw: torch.Generator, run: ThreadPool
    ) -> tuple[float, Float[Tensor, " p"]]:
        """Eq. (14) over some views, pushed back on the unknowns; and each pixel's sum of terms."""
        count = len(self._unknowns.depth)
        total, terms = 0.0, []
        for part in slices(count, self._params.samples * len(views), self._scene.rays.device.type):
            picture = render(self._scene, self._unknowns.look(), shadows, part, views, draw, run)
            loss = losses.colour_loss(self._photographed[views, part], picture / self._unit)
            mean = loss.sum() / (count * len(views))
            mean.backward()
            total += float(mean.detach())
            terms.append(loss.detach().sum(0))
        return total, torch.cat(terms)

    def _shape(self) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
        """Eq. (15) and (16)."""
        look = self._unknowns.look()
        points = self._scene.rays * look.depth[:, None]
        pseudo, known = losses.pseudo_normals(points, self._beside)
        maps = (look.albedo, look.roughness[:, None], look.depth[:, None])
        smooth = sum((losses.total_variation(values, self._beside) for values in maps), torch.zeros(()))
        return losses.normal_loss(look.normals, pseudo, known), smooth

    def _left(self, done: float) -> str:
        """How long it will still take, once that can be told."""
        took = time.perf_counter() - self._begun
        return f", about {took * (1 - done) / done / 60:.0f} min left" if done > 0 and took > 5 else ""


def rates(first: tuple[float, ...], epoch: int, halve_every: int) -> tuple[float, ...]:
    """The learning rates of an epoch."""
    return tuple(rate * 0.5 ** (epoch // halve_every if halve_every else 0) for rate in first)
