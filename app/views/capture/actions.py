"""What can be done on the Capture page by key: each action with its words and its shortcut."""

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QCoreApplication
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QWidget


@dataclass(frozen=True, slots=True)
class Intents:
    """What the page does when it is asked to."""

    start: Callable[[], None]
    pause: Callable[[], None]  # or go on
    end: Callable[[], None]
    stop: Callable[[], None]
    answer: Callable[[], None]


@dataclass(frozen=True, slots=True)
class Actions:
    """They hold wherever the focus is while the page is shown."""

    start: QAction
    pause: QAction
    end: QAction
    stop: QAction
    answer: QAction
    clipping: QAction


def make(page: QWidget, intents: Intents) -> Actions:
    """The actions, added to the page."""

    def tr(text: str) -> str:
        return QCoreApplication.translate("CapturePage", text)

    def action(text: str, keys: str, tip: str, do: Callable[[], None] | None = None) -> QAction:
        made = QAction(text, page)
        made.setShortcut(keys)
        made.setToolTip(tip)
        if do is not None:
            made.triggered.connect(lambda checked=False: do())
        page.addAction(made)
        return made

    end = tr("End the capture after the exposure under way; it can be resumed")
    made = Actions(
        action(tr("&Start"), "F5", tr("Start the capture"), intents.start),
        action(tr("&Pause"), "F6", tr("Wait before the next pose"), intents.pause),
        action(tr("Fi&nish"), "Ctrl+.", end, intents.end),
        action(tr("Stop rig and camera"), "Esc", tr("Stop rig and camera at once"), intents.stop),
        action(tr("&Done"), "Space", tr("What was asked for is done"), intents.answer),
        action(tr("Show clipping"), "O", tr("Mark clipped pixels in the photograph")),
    )
    made.stop.setIconText(tr("STOP  (Esc)"))
    made.clipping.setCheckable(True)
    made.clipping.setChecked(True)
    return made
