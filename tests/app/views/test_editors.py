"""A field shows its parameter without a word and tells an edit once, in the parameter's own kind."""

from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QCheckBox, QComboBox, QLineEdit, QToolTip
from pytestqt.qtbot import QtBot

from app.parameters import MEANINGS
from app.plan import Parameter
from app.views.editors import Field, Number, told_default, tooltip
from tests.app.views.conftest import active


def field(
    qtbot: QtBot, name: str, kind: str, value: Any, default: Any
) -> tuple[Field, list[tuple[str, Any]]]:
    made = Field(Parameter(name, kind, value, default, MEANINGS[name]))
    qtbot.addWidget(made)
    made.show()
    told: list[tuple[str, Any]] = []
    made.edited.connect(lambda name, value: told.append((name, value)))
    return made, told


def type_into(qtbot: QtBot, widget: Any, text: str) -> None:
    widget.setFocus()
    widget.selectAll()
    qtbot.keyClicks(widget, text)
    qtbot.keyClick(widget, Qt.Key.Key_Return)


def test_a_whole_number_stays_whole(qtbot: QtBot) -> None:
    made, told = field(qtbot, "surface.directions", "int", 2048, 2048)
    assert isinstance(made.control, Number)
    assert made.control.text() == "2048"
    type_into(qtbot, made.control, "512")
    assert told == [("surface.directions", 512)]
    assert type(told[0][1]) is int


@pytest.mark.parametrize(("typed", "value"), [("0.0005", 0.0005), ("2e-3", 0.002), ("0,05", 0.05)])
def test_small_numbers_are_read_and_shown_as_written(qtbot: QtBot, typed: str, value: float) -> None:
    made, told = field(qtbot, "segment.speck_share", "float", 2e-4, 2e-4)
    assert isinstance(made.control, Number)
    assert made.control.text() == "0.0002 share"
    type_into(qtbot, made.control, typed)
    assert told == [("segment.speck_share", value)]


def test_a_number_beyond_its_range_is_not_told(qtbot: QtBot) -> None:
    made, told = field(qtbot, "hdr.saturation_share", "float", 0.98, 0.98)
    type_into(qtbot, made.control, "7")
    assert "Between 0.5 and 1" in QToolTip.text()
    assert [value for _, value in told if value > 1] == []


@pytest.mark.parametrize(
    ("name", "kind", "typed"),
    [("hdr.long_edge_px", "int", "1024"), ("surface.initial_normals", "str", "/maps")],
)
def test_undo_is_the_pages_once_what_was_typed_is_taken_over(
    qtbot: QtBot, name: str, kind: str, typed: str
) -> None:
    made, told = field(qtbot, name, kind, 2048 if kind == "int" else "", 2048)
    undone: list[bool] = []
    undo = QShortcut(QKeySequence.StandardKey.Undo, made)
    undo.activated.connect(lambda: undone.append(True))
    active(made, qtbot)
    made.control.setFocus()
    made.control.selectAll()  # type: ignore[attr-defined]
    qtbot.keyClicks(made.control, typed)
    qtbot.keyClick(made.control, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert undone == []  # the text's own
    type_into(qtbot, made.control, typed)
    assert len(told) == 1
    qtbot.keyClick(made.control, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert undone == [True]


def test_a_number_left_to_the_stage_is_shown_in_words_and_told_as_nothing(qtbot: QtBot) -> None:
    made, told = field(qtbot, "light.camera_clearance", "float?", None, None)
    assert isinstance(made.control, Number)
    assert made.control.text() == "automatic"
    type_into(qtbot, made.control, "0.4")
    assert told[-1] == ("light.camera_clearance", 0.4)
    made.control.setValue(made.control.minimum())
    assert told[-1] == ("light.camera_clearance", None)


def test_a_value_beyond_what_is_offered_is_shown_and_kept(qtbot: QtBot) -> None:
    made, told = field(qtbot, "surface.directions", "int", 1_000_000, 2048)
    assert isinstance(made.control, Number)
    assert made.control.value() == 1_000_000
    assert told == []


def test_a_switch_and_a_choice_tell_their_new_state(qtbot: QtBot) -> None:
    made, told = field(qtbot, "surface.full_phase", "bool", True, True)
    assert isinstance(made.control, QCheckBox)
    qtbot.keyClick(made.control, Qt.Key.Key_Space)
    assert told == [("surface.full_phase", False)]
    made, told = field(qtbot, "export.normal_png", "str", "opengl", "opengl")
    assert isinstance(made.control, QComboBox)
    made.control.setCurrentText("directx")
    assert told == [("export.normal_png", "directx")]


def test_a_list_is_told_as_numbers_and_nonsense_goes_back(qtbot: QtBot) -> None:
    made, told = field(qtbot, "light.epochs", "list", (6, 8, 6), (6, 8, 6))
    assert isinstance(made.control, QLineEdit)
    type_into(qtbot, made.control, "2, 3")
    assert told == [("light.epochs", (2, 3))]
    type_into(qtbot, made.control, "many")
    assert told == [("light.epochs", (2, 3))]
    assert made.control.text() == "6, 8, 6"


def test_escape_leaves_a_text_as_it_was(qtbot: QtBot) -> None:
    made, told = field(qtbot, "poses.board", "str", "", "")
    assert isinstance(made.control, QLineEdit)
    assert made.control.placeholderText() == "none"
    made.control.setFocus()
    qtbot.keyClicks(made.control, "aruco")
    qtbot.keyClick(made.control, Qt.Key.Key_Escape)
    qtbot.keyClick(made.control, Qt.Key.Key_Return)
    assert told == []
    assert made.control.text() == ""


def test_showing_a_value_tells_nobody(qtbot: QtBot) -> None:
    made, told = field(qtbot, "surface.directions", "int", 2048, 2048)
    made.show_parameter(Parameter("surface.directions", "int", 64, 2048, MEANINGS["surface.directions"]))
    assert isinstance(made.control, Number)
    assert made.control.value() == 64
    assert told == []


def test_every_parameter_has_unit_default_and_name_in_its_tooltip(qtbot: QtBot) -> None:
    shown = tooltip(Parameter("hdr.long_edge_px", "int", 64, 2048, MEANINGS["hdr.long_edge_px"]))
    assert "averaged down" in shown
    assert "Default: 2048 px" in shown
    assert "--set hdr.long_edge_px" in shown
    assert (
        told_default(
            Parameter("light.camera_clearance", "float?", 1.0, None, MEANINGS["light.camera_clearance"])
        )
        == "automatic"
    )
    assert (
        told_default(Parameter("poses.focal_px", "float", 1.0, 0.0, MEANINGS["poses.focal_px"]))
        == "from pairs of views"
    )


def test_a_wheel_passing_over_a_field_changes_nothing(qtbot: QtBot) -> None:
    from PySide6.QtCore import QPoint, QPointF
    from PySide6.QtGui import QWheelEvent

    made, told = field(qtbot, "surface.directions", "int", 2048, 2048)
    made.control.clearFocus()
    event = QWheelEvent(
        QPointF(5, 5), QPointF(5, 5), QPoint(0, 0), QPoint(0, 120), Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    made.control.wheelEvent(event)
    assert told == []
