"""What a person may ask of the surface solve, and between which bounds."""

from dataclasses import dataclass

from engine.conventions import NORMAL_FRAMES
from engine.errors import SurfaceError
from engine.validation import MORE, check

LEAST_VIEWS = 8


BOUNDS = {
    "directions": (64, MORE), "views": (LEAST_VIEWS, MORE), "probes_across": (0, MORE), "probes_deep": (0, MORE),
    "probe_face_px": (8, MORE), "candidates": (10, MORE), "rough_rounds": (0, MORE), "rough_views": (LEAST_VIEWS, MORE),
    "rounds": (1, MORE), "passes": (1, MORE), "relight_groups": (1, MORE), "relight_prior": (0.001, MORE),
    "model_error": (0.001, MORE), "held_out": (0, MORE), "object_distance": (0.0, MORE), "together": (100, MORE),
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

    directions: int = 0  # cells on the sphere of incident directions; 0: as the gloss asks
    probes_across: int = 0  # probe points along each image axis of the object's box; 0: as the parallax asks
    probes_deep: int = 0  # the same along the viewing axis
    probe_face_px: int = 48  # resolution of one face of each probe's cube
    candidates: int = 300  # normals tried by the global search
    rough_rounds: int = 4  # on pixels of half the size: solve, integrate, see, refine the light: how often
    rough_views: int = 32  # that serve in these rounds
    full_turn: bool = (
        True  # one turn more before the last look at the light, with all pixels if some hide the room
    )
    views: int = 0  # that serve after them, spread evenly; 0: all
    rounds: int = 3  # at most, on all pixels until they stand still: solve, integrate, see
    passes: int = 4  # Gauss-Newton evaluations in each round
    full_diffuse: bool = True  # Disney's diffuse lobe; False is the paper's Lambert (10)
    visibility: bool = True  # let the object shadow itself
    follow_depth: bool = True  # light reaches points where the depth has them; False: all in one plane
    bounce: bool = True  # let the object light itself with what was photographed
    walls: bool = True  # and with what walls throw that no photograph shows
    robust: bool = True  # views that fit badly count less; False: plain least squares
    material: bool = True  # let photographs say how much the object mirrors head on, and whether it is metal
    rim: bool = True  # let pixels of the rim hold a share of what is photographed beside the object
    relight: bool = True  # refine the brightness of groups of emitters by the object's own shading
    exposure_drift: bool = (
        True  # let the light of every view be off by a factor, told by the object's shading
    )
    lamp_shift: bool = True  # let lamps stand in other directions than they were found in, told by the same
    relight_groups: int = 12  # groups besides the lamps
    relight_prior: float = 0.02  # how far a group's log brightness may be off before it has to be argued
    model_error: float = 0.02  # relative misfit expected of a good model
    held_out: int = 4  # views kept out of the fit and re-rendered; one in eight at most
    object_distance: float = 0.0  # camera to object along z, scene units; 0 = find it
    together: int = (
        400_000  # pixels solved together; of a larger object a smaller picture is, then every pixel in tiles
    )
    start_maps: str = (
        ""  # .exr, .png, .npy or .npz with first normals (and roughness); empty: our global search
    )
    start_roughness: str = ""  # the same with first roughness, where it is a file of its own
    start_frame: str = "opencv"  # axes of those normals: y down, z ahead; or "opengl": y up, z to the camera

    def __post_init__(self) -> None:
        check(self, "surface", SurfaceError, BOUNDS, {"start_frame": NORMAL_FRAMES}, OR_NONE)
        if self.start_roughness and not self.start_maps:
            raise SurfaceError("surface.start_roughness begins nothing alone; give surface.start_maps too")
