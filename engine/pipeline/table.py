"""The table of stages: which rooms' functions make up roomlight's pipeline, and at which version each is.

Raise a stage's version whenever the same inputs and parameters would give another result: finished results of
the old version then count as stale, and `plan` says so.
"""

import hashlib
from collections.abc import Callable

from engine.pipeline import presets, work
from engine.pipeline.stages import Hashes, Stage, canonical
from engine.session import Session, edits, shots


def stages(solver: str = "transport") -> tuple[Stage, ...]:
    """hdr -> segment -> poses -> light -> surface -> export; `solver` (`settings.SOLVERS`) is the surface's."""
    from engine.export import ExportParams
    from engine.hdr import HdrParams
    from engine.light.train import LightParams
    from engine.segment import SegmentParams
    from engine.sfm import PoseParams

    return (
        Stage(
            "hdr", 3, HdrParams(), (), work.hdr, reads=_shots, presets=presets.of_stage("hdr")
        ),
        Stage(
            "segment", 5, SegmentParams(), ("hdr",), work.segment, reads=_edits("mask.png", "strokes.png"),
            given="mask.png", given_params=("margin_px",), presets=presets.of_stage("segment"),
        ),
        Stage(
            "poses", 7, PoseParams(), ("hdr", "segment"), work.poses, reads=_pose_inputs, given="poses.json",
            given_params=("seed", "features", "mapping"), presets=presets.of_stage("poses"),
        ),
        Stage(
            "light", 10, LightParams(), ("hdr", "segment", "poses"), work.light, seeded=True,
            presets=presets.of_stage("light"),
        ),
        _reference() if solver == "reference" else _transport(),
        Stage(
            "export", 8, ExportParams(), ("hdr", "segment", "poses", "surface"), work.export, reads=_orientation,
            presets=presets.of_stage("export"),
        ),
    )  # fmt: skip


def _transport() -> Stage:
    from engine.surface.solve import SurfaceParams

    return Stage(
        "surface", 42, SurfaceParams(), ("hdr", "segment", "poses", "light"), work.surface, seeded=True,
        reads=_orientation, presets=presets.of_stage("surface"), files=("start_maps", "start_roughness"),
    )  # fmt: skip


def _reference() -> Stage:
    """The paper's solver. Its parameters alone tell its results from ours."""
    from engine.reference.params import ReferenceParams

    return Stage(
        "surface", 5, ReferenceParams(), ("hdr", "segment", "poses", "light"), work.reference, seeded=True,
        reads=_orientation, files=("start_maps",), presets=presets.of_reference(),
    )  # fmt: skip


def _shots(session: Session) -> Hashes:
    return {f"shots/{shot.folder.name}": shot.fingerprint for shot in shots(session)}


def _edits(*names: str) -> Callable[[Session], Hashes]:
    def read(session: Session) -> Hashes:
        return {f"edits/{name}": sha for name, sha in edits(session).items() if name in names}

    return read


def _orientation(session: Session) -> Hashes:
    """How the photographs are turned to stand upright, where they are."""
    return {"orientation": str(session.orientation)} if session.orientation else {}


def _pose_inputs(session: Session) -> Hashes:
    """Given poses, or else what the rig logged: its geometry and every view's angles."""
    given = _edits("poses.json")(session)
    rig = session.facts.get("rig")
    if given or not rig:
        return given
    log = canonical([rig, [shot.rig for shot in shots(session)]])
    return {"rig": hashlib.sha256(log.encode()).hexdigest()[:16]}
