"""Values tell of their changes, errors come apart into cause and remedy, folders are known for what they are."""

from pathlib import Path

from app.state import Device, State, Trouble, Watched, place_of, trouble


def test_a_value_tells_changes_and_nothing_else() -> None:
    heard: list[int] = []
    value = Watched(1)
    leave = value.listen(heard.append)
    value.set(1)
    value.set(2)
    leave()
    leave()
    value.set(3)
    assert heard == [2]
    assert value.value == 3


def test_a_listener_may_leave_while_it_hears() -> None:
    value = Watched(0)
    heard: list[str] = []
    leave = value.listen(lambda now: (heard.append("first"), leave()))
    value.listen(lambda now: heard.append("second"))
    value.set(1)
    value.set(2)
    assert heard == ["first", "second", "second"]


def test_an_error_comes_apart_at_its_first_semicolon() -> None:
    assert trouble("a.dng: is cut off; copy it again; or leave it out", "trace") == Trouble(
        "a.dng: is cut off", "copy it again; or leave it out", "trace"
    )
    assert trouble("no remedy\nknown") == Trouble("no remedy known")


def test_a_folder_is_a_session_photographs_or_nothing(tmp_path: Path) -> None:
    session = tmp_path / "out" / "session"
    (session / "shots").mkdir(parents=True)
    (session / "session.json").write_text("{}")
    photographs = tmp_path / "renders"
    photographs.mkdir()
    (photographs / "0001.exr").write_text("")
    assert place_of(session).kind == "session"
    assert place_of(session / "session.json").folder == session
    assert place_of(tmp_path / "out").folder == session
    assert place_of(session / "shots").kind == "photographs"
    assert (place_of(photographs).kind, place_of(photographs / "0001.exr").folder) == (
        "photographs",
        photographs,
    )
    assert place_of(tmp_path / "gone" / "far").kind == "nothing"


def test_a_device_replaces_what_was_shown_under_its_key() -> None:
    state = State()
    state.set_device(Device("rig", "turntable"))
    state.set_device(Device("camera", "EOS R8"))
    state.set_device(Device("rig", "offline", well=False))
    assert [device.told for device in state.devices.value] == ["EOS R8", "offline"]
    state.drop_device("camera")
    assert [device.key for device in state.devices.value] == ["rig"]
