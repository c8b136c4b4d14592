"""The reflectance of `engine/surface/reflectance/brdf.py` once more, plainly, in torch: what the kernel is held against, and runs on CUDA.

A file of its own: torch takes seconds to load, and neither planning nor solving on a CPU has a use for it.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from engine.surface.reflectance.brdf import PAINT


def lobes_reference(
    nl: Float[Tensor, "..."],
    nv: Float[Tensor, "..."],
    lv: Float[Tensor, "..."],
    roughness: Float[Tensor, "..."],
    a2: Float[Tensor, "..."],
    full_diffuse: bool,
    level: Float[Tensor, "..."],
    metal: Float[Tensor, "..."],
) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."]]:
    """`brdf.lobes` of a material as `brdf` has it, each argument of one shape or broadcast to it; `a2` is alpha**2 with what
    a cell or a disc adds to it."""
    lh = ((1 + lv) / 2).clamp(min=1e-6).sqrt()
    nh = ((nl + nv) / (2 * lh)).clamp(max=1)
    ggx = a2 / (math.pi * (nh**2 * (a2 - 1) + 1) ** 2)
    g = (((1 + (0.08 * level).sqrt()) / (1 - (0.08 * level).sqrt())) ** 2 - 1 + lh**2).sqrt()
    fresnel = ((g - lh) / (g + lh)) ** 2 / 2 * (1 + ((lh * (g + lh) - 1) / (lh * (g - lh) + 1)) ** 2)
    masking = 1 / ((nl + (a2 + (1 - a2) * nl**2).sqrt()) * (nv + (a2 + (1 - a2) * nv**2).sqrt()))
    diffuse = nl / math.pi
    if full_diffuse:
        retro = 2 * roughness * lh**2 - 0.5
        diffuse = diffuse * (1 + retro * (1 - nl) ** 5) * (1 + retro * (1 - nv) ** 5)
    facets = ggx * masking * nl
    white = (1 - lh).clamp(min=0) ** 5
    coloured = (1 - metal) * diffuse + metal * facets * (1 - white)
    return coloured, facets * ((1 - metal) * fresnel + metal * white)


def rows_reference(
    normals: Float[Tensor, "p 3"],
    roughness: Float[Tensor, " p"],
    views: Float[Tensor, "p 3"],
    directions: Float[Tensor, "d 3"],
    full_diffuse: bool,
    floor: float,
    material: Float[Tensor, "p 2"] | None = None,
) -> tuple[Float[Tensor, "p d"], Float[Tensor, "p d"]]:
    """(diffuse, specular) rows in the tensors' own precision; arguments as `brdf.rows` takes them."""
    nl = (normals @ directions.T).clamp(min=0)
    nv = (normals * views).sum(1).clamp(min=1e-3)[:, None]
    rough = roughness[:, None]
    if material is None:
        material = torch.tensor(PAINT, dtype=normals.dtype, device=normals.device).expand(len(normals), 2)
    return lobes_reference(
        nl, nv, views @ directions.T, rough, rough**4 + floor, full_diffuse, material[:, :1], material[:, 1:]
    )
