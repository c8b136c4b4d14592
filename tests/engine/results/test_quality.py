"""The verdict is that of the sign that says most; what is not known says nothing."""

import math

import numpy as np
import pytest

from engine.results.quality import BAD, DOUBTFUL, GOOD, SIGNS, Quality, quality

FINE = {
    "segment": {"stands_out": 7.0, "border_alike": 0.01},
    "light": {"heldout_log_l1": 0.1},
    "surface": {
        "stderr_normal_deg": 2.0, "held_out_error": 0.05, "residual": 2.0, "unseen_light": 0.02, "object_shift_px": 0.0,
        "exposure_drift": [0.01, -0.01, 0.02, 0.0],
    },
}  # fmt: skip


def facts(**changes: object) -> dict[str, dict[str, object]]:
    found: dict[str, dict[str, object]] = {stage: dict(values) for stage, values in FINE.items()}
    stages = {"border_alike": "segment", "heldout_log_l1": "light"}
    for name, value in changes.items():
        found[stages.get(name, "surface")][name] = value
    return found


def judged(found: dict[str, dict[str, object]]) -> Quality:
    verdict = quality(found)
    assert verdict is not None
    return verdict


def test_a_session_that_measures_nothing_wrong_of_itself_is_good():
    found = judged(FINE)
    assert (found.grade, found.good) == (GOOD, True)
    assert 0 < found.doubt < 1
    assert str(found).startswith("good: no check of the stages found a fault")


@pytest.mark.parametrize(
    ("name", "doubted", "wrong", "words"),
    [
        ("stderr_normal_deg", 8.0, 12.0, "a standard error of 8 degrees"),
        ("held_out_error", 0.15, 0.4, "differ from their renderings by 15 %"),
        ("residual", 7.0, 12.0, "are 7 times the expected error"),
        ("object_shift_px", 0.6, 1.2, "the object stands 0.6 px or more beside"),
        ("border_alike", 0.3, 0.9, "30 % of the mask's border"),
        ("heldout_log_l1", 0.5, 0.9, "differ from the fitted light by 65 %"),
        ("exposure_drift", [0.3, -0.3], [0.5, -0.5], "varies by 30 % from view to view"),
        (
            "exposure_drift",
            [0.08] * 8 + [-0.08] * 8,
            [0.11] * 8 + [-0.11] * 8,
            "show the object 17 % brighter or darker",
        ),
        (
            "unseen_light",
            0.3,
            0.6,
            "30 % of the light on the object comes from directions that no photograph shows",
        ),
    ],
)
def test_each_sign_is_told_with_its_number_and_what_to_do(name, doubted, wrong, words):
    found = judged(facts(**{name: doubted}))
    assert found.grade == DOUBTFUL
    assert not found.good
    assert words in found.reason
    assert found.remedy.endswith(".")
    assert judged(facts(**{name: wrong})).grade == BAD


def test_the_worst_sign_speaks():
    assert "standard error" in judged(facts(stderr_normal_deg=30.0, residual=6.0)).reason
    assert "residuals of the object's pixels" in judged(facts(stderr_normal_deg=9.0, residual=30.0)).reason


def test_a_solver_that_knows_no_errors_is_not_judged():
    assert quality({}) is None
    assert quality({"light": {"heldout_log_l1": 9.0}, "surface": {"held_out_error": 0.5}}) is None


def test_what_is_not_known_says_nothing_and_what_is_infinite_says_all():
    assert judged({"surface": {"stderr_normal_deg": 2.0}}).good
    assert judged(facts(residual="NaN", exposure_drift=[], border_alike="NaN")).good
    found = judged(facts(residual=math.inf))
    assert (found.grade, found.doubt) == (BAD, np.inf)


def test_every_limit_is_above_what_good_sets_have():
    assert all(sign.doubt(FINE) < 0.8 for sign in SIGNS)


def test_brightness_that_changes_once_is_doubted_and_brightness_that_varies_as_much_is_not():
    rng = np.random.default_rng(0)
    noise = 0.05 * rng.normal(size=48)
    later = np.arange(48) >= 30
    assert judged(facts(exposure_drift=list(noise))).good
    found = judged(facts(exposure_drift=list(noise + 0.16 * later)))
    assert found.grade == DOUBTFUL
    assert "earlier photographs" in found.reason
    assert judged(facts(exposure_drift=list(0.17 * rng.normal(size=48)))).good
    # Views that were not fitted have 0, and say nothing of a change.
    assert judged(facts(exposure_drift=[0.0 if i % 3 else 0.16 for i in range(48)])).good
