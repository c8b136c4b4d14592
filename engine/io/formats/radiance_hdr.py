"""Read Radiance pictures (.hdr, .pic): the header is ours, OpenCV decodes the pixels.

OpenCV knows neither the lines that tell what the values mean nor all orders of the pixels, so it is handed a plain
header. Source: Radiance's file formats and its `color.h`: what is stored was multiplied by every EXPOSURE and every
COLORCORR line; XYZE is of white (1/3, 1/3). WHTEFFICACY, which makes units photometric, is not applied.
"""

import math
import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, Float64

from engine.color import CIE_XYZ, REC709, as_rec709
from engine.errors import RawError
from engine.io.formats.exr import check_square

HEADER = re.compile(rb"#\?[^\n]*\n((?:[^\n]*\n)*?)\r?\n([^\n]*)\n")
ORDER = re.compile(r"([+-])([XY])\s+(\d{1,9})\s+([+-])(?!\2)([XY])\s+(\d{1,9})\s*")
RGBE, XYZE = "32-bit_rle_rgbe", "32-bit_rle_xyze"
LEAST = 1e-20  # factor that a picture may have been multiplied by
LONGEST_RUN = 127  # pixels in one run of a run-length code, two bytes
OLD_RUN = (1, 1, 1)  # red, green, blue: no pixel, but a run of the code of before 1991

Line = tuple[str, str]  # name, value


def read_hdr(path: Path) -> Float32[np.ndarray, "h w 3"]:
    """Linear Rec.709 radiance as it was before any exposure was applied, values unchecked.

    Raises:
        RawError: cut off, or of a kind that is not read; says which.
    """
    content = path.read_bytes()
    header = HEADER.match(content)
    if header is None:
        raise RawError(f"{path}: does not begin like a Radiance picture (#?RADIANCE ...); export it again")
    text, size = (group.decode("latin-1") for group in header.groups())
    lines = [(name, value.strip()) for name, _, value in (line.partition("=") for line in text.splitlines())]
    order = ORDER.fullmatch(size)
    if order is None:
        raise RawError(
            f"{path}: tells its size by {size.strip()[:40]!r}, not as -Y 480 +X 640; export it again"
        )
    code = next((value for name, value in reversed(lines) if name == "FORMAT"), RGBE)
    if code not in (RGBE, XYZE):
        raise RawError(
            f"{path}: is of format {code}; only {RGBE} and {XYZE} are read, export it as one of them"
        )
    check_square(path, float(_product(path, lines, "PIXASPECT", 1)[0]))
    scale = _product(path, lines, "EXPOSURE", 1) * _product(path, lines, "COLORCORR", 3)
    told = _numbers(path, lines, "PRIMARIES", 8)
    primaries = told[-1] if told else CIE_XYZ if code == XYZE else REC709
    if code == XYZE:  # a line of primaries can only tell the white of what has none
        x, y = primaries[6:]
        primaries, scale = (*CIE_XYZ[:6], x, y), scale * np.array([x, y, 1 - x - y]) / (y or np.nan)
    stored = _decoded(path, int(order[3]), int(order[6]), content[header.end() :])
    upright = stored if order[2] == "Y" else stored.transpose(1, 0, 2)
    signs = {order[2]: order[1], order[5]: order[4]}
    upright = upright[:: 1 if signs["Y"] == "-" else -1, :: 1 if signs["X"] == "+" else -1]
    return as_rec709(path, np.ascontiguousarray(upright / scale.astype(np.float32)), tuple(primaries))


def _product(path: Path, lines: Sequence[Line], name: str, count: int) -> Float64[np.ndarray, " count"]:
    """Of all lines of a name: each program that had the picture in hand added its own."""
    factors = _numbers(path, lines, name, count)
    product = np.prod(np.array([[1.0] * count, *factors]), axis=0)
    if not ((product > LEAST) & (product < 1 / LEAST)).all():
        raise RawError(f"{path}: its {name} lines make {product.tolist()}, no scale of light; correct them")
    return product


def _numbers(path: Path, lines: Sequence[Line], name: str, count: int) -> list[list[float]]:
    found = []
    for _, value in (line for line in lines if line[0] == name):
        try:
            numbers = [float(word) for word in value.split()]
        except ValueError:
            numbers = []
        if len(numbers) != count:
            raise RawError(
                f"{path}: its line {name}={value[:60]} does not hold {count} number(s); correct it"
            )
        found.append(numbers)
    return found


def _decoded(path: Path, rows: int, columns: int, pixels: bytes) -> Float32[np.ndarray, "rows columns 3"]:
    """Red, green and blue as they are stored."""
    coded = pixels[:4] == bytes([2, 2, columns >> 8 & 255, columns & 255]) and 8 <= columns < 1 << 15
    least = rows * (4 + 8 * math.ceil(columns / LONGEST_RUN) if coded else 4 * columns)
    image = None
    if 0 < least <= len(pixels):
        plain = f"#?RADIANCE\nFORMAT={RGBE}\n\n-Y {rows} +X {columns}\n".encode() + pixels
        image = cv2.imdecode(np.frombuffer(plain, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        quads = np.frombuffer(pixels[: len(pixels) // 4 * 4], np.uint8).reshape(-1, 4)
        if not coded and (quads[:, :3] == OLD_RUN).all(axis=1).any():
            raise RawError(f"{path}: has the run-length code of before 1991, which is not read; save it anew")
        raise RawError(
            f"{path}: its {len(pixels)} bytes of pixels do not make {columns} x {rows}, it may be cut off;"
            " export it again"
        )
    return image[..., ::-1]
