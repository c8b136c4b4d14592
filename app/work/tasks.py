"""What a worker child can be asked for besides answers: process, import, simulate, the demo, export, report.

Each function takes the request (plain JSON values) and the link to the window; engine rooms are imported inside,
so that a child loads what its task needs and nothing else.
"""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from app.work.worker import Link


def process(request: Mapping[str, Any], link: Link) -> Mapping[str, Any]:
    """Run the stages that are not done, as params.toml and the request's changes ask; `quality` is the result's verdict.

    Request: session, device ("auto" | "cpu" | "cuda"), until (a stage; optional), changes (fields of `Changes`; optional),
    scheduler (of a cluster that is to do it; optional, and without changes).
    """
    if request.get("scheduler"):
        from app.batch import relay

        return relay.process(request, link)
    from app.changes import Changes, open_changed
    from app.quality import quality_of
    from engine.pipeline import run, stages

    asked = open_changed(Path(request["session"]), Changes(**request.get("changes", {})))
    opened, rows, settings = asked.session, asked.rows, asked.settings
    for note in settings.notes:
        link.log(f"note: {note}")
    until = request.get("until")
    planned = stages.until(stages.plan(opened, rows, settings), until)
    waiting = [step.stage.name for step in planned if not step.done]
    link.emit("data", kind="waiting", stages=waiting)

    def begins(step: stages.Step) -> None:
        name = step.stage.name
        number = waiting.index(name) + 1 if name in waiting else 0
        link.emit("stage", name=name, number=number, count=len(waiting))
        link.log(f"{name}: {step.tell()}")

    def ends(step: stages.Step, seconds: float) -> None:
        link.emit("stage_done", name=step.stage.name, seconds=seconds)
        link.log(f"{step.stage.name}: done in {seconds:.1f} s")

    def views(step: stages.Step, make: Callable[[], Any]) -> None:
        from app.work import stage_picture

        to = opened.folder / "derived" / f"{step.stage.name}-so-far.png"
        stage_picture.preview(make(), opened.orientation, to)
        link.emit("data", kind="preview", stage=step.stage.name, file=str(to))

    watcher = run.Watcher(
        begins, lambda step, fraction, note: link.move(fraction, note), ends, link.cancelled, views
    )
    steps = run.process(opened, rows, settings, request.get("device", "auto"), until, watcher)
    verdict = quality_of({step.stage.name: step.folder for step in steps})
    ran = [step.stage.name for step in steps if not step.done]
    return {"ran": ran} | ({} if verdict is None else {"quality": dataclasses.asdict(verdict)})


def import_photographs(request: Mapping[str, Any], link: Link) -> Mapping[str, Any]:
    """Make a session of a folder of photographs.

    Request: folder, session, poses (optional), mask (optional), bracket (exposures a view; None finds out).
    """
    from engine import importing
    from engine.io import session as sessions

    link.emit("stage", name="import", number=1, count=1)
    poses, mask = request.get("poses"), request.get("mask")
    made = importing.make_session(
        Path(request["folder"]),
        Path(request["session"]),
        Path(poses) if poses else None,
        Path(mask) if mask else None,
        request.get("bracket"),
        link.progress(),
    )
    for note in sessions.notes(made):
        link.log(f"note: {note}")
    link.log(importing.describe_poses(made))
    return {"session": str(made.folder), "views": len(sessions.shots(made))}


def simulate(request: Mapping[str, Any], link: Link) -> Mapping[str, Any]:
    """Photograph a virtual object in a virtual room. Request: as `app.simulating.Request.content` has it."""
    from app import simulating, studio

    link.emit("stage", name="simulate", number=1, count=1)
    asked = simulating.request_of(request)
    notes = studio.simulate(asked.out, asked.order, asked.vignetting, link.progress())
    for note in notes:
        link.log(f"note: {note}")
    return {"session": str(asked.out / "session"), "truth": str(asked.out / "truth"), "notes": list(notes)}


def demo(request: Mapping[str, Any], link: Link) -> Mapping[str, Any]:
    """Lay the bundled session out with its finished results. Request: session. What it returns asks for what is left to do.

    Results of another version of the method are shown as they are: only the photographs are merged then.
    """
    from app import demo as demos
    from app.changes import Changes, open_changed
    from engine.pipeline import stages

    link.emit("stage", name="demo", number=1, count=1)
    folder = Path(request["session"])
    demos.copy(demos.bundled(), folder, demos.RESULTS)
    asked = open_changed(folder, Changes())
    steps = {step.stage.name: step for step in stages.plan(asked.session, asked.rows, asked.settings)}
    return {"session": str(folder), "until": None if steps["surface"].done else "hdr"}


def export(request: Mapping[str, Any], link: Link) -> Mapping[str, Any]:
    """Copy the results out.

    Request: session, to, green ("up" | "down": which way green of the normal PNGs points), files (names; None: all).
    """
    from app import results
    from engine.results import export as exports

    link.emit("stage", name="export", number=1, count=1)
    finished = results.finished(Path(request["session"]), "export").folder
    files = request.get("files")
    exports.copy(
        finished,
        Path(request["to"]),
        request.get("green"),
        None if files is None else frozenset(files),
        link.progress(),
    )
    return {"to": request["to"]}


def report(request: Mapping[str, Any], link: Link) -> Mapping[str, Any]:
    """Write the HTML page. Request: session, to (optional)."""
    from app import results

    link.emit("stage", name="report", number=1, count=1)
    to = request.get("to")
    page = results.write_report(Path(request["session"]), Path(to) if to else None, progress=link.progress())
    return {"page": str(page)}
