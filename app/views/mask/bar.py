"""The two bars of the mask page: above what one paints with, below what one looks at."""

from collections.abc import Sequence

from PySide6.QtCore import QSignalBlocker, Qt, Signal, SignalInstance
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QButtonGroup,
    QCheckBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QSlider,
    QSpinBox,
    QToolButton,
    QWidget,
)

from app.inspect.falsecolour import MINUS
from app.masking import LARGEST, SMALLEST, TOOLS
from app.views import icons
from app.views.maps.bar import EV_RANGE, EV_STEPS
from app.views.page_actions import action_button

GROWTH = 1.25  # of the brush, by a press of ] or [


def grown(size: int, way: int) -> int:
    """The brush's next size up (way 1) or down (-1): always another."""
    return max(round(size * GROWTH**way), size + 1) if way > 0 else min(round(size / GROWTH), size - 1)


class ToolBar(QFrame):
    """What one paints with."""

    tool_picked = Signal(str)
    side_picked = Signal(bool)  # adds to the object, or takes from it
    exact_picked = Signal(bool)
    size_picked = Signal(int)

    def __init__(self, parent: QWidget, clear: QAction) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 4, 8, 4)
        row.setSpacing(4)
        names = {"brush": self.tr("Brush"), "eraser": self.tr("Eraser"), "polygon": self.tr("Polygon")}
        tips = {
            "brush": self.tr("Paint strokes (B)"),
            "eraser": self.tr("Rub strokes out; the object found stays (E)"),
            "polygon": self.tr("Click corners; Enter or a double click closes, Backspace takes one back (P)"),
        }
        tools, sides = QButtonGroup(self), QButtonGroup(self)  # one of each is down
        self.tools = {tool: self._segment(row, tool, names[tool], tips[tool], tools) for tool in TOOLS}
        row.addSpacing(8)
        self.sides = {
            True: self._segment(
                row, "add", self.tr("Add"), self.tr("Strokes add to the object (A; X swaps)"), sides
            ),
            False: self._segment(
                row,
                "subtract",
                self.tr("Subtract"),
                self.tr("Strokes subtract from the object (R; X swaps)"),
                sides,
            ),
        }
        for tool, button in self.tools.items():
            button.clicked.connect(lambda checked, tool=tool: self.tool_picked.emit(tool))
        for side, button in self.sides.items():
            button.clicked.connect(lambda checked, side=side: self.side_picked.emit(side))
        self.exact = self._segment(
            row, "exact", self.tr("Exact"), self.tr("Just what is painted changes, and nothing around it (T)")
        )
        self.exact.clicked.connect(self.exact_picked)
        row.addSpacing(8)
        self.size_box = QSpinBox()
        self.size_box.setRange(SMALLEST, LARGEST)
        self.size_box.setSuffix(self.tr(" px"))
        self.size_box.setAccessibleName(self.tr("Brush size"))
        self.size_box.setToolTip(self.tr("Brush size, in pixels of the photograph ([ and ])"))
        self.size_box.valueChanged.connect(self.size_picked)
        label = QLabel(self.tr("Si&ze"))
        label.setObjectName("dim")
        label.setBuddy(self.size_box)
        row.addWidget(label)
        row.addWidget(self.size_box)
        row.addSpacing(8)
        row.addWidget(action_button(clear))
        row.addStretch(1)

    def show_tool(self, tool: str, adds: bool, exact: bool, size: int) -> None:
        self.tools[tool].setChecked(True)
        self.sides[adds].setChecked(True)
        self.exact.setChecked(exact)
        for button in (*self.sides.values(), self.exact):
            button.setEnabled(tool != "eraser")
        self.size_box.setEnabled(tool != "polygon")
        with QSignalBlocker(self.size_box):
            self.size_box.setValue(size)

    def _segment(
        self, row: QHBoxLayout, icon: str, text: str, tip: str, group: QButtonGroup | None = None
    ) -> QToolButton:
        button = QToolButton()
        button.setText(text)
        button.setToolTip(tip)
        button.setAccessibleName(text)
        button.setCheckable(True)
        button.setObjectName("segment")
        button.setProperty("narrow", True)
        icons.wear(button, icon)
        button.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        if group is not None:
            group.addButton(button)
        row.addWidget(button)
        return button


