"""What a photograph says of itself: exposure, time and camera, read from its header.

Source: TIFF 6.0 and Exif 2.3. JPEG, DNG and the makers' RAW files carry one TIFF header or more, itself or inside
a container (Canon's CR3 has one for the camera and one for the exposure), near their beginning. LibRaw is asked where
there is none that we can read.
"""

import datetime
import io
import logging
import math
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tifffile

HEADER_BYTES = 1 << 18
HEADERS = 4  # previews carry headers too; the camera's own come first
RAW_SUFFIXES = frozenset(
    f".{suffix}"
    for line in (
        "3fr ari arw bay cap cr2 cr3 crw dcr dcs dng drf eip erf fff gpr iiq k25 kdc mdc mef mos",
        "mrw nef nrw orf pef ptx pxn r3d raf raw rw2 rwl rwz sr2 srf srw x3f",
    )
    for suffix in line.split()
)
JPEG_SUFFIXES = frozenset({".jpg", ".jpeg"})
ISO_TAGS = (  # in the order in which they are believed
    "ISOSpeedRatings", "PhotographicSensitivity", "RecommendedExposureIndex", "ISOSpeed", "StandardOutputSensitivity",
)  # fmt: skip
NO_ISO = 65535  # of 16 bits: the true one is in one of the other tags

# Its remarks on tags that makers write their own way are no news to whoever photographs.
logging.getLogger("tifffile").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Exif:
    """None for what it does not say."""

    shutter_s: float | None
    iso: float | None
    aperture: float | None  # f-number
    time_s: float | None  # start of the exposure, camera clock, seconds since 1970 without a time zone
    camera: str  # maker, model and serial number as far as told; "" otherwise

    def light_ev(self) -> float | None:
        """Light gathered, EV relative to 1 s at ISO 100 and f/1; None without shutter time."""
        if self.shutter_s is None:
            return None
        return math.log2(self.shutter_s * (self.iso or 100) / 100 / (self.aperture or 1.0) ** 2)


def read(path: Path) -> Exif:
    """What `path` says of itself; a file that says nothing, or is none of ours, is no error.

    Raises:
        OSError: it is not there or cannot be read.
    """
    with path.open("rb") as file:
        tags = _tags(file.read(HEADER_BYTES))
    shutter_s, iso, aperture = (
        _number(tags.get("ExposureTime")),
        _iso(tags),
        _number(tags.get("FNumber")),
    )
    if (shutter_s is None or iso is None) and path.suffix.lower() in RAW_SUFFIXES:
        others = _libraw(path)
        shutter_s, iso, aperture = (
            own or other for own, other in zip((shutter_s, iso, aperture), others, strict=True)
        )
    maker, model = (str(tags.get(name, "")).strip("\0 ") for name in ("Make", "Model"))
    names = [model if model.startswith(maker) else f"{maker} {model}", str(tags.get("BodySerialNumber", ""))]
    camera = " ".join(name.strip("\0 ") for name in names).strip()
    clock = _clock_s(str(tags.get("DateTimeOriginal", "")), str(tags.get("SubsecTimeOriginal", "")))
    return Exif(shutter_s, iso, aperture, clock, camera)


def _tags(begin: bytes) -> dict[str, Any]:
    """The tags of all headers; the first to name one is believed."""
    found: dict[str, Any] = {}
    for mark in list(re.finditer(rb"II\*\0|MM\0\*", begin))[:HEADERS]:
        try:
            with tifffile.TiffFile(io.BytesIO(begin[mark.start() :])) as tiff:
                tags = {tag.name: tag.value for tag in tiff.pages.first.tags.values()}
        except (tifffile.TiffFileError, ValueError, KeyError, IndexError, TypeError, struct.error):
            continue  # a chance likeness, or cut off
        inner = tags.get("ExifTag")
        found = {**(inner if isinstance(inner, dict) else {}), **tags, **found}
    return found


def _libraw(path: Path) -> tuple[float | None, float | None, float | None]:
    import rawpy

    try:
        with rawpy.imread(str(path)) as raw:
            other = raw.other
            values = (other.shutter_speed, other.iso_speed, other.aperture)
    except rawpy.LibRawError:
        return None, None, None
    shutter_s, iso, aperture = (float(value) if value > 0 else None for value in values)
    return shutter_s, iso, aperture


def _number(value: object) -> float | None:
    """A tag's number or fraction; None for anything else, and for nought."""
    if isinstance(value, tuple) and len(value) == 2 and value[1]:
        value = value[0] / value[1]
    return float(value) if isinstance(value, int | float) and value > 0 else None


def _iso(tags: dict[str, Any]) -> float | None:
    """Sensitivity; a tag may hold several numbers, or nought for "see elsewhere"."""
    for name in ISO_TAGS:
        value = tags.get(name)
        values = value if isinstance(value, tuple) else (value,)
        told = [one for one in values if isinstance(one, int | float) and one > 0]
        if told and told[0] != NO_ISO:
            return float(told[0])
    return None


def _clock_s(stamp: str, fraction: str) -> float | None:
    try:
        moment = datetime.datetime.strptime(stamp.strip("\0 "), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return None
    digits = fraction.strip("\0 ")
    return moment.replace(tzinfo=datetime.UTC).timestamp() + (
        float(f"0.{digits}") if digits.isdigit() else 0.0
    )
