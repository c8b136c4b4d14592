"""Read linear images and masks; encode radiance for eyes and for feature detectors.

Source: OpenEXR's standard attributes; IEC 61966-2-1 (sRGB); Lindbloom for primaries and Bradford's adaptation
of white. Arrays are [h w 3], first pixel top left, linear Rec.709 after reading.
"""

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from jaxtyping import Bool, Float, Float32, UInt8

from engine.errors import MaskError, RawError

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # xy of red, green, blue and white
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])

LINEAR_SUFFIXES = (".exr", ".hdr", ".pic")

# The tone curve: white lies this far above the anchor; below the toe, straight instead of logarithmic.
TONE_WHITE = 32.0
TONE_TOE = 1 / 16


def read_radiance(path: Path) -> Float32[np.ndarray, "h w 3"]:
    """Linear Rec.709 radiance of an OpenEXR or Radiance file, in the file's own scale, values unchecked.

    Raises:
        RawError: unreadable, without red, green and blue, or cropped.
    """
    suffix = path.suffix.lower()
    if not path.exists():
        raise RawError(f"{path}: no such file; check the folder")
    if suffix == ".exr":
        return _read_exr(path)
    if suffix in LINEAR_SUFFIXES:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None or image.dtype != np.float32 or image.ndim != 3 or image.shape[2] != 3:
            raise RawError(
                f"{path}: cannot be read as a Radiance picture, it may be cut off; export it again"
            )
        return np.ascontiguousarray(image[..., ::-1])
    raise RawError(f"{path}: linear images are read from {', '.join(LINEAR_SUFFIXES)}; convert the file")


def read_mask(path: Path, height: int, width: int) -> Bool[np.ndarray, "h w"]:
    """A painted mask: true where the image is brighter than half; opacity counts when there is an alpha.

    Raises:
        MaskError: unreadable, of another size than `height` x `width`, or all of one kind.
    """
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.exists() else None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise MaskError(f"{path}: cannot be read as an image; save the mask as PNG")
    level = image.astype(np.float32) / (65535.0 if image.dtype == np.uint16 else 255.0)
    if level.ndim == 3:
        colour = level[..., :3].max(axis=-1)
        level = colour * level[..., 3] if level.shape[2] == 4 else colour
    mask = level > 0.5
    if mask.shape != (height, width):
        raise MaskError(
            f"{path}: the mask is {mask.shape[1]} x {mask.shape[0]}, the photographs are {width} x {height};"
            " paint it on a photograph of full size"
        )
    if mask.all() or not mask.any():
        raise MaskError(
            f"{path}: the mask is {'all' if mask.any() else 'no'} object; paint the object white on black"
        )
    return mask


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


def _read_exr(path: Path) -> Float32[np.ndarray, "h w 3"]:
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            header = dict(file.header())
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as fault:
        raise RawError(
            f"{path}: cannot be read as OpenEXR, it may be cut off ({_one_line(fault)}); export it again"
        ) from fault
    if not np.array_equal(header["dataWindow"], header["displayWindow"]):
        raise RawError(
            f"{path}: the picture is cropped (data window {_window(header['dataWindow'])}, display window"
            f" {_window(header['displayWindow'])}); export whole frames"
        )
    red, green, blue = _rgb_names(path, list(channels))
    planes = [np.asarray(channels[name], np.float32) for name in (red, green, blue)]
    if len({plane.shape for plane in planes}) > 1:
        raise RawError(f"{path}: red, green and blue are sampled differently; export full-size channels")
    rgb = np.stack(planes, axis=-1)
    primaries = header.get("chromaticities")
    if primaries is not None and not np.allclose(primaries, REC709, atol=2e-3):
        matrix = rec709_from(tuple(float(xy) for xy in primaries))
        rgb = (rgb @ matrix.T).astype(np.float32)
    return rgb


def _rgb_names(path: Path, names: list[str]) -> tuple[str, str, str]:
    """The three channels to read: the plain ones, else those of the only layer that has all three."""
    layers = [
        name[:-1] for name in names if name.endswith("R") and name[:-1] in ("", name.rpartition(".")[0] + ".")
    ]
    whole = [layer for layer in layers if {layer + "G", layer + "B"} <= set(names)]
    if "" in whole:
        whole = [""]
    if len(whole) != 1:
        found = ", ".join(sorted(names))
        raise RawError(
            f"{path}: {'no' if not whole else 'more than one'} layer with R, G and B among the channels"
            f" {found}; export one colour layer"
        )
    return whole[0] + "R", whole[0] + "G", whole[0] + "B"


def rec709_from(primaries: tuple[float, ...]) -> Float[np.ndarray, "3 3"]:
    """Linear RGB of other primaries (xy of red, green, blue, white) to Rec.709; white goes to white."""
    source, target = _xyz_from(primaries), _xyz_from(REC709)
    source_cone, target_cone = BRADFORD @ source.sum(axis=1), BRADFORD @ target.sum(axis=1)
    adapt = np.linalg.inv(BRADFORD) @ np.diag(target_cone / source_cone) @ BRADFORD
    return np.linalg.inv(target) @ adapt @ source


def _xyz_from(primaries: tuple[float, ...]) -> Float[np.ndarray, "3 3"]:
    xy = np.array(primaries).reshape(4, 2)
    xyz = np.stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy[:, 0] - xy[:, 1]) / xy[:, 1]])
    return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])


def _window(window: tuple[np.ndarray, np.ndarray]) -> str:
    (x0, y0), (x1, y1) = window
    return f"{x0},{y0} to {x1},{y1}"


def _one_line(fault: Exception) -> str:
    return " ".join(str(fault).split())
