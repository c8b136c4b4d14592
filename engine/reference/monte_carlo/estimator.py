"""The Monte Carlo estimate of outgoing radiance, differentiable in normal, albedo and roughness. Torch.

Source: the paper, Eq. (8)-(12): directions aimed at the light (von Mises-Fisher lobes over the Gaussians, mixed with the
cosine) or, in its ablation, at the highlight (GGX half-vectors mixed with the cosine); dividing by the mixed density is
the balance heuristic (Veach and Guibas 1995). The BRDF is Eq. (9)-(11): GGX and Smith's separable masking after Walter
et al. 2007, Fresnel after Schlick 1994, alpha = roughness**2.

Any one frame; directions are unit and point away from the surface; densities are per steradian. Drawing is not
differentiated: directions, densities, radiance and visibility are constants of Eq. (8).
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from engine.reference.monte_carlo.vmf_proposal import LIGHT_SHARE, SHARPNESS, Mixture

F0 = 0.04
"""Reflectance head on."""
SHARPEST = 3e-3
"""Least alpha of GGX: a mirror has no density, and a narrower lobe no digits in float32."""
GRAZING = 1e-3
"""Least cosine towards the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class Lobes:
    """Eq. (12) at some points; `vmf_proposal.Proposal` in torch, which runs on a GPU too."""

    axes: Float[Tensor, "p k 3"]
    kappas: Float[Tensor, "p k"]
    weights: Float[Tensor, " k"]


def lobes_at(mixture: Mixture, points: Float[Tensor, "p 3"], sharpness: float = SHARPNESS) -> Lobes:
    """The light's lobes as seen from each point (the mixture's frame)."""

    def there(array) -> Tensor:
        return torch.as_tensor(array, dtype=points.dtype, device=points.device)

    away = there(mixture.means) - points[:, None]
    # On a mean itself Eq. (12) has no direction; a lobe of none and a finite kappa is as good as any.
    distance = away.norm(dim=2).clamp(min=1e-6 * mixture.unit)
    kappas = sharpness * there(mixture.concentrations) * mixture.unit / distance
    return Lobes(away / distance[..., None], kappas, there(mixture.weights))


@torch.no_grad()
def towards_light(
    lobes: Lobes, normals: Float[Tensor, "p 3"], uniforms: Float[Tensor, "p s 3"]
) -> tuple[Float[Tensor, "p s 3"], Float[Tensor, "p s"]]:
    """Directions from lobes and cosine, mixed, with the density of the mixture; some lie below the horizon."""
    pick, u, v = uniforms.unbind(-1)
    ends = lobes.weights.cumsum(0)[:-1]
    lobe = torch.searchsorted(ends, (pick / LIGHT_SHARE).contiguous(), right=True)
    at_light = pick < LIGHT_SHARE
    row = torch.arange(len(normals), device=normals.device)[:, None]
    axis = torch.where(at_light[..., None], lobes.axes[row, lobe], normals[:, None])
    kappa = lobes.kappas[row, lobe]
    # 1 - cos of the angle to the axis, by inversion (Jakob 2012): as such it keeps its digits in narrow lobes.
    narrow = (-torch.log1p((1 - u) * torch.expm1(-2 * kappa)) / kappa).clamp(max=2)
    drop = torch.where(at_light, narrow, 1 - (1 - u).sqrt())
    directions = _around(axis, 1 - drop, (drop * (2 - drop)).sqrt(), v)
    return directions, light_pdf(lobes, normals, directions)


def light_pdf(
    lobes: Lobes, normals: Float[Tensor, "p 3"], directions: Float[Tensor, "p s 3"]
) -> Float[Tensor, "p s"]:
    """Density with which `towards_light` draws these directions."""
    k = lobes.kappas
    peak = torch.log(k) - math.log(2 * math.pi) - torch.log(-torch.expm1(-2 * k)) + torch.log(lobes.weights)
    aimed = torch.baddbmm((peak - k)[:, None], directions, (k[..., None] * lobes.axes).transpose(1, 2))
    return LIGHT_SHARE * aimed.exp().sum(-1) + (1 - LIGHT_SHARE) * _cosine(normals, directions) / math.pi


