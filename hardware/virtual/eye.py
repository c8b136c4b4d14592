"""Look at a scene in a thread of its own, so that whoever waits for the picture may give up.

A room is baked at the first look, which takes minutes, and a look takes seconds; neither can be broken off. What nobody
waits for any more is finished or, if it was not begun, left out.
"""

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from hardware.interfaces import Angles
from hardware.virtual.scenes import Picture, Scene

WAIT_S = 0.05  # how soon one who waits notices that he shall not


@dataclass(slots=True, eq=False)
class _Look:
    angles: Angles
    seed: int
    done: threading.Event = field(default_factory=threading.Event)
    given_up: bool = False
    picture: Picture | None = None
    error: BaseException | None = None


class Eye:
    """Makes its scene at the first look and keeps it; `close` ends the thread after the look under way."""

    def __init__(self, make: Callable[[], Scene]):
        self._make = make
        self._scene: Scene | None = None
        self._looks: queue.SimpleQueue[_Look | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def look(self, angles: Angles, seed: int, check: Callable[[], None]) -> Picture:
        """The scene's picture; `check` raises when it is no longer wanted.

        Raises:
            HardwareError: what the scene, or `check`, raises.
        """
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="virtual eye", daemon=True)
            self._thread.start()
        look = _Look(angles, seed)
        self._looks.put(look)
        try:
            while not look.done.wait(WAIT_S):
                check()
        except BaseException:
            look.given_up = True
            raise
        if look.picture is None:
            assert look.error is not None
            raise look.error
        return look.picture

    def close(self) -> None:
        self._looks.put(None)

    def _run(self) -> None:
        while (look := self._looks.get()) is not None:
            if look.given_up:
                continue
            try:
                if self._scene is None:
                    self._scene = self._make()
                look.picture = self._scene.look(look.angles, look.seed)
            except BaseException as error:  # whoever asked is told, in his own thread
                look.error = error
            look.done.set()
