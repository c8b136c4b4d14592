"""Without a screen the window says so, and what to do instead."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from app.views import screen
from app.views.screen import NoScreen, need_screen

SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there always is one")
def test_no_screen_is_one_line_and_exit_code_2() -> None:
    bare = {name: value for name, value in os.environ.items() if name not in SCREENS}
    words = [sys.executable, "-m", "app.cli", "gui"]
    root = Path(__file__).parents[3]
    answer = subprocess.run(words, cwd=root, env=bare, capture_output=True, text=True, timeout=120)
    assert answer.returncode == 2
    assert answer.stderr.count("\n") == 1
    assert "DISPLAY" in answer.stderr
    assert "roomlight process" in answer.stderr


@pytest.mark.parametrize("name", SCREENS)
def test_any_screen_will_do(name: str) -> None:
    need_screen("linux", {name: "x"})
    need_screen("darwin", {})
    with pytest.raises(NoScreen):
        need_screen("linux", {name: ""})


def test_a_display_that_nobody_answers_for_is_no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_UNIX) as server, socket.socket() as far:
        server.bind("\0/tmp/.X11-unix/X47011")
        server.listen()
        need_screen("linux", {"DISPLAY": ":47011.0"})
        far.bind(("127.0.0.1", 0))
        far.listen()
        monkeypatch.setattr(screen, "FIRST_PORT", far.getsockname()[1] - 10)
        need_screen("linux", {"DISPLAY": "127.0.0.1:10.0"})
    for gone in (":47011.0", "127.0.0.1:10.0"):
        with pytest.raises(NoScreen, match=f"nothing answers for DISPLAY={gone}"):
            need_screen("linux", {"DISPLAY": gone})
        need_screen("linux", {"DISPLAY": gone, "WAYLAND_DISPLAY": "wayland-0"})
