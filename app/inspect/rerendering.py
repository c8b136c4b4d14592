"""Re-render every view of a finished run: what the surface looks like under the light it was solved with.

Runs in a worker child. The solver keeps only the few views it did not fit; here its light, visibility and bounced light
are made again from the stored results, at the resolution they were solved with. Each view is kept as
`derived/rerendered/FINGERPRINT/NNNN.npy` (radiance of the mask's pixels), and told when it is there.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from app.inspect import maps, runs
from app.inspect.runs import Run
from engine.errors import SessionError
from engine.io.session import told
from engine.orientation import turned
from engine.pipeline import artifacts
from engine.pipeline.settings import resolve
from engine.surface.lighting.room_light import gather_incident_light
from engine.surface.optimize import gauss_newton
from engine.surface.params import SurfaceParams
from engine.surface.reflectance.brdf import of_pixels
from engine.surface.rendering.object_pixels import (
    geometry_with_visibility,
    light_transport,
    observe_object,
    photographed_radiance,
    render_pixels,
)
from engine.surface.rendering.transport import (
    IncidentLight,
    ProbeGrid,
    SurfaceGeometry,
    direction_cells,
    pixel_blocks,
    probe_grid_around,
)
from engine.types import Emitters, Frames, Poses, Surface

if TYPE_CHECKING:
    from app.work.worker import Link
    from engine.progress import Progress

BATCH = 4  # views at a time, so that a wish for another one is soon heard


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A finished run with everything its light and surface need."""

    run: Run
    params: SurfaceParams
    frames: Frames
    poses: Poses
    surface: Surface
    emitters: Emitters
    reach: tuple[float, float]  # z of the nearest and the farthest probes, scene units
    probes: tuple[int, int, int]  # along each axis of their lattice
    directions: int  # of light


def upright(solved: Solved) -> Solved:
    """The same in the frame of the upright picture; pixels in row order are the sensor's."""
    names = ("frames", "poses", "surface")
    return replace(solved, **{name: turned(getattr(solved, name), solved.run.flip) for name in names})


def serve(request: Mapping[str, Any], link: "Link") -> Mapping[str, Any]:
    """Task "rerender": {session, fingerprint, view}; hears "view" {view}; tells data {view}, those at hand first."""
    run = find(Path(request["session"]), request["fingerprint"])
    folder = maps.rerendered_folder(run)
    with told(folder):
        folder.mkdir(parents=True, exist_ok=True)
    wish = [int(request["view"])]
    link.hear("view", lambda content: wish.append(int(content["view"])))
    solved = open_run(run)
    usable = [int(view) for view in np.nonzero(solved.poses.registered)[0]]
    waiting = [view for view in usable if not (folder / f"{view:04d}.npy").is_file()]
    for view in usable:
        if view not in waiting:
            link.emit("data", view=view)
    if not waiting:
        return {"views": usable}
    progress = link.progress()
    scene = Scene(solved, progress.part(0, 0.2))
    total = len(waiting)
    while waiting:
        wanted, count = wish[-1], 1 if wish[-1] in waiting else BATCH
        some = sorted(waiting, key=lambda view: abs(view - wanted))[:count]
        done = (total - len(waiting)) / total
        span = progress.part(0.2 + 0.8 * done, 0.2 + 0.8 * (done + len(some) / total))
        span.step(0.0, f"view {solved.frames.names[some[0]]}")
        for view, flat in zip(some, scene.rendered(some, span), strict=True):
            _keep(folder / f"{view:04d}.npy", flat)
            link.emit("data", view=view)
        waiting = [view for view in waiting if view not in some]
    return {"views": usable}


def find(session: Path, fingerprint: str) -> Run:
    """The run of that surface.

    Raises:
        SessionError: it is gone.
    """
    for run in runs.runs_of(session):
        if run.fingerprint == fingerprint:
            return run
    raise SessionError(f"{session}: the result {fingerprint} is gone; process the session again")


