"""Every pixel of the object under a given light: search, Gauss-Newton, depth, visibility.

Camera frame. Knows nothing of Gaussians or files: the light arrives as energy at a lattice of probes.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy.ndimage import distance_transform_edt, mean

from engine.errors import SurfaceError
from engine.geometry import rays, resized
from engine.progress import Progress
from engine.surface import horizons, newton
from engine.surface.integrate import integrate
from engine.surface.observations import Observations, islands, numbered, observe
from engine.surface.start import global_start
from engine.surface.transport import Incident, Responses, Sight, blocks, predict
from engine.surface.visibility import occlusion
from engine.types import Camera, Frames

LEAST_VIEWS = 8
LEAST = {
    "probes_across": 0, "probes_deep": 0, "probe_face_px": 8, "candidates": 10, "rough_rounds": 0,
    "rough_views": LEAST_VIEWS, "rounds": 1, "passes": 1, "relight_groups": 0, "relight_prior": 0.001, "model_error": 0.001,
    "held_out": 0, "object_distance": 0.0,
}  # fmt: skip
"""What each number that may be asked must be at least."""
LEAST_OR_NONE = {"directions": 64, "views": LEAST_VIEWS}
"""The same of those that may also be 0."""


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
    full_turn: bool = True  # one turn more with all pixels before the last look at the light
    views: int = 0  # that serve after them, spread evenly; 0: all
    rounds: int = 3  # at most, on all pixels until they stand still: solve, integrate, see
    passes: int = 4  # Gauss-Newton evaluations in each round
    full_diffuse: bool = True  # Disney's diffuse lobe; False is the paper's Lambert (10)
    visibility: bool = True  # let the object shadow itself
    horizons: bool = True  # let the photographs overrule what the depth says hides the room
    steps: bool = True  # let horizons tell how high steps are, which normals do not
    bounce: bool = True  # let the object light itself with what was photographed
    ask: bool = (
        True  # let pixels that explain badly try their neighbours' answers, and all look for their horizons
    )
    accord: bool = True  # let neighbours decide what a pixel's photographs leave open
    relight: bool = True  # refine the brightness of groups of emitters by the object's own shading
    exposure_drift: bool = (
        True  # let every view's exposure be off by a factor, told by the object's own shading
    )
    lamp_shift: bool = True  # let lamps stand in other directions than they were found in, told by the same
    relight_groups: int = 12  # groups besides the lamps
    relight_prior: float = 0.02  # how far a group's log brightness may be off before it has to be argued
    model_error: float = 0.02  # relative misfit expected of a good model
    held_out: int = 4  # views kept out of the fit and re-rendered; one in eight at most
    object_distance: float = 0.0  # camera to object along z, scene units; 0 = find it

    def __post_init__(self) -> None:
        for name, least in {**LEAST, **LEAST_OR_NONE}.items():
            asked = getattr(self, name)
            if not (asked >= least or (asked == 0 and name in LEAST_OR_NONE)):
                raise SurfaceError(f"surface.{name} is {getattr(self, name)}; give {least} or more")


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """The object's pixels as photographed in some views; `p` counts them in row order."""

    camera: Camera
    mask: Bool[np.ndarray, "h w"]
    seen: Observations

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
        return Sight(directions / directions[:, 2:] * z[:, None], -directions, None)

    def responses(self, light: Incident, params: SurfaceParams, device: str) -> Responses:
        """How the pixels answer a light."""
        return Responses(light, self.seen.radiance, params.full_diffuse, params.bounce, device)


def subject(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    camera: Camera,
    views: Int[np.ndarray, " n"],
    params: SurfaceParams,
) -> Subject:
    """The object in some views, at the photographs' resolution."""
    return Subject(camera, mask, observe(frames, mask, views, params.model_error))


