"""What may be asked of the paper's inverse renderer, and what it reports; no torch, so that planning stays quick.

Source: the paper, Sec. 4, "Implementation details": every default is as published.
"""

from dataclasses import dataclass
from typing import Literal, get_args

from engine.conventions import NORMAL_FRAMES
from engine.errors import SurfaceError
from engine.surface.lighting.distance_search import Distance
from engine.surface.params import Diffuse
from engine.validation import MORE, check

Emitter = Literal["ours", "two_stage", "one_stage"]
SAMPLES, EPOCHS = 256, 100
MOST = 3_000_000
"""Gaussians of the paper's own light at most."""


BOUNDS = {
    "samples": (1, MORE), "epochs": (0, MORE), "batch_views": (1, MORE), "normal_rate": (0.0, MORE),
    "albedo_rate": (0.0, MORE), "roughness_rate": (0.0, MORE), "depth_rate": (0.0, MORE), "halve_every": (0, MORE),
    "smoothness": (0.0, MORE), "smooth_epochs": (0, MORE), "aim_unit": (0.0, MORE), "pixels": (0, MORE),
    "validation_views": (0, MORE), "object_distance": (0.0, MORE), "emitter_share": (1e-4, MORE), "emitter_most": (1, MORE),
}  # fmt: skip
"""What each number that may be asked must lie between."""


@dataclass(frozen=True, slots=True)
class ReferenceParams:
    """The counts and rates of the paper, and what it leaves to the data.

    Raises:
        SurfaceError: what is asked lies outside `BOUNDS`, or is no choice that there is.
    """

    samples: int = SAMPLES  # directions of Eq. (8) per pixel, view and step
    epochs: int = EPOCHS  # passes over all fitted views
    batch_views: int = 4  # views of one step of Adam
    normal_rate: float = 5e-4
    albedo_rate: float = 1e-2  # of its logit
    roughness_rate: float = 1e-2  # of its logit
    depth_rate: float = 1e-4  # in units of the object's distance
    halve_every: int = 25  # epochs after which all rates are halved, again and again; 0: never
    smoothness: float = 0.01  # weight of Eq. (16)
    smooth_epochs: int = 50  # epochs that have it; those after have none
    emitter_sampling: bool = True  # Eq. (12) beside the cosine; False: GGX beside it, the paper's ablation
    aim_by_emission: bool = (
        False  # lobes follow what the Gaussians send out; False: their centres, as published
    )
    aim_unit: float = 0.0  # length that Eq. (12) takes for 1, scene units; 0: the object's distance
    pixels: int = 0  # object pixels solved, a random part in small tiles; 0: all
    diffuse: Diffuse = "lambert"  # Lambert (10) as in the paper; or "disney": Disney's own diffuse lobe
    validation_views: int = 4  # views kept out of the fit and re-rendered; one in eight at most
    object_distance: float = 0.0  # camera to object along z, scene units; 0: by the fast solver's first look
    initial_normals: str = (
        ""  # .exr, .png, .npy or .npz with first normals (roughness, albedo); empty: our search
    )
    normals_frame: str = (
        "opencv"  # axes of those normals: y down, z ahead; or "opengl": y up, z to the camera
    )
    # The light: the stage before's, or the paper's own training, in two stages as published or in one, its ablation.
    emitter: Emitter = "ours"
    emitter_share: float = 1.0  # of the published iterations of that training
    emitter_most: int = MOST  # Gaussians that it may end with

    def __post_init__(self) -> None:
        choices = {"normals_frame": NORMAL_FRAMES, "emitter": get_args(Emitter), "diffuse": get_args(Diffuse)}
        check(self, "surface", SurfaceError, BOUNDS, choices)


def scaled(samples: int, epochs: int) -> ReferenceParams:
    """The published schedule on fewer samples and epochs; what is counted in epochs shrinks with them.

    Such a run is not the paper's: `title` says what it is.
    """
    return ReferenceParams(
        samples=samples,
        epochs=epochs,
        halve_every=max(1, round(25 * epochs / EPOCHS)),
        smooth_epochs=round(50 * epochs / EPOCHS),
    )


def title(params: ReferenceParams) -> str:
    """What a run may be called in a table: "reference as published", or its counts and what else differs."""
    if params.samples == SAMPLES and params.epochs == EPOCHS:
        name = "reference as published"
    else:
        name = f"reference at {params.samples} samples, {params.epochs} epochs"
    if not params.emitter_sampling:
        name += ", without emitter sampling"
    elif params.aim_by_emission:
        name += ", aimed by emission"
    if params.emitter == "ours":
        return name
    name += (
        f", the paper's light in {params.emitter.replace('_', ' ')}{'s' * (params.emitter == 'two_stage')}"
    )
    if params.emitter_share != 1:
        name += f", {params.emitter_share:.3g} of the iterations"
    return name if params.emitter_most == MOST else f"{name}, {params.emitter_most:,} Gaussians at most"


@dataclass(frozen=True, slots=True)
class ReferenceReport:
    """Facts of one run, fit for JSON; times are of this machine and belong to no comparison of results."""

    title: str
    pixels: int  # solved
    object_pixels: int  # of the mask
    fitted_views: int
    held_out_views: tuple[int, ...]
    held_out_error: float  # median relative error of the re-rendered radiance, over the pixels solved
    samples: int
    epochs: int
    steps: int
    radiance_unit: float  # the 1 of Eq. (14)
    distance: Distance
    emitter: str  # whose light: "ours" | "two_stage" | "one_stage"
    gaussians: int  # of that light
    emitter_seconds: float  # its training; 0 for ours
    colour_loss: tuple[float, ...]  # Eq. (14) per epoch, mean over its steps
    normal_loss: tuple[float, ...]  # Eq. (15)
    smooth_loss: tuple[float, ...]  # Eq. (16), unweighted
    start_seconds: float  # first normals, depth, mixture and tree
    seconds: float  # all epochs
    seconds_per_sample: float  # `seconds` over pixels x views x samples x epochs
    seconds_per_pixel: float  # `seconds` over pixels
    published_seconds: float  # extrapolated: all object pixels, these views, SAMPLES and EPOCHS
