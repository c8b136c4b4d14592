"""Every pixel of the object under a given light: search, Gauss-Newton, depth, visibility.

Camera frame. Knows nothing of Gaussians or files: the light arrives as energy at a lattice of probes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.ndimage import distance_transform_edt, mean

from engine.errors import SurfaceError
from engine.geometry import rays, resized
from engine.limits import MORE, check
from engine.mapfiles import FRAMES
from engine.progress import Progress
from engine.surface import horizons, newton
from engine.surface.bounced import lit
from engine.surface.brdf import of_pixels
from engine.surface.integrate import integrate
from engine.surface.observations import CAUCHY, PLAIN, Observations, islands, numbered, observe, photographed
from engine.surface.start import global_start
from engine.surface.transport import Incident, Responses, Sight, blocks, predict
from engine.surface.visibility import occlusion
from engine.types import Camera, Frames

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
    rounds: int = 3  # at most, on all pixels until they stand still: solve, integrate, see; `deepen` makes it two at least
    passes: int = 4  # Gauss-Newton evaluations in each round
    full_diffuse: bool = True  # Disney's diffuse lobe; False is the paper's Lambert (10)
    visibility: bool = True  # let the object shadow itself
    horizons: bool = True  # let the photographs overrule what the depth says hides the room
    steps: bool = True  # let horizons tell how high steps are, which normals do not
    deepen: bool = True  # and in the end shadows how deep every pixel lies
    follow_depth: bool = True  # light reaches points where the depth has them; False: all in one plane
    bounce: bool = True  # let the object light itself with what was photographed
    walls: bool = True  # and with what walls throw that no photograph shows
    ask: bool = (
        True  # let pixels that explain badly try their neighbours' answers, and all look for their horizons
    )
    robust: bool = True  # views that fit badly count less; False: plain least squares
    material: bool = True  # let photographs say how much the object mirrors head on, and whether it is metal
    accord: bool = True  # let neighbours decide what a pixel's photographs leave open
    gloss: bool = True  # let pixels expect the roughness of those that look alike
    rim: bool = True  # let pixels of the rim hold a share of what is photographed beside the object
    relight: bool = True  # refine the brightness of groups of emitters by the object's own shading
    exposure_drift: bool = False  # let every view's exposure be off by a factor, told by the object's shading
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
        check(self, "surface", SurfaceError, BOUNDS, {"start_frame": FRAMES}, OR_NONE)
        if self.start_roughness and not self.start_maps:
            raise SurfaceError("surface.start_roughness begins nothing alone; give surface.start_maps too")


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """The object's pixels as photographed in some views; `p` counts them in row order."""

    camera: Camera
    mask: Bool[np.ndarray, "h w"]
    seen: Observations
    material: Float[np.ndarray, "p 2"] | None = None  # as `brdf` has it; None: all of paint

    def exposed(self, drift: Float[np.ndarray, " n"]) -> "Subject":
        """The same had no view's log exposure drifted."""
        return replace(self, seen=self.seen.exposed(drift))

    @property
    def rays(self) -> Float[np.ndarray, "p 3"]:
        """Unit viewing directions."""
        return rays(self.camera)[self.mask]

    @property
    def pitch(self) -> float:
        """Angle between the rays of neighbouring pixels, radians."""
        every = rays(self.camera)
        beside = self.mask[:, 1:] & self.mask[:, :-1]
        return float(np.median(np.linalg.norm((every[:, 1:] - every[:, :-1])[beside], axis=1)))

    def flat(self, distance: float) -> Sight:
        """All points at one z, nothing hidden."""
        return self.at(np.full(int(self.mask.sum()), distance))

    def at(self, z: Float[np.ndarray, " p"]) -> Sight:
        """The points at their z, nothing hidden."""
        directions = self.rays
        return Sight(directions / directions[:, 2:] * z[:, None], -directions, None, material=self.material)

    def standing(self, depth: Float[np.ndarray, "h w"], follow: bool) -> Sight:
        """The points where a depth puts them, or all at its mean; nothing hidden yet."""
        z = depth[self.mask]
        return self.at(z) if follow else replace(self.flat(float(z.mean())), cast_z=z)

    def responses(
        self, light: Incident, params: SurfaceParams, device: str, sight: Sight | None = None
    ) -> Responses:
        """How the pixels answer a light; `sight` knows the walls that throw some of it, if there are any."""
        return answering(self.seen.radiance, light, sight, params, device)


