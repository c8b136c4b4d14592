"""Killed at any moment, the next run finishes with the bytes of an undisturbed one; all stages for real.

`python -m tests.bench.killed` does the same more often, with poses and mask found rather than given.
"""

import random
import shutil
from pathlib import Path

import pytest

from tests.bench.killed import differing, finish, kill, results
from tests.end_to_end import bundled

LEAST = (
    "hdr.long_edge_px=160",
    "light.budget=1500",
    "light.width=64",
    "light.passes=[2,2]",
    "surface.directions=128",
    "surface.rough_rounds=1",
    "surface.rounds=1",
    "surface.passes=1",
    "surface.probes_across=1",
    "surface.probes_deep=1",
    "surface.probe_face_px=24",
    "surface.candidates=40",
    "surface.relight=false",
    "surface.held_out=2",
)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str], float]:
    """A finished session, the options it was run with, and the seconds that took."""
    folder = bundled.copy(bundled.DEMO, tmp_path_factory.mktemp("killed") / "undisturbed", views=12)
    distance = bundled.give_truth(folder)
    options = [word for change in LEAST for word in ("--set", change)]
    options += ["--set", f"surface.object_distance={distance}"]
    return folder, options, finish(folder, options)


@pytest.mark.parametrize("seed", range(3))
def test_a_killed_run_resumes_to_the_bytes_of_an_undisturbed_one(
    undisturbed: tuple[Path, list[str], float], tmp_path: Path, seed: int
) -> None:
    whole, options, seconds = undisturbed
    struck = bundled.copy(whole, tmp_path / "struck")
    # Importing takes the first seconds of a run; kills after them meet a stage at work.
    moment = random.Random(seed).uniform(0.3, 0.95) * seconds
    # A kill after the last result was kept strikes nothing either.
    while kill(struck, options, moment) == "nothing" or results(struck) == results(whole):
        shutil.rmtree(struck)
        bundled.copy(whole, struck)
        moment *= 0.8
    finish(struck, options)
    assert differing(results(whole), results(struck)) == []
    assert not list(struck.rglob("*.partial"))
