import copy
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from engine.capture_checks.checker import ShotChecker
from engine.capture_checks.finding import Finding, Severity
from engine.capture_checks.planning.coverage import UNSEEN
from engine.capture_checks.rough_mask import on_grid
from engine.io import session as sessions
from engine.io.ground_truth import read_truth
from engine.sfm.rig_alignment import angle_between, mean_rotation
from tests.end_to_end.bundled import CAPTURE
from tests.engine import folders
from tests.engine.capture_checks import broken

FEW, BEFORE = 9, 20  # shots seen before the broken one


@dataclass(frozen=True)
class Seen:
    """A session as it was seen, whole and after some of its shots."""

    shots: tuple[sessions.Shot, ...]
    whole: ShotChecker
    findings: tuple[Finding, ...]
    few: ShotChecker
    some: ShotChecker
    mask: np.ndarray
    turns: np.ndarray


@pytest.fixture(scope="module")
def seen() -> Seen:
    shots = sessions.shots(sessions.open_session(CAPTURE / "session"))
    truth = read_truth(CAPTURE / "truth")
    watch, stages, findings = ShotChecker(), list[ShotChecker](), list[Finding]()
    for number, shot in enumerate(shots):
        if number in (FEW, BEFORE):
            stages.append(copy.deepcopy(watch))
        findings += watch.add(shot.name, shot.files)
    assert truth.cam_from_world is not None
    return Seen(shots, watch, tuple(findings), *stages, truth.mask, truth.cam_from_world[:, :, :3])


def next_shot(seen: Seen, tmp_path: Path, change: broken.Change, number: int = BEFORE) -> Sequence[Finding]:
    """What is found in shot `number`, changed, after the first `BEFORE`."""
    files = broken.rewritten(list(seen.shots[number].files), tmp_path / "broken", change)
    return copy.deepcopy(seen.some).add("broken", files)


def of_kind(findings: Sequence[Finding], kind: str) -> list[Finding]:
    return [finding for finding in findings if finding.kind == kind]


# ---- a good session


def test_a_good_session_raises_no_alarm_but_one_in_fifty(seen):
    alarms = [one for one in seen.findings if one.severity is not Severity.NOTE]
    assert len({one.shot for one in alarms}) <= 1, [one.sentence for one in alarms]


def test_rewriting_a_shot_alone_changes_nothing(seen, tmp_path):
    assert not next_shot(seen, tmp_path, lambda channel, place: channel)


def test_the_object_is_found_where_it_is(seen):
    found = on_grid(seen.some.object_mask, seen.mask.shape)
    assert (found & seen.mask).sum() / (found | seen.mask).sum() > 0.95


def test_turns_agree_with_the_truth(seen):
    turned = seen.whole.turned
    assert (turned.group == turned.main).all()
    world = mean_rotation(seen.turns.transpose(0, 2, 1) @ turned.cam_from_world)
    off_deg = np.degrees(angle_between(turned.cam_from_world, seen.turns @ world))
    assert np.median(off_deg) < 3
    assert off_deg.max() < 12


def test_the_lens_is_told_by_the_shots(seen):
    assert seen.whole.field.source == "the shots"
    assert seen.whole.field.focal == pytest.approx(0.5 / np.tan(np.radians(31)), rel=0.05)


def test_coverage_grows_to_nearly_all_of_the_room(seen):
    early, late = seen.some.coverage(), seen.whole.coverage()
    assert 0.3 < early.share < 0.65
    assert late.share > 0.9
    assert late.weight[late.state != UNSEEN].sum() > 0.9
    assert (late.placed, late.left_out) == (48, 0)
    assert seen.some.next_by_hand().gain > 0.01 > seen.whole.next_by_hand().gain
    assert seen.whole.panorama(60).shape == (60, 120, 3)


# ---- the object moves


