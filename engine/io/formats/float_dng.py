"""Read the mosaic of a floating-point DNG, as programs write it that merge exposures.

Source: DNG 1.4 (16, 24 and 32 bits, strips or tiles, deflate, levels), TIFF Technical Note 3 (the predictors for
floating point). LibRaw scales such a mosaic by the brightest pixel of each file and cuts it to 14 bits; tifffile undoes
neither the predictors nor 24 bits without a codec of its own.
"""

import zlib
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from jaxtyping import Float32, Int, UInt8

from engine.errors import RawError, reason
from engine.io.formats.exif import DAMAGE

FLOATS, MOSAIC = 3, 32803  # SampleFormat, PhotometricInterpretation
PLAIN, DEFLATE = (1,), (8, 32946)
SPREAD = {
    3: 1,
    34894: 2,
    34895: 4,
}  # how many samples apart are those of which a predictor took the difference
FULL = 16383.0  # what white becomes: of the size of a camera's own counts

Levels = tuple[float, float, float, float]


def read(
    path: Path, height: int, width: int, pattern: Int[np.ndarray, "2 2"]
) -> tuple[Float32[np.ndarray, "h w"], Levels, Levels] | None:
    """(mosaic, black, white), in units that put white at `FULL`; None where the file's pixels are no floats.

    Args:
        height, width: of the whole sensor, masked edges included.
        pattern: channel of each site of the cell that begins at the first visible pixel.

    Raises:
        RawError: compressed in a way that is not read here, damaged, or with values that are no numbers.
    """
    try:
        with tifffile.TiffFile(path) as tiff:
            pages: list[Any] = [tiff.pages.first, *(tiff.pages.first.pages or ())]
            floats = [page for page in pages if page.sampleformat == FLOATS and page.photometric == MOSAIC]
            if not floats:
                return None
            page = floats[0]
            _check_kind(path, page)
            mosaic = _pixels(page, tiff.byteorder, height, width)
            black, white = _levels(path, page, pattern)
    except (*DAMAGE, zlib.error) as fault:
        raise RawError(f"{path}: the file is cut off or damaged ({reason(fault)}); copy it again") from fault
    bad = int(mosaic.size - np.isfinite(mosaic).sum())
    if bad:
        raise RawError(f"{path}: {bad} of {mosaic.size} values are no numbers; export it again")
    return mosaic * np.float32(FULL / white), black, (FULL, FULL, FULL, FULL)


def _check_kind(path: Path, page: tifffile.TiffPage) -> None:
    known = page.compression in (*PLAIN, *DEFLATE) and page.predictor in (1, *SPREAD)
    if not known or page.bitspersample not in (16, 24, 32) or page.samplesperpixel != 1:
        raise RawError(
            f"{path}: a floating-point DNG of {page.bitspersample} bits, compression {int(page.compression)}, predictor"
            f" {int(page.predictor)}, is not supported; write it uncompressed or with deflate, or as linear EXR"
        )


def _pixels(page: tifffile.TiffPage, byteorder: str, height: int, width: int) -> Float32[np.ndarray, "h w"]:
    """The strips or tiles put together; those at the edges are whole, or as short as the picture."""
    rows, columns = page.chunks
    size = page.bitspersample // 8
    mosaic = np.empty((height, width), np.float32)
    places = [(y, x) for y in range(0, height, rows) for x in range(0, width, columns)]
    for (y, x), at, length in zip(places, page.dataoffsets, page.databytecounts, strict=True):
        page.parent.filehandle.seek(at)
        data = page.parent.filehandle.read(length)
        high = rows if page.is_tiled else min(rows, height - y)
        if page.compression in DEFLATE:
            data = zlib.decompressobj().decompress(data, high * columns * size)
        samples = np.frombuffer(data, np.uint8, high * columns * size)
        if page.predictor in SPREAD:
            steps = samples.reshape(high, -1, SPREAD[page.predictor])
            planes = np.cumsum(steps, axis=1, dtype=np.uint8).reshape(high, size, columns)
            samples = planes.transpose(
                0, 2, 1
            )  # the planes have each sample's highest byte first, whatever the file has
        else:
            samples = samples.reshape(high, columns, size)[..., :: 1 if byteorder == ">" else -1]
        tile = _floats(np.ascontiguousarray(samples))
        mosaic[y : y + rows, x : x + columns] = tile[: height - y, : width - x]
    return mosaic


def _floats(samples: UInt8[np.ndarray, "h w b"]) -> Float32[np.ndarray, "h w"]:
    """Of bytes, the highest first."""
    if samples.shape[2] != 3:
        return samples.view(f">f{samples.shape[2]}")[..., 0].astype(np.float32)
    # 24 bits: sign, 7 bits of exponent about 63, 16 of mantissa. A float of 32 has 8 about 127, and 23.
    bits = np.pad(samples, ((0, 0), (0, 0), (1, 0))).view(">u4")[..., 0].astype(np.uint32)
    return ((bits & 0x800000) << 8 | (bits & 0x7FFFFF) << 7).view(np.float32) * np.float32(2.0**64)


def _levels(path: Path, page: tifffile.TiffPage, pattern: Int[np.ndarray, "2 2"]) -> tuple[Levels, float]:
    """(black of each channel in units that put white at `FULL`, white as the file has it: 1 where it does not tell)."""
    cell = np.zeros((2, 2))
    if "BlackLevel" in page.tags:
        dims = page.tags["BlackLevelRepeatDim"].value if "BlackLevelRepeatDim" in page.tags else (1, 1)
        blacks = np.asarray(_numbers(page.tags["BlackLevel"])).reshape(dims)
        if 2 % dims[0] or 2 % dims[1]:
            raise RawError(
                f"{path}: black levels of a pattern of {dims[0]} x {dims[1]} are not supported; export linear EXR"
            )
        cell = np.tile(blacks, (2 // dims[0], 2 // dims[1]))
    white = _numbers(page.tags["WhiteLevel"])[0] if "WhiteLevel" in page.tags else 1.0
    black = np.zeros(4)
    black[pattern] = cell
    if not white > black.max():
        raise RawError(f"{path}: white level {white:g} is not above black {black.max():g}; export it again")
    black *= FULL / white
    return (float(black[0]), float(black[1]), float(black[2]), float(black[3])), white


def _numbers(tag: tifffile.TiffTag) -> list[float]:
    values = tag.value if isinstance(tag.value, tuple) else (tag.value,)
    if tag.dtype in (tifffile.DATATYPE.RATIONAL, tifffile.DATATYPE.SRATIONAL):
        return [top / bottom for top, bottom in zip(values[::2], values[1::2], strict=True)]
    return [float(value) for value in values]
