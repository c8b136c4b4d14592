"""Numbers as pictures for the screen: exposure and tone curve of radiance, colour scales of maps, normals, flags.

A picture is uint8 [h w 4] in the byte order blue, green, red, alpha, colours multiplied by alpha: what Qt draws
without converting (ARGB32_Premultiplied on little-endian machines). Transparent where there is no answer. No Qt
here.

Colour scales: viridis and magma (S. van der Walt, N. Smith, CC0), cividis (J. Nunez et al. 2018, CC0), sampled at
17 places; the signed one is our own, equally dark at equal distance from zero.
"""

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int16, Shaped, UInt8

from engine.io.png import srgb

SCALES = {
    "viridis": "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b"
    " addc30 d8e219 fde725",
    "magma": "000004 0a0822 1d1147 36106b 51127c 6a1c81 832681 9c2e7f b73779 d0416f e75263 f56b5c fc8961 fea772"
    " fec488 fde2a3 fcfdbf",
    "cividis": "00224e 002e6a 1a386f 32436d 434e6c 535a6d 61656f 6f7073 7d7c78 8c8878 9b9476 aba072 bcae6c cdbb63"
    " dec958 f0d846 fee838",
    "signed": "123f7d 2b6cb5 6ba4d5 b4d1e9 f4f2ef f3c1aa df8266 c13e3a 7d1226",
    "grey": "000000 ffffff",
}

MINUS = "\u2212"  # a true minus, as wide as a plus
LOG_STOPS = 12.0  # range of the logarithmic curve below white
FLAGS = (
    (1, "grazing", "e69f00"),
    (2, "shadowed in most views", "0072b2"),
    (4, "saturated", "cc3311"),
    (8, "ill-conditioned", "cc79a7"),
    (16, "lit by what no photograph shows", "009e73"),
)
"""Bits of Surface.flags: bit, meaning, colour (Okabe and Ito's: told apart by colour-blind people too)."""
CLIPPED = (235, 64, 52)  # red: what is there is a lower bound
UNFLAGGED = (92, 92, 92)
SEVERAL = "f2f2f2"  # more than one flag

NORMAL_FRAMES = ("opengl", "directx", "camera")
"""opengl: x right, y up, z to the viewer. directx: y down, for pictures only. camera: ours, x right, y down, z away."""


@dataclass(frozen=True, slots=True)
class Scale:
    """How a map's numbers become colours, and what stands at its legend."""

    low: float
    high: float
    unit: str
    colours: str  # a key of SCALES


@functools.cache
def table(colours: str, count: int = 256) -> UInt8[np.ndarray, "k 3"]:
    """A colour scale from low to high, red, green, blue."""
    stops = np.array([_rgb(text) for text in SCALES[colours].split()], float)
    at = np.linspace(0, len(stops) - 1, count)
    mixed = np.stack([np.interp(at, np.arange(len(stops)), stops[:, c]) for c in range(3)], axis=1)
    return np.rint(mixed).astype(np.uint8)


def bar(colours: str) -> UInt8[np.ndarray, "1 k 4"]:
    """A colour scale as a picture one pixel high."""
    return _bgra(table(colours)[None], None)


def scalar(
    values: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"], scale: Scale
) -> UInt8[np.ndarray, "h w 4"]:
    """A map of numbers; those beyond the scale take its end's colour, NaN is transparent."""
    known = mask & np.isfinite(values)
    share = (np.where(known, values, scale.low) - scale.low) / max(scale.high - scale.low, 1e-30)
    index = np.rint(np.clip(share, 0, 1) * 255).astype(np.uint8)
    return _bgra(table(scale.colours)[index], known)


def normals(
    camera_normals: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], frame: str
) -> UInt8[np.ndarray, "h w 4"]:
    """0.5 + 0.5 n as red, green, blue, of the normals expressed in `frame`."""
    shown = in_frame(camera_normals, frame)
    return _bgra(np.rint(255 * np.clip(0.5 + 0.5 * shown, 0, 1)).astype(np.uint8), mask)


def in_frame(camera_normals: Shaped[np.ndarray, "*batch 3"], frame: str) -> Shaped[np.ndarray, "*batch 3"]:
    """Normals of our camera frame (x right, y down, z away) in one of NORMAL_FRAMES."""
    signs = {"opengl": (1, -1, -1), "directx": (1, 1, -1), "camera": (1, 1, 1)}[frame]
    return camera_normals * np.array(signs, np.float32)


