"""The maps of a finished run: load them, choose one as a picture with its scale, read what stands under a pixel.

Arrays stay memory-mapped, so loading costs little and a read-out touches one page of the disk. Camera frame
(x right, y down, z forward) on the pixel grid of the photographs, all turned to stand upright; no Qt here.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from app.inspect import falsecolour
from app.inspect.falsecolour import Scale
from app.inspect.runs import Run, current, runs_of
from app.quality import quality_of
from app.scaling import fixed_scale
from app.words import QT_TRANSLATE_NOOP
from engine.color import relative_error
from engine.errors import SessionError
from engine.io import scale_edit
from engine.io.formats.arrays import UNREADABLE
from engine.io.scale_edit import ScaleBar
from engine.orientation import back, turn_picture, turned
from engine.pipeline import artifacts
from engine.results.quality import Quality
from engine.sampling import evenly_spaced
from engine.types import METRIC, Camera, Frames, Poses, Surface, ValidationRenders, material_of, part_of

WHITE_VIEWS = 8  # that decide the one exposure of all views
RADIANCE_UNIT = QT_TRANSLATE_NOOP("maps", "session radiance")
DIFFERENCE = 0.3  # ends of the scale of photograph against re-rendering, relative


@dataclass(frozen=True, slots=True)
class Layer:
    """One thing that can be looked at."""

    key: str
    title: str
    unit: str  # of its legend; the depth's is that of the run
    colours: str = ""  # of FALSE colour scales; empty where the picture shows colours or directions


LAYERS = {
    layer.key: layer
    for layer in (
        Layer("photograph", QT_TRANSLATE_NOOP("maps", "Photograph"), RADIANCE_UNIT),
        Layer("rerendered", QT_TRANSLATE_NOOP("maps", "Re-rendered"), RADIANCE_UNIT),
        Layer(
            "difference",
            QT_TRANSLATE_NOOP("maps", "Difference: rendering less photograph"),
            QT_TRANSLATE_NOOP("maps", "% of the photograph's luminance"),
            "signed",
        ),
        Layer("normal", QT_TRANSLATE_NOOP("maps", "Normal"), QT_TRANSLATE_NOOP("maps", "unit vector")),
        Layer("albedo", QT_TRANSLATE_NOOP("maps", "Albedo"), QT_TRANSLATE_NOOP("maps", "0 to 1, linear")),
        Layer(
            "roughness",
            QT_TRANSLATE_NOOP("maps", "Roughness"),
            QT_TRANSLATE_NOOP("maps", "0 to 1, GGX alpha = r²"),
            "viridis",
        ),
        Layer(
            "specular",
            QT_TRANSLATE_NOOP("maps", "Specular level"),
            QT_TRANSLATE_NOOP("maps", "0 to 1; 0.08 of it is mirrored head on"),
            "viridis",
        ),
        Layer(
            "metalness",
            QT_TRANSLATE_NOOP("maps", "Metalness"),
            QT_TRANSLATE_NOOP("maps", "0 paint, 1 metal"),
            "viridis",
        ),
        Layer("depth", QT_TRANSLATE_NOOP("maps", "Depth"), "", "cividis"),
        Layer("part", QT_TRANSLATE_NOOP("maps", "Parts of the depth"), ""),
        Layer(
            "stderr_normal",
            QT_TRANSLATE_NOOP("maps", "Standard error: normal"),
            QT_TRANSLATE_NOOP("maps", "degrees"),
            "magma",
        ),
        Layer(
            "stderr_albedo",
            QT_TRANSLATE_NOOP("maps", "Standard error: albedo"),
            QT_TRANSLATE_NOOP("maps", "albedo"),
            "magma",
        ),
        Layer(
            "stderr_roughness",
            QT_TRANSLATE_NOOP("maps", "Standard error: roughness"),
            QT_TRANSLATE_NOOP("maps", "roughness"),
            "magma",
        ),
        Layer(
            "residual",
            QT_TRANSLATE_NOOP("maps", "Rendering error"),
            QT_TRANSLATE_NOOP("maps", "% of the radiance"),
            "viridis",
        ),
        Layer("flags", QT_TRANSLATE_NOOP("maps", "Flags"), ""),
        Layer("mask", QT_TRANSLATE_NOOP("maps", "Mask"), ""),
    )
}
FACTORS = {"stderr_normal": 180 / np.pi, "residual": 100.0}  # from what is stored to what is shown
MADE_OF = ("specular", "metalness")  # the columns of a material
SHARES = ("roughness", *MADE_OF)  # from 0 to 1


@dataclass(frozen=True, slots=True, eq=False)
class Maps:
    """A finished run, ready to be looked at."""

    run: Run
    surface: Surface
    names: tuple[str, ...]  # of all views
    frames: Frames | None  # None: the photographs' results were removed
    renders: ValidationRenders | None  # of the views kept out of the fit
    registered: Bool[np.ndarray, " n"]
    unit: str  # of depth, as it is shown
    unit_factor: float  # from scene units to it
    white: float  # radiance to show as white at 0 EV, the same for all views
    rerendered: Path = field(default=Path())  # where re-renderings of further views lie, one file each
    quality: Quality | None = None  # None: of another solver
    camera: Camera | None = None  # None: the poses' results were removed
    scale_bar: ScaleBar | None = None  # that fixed the unit

    @property
    def metres(self) -> float:
        """From the surface's lengths to metres where they are known, else to those that are shown."""
        return self.unit_factor / 1000 if self.unit == "mm" else self.unit_factor

    @property
    def held_out(self) -> tuple[int, ...]:
        """Views that took no part in the fit; their re-renderings are part of the result."""
        return () if self.renders is None else self.renders.views


