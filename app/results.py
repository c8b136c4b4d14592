"""What has been computed in a session: read it, hold it against a truth, put it on a page."""

import datetime
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from app.auto import Rung
from app.scaling import rescaled
from app.state import called
from engine.errors import SessionError
from engine.hdr.merge import HdrReport
from engine.io import left_out
from engine.io import session as sessions
from engine.io.ground_truth import REQUIRED, Truth, read_truth
from engine.io.scale_edit import ScaleBar
from engine.orientation import turn_maps, turned
from engine.pipeline import artifacts, run, stage_functions, stage_table, stages
from engine.pipeline import settings as asked
from engine.pipeline.stages import Step
from engine.progress import Progress
from engine.results import metrics
from engine.results.report import report
from engine.scale_bar import factor
from engine.types import (
    Frames,
    Gaussians,
    LightProvenance,
    Masks,
    Panorama,
    Poses,
    Surface,
    ValidationRenders,
)

Scores = dict[str, dict[str, float | int | None]]
Record = TypeVar("Record")


def steps_of(folder: Path) -> tuple[Step, ...]:
    """The session's stages under the settings that params.toml holds."""
    session = sessions.open_session(folder)
    settings = asked.from_toml(sessions.read_params(session))
    return stages.plan(session, stage_table.stages(settings.solver), settings)


def finished(folder: Path, stage: str) -> Step:
    """The step of a finished stage.

    Raises:
        SessionError: it has not run with the present settings.
    """
    (step,) = [step for step in steps_of(folder) if step.stage.name == stage]
    if not step.done:
        raise SessionError(f"{folder}: stage {stage} {step.tell()}; run `roomlight process {folder}` first")
    return step


def check_scale(folder: Path, bar: ScaleBar) -> None:
    """Refuse a scale that the surface of the present settings, where there is one, does not determine.

    Raises:
        SurfaceError: the depth between the points is not determined, or they are one.
    """
    there = _there(steps_of(folder), sessions.open_session(folder).orientation)
    surface, poses = there("surface", "surface", Surface), there("poses", "poses", Poses)
    if surface is not None and poses is not None:
        factor(bar, surface, poses.camera)


def evaluate(folder: Path, truth_path: Path) -> Scores:
    """Scores of surface, mask and poses (where the truth has them)."""
    load = run.loader(steps_of(folder))
    truth = read_truth(truth_path)
    scores = {
        "surface": metrics.evaluate(load("surface", "surface", Surface), truth).as_dict(),
        "mask": metrics.evaluate_mask(load("segment", "masks", Masks).object, truth.mask).as_dict(),
    }
    if truth.cam_from_world is not None:
        poses = load("poses", "poses", Poses)
        scores["poses"] = metrics.evaluate_poses(poses, truth.cam_from_world).as_dict()
    return scores


def rung(folder: Path, preset: str) -> Rung:
    """What the session's surface has reached with a preset.

    Raises:
        SessionError: it has not run, or a part of it is damaged.
    """
    step = finished(folder, "surface")
    record = stages.read_record(step.folder)
    assert record is not None
    load = run.loader(steps_of(folder))
    frames, renders = load("hdr", "frames", Frames), load("surface", "renders", ValidationRenders)
    mask = load("surface", "surface", Surface).mask
    return Rung(
        preset,
        float(record["seconds"]),
        float(_facts(step.folder)["stderr_normal_deg"]),
        error_by_view(frames, renders, mask),
    )


def error_by_view(
    frames: Frames, renders: ValidationRenders, mask: Bool[np.ndarray, "h w"]
) -> Float[np.ndarray, " k"]:
    """Median relative error of every view kept out."""
    from engine.surface.schedule import relative_error

    error = relative_error(renders.radiance[:, mask], frames.radiance[list(renders.views)][:, mask])
    return np.median(error, axis=1)


def told(scores: Scores) -> str:
    lines = []
    for room, values in scores.items():
        lines.append(f"{room}:")
        for name, value in values.items():
            lines.append(f"  {name:28} {'unknown' if value is None else f'{value:.5g}'}")
    return "\n".join(lines)


