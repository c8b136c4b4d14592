"""The rail at the left: one button a page."""

from PySide6.QtCore import QCoreApplication, QSize, Qt, Signal
from PySide6.QtWidgets import QButtonGroup, QFrame, QSizePolicy, QToolButton, QVBoxLayout, QWidget

from app.views import icons, theme
from app.views.pages import PageRow

WIDTH = 84
HEIGHT, LOWEST = 54, 44  # of a button


class Rail(QFrame):
    """Tells `chosen` with the page's key."""

    chosen = Signal(str)

    def __init__(self, parent: QWidget | None, rows: tuple[PageRow, ...]) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self.setFixedWidth(WIDTH)
        self.buttons: dict[str, QToolButton] = {}
        group = QButtonGroup(self)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 8, 4, 8)
        layout.setSpacing(2)
        for row in rows:
            button = QToolButton()
            button.setObjectName("rail")
            button.setCheckable(True)
            button.setText(title(row))
            button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextUnderIcon)
            button.setIconSize(QSize(24, 24))
            button.setFixedWidth(WIDTH - 8)
            # In the lowest window they stand closer.
            button.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)
            button.setMinimumHeight(LOWEST)
            button.setMaximumHeight(HEIGHT)
            button.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
            button.setAccessibleName(title(row))
            tip = QCoreApplication.translate("pages", row.tip)
            button.setToolTip(f"{tip} ({row.shortcut})")
            button.clicked.connect(lambda checked=False, key=row.key: self.chosen.emit(key))
            group.addButton(button)
            layout.addWidget(button, HEIGHT)
            self.buttons[row.key] = button
        layout.addStretch(1)
        self._dress()

    def show_key(self, key: str) -> None:
        self.buttons[key].setChecked(True)
        # Also where the window is not active yet, and would light the first of them when it is.
        if self.window().focusWidget() in (None, *self.buttons.values()):
            self.buttons[key].setFocus()

    def changeEvent(self, event) -> None:
        super().changeEvent(event)
        if event.type() == event.Type.PaletteChange and hasattr(self, "buttons"):
            self._dress()

    def _dress(self) -> None:
        ours = theme.colours(self)
        for key, button in self.buttons.items():
            button.setIcon(icons.icon(key, ours.dim, 24, on=ours.accent))


def title(row: PageRow) -> str:
    return QCoreApplication.translate("pages", row.title)
