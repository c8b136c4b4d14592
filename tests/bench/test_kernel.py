"""The kernel's benchmark measures what it says: the same view, gradients in the same parameters, honest sums."""

from dataclasses import replace

import numpy as np
import pytest

from engine.light.gaussians.gaussians import radiance_towards
from tests.bench import kernel
from tests.bench.kernel import Cost


def cost(count: int = 50_000, both_s: float = 0.2) -> Cost:
    return Cost(count, 512 * 512, 0.1, both_s, 19.0, 33.0, 40.0, 60.0, 1e-5, 1e-4)


def cells(text: str, row: int) -> dict[str, str]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    return dict(zip(lines[0], lines[2 + row], strict=True))


def test_kernel_and_reference_agree_on_the_chosen_rays_and_every_gradient() -> None:
    found = kernel.measure(count=400, size=24, repeat=1, rays=50, seed=3)
    assert 0 < found.forward_off < 1e-3
    assert 0 < found.gradient_off < 1e-3
    assert found.per_ray <= found.listed


def test_a_finer_room_covers_a_ray_as_often() -> None:
    view = kernel.looking(64)
    counts = []
    for count in (4000, 16_000):
        gaussians = kernel.room(count, np.random.default_rng(0))
        counts.append(kernel.coverage(gaussians, radiance_towards(gaussians, view.origin), view)[0])
    assert counts[0] == pytest.approx(counts[1], rel=0.1)
    assert 17 < counts[1] < 22


def test_the_first_run_does_not_count_and_the_median_does(monkeypatch: pytest.MonkeyPatch) -> None:
    spent, now = iter([100.0, 1.0, 9.0, 2.0]), [0.0]

    def act() -> None:
        now[0] += next(spent)

    monkeypatch.setattr(kernel.time, "process_time", lambda: now[0])
    assert kernel.core_seconds(act, 3) == 2.0


def test_costs_per_ray_and_ratios_worked_by_hand() -> None:
    row = cells(kernel.table([cost()]), 0)
    # 0.1 s over 262144 rays is 381 ns.
    assert (row["forward ns/ray"], row["both ns/ray"]) == ("381", "763")
    assert (row["forward x"], row["both x"]) == ("400", "300")


def test_the_target_is_met_missed_or_not_measured() -> None:
    for given, word in (
        (cost(), "met"),
        (cost(both_s=0.26), "MISSED"),
        (cost(count=5000), "not measured here"),
    ):
        assert kernel.verdict([given]).splitlines()[0].endswith(word)


def test_every_count_must_agree_with_the_reference_in_radiance_and_gradients() -> None:
    off = replace(cost(count=5000), forward_off=2e-4, gradient_off=2e-3)
    for costs, word in (([cost()], "met"), ([off, cost()], "MISSED")):
        _, radiance, gradients = kernel.verdict(costs).splitlines()
        assert radiance.endswith(word)
        assert gradients.endswith(word)


def test_the_largest_difference_is_relative_to_its_own_ray() -> None:
    theirs = np.array([[1.0, 1.0, 1.0], [0.01, 0.01, 0.01]])
    ours = np.column_stack([theirs + [[0.001], [0.001]], np.zeros((2, 2))])
    assert kernel.largest_off(ours, theirs) == pytest.approx(0.1)
