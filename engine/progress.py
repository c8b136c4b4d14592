"""How long work tells how far it is, and hears that it should stop.

A stage receives one `Progress` and calls `step` at each natural pause. `step` raises `Cancelled` when a
stop was asked for, so no stage needs a second channel.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from engine.errors import Cancelled


@dataclass(slots=True)
class Progress:
    """Reports a fraction in [0, 1] with a short note; silent unless given a listener.

    `begin` and `span` map the stage's own 0..1 onto a part of a longer job. Who wants to see what is there so far gives a
    `viewer`; it gets a function that makes it, and calls that at once or not at all.
    """

    listener: Callable[[float, str], None] = field(default=lambda fraction, note: None)
    cancelled: Callable[[], bool] = field(default=lambda: False)
    begin: float | int = 0.0
    span: float | int = 1.0
    viewer: Callable[[Callable[[], Any]], None] = field(default=lambda make: None)

    def step(self, fraction: float | int, note: str = "") -> None:
        """Say that `fraction` of this job is done.

        Raises:
            Cancelled: a stop was asked for.
        """
        if self.cancelled():
            raise Cancelled("stopped on request; finished stages are kept and the next run resumes")
        self.listener(self.begin + self.span * min(max(fraction, 0.0), 1.0), note)

    def part(self, begin: float | int, end: float | int) -> "Progress":
        """A `Progress` whose 0..1 fills `begin`..`end` of this one."""
        return Progress(
            self.listener,
            self.cancelled,
            self.begin + self.span * begin,
            self.span * (end - begin),
            self.viewer,
        )

    def parts(self, count: int) -> list["Progress"]:
        """This one cut into so many equal parts."""
        return [self.part(k / count, (k + 1) / count) for k in range(count)]