class ViewBar(QFrame):
    """What one looks at: the view, its exposure, the overlay."""

    view_picked = Signal(int)  # -1: the mean over the views
    exposed = Signal()
    opacity_picked = Signal(float)
    overlay_wanted = Signal(bool)
    outline_wanted = Signal(bool)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self._names: tuple[str, ...] = ()
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 4, 12, 4)
        row.setSpacing(6)
        self.view = self._slider(
            row, self.tr("&View"), self.tr("Photograph; leftmost: average of all (Page Up and Down, M)")
        )
        self.view.setRange(-1, -1)
        self.view.setPageStep(1)
        self.view.valueChanged.connect(self._pick)
        row.setStretchFactor(self.view, 1)
        self.name = QLabel()
        self.name.setMinimumWidth(self.name.fontMetrics().horizontalAdvance("Mean over the views"))
        row.addWidget(self.name)
        self.ev = self._slider(row, self.tr("&Exposure"), self.tr("Exposure of the photograph, in stops"))
        self.ev.setRange(-EV_RANGE * EV_STEPS, EV_RANGE * EV_STEPS)
        self.ev.setPageStep(EV_STEPS)
        self.ev.setFixedWidth(90)
        self.ev.valueChanged.connect(self._expose)
        self.ev_label = QLabel("0.0 EV")
        self.ev_label.setMinimumWidth(self.ev_label.fontMetrics().horizontalAdvance(f"{MINUS}0.0 EV "))
        row.addWidget(self.ev_label)
        self.opacity = self._slider(row, self.tr("&Opacity"), self.tr("Opacity of the overlay (O, Shift+O)"))
        self.opacity.setRange(0, 10)
        self.opacity.setPageStep(1)
        self.opacity.setValue(6)
        self.opacity.setFixedWidth(80)
        self.opacity.valueChanged.connect(lambda value: self.opacity_picked.emit(value / 10))
        self.overlay = self._check(
            row, self.tr("&Overlay"), self.tr("Show object and strokes (V)"), self.overlay_wanted
        )
        self.outline = self._check(row, self.tr("&Outline"), self.tr("Show the object's outline (L)"), self.outline_wanted)  # fmt: skip

    @property
    def chosen(self) -> int | None:
        """The view; None for the mean."""
        return None if self.view.value() < 0 else self.view.value()

    @property
    def exposure_ev(self) -> float:
        return self.ev.value() / EV_STEPS

    def offer_views(self, names: Sequence[str]) -> None:
        """The views' names; the same number stays chosen where it is there."""
        fresh, self._names = not self._names, tuple(names)
        with QSignalBlocker(self.view):
            self.view.setRange(-1, len(names) - 1)
            if fresh and names:
                self.view.setValue(len(names) // 2)
        self._name()

    def step(self, by: int) -> None:
        """The next or an earlier view, round and round."""
        if self._names:
            self.view.setValue((max(self.view.value(), 0 if by < 0 else -1) + by) % len(self._names))

    def _pick(self, value: int) -> None:
        self._name()
        self.view_picked.emit(value)

    def _name(self) -> None:
        at, count = self.view.value(), len(self._names)
        text = self.tr("Mean over the views") if at < 0 else f"{self._names[at]}  ({at + 1}/{count})"
        self.name.setText(text if count else "")

    def _expose(self, value: int) -> None:
        self.ev_label.setText(f"{value / EV_STEPS:+.1f} EV".replace("-", MINUS) if value else "0.0 EV")
        self.exposed.emit()

    def _slider(self, row: QHBoxLayout, text: str, tip: str) -> QSlider:
        slider = QSlider(Qt.Orientation.Horizontal)
        slider.setAccessibleName(text.replace("&", ""))
        slider.setToolTip(tip)
        label = QLabel(text)
        label.setObjectName("dim")
        label.setBuddy(slider)
        row.addWidget(label)
        row.addWidget(slider)
        return slider

    def _check(self, row: QHBoxLayout, text: str, tip: str, wanted: SignalInstance) -> QCheckBox:
        box = QCheckBox(text)
        box.setChecked(True)
        box.setToolTip(tip)
        box.setAccessibleName(text.replace("&", ""))
        box.toggled.connect(wanted)
        row.addWidget(box)
        return box
