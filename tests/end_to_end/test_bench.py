"""`roomlight bench chart --quick` on real sets with real solvers, held against a committed record."""

import json
import subprocess
import sys
from pathlib import Path

from tests.end_to_end.bundled import ROOT

BASELINE = ROOT / "tests" / "bench" / "quick.json"


def test_ours_beats_the_reference_and_no_accuracy_got_worse(tmp_path: Path):
    record = json.loads(BASELINE.read_text())
    # Whatever else this machine does at the time makes ratios of times worthless.
    record["metrics"] = [metric for metric in record["metrics"] if metric["unit"] != "x"]
    (tmp_path / "accuracies.json").write_text(json.dumps(record))
    words = ["bench", "chart", "--quick", "--sets", tmp_path / "sets", "--out", tmp_path / "chart"]
    done = subprocess.run(
        [sys.executable, "-m", "app.cli", *map(str, words), "--gate", str(tmp_path / "accuracies.json")],
        capture_output=True, text=True, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]
    assert f"gate: 0 of {len(record['metrics'])} metrics got worse" in done.stderr
    assert (tmp_path / "chart" / "chart.svg").stat().st_size > 10_000
