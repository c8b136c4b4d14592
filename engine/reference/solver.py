"""The paper's inverse renderer as published: Monte Carlo pictures, Adam, and a mesh that casts the shadows.

Source: the paper, Sec. 3.3 and "Implementation details" of Sec. 4. Unknowns of every pixel: normal (kept at unit
length), the logits of albedo and roughness, and depth in units of the object's distance, which is the unit of the
paper's photographs. Each step renders every pixel in a batch of views, each epoch makes the mesh anew.

What the paper leaves open: the radiance that counts as 1 in Eq. (14), here that of Eq. (5) in our fits, half the
median of the background. What no photograph shows is dark: tracing the Gaussians finds nothing there, unless somebody has put
some (as `bench` does, which gives all methods one light).
"""

import time
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from engine.errors import SurfaceError
from engine.geometry import rays
from engine.light.gaussians.rasterize import ThreadPool, thread_pool
from engine.progress import Progress
from engine.reference import losses
from engine.reference.descent import Descent, Told, Unknowns, slices
from engine.reference.emitter.light import Given, light_for
from engine.reference.monte_carlo import queries, vmf_proposal
from engine.reference.monte_carlo.rendering import Look, Scene, render
from engine.reference.monte_carlo.shadows import Shadows, shadows_of
from engine.reference.params import EPOCHS, SAMPLES, ReferenceParams, ReferenceReport, title
from engine.reference.start import Start, begin
from engine.rerendering import rerendering_error
from engine.sampling import held_out
from engine.surface.data.observations import shifted_neighbours
from engine.surface.lighting.room_light import build_room_light
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import image
from engine.types import CapturedScene, Emitters, Frames, Masks, SolvedScene, Surface, ValidationRenders

TILE = 4
"""Side of the tiles in which a part of the pixels is taken: each has neighbours for Eq. (15) and (16), and a few hundred
pixels still come from all over the object."""
PICTURES = 8
"""A view kept out is rendered so often, and the mean is its picture: of one, the error would be mostly that of its samples."""
INSIDE = 0.01
"""First albedo and roughness stay so far from 0 and 1, where a sigmoid has no slope."""


