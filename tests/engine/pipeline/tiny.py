"""A tiny pipeline of three quick stages, and a session for it; run as a script, it processes a session."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from engine.io import session as sessions
from engine.pipeline import run
from engine.pipeline.settings import Settings
from engine.pipeline.stages import Stage, Work


@dataclass(frozen=True, slots=True)
class Numbers:
    values: np.ndarray
    flags: np.ndarray
    names: tuple[str, ...]
    spread: float


@dataclass(frozen=True, slots=True)
class CountParams:
    size: int = 1000
    gain: float = 1.5
    way: str = "plain"


@dataclass(frozen=True, slots=True)
class SumParams:
    directions: int = 512


@dataclass(frozen=True, slots=True)
class NoParams:
    pass


def count(work: Work) -> dict[str, Numbers]:
    total = sum(int(sha[:8], 16) for shot in sessions.shots(work.session) for sha in shot.sha256)
    rng = np.random.default_rng(total)
    for i in range(5):
        work.progress.step(i / 5, "counting")
        time.sleep(0.01)
    values = work.params.gain * rng.normal(size=(work.params.size, 3))
    return {"numbers": Numbers(values, values[:, 0] > 0, ("x", "y"), float("nan"))}


def add(work: Work) -> dict[str, Numbers]:
    before = work.load("count", "numbers", Numbers)
    rng = np.random.default_rng(work.seed)
    values = before.values + rng.normal(size=before.values.shape)
    for i in range(5):
        work.progress.step(i / 5, "adding")
        time.sleep(0.01)
    return {"numbers": Numbers(values, before.flags, before.names, work.params.directions * 0.5)}


def show(work: Work) -> dict[str, Numbers]:
    numbers = work.load("add", "numbers", Numbers)
    (work.folder / "shown").mkdir()
    (work.folder / "shown" / "sum.txt").write_text(f"{numbers.values.sum():.12g}\n")
    return {}


def _shots(session: sessions.Session) -> dict[str, str]:
    return {f"shots/{shot.folder.name}": shot.fingerprint for shot in sessions.shots(session)}


def table(version: int = 1) -> tuple[Stage, ...]:
    return (
        Stage("count", version, CountParams(), (), count, reads=_shots, presets={"draft": {"size": 10}}),
        Stage("add", 1, SumParams(), ("count",), add, seeded=True),
        Stage("export", 1, NoParams(), ("count", "add"), show),
    )


def make_session(folder: Path, shots: int = 3) -> sessions.Session:
    session = sessions.create(folder, "raw", {"model": "none", "width": 4, "height": 4})
    for i in range(shots):
        source = folder.parent / f"source{i}.dng"
        source.write_bytes(f"photograph {i}".encode())
        sessions.add_shot(session, f"IMG_{i}", [source], [{"shutter_s": 0.1}])
    return session


if __name__ == "__main__":
    told = run.Watcher(moves=lambda step, fraction, note: print(step.stage.name, fraction, flush=True))
    run.process(sessions.open_session(Path(sys.argv[1])), table(), Settings(), "cpu", watcher=told)
