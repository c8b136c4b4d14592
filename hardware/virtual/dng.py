"""Write a Bayer mosaic as a DNG file that LibRaw (and any RAW developer) opens like a camera's own.

Source: Adobe DNG specification 1.4, TIFF 6.0, Exif 2.3. Two directories (image, Exif) and one strip, losslessly
compressed as cameras do (ITU-T T.81, process 14). The file is laid out here rather than by a TIFF library because
LibRaw takes ISO from the Exif directory only, which such a library cannot nest. The mosaic is RGGB; levels are counts;
the colour matrix maps CIE XYZ under D65 to camera RGB.
"""

import datetime
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import imagecodecs
import numpy as np
from jaxtyping import Float, UInt16

from hardware.errors import StudioError

# TIFF field types, by their numbers in TIFF 6.0.
BYTE, ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SRATIONAL = 1, 2, 3, 4, 5, 7, 10
CODES = {BYTE: "B", ASCII: "B", SHORT: "H", LONG: "I", RATIONAL: "I", UNDEFINED: "B", SRATIONAL: "i"}
HEADER_BYTES = 8

Tag = tuple[int, int, Sequence[int]]  # number, type, values; a fraction takes two of them

D65 = 21  # EXIF light source
CFA_PHOTOMETRIC = 32803


MAKE, MODEL = "Roomlight", "Roomlight Virtual One"


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """One exposure with the facts a camera would write beside it."""

    mosaic: UInt16[np.ndarray, "h w"]  # RGGB, even height and width
    black: int  # counts
    white: int  # counts
    camera_from_xyz: Float[np.ndarray, "3 3"]  # under D65
    neutral: tuple[float, float, float]  # camera RGB of a white sheet as the camera judged it, G = 1
    shutter_s: float
    iso: int
    aperture: float  # f-number
    time: datetime.datetime  # start of the exposure, local time
    make: str = MAKE
    model: str = MODEL


def write(path: Path, photograph: Photograph) -> None:
    """Write `photograph` to `path`.

    Raises:
        StudioError: odd size, or counts above the white level that the file could not mean.
    """
    h, w = photograph.mosaic.shape
    if h % 2 or w % 2:
        raise StudioError(f"{path}: {w} x {h} cuts a Bayer cell in two; use an even width and height")
    peak = int(photograph.mosaic.max(initial=0))
    if peak > photograph.white:
        raise StudioError(f"{path}: count {peak} is above the white level {photograph.white}; clip it first")

    # Two rows beside each other: what is predicted from then has the same colour (DNG 1.4, page 23), which halves the file.
    pixels = imagecodecs.ljpeg_encode(photograph.mosaic.reshape(h // 2, 2 * w), bitspersample=16)
    exif_tags = _exif(photograph)
    # The offsets inside do not change the size of a directory, so one dry run tells where things will lie.
    exif_at = HEADER_BYTES + len(_directory(_image(photograph, 0, 0, 0), HEADER_BYTES))
    strip_at = exif_at + len(_directory(exif_tags, exif_at))
    path.write_bytes(
        struct.pack("<2sHI", b"II", 42, HEADER_BYTES)
        + _directory(_image(photograph, exif_at, strip_at, len(pixels)), HEADER_BYTES)
        + _directory(exif_tags, exif_at)
        + pixels
    )


def _image(photograph: Photograph, exif_at: int, strip_at: int, strip_bytes: int) -> list[Tag]:
    """The image directory: what the pixels are and what they mean."""
    h, w = photograph.mosaic.shape
    return [
        (254, LONG, [0]),  # NewSubfileType: the main image
        (256, LONG, [w]),
        (257, LONG, [h]),
        (258, SHORT, [16]),  # BitsPerSample
        (259, SHORT, [7]),  # Compression: lossless JPEG
        (262, SHORT, [CFA_PHOTOMETRIC]),
        (271, ASCII, _text(photograph.make)),
        (272, ASCII, _text(photograph.model)),
        (273, LONG, [strip_at]),
        (274, SHORT, [1]),  # Orientation: as the sensor lies
        (277, SHORT, [1]),  # SamplesPerPixel
        (278, LONG, [h]),  # RowsPerStrip
        (279, LONG, [strip_bytes]),  # StripByteCounts
        (284, SHORT, [1]),  # PlanarConfiguration: contiguous
        (306, ASCII, _text(photograph.time.strftime("%Y:%m:%d %H:%M:%S"))),
        (33421, SHORT, [2, 2]),  # CFARepeatPatternDim
        (33422, BYTE, [0, 1, 1, 2]),  # CFAPattern: red green, green blue
        (33434, RATIONAL, _fractions([photograph.shutter_s])),
        (33437, RATIONAL, _fractions([photograph.aperture])),
        (34665, LONG, [exif_at]),
        (50706, BYTE, [1, 4, 0, 0]),  # DNGVersion
        (50707, BYTE, [1, 1, 0, 0]),  # DNGBackwardVersion
        (50708, ASCII, _text(photograph.model)),  # UniqueCameraModel
        (50713, SHORT, [2, 2]),  # BlackLevelRepeatDim
        (50714, SHORT, [photograph.black] * 4),
        (50717, LONG, [photograph.white]),
        (50721, SRATIONAL, _fractions(photograph.camera_from_xyz.ravel().tolist())),  # ColorMatrix1
        (50728, RATIONAL, _fractions(photograph.neutral)),  # AsShotNeutral
        (50778, SHORT, [D65]),  # CalibrationIlluminant1
    ]


def _exif(photograph: Photograph) -> list[Tag]:
    """The Exif directory: how the photograph was taken."""
    return [
        (33434, RATIONAL, _fractions([photograph.shutter_s])),
        (33437, RATIONAL, _fractions([photograph.aperture])),
        (34855, SHORT, [photograph.iso]),
        (36864, UNDEFINED, list(b"0230")),  # ExifVersion
        (36867, ASCII, _text(photograph.time.strftime("%Y:%m:%d %H:%M:%S"))),
        (37521, ASCII, _text(f"{photograph.time.microsecond // 1000:03d}")),  # milliseconds
    ]


def _directory(tags: list[Tag], at: int) -> bytes:
    """One TIFF directory to lie at byte `at`, followed by the values too long for its entries."""
    entries, tail = b"", b""
    tail_at = at + 2 + 12 * len(tags) + 4
    for number, kind, values in tags:
        packed = struct.pack(f"<{len(values)}{CODES[kind]}", *values)
        count = len(values) // 2 if kind in (RATIONAL, SRATIONAL) else len(values)
        if len(packed) <= 4:
            field = packed.ljust(4, b"\0")
        else:
            field = struct.pack("<I", tail_at + len(tail))
            tail += packed + b"\0" * (len(packed) % 2)
        entries += struct.pack("<HHI", number, kind, count) + field
    return struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0) + tail


def _text(text: str) -> list[int]:
    return list(text.encode("ascii") + b"\0")


def _fractions(values: Sequence[float]) -> list[int]:
    """Numerator and denominator of each; denominators to a million keep nine digits of a shutter time."""
    parts = [Fraction(value).limit_denominator(1_000_000) for value in values]
    return [number for part in parts for number in (part.numerator, part.denominator)]
