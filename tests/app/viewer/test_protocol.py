"""Messages read back as they were written, and nonsense is refused by name."""

import json

import pytest

from app.viewer import protocol
from app.viewer.orbit import Orbit

CONTENTS = protocol.Contents(
    "/a b",
    "m",
    ("one", "zwei ß"),
    ((1.0,) * 12, ()),
    legends={"confidence": protocol.Legend("magma", 0.0, 2.0, "°")},
    missing=("surface",),
)
EVERY = (
    protocol.Memory("shm", 12),
    protocol.Load("/a b"),
    protocol.Probe(1, 0.5, 0.25),
    protocol.Paint("relit", "/x.npy"),
    protocol.Ping(3),
    protocol.Ready("OpenGL"),
    protocol.Look(
        7, Orbit((1.0, 2.0, 3.0), 0.5, roll=0.1), 80, 60, True, protocol.Style(("surface",), exposure_ev=-1.5)
    ),
    protocol.Unable("no", "yes"),
    protocol.Note("reading"),
    protocol.Loaded(CONTENTS),
    protocol.Refused("why"),
    protocol.Frame(7, 1, 2, 80, 60, 9, True, 12.5),
    protocol.Probed(1, (1.0, 2.0, 3.0)),
    protocol.Probed(2, ()),
    protocol.Pong(3),
)


@pytest.mark.parametrize("message", EVERY, ids=lambda message: type(message).__name__)
def test_every_message_reads_back_as_it_was(message: object) -> None:
    line = protocol.encode(message)
    assert line.endswith(b"\n")
    assert line.count(b"\n") == 1
    assert protocol.decode(line) == message


def test_wishes_fit_a_pipe_at_once() -> None:
    """POSIX writes up to 4096 bytes whole or not at all: the window need never wait for the child to read."""
    longest = protocol.Look(
        10**9, Orbit((1 / 3,) * 3, 1 / 3, *(1 / 3,) * 2), 9999, 9999, True, protocol.Style(protocol.LAYERS)
    )
    assert len(protocol.encode(longest)) < 4096
    assert len(protocol.encode(protocol.Load("x" * 3000))) < 4096


@pytest.mark.parametrize(
    "line",
    [b"", b"[Open3D INFO] hello\n", b"{}", b"[]", b'"x"', json.dumps({"is": "nobody", "what": {}}).encode(),
     b'{"is":"ping","what":{}}', b'{"is":"ping","what":3}', b"\xff\xfe"],
)  # fmt: skip
def test_what_is_no_message_is_refused(line: bytes) -> None:
    with pytest.raises(protocol.ProtocolError):
        protocol.decode(line)
