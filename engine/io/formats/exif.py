"""What a photograph's header says: the tags of TIFF and Exif, in the file itself or inside its container.

Source: TIFF 6.0, Exif 2.3. Nearly every RAW format carries such a header, some (Canon CR3) one for the camera and one
for the exposure. Olympus and Panasonic write TIFF under a mark of their own.
"""

import datetime
import io
import logging
import math
import re
import struct
from pathlib import Path
from typing import Any

import tifffile

HEADER_BYTES = 1 << 18  # containers have theirs near the beginning
LONGEST_TAG = 1 << 16  # makers' private notes are longer
HEADERS = 8  # previews carry headers too; the camera's own come first
MARKS = re.compile(rb"II\*\0|MM\0\*")
OWN_MARKS = {b"IIRO": b"II*\0", b"IIRS": b"II*\0", b"IIU\0": b"II*\0", b"MMOR": b"MM\0*"}
ISO_TAGS = (  # in the order in which they are believed; the first, of 16 bits, ends at NO_ISO
    "ISOSpeedRatings", "PhotographicSensitivity", "RecommendedExposureIndex", "ISOSpeed", "StandardOutputSensitivity",
)  # fmt: skip
NO_ISO = 65535  # Exif 2.3: the true one is too large for the tag
# What tifffile raises of a damaged file. MemoryError: a tag says that it holds gigabytes.
DAMAGE = (
    tifffile.TiffFileError, OSError, ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError,
    MemoryError, struct.error,
)  # fmt: skip

# Its remarks on other people's tags are no news to whoever imports; what matters is refused by name.
logging.getLogger("tifffile").setLevel(logging.CRITICAL)


def read_tags(path: Path) -> tuple[dict[str, Any], int]:
    """(tags by their names, end): the first header to have a tag is believed.

    `end` is the byte after the last strip or tile of pixels that a header at the file's very beginning lists; 0 without one.

    Raises:
        OSError: it is not there or cannot be read.
    """
    tags: dict[str, Any] = {}
    end = 0
    with path.open("rb") as file:
        begin = file.read(HEADER_BYTES)
        if begin[:4] in OWN_MARKS:
            tags = _tags(io.BytesIO(OWN_MARKS[begin[:4]] + begin[4:]))
        for mark in list(MARKS.finditer(begin))[:HEADERS]:
            at = mark.start()
            found = _tags(io.BytesIO(begin[at:]) if at else path)
            end = end if at else _data_end(found)
            tags = found | tags
    return tags, end


def number(value: object) -> float:
    """A tag's number or fraction; NaN for anything else."""
    if isinstance(value, tuple) and len(value) == 2 and value[1]:
        return float(value[0]) / float(value[1])
    return float(value) if isinstance(value, int | float) else math.nan


def iso(tags: dict[str, Any]) -> float:
    """Sensitivity; NaN where none is told. A tag may hold several numbers, or nought for "see elsewhere"."""
    for name in ISO_TAGS:
        value = tags.get(name)
        values = value if isinstance(value, tuple) else (value,)
        told = [one for one in values if isinstance(one, int | float) and one > 0]
        if told and told[0] != NO_ISO:
            return float(told[0])
    return math.nan


def camera(tags: dict[str, Any]) -> str:
    """Make and model; "" where neither is told."""
    make, model = (str(tags.get(name, "")).strip("\0 ") for name in ("Make", "Model"))
    return (model if model.startswith(make) else f"{make} {model}").strip()


def clock_s(tags: dict[str, Any]) -> float:
    """Start of the exposure, seconds since 1970; its digits count as they stand, for Exif knows no time zone."""
    try:
        stamp = str(tags.get("DateTimeOriginal", "")).strip("\0 ")
        moment = datetime.datetime.strptime(stamp, "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return math.nan
    digits = str(tags.get("SubsecTimeOriginal", "")).strip("\0 ")
    part_s = float(f"0.{digits}") if digits.isdigit() else 0.0
    return moment.replace(tzinfo=datetime.UTC).timestamp() + part_s


def _tags(source: io.BytesIO | Path) -> dict[str, Any]:
    """Tags of the first directory, and over them those of its Exif directory."""
    tags: dict[str, Any] = {}
    try:
        with tifffile.TiffFile(source) as tiff:
            for tag in tiff.pages.first.tags.values():
                if tag.count <= LONGEST_TAG:
                    tags[tag.name] = tag.value
    except DAMAGE:
        pass  # a chance likeness, or cut off: LibRaw has the last word on whether the file is damaged
    nested = tags.get("ExifTag")
    return tags | nested if isinstance(nested, dict) else tags


def _data_end(tags: dict[str, Any]) -> int:
    ends = [0]
    for kind in ("Strip", "Tile"):
        offsets, lengths = tags.get(f"{kind}Offsets"), tags.get(f"{kind}ByteCounts")
        if isinstance(offsets, tuple) and isinstance(lengths, tuple):
            ends += [at + length for at, length in zip(offsets, lengths, strict=False)]
    return max(ends)
