"""Read linear images and masks; encode radiance for eyes and for feature detectors.

Source: IEC 61966-2-1 (sRGB). Arrays are [h w 3], first pixel top left, linear Rec.709 after reading.
"""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from PIL import Image, ImageOps

from engine.errors import MaskError, RawError
from engine.io.formats.exr import read_exr
from engine.io.formats.radiance_hdr import read_hdr

READERS = {".exr": read_exr, ".hdr": read_hdr, ".pic": read_hdr}

# What Pillow raises of a damaged picture, or of one whose header claims more pixels than any camera has.
UNREADABLE_PICTURE = (OSError, ValueError, SyntaxError, Image.DecompressionBombError)

# The tone curve: white lies this far above the anchor; below the toe, straight instead of logarithmic.
TONE_WHITE = 32.0
TONE_TOE = 1 / 16


def read_radiance(path: Path) -> Float32[np.ndarray, "h w 3"]:
    """Linear Rec.709 radiance of an OpenEXR or Radiance file, values unchecked.

    Raises:
        RawError: unreadable, or of a kind that is not read.
    """
    if not path.exists():
        raise RawError(f"{path}: no such file; check the folder")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise RawError(f"{path}: linear images are read from {', '.join(READERS)}; convert the file")
    try:
        return reader(path)
    except OSError as fault:
        raise RawError(f"{path}: cannot be read ({fault.strerror}); check its permissions") from fault


def read_mask(path: Path, height: int, width: int) -> Bool[np.ndarray, "h w"]:
    """A painted mask as viewers show it: true where it is opaque if its opacity varies, else where it is brighter than half.

    Raises:
        MaskError: unreadable, of another size than `height` x `width`, or all of one kind.
    """
    try:
        with opened(path) as image:
            if sorted(image.size) != sorted((width, height)):
                _check_size(path, image.size, (width, height))
            upright = ImageOps.exif_transpose(
                image
            )  # as its own Orientation tag says, which decodes the pixels
            _check_size(path, upright.size, (width, height))
            mask = _painted(path, upright)
    except FileNotFoundError as fault:
        raise MaskError(f"{path}: no such file; check the path") from fault
    except UNREADABLE_PICTURE as fault:
        raise MaskError(
            f"{path}: cannot be read as a picture of 8 or 16 bits; save the mask as PNG"
        ) from fault
    if mask.all() or not mask.any():
        raise MaskError(
            f"{path}: the mask is {'all' if mask.any() else 'no'} object; paint the object white on black, or cut"
            " it out"
        )
    return mask


def _check_size(path: Path, found: Sequence[int], wanted: Sequence[int]) -> None:
    if list(found) != list(wanted):
        raise MaskError(
            f"{path}: the mask is {found[0]} x {found[1]}, the photographs are {wanted[0]} x {wanted[1]}; paint it on a"
            " photograph of full size"
        )


def opened(path: Path) -> Image.Image:
    """A picture of which only the header is read, so that its size can be judged before gigabytes are made of it.

    Raises:
        UNREADABLE_PICTURE: no such file, or no picture.
    """
    # Pillow, not OpenCV: that drops the opacity of grey pictures and of some formats without a word.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # 100 megapixels are a camera's
        return Image.open(path)


def _painted(path: Path, image: Image.Image) -> Bool[np.ndarray, "h w"]:
    if image.has_transparency_data:
        opaque = np.asarray(image.convert("RGBA"))[..., 3] > 127
        if opaque.any() and not opaque.all():
            return opaque
    if image.mode.startswith("I;16"):
        return np.asarray(image) > 32767
    if image.mode in ("I", "F"):
        raise MaskError(f"{path}: holds numbers without a largest one to be white; save the mask as PNG")
    return np.asarray(image.convert("RGB")).max(axis=-1) > 127


def tone_map(radiance: Float[np.ndarray, "h w 3"], anchor: float) -> UInt8[np.ndarray, "h w 3"]:
    """Eight bits for eyes and feature detectors: logarithmic, `anchor` (say, the median) to mid grey.

    One `anchor` for all views keeps a wall equally grey in all of them.
    """
    top = np.log1p(TONE_WHITE / TONE_TOE)
    curve = np.log1p(np.maximum(radiance, 0.0) / (anchor * TONE_TOE)) / top
    return np.rint(255 * np.clip(curve, 0.0, 1.0)).astype(np.uint8)


def srgb_decode(code: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """sRGB code values [0, 1] to linear; `png.srgb` is its inverse."""
    return np.where(code <= 0.04045, code / 12.92, ((np.maximum(code, 0.0) + 0.055) / 1.055) ** 2.4)