def write_report(
    folder: Path, to: Path | None, truth: Path | None = None, progress: Progress | None = None
) -> Path:
    """Write the HTML page about what is there so far; returns where it is.

    Raises:
        Cancelled: `progress` said so; nothing was written.
    """
    progress = progress or Progress()
    progress.step(0.0, "reading the results")
    steps = {step.stage.name: step for step in steps_of(folder)}
    session = sessions.open_session(folder)
    there = _there(tuple(steps.values()), session.orientation)
    frames, poses = there("hdr", "frames", Frames), there("poses", "poses", Poses)
    surface, gaussians = there("surface", "surface", Surface), there("light", "gaussians", Gaussians)
    by, (surface, poses, gaussians) = rescaled(folder, surface, poses, gaussians)
    renders = there("surface", "renders", ValidationRenders)
    view = stage_functions.middle_view(poses) if poses is not None else 0
    scores = evaluate(folder, truth) if truth is not None and steps["surface"].done else None
    progress.step(0.3, "drawing the page")
    page = report.html(
        report.Contents(
            title=called(folder.resolve()),
            when=datetime.datetime.now().strftime("%Y-%m-%d %H:%M"),
            names=tuple(shot.name for shot in sessions.shots(session)),
            photograph=None if frames is None else np.asarray(frames.radiance[view]),
            surface=surface,
            renders=renders,
            held_out=None if frames is None or renders is None else frames.radiance[list(renders.views)],
            panorama=there("export", "panorama", Panorama),
            grounds=there("export", "grounds", LightProvenance),
            poses=poses,
            gaussians=gaussians,
            hdr=there("hdr", "report", HdrReport),
            stages=tuple(_stage_run(step) for step in steps.values() if step.done),
            evaluation=None if scores is None else flat(scores),
            truth=None if truth is None else _upright(read_truth(truth), session.orientation),
            exported=_exported(steps["export"]),
            left_out=left_out.read(session),
            per_unit=by,
            notes=sessions.notes(session),
        )
    )
    progress.step(0.9, "writing the page")
    to = to or folder / "exports" / "report.html"
    with sessions.told(to):
        to.parent.mkdir(parents=True, exist_ok=True)
    sessions.write_atomic(to, page.encode())
    return to


def _upright(truth: Truth, flip: int) -> Truth:
    return turn_maps(truth, flip, REQUIRED)


def _there(steps: Sequence[Step], flip: int) -> Callable[..., Any]:
    """(stage, record, kind) -> a finished stage's record, upright by `flip`; None where there is none yet."""
    load, folders = run.loader(tuple(steps)), {step.stage.name: step.folder for step in steps if step.done}

    def there(stage: str, record: str, kind: type[Record]) -> Record | None:
        known = stage in folders and (folders[stage] / f"{record}.json").is_file()
        return turned(load(stage, record, kind), flip) if known else None

    return there


def cautions(folder: Path) -> tuple[str, ...]:
    """What to be careful about in the results that are there, in sentences."""
    steps, session = steps_of(folder), sessions.open_session(folder)
    there = _there(steps, session.orientation)
    surface, poses = there("surface", "surface", Surface), there("poses", "poses", Poses)
    _, (_, poses) = rescaled(folder, surface, poses)
    return report.cautions(
        report.Contents(
            title="",
            when="",
            names=tuple(shot.name for shot in sessions.shots(session)),
            poses=poses,
            panorama=there("export", "panorama", Panorama),
            grounds=there("export", "grounds", LightProvenance),
            hdr=there("hdr", "report", HdrReport),
            stages=tuple(_stage_run(step) for step in steps if step.done),
            left_out=left_out.read(session),
            notes=sessions.notes(session),
        )
    )


def flat(scores: Scores) -> Mapping[str, object]:
    return {f"{room} {name}": value for room, values in scores.items() for name, value in values.items()}


def _stage_run(step: Step) -> report.StageRun:
    record = stages.read_record(step.folder)
    assert record is not None
    return report.StageRun(
        step.stage.name, record["seconds"], record["device"], record["params"], _facts(step.folder)
    )


def _facts(folder: Path) -> Mapping[str, Any]:
    """What the stage's own report says, as plain values."""
    path = folder / "report.json"
    return artifacts.load_value(path, "values") if path.exists() else {}


def _exported(step: Step) -> tuple[str, ...]:
    if not step.done:
        return ()
    names = artifacts.load_value(step.folder / "export.json", "files")
    top = (f"{name.split('/')[0]}/" if "/" in name else name for name in names)
    return tuple(dict.fromkeys(top))