def solve(
    captured: CapturedScene,
    params: ReferenceParams,
    device: str,
    seed: int,
    progress: Progress,
    flip: int = 0,
) -> SolvedScene:
    """The surface of the pixels solved (its mask), and the pictures of the views kept out.

    The Gaussians hold the lamps and are all the light, unless the paper's own is to be trained. Of its errors the paper's
    method knows nothing: the standard errors stand at the whole range. `seed` draws pixels, batches and directions;
    maps to start from are of the upright picture, turned by `flip`.

    Raises:
        SurfaceError: too few views, an empty mask, or maps to start from that do not fit.
        LightError: a light is to be trained, and nothing shows it.
    """
    frames, masks, poses, mask = captured.frames, captured.masks, captured.poses, captured.masks.object
    if not mask.any():
        raise SurfaceError("the object mask is empty; draw the mask or segment again")
    fitted, kept_out = held_out(poses.registered, params.validation_views)
    light = light_for(
        frames, masks, poses, captured.gaussians, captured.lamps, params, seed, progress.part(0, 0.05)
    )
    gaussians, lamps, clock = light.gaussians, light.lamps, time.perf_counter()
    as_known = replace(captured, gaussians=gaussians, lamps=lamps)
    room = build_room_light(as_known, SurfaceParams(without=("light_gains",)), seed)
    first = begin(frames, mask, room, fitted, params, device, seed, progress.part(0.05, 0.1), flip)
    solved, distance = part_of(mask, params.pixels, seed), first.distance.value
    unit = radiance_unit(frames, masks, fitted)
    unknowns = unknowns_of(first, mask, solved, device)

    def there(array: np.ndarray) -> Tensor:
        return torch.tensor(np.ascontiguousarray(array), dtype=torch.float32, device=device)

    ray = rays(poses.camera)
    per_z = ray / ray[..., 2:]
    # Our light keeps a lamp as one Gaussian of thousands: by the centres alone hardly a sample aims at it.
    weights = vmf_proposal.emitted(gaussians) if params.aim_by_emission else None
    mixture = vmf_proposal.fit(gaussians, seed, unit=params.aim_unit or distance, weights=weights)
    scene = Scene(
        there(per_z[solved]), there(poses.cam_from_world), mixture,
        queries.plant(gaussians), distance, params.samples, params.emitter_sampling, params.diffuse == "disney",
    )  # fmt: skip
    photographed = there(frames.radiance[:, solved]) / unit
    descent = Descent(scene, unknowns, photographed, unit, beside_of(solved, device), params)
    draw = torch.Generator(device).manual_seed(seed)
    order = np.random.default_rng(seed)
    depth, told, begun = first.depth.copy(), [], time.perf_counter()

    def shadows_now() -> Shadows:
        with torch.no_grad():
            if params.pixels:
                _keep_in_place(unknowns.depth, there(first.depth[solved] / distance), _tiles(solved))
            depth[solved] = distance * unknowns.depth.detach().cpu().numpy()
            return shadows_of(per_z * depth[..., None], mask, solved, unknowns.normals.detach().cpu().numpy())

    with thread_pool() as run:
        for epoch in range(params.epochs):
            shadows, span = shadows_now(), progress.part(0.1, 0.98)
            told.append(descent.epoch(epoch, order.permutation(fitted), shadows, draw, run, span))
        seconds = time.perf_counter() - begun
        pictures = np.zeros((len(kept_out), *mask.shape, 3), np.float32)
        shadows = shadows_now()
        with torch.no_grad():
            for i, view in enumerate(kept_out):
                progress.step(0.98 + 0.02 * i / len(kept_out), "rendering views kept out")
                pictures[i, solved] = _picture(scene, unknowns.look(), shadows, view, draw, run)
    renders = ValidationRenders(kept_out, pictures)
    report = _report(
        params, first, light, int(solved.sum()), int(mask.sum()), len(fitted), kept_out,
        rerendering_error(frames, renders, solved),
        unit, told, begun - clock, seconds,
    )  # fmt: skip
    as_given = Emitters(gaussians, lamps, 0)
    surface = _surface(solved, unknowns, depth, told)
    return SolvedScene(surface, renders, as_given, report)


def _picture(
    scene: Scene, look: Look, shadows: Shadows, view: int, draw: torch.Generator, run: ThreadPool
) -> Float[np.ndarray, "p 3"]:
    """The mean of PICTURES renderings of a view, each from samples of its own."""
    count, device = len(look.depth), look.depth.device.type
    total = torch.zeros((count, 3), device=look.depth.device)
    for part in slices(count, scene.samples, device):
        for _ in range(PICTURES):
            total[part] += render(scene, look, shadows, part, np.array([view]), draw, run)[0]
    return (total / PICTURES).cpu().numpy()


def part_of(mask: Bool[np.ndarray, "h w"], count: int, seed: int) -> Bool[np.ndarray, "h w"]:
    """About whom the solve is: all of the mask, or `count` pixels of it in random tiles."""
    inside = np.nonzero(mask.ravel())[0]
    if not 0 < count < len(inside):
        return mask
    tile = _tiles(mask)
    turn = np.random.default_rng(seed).permutation(tile.max() + 1)
    chosen = inside[np.argsort(turn[tile], kind="stable")[:count]]
    part = np.zeros(mask.size, bool)
    part[chosen] = True
    return part.reshape(mask.shape)


