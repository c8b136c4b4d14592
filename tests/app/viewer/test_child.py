"""The drawing process: its inbox, its answers, and the whole of it with a real renderer."""

import io
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from app.viewer import protocol
from app.viewer.child import Inbox, Service
from app.viewer.frames import FrameReader
from app.viewer.orbit import Orbit
from tests.app.viewer import made
from tests.app.viewer.fake_canvas import FakeCanvas

ROOT = Path(__file__).parents[3]
EYE = Orbit((0.0, 0.0, 0.0), 3.0, 0.4, 0.2)


def look(number: int, moving: bool = True, style: protocol.Style = protocol.Style()) -> protocol.Look:  # noqa: B008
    return protocol.Look(number, EYE, 40, 30, moving, style)


def test_of_several_looks_only_the_newest_is_taken_and_after_the_rest() -> None:
    inbox = Inbox(io.BytesIO())
    for message in (look(1), protocol.Ping(1), look(2), protocol.Load("/x"), look(3)):
        inbox.put(message)
    taken = [inbox.take(wait=False) for _ in range(4)]
    assert taken == [protocol.Ping(1), protocol.Load("/x"), look(3), None]


def test_waiting_for_a_message_ends_with_the_next_one() -> None:
    inbox = Inbox(io.BytesIO())
    threading.Timer(0.05, lambda: inbox.put(protocol.Ping(9))).start()
    assert inbox.take(wait=True) == protocol.Ping(9)


class Talk:
    """A service without a process: messages in, answers out."""

    def __init__(self) -> None:
        self.stream = io.BytesIO()
        self.service = Service(FakeCanvas(), self.stream)
        self.reader = FrameReader(40 * 30 * 4)

    def __call__(self, *messages: object) -> list[object]:
        self.stream.seek(0)
        self.stream.truncate()
        for message in messages:
            self.service.handle(message)
        while self.service.busy:
            self.service.step()
        return [protocol.decode(line) for line in self.stream.getvalue().splitlines()]

    def begin(self, folder: Path) -> list[object]:
        return self(protocol.Memory(self.reader.name, self.reader.slot_bytes), protocol.Load(str(folder)))


@pytest.fixture
def talk():
    one = Talk()
    yield one
    one.reader.close()


def test_a_session_is_loaded_with_signs_of_life(talk: Talk, tmp_path: Path) -> None:
    *notes, loaded = talk.begin(made.session(tmp_path / "s"))
    assert notes
    assert all(isinstance(note, protocol.Note) for note in notes)
    assert isinstance(loaded, protocol.Loaded)
    assert loaded.contents.emitters == 400


def test_a_wish_is_answered_with_a_picture_in_the_memory(talk: Talk, tmp_path: Path) -> None:
    talk.begin(made.session(tmp_path / "s"))
    (frame,) = talk(look(5))
    assert isinstance(frame, protocol.Frame)
    assert (frame.number, frame.width, frame.height, frame.last) == (5, 40, 30, True)
    pixels = talk.reader.copy(frame.slot, frame.stamp, 4800)
    assert pixels is not None
    assert np.ptp(np.frombuffer(pixels, np.uint8)) > 50


def test_at_rest_pictures_come_until_the_last(talk: Talk, tmp_path: Path) -> None:
    talk.begin(made.session(tmp_path / "s"))
    frames = talk(look(6, moving=False))
    assert [frame.last for frame in frames if isinstance(frame, protocol.Frame)] == [
        False,
        False,
        False,
        True,
    ]


def test_a_damaged_session_is_refused_and_the_service_lives(talk: Talk, tmp_path: Path) -> None:
    (*_, refused) = talk.begin(tmp_path)
    assert isinstance(refused, protocol.Refused)
    assert "not a session" in refused.reason
    assert talk(protocol.Ping(3)) == [protocol.Pong(3)]


def test_a_probe_is_answered(talk: Talk, tmp_path: Path) -> None:
    talk.begin(made.session(tmp_path / "s"))
    talk(look(1))
    (probed,) = talk(protocol.Probe(2, 0.1, 0.5))
    assert isinstance(probed, protocol.Probed)
    assert len(probed.point) == 3


def test_a_painted_layer_joins_the_surfaces(talk: Talk, tmp_path: Path) -> None:
    talk.begin(made.session(tmp_path / "s"))
    np.save(tmp_path / "relit.npy", np.full((24, 24, 3), 0.5, np.float32))
    (loaded,) = talk(protocol.Paint("relit", str(tmp_path / "relit.npy")))
    assert isinstance(loaded, protocol.Loaded)
    assert loaded.contents.surfaces[-1] == "relit"


@pytest.mark.parametrize("shape", [(3, 3, 3), None])
def test_a_layer_that_does_not_fit_is_said(talk: Talk, tmp_path: Path, shape: tuple[int, ...] | None) -> None:
    talk.begin(made.session(tmp_path / "s"))
    if shape is not None:
        np.save(tmp_path / "relit.npy", np.zeros(shape))
    (note,) = talk(protocol.Paint("relit", str(tmp_path / "relit.npy")))
    assert isinstance(note, protocol.Note)
    assert "stays as it was" in note.text


def test_the_process_draws_a_session_and_ends_with_its_window(tmp_path: Path) -> None:
    folder = made.session(tmp_path / "s")
    environment = {
        key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")
    }
    child = subprocess.Popen(
        [sys.executable, "-m", "app.viewer.child", "--renderer", "opengl"], cwd=ROOT,
        env={**environment, "PYTHONPATH": str(ROOT)}, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    reader = FrameReader(160 * 120 * 4)
    try:
        assert child.stdin is not None
        assert child.stdout is not None
        heard = iter(protocol.decode(line) for line in child.stdout)  # every line is a message
        first = next(message for message in heard if isinstance(message, protocol.Ready | protocol.Unable))
        if isinstance(first, protocol.Unable):
            pytest.skip("no OpenGL on this machine")
        wish = protocol.Look(1, EYE, 160, 120, True, protocol.Style(emitters="ellipsoids"))
        for message in (protocol.Memory(reader.name, reader.slot_bytes), protocol.Load(str(folder)), wish):
            child.stdin.write(protocol.encode(message))
        child.stdin.flush()
        frame = next(message for message in heard if isinstance(message, protocol.Frame))
        pixels = reader.copy(frame.slot, frame.stamp, frame.width * frame.height * 4)
        assert pixels is not None
        picture = np.frombuffer(pixels, np.uint8).reshape(frame.height, frame.width, 4)
        assert len(np.unique(picture[..., :3].reshape(-1, 3), axis=0)) > 300  # not blank
        child.stdin.close()
        assert child.wait(60) == 0
    finally:
        child.kill()
        child.wait()
        reader.close()
