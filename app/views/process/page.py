"""The Process page: stages, parameters, the run under way, its log, and the queue."""

from pathlib import Path

from PySide6.QtCore import QEvent, Qt, QTimer
from PySide6.QtGui import QFontDatabase, QResizeEvent, QShowEvent, QUndoStack
from PySide6.QtWidgets import (
    QHBoxLayout,
    QPlainTextEdit,
    QPushButton,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from app import plan as plans
from app.processing import LOG_LINES, CardState, Processing, left_s
from app.state import Device, place_of, trouble
from app.views.bridge import Bridge
from app.views.editors import label
from app.views.empty import Empty
from app.views.page_actions import page_action
from app.views.page_column import Either, lay_out
from app.views.pages import Shell
from app.views.process.bar import RunBar
from app.views.process.made import told_made
from app.views.process.parameters import ParameterPanel
from app.views.process.queue import QueuePanel
from app.views.process.settings_edit import SettingsEdit
from app.views.process.stages import StageColumn, title
from app.views.side_picture import SidePicture
from app.views.trouble import show_trouble
from app.views.verdict import Verdict
from app.work.enquiries import Answer
from app.work.jobs import JobState
from engine.pipeline.settings import Settings

LOG_EVERY_MS = 120


class ProcessPage(QWidget):
    """One session's processing."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = self.tr("Process")
        self.undo_stack = QUndoStack(self)
        self._bridge = Bridge(self)
        self._shell: Shell | None = None
        self._folder: Path | None = None
        self._stage = self._made = ""  # the stage that is chosen; the result that is shown
        self._failed: str | None = None  # the failure that was told, so that it is told once
        self.model: Processing | None = None
        self._build()
        self._log_timer = QTimer(self)
        self._log_timer.setSingleShot(True)
        self._log_timer.setInterval(LOG_EVERY_MS)
        self._log_timer.timeout.connect(self._show_log)

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.empty.use(shell)
        self.empty.say_nothing_yet(None)
        self.model = Processing(shell.enquiries, shell.board, self._bridge.queued)
        self.model.answered.listen(lambda number: self._show_plan())
        self.model.job.listen(lambda status: self._show_job())
        self.model.trouble.listen(lambda trouble: self._show_trouble())
        self.model.added.listen(self._log_grew)
        self.model.preview.listen(lambda preview: self._show_made())
        self.queue = QueuePanel(self, shell.board, lambda: shell.settings.value.last_folder)
        self.queue.added.connect(self._enqueue)
        self.queue.scheduler.setText(shell.settings.value.scheduler)
        self.queue.scheduler_given.connect(lambda address: shell.settings.change(scheduler=address))
        self.queue.chosen.connect(shell.wishes.open_session)
        self.tabs.addTab(self.queue, self.tr("Queue"))
        shell.board.listen(self._bridge.latest(self._show_job))
        shell.enquiries.ask("gpu", self._bridge.queued(self._take_gpu))
        self.show_session(shell.state.session.value)

    def show_session(self, folder: Path | None) -> None:
        if self.model is None:
            return
        if folder != self._folder:
            self._folder = folder
            self.bar.head.show_session(folder)
            self.undo_stack.clear()
            self._failed = None
            self.model.open(folder)
            self._show_log()
        else:
            self.model.refresh()
        self._show_plan()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self._plan_again()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.made.fit(self.width())

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() is QEvent.Type.ActivationChange and self.isActiveWindow():
            self._plan_again()

    def _plan_again(self) -> None:
        """Another page or the command line may have changed what is up to date."""
        if self.model is not None and self._folder is not None and self.isVisible():
            self.model.refresh()

    def _build(self) -> None:
        self.start = page_action(self, self.tr("&Process"), "F5", self._process)
        self.stop = page_action(self, self.tr("&Cancel processing"), "Ctrl+.", self._cancel)
        self.stop.setIconText(self.tr("&Cancel"))
        for action in (self.start, self.stop):
            action.setShortcutContext(Qt.ShortcutContext.WindowShortcut)  # from the rail too
        self.bar = RunBar(self, self.start, self.stop)
        self.bar.preset_chosen.connect(self._edit_preset)
        self.bar.seed_chosen.connect(self._edit_seed)
        self.column = StageColumn()
        self.column.chosen.connect(self._choose)
        self.parameters = ParameterPanel()
        self.parameters.edited.connect(self._edit)
        self.parameters.reset.connect(self._reset)
        self.parameters.run_until.connect(self._process_until)
        self.log = QPlainTextEdit()
        self.log.setReadOnly(True)
        self.log.setMaximumBlockCount(LOG_LINES)
        self.log.setObjectName("plain")
        self.log.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.log.setAccessibleName(self.tr("Log"))
        self.log.setPlaceholderText(self.tr("What the run says appears here."))
        self.tabs = QTabWidget()
        self.tabs.setDocumentMode(True)
        self.tabs.setAccessibleName(self.tr("Log and queue"))
        self.tabs.addTab(self.log, self.tr("Log"))
        self.made = SidePicture(self.tr("What this stage made"))
        self.empty = Empty("process")
        stage = QWidget()
        row = QHBoxLayout(stage)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.parameters, 1)
        row.addWidget(self.made)
        self.upper = Either(self.empty, stage)
        self.right = QSplitter(Qt.Orientation.Vertical)
        self.right.addWidget(self.upper)
        self.right.addWidget(self.tabs)
        self.right.setSizes([420, 220])
        self.right.setStretchFactor(0, 1)
        self.right.setChildrenCollapsible(False)
        self.side = QWidget()
        column = QVBoxLayout(self.side)
        column.setContentsMargins(12, 0, 0, 8)
        column.addWidget(self.column)
        self.across = QSplitter()
        self.across.addWidget(self.side)
        self.across.addWidget(self.right)
        self.across.setSizes([330, 800])
        self.across.setStretchFactor(1, 1)
        self.across.setChildrenCollapsible(False)
        self.verdict = Verdict()
        self.onward = self._make_onward()
        lay_out(self, self.bar, self.verdict, self.onward, self.across)
        self._show_plan()

    def _make_onward(self) -> QWidget:
        """Where the results are, once they are there."""
        onward = QWidget()
        row = QHBoxLayout(onward)
        row.setContentsMargins(16, 0, 16, 8)
        self.leads = {}
        for key, text in (
            ("maps", self.tr("See &maps")), ("view3d", self.tr("See in &3D")), ("relight", self.tr("Re&light")),
            ("export", self.tr("E&xport")),
        ):  # fmt: skip
            button = QPushButton(text)
            button.setAccessibleName(text.replace("&", ""))
            button.clicked.connect(lambda checked=False, key=key: self._lead_to(key))
            row.addWidget(button)
            self.leads[key] = button
        row.addStretch()
        onward.hide()
        return onward

    def _lead_to(self, key: str) -> None:
        if self._shell is not None:
            self._shell.wishes.show_page.emit(key)

    # --- model to widget

    def _take_gpu(self, answer: Answer) -> None:
        if self._shell is not None and answer.content is not None and answer.content["name"]:
            self._shell.state.set_device(Device("gpu", answer.content["name"]))

    def _show_plan(self) -> None:
        plan = self.model.plan.value if self.model is not None else None
        self.upper.setCurrentIndex(self._folder is not None)
        self.side.setVisible(self._folder is not None)
        self.bar.show_settings(plan.settings if plan is not None else None)
        self.verdict.show_quality(plan.quality if plan is not None else None)
        self._show_job()
        self._show_parameters()

    def _show_job(self) -> None:
        if self.model is None:
            self.start.setEnabled(False)
            self.stop.setEnabled(False)
            return
        cards, status = self.model.cards, self.model.job.value
        self.column.show_cards(cards)
        busy = self._folder is not None and self.model.busy(self._folder)
        elsewhere = self._shell is not None and any(job.status.active for job in self._shell.board.queue)
        self.bar.show_queued(elsewhere and not busy)
        possible = bool(cards) and not busy and any(card.state is not CardState.DONE for card in cards)
        self.start.setEnabled(possible)
        self.parameters.run.setEnabled(possible)
        self.onward.setVisible(bool(cards) and all(card.state is CardState.DONE for card in cards))
        stoppable = status is not None and status.state in (JobState.RUNNING, JobState.QUEUED)
        self.stop.setEnabled(busy and stoppable)
        self._show_left()
        if status is not None and status.state is JobState.FAILED and status.message != self._failed:
            self._failed = status.message
            if self.isVisible():
                show_trouble(self, trouble(status.message, status.details))
        elif status is not None and status.state is JobState.RUNNING:
            self._failed = None

    def _show_left(self) -> None:
        assert self.model is not None
        cards, status = self.model.cards, self.model.job.value
        if not cards:
            text = (
                self.tr("planning…") if self._folder is not None and self.model.trouble.value is None else ""
            )
        elif status is not None and status.state is JobState.QUEUED:
            text = self.tr("waits in the queue")
        elif status is not None and status.active:
            left = left_s(cards)
            text = (
                self.tr("running")
                if left is None
                else self.tr("about {0} left").format(plans.told_seconds(left))
            )
        else:
            stale = sum(card.state is not CardState.DONE for card in cards)
            text = (
                self.tr("{0} of {1} stages will run").format(stale, len(cards))
                if stale
                else self.tr("all done")
            )
        self.bar.left.setText(text)

    def _show_parameters(self) -> None:
        plan = self.model.plan.value if self.model is not None else None
        row = next((row for row in plan.rows if row.name == self._stage), None) if plan is not None else None
        self.parameters.show_row(row)
        self._show_made()

    def _show_made(self) -> None:
        """The running stage's picture so far, or else what the chosen stage made."""
        if self.model is None or self._shell is None or self._folder is None:
            self.made.clear()
            return
        plan, preview, stage = self.model.plan.value, self.model.preview.value, self._stage
        row = next((row for row in plan.rows if row.name == stage), None) if plan is not None else None
        result = row.folder if row is not None and row.done and preview is None else ""
        if preview is not None:
            said = self.tr("Normals so far, {0}. look. The solve goes on.").format(preview.number)
            self.made.show_file(preview.file, said)
        elif not result:
            self.made.clear()
        elif result != self._made:
            take = self._bridge.queued(lambda answer: self._take_made(result, stage, answer))
            self._shell.enquiries.ask("made", take, session=str(self._folder), stage=stage)
        self._made = result

    def _take_made(self, result: str, stage: str, answer: Answer) -> None:
        # What cannot be pictured is said where it is opened.
        if result == self._made:
            content = answer.content or {}
            if content.get("picture") is None:
                self.made.clear()
            else:
                self.made.show_file(Path(content["picture"]), told_made(stage, content["facts"]))

    def _show_trouble(self) -> None:
        assert self.model is not None
        self._show_left()
        if self.model.trouble.value is not None and self._shell is not None:
            self._shell.wishes.trouble.emit(self.model.trouble.value)

    def _log_grew(self, line: str) -> None:
        # A run that says much is shown in strides: painting each line would cost the window its breath.
        if not self._log_timer.isActive():
            self._log_timer.start()

    def _show_log(self) -> None:
        if self.model is None:
            return
        text = "\n".join(self.model.log)
        before = self.log.toPlainText()
        if text.startswith(before) and before:
            added = text[len(before) :].lstrip("\n")
            if added:
                self.log.appendPlainText(added)
        else:
            self.log.setPlainText(text)
            self.log.moveCursor(self.log.textCursor().MoveOperation.End)

    # --- widget to model

    def _choose(self, stage: str) -> None:
        self._stage = stage
        self._show_parameters()

    def _edit(self, name: str, value: object) -> None:
        parameter = self.model.plan.value.parameter(name) if self.model and self.model.plan.value else None
        if parameter is None or self.model is None or self.model.settings is None:
            return
        text = self.tr("{0}: {1}").format(title(name.split(".")[0]), label(parameter.meaning))
        self._push(plans.with_value(self.model.settings, parameter, value), text, name)

    def _edit_preset(self, preset: str) -> None:
        if self.model is not None and self.model.settings is not None:
            self._push(
                plans.with_preset(self.model.settings, preset), self.tr("preset {0}").format(preset), "preset"
            )

    def _edit_seed(self, seed: int) -> None:
        if self.model is not None and self.model.settings is not None:
            self._push(plans.with_seed(self.model.settings, seed), self.tr("seed {0}").format(seed), "seed")

    def _reset(self, stage: str) -> None:
        if self.model is not None and self.model.settings is not None:
            text = self.tr("defaults of {0}").format(title(stage))
            self._push(plans.without_changes(self.model.settings, stage), text, f"defaults {stage}")

    def _push(self, after: Settings, text: str, what: str) -> None:
        assert self.model is not None
        before = self.model.settings
        if before is not None and after != before:
            self.undo_stack.push(SettingsEdit(text, what, before, after, self.model.edit))

    def _process(self) -> None:
        self._process_until(None)

    def _process_until(self, stage: str | None) -> None:
        if self.model is not None and self._shell is not None:
            self._failed = None
            chosen = self._shell.settings.value
            self.model.process(chosen.device, stage, chosen.scheduler)

    def _cancel(self) -> None:
        if self.model is not None:
            self.model.cancel()

    def _enqueue(self, folder: Path) -> None:
        place = place_of(folder)
        if self.model is None or self._shell is None:
            return
        if place.kind != "session":
            self._shell.wishes.say.emit(self.tr("{0} is not a session").format(folder))
        elif not self.model.busy(place.folder):
            chosen = self._shell.settings.value
            self.model.enqueue(place.folder, chosen.device, scheduler=chosen.scheduler)
