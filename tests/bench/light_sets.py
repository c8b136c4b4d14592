"""Reads what the light's benchmark compares: a simulated set's newest finished light, and the studio's truth.

The truth's files hold panoramas, poses and maps; not the point where the panoramas are taken (the mean of the
body's vertices), the object's box, or the lamps. Those come from the studio's own builders, by the set's name,
which begins with ROOM-OBJECT. Session and truth share each view's camera frame, and differ in world, unit and
radiance scale.
"""

import functools
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from app.bench.baselines.flat import sorted_into_cells
from app.bench.bound import session_per_studio
from engine.errors import TruthError
from engine.geometry import align_similarity, fibonacci_sphere, inverse
from engine.hdr.merge import HdrReport
from engine.io.ground_truth import read_truth
from engine.io.images import read_radiance
from engine.light.fitting.lamp_model import without_lamps
from engine.light.incident.coverage import coverage_of, covered
from engine.light.incident.probes import gather_probes
from engine.pipeline import artifacts
from engine.surface.rendering.area_lights import area_lights_of
from engine.types import Emitters, Gaussians, Lamps, Masks, Poses
from hardware.errors import StudioError
from hardware.virtual.studio import objects, rooms
from tests.bench import incident

SESSIONS = ("session", "given.session")
"""Where a set's light may lie: as photographed, or where `roomlight bench` gave it the truth's poses and mask."""
FACE = 128  # pixels along a face of the probe's cube
COARSE_CELLS, COARSE_FACE = 2048, 48  # for what was photographed

furnished = functools.cache(rooms.furnish)  # painting a room's textures takes half a minute


@dataclass(frozen=True, slots=True, eq=False)
class Set:
    """What is compared: our light and poses of the registered views, and their truth in the same order."""

    name: str
    light: Path  # the stage's folder
    version: int  # of that stage
    gaussians: Gaussians  # the lamps are the last of them
    lamps: Lamps
    masks: Masks
    poses: Poses
    cam_from_world: Float[np.ndarray, "n 3 4"]
    views: Int[np.ndarray, " n"]
    true_cam_from_world: Float[np.ndarray, "n 3 4"]
    true_from_ours: Float[np.ndarray, "3 4"]  # of worlds, after `scale`
    scale: float  # metres per scene unit
    panoramas: tuple[Path, ...]
    session_per_studio: float  # of radiance
    room: rooms.Room
    body: objects.Body


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """The room's emitters under one set of gains."""

    refined: bool  # by the surface, from the object's shading
    field: Gaussians  # without the lamps
    lamps: Lamps


def newest_light(session: Path) -> Path | None:
    """The folder of the light that was finished last; None where there is none."""
    return _newest(session / "stages" / "light")


def session_of(folder: Path) -> Path | None:
    """The session of a set whose light is scored: of `SESSIONS` the first with a finished one; None if none has."""
    return next((folder / name for name in SESSIONS if newest_light(folder / name) is not None), None)


def read(folder: Path) -> Set:
    """A set's newest light, what that was made from, and its truth; nothing is written.

    Raises:
        TruthError: no finished light, or a truth without the poses and panoramas of this session.
        SessionError: records cannot be read.
        StudioError: the set's name does not begin with those of a room and an object.
    """
    session = session_of(folder)
    light = None if session is None else newest_light(session)
    if light is None:
        raise TruthError(f"{folder}: no session of it has a finished light; process it first")
    record = _record(light)
    stage = {name: light.parent.parent / name / made for name, made in record["inputs"].items()}
    poses = artifacts.load(stage["poses"], "poses", Poses)
    true = read_truth(folder / "truth").cam_from_world
    panoramas = sorted((folder / "truth" / "panoramas").glob("*.exr"))
    count = len(poses.registered)
    if true is None or len(true) != count or len(panoramas) != count:
        known = 0 if true is None else len(true)
        raise TruthError(
            f"{folder}: the session has {count} views, the truth {known} poses and {len(panoramas)} panoramas;"
            " simulate the set again"
        )
    views = np.nonzero(poses.registered)[0]
    estimated, true = poses.cam_from_world[views], true[views]
    scale, true_from_ours = align_similarity(inverse(estimated)[..., 3], inverse(true)[..., 3])
    room, thing = names_of(folder.name)
    return Set(
        f"{room}-{thing}", light, record["version"], artifacts.load(light, "gaussians", Gaussians), _lamps(light),
        artifacts.load(stage["segment"], "masks", Masks), poses, estimated, views, true, true_from_ours, scale,
        tuple(panoramas[view] for view in views),
        session_per_studio(artifacts.load(stage["hdr"], "report", HdrReport).scale),
        furnished(room), objects.model(thing),
    )  # fmt: skip


