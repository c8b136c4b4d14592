"""Stands turned by hand for the promises of `Motion`: a person who answers at once, but takes 1.5 s for the far place."""

import contextlib
import threading
from collections.abc import Iterator

from hardware.interfaces import Angles
from hardware.manual import Manual, Request
from tests.hardware.contracts.motion import Made

SLOW_S = 1.5
FAR = Angles(90.0)


def manual() -> contextlib.AbstractContextManager[Made]:
    """A stand that only turns."""
    return _made(None, ())


def manual_tilting() -> contextlib.AbstractContextManager[Made]:
    """A stand that tilts too."""
    return _made((-30.0, 40.0), (Angles(0.0, 40.1), Angles(0.0, -30.1)))


@contextlib.contextmanager
def _made(tilt_deg: tuple[float, float] | None, beyond: tuple[Angles, ...]) -> Iterator[Made]:
    heard: list[str] = []

    def person(request: Request) -> None:
        heard.append(request.text)
        if request.angles == FAR:
            threading.Timer(SLOW_S, request.confirm).start()
        else:
            request.confirm()

    rig = Manual(person, tilt_deg)
    yield Made(rig, Angles(10.0), FAR, beyond, sent=lambda: " ".join(heard).encode())
    rig.close()