def open_run(run: Run) -> Solved:
    """Load a run and put its light together as the solver had it.

    Raises:
        SessionError: a part of it was removed, an older version of the method made it, or the reference solver.
    """
    record, report = run.records["surface"], run.reported("surface")
    if "seconds_per_sample" in report:
        raise SessionError(
            f"{run.session}: the reference solver made this result, and its views are not rendered anew here; look at"
            " a result of the transport solver"
        )
    # Until version 42 photographs overruled the depth on what hides the room, which is not made again.
    overruled = (run.folder("surface") / "horizons.json").is_file()
    if overruled or not (run.folder("surface") / "emitters.json").is_file() or "probes" not in report:
        raise _older(run)
    if "hdr" not in run.records:
        raise SessionError(
            f"{run.session}: its brackets are not merged yet, or their result was removed; wait until the run is over, or"
            f" run `roomlight process {run.session}`"
        )
    known = {item.name for item in dataclasses.fields(SurfaceParams)}
    asked = {name: value for name, value in record["params"].items() if name in known}
    params = resolve("surface", SurfaceParams(), {}, asked)
    frames = artifacts.load(run.folder("hdr"), "frames", Frames)
    poses = artifacts.load(run.folder("poses"), "poses", Poses)
    surface = artifacts.load(run.folder("surface"), "surface", Surface)
    emitters = artifacts.load(run.folder("surface"), "emitters", Emitters)
    near, far = map(float, report["probe_reach"])
    across, down, deep = map(int, report["probes"])
    return Solved(
        run,
        params,
        frames,
        poses,
        surface,
        emitters,
        (near, far),
        (across, down, deep),
        int(report["directions"]),
    )


class Scene:
    """A run's visibility, worked out once, and its pictures in any view."""

    def __init__(self, solved: Solved, progress: "Progress") -> None:
        """
        Raises:
            SessionError: an older version of the method made the result.
        """
        s, surface = solved, solved.surface
        self._solved = solved
        self.lattice: ProbeGrid = probe_grid_around(s.poses.camera, surface.mask, s.reach, s.probes)
        mask = surface.mask
        self._state = gauss_newton.initial_estimate(
            surface.normal[mask].astype(float),
            surface.albedo[mask].astype(float),
            surface.roughness[mask].astype(float),
        )
        one = np.nonzero(s.poses.registered)[0][:1]
        who = observe_object(s.frames, mask, s.poses.camera, one, s.params)
        who = replace(who, material=of_pixels(surface.material, mask))
        cells = direction_cells(s.directions)
        self.sight: SurfaceGeometry = geometry_with_visibility(
            who, self._state, surface.depth, cells, s.params, progress
        )

    def light(self, views: Sequence[int], progress: "Progress") -> IncidentLight:
        """What arrives around the object in some views."""
        s = self._solved
        cam_from_world = s.poses.cam_from_world[np.array(views)]
        face_px = s.params.probe_resolution
        return gather_incident_light(
            self.lattice, s.emitters, cam_from_world, s.directions, face_px, progress
        )

    def rendered(self, views: Sequence[int], progress: "Progress") -> Float[np.ndarray, "n p 3"]:
        """Radiance of the mask's pixels in some views, float32."""
        s = self._solved
        mask, light = s.surface.mask, self.light(views, progress)
        seen = photographed_radiance(s.frames, mask, views)
        responses = light_transport(seen, light, self.sight, s.params, "cpu")
        return render_pixels(responses, self.sight, pixel_blocks(mask), self._state).transpose(1, 0, 2)


def _older(run: Run) -> SessionError:
    return SessionError(
        f"{run.session}: this result was made by an older version, or parts of it were removed; process the session"
        " again to re-render its views"
    )


def _keep(path: Path, flat: Float[np.ndarray, "p 3"]) -> None:
    """Whole or not at all: a reader may look at any moment."""
    beside = path.with_name(f".{path.name}.partial.npy")
    with told(path):
        np.save(beside, flat.astype(np.float32))
        beside.replace(path)
