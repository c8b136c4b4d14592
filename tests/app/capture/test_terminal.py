"""A capture in the terminal: nobody may be there to decide, so that it says what is urgent and goes on."""

from pathlib import Path

import pytest

from app.capture.run import Capture
from app.capture.status import Finding
from app.capture.terminal import Screen
from engine.capture_checks.finding import Severity
from engine.io.session import Shot
from tests.app.capture import quick_devices
from tests.app.capture.captures import HASTY, order


def test_what_is_urgent_is_marked_and_ends_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def watch(shot: Shot) -> list[Finding]:
        severity = Severity.STOP if shot.name == "pose0001" else Severity.NOTE
        return [Finding(shot.name, "look", severity)]

    screen = Screen()
    capture = Capture(
        tmp_path / "a", order(3), quick_devices.rig, watch=watch, listener=screen.heard, patience=HASTY
    )
    assert screen.run(capture, tmp_path / "a").taken == 3
    told = capsys.readouterr().out
    assert "STOP: pose0001: look" in told
    assert "STOP: pose0002" not in told
    assert "pose0002: look" in told
