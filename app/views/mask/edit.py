"""One change of the strokes on the undo stack."""

from collections.abc import Callable

from PySide6.QtGui import QUndoCommand

from app.masking import Patch


class MaskEdit(QUndoCommand):
    """A stroke, a polygon, a clearing: made already when it is pushed."""

    def __init__(self, text: str, patch: Patch, apply: Callable[[Patch, bool], None]) -> None:
        super().__init__(text)
        self._patch, self._apply, self._made = patch, apply, True

    def redo(self) -> None:
        if not self._made:
            self._apply(self._patch, False)
        self._made = False

    def undo(self) -> None:
        self._apply(self._patch, True)
