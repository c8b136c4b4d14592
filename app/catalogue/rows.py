"""What a catalogue says of a session: where it stands, what was photographed, what came out and how sure that is.

Of a session that is stale its latest finished results are shown, and what in them is out of date.
"""

import datetime
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.batch.agenda import entry
from app.changes import Changes
from app.costs import latest_run
from app.quality import quality_of
from app.words import sentence
from engine.errors import SessionError
from engine.io import session as sessions
from engine.io.formats.arrays import UNREADABLE

PICTURES = {"photograph": "photograph.png", "albedo": "albedo.png", "normals": "normal.png"}
"""What is shown of a session, and the file of its export that shows it."""


@dataclass(frozen=True, slots=True)
class Row:
    """One session. Plain values, as catalogue.json has them: docs/automation.md."""

    key: str  # of its pictures' folder; no other session's
    name: str
    folder: str
    standing: str
    stale: str  # what is out of date, "" where nothing is
    verdict: str  # "good", "doubtful", "not to be trusted"; "" where there is no result
    reason: str  # of the verdict
    views: int
    width: int
    height: int
    megabytes: float  # of the photographs
    camera: str
    photographed: str  # ISO date of the first photograph, "" where the files do not say
    processed: str  # of the latest result
    version: str  # of the program that made it, and of the surface's method
    stderr_normal_deg: float | None  # half of the pixels have more
    held_out_error: float | None  # of views that were kept out, relative
    unit_of_length: str
    report: str | None  # a path, where one was written
    export: str | None  # the folder of the latest export
    export_fingerprint: str | None


def row(folder: Path, name: str, key: str) -> Row:
    """
    Raises:
        SessionError: the session, or a report in it, is damaged.
    """
    planned = entry(folder, name, Changes())
    session = sessions.open_session(folder)
    runs = {step.stage.name: latest_run(step.folder.parent) for step in planned.steps}
    found = {stage: run for stage, run in runs.items() if run is not None}
    # Of a stage that is up to date the run that the plan names; else its latest.
    folders = {stage: run[0] for stage, run in found.items()} | {
        step.stage.name: step.folder for step in planned.steps if step.done
    }
    verdict = quality_of(folders)
    surface, export = _values(folders.get("surface")), folders.get("export")
    exposures = [facts for shot in sessions.shots(session) for facts in shot.exposures]
    camera, page = session.facts["camera"], folder / "exports" / "report.html"
    finished = max((float(run[1]["finished"]) for run in found.values()), default=0.0)
    made_by = found["surface"][1] if "surface" in found else {}
    software = made_by.get("software", {}).get("roomlight", "")
    return Row(
        key, planned.called, str(folder.resolve()), planned.standing.value,
        "; ".join(f"{step.stage.name} {step.tell()}" for step in planned.steps if step.reasons not in ((), ("never ran",))),
        verdict.grade if verdict else "", sentence(f"{verdict.reason} {verdict.remedy}".strip()) if verdict else "",
        len(sessions.shots(session)), int(camera.get("width", 0)), int(camera.get("height", 0)),
        round(sum(facts["bytes"] for facts in exposures) / 1e6, 1), str(camera.get("model") or ""),
        _day(min((str(facts["time"]) for facts in exposures if facts.get("time")), default="")),
        datetime.datetime.fromtimestamp(finished).strftime("%Y-%m-%d") if finished else "",
        f"{software}, surface {made_by['version']}".removeprefix(", ") if made_by else "",
        _number(surface.get("stderr_normal_deg")), _number(surface.get("held_out_error")),
        _unit(export), str(page.resolve()) if page.is_file() else None,
        str(export.resolve()) if export else None, export.name if export else None,
    )  # fmt: skip


def _values(stage: Path | None) -> dict[str, Any]:
    from engine.pipeline import artifacts

    report = stage / "report.json" if stage else None
    return artifacts.load_value(report, "values") if report and report.is_file() else {}


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def _day(time: str) -> str:
    """EXIF's 2026:11:29 12:00:00 and ISO alike."""
    return time[:10].replace(":", "-")


def _unit(export: Path | None) -> str:
    try:
        return str(json.loads((export / "export.json").read_bytes())["unit_of_length"]) if export else ""
    except FileNotFoundError:
        return ""  # of the first versions
    except UNREADABLE as error:
        raise SessionError(f"{export}: damaged ({error}); remove this folder and process again") from error
