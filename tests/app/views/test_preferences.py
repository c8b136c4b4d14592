"""Preferences hold at once, and what is kept can be seen and cleared."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QFileDialog
from pytestqt.qtbot import QtBot

from app import caches, places
from app.settings import Settings
from app.views import theme
from app.views.main_window import MainWindow
from app.views.preferences import PreferencesDialog
from engine.errors import SessionError
from tests.app.calls import ROOT
from tests.app.views.conftest import until


@pytest.fixture
def dialog(window: MainWindow, qtbot: QtBot) -> PreferencesDialog:
    room = places.cache() / "studio" / "deep" / "booth.npz"
    room.parent.mkdir(parents=True)
    room.write_bytes(bytes(3_000_000))
    (action,) = [
        one
        for one in window.findChildren(type(window.menuBar().actions()[0]))
        if one.text() == "&Preferences…"
    ]
    action.trigger()
    (found,) = window.findChildren(PreferencesDialog)
    until(qtbot, lambda: found.sizes["bench"].text() == "empty")
    return found


def choose(box, data: str) -> None:
    box.setCurrentIndex(box.findData(data))
    box.activated.emit(box.currentIndex())


def test_theme_and_device_hold_at_once_and_later(
    dialog: PreferencesDialog, window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen: list[str] = []
    monkeypatch.setattr(theme, "choose", chosen.append)
    choose(dialog.theme, "light")
    choose(dialog.device, "cpu")
    assert chosen == ["light"]
    themes = [action for action in window.findChildren(QAction) if action.text() in theme.TITLES.values()]
    assert [action.text() for action in themes if action.isChecked()] == ["Light"]
    dialog.cores.setValue(1)
    dialog.folder.setText("/somewhere")
    dialog.folder.editingFinished.emit()
    for settings in (window.shell.settings, Settings()):
        assert (settings.value.theme, settings.value.device) == ("light", "cpu")
        assert (settings.value.cores, settings.place) == (1, Path("/somewhere"))
    there = os.sched_getaffinity(0)
    script = "import os\nfrom app import cores\n"
    script += "from app.settings import Settings; cores.hold_to(Settings().value.cores); print(os.sched_getaffinity(0))"
    answer = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == str({max(there)})


def test_what_is_kept_is_told_and_can_be_cleared(dialog: PreferencesDialog, qtbot: QtBot) -> None:
    assert dialog.sizes["studio"].text() == "3 MB"
    assert not dialog.clear["bench"].isEnabled()
    qtbot.mouseClick(dialog.clear["studio"], Qt.MouseButton.LeftButton)
    until(qtbot, lambda: dialog.sizes["studio"].text() == "empty")
    assert not (places.cache() / "studio").exists()


def test_the_cache_moves_as_a_whole_and_comes_back(
    dialog: PreferencesDialog, qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual, elsewhere = places.cache(), tmp_path / "disk"
    elsewhere.mkdir()
    for to, place in ((elsewhere, elsewhere / "roomlight"), (usual.parent, usual)):
        monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *words, to=to: str(to))
        dialog.elsewhere.click()
        until(qtbot, lambda place=place: dialog.place.text() == str(place) and dialog.elsewhere.isEnabled())
        assert places.cache().resolve() == place
        assert (usual / "studio" / "deep" / "booth.npz").stat().st_size == 3_000_000
    assert not any(elsewhere.iterdir())
    (elsewhere / "roomlight").mkdir()
    with pytest.raises(SessionError, match="already"):
        caches.move(elsewhere)
    assert caches.sizes()["studio"] == 3_000_000


def test_a_disk_that_refuses_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*words: Path, **named: bool) -> None:
        raise PermissionError(13, "Permission denied")

    (places.cache() / "studio").mkdir(parents=True)
    monkeypatch.setattr(caches.shutil, "rmtree", refuse)
    with pytest.raises(SessionError, match="studio"):
        caches.clear("studio")
    caches.clear("bench")  # is not there
    monkeypatch.setattr(caches.shutil, "move", refuse)
    monkeypatch.setattr(caches.shutil, "rmtree", lambda *words, **named: None)
    with pytest.raises(SessionError, match="disk"):
        caches.move(tmp_path / "disk")
    assert (places.cache() / "studio").is_dir()
