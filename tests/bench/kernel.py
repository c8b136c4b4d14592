"""Prints what one view of the Gaussians costs, forward and backward, per ray and against the torch reference.

    python -m tests.bench.kernel [--size 512] [--counts 5000,15000,50000,150000] [--repeat 5] [--rays 64]

The room is synthetic: a box of walls and heaps of things in it, seen from its middle. A Gaussian's size is a
fixed share of its distance, lognormal as in a fit, and falls with the root of the count, so that a finer room
covers a ray as often as a coarse one. SIZE makes that 19 to 20 Gaussians composited on a ray: what three views
each of two fitted rooms of the studio (study, lamps; 15 000 Gaussians) measured 17 to 22 of.

Core-seconds are CPU time of the process, all threads, medians after a warm-up; projection, sorting and, for
the backward pass, the gradients of every parameter are in them. The reference traces a few random rays; its
cost is the cost of those times all rays of the view, as it has no other way to spend less on more.
"""

import argparse
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from app.bench.markdown import markdown
from engine.light.gaussians import rasterize_kernels, raytrace_reference
from engine.light.gaussians.gaussians import Y00, radiance_towards
from engine.light.gaussians.rasterize import (
    Gradients,
    Pinhole,
    backward,
    project,
    render,
    shapes,
    thread_pool,
)
from engine.types import Gaussians

TARGET_S, TARGET_SIZE, TARGET_COUNT = 0.25, 512, 50_000
AGREE_FORWARD, AGREE_GRADIENT = 1e-4, 1e-3  # relative, with the reference
FIELD_DEG = 62.0
WALLS_M = np.array([4.0, 3.4, 2.7])
SIZE = 0.0215  # a Gaussian's middle scale over its distance, in a room of 15 000
BUNCH = 16
"""Rays that the reference traces at once: its memory is rays times Gaussians."""
PARAMETERS = ("means", "turn", "log_scales", "density", "colours")


@dataclass(frozen=True, slots=True)
class Cost:
    """One count of Gaussians; core-seconds of a whole view, differences relative."""

    count: int
    rays: int  # of the view
    forward_s: float
    both_s: float  # forward and backward
    per_ray: float  # Gaussians composited on a ray, mean
    listed: float  # Gaussians evaluated for a ray (its tile's list), mean
    reference_forward_s: float  # extrapolated to the view
    reference_both_s: float
    forward_off: float  # largest |difference| over the reference, rays and channels
    gradient_off: float  # largest over the kinds of parameters: size of the difference over the reference's


def main(argv: Sequence[str] | None = None) -> int:
    args = _parser().parse_args(argv)
    costs = []
    for count in map(int, args.counts.split(",")):
        costs.append(measure(count, args.size, args.repeat, args.rays, args.seed))
        print(table(costs[-1:]).splitlines()[-1], file=sys.stderr)
    print(
        f"{args.size} x {args.size}, {args.repeat} repeats, reference on {args.rays} rays;"
        f" {os.cpu_count()} cores, {platform.machine()}, {_processor()}\n"
    )
    print(table(costs))
    print("\n" + verdict(costs))
    return 0


def measure(count: int, size: int, repeat: int, rays: int, seed: int) -> Cost:
    """Time the kernel on one view, and hold it against the reference on a few of its rays."""
    rng = np.random.default_rng(seed)
    gaussians, view = room(count, rng), looking(size)
    geometry, colours = shapes(gaussians), radiance_towards(gaussians, view.origin)
    chosen = np.sort(rng.choice(size * size, min(rays, size * size), replace=False))
    # A linear loss on the chosen rays alone: what the reference differentiates too.
    slope = np.zeros((size * size, 3), np.float32)
    slope[chosen] = rng.normal(size=(len(chosen), 3))
    nowhere = np.zeros((size, size), np.float32)
    want = rng.uniform(0.1, 1, (size, size, 3)).astype(np.float32)
    with thread_pool() as run:

        def forward() -> np.ndarray:
            return render(shapes(gaussians), colours, view, 0.0, run)

        def both() -> object:
            return backward(shapes(gaussians), colours, view, 0.0, want, nowhere + 1, 0.1, 0.1, nowhere, run)

        forward_s, both_s = core_seconds(forward, repeat), core_seconds(both, repeat)
        image = forward().reshape(-1, rasterize_kernels.CHANNELS)[chosen]
        _, found = backward(
            geometry, colours, view, 0.0, slope.reshape(size, size, 3), nowhere, 0.0, 0.0, nowhere, run
        )  # fmt: skip
    there = reference(gaussians, colours, view, chosen, slope[chosen])
    per_ray, listed = coverage(gaussians, colours, view)
    share = size * size / len(chosen)
    return Cost(
        count, size * size, forward_s, both_s, per_ray, listed, there.forward_s * share, there.both_s * share,
        largest_off(image, there.image), worst_gradient(found, there.gradients),
    )  # fmt: skip


