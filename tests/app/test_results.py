"""The report of a session whose camera was held on its side."""

import base64
import re
from pathlib import Path

import cv2
import numpy as np

from app import results
from engine import importing
from engine.io import session as sessions
from engine.pipeline import run, stage_table
from engine.pipeline.settings import Settings
from tests.app.sessions import small
from tests.engine import folders


def pictures(page: Path) -> list[np.ndarray]:
    coded = re.findall(r"data:image/jpeg;base64,([^\"]+)", page.read_text())
    return [cv2.imdecode(np.frombuffer(base64.b64decode(one), np.uint8), 1).astype(int) for one in coded]


def test_the_reports_photograph_stands_upright(tmp_path: Path) -> None:
    session = small(tmp_path)
    opened = sessions.open_session(session)
    run.process(opened, stage_table.stages(), Settings(), "cpu", "hdr")
    (before,) = pictures(results.write_report(session, tmp_path / "before.html"))
    sessions.describe(opened, {**opened.facts["camera"], "orientation": 6})
    (after,) = pictures(results.write_report(session, tmp_path / "after.html"))
    assert np.abs(after - np.rot90(before, -1)).mean() < 0.3 * np.abs(before - before.mean((0, 1))).mean()


def test_what_was_taken_at_the_import_is_among_what_to_be_careful_about(tmp_path: Path) -> None:
    raw = folders.write_raw(tmp_path / "card")
    folders.tag(sorted(raw.iterdir())[3:], 3)
    importing.make_session(raw, tmp_path / "s", mask=folders.write_mask(tmp_path / "m.png"))
    told = " ".join(results.cautions(tmp_path / "s"))
    assert "The mask was taken as of upright pictures and turned by 180 degrees" in told
    assert "Orientation tags of 3 of 24 photographs differ" in told
