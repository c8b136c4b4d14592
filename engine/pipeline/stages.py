"""The stages, their fingerprints, and the plan that says what would run and why.

`fingerprint = sha256(canonical JSON [stage, version, params, {input: fingerprint}])[:16]`. An input is an
earlier stage, or a file of the session by its hash. A seed counts as a parameter of the stages that draw
random numbers. Device, threads and verbosity never enter. `plan` reads and never writes.
"""

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from engine.errors import SessionError
from engine.io import left_out, scale_edit
from engine.io.session import Session, file_sha256
from engine.pipeline import artifacts, differences
from engine.pipeline import settings as asked
from engine.pipeline.settings import Settings
from engine.progress import Progress

Hashes = Mapping[str, str]

EDITS = {
    f"edits/{left_out.FILE}": "photographs left out changed",
    f"edits/{scale_edit.FILE}": "scale changed",
}
"""Edits that the plan tells in words."""


@dataclass(frozen=True, slots=True)
class Work:
    """What one stage gets to work with; `load(stage, record, type)` reads an earlier stage's record."""

    session: Session
    params: Any
    seed: int
    device: str  # "cpu" | "cuda"
    folder: Path  # the stage's own unfinished folder
    given: bool
    load: Callable[[str, str, type], Any]
    progress: Progress


@dataclass(frozen=True, slots=True)
class Stage:
    """One row of the table.

    `produce` returns the records to keep, by name; a stage whose results are files (export) writes them to
    `work.folder` itself. `reads` hashes what it uses of the session besides earlier stages. When the session
    holds the edit `given`, the stage passes that on and only `given_params` of its parameters matter. `files` are those
    of its parameters that name a file outside the session: what the file holds counts too.
    """

    name: str
    version: int
    defaults: Any  # the parameter dataclass with its default values
    inputs: tuple[str, ...]
    produce: Callable[[Work], Mapping[str, Any]]
    reads: Callable[[Session], Hashes] = field(default=lambda session: {})
    given: str | None = None
    given_params: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    seeded: bool = False
    presets: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Step:
    """One stage of a plan. `reasons` is empty when the stage is done."""

    stage: Stage
    params: Any
    inputs: Hashes
    fingerprint: str
    folder: Path
    done: bool
    given: bool
    reasons: tuple[str, ...]

    def tell(self) -> str:
        """The plan's one line for this stage."""
        if self.done:
            return "done (given)" if self.given else "done"
        if self.reasons == ("never ran",):
            return "never ran, will take what is given" if self.given else "never ran"
        return "will run because " + ", ".join(self.reasons)


def canonical(content: Any) -> str:
    """The same text for the same content, whatever the order of its keys."""
    return json.dumps(
        artifacts.plain(content), sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False
    )


def fingerprint(stage: str, version: int, params: Mapping[str, Any], inputs: Hashes) -> str:
    text = canonical([stage, version, dict(params), dict(inputs)])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def plan(session: Session, table: Sequence[Stage], settings: Settings) -> tuple[Step, ...]:
    """What each stage would do with these settings, in order; reads only.

    Raises:
        SessionError: the session is damaged or the settings name unknown stages or parameters.
    """
    asked.check_stages(settings, [stage.name for stage in table])
    steps: dict[str, Step] = {}
    for stage in table:
        inputs = {name: steps[name].fingerprint for name in stage.inputs} | dict(stage.reads(session))
        params = asked.resolve(
            stage.name, stage.defaults, stage.presets.get(settings.preset, {}),
            settings.overrides.get(stage.name, {}),
        )  # fmt: skip
        given = stage.given is not None and f"edits/{stage.given}" in inputs
        counted = counted_params(stage, params, settings.seed, given)
        print_ = fingerprint(stage.name, stage.version, counted, inputs)
        folder = session.folder / "stages" / stage.name / print_
        done = read_record(folder) is not None
        reasons = () if done else _reasons(folder.parent, stage, settings.preset, counted, inputs)
        steps[stage.name] = Step(stage, params, inputs, print_, folder, done, given, reasons)
    return tuple(steps.values())


def counted_params(stage: Stage, params: Any, seed: int, given: bool) -> dict[str, Any]:
    """The parameters that decide the result, as plain values."""
    values = {item.name: artifacts.plain(getattr(params, item.name)) for item in dataclasses.fields(params)}
    if given:
        return {name: values[name] for name in stage.given_params}
    contents = {name: _content(Path(values[name])) for name in stage.files if values[name]}
    return values | contents | ({"seed": seed} if stage.seeded else {})


def _content(path: Path) -> str:
    """The hash of a file, wherever it lies; its path where it cannot be read, which the stage itself will say."""
    try:
        return file_sha256(path)[:16]
    except OSError:
        return str(path)


def files(table: Sequence[Stage]) -> tuple[str, ...]:
    """The parameters that name files outside the session, as `--set` takes them."""
    return tuple(f"{stage.name}.{name}" for stage in table for name in stage.files)


def until(steps: Sequence[Step], last: str | None) -> tuple[Step, ...]:
    """The steps up to and with stage `last`."""
    names = [step.stage.name for step in steps]
    check_stage(last, names)
    return tuple(steps) if last is None else tuple(steps[: names.index(last) + 1])


def check_stage(name: str | None, known: Sequence[str]) -> None:
    """
    Raises:
        SessionError: the stage is named and not among those that are known.
    """
    if name not in (None, *known):
        raise SessionError(f"there is no stage {name!r}; stages: {', '.join(known)}")


def read_record(folder: Path) -> dict[str, Any] | None:
    """`record.json` of a finished stage, its parameters by their names of today; None where there is none."""
    try:
        record = json.loads((folder / "record.json").read_bytes())
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict):
        return None
    return record | {"params": asked.renamed(folder.parent.name, record.get("params", {}))}


def _reasons(
    stage_folder: Path, stage: Stage, preset: str, params: Mapping[str, Any], inputs: Hashes
) -> tuple[str, ...]:
    """How this run differs from the stage's latest finished one."""
    records = [read_record(folder) for folder in stage_folder.glob("*") if folder.suffix != ".partial"]
    finished = [record for record in records if record is not None]
    if not finished:
        return ("never ran",)
    last = max(finished, key=lambda record: record["finished"])
    reasons = []
    if last["version"] != stage.version:
        reasons.append(f"the stage's method is new (version {last['version']} -> {stage.version})")
    before, now = (differences.dotted(values) for values in (last["params"], params))
    if before and 2 * len(before.keys() & now.keys()) < len(before):
        # Another solver, say: naming all that either has alone would tell nobody anything.
        return ("another method, with other parameters",)
    reasons += differences.told(stage, before, now, (differences.preset_of(stage, before, preset), preset))
    changed = [
        name
        for name in sorted(inputs.keys() | last["inputs"].keys())
        if last["inputs"].get(name) != inputs.get(name)
    ]
    reasons += _told_inputs(changed, last["inputs"], inputs)
    return tuple(reasons)


def _told_inputs(changed: Sequence[str], old: Hashes, new: Hashes) -> list[str]:
    """One phrase an input; many shots in one phrase."""
    how = {
        name: "added" if name not in old else "removed" if name not in new else "changed" for name in changed
    }
    told = [
        EDITS.get(name, f"input {name} {word}") for name, word in how.items() if not name.startswith("shots/")
    ]
    for word in ("added", "removed", "changed"):
        shots = [name for name in changed if how[name] == word and name.startswith("shots/")]
        if len(shots) > 3:
            told.append(f"input shots: {len(shots)} {word}")
        else:
            told += [f"input {name} {word}" for name in shots]
    return told
