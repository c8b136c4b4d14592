"""A small picture of one format of a finished export; drawn in a child.

What is a picture is shown as it is. Kept in the person's cache, by the export's fingerprint.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from plyfile import PlyData

from app import exports, places
from app.exports import Export, Offer
from app.inspect import falsecolour
from app.work.stage_picture import write
from engine.io.images import read_radiance

Picture = UInt8[np.ndarray, "h w 4"]  # blue, green, red, alpha

EDGE_PX = 480
YAW, PITCH = np.radians(-35.0), np.radians(20.0)
"""From where a mesh is seen, that its shape be seen."""
AMBIENT = 0.25
SHOWN_BY = {
    "maps": "normal.png",
    "splats": "light.exr",
    "lamps": "light.exr",
    "glb": "surface.ply",
    "pictures": "photograph.png",
}
"""Files that show a format whose own are no pictures, in its place."""


def show(content: Mapping[str, Any]) -> dict[str, Any]:
    """The answer to the question "exported": folder (of the export), format (a key of `FORMATS`). Answer: picture, or None."""
    found = exports.read(Path(content["folder"]))
    offer = next((offer for offer in found.offers if offer.format.key == content["format"]), None)
    file = None if offer is None else _shown(found, offer)
    if file is None:
        return {"picture": None}
    draw = DRAW.get(file.suffix)
    if draw is None:
        return {"picture": str(file)}
    to = places.cache() / "made" / f"export-{found.folder.name}-{file.stem}.png"
    if not to.is_file():
        write(to, draw(file))
    return {"picture": str(to)}


def _shown(found: Export, offer: Offer) -> Path | None:
    """The file that shows a format; None where none does."""
    file = found.folder / SHOWN_BY.get(offer.format.key, offer.files[0])
    return file if file.suffix in (*DRAW, ".png", ".jpg") and file.is_file() else None


def _panorama(file: Path) -> Picture:
    radiance = read_radiance(file)
    return falsecolour.radiance(radiance, float(np.percentile(radiance, 99.5)) or 1.0, 0.0, "log")


def _mesh(file: Path) -> Picture:
    """Its vertices from aside, lit from the eye; near ones cover those behind."""
    vertices = PlyData.read(str(file))["vertex"]
    points, normals = (np.stack([vertices[k] for k in names], -1) for names in ("xyz", ("nx", "ny", "nz")))
    colours = np.stack([vertices[k] for k in ("blue", "green", "red")], -1)
    turned = points.astype(np.float64) @ _turn().T
    shade = AMBIENT + (1 - AMBIENT) * np.clip((normals @ _turn().T)[:, 2:], 0, 1)
    low, high = turned.min(0)[:2], turned.max(0)[:2]
    # About as many pixels as there are vertices, of which each covers four, leave hardly any hole.
    wide, tall = (high - low) * min(EDGE_PX / (high - low).max(), np.sqrt(len(points) / np.prod(high - low)))
    at = ((turned[:, :2] - low) / (high - low) * [wide, tall]).astype(int)
    picture = np.zeros((int(tall) + 2, int(wide) + 2, 4), np.uint8)
    order = np.argsort(turned[:, 2])  # the nearest last
    column, row = np.repeat(at[order], 4, axis=0).T + np.tile([[0, 0, 1, 1], [0, 1, 0, 1]], len(at))
    drawn = np.append(colours * shade, np.full((len(at), 1), 255), axis=1)
    picture[len(picture) - 1 - row, column] = np.repeat(drawn[order], 4, axis=0)
    return picture


def _turn() -> Float[np.ndarray, "3 3"]:
    """eye_from_mesh; both x right, y up, z towards the viewer."""
    (c, s), (cp, sp) = ((np.cos(angle), np.sin(angle)) for angle in (YAW, PITCH))
    return np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]]) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


DRAW: Mapping[str, Callable[[Path], Picture]] = {".exr": _panorama, ".ply": _mesh}