def radiance(
    values: Float[np.ndarray, "h w 3"],
    white: float,
    exposure_ev: float = 0.0,
    tone: str = "srgb",
    mask: Bool[np.ndarray, "h w"] | None = None,
    clipped: Bool[np.ndarray, "h w"] | None = None,
) -> UInt8[np.ndarray, "h w 4"]:
    """Light as a screen shows it.

    Args:
        white: the radiance that becomes white at 0 EV.
        tone: "srgb" (what is brighter than white stays white) or "log" (LOG_STOPS stops, lamps and shadows both).
        mask: transparent elsewhere.
        clipped: drawn in red: the photographs give a lower bound there.
    """
    curve, top = _curve(tone)
    index = np.clip(np.asarray(values, np.float32) * np.float32(2.0**exposure_ev / max(white, 1e-30)), 0, 1)
    # The table is looked up by square root: even steps for the eye, with an 8-bit step nowhere skipped.
    shown = curve[(np.sqrt(index) * top).astype(np.uint16)]
    if clipped is not None:
        shown[clipped] = CLIPPED
    return _bgra(shown, mask)


def colour(values: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 4"]:
    """Linear colours from 0 to 1, sRGB-encoded."""
    return radiance(values, 1.0, mask=mask)


def flags(bits: UInt8[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 4"]:
    """One colour a flag, another where several are set."""
    lookup = np.empty((256, 3), np.uint8)
    lookup[:] = _rgb(SEVERAL)
    lookup[0] = UNFLAGGED
    for bit, _, text in FLAGS:
        lookup[bit] = _rgb(text)
    return _bgra(lookup[bits], mask)


def parts(numbers: Int16[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 4"]:
    """One colour a part of the depth, those that are too small to be told grey."""
    lookup = np.array([UNFLAGGED, *(_rgb(text) for _, _, text in FLAGS)], np.uint8)
    place = np.where(numbers > 0, (numbers - 1) % len(FLAGS) + 1, 0)
    return _bgra(lookup[place], mask)


def told_flags(bits: int) -> str:
    """The flags of one pixel in words."""
    return ", ".join(name for bit, name, _ in FLAGS if bits & bit) or "none"


def plain(mask: Bool[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 4"]:
    """A mask: the object light, the rest dark, both opaque."""
    grey = np.where(mask, 235, 40).astype(np.uint8)
    return _bgra(np.repeat(grey[..., None], 3, 2), None)


def halves(picture: UInt8[np.ndarray, "h w 4"], smallest: int = 64) -> list[UInt8[np.ndarray, "h w 4"]]:
    """The picture, and again and again at half the size: what is drawn small is drawn from a small one."""
    levels = [picture]
    while min(levels[-1].shape[:2]) >= 2 * smallest:
        last = levels[-1]
        height, width = last.shape[0] // 2 * 2, last.shape[1] // 2 * 2
        cut = last[:height, :width].astype(np.uint16)
        fours = cut[0::2, 0::2] + cut[1::2, 0::2] + cut[0::2, 1::2] + cut[1::2, 1::2]
        levels.append(((fours + 2) // 4).astype(np.uint8))
    return levels


@functools.cache
def _curve(tone: str) -> tuple[UInt8[np.ndarray, " k"], np.float32]:
    top = 65535
    linear = (np.arange(top + 1) / top) ** 2
    logarithm = 1 + np.log2(np.maximum(linear, 1e-12)) / LOG_STOPS
    code = np.clip(logarithm, 0, 1) if tone == "log" else srgb(linear)
    return np.rint(255 * code).astype(np.uint8), np.float32(top)


def _rgb(text: str) -> tuple[int, int, int]:
    return int(text[:2], 16), int(text[2:4], 16), int(text[4:], 16)


def _bgra(
    rgb: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"] | None
) -> UInt8[np.ndarray, "h w 4"]:
    out = np.empty((*rgb.shape[:2], 4), np.uint8)
    out[..., :3] = rgb[..., ::-1]
    out[..., 3] = 255
    if mask is not None:
        out[~mask] = 0
    return out
