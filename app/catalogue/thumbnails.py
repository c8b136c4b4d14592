"""Small pictures of a session's export, cut to the object, in three sizes for a page and for viewers of the IIIF kind."""

import shutil
from pathlib import Path

import numpy as np
from PIL import Image

from app.catalogue.rows import PICTURES, Row
from engine.errors import SessionError
from engine.io.images import UNREADABLE_PICTURE, opened
from engine.io.session import told
from engine.results.report.embedded_images import OUTSIDE, crop

EDGES = (150, 400, 1000)
"""Longest edges, pixels. A picture is not enlarged: of a smaller one the larger sizes hold its own pixels."""
QUALITY = 90


def draw(row: Row, images: Path) -> None:
    """`images/KEY/FINGERPRINT/albedo-400.jpg` and so on; done already where that export's pictures are there.

    Raises:
        SessionError: a picture of the export is damaged, or the disk refuses.
    """
    if row.export is None or row.export_fingerprint is None:
        return
    to = images / row.key / row.export_fingerprint
    if to.is_dir():
        return
    partial = to.with_name(f".{to.name}.partial")
    with told(to):
        shutil.rmtree(to.parent, ignore_errors=True)
        partial.mkdir(parents=True)
        export = Path(row.export)
        mask = _read(export / "mask.png", "L") > 127
        rows, columns = crop(mask)
        for name, file in PICTURES.items():
            picture = _read(export / file, "RGB")
            if name != "photograph":
                picture = np.where(mask[..., None], picture, OUTSIDE).astype(np.uint8)
            _write(Image.fromarray(np.ascontiguousarray(picture[rows, columns])), partial, name)
        partial.rename(to)


def _read(path: Path, mode: str) -> np.ndarray:
    try:
        with opened(path) as image:
            return np.asarray(image.convert(mode))
    except UNREADABLE_PICTURE as error:
        raise SessionError(
            f"{path}: cannot be read ({error}); remove the folder {path.parent} and process again"
        ) from error


def _write(picture: Image.Image, to: Path, name: str) -> None:
    for edge in EDGES:
        small = picture.copy()
        small.thumbnail((edge, edge), Image.Resampling.LANCZOS)
        small.save(to / f"{name}-{edge}.jpg", quality=QUALITY)
