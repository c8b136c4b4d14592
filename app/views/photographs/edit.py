"""Undo of what is done to photographs."""

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


class TakeAgain(QUndoCommand):
    """A photograph put aside, so that its pose is taken again."""

    def __init__(self, text: str, apply: Callable[[bool], None]) -> None:
        super().__init__(text)
        self._apply = apply

    def undo(self) -> None:
        self._apply(False)

    def redo(self) -> None:
        self._apply(True)
