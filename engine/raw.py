"""Read RAW files: the mosaic as the sensor counted it, and the facts of its exposure.

Source: LibRaw through rawpy; DNG 1.4 and Exif 2.3 for what LibRaw does not pass on (camera name, fractions
of a second). Mosaics stay in the sensor's own orientation whatever the orientation tag says: camera and
object are rigid to one another, so the object must not turn in the image when the camera is tilted.
"""

import datetime
import io
import math
import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rawpy
import tifffile
from jaxtyping import Float, Int, UInt16

from engine.errors import RawError

# Sony, Canon CR3 and Fuji keep their TIFF header inside another container, near its beginning.
HEADER_BYTES = 1 << 18


@dataclass(frozen=True, slots=True)
class Facts:
    """What a RAW file says about itself, read without decoding its pixels."""

    camera: str  # make and model, or what is known of it
    width: int
    height: int
    shutter_s: float
    iso: float
    aperture: float  # f-number; NaN when the lens did not tell
    time_s: float  # start of the exposure, camera clock, seconds since 1970 with no time zone; NaN unknown
    orientation: int  # LibRaw's flip: 0, 3 (180 degrees), 5 (90 left), 6 (90 right); never applied

    def exposure(self) -> float:
        """Light gathered, relative to 1 s at ISO 100 and f/1; f/1 when the aperture is unknown."""
        light = self.shutter_s * self.iso / 100
        return light if math.isnan(self.aperture) else light / self.aperture**2


@dataclass(frozen=True, slots=True, eq=False)
class Mosaic:
    """One exposure of a Bayer sensor. Channels are 0 red, 1 green, 2 blue, 3 second green."""

    counts: UInt16[np.ndarray, "h w"]
    pattern: Int[np.ndarray, "2 2"]  # channel of each site of the 2 x 2 cell
    black: tuple[float, float, float, float]  # counts, per channel
    white: tuple[float, float, float, float]  # counts, per channel
    rec709_from_camera: Float[np.ndarray, "3 3"]  # black-free camera RGB to linear Rec.709, daylight
    facts: Facts


@dataclass(frozen=True, slots=True)
class Bracket:
    """The exposures of one view; any order."""

    name: str
    exposures: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class _Exif:
    """What was found of the TIFF and Exif tags; '' and NaN for what was not."""

    camera: str = ""
    shutter_s: float = math.nan
    iso: float = math.nan
    aperture: float = math.nan
    time_s: float = math.nan


def read_facts(path: Path) -> Facts:
    """Exposure, time, size and camera of a RAW file; the pixels are not decoded.

    Raises:
        RawError: not a RAW file LibRaw knows, cut off, or it does not tell its exposure.
    """
    with _open(path) as raw:
        return _facts(path, raw, _exif(path))


def read_mosaic(path: Path) -> Mosaic:
    """The undeveloped pixels of a RAW file with a 2 x 2 Bayer pattern.

    Raises:
        RawError: unreadable, truncated, not Bayer, or without levels or colour matrix.
    """
    with _open(path) as raw:
        exif = _exif(path)
        _unpack(path, raw)
        facts = _facts(path, raw, exif)
        if raw.raw_type != rawpy.RawType.Flat:
            raise RawError(
                f"{path}: holds developed or full-colour pixels, not a Bayer mosaic; import the camera's"
                " own RAW files, or develop to linear EXR and import those"
            )
        counts = raw.raw_image_visible.copy()
        period = raw.raw_colors_visible[:6, :6].astype(np.int64)
        pattern = period[:2, :2]
        if not np.array_equal(period, np.tile(pattern, (3, 3))[: period.shape[0], : period.shape[1]]):
            raise RawError(
                f"{path}: the sensor of {facts.camera} has no 2 x 2 Bayer pattern (X-Trans?), which the"
                " linear merge needs; develop to linear EXR and import those"
            )
        if counts.dtype != np.uint16 or sorted(set(pattern.ravel().tolist()) - {3}) != [0, 1, 2]:
            raise RawError(
                f"{path}: the sensor of {facts.camera} is no red, green and blue Bayer sensor; develop to"
                " linear EXR and import those"
            )
        black, white = _levels(path, raw)
        matrix = np.asarray(raw.color_matrix, np.float64)[:, :3]
        daylight = np.asarray(raw.daylight_whitebalance, np.float64)[:3]
    if not (np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 1e-6 and (daylight > 0).all()):
        raise RawError(
            f"{path}: no colour matrix is known for {facts.camera}; convert the files with Adobe DNG"
            " Converter, which writes one into them"
        )
    # Daylight balance for every view: what the camera judged as white differs from shot to shot.
    # LibRaw scales the balance at will; here a white sheet keeps the value of its green sites.
    return Mosaic(counts, pattern, black, white, matrix * (daylight / daylight[1]), facts)


def _open(path: Path) -> rawpy.RawPy:
    raw = rawpy.RawPy()
    try:
        raw.open_file(str(path))
    except FileNotFoundError as fault:
        raise RawError(f"{path}: no such file; check the folder") from fault
    except rawpy.LibRawIOError as fault:
        if path.exists() and not os.access(path, os.R_OK):
            raise RawError(f"{path}: no permission to read it; change its permissions") from fault
        cause = "no such file" if not path.exists() else "it cannot be read or is cut off"
        raise RawError(f"{path}: {cause} ({_reason(fault)}); copy the file again") from fault
    except rawpy.LibRawError as fault:
        raise RawError(
            f"{path}: not a RAW file LibRaw can open ({_reason(fault)}); copy it again or convert it to DNG"
        ) from fault
    return raw


