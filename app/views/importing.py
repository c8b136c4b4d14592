"""The dialog that makes a session of a folder of photographs; the work itself is a job."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app.importing import Request, proposed, suggest_poses
from app.state import trouble
from app.views.bridge import Bridge
from app.views.pages import Shell
from app.views.trouble import show_trouble
from app.work.jobs import Job, JobState, JobStatus


class ImportDialog(QDialog):
    """Asks for a `Request`, runs it, and opens the session it made."""

    def __init__(self, parent: QWidget | None, shell: Shell, folder: Path | None = None) -> None:
        super().__init__(parent)
        self._shell = shell
        self._job: Job | None = None
        self._named = False  # the person chose the session's place; it follows the photographs no more
        self._bridge = Bridge(self)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Import photographs"))
        self.setMinimumWidth(600)
        self.folder, folder_row = self._path(self.tr("Photographs"), self._ask_folder)
        self.session, session_row = self._path(self.tr("New session"), self._ask_session)
        self.poses, poses_row = self._path(self.tr("Poses"), self._ask_poses)
        self.object_mask, mask_row = self._path(self.tr("Mask"), self._ask_mask)
        self.poses.setPlaceholderText(self.tr("found from the photographs"))
        self.object_mask.setPlaceholderText(self.tr("found from the photographs"))
        self.bracket = QComboBox()
        self.bracket.setAccessibleName(self.tr("Exposures of each view"))
        self.bracket.addItem(self.tr("found from the files"), None)
        for count in range(1, 10):
            self.bracket.addItem(str(count), count)
        self.folder.textChanged.connect(self._folder_changed)
        self.session.textEdited.connect(self._name)
        self.session.textChanged.connect(self._check)

        form = QFormLayout()
        form.setHorizontalSpacing(14)
        form.setVerticalSpacing(8)
        form.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
        form.addRow(_label(self.tr("&Photographs"), self.folder), folder_row)
        form.addRow(
            "",
            _hint(self.tr("RAW files, or linear .exr or .hdr images: at least 8 views, better 50 or more")),
        )
        form.addRow(_label(self.tr("New &session"), self.session), session_row)
        form.addRow(_label(self.tr("P&oses"), self.poses), poses_row)
        form.addRow(
            "",
            _hint(self.tr("transforms.json, a COLMAP model's folder, or a Metashape XML; may be left out")),
        )
        form.addRow(_label(self.tr("&Mask"), self.object_mask), mask_row)
        form.addRow("", _hint(self.tr("PNG of the photographs' size, white on the object; may be left out")))
        form.addRow(_label(self.tr("&Exposures a view"), self.bracket), self.bracket)

        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setAccessibleName(self.tr("Progress of the import"))
        self.note = QLabel()
        self.note.setObjectName("dim")
        self.box = QDialogButtonBox()
        self.go = self.box.addButton(self.tr("&Import"), QDialogButtonBox.ButtonRole.ActionRole)
        self.go.setObjectName("primary")
        self.go.setDefault(True)
        self.stop = self.box.addButton(QDialogButtonBox.StandardButton.Cancel)
        for button in self.box.buttons():
            button.setAccessibleName(button.text().replace("&", ""))
        self.go.clicked.connect(self._start)
        self.stop.clicked.connect(self.reject)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(18, 18, 18, 14)
        layout.setSpacing(12)
        layout.addLayout(form)
        layout.addStretch()
        layout.addWidget(self.bar)
        layout.addWidget(self.note)
        layout.addWidget(self.box)
        self.bar.hide()
        if folder is not None:
            self.folder.setText(str(folder))
        self._check()

    def request(self) -> Request:
        """What the fields say."""
        poses, mask = self.poses.text().strip(), self.object_mask.text().strip()
        return Request(
            Path(self.folder.text().strip()),
            Path(self.session.text().strip()),
            Path(poses) if poses else None,
            Path(mask) if mask else None,
            self.bracket.currentData(),
        )

    def reject(self) -> None:
        """Cancel the import under way, or leave."""
        if self._job is not None and self._job.status.active:
            self.note.setText(self.tr("Stopping…"))
            self._job.cancel()
        else:
            super().reject()

    def _start(self) -> None:
        if self._job is not None and self._job.status.active:
            return
        request = self.request()
        name = self.tr("Import {0}").format(request.folder.name)
        self._job = Job(name, "import", request.content())
        self._job.listen(self._bridge.latest(self._show))
        self._shell.board.start(self._job)
        self.bar.show()
        self._check()

    def _show(self, status: JobStatus) -> None:
        self.bar.setValue(round(1000 * status.fraction))
        if status.active:
            if status.state is JobState.RUNNING:
                self.note.setText(status.note)
            return
        self.bar.hide()
        self.note.setText("")
        self._check()
        if status.state is JobState.DONE:
            self._shell.wishes.open_session.emit(Path(str(status.result["session"])))
            self.accept()
        elif status.state is JobState.FAILED:
            show_trouble(self, trouble(status.message, status.details))

    def _check(self) -> None:
        running = self._job is not None and self._job.status.active
        said = bool(self.folder.text().strip() and self.session.text().strip())
        self.go.setEnabled(said and not running)
        for field in (self.folder, self.session, self.poses, self.object_mask, self.bracket):
            field.setEnabled(not running)

    def _name(self) -> None:
        self._named = True

    def _folder_changed(self, text: str) -> None:
        if text.strip() and not self._named:
            self.session.setText(str(proposed(Path(text.strip()))))
        found = suggest_poses(Path(text.strip())) if text.strip() else None
        if found is not None and not self.poses.text():
            self.poses.setText(str(found))
        self._check()

    def _path(self, name: str, ask: Callable[[], str]) -> tuple[QLineEdit, QWidget]:
        field = QLineEdit()
        field.setAccessibleName(name)
        browse = QPushButton(self.tr("Browse…"))
        browse.setAccessibleName(self.tr("Browse for {0}").format(name))
        browse.setAutoDefault(False)

        def fill() -> None:
            said = ask()
            if said:
                field.setText(said)
                if field is self.session:
                    self._named = True

        browse.clicked.connect(fill)
        both = QWidget()
        row = QHBoxLayout(both)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(field, 1)
        row.addWidget(browse)
        return field, both

    def _ask_folder(self) -> str:
        said = QFileDialog.getExistingDirectory(
            self, self.tr("Photographs"), self.folder.text() or self._shell.settings.value.last_folder
        )
        if said:
            self._shell.settings.change(last_folder=str(Path(said).parent))
        return said

    def _ask_session(self) -> str:
        return QFileDialog.getSaveFileName(self, self.tr("New session"), self.session.text())[0]

    def _ask_poses(self) -> str:
        kinds = self.tr("Poses (*.json *.xml *.bin *.txt)")
        said = QFileDialog.getOpenFileName(self, self.tr("Poses"), self.folder.text(), kinds)[0]
        # A COLMAP model is a folder; its files stand for it.
        return str(Path(said).parent) if said.endswith((".bin", ".txt")) else said

    def _ask_mask(self) -> str:
        kinds = self.tr("Masks (*.png)")
        return QFileDialog.getOpenFileName(self, self.tr("Mask"), self.folder.text(), kinds)[0]


def _label(text: str, field: QWidget) -> QLabel:
    label = QLabel(text)
    label.setBuddy(field)
    return label


def _hint(text: str) -> QLabel:
    hint = QLabel(text)
    hint.setObjectName("dim")
    return hint
