"""Every keyboard shortcut of the window and its pages, on one sheet that opens with `?`, where a person may choose others.

Nobody keeps a list by hand: the sheet reads the actions and shortcuts that exist. A QShortcut says what it does in
its `whatsThis`, and keeps its keys.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from PySide6.QtCore import QCoreApplication, QObject, QSignalBlocker, Qt
from PySide6.QtGui import QAction, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QHeaderView,
    QKeySequenceEdit,
    QMainWindow,
    QStyledItemDelegate,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from app.views import theme
from app.views.forms import hint, named

SHIPPED = "shipped keys"  # property of an action whose keys may be chosen
RETOLD = "retold"  # property of what names keys: its words as shipped, and as they are now
FOLLOWS = "follows"  # property of a button that names its action's keys itself
SHORTCUT = Qt.ItemDataRole.UserRole


@dataclass(frozen=True, slots=True)
class Shortcut:
    """One line of the sheet."""

    group: str  # a menu or page
    keys: str  # as this system writes them
    what: str
    of: QAction | None = field(default=None, compare=False)  # whose keys a person may choose

    @property
    def name(self) -> str:
        """What the settings call it."""
        return f"{self.group}: {self.what}"


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
            may = isinstance(action, QAction)
            if what and (told or (may and action.property(SHIPPED))):
                found.setdefault(Shortcut(title, told, what, action if may else None))
    return tuple(found)


def choose(shortcuts: Iterable[Shortcut], chosen: Mapping[str, str]) -> None:
    """Give every action the keys that were chosen for it by name, or those it came with."""
    for shortcut in shortcuts:
        action = shortcut.of
        if action is None:
            continue
        if action.property(SHIPPED) is None:
            action.setProperty(SHIPPED, action.shortcuts())
        keys = chosen.get(shortcut.name)
        action.setShortcuts(action.property(SHIPPED) if keys is None else [QKeySequence(keys)])


def replaced(actions: Iterable[QAction]) -> dict[str, str]:
    """The keys in force by the shipped ones, of actions whose keys are others now."""
    found = {}
    for action in actions:
        shipped = action.property(SHIPPED)
        if shipped is not None and shipped != action.shortcuts():
            found |= {_told(keys): _told(action.shortcut()) for keys in shipped}
    return found


def retell(root: QWidget, keys: Mapping[str, str]) -> None:
    """Let tooltips under `root`, and what buttons of its actions say, name the keys in force where they have shipped ones in
    brackets; see `replaced`."""
    for widget in root.findChildren(QWidget):
        if not widget.property(FOLLOWS):
            _retell(widget, keys, widget.toolTip(), widget.setToolTip)
    for action in root.findChildren(QAction):
        _retell(action, keys, action.iconText(), action.setIconText)


def _retell(of: QObject, keys: Mapping[str, str], now: str, say: Callable[[str], None]) -> None:
    shipped, last = of.property(RETOLD) or (now, now)
    if now != last:  # something else was said meanwhile
        shipped = now
    none = QCoreApplication.translate("ShortcutsDialog", "no key")
    told = re.sub(
        r"\([^()]*\)",
        lambda bracket: re.sub(r"[^\s(),;]+", lambda word: keys.get(word[0], word[0]) or none, bracket[0]),
        shipped,
    )
    if told != now:
        say(told)
        of.setProperty(RETOLD, (shipped, told))


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
    """The sheet; F2 or a double click on a line that may have other keys asks for them."""

    def __init__(
        self, parent: QWidget | None, shortcuts: Sequence[Shortcut], change: Callable[[str | None, str], None]
    ) -> None:
        """
        Args:
            change: told a shortcut's name and its keys from now on, as `QKeySequence` writes them; None: all as shipped.
        """
        super().__init__(parent)
        self._shortcuts, self._change = shortcuts, change
        self.lines: list[QTreeWidgetItem] = []  # one for each shortcut
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Keyboard shortcuts"))
        self.sheet = QTreeWidget()
        self.sheet.setAccessibleName(self.windowTitle())
        self.sheet.setHeaderLabels([self.tr("What"), self.tr("Keys")])
        self.sheet.setRootIsDecorated(False)
        self.sheet.header().setStretchLastSection(False)
        self.sheet.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.sheet.header().setSectionResizeMode(1, QHeaderView.ResizeMode.ResizeToContents)
        self.sheet.setObjectName("plain")
        self.sheet.setEditTriggers(
            QTreeWidget.EditTrigger.DoubleClicked | QTreeWidget.EditTrigger.EditKeyPressed
        )
        self.sheet.setItemDelegateForColumn(1, Keys(self.sheet))
        self._fill()
        self.sheet.itemChanged.connect(self._edited)
        self.said = hint(self.tr("F2 or a double click gives a line other keys."))
        box = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Close | QDialogButtonBox.StandardButton.RestoreDefaults
        )
        box.rejected.connect(self.reject)
        self.restore = box.button(QDialogButtonBox.StandardButton.RestoreDefaults)
        self.restore.clicked.connect(self._restore)
        named(*box.buttons())
        layout = QVBoxLayout(self)
        layout.addWidget(self.sheet)
        layout.addWidget(self.said)
        layout.addWidget(box)
        self.resize(640, 640)

    def _fill(self) -> None:
        groups: dict[str, QTreeWidgetItem] = {}
        for shortcut in self._shortcuts:
            if shortcut.group not in groups:
                groups[shortcut.group] = heading = QTreeWidgetItem(self.sheet, [shortcut.group])
                font = heading.font(0)
                font.setBold(True)
                heading.setFont(0, font)
                heading.setFlags(Qt.ItemFlag.ItemIsEnabled)
            line = QTreeWidgetItem(groups[shortcut.group], [shortcut.what, shortcut.keys])
            line.setData(0, SHORTCUT, shortcut)
            self.lines.append(line)
            if shortcut.of is not None:
                line.setFlags(line.flags() | Qt.ItemFlag.ItemIsEditable)
        self.sheet.expandAll()

    def _edited(self, line: QTreeWidgetItem, column: int) -> None:
        shortcut: Shortcut = line.data(0, SHORTCUT)
        assert shortcut.of is not None
        keys = QKeySequence(line.text(1), QKeySequence.SequenceFormat.NativeText)
        other = next((one for one in self._shortcuts if self._clash(shortcut, one, keys)), None)
        if other is None:
            self._change(shortcut.name, keys.toString())
        else:
            self.said.setText(self.tr("{0} is taken by {1}").format(_told(keys), other.name))
        self._show()

    def _clash(self, one: Shortcut, other: Shortcut, keys: QKeySequence) -> bool:
        """Whether the other has these keys already, where both would hear them."""
        if keys.isEmpty() or other.of is None or other.of is one.of or keys not in other.of.shortcuts():
            return False
        pages = {
            shortcut.group
            for shortcut in (one, other)
            if shortcut.of is not None and not _everywhere(shortcut.of)
        }
        return len(pages) < 2

    def _restore(self) -> None:
        self._change(None, "")
        self._show()

    def _show(self) -> None:
        with QSignalBlocker(self.sheet):
            for line in self.lines:
                action = line.data(0, SHORTCUT).of
                if action is not None:
                    line.setText(1, ", ".join(map(_told, action.shortcuts())))


def _everywhere(action: QAction) -> bool:
    """Whether it is one of the window's menus, and not a page's."""
    return isinstance(action.parent(), QMainWindow)


class Keys(QStyledItemDelegate):
    """Edits a line's keys by pressing them."""

    def createEditor(self, parent, option, index) -> QWidget:
        editor = QKeySequenceEdit(parent)
        editor.setMaximumSequenceLength(1)
        editor.setClearButtonEnabled(True)
        return editor

    def setEditorData(self, editor, index) -> None:
        editor.setKeySequence(
            QKeySequence(index.data().split(", ")[0], QKeySequence.SequenceFormat.NativeText)
        )

    def setModelData(self, editor, model, index) -> None:
        model.setData(index, _told(editor.keySequence()))


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
