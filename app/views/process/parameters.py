"""The parameters of the chosen stage, with their defaults; a change is told, not made."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QScrollArea,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from app.plan import Parameter, Row
from app.views import icons, theme
from app.views.editors import Field, label, told_default, tooltip
from app.views.process.stages import about, title

LABEL_PX = 190


class ParameterPanel(QWidget):
    """One stage's parameters."""

    edited = Signal(str, object)  # parameter's name, value
    reset = Signal(str)  # the stage all of whose parameters go back to the preset's
    run_until = Signal(str)  # the stage up to which to process

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._row: Row | None = None
        self.fields: dict[str, Field] = {}
        self._defaults: dict[str, QLabel] = {}
        self._names: dict[str, QLabel] = {}
        self._backs: dict[str, QToolButton] = {}
        self.heading = QLabel()
        self.heading.setObjectName("heading")
        self.about = QLabel()
        self.about.setObjectName("dim")
        self.run = QPushButton(self.tr("Process &up to here"))
        self.run.setAccessibleName(self.tr("Process up to this stage"))
        self.run.clicked.connect(self._run)
        self.back = QPushButton(self.tr("&Defaults"))
        self.back.setToolTip(self.tr("Every parameter of this stage as the preset has it"))
        self.back.setAccessibleName(self.tr("Defaults of this stage"))
        self.back.clicked.connect(self._reset)
        self.all = QCheckBox(self.tr("Show &all"))
        self.all.setAccessibleName(self.tr("Show all parameters"))
        self.all.toggled.connect(self._rebuild)
        top = QHBoxLayout()
        words = QVBoxLayout()
        words.setSpacing(1)
        words.addWidget(self.heading)
        words.addWidget(self.about)
        top.addLayout(words, 1)
        top.addWidget(self.all)
        top.addWidget(self.back)
        top.addWidget(self.run)
        self._scroll = QScrollArea()
        self._scroll.setWidgetResizable(True)
        self._scroll.setFrameShape(QFrame.Shape.NoFrame)
        self._scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._scroll.viewport().setAutoFillBackground(False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(16, 8, 12, 4)
        layout.setSpacing(10)
        layout.addLayout(top)
        layout.addWidget(self._scroll, 1)
        self.show_row(None)

    def show_row(self, row: Row | None) -> None:
        """Show a stage; the fields stay when it is the same, so that nothing is lost under the hands."""
        same = row is not None and self._row is not None and row.name == self._row.name
        same = same and set(self.fields) >= set(self._shown(row) if row is not None else ())
        self._row = row
        self.setEnabled(row is not None)
        if not same:
            self._rebuild()
        elif row is not None:
            for parameter in row.parameters:
                if parameter.name in self.fields:
                    self._show(parameter)
        self._mark()

    def _run(self) -> None:
        if self._row is not None:
            self.run_until.emit(self._row.name)

    def _reset(self) -> None:
        if self._row is not None:
            self.reset.emit(self._row.name)

    def _shown(self, row: Row) -> list[str]:
        return [
            p.name for p in row.parameters if self.all.isChecked() or not p.meaning.advanced or p.changed
        ]  # fmt: skip

    def _rebuild(self) -> None:
        for kept in (self.fields, self._defaults, self._names, self._backs):
            kept.clear()
        inside = QWidget()
        grid = QGridLayout(inside)
        grid.setContentsMargins(0, 0, 8, 8)
        grid.setHorizontalSpacing(12)
        grid.setVerticalSpacing(6)
        grid.setColumnMinimumWidth(1, 190)
        grid.setColumnStretch(4, 1)
        row = self._row
        self.heading.setText(title(row.name) if row is not None else "")
        self.about.setText(about(row.name) if row is not None else "")
        names = self._shown(row) if row is not None else []
        for number, parameter in enumerate(p for p in (row.parameters if row else ()) if p.name in names):
            self._add(grid, number, parameter)
        grid.setRowStretch(len(names), 1)
        self._scroll.setWidget(inside)
        self._mark()

    def _add(self, grid: QGridLayout, number: int, parameter: Parameter) -> None:
        field = Field(parameter)
        field.edited.connect(self.edited)
        name = QLabel(label(parameter.meaning))
        name.setToolTip(tooltip(parameter))
        name.setBuddy(field.control)
        name.setFixedWidth(LABEL_PX)  # fields stay in place from stage to stage
        name.setWordWrap(True)
        default = QLabel()
        default.setObjectName("dim")
        back = QToolButton()
        back.setAutoRaise(True)
        back.setAccessibleName(self.tr("{0}: back to the default").format(label(parameter.meaning)))
        back.setToolTip(self.tr("Back to the default"))
        back.setIcon(icons.icon("reset", theme.colours(self).text, 16))
        back.clicked.connect(lambda: self.edited.emit(parameter.name, field.parameter.default))
        for column, part in enumerate((name, field, default)):
            grid.addWidget(part, number, column)
        grid.addWidget(back, number, 3)
        self.fields[parameter.name], self._defaults[parameter.name] = field, default
        self._names[parameter.name], self._backs[parameter.name] = name, back
        self._show(parameter)

    def _show(self, parameter: Parameter) -> None:
        self.fields[parameter.name].show_parameter(parameter)
        font = self._names[parameter.name].font()
        font.setBold(parameter.changed)
        self._names[parameter.name].setFont(font)
        self._defaults[parameter.name].setText(self.tr("default {0}").format(told_default(parameter)))
        for part in (self._defaults[parameter.name], self._backs[parameter.name]):
            part.setVisible(parameter.changed)

    def _mark(self) -> None:
        row = self._row
        self.back.setEnabled(row is not None and any(parameter.changed for parameter in row.parameters))
        advanced = row is not None and any(parameter.meaning.advanced for parameter in row.parameters)
        self.all.setVisible(advanced)
