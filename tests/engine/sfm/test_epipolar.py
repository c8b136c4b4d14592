"""Promises of `engine.sfm.epipolar`, on matches of points in a room, seen with the noise of small photographs and of large ones."""

import cv2
import numpy as np
import pytest

from engine.geometry import inverse
from engine.sfm.epipolar import FEWEST, Judgement, Pair, judge
from tests.engine import box_room

VIEWS = 12
TRUTH = box_room.handheld(VIEWS, reach=0.6)
FOCAL_PX = 200.0  # as a photograph of 176 px has it; what is noise of a pixel here is finer on larger ones


def matched(noise_px: float, false_pairs: float = 0.0, shared: int = 60, stretch: float = 1.0) -> list[Pair]:
    """`false_pairs` is the share of pairs of views whose matches show another place than they seem to: they fit another motion."""
    rng = np.random.default_rng(0)
    pairs = []
    for i in range(VIEWS):
        for j in range(i + 1, min(i + 5, VIEWS)):
            elsewhere = rng.random() < false_pairs
            first, second = TRUTH[i], TRUTH[(j + 4) % VIEWS] if elsewhere else TRUTH[j]
            # Half the way between where both look, one to three metres off.
            ahead = inverse(first[None])[0, :, 2] + inverse(second[None])[0, :, 2]
            ahead = ahead / np.linalg.norm(ahead)
            points = ahead * rng.uniform(1, 3, (shared, 1)) + rng.normal(size=(shared, 3)) * 0.4
            seen = []
            for pose in (first, second):
                inside = points @ pose[:, :3].T + pose[:, 3]
                seen.append(
                    inside[:, :2] / inside[:, 2:] + rng.normal(size=(shared, 2)) * noise_px / FOCAL_PX
                )
            pairs.append(Pair(i, j, *(stretch * points for points in seen)))
    return pairs


def turned(deg: float) -> np.ndarray:
    """Each camera where it was, turned another way."""
    rng = np.random.default_rng(1)
    out = TRUTH.copy()
    for row, world in enumerate(inverse(TRUTH)):
        axis = rng.normal(size=3)
        out[row, :, :3] = cv2.Rodrigues(np.radians(deg) * axis / np.linalg.norm(axis))[0] @ out[row, :, :3]
        out[row, :, 3] = -out[row, :, :3] @ world[:, 3]
    return out


def swapped() -> np.ndarray:
    order = np.arange(VIEWS)
    order[[3, 8]] = 8, 3
    return TRUTH[order]


@pytest.mark.parametrize("noise_px", [0.02, 0.3, 1.0])
@pytest.mark.parametrize("false_pairs", [0.0, 0.5])
def test_right_poses_are_not_doubted_whatever_the_noise_and_however_much_looks_alike(
    noise_px: float, false_pairs: float
):
    judgement = judge(matched(noise_px, false_pairs), TRUTH, FOCAL_PX)
    assert np.isfinite(judgement.off_deg).all()
    assert not judgement.wrong.any()


@pytest.mark.parametrize("false_pairs", [0.0, 0.5])
@pytest.mark.parametrize("poses", [turned(0.5), turned(2.0), TRUTH[::-1], np.roll(TRUTH, 1, axis=0)])
def test_poses_that_are_half_a_degree_off_or_of_other_photographs_are_doubted(
    poses: np.ndarray, false_pairs: float
):
    judgement = judge(matched(0.3, false_pairs), poses, FOCAL_PX)
    assert judgement.wrong.mean() > 0.5


def test_half_a_degree_is_not_told_where_the_photographs_do_not_tell_it():
    coarse = judge(matched(3.0), turned(0.5), FOCAL_PX)
    assert coarse.told_deg > 0.2
    assert not coarse.wrong.any()
    assert judge(matched(3.0), turned(5.0), FOCAL_PX).wrong.any()


def test_a_tenth_of_a_degree_does_no_harm_however_finely_large_photographs_tell_it():
    fine = judge(matched(0.02), turned(0.1), FOCAL_PX)
    assert np.nanmedian(fine.off_deg) > 5 * fine.told_deg
    assert not fine.wrong.any()


@pytest.mark.parametrize("false_pairs", [0.0, 0.5])
def test_two_views_that_changed_places_are_named(false_pairs: float):
    assert set(np.flatnonzero(judge(matched(0.3, false_pairs), swapped(), FOCAL_PX).wrong)) == {3, 8}


def test_a_lens_of_another_length_is_doubted():
    assert judge(matched(0.3, stretch=1.1), TRUTH, FOCAL_PX / 1.1).wrong.any()


def test_views_with_too_few_matches_are_not_judged():
    few = judge(matched(0.3, shared=FEWEST // 8 - 1), TRUTH[::-1], FOCAL_PX)
    assert np.isnan(few.off_deg).all()
    assert not few.wrong.any()


def test_points_without_a_place_in_front_of_the_lens_are_left_out():
    pairs = matched(0.3)
    whole = judge(pairs, TRUTH, FOCAL_PX)
    for pair in pairs:
        pair.a[:3] = np.nan
    without = judge(pairs, TRUTH, FOCAL_PX)
    assert without.off_deg == pytest.approx(whole.off_deg, rel=0.3)
    assert without.told_deg == pytest.approx(whole.told_deg, rel=0.2)


def test_nothing_is_said_where_views_have_nothing_in_common():
    judgement = judge([], TRUTH, FOCAL_PX)
    assert judgement.facts([str(i) for i in range(VIEWS)]) == {
        "judged": 0, "off": (), "off_deg": None, "told_deg": None
    }  # fmt: skip


def test_the_facts_name_what_is_off_and_by_how_much():
    judgement = Judgement(np.array([0.05, 1.0, np.nan, 2.0]), 0.04)
    assert judgement.facts(["a", "b", "c", "d"]) == {
        "judged": 3, "off": ("b", "d"), "off_deg": 1.5, "told_deg": 0.04
    }  # fmt: skip


def test_no_view_is_named_where_no_pair_fits_any_motion():
    assert not Judgement(np.array([1.0, 2.0]), float("nan")).wrong.any()