def room(count: int, rng: np.random.Generator) -> Gaussians:
    """Seven of ten Gaussians on the walls of a box around the origin, the rest in forty heaps within it; metres."""
    ways = rng.normal(size=(40, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    heaps = ways * rng.uniform(1.0, 1.6, (40, 1))
    on_walls = round(0.7 * count)
    means = rng.uniform(-0.5, 0.5, (on_walls, 3)) * WALLS_M
    areas = WALLS_M.prod() / WALLS_M
    axis = rng.choice(3, on_walls, p=areas / areas.sum())
    side = rng.choice([-0.5, 0.5], on_walls)
    means[np.arange(on_walls), axis] = side * WALLS_M[axis] + rng.normal(0, 0.02, on_walls)
    thrown = rng.normal(size=(count - on_walls, 3)) * 0.12
    means = np.concatenate([means, heaps[rng.integers(0, 40, len(thrown))] + thrown])
    distance = np.maximum(np.linalg.norm(means, axis=1), 0.5)
    middle = SIZE * distance * np.sqrt(15_000 / count) * np.exp(0.35 * rng.normal(size=count))
    radiance = 0.3 * np.exp(rng.normal(size=(count, 1, 1))) * rng.uniform(0.6, 1.0, (count, 1, 3))
    return Gaussians(
        means=means,
        quaternions=rng.normal(size=(count, 4)),
        scales=middle[:, None] * np.array([0.8, 1.0, 1.2]),
        density=1.7 * np.exp(0.5 * rng.normal(size=count)),
        radiance=radiance / Y00,
    )


def looking(size: int) -> Pinhole:
    """A square view from the box's middle along its longest side."""
    cam_from_world = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 0.0]])
    focal = size / 2 / np.tan(np.radians(FIELD_DEG) / 2)
    return Pinhole(cam_from_world, np.array([focal, focal, size / 2, size / 2]), size, size)


def core_seconds(act: Callable[[], object], repeat: int) -> float:
    """Median CPU time of the process over the repeats, after one that does not count."""
    act()
    taken = []
    for _ in range(repeat):
        start = time.process_time()
        act()
        taken.append(time.process_time() - start)
    return statistics.median(taken)


def coverage(gaussians: Gaussians, colours: Float[np.ndarray, "k 3"], view: Pinhole) -> tuple[float, float]:
    """Gaussians composited on a ray until it ends, and those in its tile's list; means over the view."""
    index, packed, (tile_start, members, _, _) = project(shapes(gaussians), colours, view)
    everywhere: Bool[np.ndarray, "h w"] = np.ones((view.height, view.width), bool)
    _, counts, _, _ = rasterize_kernels.compositing_weights(
        packed, index, tile_start, members, view.lens, np.float32(0), everywhere, np.float32(0)
    )
    return float(counts.mean()), float(np.diff(tile_start).mean())


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The reference's answer on some rays, and its core-seconds for them."""

    image: Float[np.ndarray, "r 3"]
    gradients: dict[str, np.ndarray]  # of all Gaussians, in the kernel's own parameters
    forward_s: float
    both_s: float


def reference(
    gaussians: Gaussians,
    colours: Float[np.ndarray, "k 3"],
    view: Pinhole,
    chosen: Int[np.ndarray, " r"],
    slope: Float[np.ndarray, "r 3"],
) -> Reference:
    """Radiance and d (slope . radiance) of the chosen pixels by `raytrace_reference.py` in float64."""
    v, u = np.divmod(chosen, view.width)
    plane = np.stack([u + 0.5 - view.lens[2], v + 0.5 - view.lens[3]], 1) / view.lens[:2]
    directions = torch.tensor(np.column_stack([plane, np.ones(len(plane))]) @ view.cam_from_world[:, :3])
    origins = torch.tensor(np.tile(view.origin, (len(directions), 1)))
    slopes = torch.tensor(slope, dtype=torch.float64)
    count = len(gaussians.means)
    leaves = {
        "means": torch.tensor(gaussians.means),
        "turn": torch.zeros(count, 3, dtype=torch.float64),
        "log_scales": torch.tensor(np.log(gaussians.scales)),
        "density": torch.tensor(gaussians.density),
        "colours": torch.tensor(np.asarray(colours, np.float64)),
    }
    still = torch.tensor(gaussians.quaternions)

    def traced(at: slice) -> Tensor:
        return raytrace_reference.trace(
            leaves["means"], turned(still, leaves["turn"]), leaves["log_scales"].exp(), leaves["density"],
            leaves["colours"], origins[at], directions[at],
        )[0]  # fmt: skip

    bunches = [slice(begin, begin + BUNCH) for begin in range(0, len(chosen), BUNCH)]

    def forward() -> Tensor:
        with torch.no_grad():
            return torch.cat([traced(at) for at in bunches])

    def both() -> None:
        for leaf in leaves.values():
            leaf.grad = None
        for at in bunches:
            (slopes[at] * traced(at)).sum().backward()

    forward_s = core_seconds(forward, 1)
    image = forward().numpy()
    for leaf in leaves.values():
        leaf.requires_grad_()
    both_s = core_seconds(both, 1)
    gradients = {name: leaf.grad.numpy() for name, leaf in leaves.items() if leaf.grad is not None}
    return Reference(image, gradients, forward_s, both_s)


