"""What flows from stage to stage: frozen records of arrays, each with its shape, unit and frame.

Conventions (every file obeys them): `a_from_b` names a transform; camera frame is OpenCV's (x right,
y down, z forward) and the centre of the first pixel is (0.5, 0.5); the object lives in the camera frame;
the light lives in the world frame; radiance is linear Rec.709 on one scale per session; directions are
unit vectors pointing away from the surface; a normal that faces the camera has z < 0.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Int16, UInt8


@dataclass(frozen=True, slots=True)
class Camera:
    """A pinhole with OpenCV's radial-tangential distortion; one per session.

    Focal lengths and principal point in pixels; (0.5, 0.5) is the centre of the first pixel.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """The photographs as linear radiance: stage *hdr*'s answer.

    `noise` holds (shot, floor): the variance of a radiance x is about shot * x + floor**2 per channel.
    `clipped` marks pixels saturated in every exposure: their radiance is a lower bound.
    `dark` marks pixels below noise in every exposure.
    """

    names: tuple[str, ...]
    radiance: Float[np.ndarray, "n h w 3"]  # float32, linear Rec.709, session scale
    clipped: Bool[np.ndarray, "n h w"]
    dark: Bool[np.ndarray, "n h w"]
    noise: tuple[float, float]

    def views(self, index: Int[np.ndarray, " k"]) -> "Frames":
        """The same of some photographs."""
        names = tuple(self.names[i] for i in index)
        return Frames(names, self.radiance[index], self.clipped[index], self.dark[index], self.noise)


@dataclass(frozen=True, slots=True, eq=False)
class Masks:
    """Stage *segment*'s answer: where the object is, and where each view shows the room.

    `object` holds the object with whatever carries it. `background` excludes it with a margin, and
    whatever else is unfit to show the room in that view.
    """

    object: Bool[np.ndarray, "h w"]
    background: Bool[np.ndarray, "n h w"]

    def views(self, index: Int[np.ndarray, " k"]) -> "Masks":
        """The same of some photographs."""
        return Masks(self.object, self.background[index])


METRIC = ("rig", "board", "scale bar")
"""What makes a scene unit a metre."""


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Stage *poses*'s answer. Rows of unregistered views hold NaN and `registered` is False there."""

    camera: Camera
    cam_from_world: Float[np.ndarray, "n 3 4"]  # float64, x_cam = R x_world + t
    registered: Bool[np.ndarray, " n"]
    points: Float[np.ndarray, "m 3"]  # sparse points, world frame; may be empty
    scale: str  # "rig" | "board" | "scale bar" | "given" | "unknown": what fixes the length of one scene unit
    reprojection_px: float  # mean over all observations; NaN when poses were given

    @property
    def metric(self) -> bool:
        """Whether a scene unit is a metre."""
        return self.scale in METRIC

    def among(self, index: Int[np.ndarray, " n"], count: int) -> "Poses":
        """As the views of these indices among `count`; the others are not registered."""
        cam_from_world = np.full((count, 3, 4), np.nan)
        registered = np.zeros(count, bool)
        cam_from_world[index], registered[index] = self.cam_from_world, self.registered
        return replace(self, cam_from_world=cam_from_world, registered=registered)


@dataclass(frozen=True, slots=True, eq=False)
class Gaussians:
    """The room's light as 3D Gaussians, world frame, G = exp(-(x-mu)^T Sigma^-1 (x-mu)) without 1/2 (2).

    Sigma = R diag(scales**2) R^T with R from unit quaternions (w, x, y, z); alpha = 1 - exp(-density G) (4).
    `radiance` holds real spherical-harmonic coefficients per channel, first index the constant basis
    function, in the order of Sloan 2008; the constant coefficient alone gives radiance = coeff * Y00,
    clamped at zero when evaluated.
    """

    means: Float[np.ndarray, "k 3"]
    quaternions: Float[np.ndarray, "k 4"]
    scales: Float[np.ndarray, "k 3"]  # scene units, > 0
    density: Float[np.ndarray, " k"]  # sigma of (4), > 0
    radiance: Float[np.ndarray, "k b 3"]  # b = (degree + 1)**2


@dataclass(frozen=True, slots=True, eq=False)
class Lamps:
    """Small round lamps of the room as spheres of even radiance, world frame; the last of the Gaussians too.

    Where `clipped`, no view shows the lamp unclipped, and the radiance is a lower bound.
    """

    centres: Float[np.ndarray, "l 3"]
    radii: Float[np.ndarray, " l"]  # scene units
    radiance: Float[np.ndarray, "l 3"]  # linear Rec.709, session scale
    clipped: Bool[np.ndarray, " l"]


