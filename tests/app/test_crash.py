"""A crash leaves a report on this machine, native ones too, and reports never pile up."""

import datetime
import subprocess
import sys
from pathlib import Path

from app import crash
from tests.app.calls import ROOT


def test_a_report_holds_the_traceback_and_the_versions(tmp_path: Path) -> None:
    try:
        raise ZeroDivisionError("half a bear")
    except ZeroDivisionError as error:
        text = crash.told(type(error), error, error.__traceback__)
    path = crash.keep(text, tmp_path)
    assert path is not None
    assert "half a bear" in path.read_text()
    assert "test_crash.py" in path.read_text()
    assert "PySide6-Essentials" in path.read_text()


def test_only_the_latest_reports_are_kept(tmp_path: Path) -> None:
    start = datetime.datetime(2024, 1, 1)
    for number in range(crash.MOST_KEPT + 5):
        crash.keep(str(number), tmp_path, start + datetime.timedelta(seconds=number))
    left = sorted(tmp_path.glob("crash-*.txt"))
    assert len(left) == crash.MOST_KEPT
    assert left[0].read_text() == "5"


def test_a_place_that_cannot_be_written_is_no_second_crash(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert crash.keep("text", tmp_path / "file" / "crashes") is None
    assert crash.watch(tmp_path / "file" / "crashes") == (None, None)


def test_a_native_crash_is_told_at_the_next_start(tmp_path: Path) -> None:
    code = f"from pathlib import Path; from app import crash; import os; kept = crash.watch(Path({str(tmp_path)!r})); os.abort()"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True)
    again = (
        f"from pathlib import Path; from app import crash; print(crash.watch(Path({str(tmp_path)!r}))[1]);"
        f"print(crash.watch(Path({str(tmp_path)!r}))[1])"
    )
    answer = subprocess.run(
        [sys.executable, "-c", again], cwd=ROOT, capture_output=True, text=True, check=True
    )
    report, second = answer.stdout.split()
    assert "Fatal Python error: Aborted" in Path(report).read_text()
    assert second == "None"