def turned(quaternions: Float[Tensor, "k 4"], turn: Float[Tensor, "k 3"]) -> Float[Tensor, "k 4"]:
    """The rotations after a small turn about their own axes, R exp([turn]x), to first order."""
    w, own = quaternions[:, :1], quaternions[:, 1:]
    half = turn / 2
    return torch.cat(
        [w - (own * half).sum(1, keepdim=True), own + w * half + torch.cross(own, half, dim=1)], 1
    )


def largest_off(ours: Float[np.ndarray, "r c"], theirs: Float[np.ndarray, "r 3"]) -> float:
    """Largest difference of radiance, relative to the reference's at that ray and channel."""
    return float((np.abs(ours[:, :3] - theirs) / np.maximum(theirs, 1e-12)).max())


def worst_gradient(found: Gradients, theirs: dict[str, np.ndarray]) -> float:
    """Size of the difference relative to the size of the reference's gradient, worst kind of parameter."""
    worst = 0.0
    for name in PARAMETERS:
        ours = np.zeros_like(theirs[name])
        ours[found.index] = getattr(found, name)
        worst = max(worst, float(np.linalg.norm(ours - theirs[name]) / np.linalg.norm(theirs[name])))
    return worst


def table(costs: Sequence[Cost]) -> str:
    """A Markdown table, one row per count."""
    lines = [[
        "Gaussians", "forward core-s", "both core-s", "forward ns/ray", "both ns/ray", "on a ray", "in its list",
        "torch forward core-s", "torch both core-s", "forward x", "both x", "forward off", "gradient off",
    ]]  # fmt: skip
    for c in costs:
        lines.append([
            str(c.count), f"{c.forward_s:.3f}", f"{c.both_s:.3f}", f"{1e9 * c.forward_s / c.rays:.0f}",
            f"{1e9 * c.both_s / c.rays:.0f}", f"{c.per_ray:.1f}", f"{c.listed:.1f}",
            f"{c.reference_forward_s:.0f}", f"{c.reference_both_s:.0f}",
            f"{c.reference_forward_s / c.forward_s:.0f}", f"{c.reference_both_s / c.both_s:.0f}",
            f"{c.forward_off:.1e}", f"{c.gradient_off:.1e}",
        ])  # fmt: skip
    return markdown(lines)


def verdict(costs: Sequence[Cost]) -> str:
    """The targets beside what they are measured by: one line each."""
    said = f"target: {TARGET_SIZE}^2 with {TARGET_COUNT} Gaussians, forward and backward <= {TARGET_S} core-s"
    asked = [c for c in costs if c.count == TARGET_COUNT and c.rays == TARGET_SIZE**2]
    if asked:
        said += f"; measured {asked[0].both_s:.3f}: {_word(asked[0].both_s <= TARGET_S)}"
    else:
        said += "; not measured here"
    lines = [said]
    for what, off, limit in (
        ("radiance", max(c.forward_off for c in costs), AGREE_FORWARD),
        ("gradients", max(c.gradient_off for c in costs), AGREE_GRADIENT),
    ):
        lines.append(
            f"target: {what} as the reference's to {limit:g}; measured {off:.1e}: {_word(off <= limit)}"
        )
    return "\n".join(lines)


def _word(met: bool) -> str:
    return "met" if met else "MISSED"


def _processor() -> str:
    with open("/proc/cpuinfo") as facts:
        names = [line.split(":")[1].strip() for line in facts if line.startswith("model name")]
    return names[0] if names else "unknown processor"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="kernel", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--counts", default="5000,15000,50000,150000")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--seed", type=int, default=0)
    return parser


if __name__ == "__main__":
    sys.exit(main())
