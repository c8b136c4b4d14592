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

from app.state import Trouble
from engine.pipeline.stages import brief, dotted

STAGES = ("hdr", "segment", "poses", "light", "surface", "export")


@dataclass(frozen=True, slots=True)
class Run:
    """One finished surface and where its inputs lie."""

    session: Path
    fingerprint: str  # of the surface stage
    records: Mapping[str, Mapping[str, Any]]  # stage -> its record.json; the stages that are there
    current: bool  # the one that exports/latest shows, or else the newest

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
            known = _read(session / "stages" / stage / str(of) / "record.json") if stage in STAGES else None
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
    return tuple(Run(session, name, of, i == first) for i, (_, name, of) in enumerate(found))


def current(runs: Sequence[Run]) -> Run | None:
    """The run to show first."""
    return next((run for run in runs if run.current), None)


def differences(a: Run, b: Run) -> tuple[str, ...]:
    """What was asked otherwise, stage by stage: "surface.directions 1024 -> 2048"."""
    told = []
    for stage in STAGES[:-1]:
        before, after = (dotted(run.records.get(stage, {}).get("params", {})) for run in (a, b))
        told += [
            f"{stage}.{name} {brief(before.get(name))} -> {brief(after.get(name))}"
            for name in sorted(before.keys() | after.keys())
            if before.get(name) != after.get(name)
        ]
        versions = [run.records.get(stage, {}).get("version") for run in (a, b)]
        if versions[0] != versions[1]:
            told.append(f"{stage}: method of version {versions[0]} -> {versions[1]}")
    return tuple(told)


def names(runs: Sequence[Run]) -> tuple[str, ...]:
    """A short name for each run: when it ended, and the parameters in which it differs from the others."""
    flat = [
        {
            f"{stage}.{name}": value
            for stage in STAGES[:-1]
            for name, value in dotted(run.records.get(stage, {}).get("params", {})).items()
        }
        for run in runs
    ]
    keys = sorted({key for one in flat for key in one})
    differing = [key for key in keys if len({json.dumps(one.get(key)) for one in flat}) > 1]
    told = []
    for run, one in zip(runs, flat, strict=True):
        values = [f"{key.partition('.')[2]} {brief(one.get(key))}" for key in differing]
        rest = [f"{len(values) - 3} more"] if len(values) > 3 else []
        told.append(" · ".join([run.finished.strftime("%d %b %H:%M"), *values[:3], *rest]))
    return tuple(told)


def nothing_yet(session: Path | None) -> Trouble:
    """Why there is nothing to show."""
    if session is None:
        return Trouble("No session is open", "open one, or capture a new one, on the start page")
    return Trouble(
        "This session has no finished surface yet", "process it; results appear here when they are there"
    )


def _records(session: Path, stage: str) -> dict[str, dict[str, Any]]:
    """Fingerprint -> record of every finished result of a stage."""
    folders = (session / "stages" / stage).glob("*")
    records = {
        folder.name: _read(folder / "record.json") for folder in folders if folder.suffix != ".partial"
    }
    return {name: record for name, record in records.items() if record is not None and "finished" in record}


def _read(path: Path) -> dict[str, Any] | None:
    try:
        record = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) else None


def _latest_export(session: Path) -> str | None:
    try:
        return (session / "exports" / "latest").resolve(strict=True).name
    except OSError:
        return None