def _unpack(path: Path, raw: rawpy.RawPy) -> None:
    try:
        raw.unpack()
    except rawpy.LibRawError as fault:
        raise RawError(
            f"{path}: its pixels cannot be decoded, the file is cut off or damaged ({_reason(fault)}); copy"
            " it again"
        ) from fault


def _facts(path: Path, raw: rawpy.RawPy, exif: _Exif) -> Facts:
    shutter_s, iso, aperture = exif.shutter_s, exif.iso, exif.aperture
    time_s = exif.time_s
    if not (shutter_s > 0 and iso > 0):
        # LibRaw knows makers' private notes too, but rawpy decodes the pixels before it tells.
        try:
            other = raw.other
        except rawpy.LibRawError as fault:
            raise RawError(f"{path}: cannot be decoded ({_reason(fault)}); copy the file again") from fault
        shutter_s, iso, aperture = float(other.shutter_speed), float(other.iso_speed), float(other.aperture)
        if math.isnan(time_s) and other.timestamp is not None and other.timestamp.year > 1970:
            time_s = other.timestamp.replace(tzinfo=datetime.UTC).timestamp()
    if not (shutter_s > 0 and iso > 0):
        raise RawError(
            f"{path}: the file does not tell its shutter time and ISO ({shutter_s:g} s, ISO {iso:g}), which"
            " the merge needs; keep the EXIF data when copying or converting"
        )
    sizes = raw.sizes
    return Facts(
        exif.camera or f"unnamed camera of {sizes.width} x {sizes.height}",
        sizes.width,
        sizes.height,
        shutter_s,
        iso,
        aperture if aperture > 0 else math.nan,
        time_s,
        sizes.flip,
    )


def _exif(path: Path) -> _Exif:
    """The tags in the TIFF header that nearly every RAW format carries, itself or inside a container.

    Raises:
        RawError: the file ends before its pixels do. LibRaw would find out too, once it decodes them and loudly.
    """
    with path.open("rb") as file:
        begin = file.read(HEADER_BYTES)
    starts = [at for mark in (b"II*\0", b"MM\0*") if (at := begin.find(mark)) >= 0]
    if not starts:
        return _Exif()
    try:
        with tifffile.TiffFile(io.BytesIO(begin[min(starts) :])) as tiff:
            tags = {tag.name: tag.value for tag in tiff.pages.first.tags.values()}
    except (tifffile.TiffFileError, ValueError, KeyError, IndexError, TypeError, struct.error):
        return _Exif()  # LibRaw has the last word on whether the file is damaged
    tags |= tags.get("ExifTag", {})
    make, model = str(tags.get("Make", "")).strip("\0 "), str(tags.get("Model", "")).strip("\0 ")
    size, ends_at = path.stat().st_size, _data_end(tags) if min(starts) == 0 else 0
    if size < ends_at:
        raise RawError(f"{path}: cut off, {size} of at least {ends_at} bytes are there; copy the file again")
    return _Exif(
        (model if model.startswith(make) else f"{make} {model}").strip(),
        _number(tags.get("ExposureTime")),
        _number(tags.get("ISOSpeedRatings", tags.get("PhotographicSensitivity"))),
        _number(tags.get("FNumber")),
        _clock_s(str(tags.get("DateTimeOriginal", "")), str(tags.get("SubsecTimeOriginal", ""))),
    )


def _data_end(tags: dict[str, Any]) -> int:
    """The byte after the last strip of pixels that the first directory lists; 0 when it lists none."""
    offsets, lengths = tags.get("StripOffsets", ()), tags.get("StripByteCounts", ())
    return max((at + length for at, length in zip(offsets, lengths, strict=False)), default=0)


def _number(value: object) -> float:
    """A tag's number, its fraction or its first entry as a float; NaN for anything else."""
    if isinstance(value, tuple) and len(value) == 2 and value[1]:
        return float(value[0]) / float(value[1])
    return float(value) if isinstance(value, int | float) else math.nan


def _clock_s(stamp: str, fraction: str) -> float:
    """Seconds since 1970 of an Exif time; its digits count as they stand, for it knows no time zone."""
    try:
        moment = datetime.datetime.strptime(stamp.strip("\0 "), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        return math.nan
    digits = fraction.strip("\0 ")
    part_s = float(f"0.{digits}") if digits.isdigit() else 0.0
    return moment.replace(tzinfo=datetime.UTC).timestamp() + part_s


def _levels(
    path: Path, raw: rawpy.RawPy
) -> tuple[tuple[float, float, float, float], tuple[float, float, float, float]]:
    """Black and white counts of the four channels."""
    black = [float(level) for level in raw.black_level_per_channel]
    white = [float(raw.white_level or 0)] * 4
    for channel, level in enumerate(raw.camera_white_level_per_channel or ()):
        # The camera's own word on where it saturates, where it gives one, is at most the format's maximum.
        if 0 < level < white[channel]:
            white[channel] = float(level)
    if any(top <= bottom for top, bottom in zip(white, black, strict=True)):
        raise RawError(f"{path}: white level {white} is not above black {black}; convert the file to DNG")
    return (black[0], black[1], black[2], black[3]), (white[0], white[1], white[2], white[3])


def _reason(fault: Exception) -> str:
    text = fault.args[0] if fault.args else fault
    return text.decode(errors="replace") if isinstance(text, bytes) else str(text)
