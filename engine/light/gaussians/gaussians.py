"""What one Gaussian is: its frame, its radiance, and how the usual 3DGS file writes it.

Source: the paper, Eq. (2) and (4); spherical harmonics after Sloan, "Stupid Spherical Harmonics Tricks"
(2008); the 3DGS layout after Kerbl et al. (2023). World frame, scene units, linear radiance.

The usual 3DGS file has alpha = o exp(-q/2), ours is 1 - exp(-density exp(-q)). Peaks are matched exactly
(o = 1 - exp(-density)), and the file's scale is chosen so that both cover the same area in any plane
(our profile is flatter on top). Both maps are one-to-one, so a file reads back as it was written. The
file's colours stay linear radiance, beyond 1 where a lamp is; its offset of 0.5 is honoured.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import exp1

from engine.errors import LightError
from engine.types import Gaussians

Y00 = 0.28209479177387814
_EULER = 0.5772156649015329


def rotations(quaternions: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 3 3"]:
    """Rotation matrices of quaternions (w, x, y, z) of any length but zero."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def part(gaussians: Gaussians, index: Int[np.ndarray, " j"] | Bool[np.ndarray, " k"] | slice) -> Gaussians:
    """Some of them."""
    return Gaussians(*(getattr(gaussians, name)[index] for name in Gaussians.__slots__))


def joined(first: Gaussians, second: Gaussians) -> Gaussians:
    """Both, in this order and in the first one's precision."""
    both = ((getattr(first, name), getattr(second, name)) for name in Gaussians.__slots__)
    return Gaussians(*(np.concatenate([a, b.astype(a.dtype)]) for a, b in both))


def isotropic_gaussians(
    means: Float[np.ndarray, "k 3"],
    quaternions: Float[np.ndarray, "k 4"],
    scales: Float[np.ndarray, "k 3"],
    density: float,
    colours: Float[np.ndarray, "k 3"],
    coefficients: int,
) -> Gaussians:
    """Gaussians that look alike from every side, in a basis of so many coefficients."""
    radiance = np.zeros((len(means), coefficients, 3))
    radiance[:, 0] = colours / Y00
    return Gaussians(means, quaternions, scales, np.full(len(means), density), radiance)


def sh_degree(coefficients: int) -> int:
    """Degree of a spherical-harmonic basis with that many functions.

    Raises:
        LightError: the count is not 1, 4, 9 or 16.
    """
    if coefficients not in (1, 4, 9, 16):
        raise LightError(
            f"a Gaussian holds {coefficients} radiance coefficients, not 1, 4, 9 or 16; read the light again"
        )
    return round(coefficients**0.5) - 1


def sh_basis(directions: Float[np.ndarray, "*n 3"], degree: int) -> Float[np.ndarray, "*n b"]:
    """Real spherical harmonics up to `degree` (at most 3), Sloan's order and signs."""
    x, y, z = np.moveaxis(directions, -1, 0)
    basis = [np.full_like(x, Y00)]
    if degree >= 1:
        basis += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree >= 2:
        basis += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (3 * z * z - 1),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (x * x - y * y),
        ]
    if degree >= 3:
        basis += [
            -0.5900435899266435 * y * (3 * x * x - y * y),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (5 * z * z - 1),
            0.3731763325901154 * z * (5 * z * z - 3),
            -0.4570457994644658 * x * (5 * z * z - 1),
            1.445305721320277 * z * (x * x - y * y),
            -0.5900435899266435 * x * (x * x - 3 * y * y),
        ]
    return np.stack(basis, axis=-1)


def radiance_towards(gaussians: Gaussians, origin: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "k 3"]:
    """Radiance of every Gaussian as seen from `origin`, never negative.

    The direction v of c_k(v) is taken at the Gaussian's mean, as 3DGS does, not anew for every ray; a
    primitive is small against its distance, and probes then see what the photographs saw.
    """
    degree = sh_degree(gaussians.radiance.shape[1])
    if degree == 0:
        return np.maximum(gaussians.radiance[:, 0] * Y00, 0)
    towards = gaussians.means - origin
    towards = towards / np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    basis = sh_basis(towards, degree)
    return np.maximum(np.einsum("kb,kbc->kc", basis, gaussians.radiance), 0)


def _covered_area(density: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Integral of 1 - exp(-density exp(-r^2)) over the plane, divided by pi."""
    small = density < 1e-3  # the closed form cancels there; its series does not
    safe = np.where(small, 1.0, density)
    return np.where(small, density - density**2 / 4, _EULER + np.log(safe) + exp1(safe))


def to_3dgs(gaussians: Gaussians) -> dict[str, Float[np.ndarray, " k"]]:
    """One column per property of the usual 3DGS .ply, float32, in the order such files use."""
    k, b, _ = gaussians.radiance.shape
    sh_degree(b)
    density = gaussians.density.astype(np.float64)
    opacity = -np.expm1(-density)
    factor = np.sqrt(_covered_area(density) / (2 * opacity))
    quaternions = gaussians.quaternions / np.linalg.norm(gaussians.quaternions, axis=1, keepdims=True)
    columns: dict[str, np.ndarray] = {axis: gaussians.means[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"n{axis}": np.zeros(k) for axis in "xyz"}
    columns |= {f"f_dc_{c}": gaussians.radiance[:, 0, c] - 0.5 / Y00 for c in range(3)}
    rest = np.swapaxes(gaussians.radiance[:, 1:], 1, 2).reshape(k, -1)
    columns |= {f"f_rest_{i}": rest[:, i] for i in range(rest.shape[1])}
    columns["opacity"] = np.log(np.expm1(np.minimum(density, 700.0)))  # the logit of 1 - exp(-density)
    columns |= {f"scale_{i}": np.log(gaussians.scales[:, i] * factor) for i in range(3)}
    columns |= {f"rot_{i}": quaternions[:, i] for i in range(4)}
    return {name: np.ascontiguousarray(column, dtype=np.float32) for name, column in columns.items()}


def from_3dgs(columns: dict[str, np.ndarray]) -> Gaussians:
    """The light from the columns of a 3DGS .ply; the inverse of `to_3dgs`.

    Raises:
        LightError: a property is missing.
    """
    needed = [
        "x",
        "y",
        "z",
        "opacity",
        *(f"{n}_{i}" for n, m in (("f_dc", 3), ("scale", 3), ("rot", 4)) for i in range(m)),
    ]
    missing = [name for name in needed if name not in columns]
    if missing:
        raise LightError(
            f"not a 3DGS file: no property {', '.join(missing)}; export it as the usual 3DGS .ply"
        )
    wide = {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}
    density = np.maximum(np.logaddexp(0, wide["opacity"]), 1e-12)
    factor = np.sqrt(_covered_area(density) / (2 * -np.expm1(-density)))
    count = sum(name.startswith("f_rest_") for name in wide)
    sh_degree(1 + count // 3)
    dc = np.stack([wide[f"f_dc_{c}"] for c in range(3)], axis=1) + 0.5 / Y00
    k = len(dc)
    rest = np.stack([wide[f"f_rest_{i}"] for i in range(count)], axis=1) if count else np.zeros((k, 0))
    rest = np.swapaxes(rest.reshape(k, 3, -1), 1, 2)
    return Gaussians(
        means=np.stack([wide[a] for a in "xyz"], axis=1),
        quaternions=np.stack([wide[f"rot_{i}"] for i in range(4)], axis=1),
        scales=np.exp(np.stack([wide[f"scale_{i}"] for i in range(3)], axis=1)) / factor[:, None],
        density=density,
        radiance=np.concatenate([dc[:, None], rest], axis=1),
    )
