"""Fields that edit one parameter: number, switch, choice, text or list, each with unit, default and tooltip.

A field shows a `Parameter` and tells `edited` once a person has finished with it; it never edits by itself.
"""

from typing import Any

from PySide6.QtCore import QCoreApplication, QEvent, QObject, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QKeyEvent, QKeySequence, QValidator
from PySide6.QtWidgets import QCheckBox, QComboBox, QDoubleSpinBox, QHBoxLayout, QLineEdit, QToolTip, QWidget

from app.parameters import Meaning
from app.plan import Parameter, parse_list

LOWEST_OF_NONE = -1.0  # what a number field shows for "left to the stage"


class Number(QDoubleSpinBox):
    """Whole or real numbers over many decades, written as short as they are exact."""

    def __init__(self, whole: bool, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._whole = whole
        self.setDecimals(0 if whole else 9)
        self.setKeyboardTracking(False)
        self.setStepType(QDoubleSpinBox.StepType.AdaptiveDecimalStepType)
        self.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)

    def event(self, event: QEvent) -> bool:
        # What was taken over is undone as an edit of the page, what is only typed as text.
        if event.type() == QEvent.Type.ShortcutOverride and _undoes(event) and not self._unfinished:
            event.ignore()
            return False
        return super().event(event)

    @property
    def _unfinished(self) -> bool:
        return self.cleanText() not in (self.textFromValue(self.value()), self.specialValueText())

    def fixup(self, text: str) -> str:
        within = QCoreApplication.translate("Field", "Between {0} and {1}")
        low, high = (self.textFromValue(end) for end in (self.minimum(), self.maximum()))
        QToolTip.showText(self.mapToGlobal(self.rect().bottomLeft()), within.format(low, high), self)
        return text

    def textFromValue(self, value: float) -> str:
        return f"{value:.0f}" if self._whole else f"{value:.7g}"

    def valueFromText(self, text: str) -> float:
        plain = text.removesuffix(self.suffix()).strip().replace(",", ".")
        try:
            return float(plain)
        except ValueError:
            return self.value()

    def validate(self, text: str, place: int, /) -> tuple[QValidator.State, str, int]:
        plain = text.removesuffix(self.suffix()).strip().replace(",", ".")
        try:
            number = float(plain)
        except ValueError:
            unfinished = set(plain) <= set("0123456789.eE+-")
            state = QValidator.State.Intermediate if unfinished else QValidator.State.Invalid
            return state, text, place
        within = self.minimum() <= number <= self.maximum() and (not self._whole or number == round(number))
        return (QValidator.State.Acceptable if within else QValidator.State.Intermediate), text, place

    def wheelEvent(self, event) -> None:
        # A wheel that scrolls the page must not change what passes under it.
        if self.hasFocus():
            super().wheelEvent(event)
        else:
            event.ignore()


