"""Undo of a value that became another."""

from collections.abc import Callable
from typing import Generic, TypeVar

from PySide6.QtGui import QUndoCommand

Value = TypeVar("Value")


class ValueEdit(QUndoCommand, Generic[Value]):
    """From one value to another; `apply` puts either into force."""

    def __init__(self, text: str, before: Value, after: Value, apply: Callable[[Value], None]) -> None:
        super().__init__(text)
        self.before, self.after, self._apply = before, after, apply

    def undo(self) -> None:
        self._apply(self.before)

    def redo(self) -> None:
        self._apply(self.after)
