"""The results of a session to show in space: those of the run that the other pages show, or whatever is there so far.

Read without the engine's table of stages, whose libraries take seconds to load.
"""

import json
from dataclasses import dataclass
from pathlib import Path

from app.inspect import runs
from app.scaling import rescaled
from engine.io import session as sessions
from engine.orientation import turned
from engine.pipeline import artifacts
from engine.types import Emitters, Gaussians, Lamps, Poses, Surface

CHAIN = ("hdr", "poses", "light", "surface")


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """What belongs together, cameras and surface upright, lengths as they are shown; None where it is not there."""

    names: tuple[str, ...]  # of the views
    poses: Poses | None
    gaussians: Gaussians | None
    lamps: Lamps | None
    surface: Surface | None


def read(folder: Path) -> Results:
    """
    Raises:
        SessionError: no session, or damaged.
    """
    session = sessions.open_session(folder)
    places = stages_of(folder)

    def there(stage: str, record: str, kind: type):
        place = places.get(stage)
        if place is None or not (place / f"{record}.json").is_file():
            return None
        return turned(artifacts.load(place, record, kind), session.orientation)

    gaussians, lamps = there("light", "gaussians", Gaussians), there("light", "lamps", Lamps)
    settled = there("surface", "emitters", Emitters)
    if settled is not None:
        gaussians, lamps = settled.gaussians, settled.lamps
    surface, poses = there("surface", "surface", Surface), there("poses", "poses", Poses)
    _, (surface, poses, gaussians, lamps) = rescaled(folder, surface, poses, gaussians, lamps)
    return Results(
        _names(places["hdr"]) if "hdr" in places else tuple(shot.name for shot in sessions.shots(session)),
        poses,
        gaussians,
        lamps,
        surface,
    )


def stages_of(folder: Path) -> dict[str, Path]:
    """Where the results of each finished stage lie, all of one run."""
    run = runs.current(runs.runs_of(folder))
    if run is not None:
        return {"surface": run.folder("surface")} | {
            stage: run.folder(stage) for stage in CHAIN[:-1] if stage in run.records
        }
    # No surface yet: the newest of the last stage that is there, and what it was made from.
    for stage in reversed(CHAIN[:-1]):
        newest = _newest(folder / "stages" / stage)
        if newest is not None:
            place, inputs = newest
            made_from = {
                name: folder / "stages" / name / str(inputs[name]) for name in CHAIN if name in inputs
            }
            return {name: at for name, at in made_from.items() if (at / "record.json").is_file()} | {
                stage: place
            }
    return {}


def _newest(stage: Path) -> tuple[Path, dict[str, str]] | None:
    """The folder of the latest finished result, and its inputs' fingerprints."""
    found = []
    for path in stage.glob("*/record.json"):
        try:
            record = json.loads(path.read_bytes())
            found.append((record["finished"], path.parent, record["inputs"]))
        except (OSError, ValueError, KeyError, TypeError):
            continue  # not finished, or not ours
    if not found:
        return None
    _, place, inputs = max(found, key=lambda result: result[0])
    return place, inputs


def _names(hdr: Path) -> tuple[str, ...]:
    """The views' names, without touching their pixels."""
    try:
        return tuple(json.loads((hdr / "frames.json").read_bytes())["values"]["names"])
    except (OSError, ValueError, KeyError, TypeError):
        return ()
