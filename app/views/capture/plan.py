"""Which poses: a plan that suits the rig, a turntable, a grid of a gimbal, free, or a file. Angles in degrees."""

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QWidget,
)

from app.views.boxes import box_of
from app.views.capture.parts import Section, button, dim, row
from app.views.editors import Number
from hardware.plan import HIGHEST_DEG, LOWEST_DEG, MOST

SETTLED_MS = 250  # after the last keystroke, before the plan is worked out
POSES = 72
COLUMNS = "pan_deg,tilt_deg"  # of a plan's file
AS_THE_RIG_S = -0.5  # what the settling field shows as "rig's default"


class PlanBox(Section):
    """Holds what was chosen, and tells `changed` once a person is done with a field."""

    changed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("", parent)
        self.setAccessibleName(self.tr("Poses"))
        self.heading.setText(self.tr("Poses"))
        grid = self.rows()
        self.kind = box_of("", 14)
        for key, text in (
            ("suited", self.tr("Automatic (full sphere)")),
            ("turntable", self.tr("Turntable: one circle")),
            ("gimbal", self.tr("Gimbal: rows of tilts")),
            ("free", self.tr("Handheld, no plan")),
            ("file", self.tr("From a CSV file")),
        ):
            self.kind.addItem(text, key)
        row(grid, self.tr("Plan"), self.kind)
        self.poses = _number(1, MOST, POSES, whole=True)
        self.lowest, self.highest = _number(-90, 90, LOWEST_DEG), _number(-90, 90, HIGHEST_DEG)
        self.file = QLineEdit()
        self.file.setPlaceholderText(COLUMNS)
        self.browse = button("…")
        self.browse.setFixedWidth(40)
        self.browse.setAccessibleName(self.tr("Browse for a plan"))
        self.settle = _number(AS_THE_RIG_S, 60, AS_THE_RIG_S)
        self.settle.setSingleStep(0.5)
        self.settle.setSpecialValueText(self.tr("rig's default"))
        self.settle.setSuffix(" s")
        self.settle.setToolTip(self.tr("How long to wait after a move before the photograph"))
        for field in (self.lowest, self.highest):
            field.setSuffix("°")
        self._rows: list[tuple[tuple[str, ...], tuple[QWidget, ...]]] = []
        kinds = ("suited", "turntable", "gimbal", "free")
        self._row(kinds, row(grid, self.tr("&Number"), self.poses, self.tr("Number of poses")), self.poses)
        tilts = _beside(self.lowest, QLabel(self.tr("to")), self.highest)
        self._row(("gimbal",), row(grid, self.tr("Tilts"), tilts), tilts)
        self.lowest.setAccessibleName(self.tr("Lowest tilt, degrees"))
        self.highest.setAccessibleName(self.tr("Highest tilt, degrees"))
        files = _beside(self.file, self.browse)
        self._row(("file",), row(grid, self.tr("File"), files), files)
        self.file.setAccessibleName(self.tr("File of the plan"))
        row(grid, self.tr("Wait"), self.settle, self.tr("Wait after moving, seconds"))
        self.helpful = QCheckBox(self.tr("Most useful pose first"))
        self.helpful.setToolTip(
            self.tr(
                "Each time the pose that shows most of what no photograph has shown yet; the rig travels more"
            )
        )
        self.any_format = QCheckBox(self.tr("Als&o keep JPEGs"))
        self.any_format.setToolTip(self.tr("JPEG and others are kept, unchecked; they cannot be processed"))
        for box in (self.helpful, self.any_format):
            box.setAccessibleName(box.text().replace("&", ""))
            self.body.addWidget(box)
        self.about = dim()
        self.body.addWidget(self.about)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(SETTLED_MS)
        self._timer.timeout.connect(self.changed)
        self.kind.currentIndexChanged.connect(self._changed)
        for field in (self.poses, self.lowest, self.highest):
            field.valueChanged.connect(self._changed)
        self.file.textChanged.connect(self._changed)
        self.browse.clicked.connect(self._ask)
        self._changed()

    def plan(self) -> Mapping[str, Any] | None:
        """As the desk takes it; None while it is not complete."""
        kind, poses = self.kind.currentData(), round(self.poses.value())
        if kind == "file":
            path = self.file.text().strip()
            return {"kind": "file", "path": path} if path else None
        if kind == "gimbal":
            tilts = {"lowest": self.lowest.value(), "highest": self.highest.value()}
            return {"kind": "gimbal", "poses": poses, **tilts}
        return {"kind": kind, "poses": poses}

    @property
    def settle_s(self) -> float | None:
        return None if self.settle.value() < 0 else self.settle.value()

    def show_about(self, text: str) -> None:
        """What the plan comes to, or what is wrong with it."""
        self.about.setText(text)
        self.about.setVisible(bool(text))

    def _changed(self) -> None:
        kind = self.kind.currentData()
        for kinds, parts in self._rows:
            for part in parts:
                part.setVisible(kind in kinds)
        self._timer.start()

    def _row(self, kinds: tuple[str, ...], *parts: QWidget) -> None:
        self._rows.append((kinds, parts))

    def _ask(self) -> None:
        said, _ = QFileDialog.getOpenFileName(
            self, self.tr("Plan of poses"), self.file.text(), self.tr("Plans (*.csv);;All files (*)")
        )
        if said:
            self.file.setText(said)


def _number(low: float, high: float, value: float, whole: bool = False) -> Number:
    field = Number(whole)
    field.setRange(low, high)
    field.setValue(value)
    return field


def _beside(*parts: QWidget) -> QWidget:
    both = QWidget()
    line = QHBoxLayout(both)
    line.setContentsMargins(0, 0, 0, 0)
    line.setSpacing(6)
    for part in parts:
        line.addWidget(part, 0 if isinstance(part, QLabel | QPushButton) else 1)
    both.setFocusProxy(parts[0])
    return both
