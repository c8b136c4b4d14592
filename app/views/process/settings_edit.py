"""An edit of a session's parameters that can be undone."""

from collections.abc import Callable

from PySide6.QtGui import QUndoCommand

from app.views.value_edit import ValueEdit
from engine.pipeline.settings import Settings


class SettingsEdit(ValueEdit[Settings]):
    """Settings before and after; edits of the same thing in a row become one."""

    def __init__(
        self, text: str, what: str, before: Settings, after: Settings, apply: Callable[[Settings], None]
    ) -> None:
        super().__init__(text, before, after, apply)
        self.what = what

    def id(self) -> int:
        return 1

    def mergeWith(self, other: QUndoCommand) -> bool:
        if not isinstance(other, SettingsEdit) or other.what != self.what:
            return False
        self.after = other.after
        self.setText(other.text())
        self.setObsolete(self.after == self.before)
        return True
