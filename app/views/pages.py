"""The pages of the window, and what they may use of it; a page's module is loaded when it is first shown.

A page is a QWidget made with its parent alone. It has `show_session(folder: Path | None)`, which may be called
at any time and returns at once, and may have `use(shell: Shell)`, which is called once, before.
"""

import importlib
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QWidget

from app.state import Trouble
from app.views.trouble import show_trouble
from app.words import QT_TRANSLATE_NOOP

if TYPE_CHECKING:
    from app.settings import Settings
    from app.state import State
    from app.work.enquiries import Enquiries
    from app.work.queue import Board


@dataclass(frozen=True, slots=True)
class PageRow:
    """One row of the rail; the page `maps` is `MapsPage` of `app/views/maps/page.py`."""

    key: str
    title: str  # translated in the context "pages", as the tip
    tip: str
    number: int

    @property
    def shortcut(self) -> str:
        return f"Ctrl+{self.number % 10}"


PAGES = tuple(
    PageRow(*row, number)
    for number, row in enumerate(
        (
            ("start", QT_TRANSLATE_NOOP("pages", "Start"),
             QT_TRANSLATE_NOOP("pages", "New capture, sessions, import")),
            ("capture", QT_TRANSLATE_NOOP("pages", "Capture"),
             QT_TRANSLATE_NOOP("pages", "Turn the rig and photograph")),
            ("photographs", QT_TRANSLATE_NOOP("pages", "Photographs"),
             QT_TRANSLATE_NOOP("pages", "Look at them, and leave some out")),
            ("process", QT_TRANSLATE_NOOP("pages", "Process"),
             QT_TRANSLATE_NOOP("pages", "Photographs to surface")),
            ("mask", QT_TRANSLATE_NOOP("pages", "Mask"),
             QT_TRANSLATE_NOOP("pages", "Paint what is object and what is room")),
            ("view3d", QT_TRANSLATE_NOOP("pages", "3D"),
             QT_TRANSLATE_NOOP("pages", "Light, cameras and surface in space")),
            ("maps", QT_TRANSLATE_NOOP("pages", "Maps"),
             QT_TRANSLATE_NOOP("pages", "Normals, albedo, roughness, depth, errors")),
            ("charts", QT_TRANSLATE_NOOP("pages", "Charts"),
             QT_TRANSLATE_NOOP("pages", "Errors, residuals, coverage")),
            ("relight", QT_TRANSLATE_NOOP("pages", "Relight"),
             QT_TRANSLATE_NOOP("pages", "The object under another light")),
            ("export", QT_TRANSLATE_NOOP("pages", "Export"),
             QT_TRANSLATE_NOOP("pages", "Files for other programs")),
        ),
        1,
    )
)  # fmt: skip


class Wishes(QObject):
    """What a page may ask of the window."""

    ask_session = Signal()  # ask for a session's folder and open it
    open_session = Signal(Path)  # make this the open session
    show_page = Signal(str)  # by its key
    say = Signal(str)  # a line in the status bar, for some seconds
    trouble = Signal(object)  # a Trouble: tell it in a dialog
    new_capture = Signal()
    open_demo = Signal()
    simulate = Signal()  # ask what to photograph in a virtual room
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


def load(row: PageRow) -> type[QWidget]:
    """The page's class."""
    module = importlib.import_module(f"app.views.{row.key}.page")
    return getattr(module, f"{row.key.capitalize()}Page")


def preload() -> None:
    """Import what pages are made of, in a thread: a page's first show then only has to make it.

    The first of them to be shown would else cost the window's thread a fifth of a second, numpy above all.
    """

    def work() -> None:
        for row in PAGES:
            load(row)
        importlib.import_module("app.views.charts.view")

    threading.Thread(target=work, name="preload", daemon=True).start()


def tell(shell: Shell | None, page: QWidget, fault: Trouble) -> None:
    """Tell a page's trouble: through the window, or right here where the page stands alone."""
    if shell is not None:
        shell.wishes.trouble.emit(fault)
    else:
        show_trouble(page.window(), fault)