def halved(
    frames: Frames, mask: Bool[np.ndarray, "h w"], camera: Camera
) -> tuple[Frames, Bool[np.ndarray, "h2 w2"], Camera]:
    """Photographs of half the size, for the object alone: means over the object's pixels of each 2 x 2."""
    height, width = mask.shape[0] // 2 * 2, mask.shape[1] // 2 * 2

    def fours(x: Shaped[np.ndarray, "*n h w"]) -> Shaped[np.ndarray, "*n h2 w2 4"]:
        x = x[..., :height, :width].reshape(*x.shape[:-2], height // 2, 2, width // 2, 2)
        return np.moveaxis(x, -3, -2).reshape(*x.shape[:-4], height // 2, width // 2, 4)

    inside = fours(mask)
    small = inside.sum(-1) >= 2
    count = np.maximum(inside.sum(-1), 1)
    radiance = np.stack(
        [(fours(frames.radiance[..., c]) * inside).sum(-1) / count for c in range(3)], -1
    ).astype(np.float32)
    clipped, dark = (np.asarray((fours(x) & inside).any(-1)) for x in (frames.clipped, frames.dark))
    shot, floor = frames.noise
    # A mean of four: a quarter of the variance.
    fewer = Frames(frames.names, radiance, clipped, dark, (shot / 4, floor / 2))
    # An odd last row or column is cut off, and the field of view with it.
    even = Camera(
        width, height, camera.fx, camera.fy, camera.cx, camera.cy, camera.k1, camera.k2, camera.p1, camera.p2
    )
    return fewer, small, resized(even, width // 2, height // 2)


def search(
    who: Subject, light: Incident, sight: Sight, params: SurfaceParams, device: str, progress: Progress
) -> newton.State:
    """A first surface from nothing."""
    responses = who.responses(light, params, device)
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
    return lifted(who, depth, state.lift, distance)


def lifted(
    who: Subject, depth: Float[np.ndarray, "h w"], lift: Float[np.ndarray, " p"], distance: float
) -> Float[np.ndarray, "h w"]:
    """The depth with its pixels nearer by `lift` (in logarithms); the mean of each connected part stays `distance`."""
    if not lift.any():
        return depth
    z = depth[who.mask] * np.exp(-lift)
    part, count = islands(who.mask)
    lower = np.zeros_like(depth)
    lower[who.mask] = z * distance / np.asarray(mean(z, part, np.arange(count)))[part]
    return lower


def sight_of(
    who: Subject,
    state: newton.State,
    depth: Float[np.ndarray, "h w"],
    directions: Float[np.ndarray, "d 3"],
    params: SurfaceParams,
    progress: Progress,
) -> Sight:
    """Where the depth puts the points, and what hides the room from them."""
    q = rays(who.camera)
    points = q / q[..., 2:] * depth[..., None]
    hidden = None
    if params.visibility:
        hidden = occlusion(points, image(who.mask, state.normals), who.mask, directions, progress)
    return Sight(points[who.mask], -q[who.mask], hidden)


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
) -> tuple[newton.State, Float[np.ndarray, "h w"], Sight]:
    """What `halved` pixels know as a start for the full ones, each taking the nearest one's; with a depth of their own."""
    take = doubled(half.mask, who.mask)
    state = newton.begin(
        state.normals[take], state.albedo[take], state.roughness[take], state.level[take], state.lift[take]
    )
    depth = depth_of(who, state, distance, progress)
    hidden = None
    if sight.occlusion is not None:
        # Last comes who stands for a source that the camera does not see.
        behind = np.full(half.mask.sum() + 1, -1, np.int32)
        behind[take] = np.arange(len(take))
        hidden = sight.occlusion.part(take)
        hidden = replace(hidden, source=behind[hidden.source])
    return state, depth, replace(who.at(depth[who.mask]), occlusion=hidden)


def rerender(
    frames: Frames,
    mask: Bool[np.ndarray, "h w"],
    light: Incident,
    views: tuple[int, ...],
    state: newton.State,
    sight: Sight,
    params: SurfaceParams,
    device: str,
) -> Float[np.ndarray, "n h w 3"]:
    """Pictures of the answer in views the fit has not used."""
    radiance = np.zeros((len(views), *mask.shape, 3), np.float32)
    if views:
        photographed = frames.radiance[list(views)][:, mask].transpose(1, 0, 2).reshape(int(mask.sum()), -1)
        responses = Responses(
            light, np.ascontiguousarray(photographed), params.full_diffuse, params.bounce, device
        )
        flat = np.zeros((int(mask.sum()), len(views), 3), np.float32)
        for pixels, answer in predict(
            responses, sight, blocks(mask), state.normals, state.albedo, state.roughness
        ):
            flat[pixels] = answer
        radiance[:, mask] = flat.transpose(1, 0, 2)
    return radiance


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
