"""Turn the rig by hand: a pad of arrows, a step, home, and where it stands. Angles are degrees as the rig counts them."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QButtonGroup,
    QDoubleSpinBox,
    QGridLayout,
    QHBoxLayout,
    QPushButton,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from app.capture.wanted import told_angle
from app.views.capture.parts import Section, button, dim
from app.views.editors import Number

STEPS_DEG = (1.0, 10.0, 45.0)
LIMIT_DEG = 3600.0


class Jog(Section):
    """Tells what was asked for; arrow keys do as the pad while anything of it has the focus."""

    jog_wanted = Signal(float, float)  # pan, tilt: by so many degrees
    move_wanted = Signal(float, float)  # to there
    home_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("", parent)
        self.setAccessibleName(self.tr("Move the rig"))
        self.heading.setText(self.tr("Move the rig"))
        self._axes: frozenset[str] = frozenset()
        self._turns = False
        self._waits: QWidget | None = None  # for the keyboard, while the rig turns
        self.where = dim()
        self.where.setAccessibleName(self.tr("Where the rig stands"))
        self.where.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignTop)
        self.pad = QWidget()
        self.pad.setAccessibleName(self.tr("Turn by steps"))
        arrows = QGridLayout(self.pad)
        arrows.setContentsMargins(0, 0, 0, 0)
        arrows.setSpacing(3)
        self.arrows: dict[str, QToolButton] = {}
        for key, text, sign, keys, place, pan, tilt in (
            ("left", self.tr("Pan back"), Qt.ArrowType.LeftArrow, "Left", (1, 0), -1, 0),
            ("right", self.tr("Pan on"), Qt.ArrowType.RightArrow, "Right", (1, 2), 1, 0),
            ("up", self.tr("Tilt up"), Qt.ArrowType.UpArrow, "Up", (0, 1), 0, 1),
            ("down", self.tr("Tilt down"), Qt.ArrowType.DownArrow, "Down", (2, 1), 0, -1),
        ):
            arrow = QToolButton()
            arrow.setArrowType(sign)
            arrow.setFixedSize(34, 26)
            arrow.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            arrow.setAccessibleName(text)
            arrow.setToolTip(f"{text} ({keys})")
            action = QAction(text, self)
            action.setShortcut(keys)
            action.setShortcutContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
            for signal in (arrow.clicked, action.triggered):
                signal.connect(lambda checked=False, pan=pan, tilt=tilt: self._jog(pan, tilt))
            self.pad.addAction(action)
            arrows.addWidget(arrow, *place)
            self.arrows[key] = arrow
        self.steps = QButtonGroup(self)
        steps = QVBoxLayout()
        steps.setSpacing(3)
        for i, step in enumerate(STEPS_DEG):
            chosen = QPushButton(f"{step:g}°")
            chosen.setCheckable(True)
            chosen.setChecked(step == 10.0)
            chosen.setFixedWidth(50)
            chosen.setAccessibleName(self.tr("Step of {0} degrees").format(f"{step:g}"))
            chosen.setToolTip(chosen.accessibleName())
            self.steps.addButton(chosen, i)
            steps.addWidget(chosen)
        self.pan, self.tilt = _angle(self.tr("Pan to")), _angle(self.tr("Tilt to"))
        self.go = button(self.tr("&Go"), self.tr("Turn to these angles"))
        self.home = button("")
        self.go.clicked.connect(lambda: self.move_wanted.emit(self.pan.value(), self.tilt.value()))
        self.home.clicked.connect(self.home_wanted)
        aside = QVBoxLayout()
        aside.addWidget(self.where)
        aside.addStretch()
        aside.addWidget(self.home)
        by_steps = QHBoxLayout()
        by_steps.setSpacing(8)
        by_steps.addWidget(self.pad)
        by_steps.addLayout(steps)
        by_steps.addLayout(aside, 1)
        to_angles = QHBoxLayout()
        to_angles.setSpacing(4)
        for text, field in ((self.tr("pan"), self.pan), (self.tr("tilt"), self.tilt)):
            to_angles.addWidget(dim(text, wraps=False))
            to_angles.addWidget(field, 1)
        to_angles.addWidget(self.go)
        self.body.addLayout(by_steps)
        self.body.addLayout(to_angles)
        self.show_able(frozenset(), homes=False, turns=False)

    def show_able(self, axes: frozenset[str], homes: bool, turns: bool, finds_zero: bool = True) -> None:
        """
        Args:
            axes: those there are, "pan" and "tilt".
            homes: it may be homed now.
            turns: it may be turned now.
            finds_zero: homing does; else a person turns it there first.
        """
        self._finds_zero = finds_zero
        self._axes, self._turns = axes, turns
        focused = next(
            (part for part in (*self.arrows.values(), self.go, self.home) if part.hasFocus()), None
        )
        self.setVisible(bool(axes))
        for key, arrow in self.arrows.items():
            arrow.setEnabled(turns and ("pan" if key in ("left", "right") else "tilt") in axes)
        for part in (*self.pad.actions(), *self.steps.buttons(), self.go):
            part.setEnabled(turns)
        self.pan.setEnabled(turns and "pan" in axes)
        self.tilt.setEnabled(turns and "tilt" in axes)
        self.home.setEnabled(homes)
        text, tip = self.tr("Hom&e"), self.tr("Find the zero of every axis")
        if not finds_zero:
            text = self.tr("At z&ero")
            tip = self.tr("The rig cannot find its zero by itself, and was turned there by hand")
        self.home.setText(text)
        self.home.setAccessibleName(text.replace("&", ""))
        self.home.setToolTip(tip)
        self._keep_focus(focused)

    def _keep_focus(self, focused: QWidget | None) -> None:
        """What had the keyboard has it again once the rig stands, not the next field meanwhile."""
        if focused is not None and not focused.isEnabled():
            self._waits = focused
            self.setFocus()
        elif self._waits is not None and self._waits.isEnabled():
            if self.hasFocus():
                self._waits.setFocus()
            self._waits = None

    def show_where(self, pan_deg: float | None, tilt_deg: float | None) -> None:
        if pan_deg is None and self.home.isEnabled():
            first = (
                self.tr("Find the zero position first")
                if self._finds_zero
                else self.tr("Turn it to its zero first")
            )
            self.where.setText(first)
            return
        parts = [self.tr("pan {0}").format(told_angle(pan_deg))]
        if "tilt" in self._axes:
            parts.append(self.tr("tilt {0}").format(told_angle(tilt_deg)))
        self.where.setText("\n".join(parts))

    def _jog(self, pan: int, tilt: int) -> None:
        step = STEPS_DEG[self.steps.checkedId()]
        if self._turns and ("pan" if pan else "tilt") in self._axes:
            self.jog_wanted.emit(pan * step, tilt * step)


def _angle(name: str) -> QDoubleSpinBox:
    field = Number(whole=False)
    field.setRange(-LIMIT_DEG, LIMIT_DEG)
    field.setSuffix("°")
    field.setAccessibleName(name)
    field.setToolTip(name)
    field.setMinimumWidth(60)
    return field
