"""The panel beside the 3D view: layers with check boxes, how each is shown, where to look from. Emits what is wanted."""

import math

from PySide6.QtCore import QCoreApplication, QLocale, Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QButtonGroup,
    QCheckBox,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QSlider,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from app.inspect.falsecolour import Scale
from app.viewer import showing
from app.viewer.showing import Showing
from app.views.column import Column
from app.views.legend import Legend
from app.views.page_actions import tell_keys

WIDTH = 262
EV_STEPS = 2  # of the slider, per stop
EV_RANGE = 6
SIZE_STEPS = 4  # of the slider, per doubling
SIZE_RANGE = 3
MINUS = "\N{MINUS SIGN}"
PLAIN = """QToolButton { padding: 3px 6px; border: 1px solid palette(mid); border-radius: 3px; }
QToolButton:hover { background: palette(button); }
QToolButton:pressed { background: palette(mid); }
QToolButton:focus { border-color: palette(highlight); }"""


class ViewPanel(QFrame):
    """Shows a `Showing`; every widget is named by what it changes."""

    layer_toggled = Signal(str, bool)
    surface_chosen = Signal(str)
    emitters_chosen = Signal(str)
    exposure_changed = Signal(float)
    frusta_changed = Signal(float)
    front_opened = Signal(bool)
    view_chosen = Signal(int)

    def __init__(self, parent: QWidget | None, actions: dict[str, QAction]) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self._actions = actions
        self.layers: dict[str, QCheckBox] = {}
        self.counts: dict[str, QLabel] = {}
        self._column = QVBoxLayout()
        self._column.setContentsMargins(14, 10, 12, 10)
        self._column.setSpacing(5)
        self._build()
        inside = QWidget()
        inside.setLayout(self._column)
        scroll = Column(inside, WIDTH, self)
        scroll.setAccessibleName(self.tr("Layers and view"))
        for part in (inside, scroll.viewport()):
            part.setAutoFillBackground(False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(scroll, 1)

    def show_state(self, state: Showing) -> None:
        """Everything as it is; emits nothing."""
        contents, style = state.contents, state.style
        locale = QLocale()
        counts = {
            "surface": (contents.triangles, self.tr("{0} triangles")),
            "emitters": (contents.emitters, "{0}"),
            "lamps": (contents.lamps, "{0}"),
            "cameras": (len(showing.registered(contents)), "{0}"),
            "points": (contents.points, "{0}"),
        }
        for name, box in self.layers.items():
            count, text = counts.get(name, (1, ""))
            box.blockSignals(True)
            box.setChecked(name in style.visible and count > 0)
            box.blockSignals(False)
            box.setEnabled(count > 0)
            if name in self.counts:
                none = self.tr("none") if contents.folder else ""
                self.counts[name].setText(text.format(locale.toString(count)) if count else none)
        self._show_surface(state)
        for key, button in self.ways.items():
            button.setChecked(key == style.emitters)
            button.setEnabled(contents.emitters > 0)
        self.exposure.blockSignals(True)
        self.exposure.setValue(round(style.exposure_ev * EV_STEPS))
        self.exposure.blockSignals(False)
        self.exposure.setEnabled(contents.emitters + contents.lamps > 0)
        self.stops.setText(f"{style.exposure_ev:+.1f} EV".replace("-", MINUS))
        self.frusta.blockSignals(True)
        self.frusta.setValue(round(math.log2(style.frusta) * SIZE_STEPS))
        self.frusta.blockSignals(False)
        self.frusta.setEnabled(bool(showing.registered(contents)) and "cameras" in style.visible)
        self.front.blockSignals(True)
        self.front.setChecked(style.open_front)
        self.front.blockSignals(False)
        self.front.setEnabled(contents.emitters > 0)
        self._show_views(state)

    def show_renderer(self, text: str) -> None:
        """For who asks; nobody else needs it."""
        self.layers["surface"].setToolTip(text)

    # Building

    def _build(self) -> None:
        self._layer("surface", self.tr("Surface"), bold=True)
        self.surface = QComboBox()
        self.surface.setAccessibleName(self.tr("Surface layer"))
        self.surface.activated.connect(lambda i: self.surface_chosen.emit(self.surface.itemData(i)))
        self._inside(self.surface)
        self.legend = Legend()
        self._inside(self.legend)
        self._gap()
        self._layer("emitters", self.tr("Room light (Gaussians)"), bold=True)
        row = QHBoxLayout()
        row.setSpacing(4)
        self.ways: dict[str, QToolButton] = {}
        group = QButtonGroup(self)
        for key, text, tip in (
            ("points", self.tr("Points"), self.tr("Each Gaussian as a dot, larger where it is brighter")),
            ("ellipsoids", self.tr("Ellipsoids"), self.tr("The brightest Gaussians in their shape and size")),
            (
                "splats",
                self.tr("Splats"),
                self.tr("The room as the photographs see it; sharp once the view rests"),
            ),
        ):
            button = QToolButton()
            button.setText(text)
            button.setToolTip(tip)
            button.setAccessibleName(self.tr("Emitters as {0}").format(text.lower()))
            button.setCheckable(True)
            button.setObjectName("segment")
            button.setProperty("narrow", True)
            button.clicked.connect(lambda checked, key=key: self.emitters_chosen.emit(key))
            group.addButton(button)
            row.addWidget(button, 1)
            self.ways[key] = button
        self._inside(row)
        row = QHBoxLayout()
        self.exposure = QSlider(Qt.Orientation.Horizontal)
        self.exposure.setRange(-EV_RANGE * EV_STEPS, EV_RANGE * EV_STEPS)
        self.exposure.setPageStep(EV_STEPS)
        self.exposure.setAccessibleName(self.tr("Brightness of the light"))
        self.exposure.setToolTip(self.tr("Brightness of emitters and lamps on the screen, in stops"))
        self.exposure.valueChanged.connect(lambda value: self.exposure_changed.emit(value / EV_STEPS))
        self.stops = QLabel("+0.0 EV")
        self.stops.setMinimumWidth(self.stops.fontMetrics().horizontalAdvance("+0.0 EV") + 2)
        self.stops.setAlignment(Qt.AlignmentFlag.AlignRight)
        row.addWidget(self.exposure, 1)
        row.addWidget(self.stops)
        self._inside(row)
        self.front = QCheckBox(self.tr("Cut away the near side"))
        self.front.setAccessibleName(self.tr("Cut away the near side"))
        self.front.setToolTip(self.tr("Leave out the emitters between the eye and the cameras"))
        self.front.toggled.connect(self.front_opened)
        self._inside(self.front)
        self._layer("lamps", self.tr("Lamps"))
        self._gap()
        self._layer("cameras", self.tr("Cameras"), bold=True)
        row = QHBoxLayout()
        row.addWidget(QLabel(self.tr("Size")))
        self.frusta = QSlider(Qt.Orientation.Horizontal)
        self.frusta.setRange(-SIZE_RANGE * SIZE_STEPS, SIZE_RANGE * SIZE_STEPS)
        self.frusta.setPageStep(SIZE_STEPS)
        self.frusta.setAccessibleName(self.tr("Size of the cameras"))
        self.frusta.setToolTip(self.tr("How large the cameras are drawn"))
        self.frusta.valueChanged.connect(lambda value: self.frusta_changed.emit(2.0 ** (value / SIZE_STEPS)))
        row.addWidget(self.frusta, 1)
        self._inside(row)
        row = QHBoxLayout()
        row.setSpacing(4)
        self.views = QComboBox()
        self.views.setAccessibleName(self.tr("View"))
        self.views.setToolTip(self.tr("The surface stands where it was in this view"))
        self.views.setMaxVisibleItems(24)
        self.views.activated.connect(lambda i: self.view_chosen.emit(self.views.itemData(i)))
        row.addWidget(self.views, 1)
        for key, arrow in (("previous", Qt.ArrowType.LeftArrow), ("next", Qt.ArrowType.RightArrow)):
            row.addWidget(self._button(key, arrow))
        self._inside(row)
        row = QHBoxLayout()
        row.setSpacing(4)
        row.addWidget(self._button("photograph"), 1)
        row.addWidget(self._button("through"), 1)
        self._inside(row)
        self._gap()
        for key, text in (
            ("points", self.tr("Sparse points")),
            ("axes", self.tr("World axes")),
            ("grid", self.tr("Ground grid")),
        ):
            self._layer(key, text)
        self._gap()
        grid = QGridLayout()
        grid.setSpacing(4)
        for k, key in enumerate(("front", "left", "top", "back", "right", "bottom")):
            grid.addWidget(self._button(key), k // 3, k % 3)
        for k, key in enumerate(("reset", "object", "everything")):
            grid.addWidget(self._button(key), 2, k)
        for column in range(3):
            grid.setColumnStretch(column, 1)
        self._column.addLayout(grid)
        self._column.addStretch(1)

    def _layer(self, name: str, text: str, bold: bool = False) -> None:
        box = QCheckBox(text)
        box.setAccessibleName(text)
        font = box.font()
        font.setBold(bold)
        box.setFont(font)
        box.toggled.connect(lambda shown: self.layer_toggled.emit(name, shown))
        self.layers[name] = box
        row = QHBoxLayout()
        row.addWidget(box, 1)
        if name not in ("axes", "grid"):
            count = QLabel()
            count.setObjectName("dim")
            self.counts[name] = count
            row.addWidget(count)
        self._column.addLayout(row)

    def _button(self, key: str, arrow: Qt.ArrowType | None = None) -> QToolButton:
        """A button for one of the page's actions."""
        action = self._actions[key]
        button = QToolButton()
        button.setDefaultAction(action)
        button.setStyleSheet(PLAIN)
        button.setSizePolicy(
            button.sizePolicy().horizontalPolicy().Expanding, button.sizePolicy().verticalPolicy()
        )
        button.setAccessibleName(action.toolTip())
        tell_keys(button, action)
        if arrow is not None:
            button.setArrowType(arrow)
            button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonIconOnly)
            button.setSizePolicy(
                button.sizePolicy().horizontalPolicy().Fixed, button.sizePolicy().verticalPolicy()
            )
        return button

    def _inside(self, part: QWidget | QHBoxLayout) -> None:
        """Under its layer, a little to the right."""
        row = QHBoxLayout()
        row.setContentsMargins(22, 0, 0, 0)
        if isinstance(part, QWidget):
            row.addWidget(part, 1)
        else:
            row.addLayout(part, 1)
        self._column.addLayout(row)

    def _gap(self) -> None:
        line = QFrame()
        line.setFrameShape(QFrame.Shape.HLine)
        line.setFrameShadow(QFrame.Shadow.Plain)
        line.setStyleSheet("color: palette(mid);")
        self._column.addSpacing(3)
        self._column.addWidget(line)
        self._column.addSpacing(3)

    # Showing

    def _show_surface(self, state: Showing) -> None:
        names = state.contents.surfaces
        if [self.surface.itemData(i) for i in range(self.surface.count())] != list(names):
            self.surface.clear()
            for name in names:
                self.surface.addItem(title(name), name)
        self.surface.setEnabled(bool(names))
        self.surface.setCurrentIndex(self.surface.findData(state.style.surface))
        legend = state.contents.legends.get(state.style.surface)
        if legend is not None:
            self.legend.show_scale(Scale(legend.low, legend.high, legend.unit, legend.colours))
        elif state.style.surface == "normals":
            self.legend.show_scale(None, self.tr("red right, green up"), "normal")
        self.legend.setVisible(bool(names) and (legend is not None or state.style.surface == "normals"))

    def _show_views(self, state: Showing) -> None:
        contents = state.contents
        views = showing.registered(contents)
        if [self.views.itemData(i) for i in range(self.views.count())] != views:
            self.views.clear()
            for view in views:
                self.views.addItem(contents.names[view] if view < len(contents.names) else str(view), view)
        self.views.setEnabled(bool(views))
        self.views.setCurrentIndex(self.views.findData(showing.standing(state)))


def title(surface: str) -> str:
    """A surface layer's name for people."""
    known = {
        "shaded": QCoreApplication.translate("ViewPanel", "Shaded"),
        "albedo": QCoreApplication.translate("ViewPanel", "Albedo"),
        "normals": QCoreApplication.translate("ViewPanel", "Normals"),
        "roughness": QCoreApplication.translate("ViewPanel", "Roughness"),
        "confidence": QCoreApplication.translate("ViewPanel", "Uncertainty of normals"),
        "relit": QCoreApplication.translate("ViewPanel", "Relit"),
    }
    return known.get(surface, surface)