class Field(QWidget):
    """One parameter's editor."""

    edited = Signal(str, object)  # name, value

    def __init__(self, parameter: Parameter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.parameter = parameter
        self.control = _control(parameter)
        self.control.setAccessibleName(label(parameter.meaning))
        self.control.setAccessibleDescription(tooltip(parameter))
        self.setFocusProxy(self.control)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.control)
        self.show_parameter(parameter)
        self._connect()

    def show_parameter(self, parameter: Parameter) -> None:
        """Show a value without telling anybody."""
        self.parameter = parameter
        self.control.setToolTip(tooltip(parameter))
        value = parameter.value
        with QSignalBlocker(self.control):
            if isinstance(self.control, QCheckBox):
                self.control.setChecked(bool(value))
            elif isinstance(self.control, Number):
                shown = LOWEST_OF_NONE if value is None else float(value)
                self.control.setRange(min(self.control.minimum(), shown), max(self.control.maximum(), shown))
                self.control.setValue(shown)
            elif isinstance(self.control, QComboBox):
                self.control.setCurrentText(str(value))
            elif isinstance(self.control, QLineEdit) and not self.control.isModified():
                self.control.setText(told_value(value))

    def _connect(self) -> None:
        if isinstance(self.control, QCheckBox):
            self.control.toggled.connect(self._tell)
        elif isinstance(self.control, Number):
            self.control.valueChanged.connect(self._tell_number)
        elif isinstance(self.control, QComboBox):
            self.control.currentTextChanged.connect(self._tell)
        elif isinstance(self.control, QLineEdit):
            self.control.editingFinished.connect(self._tell_text)
        self.control.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(self.control, QLineEdit) and not self.control.isModified():
            if event.type() == QEvent.Type.ShortcutOverride and _undoes(event):
                event.ignore()
                return True
        # Escape leaves a text as it was.
        elif (
            isinstance(self.control, QLineEdit)
            and event.type() == QEvent.Type.KeyPress
            and event.key() == Qt.Key.Key_Escape  # pyrefly: ignore[missing-attribute]
        ):
            self.control.setText(told_value(self.parameter.value))
            self.control.setModified(False)
            return True
        return super().eventFilter(watched, event)

    def _tell(self, value: Any) -> None:
        self.edited.emit(self.parameter.name, value)

    def _tell_number(self, value: float) -> None:
        if self.parameter.kind.endswith("?") and value < self.parameter.meaning.low:
            self._tell(None)
        else:
            self._tell(round(value) if self.parameter.kind.startswith("int") else float(f"{value:.7g}"))

    def _tell_text(self) -> None:
        assert isinstance(self.control, QLineEdit)
        if not self.control.isModified():
            return
        self.control.setModified(False)
        text = self.control.text().strip()
        if self.parameter.kind == "words":
            self._tell(tuple(word for word in text.replace(",", " ").split()))
        elif self.parameter.kind == "list":
            numbers = parse_list(text)
            if numbers is None:
                self.control.setText(told_value(self.parameter.value))
            else:
                self._tell(numbers)
        else:
            self._tell(text)


def _undoes(event: QEvent) -> bool:
    keys = QKeySequence.StandardKey
    return isinstance(event, QKeyEvent) and any(event.matches(key) for key in (keys.Undo, keys.Redo))


def _control(parameter: Parameter) -> QWidget:
    meaning = parameter.meaning
    if parameter.kind == "bool":
        return QCheckBox(QCoreApplication.translate("Field", "on"))
    if parameter.kind.startswith(("int", "float")):
        number = Number(parameter.kind.startswith("int"))
        optional = parameter.kind.endswith("?")
        number.setRange(LOWEST_OF_NONE if optional else meaning.low, meaning.high)
        if meaning.nothing:
            number.setSpecialValueText(translated(meaning.nothing))
        if meaning.unit:
            number.setSuffix(f" {translated(meaning.unit)}")
        return number
    if meaning.choices:
        choice = QComboBox()
        choice.addItems(list(meaning.choices))
        return choice
    text = QLineEdit()
    text.setPlaceholderText(translated(meaning.nothing) if meaning.nothing else "")
    return text


def translated(text: str) -> str:
    return QCoreApplication.translate("parameters", text)


def label(meaning: Meaning) -> str:
    return translated(meaning.label)


def told_value(value: Any) -> str:
    """A value as a person writes it."""
    if isinstance(value, bool):
        return (
            QCoreApplication.translate("Field", "on") if value else QCoreApplication.translate("Field", "off")
        )
    if isinstance(value, tuple | list):
        return ", ".join(str(item) for item in value)
    if isinstance(value, float):
        return f"{value:.7g}"
    return "" if value is None else str(value)


def told_default(parameter: Parameter) -> str:
    """The preset's default, with its unit."""
    meaning, default = parameter.meaning, parameter.default
    if meaning.nothing and (default in (None, "") or default == meaning.low):
        return translated(meaning.nothing)
    unit = f" {translated(meaning.unit)}" if meaning.unit else ""
    return f"{told_value(default)}{unit}"


def tooltip(parameter: Parameter) -> str:
    """Sense, default, and the name on the command line."""
    default = QCoreApplication.translate("Field", "Default: {0}").format(told_default(parameter))
    return f"{translated(parameter.meaning.sense)}\n{default}\n--set {parameter.name}=…"
