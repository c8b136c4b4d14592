"""Colours of the window, dark and light: neutral greys, so that a picture's colours are judged right.

Pages take every colour from `colours(widget)` and ask again on `QEvent.Type.PaletteChange`, which Qt sends to
every widget when the system or the person changes between dark and light. Colours are sRGB, "#rrggbb".
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtGui import QColor, QFont, QFontDatabase, QPainter, QPalette, QPen
from PySide6.QtWidgets import QApplication, QWidget

from app.words import QT_TRANSLATE_NOOP

MARKS = (Path(__file__).parent / "marks").as_posix()
FONTS = Path(__file__).parent / "fonts"
FAMILY, POINTS = "Inter", 9.5
CHOSEN = "roomlight theme"  # property of the application
Theme = Literal["system", "dark", "light"]
TITLES: dict[Theme, str] = {
    "system": QT_TRANSLATE_NOOP("theme", "As the system"),
    "dark": QT_TRANSLATE_NOOP("theme", "Dark"),
    "light": QT_TRANSLATE_NOOP("theme", "Light"),
}
StyleOption = Any
"""A QStyleOptionViewItem: PySide's stubs do not know the types of what it holds."""


@dataclass(frozen=True, slots=True)
class Palette:
    """Every colour there is; text colours are readable on `window`, `panel` and `field`."""

    dark: bool
    window: str  # behind everything
    panel: str  # raised: cards, rail, dock
    field: str  # where one types; lists
    picture: str  # behind photographs and maps
    line: str  # borders, separators, grids
    text: str
    dim: str  # secondary text, still readable
    disabled: str
    accent: str  # selection, progress, what is on
    focus: str  # the ring around what keys act on
    on_accent: str  # text on `accent`
    good: str
    warn: str
    bad: str
    series: tuple[str, ...]  # lines of a chart, told apart by colour-blind people too


# Series after Okabe and Ito's set for colour-blind readers, lightened or darkened to stand on the ground.
DARK = Palette(
    dark=True,
    window="#232323", panel="#2c2c2c", field="#1b1b1b", picture="#181818", line="#434343",
    text="#e4e4e4", dim="#a6a6a6", disabled="#6d6d6d", accent="#4f9cf0", focus="#b7dcff", on_accent="#0c0c0c",
    good="#67c27a", warn="#e6b04a", bad="#f27d72",
    series=("#5ab4f0", "#f0a030", "#34c79a", "#e98bc2", "#f2e35c", "#e8743a", "#9aa7f5", "#c8c8c8"),
)  # fmt: skip
LIGHT = Palette(
    dark=False,
    window="#ededed", panel="#f7f7f7", field="#ffffff", picture="#d2d2d2", line="#c3c3c3",
    text="#1c1c1c", dim="#5a5a5a", disabled="#9b9b9b", accent="#1763b8", focus="#3a88dd", on_accent="#ffffff",
    good="#1d7434", warn="#8a5a00", bad="#b3261e",
    series=("#0072b2", "#b36b00", "#007d5b", "#b04f8a", "#7d7200", "#c14a00", "#4a55b5", "#555555"),
)  # fmt: skip


def colours(widget: QWidget | None = None) -> Palette:
    """The palette in force. One palette serves all; `widget` says who asks, and asks again when it changes."""
    return DARK if QApplication.palette().color(QPalette.ColorRole.Window).lightness() < 128 else LIGHT


def colour(name: str, opacity: float = 1.0) -> QColor:
    """A colour of the palette for a painter."""
    made = QColor(name)
    made.setAlphaF(opacity)
    return made


def pen(name: str, width: float = 1.0) -> QPen:
    return QPen(QColor(name), width)


def ring(painter: QPainter, widget: QWidget, ours: Palette) -> None:
    """Around a widget that paints itself, while keys act on it."""
    if widget.hasFocus():
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(pen(ours.focus, 2))
        painter.drawRect(widget.rect().adjusted(1, 1, -1, -1))


def title(text: str) -> str:
    """One of `TITLES` in the person's language."""
    return QCoreApplication.translate("theme", text)


def install(app: QApplication, theme: Theme = "system") -> None:
    """Dress the application, and again whenever the system changes between dark and light."""
    app.setStyle("Fusion")
    app.setFont(_font())
    choose(theme)
    app.styleHints().colorSchemeChanged.connect(lambda scheme: _dress(app))


def _font() -> QFont:
    """The shipped family, whose figures are all as wide: numbers that change stand still."""
    if FAMILY not in QFontDatabase.families():
        for file in sorted(FONTS.glob("*.otf")):
            QFontDatabase.addApplicationFont(str(file))
    font = QFont(FAMILY)
    font.setPointSizeF(POINTS)
    font.setFeature(QFont.Tag("tnum"), 1)
    return font


