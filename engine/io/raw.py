"""Read RAW files: the mosaic as the sensor counted it, and the facts of its exposure.

Source: LibRaw through rawpy, its table of cameras included; DNG 1.4 and Exif 2.3 for what LibRaw does not pass on
(camera name, fractions of a second, floating-point pixels). Mosaics stay in the sensor's own orientation
whatever the orientation tag says: camera and object are rigid to one another, so the object must not turn in the
image when the camera is tilted.
"""

import datetime
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rawpy
import tifffile
from jaxtyping import Float, Float32, Int, UInt16

from engine.errors import RawError
from engine.io.formats import exif, float_dng

LIBRAW = "LibRaw " + ".".join(map(str, rawpy.libraw_version[:2]))
NOT_SUPPORTED = (rawpy.LibRawFileUnsupportedError, rawpy.LibRawNotImplementedError)
TOO_LARGE = (rawpy.LibRawUnsufficientMemoryError, rawpy.LibRawTooBigError, rawpy.LibRawMemPoolOverflowError)
DECODED = {
    "counts": (1, 7),
    "floats in strips": (1, 8),
    "floats in tiles": (8,),
}  # none, lossless JPEG, deflate
COMPRESSIONS = {
    1: "uncompressed", 5: "LZW", 7: "lossless JPEG", 8: "deflate", 9: "VC-5", 34892: "lossy JPEG", 52546: "JPEG XL",
}  # fmt: skip
LOSSLESS_JPEG, JPEG_BEGINS = 7, b"\xff\xd8"
SQUARE = 0.02  # how far from square a pixel may be
MOST_PIXELS_A_BYTE = 128  # lossless JPEG spends a bit on a pixel at least, lossy kinds an eighth
# IEC 61966-2-1; white is that of daylight, D65.
XYZ_FROM_REC709 = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


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

    counts: UInt16[np.ndarray, "h w"] | Float32[np.ndarray, "h w"]  # floats of a floating-point DNG
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


def read_facts(path: Path) -> Facts:
    """Exposure, time, size and camera of a RAW file; the pixels are not decoded.

    Raises:
        RawError: not a RAW file LibRaw knows, cut off, or it does not tell its exposure.
    """
    with _open(path) as raw:
        return _facts(path, raw, _tags(path))


def read_mosaic(path: Path) -> Mosaic:
    """The undeveloped pixels of a RAW file with a 2 x 2 Bayer pattern.

    Raises:
        RawError: unreadable, truncated, not supported, not Bayer, or without levels or colour matrix.
    """
    with _open(path) as raw:
        tags = _tags(path)
        _unpack(path, raw)
        facts = _facts(path, raw, tags)
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
        channels = sorted(set(pattern.ravel().tolist()) - {3})
        if counts.dtype != np.uint16 or channels != [0, 1, 2] or raw.color_desc != b"RGBG":
            raise RawError(
                f"{path}: the sensor of {facts.camera} is no red, green and blue Bayer sensor; develop to"
                " linear EXR and import those"
            )
        sizes = raw.sizes
        if abs(sizes.pixel_aspect - 1) > SQUARE:
            raise RawError(
                f"{path}: the pixels of {facts.camera} are not square ({sizes.pixel_aspect:g} : 1); develop to linear"
                " EXR and import those"
            )
        black, white = _levels(path, raw)
        if "DNGVersion" in tags:
            _check_parts(path)
            floats = float_dng.read(path, sizes.raw_height, sizes.raw_width, pattern)
            if floats is not None:
                whole, black, white = floats
                top, left = sizes.top_margin, sizes.left_margin
                counts = whole[top : top + sizes.height, left : left + sizes.width].copy()
        return Mosaic(counts, pattern, black, white, _rec709_from_camera(path, raw, facts.camera), facts)


def _rec709_from_camera(path: Path, raw: rawpy.RawPy, camera: str) -> Float[np.ndarray, "3 3"]:
    """Daylight balance for every view: what the camera judged as white differs from shot to shot.

    LibRaw scales the balance at will; here a white sheet keeps the value of its green sites.
    """
    matrix = np.asarray(raw.color_matrix, np.float64)[:, :3]
    daylight = np.asarray(raw.daylight_whitebalance, np.float64)[:3]
    if not matrix.any():
        # Only DNG brings a matrix of its own. That of the table is camera from XYZ, of any scale in each row.
        camera_from_rec709 = np.asarray(raw.rgb_xyz_matrix, np.float64)[:3] @ XYZ_FROM_REC709
        daylight = 1 / np.where((white := camera_from_rec709.sum(axis=1)) > 0, white, np.inf)
        if (daylight > 0).all() and abs(
            np.linalg.det(balanced := camera_from_rec709 * daylight[:, None])
        ) > 1e-6:
            matrix = np.linalg.inv(balanced)
    if not (np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 1e-6 and (daylight > 0).all()):
        raise RawError(
            f"{path}: no colour matrix is known for {camera}; convert the files with Adobe DNG"
            " Converter, which writes one into them"
        )
    return matrix * (daylight / daylight[1])


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
        _refuse_dng(path, fault)
        raise RawError(
            f"{path}: not a RAW file LibRaw can open ({_reason(fault)}); copy it again or convert it to DNG"
        ) from fault
    return raw


