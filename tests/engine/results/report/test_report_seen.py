"""The report in a browser without a screen: what a person would see is there, in a light and in a dark room."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from engine.results.report import report
from tests.engine.results.report.test_report import full

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
WIDTH, HEIGHT = 1100, 1500
LONG_S = 120  # a browser that starts on a busy machine

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed here")


def seen(page: Path, to: Path, dark: bool) -> np.ndarray:
    """What Chromium shows of a page's first screens, red, green, blue."""
    assert BROWSER is not None
    scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
    subprocess.run(
        [
            BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", *scheme,
            f"--user-data-dir={to.parent / 'profile'}", f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={to}",
            page.as_uri(),
        ],
        capture_output=True, check=True, timeout=LONG_S,
    )  # fmt: skip
    return np.asarray(Image.open(to).convert("RGB")).astype(int)


@pytest.mark.parametrize("dark", [False, True])
def test_a_browser_shows_words_and_pictures_on_ground_that_means_nothing(tmp_path: Path, dark: bool) -> None:
    page = tmp_path / "report.html"
    page.write_text(report.html(full()))
    shot = seen(page, tmp_path / "shot.png", dark)
    assert shot.shape == (HEIGHT, WIDTH, 3)
    ground = shot[2, 2]
    assert (ground.mean() < 60) == dark
    other = np.abs(shot - ground).max(-1) > 12
    assert 0.1 < other.mean() < 0.8  # neither blank nor painted over
    assert other[:300].any(1).sum() > 60  # the heading
    coloured = np.ptp(shot, axis=-1) > 60
    assert coloured.mean() > 0.02  # the maps
    # Maps stand on the page's own ground: nowhere is there a frame full of a colour map's end.
    blue = (shot[..., 2] > shot[..., 0] + 60) & (shot.sum(-1) < 300)
    assert blue.mean() < 0.01
