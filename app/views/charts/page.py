"""The charts page: a list of charts, one of them large, and its numbers to take away."""

import functools
import importlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import (
    QFileDialog,
    QFrame,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QMenu,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app.inspect import charting, maps, runs
from app.inspect.charting import ERRORS, TITLES, Chart
from app.inspect.runs import Run
from app.relight import lights as light_files
from app.state import Trouble
from app.views.background import Background
from app.views.boxes import box_of, widened
from app.views.bridge import Bridge
from app.views.elided import Elided
from app.views.empty import Empty
from app.views.errand import Errand
from app.views.head import Head
from app.views.page_actions import page_action
from app.views.page_column import Either, lay_out
from app.views.pages import Shell, tell
from app.views.readout import told
from app.words import sentence
from engine.io.ground_truth import Truth, read_truth

if TYPE_CHECKING:
    from app.views.charts.view import ChartView

OF_ALL_RUNS = ("errors", "times")
LIST = """QListWidget { padding: 6px; } QListWidget::item { padding: 6px 8px; border-radius: 4px; }
QListWidget::item:selected { background: palette(highlight); color: palette(highlighted-text); }"""
CHILDREN = {"views": "rerender", "coverage": "coverage"}  # charts whose numbers a child works out on demand


class ChartsPage(QWidget):
    """Charts of the open session."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = self.tr("Charts")
        self.setAccessibleName(self.title)
        self._shell: Shell | None = None
        self._session: Path | None = None
        self._runs: tuple[Run, ...] = ()
        self._truth: Truth | None = None
        self._chart: Chart | None = None
        self._view: ChartView | None = None
        self._background = Background(self, "charts")

        self.list = QListWidget()
        self.list.setAccessibleName(self.tr("Charts"))
        self.list.setFixedWidth(210)
        self.list.setStyleSheet(LIST)
        self.list.setFrameShape(QFrame.Shape.NoFrame)
        for key, title in TITLES.items():
            item = QListWidgetItem(told(title))
            item.setData(Qt.ItemDataRole.UserRole, key)
            self.list.addItem(item)
        self.list.setCurrentRow(0)
        self.list.currentRowChanged.connect(lambda row: self.draw())

        self.heading, self.said = QLabel(), QLabel()
        self.heading.setObjectName("heading")
        self.said.setObjectName("dim")
        self.said.setWordWrap(True)
        self.run_box = box_of(self.tr("Run"), 24)
        self.run_box.activated.connect(self._pick_run)
        self.error_box = box_of(self.tr("Error"), 30)
        for key, (title, _, _) in ERRORS.items():
            self.error_box.addItem(told(title), key)
        widened(self.error_box)
        self.error_box.currentIndexChanged.connect(lambda index: self.draw())
        self.truth = QPushButton(self.tr("Ground &truth…"))
        self.truth.setAccessibleName(self.tr("Choose a ground truth"))
        self.truth.setToolTip(
            self.tr("A truth.npz to hold the runs against, as the virtual studio writes it")
        )
        self.truth.clicked.connect(self._ask_truth)
        self.errand = Errand(self)
        self.errand.wanted.connect(self.begin)
        self.errand.heard.connect(lambda event: self.draw() if self.key == "views" else None)
        self.errand.done.connect(lambda task, result: self.draw())
        self.errand.failed.connect(self._tell)
        self.errand.changed.connect(self._show_buttons)
        self.export = QPushButton(self.tr("E&xport"))
        self.export.setAccessibleName(self.tr("Export"))
        self._make_actions()

        head = QHBoxLayout()
        head.setContentsMargins(14, 10, 14, 2)
        head.setSpacing(8)
        head.addWidget(self.heading)
        head.addStretch(1)
        for widget in (
            self.error_box, self.truth, self.run_box, self.errand
        ):  # fmt: skip
            head.addWidget(widget)
        self.said.setContentsMargins(14, 0, 14, 8)
        self.message = Empty("charts")
        self.stack = Either(self.message)
        self.pointed = Elided()
        self.pointed.setAccessibleName(self.tr("Value under the mouse"))
        self.pointed.setContentsMargins(14, 4, 14, 6)
        right = QVBoxLayout()
        right.setContentsMargins(0, 0, 0, 0)
        right.setSpacing(0)
        right.addLayout(head)
        right.addWidget(self.said)
        right.addWidget(self.stack, 1)
        right.addWidget(self.pointed)
        across = QHBoxLayout()
        across.setSpacing(0)
        across.addWidget(self.list)
        across.addLayout(right, 1)
        self.head = Head(self, self.export)
        lay_out(self, self.head, across, spacing=2)
        self._say_nothing()

    # The contract with the window

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self.message.use(shell)
        self._say_nothing()
        self.errand.board = shell.board
        shell.board.listen(Bridge(self).latest(self._look_again))

    def show_session(self, folder: Path | None) -> None:
        """Show a session's charts; returns at once."""
        if folder != self._session:
            self.errand.stop()
            self._session = folder
            self.head.show_session(folder)
            self._runs, self._truth, self._chart = (), None, None
            self._say_nothing()
            if folder is not None:
                self.message.say_reading()
        self.refresh()

    def refresh(self) -> None:
        """Look whether there are new results."""
        folder = self._session
        if folder is None:
            self._background.drop("runs")
            self._say_nothing()
            return
        self._background.ask("runs", lambda: _found(folder), self._show_runs, self._tell)

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self._look_again()

    def _look_again(self) -> None:
        if self._session is not None and self.isVisible():
            self.refresh()

    # Choices

    @property
    def key(self) -> str:
        """The chart that is chosen."""
        return self.list.currentItem().data(Qt.ItemDataRole.UserRole)

    @property
    def chart(self) -> Chart | None:
        """What is drawn."""
        return self._chart

    def draw(self) -> None:
        """Work the chosen chart out, off the window's thread, and draw it."""
        self._show_buttons()
        if not self._runs or not self.isVisible():
            return
        found, truth = self._runs, self._truth
        run = found[max(self.run_box.currentIndex(), 0)]
        makers: dict[str, Callable[[], Chart]] = {
            "errors": functools.partial(charting.errors, found, self.error_box.currentData(), truth),
            "times": functools.partial(charting.stage_times, found),
            "settling": functools.partial(charting.settling, run),
            "coverage": lambda: charting.coverage(light_files.load(run)),
            "views": lambda: charting.view_residuals(maps.load(run)),
            "exposures": lambda: charting.exposures(maps.load(run)),
            "distance": lambda: charting.distance(run, maps.load(run)),
        }
        make = makers[self.key]

        def work() -> Chart:
            # pyqtgraph takes a second: loaded here, the window does not stand still for it.
            importlib.import_module("app.views.charts.view")
            return make()

        self._background.ask("chart", work, self._show, self._say_nothing)

    def _pick_run(self, index: int) -> None:
        self.errand.stop()
        self.draw()

    def _ask_truth(self) -> None:
        start = str(self._session.parent if self._session else Path.home())
        chosen, _ = QFileDialog.getOpenFileName(self, self.tr("Truth"), start, self.tr("Truth (*.npz)"))
        if chosen:
            self.use_truth(Path(chosen))

    def use_truth(self, path: Path) -> None:
        """Hold the runs against a truth."""

        def got(truth: Truth) -> None:
            self._truth = truth
            at = self.error_box.findData("truth")
            if self.error_box.currentIndex() == at:
                self.draw()
            self.error_box.setCurrentIndex(at)

        self._background.ask("truth", lambda: read_truth(path), got, self._tell)

    # Export

    def save_csv(self, to: Path) -> None:
        """The chart's numbers."""
        chart = self._chart
        if chart is not None:
            self._write(to, lambda: to.write_text(charting.as_csv(chart)))

    def save_picture(self, to: Path) -> None:
        """The chart as PNG or SVG, by the file's name."""
        view = self._view
        if view is not None:
            self._write(to, lambda: view.save(to))

    def _write(self, to: Path, write: Callable[[], object]) -> None:
        try:
            write()
        except OSError as error:
            self._tell(
                Trouble(
                    f"{to}: {error.strerror or error}", self.tr("choose another folder, or check the disk")
                )
            )

    def _make_actions(self) -> None:
        menu = QMenu(self.export)
        for text, suffix, keys, save in (
            (self.tr("Picture (PNG)…"), "png", "Ctrl+Shift+S", self.save_picture),
            (self.tr("Drawing (SVG)…"), "svg", "", self.save_picture),
            (self.tr("Numbers (CSV)…"), "csv", "Ctrl+Shift+C", self.save_csv),
        ):
            menu.addAction(page_action(self, text, keys, functools.partial(self._save_as, suffix, save)))
        page_action(self, self.tr("Look for new results"), "F5", self.refresh)
        self.export.setMenu(menu)

    def _save_as(self, suffix: str, save: Callable[[Path], None]) -> None:
        if self._chart is None or self._session is None:
            return
        start = str(self._session.parent / f"{self.key}.{suffix}")
        to, _ = QFileDialog.getSaveFileName(
            self, self.tr("Export chart"), start, f"{suffix.upper()} (*.{suffix})"
        )
        if to:
            save(Path(to))

    def begin(self) -> None:
        """Let a child work out what this chart needs."""
        if self.errand.busy or not self._runs:
            return
        run = self._runs[max(self.run_box.currentIndex(), 0)]
        request = {"session": str(run.session), "fingerprint": run.fingerprint, "view": 0}
        self.errand.begin(self.heading.text(), CHILDREN[self.key], request)

    # What arrives

    def _show_runs(self, answer: tuple[tuple[Run, ...], Truth | None]) -> None:
        found, truth = answer
        if not found:
            self._runs = ()
            self._say_nothing()
            return
        if [(run.fingerprint, run.name) for run in found] != [
            (run.fingerprint, run.name) for run in self._runs
        ]:
            self.run_box.clear()
            for name in runs.names(found):
                self.run_box.addItem(name)
            chosen = runs.current(found)
            self.run_box.setCurrentIndex(0 if chosen is None else found.index(chosen))
            widened(self.run_box)
        self._runs = found
        self._truth = self._truth or truth
        self.draw()

    def _show(self, chart: Chart) -> None:
        self.pointed.setText("")
        if chart.missing:
            self.message.say(Trouble(told(sentence(chart.missing))))
            self.stack.setCurrentWidget(self.message)
        elif self._view is None:
            self._make_view()
            session = self._session
            # Making, drawing and painting each take their time: a turn of the event loop for each.
            QTimer.singleShot(0, self, lambda: self._show(chart) if session == self._session else None)
            return
        else:
            self._view.show_chart(chart)
            self.stack.setCurrentWidget(self._view)
        self._chart = chart
        self.heading.setText(told(chart.title))
        self.said.setText(said(chart))
        self._show_buttons()

    def _make_view(self) -> None:
        from app.views.charts.view import ChartView

        self._view = ChartView(self)
        self._view.pointed.connect(self.pointed.setText)
        self.stack.addWidget(self._view)

    def _show_buttons(self) -> None:
        key = self.key
        there = bool(self._runs)
        self.error_box.setVisible(there and key == "errors")
        self.truth.setVisible(there and key == "errors")
        self.run_box.setVisible(there and key not in OF_ALL_RUNS)
        offered = ""
        if there and self._lacks():
            offered = self.tr("&Re-render all views") if key == "views" else self.tr("Com&pute")
        self.errand.offer(offered)
        self.export.setEnabled(self._chart is not None and not self._chart.missing)

    def _lacks(self) -> bool:
        """Whether a child could add to this chart."""
        chart = self._chart
        return chart is not None and chart.key == self.key and chart.lacking and self.key in CHILDREN

    def _say_nothing(self, fault: Trouble | None = None) -> None:
        self._chart = None
        self.heading.clear()
        self.said.clear()
        self.message.say_nothing_yet(self._session, fault)
        self.stack.setCurrentWidget(self.message)
        self._show_buttons()

    def _tell(self, fault: Trouble) -> None:
        tell(self._shell, self, fault)


def said(chart: Chart) -> str:
    """The sentence under the title, in the person's language."""
    return told(chart.said).format(**chart.facts)


def _found(session: Path) -> tuple[tuple[Run, ...], Truth | None]:
    path = charting.known_truth(session)
    return runs.runs_of(session), None if path is None else read_truth(path)
