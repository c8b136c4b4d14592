"""Line icons in the colours of the theme, drawn from paths on a 24 x 24 grid; our own drawings."""

from PySide6.QtCore import QByteArray, QEvent, QObject, QSize, Qt
from PySide6.QtGui import QIcon, QPainter, QPixmap
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QAbstractButton, QToolButton

from app.views import theme

PATHS = {
    "start": "M4 11 L12 4 L20 11 V20 H14.5 V14 H9.5 V20 H4 Z",
    "capture": "M3 8 H7 L9 5 H15 L17 8 H21 V19 H3 Z M12 9.5 a4 4 0 1 0 .01 0 Z",
    "photographs": "M3 4 H10 V10 H3 Z M14 4 H21 V10 H14 Z M3 14 H10 V20 H3 Z M14 17 L16.5 20 L21 14",
    "process": "M4 6 H14 M4 12 H20 M4 18 H11 M17 3.5 V8.5 M17 15.5 L21 18 L17 20.5 Z",
    "mask": "M4 8 V4 H8 M16 4 H20 V8 M20 16 V20 H16 M8 20 H4 V16 M12 7.5 a2.3 2.3 0 1 0 .01 0 Z M7.5 17.5 a4.5 4.5 0 0 1 9 0",
    "view3d": "M12 3 L20 7.5 V16.5 L12 21 L4 16.5 V7.5 Z M4 7.5 L12 12 L20 7.5 M12 12 V21",
    "maps": "M4 4 H20 V20 H4 Z M12 4 V20 M4 12 H20 M15 8 h2 M7 16 h2",
    "charts": "M4 4 V20 H20 M7 15 L11 10 L14.5 13 L19.5 6.5",
    "relight": "M12 8 a4 4 0 1 0 .01 0 Z M12 2.5 V5 M12 19 V21.5 M2.5 12 H5 M19 12 H21.5 M5.3 5.3 L7 7 M17 17 L18.7 18.7"
    " M5.3 18.7 L7 17 M17 7 L18.7 5.3",
    "export": "M12 15 V4 M8 8 L12 4 L16 8 M5 13 V20 H19 V13",
    "import": "M12 4 V15 M8 11 L12 15 L16 11 M5 13 V20 H19 V13",
    "open": "M3 19 V5 H9 L11 7.5 H19 V10 M3 19 L6 10 H22 L19 19 Z",
    "done": "M5 12.5 L10 17.5 L19.5 7",
    "stale": "M12 4 a8 8 0 1 0 .01 0 Z M12 7.5 V12 L15 14",
    "running": "M7 5 L19 12 L7 19 Z",
    "failed": "M6 6 L18 18 M18 6 L6 18",
    "reset": "M5 5 V10 H10 M5.6 9.6 A7.5 7.5 0 1 1 4.6 13",
    "up": "M6 15 L12 9 L18 15",
    "down": "M6 9 L12 15 L18 9",
    "remove": "M6 6 L18 18 M18 6 L6 18",
    "more": "M5 12 h.01 M12 12 h.01 M19 12 h.01",
    "note": "M12 3.5 a8.5 8.5 0 1 0 .01 0 Z M12 11 V16.5 M12 7.5 v.01",
    "disk": "M4 13 V19 H20 V13 M4 13 L7 5 H17 L20 13 Z M16.5 16 h.01",
    "chip": "M7 7 H17 V17 H7 Z M10 3.5 V7 M14 3.5 V7 M10 17 V20.5 M14 17 V20.5 M3.5 10 H7 M3.5 14 H7 M17 10 H20.5"
    " M17 14 H20.5",
    "brush": "M4 20 C3.5 16 7 13.5 9.5 16 C11.5 18.5 8.5 20.5 4 20 Z M9.5 15.5 L18.5 4 L20.5 5.8 L11 16.5",
    "eraser": "M8.5 19.5 L3.5 14.5 L14 4 L20.5 10.5 L11.5 19.5 Z M8.5 9.5 L15 16 M11.5 19.5 H20.5",
    "polygon": "M5 10 L13 4 L20 9.5 L16.5 19 L7 18 Z",
    "add": "M12 5 V19 M5 12 H19",
    "subtract": "M5 12 H19",
    "exact": "M12 3 V9 M12 15 V21 M3 12 H9 M15 12 H21 M12 12 v.01",
    "grid": "M4 4 H10.5 V10.5 H4 Z M13.5 4 H20 V10.5 H13.5 Z M4 13.5 H10.5 V20 H4 Z M13.5 13.5 H20 V20 H13.5 Z",
    "swipe": "M3 5 H21 V19 H3 Z M12 3 V21 M8.5 9.5 L6 12 L8.5 14.5 M15.5 9.5 L18 12 L15.5 14.5",
    "compare": "M4 4 H15 V15 H4 Z M18 9 H20 V20 H9 V18",
    "warning": "M12 4 L21.5 20 H2.5 Z M12 10 V14.5 M12 17 v.01",
}

SCALES = (1.0, 2.0, 3.0)


def icon(name: str, colour: str, size: int = 24, on: str | None = None) -> QIcon:
    """The icon in `colour`, sharp at every scale of the screen; `on` is its colour while checked."""
    made = QIcon()
    for scale in SCALES:
        made.addPixmap(pixmap(name, colour, size, scale))
        if on is not None:
            made.addPixmap(pixmap(name, on, size, scale), QIcon.Mode.Normal, QIcon.State.On)
    return made


def pixmap(name: str, colour: str, size: int = 24, scale: float = 1.0) -> QPixmap:
    """The icon as a picture of `size` logical pixels."""
    drawing = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 24 24"><path d="{PATHS[name]}" fill="none"'
        f' stroke="{colour}" stroke-width="1.7" stroke-linecap="round" stroke-linejoin="round"/></svg>'
    )
    picture = QPixmap(QSize(size, size) * scale)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    QSvgRenderer(QByteArray(drawing.encode())).render(painter)
    painter.end()
    picture.setDevicePixelRatio(scale)
    return picture


def wear(button: QAbstractButton, name: str, size: int = 16) -> None:
    """Let the button have the icon beside its words, in the colours of the theme, whichever comes."""
    if isinstance(button, QToolButton):
        button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
    button.setIconSize(QSize(size, size))
    button.installEventFilter(_Dresser(button, name, size))


class _Dresser(QObject):
    """Lives with its button."""

    def __init__(self, button: QAbstractButton, name: str, size: int) -> None:
        super().__init__(button)
        self._button, self._name, self._size = button, name, size
        self._dress()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()
        return False

    def _dress(self) -> None:
        ours = theme.colours(self._button)
        self._button.setIcon(icon(self._name, ours.text, self._size, on=ours.on_accent))
