"""A column of controls that scrolls up and down; its panel is never narrower than they are, in any theme, font or language."""

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QFrame, QScrollArea, QWidget


class Column(QScrollArea):
    """Shows `controls`."""

    def __init__(self, controls: QWidget, least_px: int, panel: QWidget | None = None) -> None:
        """
        Args:
            least_px: how wide it is at least.
            panel: what it fills from left to right and is held as wide as it; None: itself.
        """
        super().__init__()
        self._controls, self._least_px, self._panel = controls, least_px, panel or self
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setWidget(controls)
        self.verticalScrollBar().setAccessibleName(self.tr("More controls"))
        self.verticalScrollBar().installEventFilter(self)
        self._panel.setFixedWidth(least_px)

    def eventFilter(self, of: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.LayoutRequest, QEvent.Type.Show, QEvent.Type.Hide):
            bar = self.verticalScrollBar()
            needed_px = self._controls.minimumSizeHint().width() + (bar.width() if bar.isVisible() else 0)
            self._panel.setFixedWidth(max(self._least_px, needed_px))
        return super().eventFilter(of, event)
