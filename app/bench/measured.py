"""Runs a row on a set, or takes what an earlier call kept of the very same: an interrupted benchmark goes on.

A kept row is named by its input's fingerprint, its own facts, the seed, the device and the engine's source. Its
seconds are those of the run that measured it, and are compared with those of the same run only.
"""

import hashlib
import json
import math
import secrets
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.bench import record
from app.bench.rows import Method, ours
from app.bench.sets import Set, job
from app.bench.stored import Stored, fewer_pixels, fewer_views
from engine.errors import SessionError
from engine.io import session as sessions
from engine.pipeline import artifacts
from engine.pipeline.stages import canonical
from engine.surface.params import SurfaceParams
from engine.surface.uncertainty.model_parts import PartWorth
from engine.types import Surface

VERSION = 4  # raise when a kept row would be measured otherwise
WARM_PIXELS, WARM_VIEWS = 100, 16
LEAST = SurfaceParams(
    directions=256, coarse_iterations=1, fine_iterations=1, gauss_newton_steps=1, normal_candidates=40,
    probe_grid_xy=2, probe_grid_z=2, probe_resolution=32,
)  # fmt: skip
"""Does all that our rows do, once."""


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """What one method made of one set."""

    set: Set
    method: Method
    surface: Surface
    seconds: float  # of the whole object; NaN: nobody knows
    extrapolated: bool
    run: str  # names the call that measured the seconds
    rendered: float = math.nan  # `Answer.rendered` and what follows it
    by_view: tuple[float, ...] = ()
    worths: tuple[PartWorth, ...] = ()


class Bench:
    """One call of the benchmark: keeps rows as they are finished."""

    def __init__(self, folder: Path, device: str, seed: int, fresh: bool):
        self._rows, self._device, self._seed, self._fresh = folder / "rows", device, seed, fresh
        self.run = secrets.token_hex(6)
        self._warm = False

    def rows(self, on: Set, methods: Sequence[Method]) -> list[Row]:
        """Every method on one set.

        Raises:
            RoomlightError: what a solver has to say.
            Cancelled: a stop was asked for; finished rows are kept.
        """
        return [self._row(on, method) for method in methods]

    def _row(self, on: Set, method: Method) -> Row:
        place = self._rows / row_key(on.stored, method, self._device, self._seed)
        if place.is_dir() and not self._fresh:
            try:
                return _read(place, on, method)
            except (SessionError, OSError, ValueError, KeyError):
                pass  # damaged: measured again, as if it had never been
        if not self._warm:
            warm_up(on.stored, self._device)
            self._warm = True
        with job(f"{on.name} {method.key}") as progress:
            answer = method.solve(on.stored, self._device, self._seed, progress)
        row = Row(
            on, method, answer.surface, answer.seconds, answer.extrapolated, self.run, answer.rendered,
            answer.by_view, answer.worths,
        )  # fmt: skip
        _keep(row, place)
        return row


def row_key(stored: Stored, method: Method, device: str, seed: int) -> str:
    """Names all that decides a row."""
    facts = [
        VERSION, stored.fingerprint, len(stored.frames.names), method.key, dict(method.facts), device, seed,
        record.engine_digest(),
    ]  # fmt: skip
    return hashlib.sha256(canonical(facts).encode()).hexdigest()[:16]


def warm_up(stored: Stored, device: str) -> None:
    """Compile and load what solvers share, so that the first row does not pay for it."""
    views = len(stored.frames.names)
    small = fewer_pixels(stored, WARM_PIXELS)
    small = fewer_views(small, min(WARM_VIEWS, views)) if stored.poses.registered.all() else small
    with job("warming up") as progress:
        ours("warm", "", LEAST).solve(small, device, 0, progress)


def _keep(row: Row, place: Path) -> None:
    """Write a row; it appears whole or not at all."""
    partial = place.with_name(place.name + ".partial")
    with sessions.told(place):
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
    try:
        artifacts.save(partial, "surface", row.surface)
        facts = {
            "seconds": _known(row.seconds), "extrapolated": row.extrapolated, "run": row.run,
            "rendered": _known(row.rendered), "by_view": row.by_view, "worths": artifacts.plain(row.worths),
        }  # fmt: skip
        artifacts.save_json(partial / "row.json", facts)
        with sessions.told(place):
            shutil.rmtree(place, ignore_errors=True)
            partial.rename(place)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _read(place: Path, on: Set, method: Method) -> Row:
    facts = json.loads((place / "row.json").read_bytes())
    surface = artifacts.load(place, "surface", Surface)
    seconds, rendered = (
        math.nan if facts[name] is None else float(facts[name]) for name in ("seconds", "rendered")
    )
    worths = tuple(PartWorth(**one) for one in facts["worths"])
    return Row(
        on, method, surface, seconds, bool(facts["extrapolated"]), str(facts["run"]), rendered,
        tuple(facts["by_view"]), worths,
    )  # fmt: skip


def _known(value: float) -> float | None:
    """JSON has no NaN."""
    return None if math.isnan(value) else value