def choose(theme: Theme) -> None:
    """Follow the system, or not; takes effect at once."""
    app = QApplication.instance()
    assert isinstance(app, QApplication)
    app.setProperty(CHOSEN, theme)
    wanted = {"dark": Qt.ColorScheme.Dark, "light": Qt.ColorScheme.Light}
    # Frames and dialogs that the system draws go along, where the platform hears of it.
    app.styleHints().setColorScheme(wanted.get(theme, Qt.ColorScheme.Unknown))
    _dress(app)


def _dress(app: QApplication) -> None:
    ours = in_force(app.property(CHOSEN), app.styleHints().colorScheme())
    app.setPalette(qt_palette(ours))
    app.setStyleSheet(_sheet(ours))


def in_force(theme: Theme, system: Qt.ColorScheme) -> Palette:
    """The palette for a choice; a system that does not say gets the dark one, as picture programs have it."""
    if theme == "system":
        return LIGHT if system == Qt.ColorScheme.Light else DARK
    return LIGHT if theme == "light" else DARK


def qt_palette(ours: Palette) -> QPalette:
    """`ours` in the roles of Qt's own widgets."""
    role, group = QPalette.ColorRole, QPalette.ColorGroup
    made = QPalette()
    for name, colour in {
        role.Window: ours.window, role.WindowText: ours.text, role.Base: ours.field,
        role.AlternateBase: ours.panel, role.Text: ours.text, role.PlaceholderText: ours.dim,
        role.Button: ours.panel, role.ButtonText: ours.text, role.BrightText: ours.bad,
        role.ToolTipBase: ours.panel, role.ToolTipText: ours.text, role.Link: ours.accent,
        role.LinkVisited: ours.accent, role.Highlight: ours.accent, role.HighlightedText: ours.on_accent,
        role.Accent: ours.accent, role.Light: ours.line, role.Midlight: ours.line, role.Mid: ours.line,
        role.Dark: ours.line, role.Shadow: "#000000",
    }.items():  # fmt: skip
        made.setColor(name, QColor(colour))
    for name in (role.WindowText, role.Text, role.ButtonText):
        made.setColor(group.Disabled, name, QColor(ours.disabled))
    return made


