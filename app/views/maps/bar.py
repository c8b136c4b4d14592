"""The bar of the maps page: how to look (maps, swipe, compare), which run, which view, exposure, and a menu of the rest."""

from collections.abc import Callable, Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction, QActionGroup
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QMenu,
    QPushButton,
    QSlider,
    QToolButton,
    QWidget,
)

from app.inspect.falsecolour import MINUS
from app.inspect.maps import Maps
from app.views import icons
from app.views.boxes import box_of, widened
from app.views.maps.grid import ARRANGEMENTS
from app.views.maps.panel import Showing
from app.views.page_actions import page_action
from app.views.pictures.viewport import Viewport

EV_STEPS = 3  # of the slider, per stop
EV_RANGE = 6


class MapsBar(QFrame):
    """Shows and tells choices; keeps how pictures are drawn."""

    mode_picked = Signal(int)  # 0 maps, 1 swipe, 2 compare
    run_picked = Signal(int)
    changed = Signal()  # view, exposure, or how it is drawn
    arranged = Signal(int)  # panels
    save_wanted = Signal()
    copy_wanted = Signal()
    name_wanted = Signal()
    scale_wanted = Signal()
    mark_wanted = Signal()
    refresh_wanted = Signal()

    def __init__(self, parent: QWidget, viewport: Viewport) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self._viewport = viewport
        self._frame, self._tone = "opengl", "srgb"
        row = QHBoxLayout(self)
        row.setContentsMargins(8, 4, 8, 4)
        row.setSpacing(6)
        self.modes: list[QToolButton] = []
        for mode, icon, text, tip in (
            (0, "grid", self.tr("Maps"), self.tr("All maps, linked (G)")),
            (1, "swipe", self.tr("Swipe"), self.tr("Photograph against re-rendering (S)")),
            (2, "compare", self.tr("Compare"), self.tr("Two runs or two sessions (C)")),
        ):
            button = QToolButton()
            button.setText(text)
            button.setToolTip(tip)
            button.setAccessibleName(text)
            button.setCheckable(True)
            button.setAutoExclusive(True)
            button.setObjectName("segment")
            button.setProperty("narrow", True)
            icons.wear(button, icon)
            button.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            button.clicked.connect(lambda checked, mode=mode: self.mode_picked.emit(mode))
            row.addWidget(button)
            self.modes.append(button)
        self.modes[0].setChecked(True)
        row.addSpacing(8)
        self.run_box = box_of(self.tr("Run"), 20)
        self.run_box.activated.connect(self.run_picked)
        self.view_box = box_of(self.tr("View"), 16)
        self.view_box.setMaxVisibleItems(24)
        self.view_box.currentIndexChanged.connect(lambda index: self.changed.emit())
        self._labelled(row, self.tr("&View"), self.view_box)
        for way, name, by in (
            (Qt.ArrowType.LeftArrow, self.tr("Previous view"), -1),
            (Qt.ArrowType.RightArrow, self.tr("Next view"), 1),
        ):
            arrow = QToolButton()
            arrow.setArrowType(way)
            arrow.setAutoRaise(True)
            arrow.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            arrow.setAccessibleName(name)
            arrow.setToolTip(name)
            arrow.clicked.connect(lambda checked, by=by: self.step_view(by))
            row.addWidget(arrow)
        row.addStretch(1)
        self.ev = QSlider(Qt.Orientation.Horizontal)
        self.ev.setRange(-EV_RANGE * EV_STEPS, EV_RANGE * EV_STEPS)
        self.ev.setPageStep(EV_STEPS)
        self.ev.setMinimumWidth(44)
        self.ev.setMaximumWidth(100)
        self.ev.setAccessibleName(self.tr("Exposure"))
        self.ev.setToolTip(
            self.tr("Exposure of photographs and re-renderings, in stops (E, Shift+E; Shift+0 resets)")
        )
        self.ev.valueChanged.connect(self._expose)
        self._labelled(row, self.tr("&Exposure"), self.ev)
        self.ev_label = QLabel("0.0 EV")
        self.ev_label.setMinimumWidth(self.ev_label.fontMetrics().horizontalAdvance(f"{MINUS}0.0 EV"))
        row.addWidget(self.ev_label)
        self.display = QPushButton(self.tr("&Display"))
        self.display.setAccessibleName(self.tr("Display"))
        row.addWidget(self.display)
        self._make_actions(parent)

    # What is chosen

    def showing(self, maps: Maps | None) -> Showing | None:
        """A run as it is to be looked at."""
        if maps is None:
            return None
        ev = self.ev.value() / EV_STEPS
        return Showing(maps, self.view, self._frame, ev, self._tone, self.clipped.isChecked())

    @property
    def view(self) -> int:
        return max(self.view_box.currentIndex(), 0)

    def show_mode(self, mode: int) -> None:
        self.modes[mode].setChecked(True)

    def offer_runs(self, names: Sequence[str], chosen: int) -> None:
        self.run_box.clear()
        self.run_box.addItems(list(names))
        self.run_box.setCurrentIndex(chosen)
        widened(self.run_box)

    def offer_views(self, maps: Maps) -> None:
        """The run's views; the same one stays chosen where it is there, else the first that was held out."""
        before = self.view_box.currentText()
        self.view_box.blockSignals(True)
        self.view_box.clear()
        for i, name in enumerate(maps.names):
            mark = ", validation" if i in maps.held_out else "" if maps.registered[i] else ", no pose"
            self.view_box.addItem(name + mark)
        first = self.view_box.findText(before) if before else -1
        if first < 0:
            first = maps.held_out[0] if maps.held_out else 0
        self.view_box.setCurrentIndex(min(first, self.view_box.count() - 1))
        self.view_box.blockSignals(False)

    def choose_view(self, view: int) -> None:
        if 0 <= view < self.view_box.count():
            self.view_box.setCurrentIndex(view)

    def step_view(self, by: int) -> None:
        """The next or an earlier view, round and round."""
        count = self.view_box.count()
        if count:
            self.view_box.setCurrentIndex((self.view_box.currentIndex() + by) % count)

    def show_arrangement(self, count: int) -> None:
        self._counts.actions()[list(ARRANGEMENTS).index(count)].setChecked(True)

    def _expose(self, value: int) -> None:
        self.ev_label.setText(f"{value / EV_STEPS:+.1f} EV".replace("-", MINUS) if value else "0.0 EV")
        self.changed.emit()

    def _set_frame(self, frame: str) -> None:
        self._frame = frame
        self.changed.emit()

    def _set_tone(self, tone: str) -> None:
        self._tone = tone
        self.changed.emit()

    # Building

    def _labelled(self, row: QHBoxLayout, text: str, widget: QWidget) -> None:
        label = QLabel(text)
        label.setObjectName("dim")
        label.setBuddy(widget)
        row.addWidget(label)
        row.addWidget(widget)

    def _make_actions(self, page: QWidget) -> None:
        """The menu, and every shortcut of the page."""
        menu, port = QMenu(self.display), self._viewport
        self.display.setMenu(menu)
        frames = [
            (self.tr("Normals: OpenGL (green up, blue to the viewer)"), "opengl"),
            (self.tr("Normals: DirectX (green down)"), "directx"),
            (self.tr("Normals: camera frame (x right, y down, z away)"), "camera"),
        ]
        self.frames = _choices(menu, frames, self._set_frame, "opengl")
        menu.addSeparator()
        tones = [
            (self.tr("Tone: as a screen shows it"), "srgb"),
            (self.tr("Tone: logarithmic, 12 stops"), "log"),
        ]
        _choices(menu, tones, self._set_tone, "srgb")
        self.clipped = self._action(page, self.tr("Mark clipped pixels in red"), "O", self.changed.emit, menu)
        self.clipped.setCheckable(True)
        menu.addSeparator()
        counts = [
            (self.tr("1 panel") if n == 1 else self.tr("{n} panels").format(n=n), n) for n in ARRANGEMENTS
        ]
        self._counts = _choices(menu, counts, self.arranged.emit, 6)
        menu.addSeparator()
        for text, keys, call in (
            (self.tr("Fit the object"), "F", lambda: port.fit("object")),
            (self.tr("Fit the photograph"), "Shift+F", lambda: port.fit("all")),
            (self.tr("Zoom to 100 %"), "1", lambda: port.natural(self.devicePixelRatioF())),
            (self.tr("Name this run…"), "F2", self.name_wanted.emit),
            (self.tr("Measure, set scale…"), "D", self.scale_wanted.emit),
            (self.tr("Save picture…"), "Ctrl+Shift+S", self.save_wanted.emit),
            (self.tr("Copy picture"), "Ctrl+Shift+C", self.copy_wanted.emit),
        ):
            self._action(page, text, keys, call, menu)
        for text, keys, call in (
            (self.tr("Zoom in"), "+", lambda: port.zoom(1.25, port.cursor)),
            (self.tr("Zoom out"), "-", lambda: port.zoom(0.8, port.cursor)),
            (self.tr("All maps"), "G", lambda: self.mode_picked.emit(0)),
            (self.tr("Photograph against re-rendering"), "S", lambda: self.mode_picked.emit(1)),
            (self.tr("Compare runs"), "C", lambda: self.mode_picked.emit(2)),
            (self.tr("Previous view"), ("[", "PgUp"), lambda: self.step_view(-1)),
            (self.tr("Next view"), ("]", "PgDown"), lambda: self.step_view(1)),
            (self.tr("Brighter"), "E", lambda: self.ev.setValue(self.ev.value() + 1)),
            (self.tr("Darker"), "Shift+E", lambda: self.ev.setValue(self.ev.value() - 1)),
            (self.tr("Exposure 0"), "Shift+0", lambda: self.ev.setValue(0)),
            (self.tr("Look for new results"), "F5", self.refresh_wanted.emit),
        ):
            self._action(page, text, keys, call)
        self.mark = self._action(page, self.tr("Mark a point to measure"), "M", self.mark_wanted.emit)

    def _action(
        self,
        page: QWidget,
        text: str,
        keys: str | tuple[str, ...],
        call: Callable[[], object],
        menu: QMenu | None = None,
    ) -> QAction:
        action = page_action(page, text, keys, call)
        if menu is not None:
            menu.addAction(action)
        return action


def _choices(
    menu: QMenu, choices: Sequence[tuple[str, object]], chosen: Callable, first: object
) -> QActionGroup:
    """Lines of a menu of which one is marked."""
    group = QActionGroup(menu)
    for text, value in choices:
        action = menu.addAction(text)
        action.setCheckable(True)
        action.setChecked(value == first)
        action.triggered.connect(lambda checked, value=value: chosen(value))
        group.addAction(action)
    return group
