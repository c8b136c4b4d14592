"""Pictures by Eq. (8): some pixels in some views, with directions drawn afresh, shadows cast and the light traced.

Shape lives in the camera frame, light in the world; Eq. (1) takes points and normals over. Torch on any device; the
Gaussians and the mesh are traced on the CPU.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from engine.light.gaussians.rasterize import ThreadPool
from engine.reference.monte_carlo import estimator, queries
from engine.reference.monte_carlo.shadows import Shadows
from engine.reference.monte_carlo.vmf_proposal import Mixture


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What stays as it is while the surface moves, for the `p` pixels solved."""

    rays: Float[Tensor, "p 3"]  # from the camera, with z = 1, camera frame
    cam_from_world: Float[Tensor, "n 3 4"]
    mixture: Mixture
    tree: queries.Tree
    distance: float  # of the object, scene units
    samples: int
    emitter_sampling: bool
    full_diffuse: bool


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The surface as it stands."""

    normals: Float[Tensor, "p 3"]  # unit, camera frame
    albedo: Float[Tensor, "p 3"]
    roughness: Float[Tensor, " p"]
    depth: Float[Tensor, " p"]  # z / distance


def render(
    scene: Scene, look: Look, shadows: Shadows, pixels: slice, views: Int[np.ndarray, " b"],
    draw: torch.Generator, run: ThreadPool,
) -> Float[Tensor, "b q 3"]:  # fmt: skip
    """Radiance of some of the pixels in some views."""
    pose = scene.cam_from_world[torch.as_tensor(views, device=scene.rays.device)]
    turn, shift = pose[:, :, :3], pose[:, :, 3]
    rays, normals = scene.rays[pixels], look.normals[pixels]
    points = rays * (scene.distance * look.depth[pixels].detach())[:, None]
    origins = torch.einsum("bij,bqi->bqj", turn, points - shift[:, None]).flatten(0, 1)
    normals = torch.einsum("bij,qi->bqj", turn, normals).flatten(0, 1)
    facing = -torch.nn.functional.normalize(rays, dim=1)
    facing = torch.einsum("bij,qi->bqj", turn, facing).flatten(0, 1)
    albedo, roughness = look.albedo[pixels].repeat(len(views), 1), look.roughness[pixels].repeat(len(views))
    uniforms = torch.rand((len(normals), scene.samples, 3), generator=draw, device=rays.device)
    still = normals.detach()
    if scene.emitter_sampling:
        lobes = estimator.lobes_at(scene.mixture, origins)
        directions, pdf = estimator.towards_light(lobes, still, uniforms)
    else:
        directions, pdf = estimator.towards_highlight(still, facing, roughness.detach(), uniforms)
    risen = torch.einsum("ki,ksi->ks", still, directions) > 0
    shape = (len(views), len(rays), scene.samples)
    seen = torch.einsum("bij,bqsj->bqsi", turn, directions.view(*shape, 3))
    clear = shadows.clear(pixels, seen.cpu().numpy(), risen.view(shape).cpu().numpy())
    light = queries.radiance(
        scene.tree, origins.cpu().numpy(), directions.cpu().numpy(), clear.reshape(len(normals), -1), run
    )
    arriving = torch.as_tensor(light, device=rays.device)
    answer = estimator.estimate(
        normals, albedo, roughness, facing, directions, pdf, arriving, scene.full_diffuse
    )
    return answer.view(len(views), len(rays), 3)
