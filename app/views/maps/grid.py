"""The maps of a run side by side, linked; a double click lets one fill the page."""

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QGridLayout, QWidget

from app.inspect.maps import LAYERS
from app.views.background import Background
from app.views.maps.panel import MapPanel, Showing
from app.views.pictures.viewport import Viewport

FIRST = ("photograph", "normal", "albedo", "roughness", "depth", "stderr_normal", "residual", "flags")
ARRANGEMENTS = {1: (1, 1), 2: (1, 2), 4: (2, 2), 6: (2, 3), 8: (2, 4)}  # panels -> rows, columns


class MapsGrid(QWidget):
    """Panels of which each shows what a person chose."""

    arranged = Signal(int)

    def __init__(self, parent: QWidget | None, viewport: Viewport, background: Background) -> None:
        super().__init__(parent)
        self._viewport = viewport
        self._count = self._before = 6
        self.panels = [MapPanel(self, viewport, background, list(LAYERS), layer) for layer in FIRST]
        for panel in self.panels:
            panel.view.activated.connect(lambda panel=panel: self.enlarge(panel))
        self._layout = QGridLayout(self)
        self._layout.setContentsMargins(0, 0, 0, 0)
        self._layout.setSpacing(2)
        self._place(self.panels[: self._count])

    @property
    def count(self) -> int:
        """How many panels there are."""
        return self._count

    def arrange(self, count: int) -> None:
        """Show 1, 2, 4, 6 or 8 panels."""
        if count not in ARRANGEMENTS or count == self._count:
            return
        self._before, self._count = self._count, count
        self._place(self.panels[:count])
        self.arranged.emit(count)

    def enlarge(self, panel: MapPanel) -> None:
        """Let one panel fill the page, or all come back."""
        if self._count == 1:
            self.arrange(self._before)
            return
        if panel is not self.panels[0]:
            # The first panel takes over what was double-clicked; back again, each has its own.
            first, other = self.panels[0].layer, panel.layer
            self.panels[0].set_layer(other)
            panel.set_layer(first)
        self.arrange(1)

    def show_run(self, showing: Showing | None) -> None:
        for panel in self.panels:
            panel.show_run(showing)

    def redraw(self, layers: Sequence[str]) -> None:
        """Draw panels of these layers again."""
        for panel in self.panels:
            if panel.layer in layers:
                panel.redraw()

    def chosen(self) -> MapPanel:
        """The panel that has the focus, or else the first."""
        return next(
            (panel for panel in self.panels if panel.isVisible() and panel.view.hasFocus()), self.panels[0]
        )

    def image(self) -> tuple[str, QImage | None]:
        """The chosen panel's layer and picture."""
        panel = self.chosen()
        return panel.layer, panel.image()

    def _place(self, shown: Sequence[MapPanel]) -> None:
        rows, columns = ARRANGEMENTS[len(shown)]
        for panel in self.panels:
            self._layout.removeWidget(panel)
            panel.setVisible(panel in shown)
        for i in range(4):
            self._layout.setColumnStretch(i, 1 if i < columns else 0)
            self._layout.setRowStretch(i, 1 if i < rows else 0)
        for i, panel in enumerate(shown):
            self._layout.addWidget(panel, i // columns, i % columns)
        self._viewport.refit()
