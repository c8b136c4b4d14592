"""What dialogs that ask for a job are made of: fields with a button to browse, hints under them, and the job's foot."""

from collections.abc import Callable, Mapping
from typing import Any

from PySide6.QtCore import QCoreApplication, QEvent, QObject, Signal
from PySide6.QtWidgets import (
    QAbstractButton,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app.state import trouble
from app.views.bridge import Bridge
from app.views.trouble import show_trouble
from app.work.jobs import Job, JobState, JobStatus
from app.work.queue import Board


def form() -> QFormLayout:
    """Names on the left, fields as wide as there is room."""
    made = QFormLayout()
    made.setHorizontalSpacing(14)
    made.setVerticalSpacing(8)
    made.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    return made


def label(text: str, field: QWidget) -> QLabel:
    """Also what a screen reader calls the field."""
    made = QLabel(text)
    made.setBuddy(field)
    field.setAccessibleName(field.accessibleName() or text.replace("&", ""))
    return made


def named(*buttons: QAbstractButton) -> None:
    """Let a screen reader call them by their words."""
    for button in buttons:
        button.setAccessibleName(button.text().replace("&", ""))


def hint(text: str) -> QLabel:
    made = QLabel(text)
    made.setObjectName("dim")
    return made


def browsed(
    field: QLineEdit | QComboBox, name: str, ask: Callable[[], str], chosen: Callable[[], None] = lambda: None
) -> QWidget:
    """A field with a button beside it that fills it with what `ask` says, if that is something; then `chosen` is called."""
    translate = QCoreApplication.translate
    field.setAccessibleName(name)
    browse = QPushButton(translate("Form", "Browse…"))
    browse.setAccessibleName(translate("Form", "Browse for {0}").format(name))
    browse.setAutoDefault(False)

    def fill() -> None:
        if said := ask():
            field.setCurrentText(said) if isinstance(field, QComboBox) else field.setText(said)
            chosen()

    browse.clicked.connect(fill)
    field.installEventFilter(_Follows(browse))
    both = QWidget()
    row = QHBoxLayout(both)
    row.setContentsMargins(0, 0, 0, 0)
    row.addWidget(field, 1)
    row.addWidget(browse)
    return both


class _Follows(QObject):
    """Enables a button with the field it is installed on."""

    def __init__(self, button: QPushButton) -> None:
        super().__init__(button)
        self._button = button

    def eventFilter(self, of: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.EnabledChange and isinstance(of, QWidget):
            self._button.setEnabled(of.isEnabled())
        return False


class JobFoot(QWidget):
    """A dialog's last lines: a button that starts a job, its progress, and one that stops it or leaves. Tells what fails."""

    wanted = Signal()  # the first button
    done = Signal(object)  # the job's result
    changed = Signal()  # begun or ended

    def __init__(self, dialog: QDialog, board: Board, go: str, *above: QWidget | QLayout) -> None:
        """Lays `dialog` out: what stands `above`, then this."""
        super().__init__(dialog)
        self._dialog = dialog
        self._board = board
        self._bridge = Bridge(self)
        self._job: Job | None = None
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setAccessibleName(self.tr("Progress"))
        self.note = hint("")
        self.box = QDialogButtonBox()
        self.go = self.box.addButton(go, QDialogButtonBox.ButtonRole.ActionRole)
        self.go.setObjectName("primary")
        self.go.setDefault(True)
        self.stop = self.box.addButton(QDialogButtonBox.StandardButton.Cancel)
        named(*self.box.buttons())
        self.go.clicked.connect(self.wanted)
        self.stop.clicked.connect(self.leave)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(12)
        for widget in (self.bar, self.note, self.box):
            layout.addWidget(widget)
        self.bar.hide()
        whole = QVBoxLayout(dialog)
        whole.setContentsMargins(18, 18, 18, 14)
        whole.setSpacing(12)
        for part in above:
            whole.addLayout(part) if isinstance(part, QLayout) else whole.addWidget(part)
        whole.addStretch()
        whole.addWidget(self)

    @property
    def running(self) -> bool:
        return self._job is not None and self._job.status.active

    def begin(self, name: str, task: str, request: Mapping[str, Any]) -> None:
        """Start a job beside the queue; nothing while one runs."""
        if self.running:
            return
        self._job = Job(name, task, request)
        self._job.listen(self._bridge.latest(self._show))
        self._board.start(self._job)
        self.bar.show()
        self.changed.emit()

    def leave(self) -> None:
        """Stop what runs; if nothing does, close the dialog."""
        if self._job is not None and self.running:
            self.note.setText(self.tr("Stopping…"))
            self._job.cancel()
        else:
            self._dialog.done(QDialog.DialogCode.Rejected)

    def ended(self, go: str) -> None:
        """The work is done and told: offer what comes next, or to leave."""
        self.go.setText(go)
        self.go.setAccessibleName(go.replace("&", ""))
        self.stop.setText(self.tr("Close"))
        self.stop.setAccessibleName(self.stop.text())

    def _show(self, status: JobStatus) -> None:
        self.bar.setValue(round(1000 * status.fraction))
        if status.active:
            if status.state is JobState.RUNNING:
                self.note.setText(status.note)
            return
        self.bar.hide()
        self.note.setText(self.tr("Stopped") if status.state is JobState.CANCELLED else "")
        self.changed.emit()
        if status.state is JobState.DONE:
            self.done.emit(dict(status.result))
        elif status.state is JobState.FAILED:
            show_trouble(self._dialog, trouble(status.message, status.details))
