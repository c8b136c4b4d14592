"""Settings never keep the window from opening: whatever is wrong with the file, defaults hold and it is said."""

from pathlib import Path

import pytest

from app import places
from app.settings import MOST_RECENT, Preferences, Settings


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "roomlight" / "settings.toml"


def test_what_was_changed_is_there_after_a_restart(path: Path) -> None:
    Settings(path).change(theme="light", recent=("/a", "/b"))
    again = Settings(path)
    assert (again.value.theme, again.value.recent, again.notice) == ("light", ("/a", "/b"), None)


def test_a_first_start_has_defaults_and_nothing_to_say(path: Path) -> None:
    settings = Settings(path)
    assert settings.value == Preferences()
    assert settings.notice is None


@pytest.mark.parametrize("content", [b"theme = ", b"\xff\xfe\x00", b"[[[["])
def test_a_damaged_file_is_set_aside_and_told(path: Path, content: bytes) -> None:
    path.parent.mkdir()
    path.write_bytes(content)
    settings = Settings(path)
    assert settings.value == Preferences()
    assert settings.notice is not None
    assert "damaged" in settings.notice.what
    assert path.with_name("settings.toml.damaged").read_bytes() == content
    settings.change(theme="dark")
    assert Settings(path).value.theme == "dark"


def test_one_wrong_entry_costs_that_entry_alone(path: Path) -> None:
    path.parent.mkdir()
    path.write_text('theme = "pink"\ndevice = "cpu"\nrecent = [1, 2]\nof_a_newer_version = true\n')
    settings = Settings(path)
    assert (settings.value.theme, settings.value.device, settings.value.recent) == ("system", "cpu", ())
    assert settings.notice is not None
    assert "recent, theme" in settings.notice.what
    assert "newer" not in settings.notice.what


@pytest.mark.parametrize("obstacle", ["file where the folder should be", "folder where the file should be"])
def test_a_place_that_cannot_be_used_is_told_once_and_settings_live_on(path: Path, obstacle: str) -> None:
    if obstacle.startswith("file"):
        path.parent.write_text("")
    else:
        path.mkdir(parents=True)
    settings = Settings(path)
    settings.change(theme="light")
    assert settings.value.theme == "light"
    assert settings.notice is not None
    settings.notice = None
    settings.change(theme="dark")
    assert settings.value.theme == "dark"
    assert settings.notice is None


def test_the_latest_session_comes_first_and_once(path: Path) -> None:
    settings = Settings(path)
    for number in range(MOST_RECENT + 3):
        settings.opened(Path(f"/s/{number}"))
    settings.opened(Path("/s/10"))
    assert settings.value.recent[0] == "/s/10"
    assert settings.value.recent.count("/s/10") == 1
    assert len(settings.value.recent) == MOST_RECENT
    settings.forget(Path("/s/10"))
    assert "/s/10" not in Settings(path).value.recent


def test_listeners_hear_of_a_change(path: Path) -> None:
    settings, heard = Settings(path), []
    settings.preferences.listen(heard.append)
    settings.change(device="cpu")
    settings.change(device="cpu")
    assert [preferences.device for preferences in heard] == ["cpu"]


def test_places_follow_the_desktop_specification(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/ada")
    monkeypatch.setenv("XDG_CONFIG_HOME", "/elsewhere")
    monkeypatch.setenv("XDG_STATE_HOME", "relative/is/ignored")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert places.config() == Path("/elsewhere/roomlight")
    assert places.state() == Path("/home/ada/.local/state/roomlight")
    assert places.cache() == Path("/home/ada/.cache/roomlight")