def _sheet(ours: Palette) -> str:
    """What a palette cannot say. Names: QLabel#title, #heading, #dim; QFrame#card, #panel; QPushButton#primary, #stop;
    QToolButton#segment (of several one is down); #plain (a list or text without a frame); QComboBox#flat (a list that reads as a title)."""
    check = "check-on-dark.svg" if ours.dark else "check-on-light.svg"
    return f"""
    QLabel#title {{ font-size: 18pt; font-weight: 600; }}
    QLabel#heading {{ font-size: 11.5pt; font-weight: 600; }}
    QLabel#dim {{ color: {ours.dim}; }}
    QLabel[grade="doubted"] {{ color: {ours.warn}; }}
    QFrame#panel {{ background: {ours.panel}; border: none; }}
    QFrame#card {{ background: {ours.panel}; border: 1px solid {ours.line}; border-radius: 6px; }}
    QFrame#card[selected="true"] {{ border: 1px solid {ours.accent}; }}
    QPushButton {{ background: {ours.panel}; border: 1px solid {ours.line}; border-radius: 4px; padding: 4px 12px; }}
    QPushButton:hover, QComboBox:hover {{ border-color: {ours.dim}; }}
    QPushButton:pressed {{ background: {ours.field}; }}
    QPushButton:checked, QToolButton#segment:checked {{ background: {ours.accent}; color: {ours.on_accent};
        border-color: {ours.accent}; }}
    QPushButton:focus {{ border: 2px solid {ours.focus}; padding: 3px 11px; }}
    QToolButton#segment {{ padding: 3px 10px; border: 1px solid {ours.line}; border-radius: 3px; }}
    QToolButton#segment[narrow="true"] {{ padding: 3px 4px; }}
    QToolButton#segment:focus {{ border: 2px solid {ours.focus}; padding: 2px 9px; }}
    QToolButton#segment[narrow="true"]:focus {{ padding: 2px 3px; }}
    QPushButton, QAbstractItemView {{ outline: 0; }}
    QPushButton:disabled {{ color: {ours.disabled}; }}
    QLineEdit, QComboBox, QAbstractSpinBox {{ background: {ours.field}; border: 1px solid {ours.line};
        border-radius: 4px; padding: 2px 6px; min-height: 18px; selection-background-color: {ours.accent}; }}
    QLineEdit:focus, QComboBox:focus, QAbstractSpinBox:focus {{ border: 2px solid {ours.focus}; padding: 1px 5px; }}
    QLineEdit:disabled, QComboBox:disabled, QAbstractSpinBox:disabled {{ color: {ours.disabled}; }}
    QComboBox, QComboBox:focus {{ padding-right: 18px; }}
    QComboBox QAbstractItemView {{ padding: 4px; }}
    QComboBox::drop-down {{ border: none; width: 18px; }}
    QComboBox::down-arrow, QAbstractSpinBox::down-arrow {{ image: url({MARKS}/down.svg); width: 12px; height: 12px; }}
    QAbstractSpinBox::up-arrow {{ image: url({MARKS}/up.svg); width: 12px; height: 12px; }}
    QAbstractSpinBox, QAbstractSpinBox:focus {{ padding-right: 18px; }}
    QAbstractSpinBox::up-button, QAbstractSpinBox::down-button {{ border: none; width: 18px; background: none; }}
    QCheckBox::indicator, QRadioButton::indicator, QTreeView::indicator {{ width: 13px; height: 13px;
        border: 1px solid {ours.disabled}; border-radius: 3px; background: {ours.field}; }}
    QRadioButton::indicator {{ border-radius: 7px; }}
    QCheckBox::indicator:checked, QTreeView::indicator:checked {{ background: {ours.accent};
        border-color: {ours.accent}; image: url({MARKS}/{check}); }}
    QRadioButton::indicator:checked {{ border: 4px solid {ours.accent}; width: 7px; height: 7px;
        background: {ours.on_accent}; }}
    QCheckBox::indicator:disabled, QTreeView::indicator:disabled {{ background: {ours.panel};
        border-color: {ours.line}; }}
    QCheckBox:focus, QRadioButton:focus {{ color: {ours.accent}; }}
    QCheckBox::indicator:focus, QRadioButton::indicator:focus {{ border-color: {ours.focus}; }}
    QScrollBar {{ background: none; border: none; }}
    QScrollBar:vertical {{ width: 11px; }}
    QScrollBar:horizontal {{ height: 11px; }}
    QScrollBar::handle {{ background: {ours.line}; border-radius: 4px; margin: 1px; }}
    QScrollBar::handle:vertical {{ min-height: 26px; }}
    QScrollBar::handle:horizontal {{ min-width: 26px; }}
    QScrollBar::handle:hover {{ background: {ours.disabled}; }}
    QScrollBar::add-line, QScrollBar::sub-line {{ width: 0; height: 0; }}
    QScrollBar::add-page, QScrollBar::sub-page {{ background: none; }}
    QHeaderView::section {{ background: {ours.window}; color: {ours.dim}; border: none;
        border-bottom: 1px solid {ours.line}; padding: 4px 6px; }}
    QTreeView::item {{ padding: 4px 2px; }}
    QTabBar::tab {{ background: none; color: {ours.dim}; border: none; border-bottom: 2px solid transparent;
        padding: 5px 12px; }}
    QTabBar::tab:selected {{ color: {ours.text}; border-bottom-color: {ours.accent}; }}
    QTabBar::tab:hover {{ color: {ours.text}; }}
    QSplitter::handle:horizontal {{ border-left: 1px solid {ours.line}; margin: 0 2px; }}
    QSplitter::handle:vertical {{ border-top: 1px solid {ours.line}; margin: 2px 0; }}
    QPushButton#primary {{ background: {ours.accent}; color: {ours.on_accent}; border: 1px solid {ours.accent};
        border-radius: 4px; padding: 5px 14px; font-weight: 600; }}
    QPushButton#tile {{ background: {ours.panel}; border: 1px solid {ours.line}; border-radius: 4px; }}
    QPushButton#tile:hover {{ border-color: {ours.dim}; }}
    QPushButton#tile:focus {{ border: 2px solid {ours.focus}; }}
    QPushButton#primary:disabled {{ background: {ours.panel}; color: {ours.disabled}; border-color: {ours.line}; }}
    QPushButton#stop {{ background: {ours.bad}; color: {ours.window}; border-radius: 4px; padding: 5px 14px;
        font-weight: 700; }}
    QPushButton#primary:focus, QPushButton#stop:focus {{ border: 2px solid {ours.text}; padding: 4px 13px; }}
    QComboBox#flat {{ border: 1px solid transparent; background: transparent; padding: 0 3px; font-weight: 600; }}
    QComboBox#flat:focus {{ border: 1px solid {ours.focus}; padding: 0 3px; }}
    #plain {{ border: 1px solid transparent; }}
    #plain:focus {{ border: 1px solid {ours.focus}; }}
    QListWidget:focus, QTreeWidget:focus, QTableWidget:focus {{ border: 1px solid {ours.focus}; }}
    QToolButton#rail {{ border: none; border-radius: 5px; color: {ours.dim}; font-size: 8pt; padding-top: 4px; }}
    QToolButton#rail:hover {{ background: {ours.window}; }}
    QToolButton#rail:checked {{ background: {ours.window}; color: {ours.text}; }}
    QToolButton#rail:focus {{ border: 2px solid {ours.focus}; padding-top: 0; }}
    QToolTip {{ background: {ours.panel}; color: {ours.text}; border: 1px solid {ours.line}; padding: 4px; }}
    QProgressBar {{ background: {ours.line}; border: none; border-radius: 3px; max-height: 6px; }}
    QProgressBar::chunk {{ background: {ours.accent}; border-radius: 3px; }}
    QDialogButtonBox {{ dialogbuttonbox-buttons-have-icons: 0; }}
    QStatusBar {{ border-top: 1px solid {ours.line}; }}
    QStatusBar::item {{ border: none; }}
    """
