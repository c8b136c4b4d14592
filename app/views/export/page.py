"""The Export page: every format with its content, frame and units; where to, and which way green points."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PySide6.QtCore import QCoreApplication, Qt, QUrl
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import (
    QButtonGroup,
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QPushButton,
    QRadioButton,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from app import exports
from app.exports import FORMATS, GREEN, TARGETS, Export, Format
from app.plan import read_plan
from app.state import trouble
from app.views import theme
from app.views.bridge import Bridge
from app.views.empty import Empty
from app.views.errand import Errand
from app.views.head import Head
from app.views.page_actions import page_action
from app.views.page_column import Either, lay_out
from app.views.pages import Shell
from app.views.side_picture import SidePicture
from app.views.trouble import show_trouble
from app.views.verdict import Verdict
from app.work.enquiries import Answer
from engine.errors import ExportError
from engine.results.quality import Quality

KEY = Qt.ItemDataRole.UserRole


class ExportPage(QWidget):
    """What a finished session gives to other programs."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = self.tr("Export")
        self._bridge = Bridge(self)
        self._shell: Shell | None = None
        self._folder: Path | None = None
        self._export: Export | None = None
        self._newest = self._pictured = self._ended = 0
        self._build()
        self._show()

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.empty.use(shell)
        self.errand.board = shell.board
        shell.board.listen(self._bridge.latest(self._look_again))
        self.show_session(shell.state.session.value)

    def show_session(self, folder: Path | None) -> None:
        if folder != self._folder or folder is None:
            self._export = None
            self.to.setText(str(folder.parent / f"{folder.stem}-export") if folder is not None else "")
        self._folder = folder
        self.head.show_session(folder)
        self.state.setText(self.tr("looking…") if folder is not None else "")
        self._show()
        if folder is None or self._shell is None:
            self.verdict.show_quality(None)
            self.empty.say_nothing_yet(folder)
            return
        if self._export is None:
            self.empty.say_reading()
        self._newest += 1
        take, number = self._bridge.queued(self._take), self._newest
        self._shell.enquiries.ask("plan", lambda answer: take(number, *_found(answer)), session=str(folder))

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self.show_session(self._folder)

    def _look_again(self) -> None:
        """Once a run has ended; what runs beside the queue is this page's own."""
        ended = sum(job.status.ended for job in self._shell.board.queue) if self._shell is not None else 0
        if ended != self._ended and self.isVisible():
            self.show_session(self._folder)
        self._ended = ended

    def _take(self, number: int, export: Export | None, why: str, quality: Quality | None) -> None:
        if number != self._newest:
            return
        self._export = export
        self.verdict.show_quality(quality)
        self.state.setText("")
        self.empty.say_nothing_yet(self._folder, trouble(why))
        if export is not None:
            self.greens[export.green].setChecked(True)
            length = (
                ""
                if export.length != "unknown"
                else self.tr("; no real-world scale: Set scale in Maps gives one")
            )
            self.state.setText(self.tr("up to date") + length)
        self._show()
        self._preview()

    def _build(self) -> None:
        self.table = QTreeWidget()
        self.table.setAccessibleName(self.tr("Formats"))
        self.table.setObjectName("plain")
        self.table.setRootIsDecorated(False)
        self.table.setAlternatingRowColors(True)
        self.table.setWordWrap(True)
        self.table.setHeaderLabels(
            [
                self.tr("File"),
                self.tr("Content"),
                self.tr("Frame"),
                self.tr("Values and units"),
                self.tr("Size"),
            ]
        )
        for column, width in ((0, 170), (4, 68)):
            self.table.header().resizeSection(column, width)
        self.table.header().setStretchLastSection(False)
        for column in (1, 2, 3):
            self.table.header().setSectionResizeMode(column, QHeaderView.ResizeMode.Stretch)
        self._lines = [_line(entry) for entry in FORMATS]
        self.table.addTopLevelItems(self._lines)
        self.table.itemChanged.connect(lambda item, column: self._enable())
        self.table.currentItemChanged.connect(lambda now, before: self._preview())
        self.preview = SidePicture(self.tr("What is written"))

        self.greens: dict[str, QRadioButton] = {}
        group = QButtonGroup(self)
        greens = QHBoxLayout()
        greens.addWidget(QLabel(self.tr("Normal maps")))
        for key, text in GREEN.items():
            button = QRadioButton(_translated(text))
            button.setAccessibleName(_translated(text))
            group.addButton(button)
            greens.addSpacing(10)
            greens.addWidget(button)
            self.greens[key] = button
        self.greens["up"].setChecked(True)
        greens.addStretch()
        self.target = QComboBox()
        self.target.setAccessibleName(self.tr("Program that the files are for"))
        self.target.setToolTip(
            self.tr(
                "Ticks the files that this program reads, and turns green of the normal maps as it wants it"
            )
        )
        for key, target in TARGETS.items():
            self.target.addItem(_translated(target.title), key)
        self.target.activated.connect(lambda row: self._choose(self.target.itemData(row)))
        name = QLabel(self.tr("&Program"))
        name.setBuddy(self.target)
        self.to = QLineEdit()
        self.to.setAccessibleName(self.tr("Folder to write to"))
        self.to.textChanged.connect(self._enable)
        to = QLabel(self.tr("&Folder"))
        to.setBuddy(self.to)
        browse = QPushButton(self.tr("&Browse…"))
        browse.setAccessibleName(self.tr("Browse for the folder to write to"))
        browse.clicked.connect(self._browse)
        self.open = QPushButton(self.tr("&Open folder"))
        self.open.setAccessibleName(self.tr("Open the folder written to"))
        self.open.clicked.connect(self._open)
        self.report = QPushButton(self.tr("&Report…"))
        self.report.setAccessibleName(self.tr("Write the report and open it"))
        self.report.setToolTip(self.tr("One self-contained HTML page about the results"))
        self.report.clicked.connect(self._report)
        self.action = page_action(self, self.tr("E&xport"), "Ctrl+Return", self._start)
        self.action.setShortcutContext(Qt.ShortcutContext.WindowShortcut)  # from the rail too
        self.head = Head(self, self.action)
        self.head.add(name, self.target)
        self.state, self.go = self.head.state, self.head.primary
        self.errand = Errand(self)
        self.errand.changed.connect(self._enable)
        self.errand.done.connect(self._done)
        self.errand.failed.connect(lambda fault: show_trouble(self, fault))
        bottom = QHBoxLayout()
        for part in (to, self.to, browse, self.open, self.errand, self.report):
            bottom.addWidget(part, 1 if part is self.to else 0)

        body = QWidget()
        layout = QVBoxLayout(body)
        layout.setContentsMargins(16, 10, 12, 10)
        layout.setSpacing(10)
        self.verdict, self.empty = Verdict(), Empty("export")
        self.stack = Either(self.empty, body)
        lay_out(self, self.head, self.verdict, self.stack)
        middle = QHBoxLayout()
        middle.addWidget(self.table, 1)
        middle.addWidget(self.preview)
        layout.addLayout(middle, 1)
        layout.addLayout(greens)
        layout.addLayout(bottom)

    def keys(self) -> frozenset[str]:
        """The formats that are ticked."""
        return frozenset(
            line.data(0, KEY) for line in self._lines if line.checkState(0) == Qt.CheckState.Checked
        )

    def green(self) -> str:
        """ "up" or "down"."""
        return next(key for key, button in self.greens.items() if button.isChecked())

    def _choose(self, key: str) -> None:
        target = TARGETS[key]
        self.greens[target.green].setChecked(True)
        for line, entry in zip(self._lines, FORMATS, strict=True):
            wanted = not target.formats or entry.key in target.formats
            if not line.isDisabled():
                line.setCheckState(0, Qt.CheckState.Checked if wanted else Qt.CheckState.Unchecked)

    def _show(self) -> None:
        there = {offer.format.key: offer for offer in self._export.offers} if self._export is not None else {}
        length = self._export.length if self._export is not None else ""
        unit = length if length not in ("", "unknown") else self.tr("scene units")
        for item, entry in zip(self._lines, FORMATS, strict=True):
            item.setText(3, _translated(entry.unit).replace("{length}", unit))
            item.setToolTip(3, item.text(3))
            item.setText(4, exports.told_bytes(there[entry.key].bytes) if entry.key in there else "")
            item.setToolTip(0, f"{_translated(entry.title)}: {', '.join(entry.files)}")
            absent = bool(there) and entry.key not in there
            if absent != item.isDisabled():
                item.setCheckState(0, Qt.CheckState.Unchecked if absent else Qt.CheckState.Checked)
            item.setDisabled(absent)
        self._enable()

    def _enable(self) -> None:
        running = self.errand.busy
        ready = self._export is not None and not running
        self.action.setEnabled(ready and bool(self.keys()) and bool(self.to.text().strip()))
        self.target.setEnabled(self._export is not None)
        self.report.setEnabled(self._folder is not None and not running)
        self.stack.setCurrentIndex(self._export is not None)
        self.open.setEnabled(Path(self.to.text().strip() or "/nowhere").is_dir())

    def resizeEvent(self, event) -> None:
        super().resizeEvent(event)
        self.preview.fit(self.width())

    def _preview(self) -> None:
        """A picture of the format that is chosen, where its files are such as can be looked at."""
        item, export = self.table.currentItem(), self._export
        self._pictured += 1
        if item is None or export is None or self._shell is None:
            self.preview.clear()
            return
        key, number = str(item.data(0, KEY)), self._pictured
        take = self._bridge.queued(lambda answer: self._take_picture(number, key, answer))
        self._shell.enquiries.ask("exported", take, folder=str(export.folder), format=key)

    def _take_picture(self, number: int, key: str, answer: Answer) -> None:
        if number != self._pictured or self._export is None:
            return
        picture = (answer.content or {}).get("picture")
        if picture is None:
            self.preview.clear()
            return
        files = next((offer.files for offer in self._export.offers if offer.format.key == key), ())
        self.preview.show_file(Path(picture), ", ".join(files[:3]) + (", \u2026" if len(files) > 3 else ""))

    def _browse(self) -> None:
        said = QFileDialog.getExistingDirectory(
            self, self.tr("Folder to write to"), str(Path(self.to.text() or ".").parent)
        )
        if said:
            self.to.setText(said)

    def _open(self) -> None:
        QDesktopServices.openUrl(QUrl.fromLocalFile(self.to.text().strip()))

    def _start(self) -> None:
        if self._folder is None or self._export is None or self._shell is None:
            return
        to = Path(self.to.text().strip()).expanduser()
        request = exports.request(self._folder, to, self._export, self.keys(), self.green())
        self.errand.begin(self.tr("Export"), "export", request, self.go)

    def _report(self) -> None:
        if self._folder is None:
            return
        to, _ = QFileDialog.getSaveFileName(
            self, self.tr("Report"), str(self._folder / "exports" / "report.html"), "HTML (*.html)"
        )
        if to:
            request = {"session": str(self._folder), "to": to}
            self.errand.begin(self.tr("Report"), "report", request, self.report)

    def _done(self, task: str, result: Mapping[str, Any]) -> None:
        if task == "export":
            said = self.tr("Exported to {0}").format(result["to"])
        else:
            said = self.tr("Report written: {0}").format(result["page"])
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(result["page"])))
        self.state.setText(said)
        if self._shell is not None:
            self._shell.wishes.say.emit(said)

    def changeEvent(self, event) -> None:
        super().changeEvent(event)
        if event.type() == event.Type.PaletteChange and hasattr(self, "table"):
            self._dim()

    def _dim(self) -> None:
        dim = theme.colour(theme.colours(self).dim)
        for item in self._lines:
            for column in (2, 3, 4):
                item.setForeground(column, dim)


def _found(answer: Answer) -> tuple[Export | None, str, Quality | None]:
    """The session's finished export, or why there is none, and what it is worth; in the reader thread, it reads the disk."""
    translate = QCoreApplication.translate
    if answer.content is None:
        return None, answer.trouble.what if answer.trouble is not None else "", None
    plan = read_plan(answer.content)
    row = next(row for row in plan.rows if row.name == "export")
    if not row.done:
        return (
            None,
            translate("ExportPage", "The results are not there, or older than the settings; process first"),
            plan.quality,
        )
    try:
        return exports.read(Path(row.folder)), "", plan.quality
    except ExportError as error:
        return None, str(error), plan.quality


def _line(entry: Format) -> QTreeWidgetItem:
    item = QTreeWidgetItem(
        [
            ", ".join(name.replace("/*", "/") for name in entry.files),
            _translated(entry.content),
            _translated(entry.frame),
            "",
            "",
        ]
    )
    item.setData(0, KEY, entry.key)
    item.setCheckState(0, Qt.CheckState.Checked)
    item.setTextAlignment(4, Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    for column in (1, 2):
        item.setToolTip(column, item.text(column))
    return item


def _translated(text: str) -> str:
    return QCoreApplication.translate("exports", text)
