"""RAW files as others write them, laid out with the studio's DNG writer: makers' own, floats, other compressions."""

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hardware.virtual import dng
from hardware.virtual.sensor import Sensor
from tests.engine.brackets_on_disk import START

FIRST_OF_DNG = 50706  # the tags from here on are those of DNG
BLACK, WHITE = 512, 16383
PADDED = 4096  # where pixels begin

Tags = Sequence[dng.Tag]


def counts(height: int = 64, width: int = 96, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(1000, 9000, (height, width)).astype(np.uint16)


def write(
    path: Path,
    mosaic: np.ndarray,
    pixels: Sequence[bytes] | None = None,
    make: str = dng.MAKE,
    model: str = dng.MODEL,
    changed: Tags = (),
    exif: Tags = (),
    without: Sequence[int] = (),
    offsets: int = 273,
) -> Path:
    """A DNG with tags `changed` (and of Exif) and others left out; `pixels` are its strips or tiles."""
    shape = np.zeros(mosaic.shape, np.uint16)
    camera = Sensor()
    facts = dng.Photograph(
        shape, BLACK, WHITE, camera.camera_from_xyz, camera.neutral(), 0.01, 100, 8.0, START, make, model
    )
    parts = [mosaic.astype("<u2").tobytes()] if pixels is None else list(pixels)
    lengths = [len(part) for part in parts]
    at = [PADDED + sum(lengths[:i]) for i in range(len(parts))]
    placed = [(offsets, dng.LONG, at), ({273: 279, 324: 325}[offsets], dng.LONG, lengths)]

    def with_changes(tags: Tags, changes: Tags) -> list[dng.Tag]:
        numbers = {tag[0] for tag in changes} | set(without)
        return sorted([tag for tag in tags if tag[0] not in numbers] + list(changes))

    # Uncompressed, if nothing else is said.
    changes = {tag[0]: tag for tag in (*placed, (259, dng.SHORT, [1]), *changed)}

    def image(exif_at: int) -> bytes:
        return dng._directory(with_changes(dng._image(facts, exif_at, 0, 0), list(changes.values())), 8)

    header = struct.pack("<2sHI", b"II", 42, 8)
    exif_at = len(header) + len(image(0))
    content = header + image(exif_at) + dng._directory(with_changes(dng._exif(facts), exif), exif_at)
    path.write_bytes(content.ljust(PADDED, b"\0") + b"".join(parts))
    return path


def write_maker(
    path: Path,
    make: str,
    model: str,
    mosaic: np.ndarray | None = None,
    exif: Tags = (),
    changed: Tags = (),
    pixels: Sequence[bytes] | None = None,
) -> Path:
    """As a maker's own file: a TIFF without one tag of DNG, which LibRaw opens by the names in it."""
    own = [tag[0] for tag in dng._image(_any_photograph(), 0, 0, 0) if tag[0] >= FIRST_OF_DNG]
    mosaic = counts() if mosaic is None else mosaic
    return write(path, mosaic, pixels, make, model, changed, exif, own)


def nikon_note(black: int) -> list[dng.Tag]:
    """Nikon's own notes in Exif, as far as they tell the black level: a TIFF behind a mark."""
    notes = dng._directory([(0x1, dng.UNDEFINED, list(b"0211")), (0x3D, dng.SHORT, [black] * 4)], 8)
    return [(37500, dng.UNDEFINED, list(b"Nikon\0\2\x10\0\0" + struct.pack("<2sHI", b"II", 42, 8) + notes))]


def write_orf(path: Path, model: str, mosaic: np.ndarray) -> Path:
    """As Olympus cameras wrote them: a mark of their own, 12 bits packed in little-endian words of 32."""
    bits = np.unpackbits(mosaic.astype(">u2").view(np.uint8).reshape(-1, 2), axis=1)[:, 4:]
    words = np.packbits(bits.ravel()).reshape(-1, 4)[:, ::-1]
    depth = [(258, dng.SHORT, [12])]
    write_maker(path, "OLYMPUS CORPORATION", model, mosaic, changed=depth, pixels=[words.tobytes()])
    path.write_bytes(b"IIRO" + path.read_bytes()[4:])
    return path


def write_raf(path: Path, model: str, mosaic: np.ndarray, black: int) -> Path:
    """As Fujifilm's cameras do: a container with a JPEG that has the Exif tags, a list of sizes, and a TIFF of pixels."""
    height, width = mosaic.shape
    header = struct.pack("<2sHI", b"II", 42, 8)
    exif = dng._exif(_any_photograph())

    def names(at: int) -> bytes:
        return dng._directory(
            [
                (271, dng.ASCII, dng._text("FUJIFILM")),
                (272, dng.ASCII, dng._text(model)),
                (34665, dng.LONG, [at]),
            ],
            8,
        )

    exif_at = 8 + len(names(0))
    body = b"Exif\0\0" + header + names(exif_at) + dng._directory(exif, exif_at)
    jpeg = b"\xff\xd8\xff\xe1" + struct.pack(">H", len(body) + 2) + body + b"\xff\xd9"
    sizes = struct.pack(">I", 2) + b"".join(
        struct.pack(">HHHH", tag, 4, height, width) for tag in (0x100, 0x121)
    )
    data = mosaic.astype("<u2").tobytes()
    inner_at = 8 + 2 + 12 + 4

    def inner(at: int) -> bytes:
        told = {0xF001: width, 0xF002: height, 0xF003: 16, 0xF007: at, 0xF008: len(data)}
        tags = [(tag, dng.LONG, [value]) for tag, value in told.items()]
        return dng._directory([*tags, (0xF00A, dng.LONG, [black] * 4)], inner_at)

    cfa = header + dng._directory([(0xF000, dng.LONG, [inner_at])], 8)
    cfa += inner(inner_at + len(inner(0))) + data
    parts, places, at = (jpeg, sizes, cfa), [], 160
    for part in parts:
        places += [at, len(part)]
        at += len(part)
    begin = b"FUJIFILMCCD-RAW 0201FF393101" + model.encode().ljust(32, b"\0") + b"0100" + bytes(20)
    path.write_bytes((begin + struct.pack(">6I", *places)).ljust(160, b"\0") + b"".join(parts))
    return path


def write_floats(
    path: Path,
    mosaic: np.ndarray,
    bits: int,
    predictor: int = 1,
    tile: tuple[int, int] | None = None,
    deflate: bool = True,
) -> Path:
    """A floating-point DNG with white at 1, of deflated strips of 20 rows, or of tiles."""
    height, width = mosaic.shape
    rows, columns = tile or (20, width)
    changed: list[dng.Tag] = [
        (258, dng.SHORT, [bits]), (259, dng.SHORT, [8 if deflate else 1]), (317, dng.SHORT, [predictor]),
        (339, dng.SHORT, [3]), (50714, dng.SHORT, [0] * 4), (50717, dng.LONG, [1]),
    ]  # fmt: skip
    changed += [(322, dng.SHORT, [columns]), (323, dng.SHORT, [rows])] if tile else [(278, dng.LONG, [rows])]
    parts = []
    for y in range(0, height, rows):
        for x in range(0, width, columns):
            part = mosaic[y : y + rows, x : x + columns]
            if tile:
                part = np.pad(part, ((0, rows - part.shape[0]), (0, columns - part.shape[1])))
            data = _coded(part, bits, predictor)
            parts.append(zlib.compress(data) if deflate else data)
    without = (273, 278, 279) if tile else ()
    return write(path, mosaic, parts, changed=changed, without=without, offsets=324 if tile else 273)


def _coded(part: np.ndarray, bits: int, predictor: int) -> bytes:
    size = bits // 8
    if bits == 24:
        code = part.astype(">f4").view(">u4").astype(np.int64)
        # Exponents about 63 instead of 127; 16 bits of mantissa instead of 23. Nothing here is as small as 2^-63.
        code = np.where(part > 0, ((code >> 23) - 64 << 16) | (code >> 7 & 0xFFFF), 0)
        samples = code.astype(">u4").view(np.uint8).reshape(*part.shape, 4)[..., 1:]
    else:
        samples = part.astype(f">f{size}").view(np.uint8).reshape(*part.shape, size)
    if predictor == 1:
        return np.ascontiguousarray(samples[..., ::-1]).tobytes()
    apart = {3: 1, 34894: 2, 34895: 4}[predictor]
    planes = samples.transpose(0, 2, 1).reshape(len(part), -1, apart)
    return np.concatenate([planes[:, :1], planes[:, 1:] - planes[:, :-1]], axis=1).tobytes()


def _any_photograph() -> dng.Photograph:
    camera = Sensor()
    return dng.Photograph(
        np.zeros((2, 2), np.uint16),
        BLACK,
        WHITE,
        camera.camera_from_xyz,
        camera.neutral(),
        0.01,
        100,
        8.0,
        START,
    )
