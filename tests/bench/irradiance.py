"""How far a light's irradiance at the object is from the truth, for benchmarks that fit the light themselves.

Some views are enough: the light is the same in all, turned. Camera frame; energies as in `incident.py`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from app import results
from engine.errors import TruthError
from engine.geometry import align_similarity, fibonacci_sphere, inverse
from engine.hdr.merge import HdrReport
from engine.io.ground_truth import read_truth
from engine.io.images import read_radiance
from engine.light.fitting.lamp_model import without_lamps
from engine.pipeline import run
from engine.types import Gaussians, Lamps, Poses
from hardware.virtual.studio import objects
from tests.bench import incident, light_sets

VIEWS = 12  # that are compared, evenly spread
CELLS, NORMALS, FACE = 2048, 642, 96


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """The studio's light where its panoramas were taken, in some views of a session."""

    point: Float[np.ndarray, "1 3"]  # camera frame, scene units
    cam_from_world: Float[np.ndarray, "n 3 4"]  # of the session
    energy: Float[np.ndarray, "n d 3"]  # on the session's scale of radiance
    directions: Float[np.ndarray, "d 3"]


def beside(session: Path) -> Lit:
    """The truth of the set that a session with finished poses lies in.

    Raises:
        TruthError: no truth with this session's views lies beside it.
        SessionError: hdr or poses has not run.
        StudioError: the set's name does not begin with those of a room and an object.
    """
    folder = session.resolve().parent
    load = run.loader(results.steps_of(session))
    poses, report = load("poses", "poses", Poses), load("hdr", "report", HdrReport)
    true = read_truth(folder / "truth").cam_from_world
    panoramas = sorted((folder / "truth" / "panoramas").glob("*.exr"))
    if true is None or not len(true) == len(panoramas) == len(poses.registered):
        raise TruthError(f"{folder}: the truth is not that of this session's views; simulate the set again")
    views = np.nonzero(poses.registered)[0]
    ours = poses.cam_from_world[views]
    scale, _ = align_similarity(inverse(ours)[..., 3], inverse(true[views])[..., 3])
    some = np.unique(np.linspace(0, len(views) - 1, VIEWS).round().astype(int))
    directions = fibonacci_sphere(CELLS)
    pictures = [read_radiance(panoramas[view]) for view in views[some]]
    onto = incident.binning(directions, len(pictures[0]))
    energy = np.stack([incident.binned(picture, onto) for picture in pictures])
    body = objects.model(light_sets.names_of(folder.name)[1])
    point = body.solid.vertices.mean(0)[None] / scale
    return Lit(point, ours[some], energy * light_sets.session_per_studio(report.scale), directions)


def off(lit: Lit, gaussians: Gaussians, lamps: Lamps) -> incident.Irradiance:
    """Error of the light as it was fitted, in percent, mean over the views; the lamps are the last Gaussians."""
    field = without_lamps(gaussians, lamps)
    energy, _ = light_sets.energy_at(lit.point, lit.cam_from_world, field, lamps, field, lit.directions, FACE)
    normals = fibonacci_sphere(NORMALS)
    errors = [
        incident.irradiance_error(a, b, lit.directions, normals)
        for a, b in zip(energy, lit.energy, strict=True)
    ]
    means = np.mean([(e.mean, e.p95, e.own_mean, e.own_p95) for e in errors], axis=0)
    return incident.Irradiance(*map(float, means))
