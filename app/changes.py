"""What a command line changes of a session's settings, and the stages that are then asked for."""

from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from engine.pipeline import settings as asked
from engine.pipeline.settings import Settings

if TYPE_CHECKING:
    from engine.io.session import Session
    from engine.pipeline.stages import Stage


@dataclass(frozen=True, slots=True)
class Changes:
    """As `--preset`, `--seed`, `--set` and `--solver` have them; what is left out stays as params.toml says."""

    preset: str | None = None
    seed: int | None = None
    assignments: tuple[str, ...] = ()
    solver: str | None = None


@dataclass(frozen=True, slots=True)
class Asked:
    """A session with the settings asked for, which are not yet written."""

    session: "Session"
    rows: "tuple[Stage, ...]"
    settings: Settings


def changes_of(args: Namespace) -> Changes:
    """What the options say that `process`, `plan` and `batch` share."""
    return Changes(args.preset, args.seed, tuple(args.set), args.solver)


def open_changed(folder: Path, changes: Changes) -> Asked:
    """
    Raises:
        SessionError: the session is damaged, or the settings are unknown.
    """
    from engine.io import session as sessions
    from engine.pipeline import stage_table, stages

    opened = sessions.open_session(folder)
    before = asked.from_toml(sessions.read_params(opened))
    rows = stage_table.stages(changes.solver or before.solver)
    settings = asked.with_changes(
        before, changes.preset, changes.seed, changes.assignments, changes.solver, stages.files(rows)
    )
    return Asked(opened, rows, settings)


def check(changes: Changes, until: str | None = None) -> None:
    """Refuse, before any session is looked at, what no session could be asked.

    Raises:
        SessionError: a setting or a stage is unknown.
    """
    from engine.pipeline import stage_table, stages

    rows = stage_table.stages(changes.solver or Settings().solver)
    settings = asked.with_changes(
        Settings(), changes.preset, changes.seed, changes.assignments, changes.solver, stages.files(rows)
    )
    names = [row.name for row in rows]
    asked.check_stages(settings, names)
    for row in rows:
        asked.resolve(
            row.name, row.defaults, row.presets.get(settings.preset, {}), settings.overrides.get(row.name, {})
        )
    stages.check_stage(until, names)
