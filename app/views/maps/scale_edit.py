"""Undo of a scale that was given."""

from collections.abc import Callable

from PySide6.QtGui import QUndoCommand

from engine.io.scale_edit import ScaleBar


class ScaleEdit(QUndoCommand):
    """From one scale bar, or none, to another."""

    def __init__(
        self,
        text: str,
        before: ScaleBar | None,
        after: ScaleBar | None,
        apply: Callable[[ScaleBar | None], None],
    ) -> None:
        super().__init__(text)
        self._before, self._after, self._apply = before, after, apply

    def undo(self) -> None:
        self._apply(self._before)

    def redo(self) -> None:
        self._apply(self._after)