@dataclass(frozen=True, slots=True)
class Look:
    """What is to be shown of a run, and how."""

    layer: str
    view: int = 0
    normal_frame: str = "opengl"
    exposure_ev: float = 0.0
    tone: str = "srgb"
    mark_clipped: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A map as it is drawn: the picture at falling sizes, and its legend."""

    levels: list[UInt8[np.ndarray, "h w 4"]]  # as in falsecolour
    scale: Scale | None
    note: str = ""  # in place of a scale: what the colours mean
    values: Float[np.ndarray, "h w"] | None = None  # of a map of numbers, in the scale's unit


def load(run: Run) -> Maps:
    """Open a run's results.

    Raises:
        SessionError: the surface cannot be read back.
    """
    surface = turned(artifacts.load(run.folder("surface"), "surface", Surface), run.flip)
    frames = turned(_there(run, "hdr", "frames", Frames), run.flip)
    poses = turned(_there(run, "poses", "poses", Poses), run.flip)
    renders = turned(_there(run, "surface", "renders", ValidationRenders), run.flip)
    count = 0 if frames is None else len(frames.names)
    names = () if frames is None else frames.names
    registered = np.ones(count, bool) if poses is None else poses.registered
    by, fixed = fixed_scale(run.session, surface, poses)
    unit, factor = unit_of(fixed)
    white = 1.0 if frames is None else _white(frames, surface.mask)
    verdict = quality_of({stage: run.folder(stage) for stage in ("light", "surface")})
    return Maps(
        run, surface, names, frames, renders, registered, unit, by * factor, white, rerendered_folder(run), verdict,
        None if poses is None else poses.camera, scale_edit.read(run.session),
    )  # fmt: skip


def load_current(session: Path) -> Maps | None:
    """Open the run that the pages show first; None where there is none yet.

    Raises:
        SessionError: the surface cannot be read back.
    """
    run = current(runs_of(session))
    return None if run is None else load(run)


def unit_of(scale: str) -> tuple[str, float]:
    """(unit, factor from what `scale` fixes) of lengths as shown; `scale` as in `engine.types.Poses`."""
    if scale in METRIC:
        return "mm", 1000.0
    return (
        QT_TRANSLATE_NOOP("maps", "units of the given poses")
        if scale == "given"
        else QT_TRANSLATE_NOOP("maps", "scene units")
    ), 1.0


def rerendered_folder(run: Run) -> Path:
    """Where re-renderings on demand are kept; may be removed at any time."""
    return run.session / "derived" / "rerendered" / run.fingerprint


def object_box(maps: Maps) -> tuple[int, int, int, int] | None:
    """Left, top, right, bottom of the object, in pixels."""
    rows, columns = (np.nonzero(maps.surface.mask.any(axis))[0] for axis in (1, 0))
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def photograph(maps: Maps, view: int) -> Float[np.ndarray, "h w 3"] | None:
    return None if maps.frames is None else maps.frames.radiance[view]


def rendering(maps: Maps, view: int) -> Float[np.ndarray, "h w 3"] | None:
    """The run's surface under its light in a view; None where that was not computed yet."""
    if maps.renders is not None and view in maps.renders.views:
        return maps.renders.radiance[maps.renders.views.index(view)]
    try:
        flat = np.load(maps.rerendered / f"{view:04d}.npy", allow_pickle=False)
    except UNREADABLE:
        return None
    if flat.shape != (int(maps.surface.mask.sum()), 3):
        return None
    mask = turn_picture(maps.surface.mask, back(maps.run.flip))  # as the sensor lies, as it was re-rendered
    picture = np.zeros((*mask.shape, 3), np.float32)
    picture[mask] = flat
    return turn_picture(picture, maps.run.flip)


