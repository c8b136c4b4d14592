"""PNG files with 8 or 16 bits a sample, colour or grey, with the facts a reader needs as text inside.

Source: PNG (Third Edition), W3C 2025. Sample values are the caller's; `transfer` says what they mean:
"srgb" colours to look at, "linear" radiometric colours, "data" no colours at all.
"""

import struct
import zlib
from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8, UInt16

from engine.errors import ExportError


def encode(
    samples: UInt8[np.ndarray, "h w *c"] | UInt16[np.ndarray, "h w *c"],
    transfer: str = "data",
    text: Mapping[str, str] | None = None,
) -> bytes:
    """The file's bytes; `samples` is h x w (grey) or h x w x 3 (colour)."""
    colour = {2: 0, 3: 2}.get(samples.ndim)
    if colour is None or (colour == 2 and samples.shape[2] != 3):
        raise ExportError(f"a PNG holds h x w or h x w x 3 samples, not {samples.shape}")
    height, width = samples.shape[:2]
    depth = 8 * samples.itemsize
    rows = np.ascontiguousarray(samples.astype(samples.dtype.newbyteorder(">"))).view(np.uint8)
    rows = rows.reshape(height, -1)
    # Filter 2 ("up"): each byte less the one above, modulo 256; smooth maps then deflate well.
    up = rows - np.concatenate([np.zeros_like(rows[:1]), rows[:-1]])
    body = np.concatenate([np.full((height, 1), 2, np.uint8), up], axis=1).tobytes()
    chunks = [_chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))]
    if transfer == "srgb":
        chunks.append(_chunk(b"sRGB", b"\0"))
    elif transfer == "linear":
        chunks.append(_chunk(b"gAMA", struct.pack(">I", 100000)))
    chunks += [_text(key, value) for key, value in (text or {}).items()]
    chunks += [_chunk(b"IDAT", zlib.compress(body, 6)), _chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light in 0..1 to sRGB's encoded 0..1 (IEC 61966-2-1); values outside are brought to the ends."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-12) ** (1 / 2.4) - 0.055)


def to_8_bit(values: np.ndarray) -> np.ndarray:
    """0..1 to 0..255, rounded; values outside are brought to the ends."""
    return np.round(np.clip(values, 0.0, 1.0) * 255).astype(np.uint8)


def to_16_bit(values: np.ndarray) -> np.ndarray:
    """0..1 to 0..65535, rounded; values outside are brought to the ends."""
    return np.round(np.clip(values, 0.0, 1.0) * 65535).astype(np.uint16)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _text(key: str, value: str) -> bytes:
    # iTXt, not tEXt: view names may hold any letter.
    return _chunk(b"iTXt", key.encode("latin-1") + b"\0\0\0\0\0" + value.encode())
