"""The finished runs of a session: one for every surface that was solved, newest first, read from its records alone.

A run is a folder `stages/surface/FINGERPRINT` and the results it was made from, which its `record.json` names.
Nothing is planned here: what the present settings would give is asked of `app/results.py`.
"""

import datetime
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.parameters import MEANINGS
from engine.io import session as sessions
from engine.pipeline import differences, stage_table
from engine.pipeline.artifacts import plain
from engine.pipeline.differences import brief
from engine.pipeline.stages import read_record

STAGES = ("hdr", "segment", "poses", "light", "surface", "export")
PAPER = "paper's solver"
NAME = "name.txt"
"""Beside a surface's record: what a person calls the run."""


@dataclass(frozen=True, slots=True)
class Run:
    """One finished surface and where its inputs lie."""

    session: Path
    fingerprint: str  # of the surface stage
    records: Mapping[str, Mapping[str, Any]]  # stage -> its record.json; the stages that are there
    current: bool  # the one that exports/latest shows, or else the newest
    preset: str  # with which its surface was solved, as far as its parameters tell; or `PAPER`
    besides: Mapping[str, Any]  # what was set besides, by dotted names
    name: str = ""  # that a person gave it

    def folder(self, stage: str) -> Path:
        """Where a stage of this run lies."""
        if stage == "surface":
            return self.session / "stages" / stage / self.fingerprint
        if stage == "export":
            return self.session / "stages" / stage / self.records[stage]["fingerprint"]
        return self.session / "stages" / stage / self.records["surface"]["inputs"][stage]

    @property
    def finished(self) -> datetime.datetime:
        """When its last stage ended, local time."""
        return datetime.datetime.fromtimestamp(self.records["surface"]["finished"])

    @property
    def seconds(self) -> float:
        """What all its stages took, export left out."""
        return sum(record["seconds"] for name, record in self.records.items() if name != "export")

    @property
    def flip(self) -> int:
        """What stands the photographs upright that it was solved from (`engine/orientation.py`)."""
        return int(self.records["surface"]["inputs"].get("orientation", 0))

    def reported(self, stage: str) -> Mapping[str, Any]:
        """What a stage's own report says, as plain values; empty where it wrote none."""
        try:
            return json.loads((self.folder(stage) / "report.json").read_bytes())["values"]
        except (OSError, ValueError, KeyError):
            return {}


def runs_of(session: Path) -> tuple[Run, ...]:
    """Every finished surface of a session, newest first; none where nothing was processed."""
    found = []
    latest = _latest_export(session)
    exports = _records(session, "export")
    for fingerprint, record in _records(session, "surface").items():
        records = {"surface": record}
        for stage, of in record["inputs"].items():
            known = read_record(session / "stages" / stage / str(of)) if stage in STAGES else None
            if known is not None:
                records[stage] = known
        made = [
            {**export, "fingerprint": name}
            for name, export in exports.items()
            if export["inputs"].get("surface") == fingerprint
        ]
        if made:
            records["export"] = max(
                made, key=lambda export: (export["fingerprint"] == latest, export["finished"])
            )
        found.append((record["finished"], fingerprint, records))
    found.sort(reverse=True, key=lambda run: run[:2])
    shown = [latest is not None and of.get("export", {}).get("fingerprint") == latest for _, _, of in found]
    first = shown.index(True) if True in shown else 0
    return tuple(
        Run(session, of, records, i == first, *_asked(records), _read_name(session, of))
        for i, (_, of, records) in enumerate(found)
    )


def rename(run: Run, name: str) -> None:
    """Call a run by this name from now on; "" by what was asked of it.

    Raises:
        SessionError: the disk refuses.
    """
    path = run.folder("surface") / NAME
    if name.strip():
        sessions.write_atomic(path, " ".join(name.split()).encode())
    else:
        with sessions.told(path):
            path.unlink(missing_ok=True)


def _read_name(session: Path, fingerprint: str) -> str:
    try:
        return (session / "stages" / "surface" / fingerprint / NAME).read_text()
    except (OSError, ValueError):
        return ""


def current(runs: Sequence[Run]) -> Run | None:
    """The run to show first."""
    return next((run for run in runs if run.current), None)


def changes(a: Run, b: Run) -> tuple[str, ...]:
    """What was asked otherwise: "preset standard -> draft", then "surface.directions 1024 -> 2048"."""
    table = {stage.name: stage for stage in stage_table.stages()}
    told = []
    for name in STAGES[:-1]:
        if name == "surface" and PAPER in (a.preset, b.preset):
            told += [f"{a.preset} -> {b.preset}"] if a.preset != b.preset else []
        else:
            before, after = (run.records.get(name, {}).get("params", {}) for run in (a, b))
            reasons = differences.told(table[name], before, after, (a.preset, b.preset))
            told += [reason.replace("params.", f"{name}.", 1) for reason in reasons]
        versions = [run.records.get(name, {}).get("version") for run in (a, b)]
        if versions[0] != versions[1]:
            told.append(f"{name}: method of version {versions[0]} -> {versions[1]}")
    return tuple(told)


def names(runs: Sequence[Run]) -> tuple[str, ...]:
    """A short name for each run: the one it was given, or its preset, when it ended, and what was set besides that others were not."""
    told = []
    for run in runs:
        if run.name:
            told.append(run.name)
            continue
        values = [
            f"{_label(name)} {brief(value)}"
            for name, value in run.besides.items()
            if any(other.besides.get(name) != value for other in runs)
        ]
        rest = [f"{len(values) - 2} more"] if len(values) > 2 else []
        told.append(" · ".join([f"{run.preset}, {run.finished.strftime('%d %b %H:%M')}", *values[:2], *rest]))
    return tuple(told)


def _asked(records: Mapping[str, Mapping[str, Any]]) -> tuple[str, dict[str, Any]]:
    """The preset, and by dotted names what was set besides it."""
    table = {stage.name: stage for stage in stage_table.stages()}
    surface, asked = table["surface"], records["surface"]["params"]
    known, ours = differences.dotted(asked).keys(), differences.dotted(plain(surface.defaults)).keys()
    # The other solver's own table would load the whole of it, for a name.
    preset = differences.preset_of(surface, asked) if 2 * len(known & ours) >= len(known) else PAPER
    return preset, {
        f"{stage}.{name}": value
        for stage, record in records.items()
        if stage in STAGES[:-1]
        for name, value in differences.beside(table[stage], preset, record["params"]).items()
    }


def _label(name: str) -> str:
    return MEANINGS[name].label.casefold() if name in MEANINGS else name.rpartition(".")[2]


def _records(session: Path, stage: str) -> dict[str, dict[str, Any]]:
    """Fingerprint -> record of every finished result of a stage."""
    folders = (session / "stages" / stage).glob("*")
    records = {folder.name: read_record(folder) for folder in folders if folder.suffix != ".partial"}
    return {name: record for name, record in records.items() if record is not None and "finished" in record}


def _latest_export(session: Path) -> str | None:
    try:
        return (session / "exports" / "latest").resolve(strict=True).name
    except OSError:
        return None
