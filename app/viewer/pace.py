"""How much to draw while the eye moves, so that it moves smoothly: learnt from how long pictures take."""

from dataclasses import dataclass

AIM_MS = 45.0
"""A picture at least this often, so that 15 a second are kept with room to spare."""
_CALM = 0.35  # how fast the estimate follows
_HOPE = 0.96


@dataclass(frozen=True, slots=True)
class Effort:
    """Which set of parts, and every how many pixels."""

    level: int
    divisor: int


EFFORTS = (Effort(0, 1), Effort(1, 1), Effort(1, 2), Effort(1, 3))
LEAST = len(EFFORTS) - 1


class Pace:
    """Chooses among EFFORTS. Within one movement it only ever draws less, so that pictures do not flicker.

    The first picture of an effort sends everything to the graphics card and tells nothing about the next one.
    """

    def __init__(self) -> None:
        self.forget()

    @property
    def effort(self) -> Effort:
        return EFFORTS[self._step]

    def still(self, milliseconds: float) -> None:
        """A full picture took so long; says where the next movement begins: with the most that is quick enough."""
        self._learn(0, milliseconds)
        # What was too slow once, perhaps because the machine was busy, is tried again by and by.
        self._known[1:] = [None if known is None else known * _HOPE for known in self._known[1:]]
        slow = [known is not None and known > AIM_MS for known in self._known]
        self._step = slow.index(False) if False in slow else LEAST

    def moved(self, milliseconds: float) -> None:
        """A picture of the present effort took so long."""
        self._learn(self._step, milliseconds)
        known = self._known[self._step]
        if known is not None and known > AIM_MS and self._step < LEAST:
            self._step += 1

    def forget(self) -> None:
        """What is drawn, or its size, has changed."""
        self._step = 0
        self._known: list[float | None] = [None] * len(EFFORTS)
        self._tried = [False] * len(EFFORTS)

    def _learn(self, step: int, milliseconds: float) -> None:
        if not self._tried[step]:
            self._tried[step] = True
            return
        before = self._known[step]
        self._known[step] = milliseconds if before is None else before + _CALM * (milliseconds - before)
