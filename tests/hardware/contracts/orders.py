"""Orders in threads of their own, and waiting for what should take a moment."""

import threading
import time
from collections.abc import Callable

from hardware.errors import HardwareError

PATIENCE_S = 30.0  # for what should take a moment; only a fault ever waits this long


class Order(threading.Thread):
    """One order in a thread of its own; `outcome` is what it returned or raised."""

    def __init__(self, order: Callable[[], object]):
        super().__init__(daemon=True)
        self._order = order
        self.outcome: object = None
        self.start()

    def run(self) -> None:
        try:
            self.outcome = self._order()
        except HardwareError as error:
            self.outcome = error

    def finished(self) -> object:
        self.join(PATIENCE_S)
        assert not self.is_alive(), "the order never came back"
        return self.outcome


def wait(what: Callable[[], bool], message: str) -> None:
    end = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < end, message
        time.sleep(0.005)