def _unpack(path: Path, raw: rawpy.RawPy) -> None:
    width, height, there = raw.sizes.raw_width, raw.sizes.raw_height, path.stat().st_size
    if width * height > MOST_PIXELS_A_BYTE * there:
        # LibRaw would spend minutes and gigabytes on a damaged header, and hand out zeros.
        raise RawError(
            f"{path}: says that it holds {width} x {height} pixels, too many for its {there} bytes; the file is cut"
            " off or damaged, copy it again"
        )
    try:
        raw.unpack()
    except TOO_LARGE as fault:
        raise RawError(f"{path}: too large to decode ({_reason(fault)}); develop it to linear EXR") from fault
    except rawpy.LibRawError as fault:
        _refuse_dng(path, fault)
        if isinstance(fault, NOT_SUPPORTED):
            raise RawError(
                f"{path}: {LIBRAW} does not support how its pixels are compressed ({path.suffix}; Nikon's high efficiency"
                " is such a way); set the camera to lossless or uncompressed RAW, and convert what is taken with Adobe"
                " DNG Converter"
            ) from fault
        raise RawError(
            f"{path}: its pixels cannot be decoded, the file is cut off or damaged ({_reason(fault)}); copy"
            " it again"
        ) from fault


def _refuse_dng(path: Path, fault: Exception) -> None:
    """Tell a DNG whose kind is not supported from a damaged one, by what it says of itself.

    Raises:
        RawError: it is a whole DNG of a kind that LibRaw does not decode.
    """
    try:
        with tifffile.TiffFile(path) as tiff:
            largest = _largest(tiff)
            bits, stored = largest.bitspersample, int(largest.compression)
            kind = "counts"
            if largest.sampleformat == float_dng.FLOATS:
                kind = "floats in tiles" if largest.is_tiled else "floats in strips"
            if "DNGVersion" not in tiff.pages.first.tags:
                return
    except exif.DAMAGE:
        return
    if isinstance(fault, NOT_SUPPORTED) or stored not in DECODED[kind]:
        raise RawError(
            f"{path}: {LIBRAW} does not support this kind of DNG ({kind} of {bits} bits, {COMPRESSIONS.get(stored, stored)});"
            " convert it with Adobe DNG Converter (compatible with Camera Raw 7.1, not lossy), or import the camera's own"
            " RAW files"
        ) from fault


def _check_parts(path: Path) -> None:
    """
    Raises:
        RawError: a strip or tile of lossless JPEG does not begin as one; LibRaw hands out whatever was in memory for it.
    """
    try:
        with tifffile.TiffFile(path) as tiff:
            page, file = _largest(tiff), tiff.filehandle
            offsets = page.dataoffsets if page.compression == LOSSLESS_JPEG else ()
            begins = [(file.seek(at), file.read(2))[1] for at in offsets]
    except exif.DAMAGE:
        return  # LibRaw decoded it, and knows kinds of headers that tifffile does not
    if wrong := sum(begin != JPEG_BEGINS for begin in begins):
        raise RawError(
            f"{path}: {wrong} of its {len(begins)} parts of pixels are damaged, they do not begin like the lossless JPEG"
            " that they are; copy it again"
        )


def _largest(tiff: tifffile.TiffFile) -> Any:
    """The page of the photograph; smaller ones are previews."""
    pages: list[Any] = [tiff.pages.first, *(tiff.pages.first.pages or ())]
    return max(pages, key=lambda page: page.imagewidth * page.imagelength)


def _facts(path: Path, raw: rawpy.RawPy, tags: dict[str, Any]) -> Facts:
    shutter_s, iso, aperture = (
        exif.number(tags.get("ExposureTime")),
        exif.iso(tags),
        exif.number(tags.get("FNumber")),
    )
    time_s = exif.clock_s(tags)
    if not (shutter_s > 0 and iso > 0):
        # LibRaw knows makers' private notes too, but rawpy decodes the pixels before it tells.
        _unpack(path, raw)
        other = raw.other
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
        exif.camera(tags) or f"unnamed camera of {sizes.width} x {sizes.height}",
        sizes.width,
        sizes.height,
        shutter_s,
        iso,
        aperture if aperture > 0 else math.nan,
        time_s,
        sizes.flip,
    )


def _tags(path: Path) -> dict[str, Any]:
    """What the header says.

    Raises:
        RawError: the file ends before its pixels do. LibRaw would find out too, once it decodes them and loudly.
    """
    tags, end = exif.read_tags(path)
    size = path.stat().st_size
    if size < end:
        raise RawError(f"{path}: cut off, {size} of at least {end} bytes are there; copy the file again")
    return tags


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
