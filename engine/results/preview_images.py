"""The maps as PNG pictures, each with its meaning written inside and given back as facts.

Normals are drawn as the camera sees them: red right, blue towards the viewer, green up (OpenGL, Blender) or
down (DirectX). Depth keeps sample 0 for "no answer".
"""

import cv2
import numpy as np
from jaxtyping import Float

from engine.errors import ExportError
from engine.io import png
from engine.types import LightProvenance, Surface

NORMALS = ("normal.png", "normal_16.png")
GROUNDS = {
    # sRGB of each `LightProvenance.kind`, in its order; told apart by the colour-blind too (Okabe and Ito 2008)
    "photographed": (0, 158, 115),
    "clipped": (240, 228, 66),
    "guessed": (213, 94, 0),
}

_SRGB_8 = png.to_8_bit(png.srgb(np.arange(65536) / 65535))


def draw(
    surface: Surface, photograph: Float[np.ndarray, "h w 3"], green: str, unit: str
) -> tuple[dict[str, bytes], dict[str, object]]:
    """The files by name, and what their samples mean; `green` is "up" or "down"."""
    mask = surface.mask
    sign = 1.0 if green == "up" else -1.0
    shown = surface.normal * [1.0, -sign, -1.0] * 0.5 + 0.5
    normal = png.to_16_bit(np.where(mask[..., None], shown, [0.5, 0.5, 1.0]))
    normal_text = _normal_text(green)
    known = mask & (surface.depth > 0)
    near, far = (
        (float(surface.depth[known].min()), float(surface.depth[known].max())) if known.any() else (0.0, 0.0)
    )
    steps = (surface.depth - near) / max(far - near, 1e-30)
    depth = np.where(known, 1 + np.round(np.clip(steps, 0, 1) * 65534), 0).astype(np.uint16)
    depth_text = {
        "Description": "depth along z = near + (sample - 1) / 65534 * (far - near); sample 0 is no answer",
        "near": repr(near),
        "far": repr(far),
        "unit": unit,
    }
    stderr = np.degrees(surface.stderr_normal)
    limit = float(np.ceil(max(np.percentile(stderr[mask], 99), 0.1))) if mask.any() else 1.0
    stderr_text = {
        "Description": "one standard error of the normal = sample / 65535 * full_deg",
        "full_deg": repr(limit),
    }
    white = white_of(photograph)
    pictures = {
        "normal.png": png.encode((normal >> 8).astype(np.uint8), "data", normal_text),
        "normal_16.png": png.encode(normal, "data", normal_text),
        "albedo.png": png.encode(png.to_8_bit(png.srgb(surface.albedo)), "srgb"),
        "albedo_linear_16.png": png.encode(
            png.to_16_bit(surface.albedo),
            "linear",
            {"Description": "albedo = sample / 65535, linear Rec.709"},
        ),
        "roughness_16.png": png.encode(
            png.to_16_bit(surface.roughness), "data", {"Description": "roughness = sample / 65535"}
        ),
        **_materials(surface),
        "depth_16.png": png.encode(depth, "data", depth_text),
        "stderr_normal_16.png": png.encode(png.to_16_bit(stderr / limit), "data", stderr_text),
        "mask.png": png.encode(mask.astype(np.uint8) * 255),
        "photograph.png": png.encode(png.to_8_bit(png.srgb(photograph / white)), "srgb"),
    }
    facts: dict[str, object] = {
        "normal": {"green": green},
        "albedo": {"full": 1.0, "encoding": "sRGB"},
        "albedo_linear_16": {"full": 1.0, "encoding": "linear Rec.709"},
        "roughness_16": {"full": 1.0, "alpha": "roughness^2 (GGX)"},
        "depth_16": {"near": near, "far": far, "unit": unit, "no_answer": 0},
        "stderr_normal_16": {"full_deg": limit},
        "photograph": {"radiance_shown_white": white},
    }
    if surface.material is not None:
        facts["specular_16"] = {"full": 1.0, "normal_reflectance": "0.08 specular where metalness is 0"}
        facts["metalness_16"] = {"full": 1.0, "normal_reflectance": "albedo where metalness is 1"}
    return pictures, facts


def white_of(photograph: Float[np.ndarray, "h w 3"]) -> float:
    """The radiance that pictures of views show as white: few pixels are brighter."""
    return float(np.percentile(photograph, 99)) or 1.0


def view(radiance: Float[np.ndarray, "h w 3"], white: float) -> bytes:
    """One photograph as JPEG, for programs that take poses together with pictures: sRGB, nothing brighter than `white`."""
    share = np.clip(radiance * np.float32(65535 / white), 0, 65535).astype(np.uint16)
    quality = [
        cv2.IMWRITE_JPEG_QUALITY,
        95,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]
    bgr = cv2.cvtColor(np.take(_SRGB_8, share), cv2.COLOR_RGB2BGR)
    return cv2.imencode(".jpg", bgr, quality)[1].tobytes()


def _materials(surface: Surface) -> dict[str, bytes]:
    """Nothing where all is of paint."""
    if surface.material is None:
        return {}
    level, metalness = np.moveaxis(surface.material, -1, 0)
    head_on = "where it is no metal; its reflectance head on is 0.08 times that"
    return {
        "specular_16.png": png.encode(
            png.to_16_bit(level), "data", {"Description": f"specular level = sample / 65535, {head_on}"}
        ),
        "metalness_16.png": png.encode(
            png.to_16_bit(metalness), "data", {"Description": "metalness = sample / 65535"}
        ),
    }


def coverage(grounds: LightProvenance) -> bytes:
    """What the panorama's light rests on, in three plain colours, said in the file's text."""
    text = "; ".join(f"{kind}: sRGB {' '.join(map(str, colour))}" for kind, colour in GROUNDS.items())
    return png.encode(np.array(list(GROUNDS.values()), np.uint8)[grounds.kind], "srgb", {"Description": text})


def with_green(data: bytes, green: str) -> bytes:
    """A normal map's file with its green channel turned round, which makes it point `green`: "up" or "down".

    Raises:
        ExportError: the file is damaged.
    """
    samples = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if samples is None or samples.ndim != 3 or samples.shape[2] != 3:
        raise ExportError(
            "a normal map of the finished export is damaged; remove its folder and process again"
        )
    turned = np.ascontiguousarray(samples[..., ::-1])
    full = 65535 if turned.dtype == np.uint16 else 255
    turned[..., 1] = full - turned[..., 1]
    return png.encode(turned, "data", _normal_text(checked(green)))


def checked(green: str) -> str:
    """
    Raises:
        ExportError: neither "up" nor "down".
    """
    if green not in ("up", "down"):
        raise ExportError(f"green of normal maps is {green!r}; choose up (OpenGL) or down (DirectX)")
    return green


def _normal_text(green: str) -> dict[str, str]:
    return {
        "Description": "normals as seen by the camera: red right, blue towards the viewer, green "
        + ("up (OpenGL, Blender)" if green == "up" else "down (DirectX)"),
    }