@pytest.mark.parametrize(("right", "down"), [(2.0, 0.0), (-2.0, 3.0), (14.0, -9.0)])
def test_an_object_that_moved_stops_the_session(seen, tmp_path, right, down):
    (found,) = of_kind(next_shot(seen, tmp_path, broken.moved(seen.mask, right, down)), "moved")
    assert found.severity is Severity.STOP
    assert found.value == pytest.approx(np.hypot(right, down), abs=0.4)
    assert ("right" if right > 0 else "left") in found.seen


def test_an_object_that_moved_by_a_pixel_is_warned_of(seen, tmp_path):
    (found,) = of_kind(next_shot(seen, tmp_path, broken.moved(seen.mask, 0.0, 1.0)), "moved")
    assert found.severity is Severity.WARNING
    assert found.value == pytest.approx(1.0, abs=0.3)
    assert "down" in found.seen


def test_a_quarter_of_a_pixel_is_no_movement(seen, tmp_path):
    assert not of_kind(next_shot(seen, tmp_path, broken.moved(seen.mask, 0.25, 0.0)), "moved")


def test_an_object_that_stays_away_is_not_got_used_to(seen, tmp_path):
    watch = copy.deepcopy(seen.few)
    for number in range(FEW, FEW + 3):
        files = list(seen.shots[number].files)
        files = broken.rewritten(files, tmp_path / f"{number}", broken.moved(seen.mask, 2.0, 0.0))
        (found,) = of_kind(watch.add(f"{number}", files), "moved")
        assert found.value == pytest.approx(2.0, abs=0.3)
    back = seen.shots[FEW + 3]
    assert watch.add(back.name, back.files) == ()


def test_an_object_gone_stops_the_session(seen, tmp_path):
    gone = broken.moved(seen.mask, 400.0, 0.0)
    (found,) = of_kind(next_shot(seen, tmp_path, gone), "moved")
    assert found.severity is Severity.STOP
    assert "fell" in found.seen


def test_an_object_that_moved_before_it_was_known_is_found_in_hindsight(seen, tmp_path):
    watch, found = ShotChecker(), list[Finding]()
    for number, shot in enumerate(seen.shots[:8]):
        files = list(shot.files)
        if number == 3:
            files = broken.rewritten(files, tmp_path / "moved", broken.moved(seen.mask, 3.0, 0.0))
        found += watch.add(shot.name, files)
    assert [one.shot for one in of_kind(found, "moved")] == [seen.shots[3].name]


# ---- blur


def test_an_object_out_of_focus_is_told_from_a_room_that_moved(seen, tmp_path):
    blurred = broken.within(seen.mask, broken.out_of_focus(2.0))
    (found,) = of_kind(next_shot(seen, tmp_path, blurred), "blur")
    assert found.seen.startswith("the object's edges")
    assert found.unit == "px"


def test_a_room_that_moved_is_told_with_its_direction(seen, tmp_path):
    swept = broken.within(~seen.mask, broken.swept(10))
    (found,) = of_kind(next_shot(seen, tmp_path, swept), "blur")
    assert found.seen.startswith("the room's edges")
    assert "horizontal" in found.seen


def test_blur_is_not_taken_for_movement(seen, tmp_path):
    everything = np.ones_like(seen.mask)
    found = next_shot(seen, tmp_path, broken.within(everything, broken.out_of_focus(2.5)))
    assert {one.kind for one in found} == {"blur"}


# ---- exposure


def test_a_view_clipped_in_every_exposure_is_told_with_a_shorter_bracket(seen, tmp_path):
    everything = np.ones_like(seen.mask)
    found = of_kind(next_shot(seen, tmp_path, broken.within(everything, broken.brighter(2000.0))), "exposure")
    assert found
    assert all(one.severity is not Severity.NOTE for one in found)
    assert "middle exposure by -" in found[0].remedy


