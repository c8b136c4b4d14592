"""Makes the README's picture of a processed session: photograph, normals, albedo, roughness, and the light.

    python -m tests.bench.picture SESSION PICTURE.jpg

Everything comes from the session's export (docs/file-formats.md).
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
from matplotlib import colormaps

from engine.io.png import srgb, to_8_bit

GAP = 12
TALL = 420


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="picture", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("picture", type=Path)
    args = parser.parse_args(argv)
    export = args.session / "exports" / "latest"
    if not (export / "export.json").is_file():
        print(f"{export}: no export there; run `roomlight process {args.session}` first", file=sys.stderr)
        return 2
    cv2.imwrite(str(args.picture), compose(export)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
    print(args.picture)
    return 0


def compose(export: Path) -> np.ndarray:
    """Four maps in a row, cropped to the object, and the panorama of the light below."""
    mask = read(export / "mask.png")[..., 0] > 0
    rough = np.asarray(cv2.imread(str(export / "roughness_16.png"), cv2.IMREAD_UNCHANGED)) / 65535
    maps = [
        read(export / "normal.png"),
        read(export / "albedo.png"),
        to_8_bit(np.asarray(colormaps["viridis"](rough))[..., :3]),
    ]
    rows, columns = np.nonzero(mask.any(1))[0], np.nonzero(mask.any(0))[0]
    pad = int(0.08 * max(np.ptp(rows), np.ptp(columns))) + 1
    cut = (
        slice(max(rows[0] - pad, 0), rows[-1] + pad + 1),
        slice(max(columns[0] - pad, 0), columns[-1] + pad + 1),
    )
    tiles = [read(export / "photograph.png")[cut], *(np.where(mask[..., None], m, 255)[cut] for m in maps)]
    scale = TALL / tiles[0].shape[0]
    tiles = [
        cv2.resize(t.astype(np.uint8), None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC) for t in tiles
    ]
    gap = np.full((tiles[0].shape[0], GAP, 3), 255, np.uint8)
    top = np.concatenate([part for t in tiles for part in (t, gap)][:-1], axis=1)
    light = panorama(export / "light.exr")
    middle = light[light.shape[0] // 6 : light.shape[0] * 5 // 6]
    height = round(middle.shape[0] * top.shape[1] / middle.shape[1])
    below = cv2.resize(middle, (top.shape[1], height), interpolation=cv2.INTER_AREA)
    return np.concatenate([top, np.full((GAP, top.shape[1], 3), 255, np.uint8), below])


def panorama(path: Path) -> np.ndarray:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        light = np.stack([file.channels()[c].pixels for c in "RGB"], -1).astype(np.float64)
    middle = np.median(light.max(-1))
    return to_8_bit(srgb(light / (light + 2 * max(float(middle), 1e-9))))


def read(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise SystemExit(f"{path}: cannot be read; export the session again")
    return image[..., ::-1]


if __name__ == "__main__":
    sys.exit(main())
