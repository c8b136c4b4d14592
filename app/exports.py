"""The formats of an export as a person chooses among them: files, content, frame and units; without Qt.

What docs/file-formats.md says at length, in a line each. Texts are translated in the context "exports".
"""

import fnmatch
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.words import QT_TRANSLATE_NOOP
from engine.errors import ExportError


@dataclass(frozen=True, slots=True)
class Format:
    """One line of the export dialog; a `unit` of "{length}" is the session's unit of length."""

    key: str
    title: str
    files: tuple[str, ...]  # patterns of names in the export
    content: str
    frame: str
    unit: str
    normals: bool = False  # a normal map whose green can be turned round


CAMERA = QT_TRANSLATE_NOOP("exports", "camera: x right, y down, z forward")
SEEN = QT_TRANSLATE_NOOP("exports", "as the camera sees it")
Y_UP = QT_TRANSLATE_NOOP("exports", "y up: x right, z towards the viewer")
WORLD = QT_TRANSLATE_NOOP("exports", "world")
LENGTH = "{length}"

FORMATS = (
    Format("maps", "OpenEXR", ("maps.exr",),
           QT_TRANSLATE_NOOP("exports", "All maps, standard errors and flags, float32"),
           CAMERA, QT_TRANSLATE_NOOP("exports", "unit normals; linear Rec.709; depth in {length}; degrees")),
    Format("normals", "PNG", ("normal.png", "normal_16.png"),
           QT_TRANSLATE_NOOP("exports", "Normal map, 8 and 16 bits"),
           SEEN, QT_TRANSLATE_NOOP("exports", "0.5 + 0.5 n; red right, blue to the viewer, green as below"), normals=True),
    Format("albedo", "PNG", ("albedo.png", "albedo_linear_16.png"),
           QT_TRANSLATE_NOOP("exports", "Albedo, sRGB 8 bits and linear 16 bits"),
           SEEN, QT_TRANSLATE_NOOP("exports", "0 to 1")),
    Format("roughness", "PNG", ("roughness_16.png",),
           QT_TRANSLATE_NOOP("exports", "Roughness, 16 bits"),
           SEEN, QT_TRANSLATE_NOOP("exports", "0 to 1, perceptual: GGX alpha = roughness²")),
    Format("materials", "PNG", ("specular_16.png", "metalness_16.png"),
           QT_TRANSLATE_NOOP("exports", "Specular level and metalness, 16 bits, where not all is of paint"),
           SEEN, QT_TRANSLATE_NOOP("exports", "0 to 1: 0.08 of the level is reflected head on")),
    Format("depth", "PNG", ("depth_16.png",),
           QT_TRANSLATE_NOOP("exports", "Depth, 16 bits; 0 is no answer"),
           CAMERA, QT_TRANSLATE_NOOP("exports", "{length}, between near and far in the file's text")),
    Format("errors", "PNG", ("stderr_normal_16.png",),
           QT_TRANSLATE_NOOP("exports", "Standard error of the normals, 16 bits"),
           SEEN, QT_TRANSLATE_NOOP("exports", "degrees; the file's text tells the scale")),
    Format("pictures", "PNG", ("mask.png", "photograph.png"),
           QT_TRANSLATE_NOOP("exports", "Mask of the object, and one view"),
           SEEN, QT_TRANSLATE_NOOP("exports", "0 or 255; sRGB")),
    Format("ply", "PLY", ("surface.ply",),
           QT_TRANSLATE_NOOP("exports", "Mesh; normals, colour, errors at its vertices"),
           Y_UP, LENGTH),
    Format("glb", "glTF 2.0", ("surface.glb",),
           QT_TRANSLATE_NOOP("exports", "Mesh, textures; tangent-space normals, green up"),
           Y_UP, LENGTH),
    Format("splats", "PLY (3DGS)", ("light.ply",),
           QT_TRANSLATE_NOOP("exports", "The room's light as Gaussian splats"),
           WORLD, QT_TRANSLATE_NOOP("exports", "{length}; radiance on the session's scale")),
    Format("lamps", "JSON", ("lamps.json",),
           QT_TRANSLATE_NOOP("exports", "Small lamps: centre, radius, radiance, clipped or not"),
           WORLD, QT_TRANSLATE_NOOP("exports", "{length}; linear Rec.709 on the session's scale")),
    Format("panorama", "OpenEXR", ("light.exr",),
           QT_TRANSLATE_NOOP("exports", "Panorama of the light at the object"),
           QT_TRANSLATE_NOOP("exports", "one view's camera; equirectangular"),
           QT_TRANSLATE_NOOP("exports", "linear Rec.709; seen: 1 photographed, 0 guessed")),
    Format("coverage", "PNG", ("coverage.png",),
           QT_TRANSLATE_NOOP("exports", "What the panorama rests on: photographed, clipped, guessed"),
           QT_TRANSLATE_NOOP("exports", "one view's camera; equirectangular"),
           QT_TRANSLATE_NOOP("exports", "three colours, named in the file's text")),
    Format("views", "JPEG", ("images/*",),
           QT_TRANSLATE_NOOP("exports", "The views with a pose, named as in the two below"),
           SEEN, QT_TRANSLATE_NOOP("exports", "sRGB, one exposure")),
    Format("colmap", "COLMAP", ("colmap/*",),
           QT_TRANSLATE_NOOP("exports", "Camera and poses as a COLMAP model"),
           WORLD, LENGTH),
    Format("transforms", "transforms.json", ("transforms.json",),
           QT_TRANSLATE_NOOP("exports", "Camera and poses for NeRF tools"),
           QT_TRANSLATE_NOOP("exports", "world; cameras y up, z backward"), LENGTH),
)  # fmt: skip