@torch.no_grad()
def towards_highlight(
    normals: Float[Tensor, "p 3"],
    views: Float[Tensor, "p 3"],
    roughness: Float[Tensor, " p"],
    uniforms: Float[Tensor, "p s 3"],
) -> tuple[Float[Tensor, "p s 3"], Float[Tensor, "p s"]]:
    """Directions from GGX half-vectors and cosine, half each, with the density of the mixture."""
    pick, u, v = uniforms.unbind(-1)
    a2 = (roughness**4).clamp(min=SHARPEST**2)[:, None]
    ggx = pick < 0.5
    cosine2 = torch.where(ggx, (1 - u) / (1 + (a2 - 1) * u), 1 - u)
    axis = normals[:, None].expand(*pick.shape, 3)
    drawn = _around(axis, cosine2.sqrt(), (1 - cosine2).clamp(min=0).sqrt(), v)
    mirrored = 2 * (views[:, None] * drawn).sum(-1, keepdim=True) * drawn - views[:, None]
    directions = torch.where(ggx[..., None], mirrored, drawn)
    half = torch.nn.functional.normalize(directions + views[:, None], dim=-1)
    nh = _cosine(normals, half)
    vh = (views[:, None] * half).sum(-1).clamp(min=1e-6)
    lobe = _ggx(nh, a2) * nh / (4 * vh)
    return directions, 0.5 * lobe + 0.5 * _cosine(normals, directions) / math.pi


def response(
    normals: Float[Tensor, "p 3"],
    roughness: Float[Tensor, " p"],
    views: Float[Tensor, "p 3"],
    directions: Float[Tensor, "p s 3"],
    full_diffuse: bool,
) -> tuple[Float[Tensor, "p s"], Float[Tensor, "p s"]]:
    """(f_d without albedo, f_s) of Eq. (9)-(11), each times the cosine; `full_diffuse` is Disney's own diffuse lobe."""
    nl = _cosine(normals, directions)
    nv = (normals * views).sum(1, keepdim=True).clamp(min=GRAZING)
    half = torch.nn.functional.normalize(directions + views[:, None], dim=-1)
    vh = (views[:, None] * half).sum(-1).clamp(1e-6, 1)
    a2 = (roughness**4).clamp(min=SHARPEST**2)[:, None]
    fresnel = F0 + (1 - F0) * (1 - vh) ** 5
    # G / (4 n.l n.v): each side's 2 n.w / (n.w + sqrt(a2 + (1 - a2) (n.w)^2)) without its factor n.w.
    masking = 1 / ((nl + (a2 + (1 - a2) * nl * nl).sqrt()) * (nv + (a2 + (1 - a2) * nv * nv).sqrt()))
    specular = _ggx(_cosine(normals, half).clamp(max=1), a2) * fresnel * masking * nl
    diffuse = nl / math.pi
    if full_diffuse:
        retro = 2 * roughness[:, None] * vh * vh - 0.5
        diffuse = diffuse * (1 + retro * (1 - nl) ** 5) * (1 + retro * (1 - nv) ** 5)
    return diffuse, specular


def estimate(
    normals: Float[Tensor, "p 3"],
    albedo: Float[Tensor, "p 3"],
    roughness: Float[Tensor, " p"],
    views: Float[Tensor, "p 3"],
    directions: Float[Tensor, "p s 3"],
    pdf: Float[Tensor, "p s"],
    radiance: Float[Tensor, "p s 3"],
    full_diffuse: bool = False,
) -> Float[Tensor, "p 3"]:
    """Eq. (8); `radiance` is V L_i of every sample."""
    diffuse, specular = response(normals, roughness, views, directions, full_diffuse)
    # Directions below the horizon of a mixture's own normal may have no density, and no cosine either.
    share = torch.where(pdf > 0, 1 / pdf.clamp(min=torch.finfo(pdf.dtype).tiny), 0) / pdf.shape[1]
    spread = torch.einsum("ps,psc->pc", diffuse * share, radiance)
    return albedo * spread + torch.einsum("ps,psc->pc", specular * share, radiance)


def _cosine(normals: Float[Tensor, "p 3"], directions: Float[Tensor, "p s 3"]) -> Float[Tensor, "p s"]:
    return torch.einsum("pi,psi->ps", normals, directions).clamp(min=0)


def _ggx(nh: Float[Tensor, "p s"], a2: Float[Tensor, "p 1"]) -> Float[Tensor, "p s"]:
    """Density of half-vectors, D of Eq. (11)."""
    return a2 / (math.pi * (nh * nh * (a2 - 1) + 1) ** 2)


def _around(
    axis: Float[Tensor, "p s 3"],
    cosine: Float[Tensor, "p s"],
    sine: Float[Tensor, "p s"],
    turn: Float[Tensor, "p s"],
) -> Float[Tensor, "p s 3"]:
    """Unit vectors at an angle to their axes, `turn` in [0, 1) about them (frames: Duff et al. 2017)."""
    x, y, z = axis.unbind(-1)
    sign = torch.where(z >= 0, 1.0, -1.0).to(z.dtype)
    a = -1 / (sign + z)
    b = x * y * a
    first = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    second = torch.stack([b, sign + y * y * a, -y], -1)
    angle = 2 * math.pi * turn
    flat = (sine * angle.cos())[..., None] * first + (sine * angle.sin())[..., None] * second
    return flat + cosine[..., None] * axis
