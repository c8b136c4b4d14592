"""A first surface from nothing: the best of many normals and roughnesses at every pixel, albedo solved.

For a candidate (normal, roughness) the picture is linear in albedo, I_c = a_c D_c + S, so the weighted
least-squares albedo and its misfit follow from five sums over the views, each of which is a matrix product of
pixels with candidates. The best few are compared again by a robust log misfit, which forgives shadows.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from engine.geometry import fibonacci_sphere
from engine.parallel import each
from engine.progress import Progress
from engine.surface.data.observations import Observations
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem, initial_estimate
from engine.surface.rendering.transport import SurfaceGeometry

ROUGHNESSES = (0.25, 0.5, 0.8)


def exhaustive_search(problem: PixelProblem, candidates: int, progress: Progress) -> PixelEstimate:
    """The best of so many normals at every pixel; pixels of a block share one light and one view direction. Each is of the
    geometry's material."""
    geometry, transport = problem.geometry, problem.transport
    count = len(geometry.points)
    normals, albedo = np.zeros((count, 3)), np.zeros((count, 3))
    roughness = np.zeros(count)
    sphere = fibonacci_sphere(2 * candidates)
    regions = [part for region in problem.blocks for part in _of_one_material(geometry, region)]

    def search(pixels: Int[np.ndarray, " _"]) -> None:
        middle = pixels[len(pixels) // 2]
        facing = sphere[sphere @ geometry.views[middle] > 0.05]
        tried = np.repeat(facing, len(ROUGHNESSES), 0)
        rough = np.tile(ROUGHNESSES, len(facing))
        # As so many one-variant pixels: candidates differ in more than a lean.
        alike = replace(geometry, visibility=None).part(np.full(len(tried), middle))
        block = transport.block(alike, np.arange(len(tried)))
        block = block.under(transport.incident.at(geometry.points[pixels].mean(0)))
        diffuse, specular = transport(block, tried[:, None], rough[:, None])
        best, a = _choose(diffuse[:, 0], specular[:, 0], problem.observations, pixels)
        normals[pixels], roughness[pixels], albedo[pixels] = tried[best], rough[best], a

    each(search, regions, progress, "searching normals")
    return initial_estimate(normals, albedo, roughness)


def _of_one_material(geometry: SurfaceGeometry, pixels: Int[np.ndarray, " k"]) -> list[Int[np.ndarray, " _"]]:
    if geometry.material is None:
        return [pixels]
    _, which = np.unique(geometry.material[pixels], axis=0, return_inverse=True)
    return [pixels[which == k] for k in range(which.max() + 1)]


def _choose(
    diffuse: Float[np.ndarray, "k v"],
    specular: Float[np.ndarray, "k v"],
    observations: Observations,
    pixels: Int[np.ndarray, " p"],
) -> tuple[Int[np.ndarray, " p"], Float[np.ndarray, "p 3"]]:
    """Index of the best candidate for each pixel and its albedo."""
    chosen, albedos = [], []
    d, s = (np.ascontiguousarray(x.reshape(len(x), -1, 3).transpose(2, 0, 1)) for x in (diffuse, specular))
    for begin in range(0, len(pixels), 1024):
        part = pixels[begin : begin + 1024]
        shape = (len(part), -1, 3)
        radiance = observations.radiance[part].reshape(shape).transpose(2, 0, 1)
        eps = observations.eps[part][None, :, None]
        weight = (observations.weight[part].reshape(shape).transpose(2, 0, 1) > 0) / (radiance + eps) ** 2
        misfit = 0
        a = []
        for c in range(3):
            w, wi = weight[c], weight[c] * radiance[c]
            dt, st = d[c].T, s[c].T
            cross = wi @ dt - w @ (d[c] * s[c]).T
            square = w @ (d[c] ** 2).T + 1e-20
            best = np.clip(cross / square, 0.005, 1.0)
            a.append(best)
            rest = w @ (s[c] ** 2).T - 2 * (wi @ st)
            misfit = misfit + rest - 2 * best * cross + best**2 * square
        finalists = np.argpartition(misfit, 12, axis=1)[:, :12]
        robust = np.zeros(finalists.shape)
        refined = np.zeros((*finalists.shape, 3))
        for c in range(3):
            first = np.take_along_axis(a[c], finalists, 1)[..., None]
            dd, ss = d[c][finalists], s[c][finalists]
            bright, floor, valid = (radiance[c] + eps[0])[:, None], eps[0][:, None], (weight[c] > 0)[:, None]
            logs = np.log(bright / (np.maximum(first * dd + ss, 0) + floor))
            # The median ratio is the albedo that shadows and highlights do not move.
            shift = np.median(np.where(valid, logs, 0), axis=2, keepdims=True)
            second = np.clip(first * np.exp(shift), 0.005, 1.0)
            logs = np.log(bright / (np.maximum(second * dd + ss, 0) + floor))
            robust += np.where(valid, np.abs(logs), 0).sum(2)
            refined[..., c] = second[..., 0]
        winner = np.argmin(robust, 1)
        rows = np.arange(len(part))
        chosen.append(finalists[rows, winner])
        albedos.append(refined[rows, winner])
    return np.concatenate(chosen), np.concatenate(albedos)
