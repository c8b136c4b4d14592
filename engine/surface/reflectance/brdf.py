"""The reflectance of one surface point towards the camera: the paper's two-parameter Disney BRDF, and its metals.

Source: the paper, Eq. (9)-(11); the full diffuse lobe after B. Burley, "Physically Based Shading at
Disney" (2012), Sec. 5.3, specular level and metalness Sec. 5.1 and 5.5; GGX and Smith's separable masking after Walter et
al. 2007; Fresnel's reflectance of a dielectric, unpolarised, in the form of R. Cook and K. Torrance, "A Reflectance Model for
Computer Graphics" (1982); Schlick's power for metals. alpha = roughness**2. All directions are unit and point away from
the surface. A "row" is the response of one pixel to unit radiance from every direction, cosine included:

    diffuse[p, d]     to be multiplied by albedo: of paint k_d / pi * max(0, n.l), of metal the highlight but for its
                      share at grazing, which is white
    specular[p, d]    the rest: of paint f_s * max(0, n.l)

A material is (specular level, metalness) as Disney has them: level 0.5 is an index of 1.5, a level of s reflects 0.08 s
head on; a metal's highlight is of the colour that its albedo says.

`rows` is the Numba kernel; `engine/surface/reflectance/brdf_torch.py` says the same in torch.
"""

import math
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

PAINT = (0.5, 0.0)
"""The material of which nothing is known: a dielectric of index 1.5, a reflectance of 0.04 head on, as in the paper's model.
What it reflects otherwise is Fresnel's law and not Schlick's power, which is a fifth short at 45 degrees and a quarter at
60."""


def of_pixels(
    material: Float[np.ndarray, "*p 2"] | None, pixels: np.ndarray
) -> Float[np.ndarray, "k 2"] | None:
    """The material of some pixels, by their numbers or a mask; None, all of paint, stays that."""
    return None if material is None else material[pixels]


def index_of(level: Float[np.ndarray, "*p"]) -> Float[np.ndarray, "*p"]:
    """The index of refraction that reflects 0.08 `level` head on (Burley 2012, Sec. 5.5)."""
    return 2 / (1 - np.sqrt(0.08 * level)) - 1


def optics(material: Float[np.ndarray, "p 2"] | None, count: int) -> Float[np.ndarray, "p 2"]:
    """What the kernels ask of `count` pixels' materials (None: all `PAINT`): squared index less one, metalness; float32."""
    if material is None:
        material = np.tile(PAINT, (count, 1))
    level, metalness = np.asarray(material, float).T
    return np.stack([index_of(level) ** 2 - 1, metalness], 1).astype(np.float32)


def lobe_floor(count: int) -> float:
    """What averaging over one of `count` direction cells adds to alpha**2.

    A cell of solid angle 4 pi / count is about a disc of radius 2 / sqrt(count); the half-vector moves half
    as far as the light, and alpha**2 is twice the per-axis variance of a narrow lobe.
    """
    radius = 2 / math.sqrt(count)
    return 2 * (radius / 2) ** 2 / 4


# Inlined: a cached kernel that calls another may be given that one as compiled elsewhere, which rounds differently.
@numba.njit(inline="always", fastmath=True, error_model="numpy")
@no_type_check
def lobes(nl, nv, smith_v, fv, lv, r, a2, full_diffuse, bend, metal):
    """(what albedo multiplies, the rest) towards the camera per unit radiance and solid angle, cosine included.

    Cosines of light and view to the normal and to each other; what depends on the pixel alone comes along: `bend`
    and `metal` as `optics` has them.
    """
    over_pi = np.float32(1 / math.pi)
    half2 = max(np.float32(0.5) + np.float32(0.5) * lv, np.float32(1e-6))  # (l.h)^2
    lh = math.sqrt(half2)
    nh = (nl + nv) / (np.float32(2) * lh)
    t = nh * nh * (a2 - np.float32(1)) + np.float32(1)
    t = max(t, a2)  # n.h exceeds 1 by rounding, or where `nl` is the mean over a lamp that is half set
    g = math.sqrt(bend + half2)
    across = (g - lh) / (g + lh)
    along = (lh * (g + lh) - np.float32(1)) / (lh * (g - lh) + np.float32(1))
    fresnel = np.float32(0.5) * across * across * (np.float32(1) + along * along)
    smith_l = nl + math.sqrt(a2 + (np.float32(1) - a2) * nl * nl)
    facets = a2 * over_pi / (t * t) / (smith_l * smith_v) * nl
    specular = facets * fresnel
    k = np.float32(1)
    if full_diffuse:
        ml = np.float32(1) - nl
        fl = ml * ml * ml * ml * ml
        retro = np.float32(2) * r * half2 - np.float32(0.5)
        k = (np.float32(1) + retro * fl) * (np.float32(1) + retro * fv)
    diffuse = k * over_pi * nl
    if metal > 0:
        away = max(np.float32(1) - lh, np.float32(0))
        white = away * away * away * away * away
        paint = np.float32(1) - metal
        diffuse = paint * diffuse + metal * facets * (np.float32(1) - white)
        specular = paint * specular + metal * facets * white
    return diffuse, specular


@numba.njit(nogil=True, fastmath=True, cache=True, error_model="numpy")
@no_type_check
def _rows(normals, roughness, views, matter, dx, dy, dz, full_diffuse, floor, diffuse, specular):
    for p in range(normals.shape[0]):
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        vx, vy, vz = views[p, 0], views[p, 1], views[p, 2]
        r = roughness[p]
        bend, metal = matter[p, 0], matter[p, 1]
        nv = max(nx * vx + ny * vy + nz * vz, np.float32(1e-3))
        a2 = r * r * r * r + floor
        smith_v = nv + math.sqrt(a2 + (np.float32(1) - a2) * nv * nv)
        mv = np.float32(1) - nv
        fv = mv * mv * mv * mv * mv
        for d in range(dx.shape[0]):
            nl = nx * dx[d] + ny * dy[d] + nz * dz[d]
            nl = max(nl, np.float32(0))
            lv = vx * dx[d] + vy * dy[d] + vz * dz[d]
            diffuse[p, d], specular[p, d] = lobes(nl, nv, smith_v, fv, lv, r, a2, full_diffuse, bend, metal)


def rows(
    normals: Float[np.ndarray, "p 3"],
    roughness: Float[np.ndarray, " p"],
    views: Float[np.ndarray, "p 3"],
    directions: Float[np.ndarray, "d 3"],
    full_diffuse: bool,
    floor: float,
    material: Float[np.ndarray, "p 2"] | None = None,
) -> Float[np.ndarray, "2 p d"]:
    """Diffuse and specular rows of `p` pixels in float32; `floor` from `lobe_floor`; no `material`: all `PAINT`."""
    out = np.empty((2, len(normals), len(directions)), np.float32)
    d = np.ascontiguousarray(directions.T, dtype=np.float32)
    _rows(
        np.ascontiguousarray(normals, np.float32), np.ascontiguousarray(roughness, np.float32),
        np.ascontiguousarray(views, np.float32), optics(material, len(normals)), d[0], d[1], d[2], full_diffuse,
        np.float32(floor), out[0], out[1],
    )  # fmt: skip
    return out