def test_a_clipped_object_is_warned_of_and_a_clipped_lamp_is_not(seen, tmp_path):
    part = seen.mask.copy()
    part[: np.nonzero(part)[0].mean().astype(int)] = False
    found = of_kind(next_shot(seen, tmp_path, broken.within(part, broken.brighter(200.0))), "exposure")
    assert any("of the object is clipped" in one.seen for one in found)
    lamp = np.zeros_like(seen.mask)
    lamp[10:22, 10:24] = True
    assert not next_shot(seen, tmp_path / "lamp", broken.within(lamp, broken.brighter(500.0)))


def test_a_lens_cap_stops_the_session(seen, tmp_path):
    everything = np.ones_like(seen.mask)
    found = of_kind(next_shot(seen, tmp_path, broken.within(everything, broken.brighter(1e-5))), "exposure")
    assert [one.severity for one in found] == [Severity.STOP]
    assert "lens cap" in found[0].seen


# ---- overlap


def test_a_bare_wall_warns_of_overlap_and_not_of_blur(seen, tmp_path):
    def bare(channel: np.ndarray) -> np.ndarray:
        level = float(np.median(channel))
        noise = np.random.default_rng(0).standard_normal(channel.shape).astype(np.float32)
        return level + noise * np.sqrt(max(0.3 * level, 1.0))

    found = next_shot(seen, tmp_path, broken.within(~seen.mask, bare))
    assert [one.kind for one in found] == ["overlap"]
    assert "bare wall" in found[0].remedy


def test_a_leap_is_warned_of_and_left_out_of_the_coverage(seen):
    watch = copy.deepcopy(seen.some)
    far = seen.shots[46]  # the ceiling, after twenty shots of the floor
    (found,) = of_kind(watch.add(far.name, far.files), "overlap")
    assert found.value < 15
    assert "half-way" in found.remedy
    assert watch.coverage().left_out == 1


# ---- files


def test_a_damaged_file_is_told_and_the_session_goes_on(seen, tmp_path):
    watch = copy.deepcopy(seen.some)
    half = tmp_path / "half.dng"
    half.write_bytes(seen.shots[BEFORE].files[0].read_bytes()[:50_000])
    (found,) = watch.add("half", [half, *seen.shots[BEFORE].files[1:]])
    assert (found.kind, found.severity) == ("unreadable", Severity.STOP)
    assert "cut off" in found.seen
    shot = seen.shots[BEFORE]
    assert watch.add(shot.name, shot.files) == ()
    assert len(watch.names) == BEFORE + 1


def test_photographs_of_another_size_are_refused(seen, tmp_path):
    small = tmp_path / "small.dng"
    broken.write(small, np.full((64, 96), 2000, np.uint16), 0.01)
    (found,) = copy.deepcopy(seen.some).add("small", [small])
    assert (found.kind, found.severity) == ("unreadable", Severity.STOP)
    assert "96 x 64" in found.seen


def test_nothing_is_known_before_the_first_shot():
    watch = ShotChecker()
    assert watch.coverage() is None
    assert watch.panorama() is None
    assert watch.next_by_hand() is None
    assert watch.order([(0.0, 0.0)]) is None


# ---- a camera held another way up


def held(seen, tmp_path, tag: int) -> ShotChecker:
    """Three shots of a session whose files say so."""
    watch = ShotChecker()
    for number, shot in enumerate(seen.shots[:3]):
        place = tmp_path / f"{tag}-{number}"
        place.mkdir()
        files = [Path(shutil.copy(file, place)) for file in shot.files]
        if tag != 1:
            folders.tag(files, tag)
        watch.add(shot.name, files)
    return watch


def test_the_panorama_of_a_camera_upside_down_stands_upright(seen, tmp_path):
    """What was above the sensor was below the camera."""
    level, hanging = (held(seen, tmp_path, tag) for tag in (1, 3))
    before, after = level.panorama(60).astype(int), hanging.panorama(60).astype(int)
    assert np.abs(after - before[::-1, ::-1]).mean() < 0.2 * np.abs(after - before).mean()
    assert hanging.coverage().share == level.coverage().share
