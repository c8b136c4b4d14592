"""`roomlight capture` and `roomlight rig` on the virtual rig: they work as they stand, and every fault is one line."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.capture.order import Pose, read
from app.capture.status import Missing
from app.capture.terminal import told_missing
from app.cli import main
from engine.io import session as sessions
from tests.app.calls import ROOT, command, refused

RIG, CAMERA = "virtual:grbl?speed=200", "virtual:?size=64x48"
ZABER = "virtual:zaber?speed=200&kind=turntable"


def captured(folder: Path) -> list[str]:
    shots = sessions.shots(sessions.open_session(folder))
    for shot in shots:
        sessions.verify(shot)
    return sorted(shot.name for shot in shots)


def capture(*words: object) -> int:
    return main(["capture", *map(str, words)])


def test_the_virtual_rig_and_camera_need_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a"
    assert capture("--rig", RIG, "--camera", CAMERA, "--poses", 4, "--bracket", "-2,0,2", folder) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[-2] == f"{folder}: 4 poses of 3 exposure(s), 64 x 48"
    assert told[-1] == f"next: roomlight process {folder}"
    assert captured(folder) == [f"pose{index:04d}" for index in range(4)]
    session = sessions.open_session(folder)
    assert session.facts["rig"]["kind"] == "gimbal"
    assert len(session.facts["rig"]["geometry"]["pan_axis"]) == 3
    wanted = read(folder)
    assert wanted.bracket.stops == (-2.0, 0.0, 2.0)
    for shot, pose in zip(sessions.shots(session), wanted.poses, strict=True):
        assert shot.rig is not None
        assert pose.angles is not None
        assert shot.rig["pan_deg"] == pytest.approx(pose.angles.pan_deg, abs=0.02)
        assert shot.rig["tilt_deg"] == pytest.approx(pose.angles.tilt_deg, abs=0.02)
    assert main(["process", str(folder), "--until", "hdr", "--device", "cpu"]) == 0
    assert capture("--resume", folder) == 0  # nothing left to do


def test_a_plan_file_and_a_turntable_are_warned_of_one_axis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "plan.csv"
    plan.write_text("pan_deg,tilt_deg,name\n0,0,front\n# as far as it goes\n90,0,side\n180,0,back\n")
    assert capture("--rig", ZABER, "--camera", CAMERA, "--plan", plan, "--bracket", "0", tmp_path / "a") == 0
    assert "all poses turn about one axis" in capsys.readouterr().out
    assert captured(tmp_path / "a") == ["pose0000", "pose0001", "pose0002"]
    assert [pose.label for pose in read(tmp_path / "a").poses] == ["front", "side", "back"]


def test_resume_takes_the_missing_poses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "a"
    assert capture("--rig", RIG, "--camera", CAMERA, "--poses", 4, folder) == 0
    (folder / "shots" / "0001" / "shot.json").unlink()
    assert capture("--resume", folder, "--rig", "virtual:zaber?speed=200") == 0
    assert captured(folder) == [f"pose{index:04d}" for index in range(4)]
    error = refused(capsys, "capture", "--resume", folder, "--poses", 5, "--bracket", "0")
    assert "--poses, --bracket with --resume: a capture goes on as it was begun" in error
    assert "no capture to resume" in refused(capsys, "capture", "--resume", tmp_path / "nothing")


def test_bad_input_is_one_line_and_leaves_no_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a"
    devices = ("--rig", RIG, "--camera", CAMERA)
    plan = tmp_path / "plan.csv"
    plan.write_text("pan_deg,tilt_deg\n10,0\n20,a lot\n")
    for told, words in (
        ("plan.csv, line 3: tilt_deg 'a lot' is no number", (*devices, "--plan", plan)),
        ("either --plan FILE or --poses N", devices),
        ("either --plan FILE or --poses N", (*devices, "--plan", plan, "--poses", 3)),
        ("which rig and which camera", ("--poses", 3)),
        ("possible are grbl:///dev/ttyUSB0", ("--rig", "sundial:", "--camera", CAMERA, "--poses", 3)),
        ("there is no such port", ("--rig", "grbl:///dev/ttyUSB77", "--camera", CAMERA, "--poses", 3)),
        ("no room called 'hell'", ("--rig", RIG, "--camera", "virtual:?room=hell", "--poses", 3)),
        ("0 poses", (*devices, "--poses", 0)),
        ("nowhere.toml: cannot be read", (*devices, "--poses", 3, "--geometry", tmp_path / "nowhere.toml")),
    ):
        assert told in refused(capsys, "capture", *words, folder), words
        assert not folder.exists()
    plan.write_text("pan_deg,tilt_deg\n10,0\n20,89\n")
    error = refused(capsys, "capture", *devices, "--plan", plan, folder)
    assert "pose 1 has tilt 89, beyond -75 to 75 degrees" in error
    folder.mkdir()
    (folder / "thesis.txt").write_text("years of work")
    assert "exists already" in refused(capsys, "capture", *devices, "--poses", 3, folder)


@pytest.mark.parametrize(
    "words", [("--bracket", "3,3"), ("--bracket", "-3;0"), ("--shutter", "1/0"), ("--poses", "many")]
)
def test_words_that_cannot_be_meant_are_usage_errors(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        capture("--rig", RIG, "--camera", CAMERA, *words, "a")
    assert ended.value.code == 2
    assert "usage:" in capsys.readouterr().err


def test_a_setting_the_camera_does_not_offer_names_it_and_resumes_nothing_by_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = refused(
        capsys, "capture", "--rig", RIG, "--camera", CAMERA, "--poses", 3, "--iso", 50, tmp_path / "a"
    )
    assert (
        "ISO 50 is not offered, only 100; 0 of 3 poses are kept: go on with `roomlight capture --resume"
        in error
    )


def test_a_disk_too_small_is_told_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "a"
    huge = "virtual:?size=9998x9998"
    error = refused(capsys, "capture", "--rig", RIG, "--camera", huge, "--poses", 9000, folder)
    assert re.search(r"27000 photographs of about 200 MB need 56\d\d\.\d+ GB, and .* GB are free", error)
    assert not folder.exists()


def _begun(folder: Path, *words: str) -> subprocess.Popen[str]:
    """A capture that has finished its first pose and is far from its end."""
    words = ("capture", "--rig", "virtual:grbl?speed=2", "--camera", CAMERA, "--poses", "40", str(folder))
    going = subprocess.Popen(
        [sys.executable, "-m", "app.cli", *words],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Begun in the background, tests ignore Ctrl-C, and what they begin would inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 60
    while not (folder / "shots" / "0000" / "shot.json").exists():
        assert going.poll() is None, going.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return going


@pytest.mark.parametrize(("number", "times"), [(signal.SIGINT, 1), (signal.SIGINT, 2), (signal.SIGTERM, 1)])
def test_a_signal_ends_it_and_says_how_to_go_on(tmp_path: Path, number: signal.Signals, times: int) -> None:
    folder = tmp_path / "a"
    going = _begun(folder)
    for _ in range(times):
        os.kill(going.pid, number)
        time.sleep(0.05)
    out, error = going.communicate(timeout=30)
    # A second Ctrl-C may find the capture ended, and meet the interpreter on its way out.
    assert going.returncode in (130, -signal.SIGINT) if times > 1 else going.returncode == 130, error
    kept = len(captured(folder))
    assert f"stopped; {kept} of 40 poses are kept: go on with `roomlight capture --resume {folder}`" in error
    assert "Traceback" not in error
    assert not (folder / "capture" / "incoming").exists()


def test_poses_that_are_missing_are_named_with_their_reason(tmp_path: Path) -> None:
    missing = tuple(Missing(Pose(index, None), "it would not focus") for index in range(7))
    told = told_missing(missing, 12, tmp_path)
    assert told.startswith("7 of 12 poses are missing (pose0000: it would not focus; pose0001")
    assert told.endswith(f"and 2 more); `roomlight capture --resume {tmp_path}` tries them again")


def test_a_rig_is_listed_asked_homed_and_moved(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rig", "list"]) == 0
    assert "virtual:" in capsys.readouterr().out
    assert main(["rig", "status", RIG]) == 0
    told = capsys.readouterr().out
    assert "pan   -5 to 365 degrees" in told
    assert "not homed" in told
    assert main(["rig", "home", RIG]) == 0
    assert "stands at pan" in capsys.readouterr().out
    assert main(["rig", "move", RIG, "--pan", "30", "--tilt", "-10"]) == 0
    told = capsys.readouterr().out
    assert "homing first" in told
    assert "stands at pan 30.000, tilt -10.000" in told
    assert "tilt" in refused(capsys, "rig", "move", RIG, "--tilt", 89)
    assert main(["rig", "stop", RIG]) == 0
    assert "stopped" in capsys.readouterr().out
    assert main(["rig", "status", "folder:."]) == 0
    assert "no such port" in refused(capsys, "rig", "status", "grbl:///dev/ttyUSB77")
    assert "no device URL" in refused(capsys, "rig", "home", "nonsense")


def test_help_names_both_commands() -> None:
    told = command("--help").stdout
    assert "capture" in told
    assert "rig" in told
