"""Both palettes are readable, follow the choice at once, and dress Qt's own widgets too."""

import importlib

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QFontInfo, QFontMetricsF, QPalette
from PySide6.QtWidgets import QApplication, QPushButton, QScrollArea, QWidget
from pytestqt.qtbot import QtBot

from app.views import theme
from app.views.theme import DARK, LIGHT, Palette
from tests.app.views.conftest import until


def contrast(a: str, b: str) -> float:
    """WCAG 2's contrast ratio, 1 to 21."""

    def luminance(name: str) -> float:
        parts = [
            channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
            for channel in QColor(name).getRgbF()[:3]
        ]
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2]

    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("ours", [DARK, LIGHT])
def test_text_is_readable_on_every_ground(ours: Palette) -> None:
    for ground in (ours.window, ours.panel, ours.field):
        assert contrast(ours.text, ground) >= 7
        for colour in (ours.dim, ours.good, ours.warn, ours.bad, ours.accent):
            assert contrast(colour, ground) >= 4.5, (colour, ground)
        assert contrast(ours.focus, ground) >= 3, ground  # WCAG 2.2, 1.4.11
    assert contrast(ours.on_accent, ours.accent) >= 4.5
    assert contrast(ours.focus, ours.accent) >= 1.5  # on what is down, too


@pytest.mark.parametrize("ours", [DARK, LIGHT])
def test_lines_of_a_chart_stand_out_from_its_ground(ours: Palette) -> None:
    assert len(set(ours.series)) == len(ours.series) >= 8
    for line in ours.series:
        assert contrast(line, ours.window) >= 3, line


def test_the_choice_holds_and_otherwise_the_system_decides() -> None:
    assert theme.in_force("dark", Qt.ColorScheme.Light) is DARK
    assert theme.in_force("light", Qt.ColorScheme.Dark) is LIGHT
    assert theme.in_force("system", Qt.ColorScheme.Light) is LIGHT
    assert theme.in_force("system", Qt.ColorScheme.Dark) is DARK
    assert theme.in_force("system", Qt.ColorScheme.Unknown) is DARK


def test_widgets_change_with_the_choice_and_are_told(qtbot: QtBot, qapp: QApplication) -> None:
    changed = []

    class Page(QWidget):
        def changeEvent(self, event) -> None:
            if event.type() == event.Type.PaletteChange:
                changed.append(theme.colours(self))

    theme.install(qapp, "light")
    page = Page()
    qtbot.addWidget(page)
    page.show()
    assert theme.colours(page) is LIGHT
    theme.choose("dark")
    assert theme.colours(page) is DARK
    until(qtbot, lambda: changed and changed[-1] is DARK)
    assert page.palette().color(QPalette.ColorRole.Window).name() == DARK.window
    assert theme.colours() is DARK


def test_the_marks_that_the_sheet_names_are_there() -> None:
    from pathlib import Path

    for name in ("up.svg", "down.svg", "check-on-dark.svg", "check-on-light.svg"):
        assert (Path(theme.MARKS) / name).is_file()


@pytest.mark.parametrize(
    ("module", "name"),
    [("view3d", "View3dPage"), ("capture", "CapturePage"), ("relight", "RelightPage")],
)
def test_a_panel_stays_as_wide_as_its_controls_when_they_are_dressed_anew(
    qtbot: QtBot, qapp: QApplication, module: str, name: str
) -> None:
    page = getattr(importlib.import_module(f"app.views.{module}.page"), name)(None)
    qtbot.addWidget(page)
    page.resize(1240, 560)
    page.show()
    if module == "view3d":
        page.stack.setCurrentIndex(1)  # without a session there is no panel
    panel = next(area for area in page.findChildren(QScrollArea) if area.width() < page.width() / 2)
    panel.widget().setStyleSheet("* { font-size: 14pt; }")
    qapp.processEvents()  # sizes are asked for anew
    until(qtbot, lambda: panel.viewport().width() >= panel.widget().minimumSizeHint().width())


def test_the_shipped_font_is_worn_and_its_figures_are_all_as_wide(qtbot: QtBot, qapp: QApplication) -> None:
    theme.install(qapp, "dark")
    box = QPushButton("0")
    box.setObjectName("primary")  # dressed by the sheet, which gives it another weight
    qtbot.addWidget(box)
    box.show()
    for metrics in (QFontMetricsF(box.font()), QFontMetricsF(qapp.font())):
        widths = [metrics.horizontalAdvance(10 * figure) for figure in "0123456789"]
        assert max(widths) - min(widths) < 0.5  # px; proportional ones differ by 30
    assert QFontInfo(box.font()).family() == "Inter"
