"""The small picture of a view."""

from pathlib import Path

import numpy as np
import pytest

from app.viewer import photograph as photographs
from app.viewer.photograph import photograph
from engine.errors import SessionError
from engine.io import session as sessions
from tests.app.viewer import made


def test_a_photograph_is_that_of_its_view(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s", views=3)
    for view in range(3):
        shown = photograph(folder, view)
        assert shown.shape == (24, 24, 4)
        assert (shown[..., 3] == 255).all()
        assert shown[-1, -1, 0] > shown[0, 0, 0]  # it brightens downwards, as the view does
        assert shown[..., :3].max() == 255


def test_a_large_photograph_is_thinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(photographs, "LONGEST_PX", 10)
    shown = photograph(made.session(tmp_path / "s"), 1)
    assert shown.shape == (8, 8, 4)
    assert np.ptp(shown[..., 1].astype(int)) > 0


def test_a_photograph_that_is_not_there_is_told(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s", stages=("hdr",))
    with pytest.raises(SessionError, match="not number 9"):
        photograph(folder, 9)
    empty = made.session(tmp_path / "t", stages=())
    with pytest.raises(SessionError, match="not merged"):
        photograph(empty, 0)


def test_a_photograph_stands_upright(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s")
    before = photograph(folder, 1)
    opened = sessions.open_session(folder)
    sessions.describe(opened, {**opened.facts["camera"], "orientation": 5})
    np.testing.assert_array_equal(photograph(folder, 1), np.rot90(before))
