"""A table of earlier records, each of which measured some of its sets: hours of work need not be one call.

The rows of a set come from one record, which compared them over the same pixels. An engine of another text may give
other answers, so that every record's is told.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.bench.estimated import Estimated
from app.bench.record import BenchError, Record, read, told
from app.bench.scores import Scored, by_method

ALIKE = ("command", "size", "inputs", "seed")
"""What records must have in common to be of one table."""
UNSURE = ("seconds", "rendered", "in_band", "bound", "to_bound", "blur", "depth_within", "depth_between")
"""What of a row may be unknown; older records do not name all of it."""


def row(one: Scored) -> dict[str, Any]:
    """As a record holds it: NaN is null."""
    known = {key: _known(value) for key, value in one.values.items()}
    return asdict(one) | {"values": known} | {name: _known(getattr(one, name)) for name in UNSURE}


def merged(
    paths: Sequence[Path], command: str
) -> tuple[Record, dict[str, list[Scored]], list[Estimated], list[str]]:
    """(The first record, all rows by group, mask and poses as estimated, a line about every record).

    Raises:
        BenchError: a record cannot be read, holds no rows, is of another measurement or of a set that another holds too;
            or a method is missing on some of the sets, so that its mean would be one of others.
    """
    records = [read(path) for path in paths]
    first, groups, owner = records[0], {}, {}
    estimated = [
        _estimated(entry, path) for path, one in zip(paths, records, strict=True) for entry in one.estimated
    ]
    for number, (path, one) in enumerate(zip(paths, records, strict=True)):
        if one.command != command or not one.rows:
            raise BenchError(f"{path}: holds no rows of `bench {command}`; write one with --json")
        for name in ALIKE:
            if getattr(one, name) != getattr(first, name):
                raise BenchError(
                    f"{path}: its {name} is {getattr(one, name)!r}, that of {paths[0]} is {getattr(first, name)!r};"
                    " only parts of one table go together"
                )
        for group, held in one.rows.items():
            found = [_scored(entry, path) for entry in held]
            for each in found:
                other = owner.setdefault((group, each.set), number)
                if other != number:
                    raise BenchError(f"{paths[other]} and {path} both hold {each.set}; name one of them")
            groups.setdefault(group, []).extend(found)
    for found in groups.values():
        _check_complete(found)
    lines = [
        f"{path}: {told(one)}, engine {one.versions.get('engine', 'unknown')}"
        for path, one in zip(paths, records, strict=True)
    ]
    engines = {one.versions.get("engine") for one in records}
    if len(engines) > 1:
        lines.append(
            f"NOT of one engine: the source of the solvers differs between these records ({len(engines)})"
        )
    return first, groups, estimated, lines


def _check_complete(found: Sequence[Scored]) -> None:
    sets = {one.set for one in found}
    for method, group in by_method(found).items():
        if missing := sorted(sets - {one.set for one in group}):
            raise BenchError(
                f"{method} was not measured on {', '.join(missing)}, which other rows were: their means would be of"
                " other sets; measure it there, or leave it out with --methods"
            )


def _scored(entry: Mapping[str, Any], path: Path) -> Scored:
    try:
        values = {key: _number(value) for key, value in entry["values"].items()}
        changed: dict[str, Any] = {
            "values": values, "runs": tuple(entry["runs"]), **{name: _number(entry.get(name)) for name in UNSURE},
        }  # fmt: skip
        return Scored(**{**entry, **changed})
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise _unreadable(path, error) from error


def _estimated(entry: Mapping[str, Any], path: Path) -> Estimated:
    try:
        return Estimated(**entry)
    except TypeError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: Exception) -> BenchError:
    return BenchError(f"{path}: its rows cannot be read ({error}); measure them again with --json")


def _known(value: float) -> float | None:
    """JSON has neither NaN nor infinities."""
    return value if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