def _tiles(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, " p"]:
    """Number of the tile that each pixel of a mask lies in; none is left out."""
    v, u = np.nonzero(mask)
    return np.unique(v // TILE * mask.shape[1] + u // TILE, return_inverse=True)[1]


def beside_of(solved: Bool[np.ndarray, "h w"], device: str) -> Int[Tensor, "p 4"]:
    """The neighbours as losses.py asks for them."""
    return torch.as_tensor(shifted_neighbours(solved, np.array(losses.STEPS)), device=device)


def radiance_unit(frames: Frames, masks: Masks, views: Int[np.ndarray, " f"]) -> float:
    """The 1 of Eq. (14): half the median radiance of the background, as `plane_sweep.knee_of` has it for Eq. (5)."""
    shown = frames.radiance[views][masks.background[views]]
    if not len(shown):
        shown = frames.radiance[views][:, masks.object]
    values = shown.mean(-1)
    return max(0.5 * float(np.median(values)), 1e-3 * float(values.mean()), 1e-12)


def unknowns_of(
    first: Start, mask: Bool[np.ndarray, "h w"], solved: Bool[np.ndarray, "h w"], device: str
) -> Unknowns:
    """The unknowns at the start."""
    rows = solved[mask]

    def leaf(array: np.ndarray) -> Tensor:
        return torch.tensor(array, dtype=torch.float32, device=device, requires_grad=True)

    def logit(share: np.ndarray) -> np.ndarray:
        share = np.clip(share, INSIDE, 1 - INSIDE)
        return np.log(share / (1 - share))

    return Unknowns(
        leaf(first.normals[rows]), leaf(logit(first.albedo[rows])), leaf(logit(first.roughness[rows])),
        leaf(first.depth[solved] / first.distance.value),
    )  # fmt: skip


def _keep_in_place(
    depth: Float[Tensor, " p"], first: Float[Tensor, " p"], tile: Int[np.ndarray, " p"]
) -> None:
    """Bring every tile back to the mean depth it began with, in place.

    No loss knows where a tile stands as a whole: alone it would drift into its surroundings' shadow, which in a solve
    of all pixels move along.
    """
    which = torch.as_tensor(tile, device=depth.device)
    sums = [
        torch.zeros(int(tile.max()) + 1, device=depth.device).index_add_(0, which, x) for x in (first, depth)
    ]
    depth *= (sums[0] / sums[1])[which]


def _surface(
    solved: Bool[np.ndarray, "h w"], unknowns: Unknowns, depth: Float[np.ndarray, "h w"], told: list[Told]
) -> Surface:
    """The unknowns as maps."""
    look = unknowns.look()

    def on_grid(values: Tensor) -> np.ndarray:
        return image(solved, values.detach().cpu().numpy())

    whole = solved.astype(np.float32)
    residual = told[-1].misfit / 3 if told else np.zeros(int(solved.sum()))
    return Surface(
        solved,
        on_grid(look.normals),
        on_grid(look.albedo),
        on_grid(look.roughness),
        (depth * solved).astype(np.float32),
        np.float32(np.pi) * whole,
        whole,
        whole,
        image(solved, residual),
        np.zeros(solved.shape, np.uint8),
    )


def _report(
    params: ReferenceParams, first: Start, light: Given, pixels: int, object_pixels: int, fitted: int,
    kept_out: tuple[int, ...], error: float, unit: float, told: list[Told], start_seconds: float, seconds: float,
) -> ReferenceReport:  # fmt: skip
    """The facts, and what they say of the published settings."""
    drawn = pixels * fitted * params.samples * params.epochs
    per_sample = seconds / max(drawn, 1)
    return ReferenceReport(
        title=title(params),
        pixels=pixels,
        object_pixels=object_pixels,
        fitted_views=fitted,
        held_out_views=kept_out,
        held_out_error=error,
        samples=params.samples,
        epochs=params.epochs,
        steps=params.epochs * -(-fitted // params.batch_views),
        radiance_unit=unit,
        distance=first.distance,
        emitter=params.emitter,
        gaussians=len(light.gaussians.means),
        emitter_seconds=light.seconds,
        colour_loss=tuple(epoch.colour for epoch in told),
        normal_loss=tuple(epoch.normal for epoch in told),
        smooth_loss=tuple(epoch.smooth for epoch in told),
        start_seconds=start_seconds,
        seconds=seconds,
        seconds_per_sample=per_sample,
        seconds_per_pixel=seconds / pixels,
        published_seconds=per_sample * object_pixels * fitted * SAMPLES * EPOCHS,
    )
