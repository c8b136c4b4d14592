"""Undo of leaving photographs out."""

from collections.abc import Callable

from PySide6.QtGui import QUndoCommand


class LeaveOut(QUndoCommand):
    """From one set of photographs left out to another, by name."""

    def __init__(
        self,
        text: str,
        before: frozenset[str],
        after: frozenset[str],
        apply: Callable[[frozenset[str]], None],
    ) -> None:
        super().__init__(text)
        self._before, self._after, self._apply = before, after, apply

    def undo(self) -> None:
        self._apply(self._before)

    def redo(self) -> None:
        self._apply(self._after)