def subject(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    camera: Camera,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
) -> Subject:
    """The object in some views, at the photographs' resolution."""
    cauchy = CAUCHY if params.robust else PLAIN
    return Subject(camera, mask, observe(frames, mask, views, params.model_error, cauchy, params.rim))


def halved(
    frames: Frames, mask: Bool[np.ndarray, "h w"], camera: Camera
) -> tuple[Frames, Bool[np.ndarray, "h2 w2"], Camera]:
    """Photographs of half the size: means over each 2 x 2, of the object's pixels where it is the object, else of the others."""
    height, width = mask.shape[0] // 2 * 2, mask.shape[1] // 2 * 2

    def fours(x: Shaped[np.ndarray, "*n h w"]) -> Shaped[np.ndarray, "*n h2 w2 4"]:
        x = x[..., :height, :width].reshape(*x.shape[:-2], height // 2, 2, width // 2, 2)
        return np.moveaxis(x, -3, -2).reshape(*x.shape[:-4], height // 2, width // 2, 4)

    inside = fours(mask)
    small = inside.sum(-1) >= 2
    own = inside == small[..., None]
    count = np.maximum(own.sum(-1), 1)
    radiance = np.empty((len(frames.names), *small.shape, 3), np.float32)
    for view, photograph in enumerate(frames.radiance):  # one by one: all of them may be more than fits
        for c in range(3):
            radiance[view, ..., c] = (fours(photograph[..., c]) * own).sum(-1) / count
    clipped, dark = (
        np.stack([(fours(view) & inside).any(-1) for view in views])
        for views in (frames.clipped, frames.dark)
    )
    shot, floor = frames.noise
    # A mean of four: a quarter of the variance.
    fewer = Frames(frames.names, radiance, clipped, dark, (shot / 4, floor / 2))
    # An odd last row or column is cut off, and the field of view with it.
    even = Camera(
        width, height, camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2
    )
    return fewer, small, resized(even, width // 2, height // 2)


def search(
    who: Subject, light: Incident, sight: Sight, params: SurfaceParams, progress: Progress
) -> newton.State:
    """A first surface from nothing."""
    responses = who.responses(light, params, "cpu")
    regions = coarse_regions(who.mask)
    return newton.begin(*global_start(responses, sight, who.seen, regions, params.candidates, progress))


def as_photographed(
    who: Subject, state: newton.State, sight: Sight, directions: Float[np.ndarray, "d 3"]
) -> Sight:
    """The depth's sight with every horizon that the photographs put elsewhere."""
    beside = horizons.beside(who.mask)
    return horizons.overruled(sight, state.level, state.normals, blocks(who.mask), directions, beside)


def depth_of(
    who: Subject, state: newton.State, distance: float, progress: Progress
) -> Float[np.ndarray, "h w"]:
    """Depth from the normals and steps; its mean is `distance`."""
    depth = integrate(who.camera, image(who.mask, state.normals), who.mask, distance, progress)
    return lifted(who.mask, depth, state.lift, distance)


def lifted(
    mask: Bool[np.ndarray, "h w"],
    depth: Float[np.ndarray, "h w"],
    lift: Float[np.ndarray, " p"],
    distance: float,
) -> Float[np.ndarray, "h w"]:
    """The depth with its pixels nearer by `lift` (in logarithms); the mean of each connected part stays `distance`."""
    if not lift.any():
        return depth
    z = depth[mask] * np.exp(-lift)
    part, count = islands(mask)
    lower = np.zeros_like(depth)
    lower[mask] = z * distance / np.asarray(mean(z, part, np.arange(count)))[part]
    return lower


def sight_of(
    who: Subject,
    state: newton.State,
    depth: Float[np.ndarray, "h w"],
    directions: Float[np.ndarray, "d 3"],
    params: SurfaceParams,
    progress: Progress,
) -> Sight:
    """Where the depth puts the points, and what of it hides the room from them."""
    hidden = None
    if params.visibility:
        q = rays(who.camera)
        points = q / q[..., 2:] * depth[..., None]
        albedo = state.albedo if params.bounce and params.walls else None
        normals = image(who.mask, state.normals)
        hidden = occlusion(points, normals, who.mask, directions, progress, albedo=albedo)
    return replace(who.standing(depth, params.follow_depth), occlusion=hidden)


def doubled(small: Bool[np.ndarray, "h2 w2"], mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, " p"]:
    """For each of the mask's pixels the nearest of the `halved` ones."""
    nearest = distance_transform_edt(~small, return_distances=False, return_indices=True)
    index = numbered(small)[tuple(nearest)]  # pyright: ignore[reportArgumentType]
    v, u = np.nonzero(mask)
    return index[np.minimum(v // 2, small.shape[0] - 1), np.minimum(u // 2, small.shape[1] - 1)]


def finer(
    who: Subject,
    half: Subject,
    state: newton.State,
    sight: Sight,
    distance: float,
    progress: Progress,
) -> tuple[Subject, newton.State, Float[np.ndarray, "h w"], Sight]:
    """What `halved` pixels know as a start for the full ones (`who`), each taking the nearest one's; with a depth of their
    own. The full ones are of the half ones' material then."""
    take = doubled(half.mask, who.mask)
    who = replace(who, material=of_pixels(half.material, take))
    state = newton.begin(
        state.normals[take], state.albedo[take], state.roughness[take], state.level[take], state.lift[take]
    )
    depth = depth_of(who, state, distance, progress)
    hidden = None
    if sight.occlusion is not None:
        count = int(half.mask.sum())
        behind = np.full(count, -1, np.int32)
        behind[take] = np.arange(len(take))
        hidden = sight.occlusion.part(take).told(count, behind, len(take))
    return who, state, depth, replace(who.standing(depth, sight.cast_z is None), occlusion=hidden)


def answering(
    photographed: Float[np.ndarray, "p v"],
    light: Incident,
    sight: Sight | None,
    params: SurfaceParams,
    device: str,
) -> Responses:
    """How pixels answer a light in whose views they were `photographed`; `sight` knows the walls that throw some of it."""
    walls = lit(sight, light, photographed) if sight is not None and params.bounce else None
    return Responses(light, photographed, params.full_diffuse, params.bounce, device, walls)


def photographed_in(
    frames: Frames, mask: Bool[np.ndarray, "h w"], views: Sequence[int]
) -> Float[np.ndarray, "p v"]:
    """The mask's pixels in some views, which may be none; view-major."""
    v, u = np.nonzero(mask)
    return photographed(frames, np.array(views, int), (v, u)).reshape(len(v), 3 * len(views))


def painted(
    responses: Responses, sight: Sight, parts: list[Int[np.ndarray, " _"]], state: newton.State
) -> Float[np.ndarray, "p k 3"]:
    """What the answer sends in every view of the responses' light; float32."""
    sent = np.zeros((len(state.normals), responses.photographed.shape[1] // 3, 3), np.float32)
    if sent.size:
        for pixels, answer in predict(responses, sight, parts, state.normals, state.albedo, state.roughness):
            sent[pixels] = answer
    return sent


def coarse_regions(mask: Bool[np.ndarray, "h w"], across: int = 3) -> list[Int[np.ndarray, " _"]]:
    """Pixels in at most `across`^2 parts of the mask's bounding box: enough for a first look."""
    v, u = np.nonzero(mask)

    def cell(x: Int[np.ndarray, " p"]) -> Int[np.ndarray, " p"]:
        return (x - x.min()) * across // (x.max() - x.min() + 1)

    tile = cell(v) * across + cell(u)
    return [np.nonzero(tile == k)[0] for k in np.unique(tile)]


def image(mask: Bool[np.ndarray, "h w"], values: Shaped[np.ndarray, "p ..."]) -> Float[np.ndarray, "h w ..."]:
    """Per-pixel values back on the image grid, zero outside; float32."""
    full = np.zeros((*mask.shape, *values.shape[1:]), np.float32)
    full[mask] = values
    return full