def values(maps: Maps, key: str) -> Float[np.ndarray, "h w"]:
    """A scalar map in the unit it is shown in."""
    if key in MADE_OF:
        return material_of(maps.surface)[..., MADE_OF.index(key)]
    factor = maps.unit_factor if key == "depth" else FACTORS.get(key, 1.0)
    stored = getattr(maps.surface, key)
    return stored if factor == 1.0 else stored * np.float32(factor)


def scale_of(maps: Maps, key: str) -> Scale:
    """The scale of a scalar map: 0 to 1 for what is a share, 0 to the 98th percentile for errors, 1 to 99 % for depth."""
    layer = LAYERS[key]
    inside = values(maps, key)[maps.surface.mask]
    unit = maps.unit if key == "depth" else layer.unit
    if key in SHARES or not inside.size:
        return Scale(0.0, 1.0, unit, layer.colours)
    if key == "depth":
        low, high = (float(x) for x in np.percentile(inside, [1, 99]))
        return Scale(low, high if high > low else low + 1e-6, unit, layer.colours)
    return Scale(0.0, float(np.percentile(inside, 98)) or 1.0, unit, layer.colours)


def picture(maps: Maps, look: Look) -> Picture | None:
    """What `look` asks for, or None where it is not there (a re-rendering nobody has computed)."""
    if look.layer in ("photograph", "rerendered", "difference"):
        return _light(maps, look)
    s, mask = maps.surface, maps.surface.mask
    if look.layer == "normal":
        drawn, note = falsecolour.normals(s.normal, mask, look.normal_frame), FRAME_NOTES[look.normal_frame]
    elif look.layer == "albedo":
        drawn, note = (
            falsecolour.colour(s.albedo, mask),
            QT_TRANSLATE_NOOP("maps", "0 to 1, shown sRGB-encoded"),
        )
    elif look.layer == "flags":
        drawn, note = falsecolour.flags(s.flags, mask), ""
    elif look.layer == "part":
        drawn, note = falsecolour.parts(part_of(s), mask), PARTS_NOTE
    elif look.layer == "mask":
        drawn, note = falsecolour.plain(mask), f"{int(mask.sum())} px"
    else:
        scale, numbers = scale_of(maps, look.layer), values(maps, look.layer)
        return Picture(falsecolour.halves(falsecolour.scalar(numbers, mask, scale)), scale, "", numbers)
    return Picture(falsecolour.halves(drawn), None, note)


def _light(maps: Maps, look: Look) -> Picture | None:
    """A photograph, its re-rendering, or their difference."""
    photographed, mask = photograph(maps, look.view), maps.surface.mask
    made = None if look.layer == "photograph" else rendering(maps, look.view)
    if photographed is None or (look.layer != "photograph" and made is None):
        return None
    if look.layer == "difference" and made is not None:
        error = 100 * relative_error(photographed, made, mask)
        scale = Scale(-100 * DIFFERENCE, 100 * DIFFERENCE, LAYERS["difference"].unit, "signed")
        return Picture(falsecolour.halves(falsecolour.scalar(error, mask, scale)), scale, "", error)
    if made is None:
        clipped = maps.frames.clipped[look.view] if look.mark_clipped and maps.frames is not None else None
        drawn = falsecolour.radiance(photographed, maps.white, look.exposure_ev, look.tone, clipped=clipped)
    else:
        drawn = falsecolour.radiance(made, maps.white, look.exposure_ev, look.tone, mask)
    note = f"{RADIANCE_UNIT}, white at {maps.white * 2.0**-look.exposure_ev:.3g}"
    return Picture(falsecolour.halves(drawn), None, note)


PARTS_NOTE = QT_TRANSLATE_NOOP(
    "maps",
    "offsets between parts are less certain than the shape of one: see the standard error under the pointer",
)
FRAME_NOTES: Mapping[str, str] = {
    "opengl": QT_TRANSLATE_NOOP("maps", "OpenGL: red right, green up, blue to the viewer"),
    "directx": QT_TRANSLATE_NOOP("maps", "DirectX: red right, green down, blue to the viewer"),
    "camera": QT_TRANSLATE_NOOP("maps", "camera frame: red right, green down, blue away"),
}


def _there(run: Run, stage: str, record: str, kind: type):
    """A record, or None where its files are gone."""
    try:
        folder = run.folder(stage)
        return artifacts.load(folder, record, kind) if (folder / f"{record}.json").is_file() else None
    except (SessionError, KeyError):
        return None


def _white(frames: Frames, mask: Bool[np.ndarray, "h w"]) -> float:
    """The 99th percentile of the object's brightest channel over some views."""
    views = evenly_spaced(len(frames.names), WHITE_VIEWS)
    inside = [frames.radiance[view][mask].max(axis=-1) for view in views] if mask.any() else []
    return float(np.percentile(np.concatenate(inside), 99)) or 1.0 if inside else 1.0
