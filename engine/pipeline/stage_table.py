"""The table of stages: which rooms' functions make up roomlight's pipeline, and at which version each is.

Raise a stage's version whenever the same inputs and parameters would give another result: finished results of
the old version then count as stale, and `plan` says so.
"""

import hashlib
from collections.abc import Callable, Mapping
from typing import Any

from engine.io import left_out, scale_edit
from engine.io.session import Session, edits, shots
from engine.pipeline import presets
from engine.pipeline.stages import Hashes, Stage, Work, canonical


def stages(solver: str = "transport") -> tuple[Stage, ...]:
    """hdr -> segment -> poses -> light -> surface -> export; `solver` (`settings.SOLVERS`) is the surface's."""
    from engine.hdr.params import HdrParams
    from engine.light.fitting.params import LightParams
    from engine.results.params import ExportParams
    from engine.segmentation.params import SegmentParams
    from engine.sfm.params import PoseParams

    return (
        Stage(
            "hdr", 4, HdrParams(), (), _produce("hdr"), reads=_shots, presets=presets.of_stage("hdr")
        ),
        Stage(
            "segment", 6, SegmentParams(), ("hdr",), _produce("segment"), reads=_edits("mask.png", "strokes.png", left_out.FILE),
            given="mask.png", given_params=("margin_px", "fewest_views", "most_views", "search_edge_px"), presets=presets.of_stage("segment"),
        ),
        Stage(
            "poses", 10, PoseParams(), ("hdr", "segment"), _produce("poses"), reads=_pose_inputs, given="poses.json",
            given_params=("seed", "features", "mapping"), presets=presets.of_stage("poses"),
        ),
        Stage(
            "light", 15, LightParams(), ("hdr", "segment", "poses"), _produce("light"), seeded=True,
            presets=presets.of_stage("light"),
        ),
        _reference() if solver == "reference" else _transport(),
        Stage(
            "export", 9, ExportParams(), ("hdr", "segment", "poses", "surface"), _produce("export"), reads=_export_inputs,
            presets=presets.of_stage("export"),
        ),
    )  # fmt: skip


def _produce(name: str) -> Callable[[Work], Mapping[str, Any]]:
    """One of `stage_functions`, which come with numbers' libraries: a plan does without."""

    def produce(work: Work) -> Mapping[str, Any]:
        from engine.pipeline import stage_functions

        return getattr(stage_functions, name)(work)

    return produce


def _transport() -> Stage:
    from engine.surface.params import SurfaceParams

    return Stage(
        "surface", 55, SurfaceParams(), ("hdr", "segment", "poses", "light"), _produce("surface"), seeded=True,
        reads=_orientation, presets=presets.of_stage("surface"), files=("initial_normals", "initial_roughness"),
    )  # fmt: skip


def _reference() -> Stage:
    """The paper's solver. Its parameters alone tell its results from ours."""
    from engine.reference.params import ReferenceParams

    return Stage(
        "surface", 5, ReferenceParams(), ("hdr", "segment", "poses", "light"), _produce("reference"), seeded=True,
        reads=_orientation, files=("initial_normals",), presets=presets.of_reference(),
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


def _export_inputs(session: Session) -> Hashes:
    """How the photographs are turned, and the scale that was given."""
    return {**_orientation(session), **_edits(scale_edit.FILE)(session)}


def _pose_inputs(session: Session) -> Hashes:
    """Given poses, or else what the rig logged: its geometry and every view's angles. And which views are left out."""
    edited = _edits("poses.json", left_out.FILE)(session)
    rig = session.facts.get("rig")
    if "edits/poses.json" in edited or not rig:
        return edited
    log = canonical([rig, [shot.rig for shot in shots(session)]])
    return {**edited, "rig": hashlib.sha256(log.encode()).hexdigest()[:16]}