GREEN = {
    # choice -> (what people call it, which way green points)
    "up": QT_TRANSLATE_NOOP("exports", "Green up (OpenGL: Blender, Maya, glTF)"),
    "down": QT_TRANSLATE_NOOP("exports", "Green down, Y flipped (DirectX: Unreal, 3ds Max)"),
}


@dataclass(frozen=True, slots=True)
class Target:
    """The program that an export is for: the formats that it reads, and which way it wants green of normal maps."""

    title: str
    formats: tuple[str, ...]  # keys of `FORMATS`; none: all of them
    green: str = "up"


TARGETS = {
    "all": Target(QT_TRANSLATE_NOOP("exports", "Everything"), ()),
    "blender": Target("Blender", ("glb", "normals", "albedo", "roughness", "materials", "panorama", "lamps")),
    "unreal": Target(
        "Unreal Engine", ("glb", "normals", "albedo", "roughness", "materials", "panorama"), "down"
    ),
    "substance": Target(
        "Substance 3D", ("normals", "albedo", "roughness", "materials", "depth", "pictures"), "down"
    ),
    "nuke": Target("Nuke", ("maps", "panorama", "lamps", "ply")),
    "metashape": Target("Metashape, COLMAP", ("views", "colmap", "transforms", "pictures")),
    "web": Target("Web", ("glb",)),
}
"""By the word of the command line. Unreal and Substance take green down (DirectX) unless told otherwise."""


@dataclass(frozen=True, slots=True)
class Offer:
    """One format of a finished export: its files there, and their size."""

    format: Format
    files: tuple[str, ...]
    bytes: int


@dataclass(frozen=True, slots=True)
class Export:
    """A finished export."""

    folder: Path
    length: str  # the unit of length, "unknown" where nothing fixed it
    green: str  # of its normal maps: "up" or "down"
    offers: tuple[Offer, ...]


def read(folder: Path) -> Export:
    """What a finished export holds.

    Raises:
        ExportError: it is none, or damaged.
    """
    try:
        index = json.loads((folder / "export.json").read_bytes())
        names = [str(name) for name in index["files"]]
        length, green = str(index["unit_of_length"]), str(index["png"]["normal"]["green"])
        offers = tuple(_offer(entry, folder, names) for entry in FORMATS)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ExportError(f"{folder}: no finished export ({error}); process the session again") from error
    return Export(folder, length, green, tuple(offer for offer in offers if offer.files))


def _offer(entry: Format, folder: Path, names: Collection[str]) -> Offer:
    files = tuple(name for name in names if any(fnmatch.fnmatch(name, pattern) for pattern in entry.files))
    return Offer(entry, files, sum((folder / name).stat().st_size for name in files))


def chosen(export: Export, keys: Collection[str]) -> list[str] | None:
    """The files of the formats chosen; None when that is all of them."""
    files = [name for offer in export.offers if offer.format.key in keys for name in offer.files]
    return None if all(offer.format.key in keys for offer in export.offers) else files


def files_for(folder: Path, target: str) -> list[str] | None:
    """The files of a finished export that a target of `TARGETS` reads; None: all.

    Raises:
        ExportError: it is no finished export, or holds nothing of them.
    """
    export = read(folder)
    files = chosen(export, TARGETS[target].formats or {entry.key for entry in FORMATS})
    if files == []:
        raise ExportError(
            f"{folder}: holds nothing that {TARGETS[target].title} reads; process the session again"
        )
    return files


def request(session: Path, to: Path, export: Export, keys: Collection[str], green: str) -> Mapping[str, Any]:
    """What the task "export" is asked."""
    return {"session": str(session), "to": str(to), "green": green, "files": chosen(export, keys)}


def told_bytes(count: float) -> str:
    """ "640 kB", "1.3 GB"."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5 or unit == "GB":
            return f"{count:.0f} {unit}" if count >= 99.5 or unit == "B" else f"{count:.2g} {unit}"
        count /= 1000
    raise AssertionError
