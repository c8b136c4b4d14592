"""The pages of the window, and what they may use of it; a page's module is loaded when it is first shown.

A page is a QWidget made with its parent alone. It has `show_session(folder: Path | None)`, which may be called
at any time and returns at once, and may have `use(shell: Shell)`, which is called once, before.
"""

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QWidget

from app.words import QT_TRANSLATE_NOOP

if TYPE_CHECKING:
    from app.settings import Settings
    from app.state import State
    from app.work.enquiries import Enquiries
    from app.work.queue import Board


@dataclass(frozen=True, slots=True)
class PageRow:
    """One row of the rail."""

    key: str
    title: str  # translated in the context "pages"
    shortcut: str
    module: str
    kind: str  # the class in `module`
    tip: str


PAGES = (
    PageRow("start", QT_TRANSLATE_NOOP("pages", "Start"), "Ctrl+1", "app.views.start", "StartPage",
            QT_TRANSLATE_NOOP("pages", "New capture, sessions, import")),
    PageRow("capture", QT_TRANSLATE_NOOP("pages", "Capture"), "Ctrl+2", "app.views.capture", "CapturePage",
            QT_TRANSLATE_NOOP("pages", "Turn the rig and photograph")),
    PageRow("process", QT_TRANSLATE_NOOP("pages", "Process"), "Ctrl+3", "app.views.process", "ProcessPage",
            QT_TRANSLATE_NOOP("pages", "Photographs to surface")),
    PageRow("mask", QT_TRANSLATE_NOOP("pages", "Mask"), "Ctrl+4", "app.views.mask", "MaskPage",
            QT_TRANSLATE_NOOP("pages", "Paint what is object and what is room")),
    PageRow("view3d", QT_TRANSLATE_NOOP("pages", "3D"), "Ctrl+5", "app.views.view3d", "View3dPage",
            QT_TRANSLATE_NOOP("pages", "Light, cameras and surface in space")),
    PageRow("maps", QT_TRANSLATE_NOOP("pages", "Maps"), "Ctrl+6", "app.views.maps", "MapsPage",
            QT_TRANSLATE_NOOP("pages", "Normals, albedo, roughness, depth, errors")),
    PageRow("charts", QT_TRANSLATE_NOOP("pages", "Charts"), "Ctrl+7", "app.views.charts", "ChartsPage",
            QT_TRANSLATE_NOOP("pages", "Errors, residuals, coverage")),
    PageRow("relight", QT_TRANSLATE_NOOP("pages", "Relight"), "Ctrl+8", "app.views.relight", "RelightPage",
            QT_TRANSLATE_NOOP("pages", "The object under another light")),
    PageRow("export", QT_TRANSLATE_NOOP("pages", "Export"), "Ctrl+9", "app.views.export", "ExportPage",
            QT_TRANSLATE_NOOP("pages", "Files for other programs")),
)  # fmt: skip


class Wishes(QObject):
    """What a page may ask of the window."""

    ask_session = Signal()  # ask for a session's folder and open it
    open_session = Signal(Path)  # make this the open session
    show_page = Signal(str)  # by its key
    say = Signal(str)  # a line in the status bar, for some seconds
    trouble = Signal(object)  # a Trouble: tell it in a dialog
    new_capture = Signal()
    add_photographs = Signal(object)  # a folder (Path) to import, or None to ask for one


@dataclass(frozen=True, slots=True)
class Shell:
    """What the window shares with its pages."""

    state: "State"  # the open session
    board: "Board"  # every job that runs or waits
    settings: "Settings"  # of this person
    enquiries: "Enquiries"  # quick questions to the engine, answered by a child
    wishes: Wishes


@runtime_checkable
class UsesShell(Protocol):
    """A page that wants the shell."""

    def use(self, shell: Shell) -> None: ...


def load(row: PageRow) -> type[QWidget] | None:
    """The page's class; None while nobody has written it."""
    try:
        module = importlib.import_module(row.module)
    except ModuleNotFoundError as error:
        if error.name != row.module:
            raise
        return None
    return getattr(module, row.kind)
