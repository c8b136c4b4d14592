"""A photograph against its re-rendering under a swipe, their difference beside it, and the views not yet rendered.

Views kept out of the fit are part of the result. The others are computed on demand, by a child.
"""

import numpy as np
from PySide6.QtCore import QCoreApplication, Qt, Signal
from PySide6.QtGui import QImage
from PySide6.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from app.inspect import falsecolour, maps
from app.inspect.maps import Picture
from app.views.background import Background
from app.views.elided import Elided
from app.views.errand import Errand
from app.views.legend import Legend
from app.views.maps.panel import MapPanel, Showing
from app.views.pictures.view import ImageView
from app.views.pictures.viewport import Viewport
from app.views.readout import told
from app.words import QT_TRANSLATE_NOOP
from app.work.jobs import Event
from engine.color import relative_error

DIMMED = 90  # of 256


class MapsSwipe(QWidget):
    """Left the photograph, right of the swipe the re-rendering; the difference in a panel of its own."""

    rendered = Signal(int)  # a view arrived
    failed = Signal(object)  # a Trouble

    def __init__(self, parent: QWidget | None, viewport: Viewport, background: Background) -> None:
        super().__init__(parent)
        self._background = background
        self._showing: Showing | None = None

        self.view = ImageView(self, viewport)
        self.view.labels = (self.tr("photographed"), self.tr("re-rendered"))
        self.view.setAccessibleName(self.tr("Photograph and re-rendering"))
        self.legend = Legend(self)
        self.difference = MapPanel(
            self, viewport, background, ("difference", "rerendered", "residual"), "difference"
        )

        self.said = Elided()
        self.said.setObjectName("dim")
        self.errand = Errand(self)
        self.errand.offer(self.tr("&Re-render all views"))
        self.errand.start.setToolTip(
            self.tr("Computes what the surface looks like in every view; this one first")
        )
        self.errand.wanted.connect(self.begin)
        self.errand.heard.connect(self._hear)
        self.errand.failed.connect(self.failed)

        left = QFrame()
        left.setObjectName("panel")
        foot = QHBoxLayout()
        foot.setContentsMargins(8, 2, 8, 3)
        foot.setSpacing(10)
        foot.addWidget(self.said, 1)
        foot.addWidget(self.errand)
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.view, 1)
        column.addLayout(foot)

        self.splitter = QSplitter(Qt.Orientation.Horizontal)
        self.splitter.addWidget(left)
        self.splitter.addWidget(self.difference)
        self.splitter.setStretchFactor(0, 3)
        self.splitter.setStretchFactor(1, 2)
        self.splitter.setChildrenCollapsible(False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.splitter)

    def show_run(self, showing: Showing | None) -> None:
        """Show a view of a run; a child at work on another run is stopped."""
        if showing is None or (self._showing is not None and showing.maps.run != self._showing.maps.run):
            self.errand.stop()
        self._showing = showing
        self.difference.show_run(showing)
        if showing is None:
            self.view.show_picture(None)
            self.said.clear()
            return
        if not self.isVisible():
            return
        self.errand.send("view", view=showing.view)
        self._background.ask("swipe", lambda: _draw(showing), self._show)

    def image(self) -> tuple[str, QImage | None]:
        """The difference, as it can be saved."""
        return self.difference.layer, self.difference.image()

    def begin(self) -> None:
        """Start re-rendering, the present view first."""
        if self._showing is None or self.errand.busy:
            return
        run = self._showing.maps.run
        request = {"session": str(run.session), "fingerprint": run.fingerprint, "view": self._showing.view}
        self.errand.begin(self.tr("Re-render views"), "rerender", request)

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self.show_run(self._showing)

    def _hear(self, event: Event) -> None:
        if "view" in event:
            view = int(event["view"])
            self.rendered.emit(view)
            if self._showing is not None and view == self._showing.view:
                self.difference.redraw()
                self.show_run(self._showing)

    def _show(self, drawn: "tuple[Picture | None, Picture | None, str]") -> None:
        photograph, rendering, said = drawn
        if photograph is None:
            self.view.show_picture(
                None,
                message=told(
                    QT_TRANSLATE_NOOP("maps", "The brackets are not merged yet, or their result was removed")
                ),
            )
        else:
            self.view.show_picture(photograph.levels, rendering.levels if rendering is not None else None)
        self.said.setText(said)


def _draw(showing: Showing) -> tuple[Picture | None, Picture | None, str]:
    """Both pictures, and the numbers of their difference."""
    photograph = maps.picture(showing.maps, showing.look("photograph"))
    rendering = maps.picture(showing.maps, showing.look("rerendered"))
    if photograph is not None and rendering is not None:
        # Outside the object the photograph goes on, dimmed: the eye keeps its place while swiping.
        base = photograph.levels[0].copy()
        base[..., :3] = (base[..., :3].astype(np.uint16) * DIMMED >> 8).astype(np.uint8)
        inside = rendering.levels[0][..., 3] > 0
        base[inside] = rendering.levels[0][inside]
        rendering = Picture(falsecolour.halves(base), None)
    return photograph, rendering, _said(showing)


def _said(showing: Showing) -> str:
    """How far photograph and re-rendering are apart, or why that is not known."""
    shown, view, translate = showing.maps, showing.view, QCoreApplication.translate
    if view < len(shown.registered) and not shown.registered[view]:
        return translate("maps", "This view has no pose, so it cannot be re-rendered")
    photographed, made = maps.photograph(shown, view), maps.rendering(shown, view)
    kind = (
        translate("maps", "validation view")
        if view in shown.held_out
        else translate("maps", "part of the fit")
    )
    if photographed is None or made is None:
        return f"{kind} · " + translate("maps", "not re-rendered yet")
    error = np.abs(relative_error(photographed, made, shown.surface.mask))
    middle, most = 100 * np.nanpercentile(error, [50, 95])
    apart = translate("maps", "difference of luminance: median {0:.1f} %, 95 % below {1:.0f} %").format(
        middle, most
    )
    return f"{kind} · {apart}"
