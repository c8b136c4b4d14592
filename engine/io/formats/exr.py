"""Read the colours of an OpenEXR file, whatever parts and layers it keeps them in.

Source: OpenEXR's standard attributes; the Color Interop Forum's colour space names.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from jaxtyping import Float32

from engine.color import REC709, Primaries, as_rec709
from engine.errors import RawError, reason

FLAT = (OpenEXR.scanlineimage, OpenEXR.tiledimage)
SQUARE = 0.01  # the aspect of a pixel may differ from 1 by so much

Header = Mapping[str, Any]
Places = Mapping[str, tuple[int, str]]  # channel, as a person knows it -> number of its part, its name there


def read_exr(path: Path) -> Float32[np.ndarray, "h w 3"]:
    """Linear Rec.709 radiance, values unchecked: the plain R, G and B, else those of the only layer that has all three.

    Raises:
        RawError: unreadable; deep, cropped or of other colours than linear RGB; no or several colour layers.
    """
    # What a file is, its headers tell: only one that we can use is decoded.
    with _opened(path, header_only=True) as file:
        headers = [dict(part.header) for part in file.parts]
        places = _places(headers)
    if not places and headers:
        raise RawError(f"{path}: is a deep picture, many values a pixel; flatten it and export it again")
    chosen = [places[name] for name in _colours(path, places)]
    for part, _ in chosen:
        _check_whole(path, headers[part])
    first = headers[chosen[0][0]]
    primaries = _primaries(path, first)
    with _opened(path) as file:
        read = {part.part_index: part.channels for part in file.parts}  # what cannot be decoded is left out
        try:
            planes = [read[part][name].pixels for part, name in chosen]
        except KeyError as fault:
            raise RawError(
                f"{path}: cannot be read as OpenEXR, its pixels are cut off or damaged; export it again"
            ) from fault
    if any(plane.dtype == np.uint32 for plane in planes):
        raise RawError(
            f"{path}: red, green and blue are whole numbers (UINT), no light; export half or float"
        )
    if len({plane.shape for plane in planes}) > 1:
        raise RawError(f"{path}: red, green and blue are sampled differently; export full-size channels")
    rgb = np.stack([np.asarray(plane, np.float32) for plane in planes], axis=-1)
    return as_rec709(path, rgb, primaries)


@contextmanager
def _opened(path: Path, header_only: bool = False) -> Iterator[Any]:
    try:
        with OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as file:
            yield file
    except (RuntimeError, ValueError, OSError) as fault:
        told = reason(fault)
        raise RawError(
            f"{path}: cannot be read as OpenEXR, it may be cut off ({told}); export it again"
        ) from fault


def _places(headers: Sequence[Header]) -> Places:
    """Where the channels of all flat parts lie; those of a part that shares a name with another carry the part's."""
    held = {
        number: [channel.name for channel in header["channels"]]
        for number, header in enumerate(headers)
        if header["type"] in FLAT
    }
    count = Counter(name for names in held.values() for name in names)
    places = {}
    for number, names in held.items():
        shared = any(count[name] > 1 for name in names)
        layer = f"{headers[number].get('name') or f'part {number}'}." if shared else ""
        places |= {layer + name: (number, name) for name in names}
    return places


def _colours(path: Path, places: Places) -> tuple[str, str, str]:
    """The three channels to read."""
    layers = [
        name[:-1]
        for name in places
        if name.endswith("R") and name[:-1] in ("", name.rpartition(".")[0] + ".")
    ]
    whole = [layer for layer in layers if {layer + "G", layer + "B"} <= set(places)]
    if "" in whole:
        whole = [""]
    if not whole:
        raise RawError(
            f"{path}: no layer with R, G and B among the channels {', '.join(sorted(places))}; export one"
            " colour layer"
        )
    if len(whole) > 1:
        found = ", ".join(sorted(layer.rstrip(".") for layer in whole))
        raise RawError(f"{path}: more than one layer with R, G and B: {found}; export one colour layer")
    return whole[0] + "R", whole[0] + "G", whole[0] + "B"


def _check_whole(path: Path, header: Header) -> None:
    if not np.array_equal(header["dataWindow"], header["displayWindow"]):
        raise RawError(
            f"{path}: the picture is cropped (data window {_window(header['dataWindow'])}, display window"
            f" {_window(header['displayWindow'])}); export whole frames"
        )
    check_square(path, float(header["pixelAspectRatio"]))


def check_square(path: Path, aspect: float) -> None:
    """Refuse a picture that is squeezed: its pixels are `aspect` times as wide as high, or the other way round.

    Raises:
        RawError: they are not square.
    """
    if not abs(aspect - 1) <= SQUARE:
        raise RawError(f"{path}: its pixels are not square (aspect {aspect:g}); export it with square pixels")


def _primaries(path: Path, header: Header) -> Primaries:
    """Those that the file tells, Rec.709 where it does not. A name of its colour space goes first: it may be no RGB."""
    named = header.get("colorInteropID", "")
    if named not in ("", "unknown"):
        primaries = OpenEXR.colorInteropIDToChromaticities(named)
        if primaries is None:
            raise RawError(f"{path}: its colours are {named}, not linear RGB; export it as linear Rec.709")
        return primaries
    return tuple(float(xy) for xy in header.get("chromaticities", REC709))


def _window(window: tuple[np.ndarray, np.ndarray]) -> str:
    (x0, y0), (x1, y1) = window
    return f"{x0},{y0} to {x1},{y1}"