@dataclass(frozen=True, slots=True, eq=False)
class Emitters:
    """The room's light with its lamps apart. Stage *surface* keeps the one it solved under: as bright as the
    object's shading told, or as it was given.

    Of the Gaussians the lamps are the last, and before them come `patches` that close the room where no
    photograph looked.
    """

    gaussians: Gaussians
    lamps: Lamps
    patches: int

    def field(self) -> Gaussians:
        """Everything but the lamps."""
        return self._first(len(self.gaussians.means) - len(self.lamps.radii))

    def shown(self) -> Gaussians:
        """The field as photographs show it: what may stand before a lamp."""
        return self._first(len(self.gaussians.means) - len(self.lamps.radii) - self.patches)

    def photographed(self) -> Gaussians:
        """Everything but the patches: the field as photographs show it, and the lamps."""
        lamps = len(self.gaussians.means) - len(self.lamps.radii)
        kept = np.r_[0 : lamps - self.patches, lamps : len(self.gaussians.means)]
        return Gaussians(*(getattr(self.gaussians, name)[kept] for name in Gaussians.__slots__))

    def _first(self, count: int) -> Gaussians:
        return Gaussians(*(getattr(self.gaussians, name)[:count] for name in Gaussians.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class CapturedScene:
    """What the stages before *surface* left: photographs, what in them is the object, where they were taken from, and the
    room's light, whose lamps are the last of the Gaussians."""

    frames: Frames
    masks: Masks
    poses: Poses
    gaussians: Gaussians
    lamps: Lamps


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Stage *surface*'s answer, on the pixel grid of the photographs, camera frame.

    Values outside `mask` are zero. `stderr_*` are one standard error.
    `flags` is a bit field: 1 grazing, 2 shadowed in most views, 4 saturated, 8 ill-conditioned, 16 lit by what no photograph shows.
    """

    mask: Bool[np.ndarray, "h w"]
    normal: Float[np.ndarray, "h w 3"]
    albedo: Float[np.ndarray, "h w 3"]
    roughness: Float[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]  # z, scene units
    stderr_normal: Float[np.ndarray, "h w"]  # radians
    stderr_albedo: Float[np.ndarray, "h w"]
    stderr_roughness: Float[np.ndarray, "h w"]
    residual: Float[np.ndarray, "h w"]  # robust relative misfit
    flags: UInt8[np.ndarray, "h w"]
    material: Float[np.ndarray, "h w 2"] | None = (
        None  # Disney's specular level, metalness; None: 0.5, 0 everywhere
    )
    # 1: the largest part of the depth that no jump divides, 2: the next, ...; 0: a part too small to be told, or off the mask.
    # None: not known.
    part: Int16[np.ndarray, "h w"] | None = None
    stderr_part: Float[np.ndarray, "h w"] | None = (
        None  # scene units: of where a pixel's part stands beside the others
    )


def material_of(surface: Surface) -> Float[np.ndarray, "h w 2"]:
    """Specular level and metalness of every pixel, zero outside the mask; float32."""
    made = np.array([0.5, 0.0]) if surface.material is None else surface.material
    return np.where(surface.mask[..., None], made, 0).astype(np.float32)


def part_of(surface: Surface) -> Int16[np.ndarray, "h w"]:
    """The part of the depth that every pixel belongs to; zero where it is not known."""
    return np.zeros(surface.mask.shape, np.int16) if surface.part is None else surface.part


@dataclass(frozen=True, slots=True, eq=False)
class ValidationRenders:
    """Views kept out of the surface's fit, re-rendered from the answer; zero outside the object."""

    views: tuple[int, ...]  # indices into Frames
    radiance: Float[np.ndarray, "k h w 3"]  # float32, session scale


@dataclass(frozen=True, slots=True, eq=False)
class SolvedScene:
    """What a solver of stage *surface* answers."""

    surface: Surface
    renders: ValidationRenders
    emitters: Emitters  # the light it was solved under
    report: Any  # the solver's facts, fit for JSON


@dataclass(frozen=True, slots=True, eq=False)
class Panorama:
    """Radiance that arrives at the object's centre in one view, in the camera frame of that view.

    Column u of w, row v of h: azimuth phi = 2 pi (u + 0.5) / w - pi, polar angle theta = pi (v + 0.5) / h from
    -y (up); direction = (sin theta sin phi, -cos theta, sin theta cos phi), so the middle looks along +z.
    """

    view: str
    radiance: Float[np.ndarray, "h w 3"]
    seen: Float[np.ndarray, "h w"]  # 1 where photographs show that direction, 0 where it is a guess


@dataclass(frozen=True, slots=True, eq=False)
class LightProvenance:
    """What the light of a `Panorama` rests on, laid out as that.

    Shares are of the diffuse irradiance (luminance) averaged over the object's normals, 0 to 1.
    """

    kind: UInt8[np.ndarray, "h w"]  # 0 photographed, 1 clipped in every photograph that shows it, 2 guessed
    guessed: float
    lower_bound: (
        float  # share that comes from clipped directions, of which photographs tell the least and no more
    )
