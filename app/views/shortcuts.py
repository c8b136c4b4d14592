"""Every keyboard shortcut of the window and its pages, on one sheet that opens with `?`.

Nobody keeps a list by hand: the sheet reads the actions and shortcuts that exist. A QShortcut says what it does in
its `whatsThis`.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from PySide6.QtCore import QCoreApplication, QObject, Qt
from PySide6.QtGui import QAction, QKeySequence, QShortcut
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QLabel, QScrollArea, QVBoxLayout, QWidget

from app.views import theme


@dataclass(frozen=True, slots=True)
class Shortcut:
    """One line of the sheet."""

    group: str  # a menu or page
    keys: str  # as this system writes them
    what: str


def collect(groups: Iterable[tuple[str, QWidget]]) -> tuple[Shortcut, ...]:
    """What there is in each of (title, widget), under the first that has it."""
    found: dict[Shortcut, None] = {}
    listed: set[QObject] = set()
    for title, widget in groups:
        for action in [*widget.actions(), *widget.findChildren(QAction), *widget.findChildren(QShortcut)]:
            if action in listed:
                continue
            listed.add(action)
            what, keys = (
                action.whatsThis(),
                action.keys() if isinstance(action, QShortcut) else action.shortcuts(),
            )
            if isinstance(action, QAction):
                what = what or action.text().replace("&", "").rstrip(".…") or action.toolTip()
            told = ", ".join(_told(one) for one in keys)
            if told and what:
                found.setdefault(Shortcut(title, told, what))
    return tuple(found)


def mouse() -> tuple[Shortcut, ...]:
    """What the mouse does in pictures, in space and on controls."""

    def tr(text: str) -> str:
        return QCoreApplication.translate("ShortcutsDialog", text)

    rows = (
        (tr("Wheel"), tr("Zoom in pictures, maps and 3D; exposure on the relight page")),
        (
            tr("Drag"),
            tr(
                "Move a picture; turn the view in 3D, the poses' sphere, or the light; move a lamp of your own"
            ),
        ),
        (tr("Right drag"), tr("Move the view in 3D")),
        (tr("Double click"), tr("Enlarge a map; centre a point in 3D; put a slider back to 0")),
        (tr("Right click"), tr("What else there is to do with a list's line")),
    )
    return tuple(Shortcut(tr("Mouse"), keys, what) for keys, what in rows)


def _told(keys: QKeySequence) -> str:
    return keys.toString(QKeySequence.SequenceFormat.NativeText)


class ShortcutsDialog(QDialog):
    """The sheet."""

    def __init__(self, parent: QWidget | None, shortcuts: Iterable[Shortcut]) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Keyboard shortcuts"))
        self.sheet = QLabel(table(shortcuts, theme.colours(self)))
        self.sheet.setTextFormat(Qt.TextFormat.RichText)
        self.sheet.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.sheet.setMargin(10)
        scroll = QScrollArea()
        scroll.setWidget(self.sheet)
        scroll.setWidgetResizable(True)
        scroll.setFrameShape(QScrollArea.Shape.NoFrame)
        scroll.setAccessibleName(self.windowTitle())
        box = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        box.rejected.connect(self.reject)
        for button in box.buttons():
            button.setAccessibleName(button.text().replace("&", ""))
        layout = QVBoxLayout(self)
        layout.addWidget(scroll)
        layout.addWidget(box)
        wide = self.sheet.sizeHint().width() + 60
        self.resize(wide, min(640, self.sheet.sizeHint().height() + 90))


def table(shortcuts: Iterable[Shortcut], ours: theme.Palette) -> str:
    """As HTML, a heading a group."""
    rows, group = [], None
    for shortcut in shortcuts:
        if shortcut.group != group:
            group = shortcut.group
            rows.append(
                f'<tr><td colspan="2" style="padding:12px 0 4px 0"><b style="color:{ours.text}">{group}</b></td></tr>'
            )
        rows.append(
            f'<tr><td style="padding:2px 28px 2px 12px; white-space:nowrap; color:{ours.accent}">'
            f"{_escaped(shortcut.keys)}</td><td style='padding:2px 0'>{_escaped(shortcut.what)}</td></tr>"
        )
    empty = QCoreApplication.translate("ShortcutsDialog", "No shortcuts.")
    return f"<table cellspacing='0'>{''.join(rows)}</table>" if rows else empty


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
