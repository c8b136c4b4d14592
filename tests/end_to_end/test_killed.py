"""Killed in the midst of its stages, a run finishes with the bytes of an undisturbed one; all stages for real.

`python -m tests.bench.killed` does the same at any moment and more often, with poses and mask found rather than given.
"""

import random
import shutil
from pathlib import Path

import pytest

from tests.bench.killed import differing, finish, kill, results
from tests.end_to_end import bundled

LEAST = (
    "hdr.long_edge_px=160",
    "poses.features.maximum=500",
    "light.max_gaussians=1500",
    "light.max_image_width=64",
    "light.epochs=[2,2]",
    "surface.directions=128",
    "surface.coarse_iterations=1",
    "surface.fine_iterations=1",
    "surface.gauss_newton_steps=1",
    "surface.probe_grid_xy=1",
    "surface.probe_grid_z=1",
    "surface.probe_resolution=24",
    "surface.normal_candidates=40",
    "surface.without=light_gains,detect_metal,classify_material",
    "surface.validation_views=2",
)

STRUCK = ("hdr", "light", "surface")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A finished session, and the options it was run with."""
    folder = bundled.copy(bundled.DEMO, tmp_path_factory.mktemp("killed") / "undisturbed", views=9)
    distance = bundled.give_truth(folder)
    options = [word for change in LEAST for word in ("--set", change)]
    options += ["--set", f"surface.object_distance={distance}"]
    finish(folder, options)
    return folder, options


def test_a_run_killed_in_one_stage_after_another_ends_with_the_bytes_of_an_undisturbed_one(
    undisturbed: tuple[Path, list[str]], tmp_path: Path
) -> None:
    whole, options = undisturbed
    struck = bundled.copy(whole, tmp_path / "struck")
    for stage in STRUCK:
        after_s = random.Random(stage).uniform(0, 1)
        # A stage that is over by then has not been struck; what was instead is taken out of the way, for it would be found again.
        while kill(struck, options, after_s, stage) != stage:
            assert after_s > 0.01
            for other in [*STRUCK[STRUCK.index(stage) :], "segment", "poses", "export"]:
                shutil.rmtree(struck / "stages" / other, ignore_errors=True)
            after_s /= 2
    finish(struck, options)
    assert differing(results(whole), results(struck)) == []
    assert not list(struck.rglob("*.partial"))
