from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np

from engine.capture_checks.checker import ShotChecker
from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.rotation import rig_consistency
from engine.capture_checks.rotation.overlap import ViewPair
from engine.capture_checks.rotation.two_view import RelativePose
from hardware.interfaces import Angles, Bracket, Exposure
from hardware.virtual.camera import VirtualCamera, VirtualCameraConfig
from hardware.virtual.scenes import Card
from hardware.virtual.studio import motion

SIZE = (320, 240)
PIXEL = 1 / 320


def by(pan_deg: float) -> np.ndarray:
    return cv2.Rodrigues(np.array([0.0, np.radians(pan_deg), 0.0]))[0]


def link(
    earlier: int, shown_deg: float, inliers: int = 40, spread: float = 1.0, shift_px: float = 30.0
) -> ViewPair:
    """A pair whose picture turned by so much; `spread`: of its points over the picture."""
    x, y = np.meshgrid(np.linspace(-0.49, 0.49, 12), np.linspace(-0.37, 0.37, 9))
    points = spread * np.column_stack([x.ravel(), y.ravel()])
    turn = RelativePose(by(shown_deg), np.array([1.0, 0.0, 0.0]), 1.0)
    return ViewPair(earlier, 9, inliers, (turn,), (points, points + [shift_px * PIXEL, 0.0]), PIXEL)


def check(
    links: Sequence[ViewPair], rig_deg: float, lens_known: bool = True, object_known: bool = True
) -> Finding | None:
    """All earlier shots at 0 degrees, as the rig says; the last one at `rig_deg`."""
    logged = [by(0.0)] * 9 + [by(rig_deg)]
    return rig_consistency.check("late", links, logged, [f"s{i}" for i in range(9)], lens_known, object_known)


# ---- by the numbers


def test_a_picture_that_turned_as_it_should_says_nothing():
    assert check([link(8, 28.0)], 30.0) is None
    assert check([link(8, 33.0)], 30.0) is None
    assert check([], 30.0) is None


def test_a_picture_that_turned_too_little_or_the_other_way_says_stop():
    for shown_deg in (0.0, 15.0, -30.0, 45.0):
        found = check([link(8, shown_deg)], 30.0)
        assert found is not None, shown_deg
        assert (found.kind, found.severity) == ("turn", Severity.STOP)
        assert "30 degrees since s8" in found.sentence


def test_one_pair_that_agrees_is_enough():
    assert check([link(7, 0.0, inliers=90), link(8, 29.0)], 30.0) is None
    assert check([link(7, 0.0, inliers=90), link(8, 22.0)], 30.0) is not None


def test_pairs_that_tell_little_accuse_nobody():
    assert check([link(8, 0.0, inliers=14)], 30.0) is None
    assert check([link(8, 0.0)], 0.5) is None


def test_a_lens_that_is_only_assumed_may_be_far_off():
    assert check([link(8, 15.0)], 30.0, lens_known=False) is None
    assert check([link(8, 15.0)], 30.0) is not None
    assert check([link(8, 0.0)], 30.0, lens_known=False) is not None


def test_a_picture_that_stands_still_needs_no_lens_and_no_large_turn():
    for rig_deg in (1.5, 3.0):
        found = check([link(8, 0.0, shift_px=0.5)], rig_deg, lens_known=False)
        assert found is not None
        assert "did not turn" in found.sentence


def test_an_object_nobody_knows_may_stand_still_while_the_room_turns():
    assert check([link(8, 0.0, spread=0.5, shift_px=0.5)], 3.0, object_known=False) is None
    assert check([link(8, 0.0, spread=1.0, shift_px=0.5)], 3.0, object_known=False) is not None


def test_without_the_rigs_word_there_is_nothing_to_contradict():
    logged = [None] * 9 + [by(30.0)]
    assert rig_consistency.check("late", [link(8, 0.0)], logged, ["s"] * 9, True, True) is None
    assert (
        rig_consistency.check("late", [link(8, 0.0)], [by(0.0)] * 9 + [None], ["s"] * 9, True, True) is None
    )


# ---- in photographs


def test_a_motor_that_stalls_is_noticed_at_once_and_once():
    stands = [Angles(0.0)]
    camera = VirtualCamera(VirtualCameraConfig(SIZE), lambda: Card("turntable", SIZE), lambda: stands[0])
    watch = ShotChecker(asdict(motion.geometry_of("turntable")))
    found: list[list[Finding]] = []
    for pose in range(4):
        said_deg = 12.0 * pose
        stands[0] = Angles(said_deg - (12.0 if pose >= 2 else 0.0))
        files = [camera.card / taken.handle for taken in camera.expose(Bracket(Exposure(None)))]
        seen = watch.add(f"s{pose}", [Path(file) for file in files], (said_deg, 0.0))
        found.append([one for one in seen if one.kind == "turn"])
    camera.close()
    assert [len(turns) for turns in found] == [0, 0, 1, 0]