def names_of(folder: str) -> tuple[str, str]:
    """Room and object of a set's folder: ROOM-OBJECT, and what `roomlight bench` adds after another hyphen.

    Raises:
        StudioError: it does not begin with two names.
    """
    room, thing, *_ = [*folder.split("-"), ""]
    if not (room and thing):
        raise StudioError(f"{folder}: a set's folder is called ROOM-OBJECT; rename it")
    return room, thing


def true_energy(s: Set, onto: incident.Binning) -> Float[np.ndarray, "n d 3"]:
    """The studio's panoramas in our cells, on the session's scale of radiance."""
    return (
        np.stack([incident.binned(read_radiance(path), onto) for path in s.panoramas]) * s.session_per_studio
    )


def lights(s: Set) -> list[Light]:
    """The light as it was fitted, and under the gains that the newest surface solved with it found for its emitters."""
    field = without_lamps(s.gaussians, s.lamps)
    fitted = Light(False, field, s.lamps)
    surface = _newest(s.light.parent.parent / "surface", s.light.name)
    if surface is None:
        return [fitted]
    settled = artifacts.load(surface, "emitters", Emitters)
    return [fitted, Light(True, settled.field(), settled.lamps)]


def our_energy(
    s: Set, light: Light, directions: Float[np.ndarray, "d 3"]
) -> tuple[Float[np.ndarray, "n d 3"], Float[np.ndarray, "n d"]]:
    """Energy at the panoramas' point as the solver reads it, and the Gaussians' opacity there: the rest is filled in.

    The directions are those of `fibonacci_sphere`.
    """
    solid = without_lamps(s.gaussians, s.lamps)  # what no photograph shows hides no lamp
    return energy_at(_point(s), s.cam_from_world, light.field, light.lamps, solid, directions)


def energy_at(
    point: Float[np.ndarray, "1 3"],
    poses: Float[np.ndarray, "n 3 4"],
    field: Gaussians,
    lamps: Lamps,
    solid: Gaussians,
    directions: Float[np.ndarray, "d 3"],
    face: int = FACE,
) -> tuple[Float[np.ndarray, "n d 3"], Float[np.ndarray, "n d"]]:
    """`our_energy` at any point of the camera frame: the field, filled, and the lamps that `solid` does not hide."""
    found = gather_probes(field, poses, point, directions, face)
    energy, opaque = found.energy, found.seen
    near = area_lights_of(lamps, solid, poses, point[0], len(directions))
    energy[:, 0] += (
        sorted_into_cells(near, point[0]).reshape(len(directions), len(poses), 3).transpose(1, 0, 2)
    )
    return energy[:, 0].astype(np.float64), opaque[:, 0]


def photographed(s: Set) -> Float[np.ndarray, "n e"]:
    """Per view and coarse cell, the share of the light there that some view photographed."""
    cells, shown = fibonacci_sphere(COARSE_CELLS), coverage_of(s.masks, s.poses)
    found = gather_probes(s.gaussians, s.cam_from_world, _point(s), cells, COARSE_FACE, False)
    places = found.places[:, 0].astype(np.float64)
    return found.seen[:, 0] * covered(shown, places.reshape(-1, 3)).reshape(places.shape[:2])


def _point(s: Set) -> Float[np.ndarray, "1 3"]:
    return (s.body.solid.vertices.mean(0) / s.scale)[None]


def _newest(stage: Path, light: str | None = None) -> Path | None:
    """The folder that was finished last, of those that were made from `light`."""
    records = {
        p.parent: _record(p.parent) for p in stage.glob("*/record.json") if p.parent.suffix != ".partial"
    }
    made = [path for path, record in records.items() if light in (None, record["inputs"].get("light"))]
    return max(made, key=lambda path: records[path]["finished"], default=None)


def _record(stage: Path) -> dict:
    return json.loads((stage / "record.json").read_bytes())


def _lamps(light: Path) -> Lamps:
    """None in a light of a version that knew no lamps."""
    if (light / "lamps.json").is_file():
        return artifacts.load(light, "lamps", Lamps)
    return Lamps(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3)), np.zeros(0, bool))
