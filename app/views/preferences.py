"""The dialog of preferences: looks, device and cores, folder, keys, and what is kept in the cache."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import QCoreApplication, Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QGridLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app import caches, places
from app.state import Trouble
from app.views import theme
from app.views.background import Background
from app.views.editors import Number
from app.views.forms import browsed, form, hint, label, named
from app.views.pages import Shell
from app.views.trouble import show_trouble

DEVICES = ("auto", "cpu", "cuda")


class PreferencesDialog(QDialog):
    """Every change holds at once, here and in later sessions."""

    def __init__(self, parent: QWidget | None, shell: Shell, show_shortcuts: Callable[[], None]) -> None:
        super().__init__(parent)
        self._shell, self._background = shell, Background(self, "caches")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Preferences"))
        self.setMinimumWidth(520)
        chosen = shell.settings.value
        themes = {name: theme.title(text) for name, text in theme.TITLES.items()}
        devices = {"auto": self.tr("Automatic"), "cpu": self.tr("CPU"), "cuda": self.tr("GPU (CUDA)")}
        self.theme = self._box(themes, chosen.theme, self._choose_theme)
        self.device = self._box(devices, chosen.device, lambda name: shell.settings.change(device=name))
        rows = form()
        rows.addRow(label(self.tr("&Theme"), self.theme), self.theme)
        rows.addRow(label(self.tr("&Device"), self.device), self.device)
        self.cores = Number(whole=True)
        self.cores.setRange(0, len(os.sched_getaffinity(0)))
        self.cores.setSpecialValueText(self.tr("all"))
        self.cores.setValue(chosen.cores)
        self.cores.valueChanged.connect(lambda count: shell.settings.change(cores=round(count)))
        rows.addRow(label(self.tr("C&ores"), self.cores), self.cores)
        rows.addRow("", hint(self.tr("Of what is started from now on; nothing is done again for it.")))

        self.folder = QLineEdit(chosen.new_sessions)
        self.folder.setPlaceholderText(self.tr("Where the last one went"))
        self.folder.editingFinished.connect(self._choose_folder)
        whole_row = browsed(
            self.folder, self.tr("Folder for new sessions"),
            lambda: QFileDialog.getExistingDirectory(self, self.tr("Folder for new sessions"), str(shell.settings.place)),
            self._choose_folder,
        )  # fmt: skip
        rows.addRow(label(self.tr("&New sessions"), self.folder), whole_row)
        keys = QPushButton(self.tr("&Keyboard shortcuts…"))
        keys.setAccessibleName(self.tr("Keyboard shortcuts"))
        keys.setAutoDefault(False)
        keys.clicked.connect(show_shortcuts)
        rows.addRow("", keys)

        self.sizes: dict[str, QLabel] = {}
        self.clear: dict[str, QPushButton] = {}
        table = QGridLayout()
        table.setColumnStretch(0, 1)
        table.setHorizontalSpacing(14)
        for row, (name, text) in enumerate(caches.NAMES.items()):
            words = QCoreApplication.translate("caches", text)
            size, button = QLabel("…"), QPushButton(self.tr("Clear"))
            size.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
            button.setAccessibleName(self.tr("Clear {0}").format(words))
            button.setAutoDefault(False)
            button.clicked.connect(lambda checked=False, name=name: self._clear(name))
            for column, widget in enumerate((QLabel(words), size, button)):
                table.addWidget(widget, row, column)
            self.sizes[name], self.clear[name] = size, button
        self.place = QLabel(str(places.cache().resolve()))
        self.place.setObjectName("dim")
        self.place.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.elsewhere = QPushButton(self.tr("&Move…"))
        self.elsewhere.setAccessibleName(self.tr("Keep the cache in another folder"))
        self.elsewhere.clicked.connect(self._ask_place)
        show = QPushButton(self.tr("Show &folder"))
        show.clicked.connect(lambda: QDesktopServices.openUrl(QUrl.fromLocalFile(str(places.cache()))))
        for column, widget in enumerate((self.place, self.elsewhere, show)):
            table.addWidget(widget, len(caches.NAMES), column)
        for button in (self.elsewhere, show):
            button.setAutoDefault(False)

        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close)
        buttons.rejected.connect(self.reject)
        named(show, *buttons.buttons())
        heading = QLabel(self.tr("Cache"))
        heading.setObjectName("heading")
        whole = QVBoxLayout(self)
        whole.setSpacing(12)
        whole.addLayout(rows)
        whole.addWidget(heading)
        whole.addWidget(hint(self.tr("What can be made again. Sessions and their results are elsewhere.")))
        whole.addLayout(table)
        whole.addWidget(buttons)
        self._measure()

    def _box(self, words: Mapping[Any, str], chosen: str, take: Callable[[Any], None]) -> QComboBox:
        box = QComboBox()
        for name, text in words.items():
            box.addItem(text, name)
        box.setCurrentIndex(box.findData(chosen))
        box.activated.connect(lambda row: take(box.itemData(row)))
        return box

    def _choose_theme(self, name: theme.Theme) -> None:
        self._shell.settings.change(theme=name)
        theme.choose(name)

    def _choose_folder(self) -> None:
        said = self.folder.text().strip()
        self._shell.settings.change(new_sessions=os.path.abspath(os.path.expanduser(said)) if said else "")

    def _measure(self) -> None:
        self._background.ask("sizes", caches.sizes, self._show)

    def _show(self, sizes: Mapping[str, int]) -> None:
        for name, count in sizes.items():
            self.sizes[name].setText(
                self.tr("{0} MB").format(f"{count / 1e6:.3g}") if count else self.tr("empty")
            )
            self.clear[name].setEnabled(count > 0)

    def _clear(self, name: str) -> None:
        self.clear[name].setEnabled(False)
        self._background.ask(name, lambda: caches.clear(name), lambda nothing: self._measure(), self._refused)

    def _refused(self, fault: Trouble) -> None:
        show_trouble(self, fault)
        self.elsewhere.setEnabled(True)
        self._measure()

    def _ask_place(self) -> None:
        if self._shell.board.active:
            why = Trouble(self.tr("The cache is in use"), self.tr("wait until nothing runs"))
            show_trouble(self, why)
            return
        said = QFileDialog.getExistingDirectory(
            self, self.tr("Keep the cache in"), str(places.cache().parent)
        )
        if said:
            self.elsewhere.setEnabled(False)
            self._background.ask("move", lambda: caches.move(Path(said)), self._moved, self._refused)

    def _moved(self, there: Path) -> None:
        self.place.setText(str(there))
        self.elsewhere.setEnabled(True)
