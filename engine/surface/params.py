"""What a person may ask of the surface solve, and between which bounds."""

from dataclasses import dataclass
from typing import Literal, get_args

from engine.conventions import LEAST_VIEWS, NORMAL_FRAMES
from engine.errors import SurfaceError
from engine.validation import MORE, check

Diffuse = Literal["disney", "lambert"]
"""Lobes: Disney's with retro-reflection, as renderers have it, and the paper's."""
PARTS = (
    "self_shadowing", "interreflections", "hidden_surfaces", "mixed_pixels", "robust_loss", "light_gains", "view_exposures",
    "lamp_directions", "detect_metal", "classify_material", "expect_roughness", "regularize",
)  # fmt: skip
"""What `SurfaceParams.without` can leave out: parts of the model, the last four of them passes of the schedule. Hidden surfaces
are steps of the depth, mixed pixels those of the rim; gains, exposures and directions are what the object's shading corrects."""

BOUNDS = {
    "directions": (64, MORE), "views": (LEAST_VIEWS, MORE), "probe_grid_xy": (0, MORE), "probe_grid_z": (0, MORE),
    "probe_resolution": (8, MORE), "normal_candidates": (10, MORE), "coarse_iterations": (0, MORE),
    "coarse_views": (LEAST_VIEWS, MORE), "fine_iterations": (1, MORE), "gauss_newton_steps": (1, MORE),
    "light_groups": (1, MORE), "light_gain_sigma": (0.001, MORE), "model_error": (0.001, MORE),
    "solves": (1, MORE), "validation_views": (0, MORE), "object_distance": (0.0, MORE), "tile_above_pixels": (100, MORE),
}  # fmt: skip
"""What each number that may be asked must lie between."""
OR_NONE = ("directions", "views")
"""Of these, those that may also be 0."""


@dataclass(frozen=True, slots=True)
class SurfaceParams:
    """What the person may ask of the surface solve.

    Raises:
        SurfaceError: too little is asked.
    """

    directions: int = 0  # cells on the sphere of incident directions; 0: as the roughness asks
    probe_grid_xy: int = 0  # probe points along each image axis of the object's box; 0: as the parallax asks
    probe_grid_z: int = 0  # the same along the viewing axis
    probe_resolution: int = 48  # pixels along one face of each probe's cube
    normal_candidates: int = 300  # tried by the global search
    coarse_iterations: int = 4  # on pixels of half the size: solve, integrate, trace, calibrate the light
    coarse_views: int = 32  # that serve in these iterations
    full_phase: bool = True  # the light is calibrated once more with all pixels, if some hide the room
    views: int = 0  # that serve afterwards, spread evenly; 0: all
    fine_iterations: int = 3  # at most, on all pixels until they stand still: solve, integrate, trace
    gauss_newton_steps: int = 4  # evaluations in each iteration
    solves: int = 1  # from three on their medoid is taken, pixel by pixel
    diffuse: Diffuse = "disney"
    without: tuple[str, ...] = ()  # of `PARTS`: what the model leaves out, for ablations
    light_groups: int = 12  # groups of emitters besides the lamps
    light_gain_sigma: float = 0.02  # how far a group's log brightness may be off before it has to be argued
    model_error: float = 0.02  # relative misfit expected of a good model
    validation_views: int = 4  # kept out of the fit and rendered again; one in eight at most
    object_distance: float = 0.0  # camera to object along z, scene units; 0: found
    # Pixels solved jointly; of a larger object a smaller picture is, then every pixel in tiles.
    tile_above_pixels: int = 400_000
    initial_normals: str = (
        ""  # .exr, .png, .npy or .npz with first normals (and roughness); empty: our search
    )
    initial_roughness: str = ""  # the same with first roughness, where it is a file of its own
    normals_frame: str = "opencv"  # of those: y down, z ahead; or "opengl": y up, z to the camera

    def __post_init__(self) -> None:
        choices = {"normals_frame": NORMAL_FRAMES, "diffuse": get_args(Diffuse), "without": PARTS}
        check(self, "surface", SurfaceError, BOUNDS, choices, OR_NONE)
        if self.initial_roughness and not self.initial_normals:
            raise SurfaceError(
                "surface.initial_roughness begins nothing alone; give surface.initial_normals too"
            )

    def models(self, *parts: str) -> bool:
        """Whether the model has all of these parts."""
        return not set(parts) & set(self.without)
