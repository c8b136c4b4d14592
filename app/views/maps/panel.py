"""One map: which it is (a list to choose from), the picture, its legend."""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QComboBox, QFrame, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from app.inspect import maps
from app.inspect.maps import LAYERS, Look, Maps, Picture
from app.state import Trouble
from app.views.background import Background
from app.views.legend import Legend
from app.views.pictures.view import ImageView
from app.views.pictures.viewport import Viewport
from app.views.readout import told
from app.words import QT_TRANSLATE_NOOP


@dataclass(frozen=True, slots=True, eq=False)
class Showing:
    """What all panels of a page show of a run."""

    maps: Maps
    view: int
    normal_frame: str
    exposure_ev: float
    tone: str
    mark_clipped: bool

    def look(self, layer: str) -> Look:
        return Look(layer, self.view, self.normal_frame, self.exposure_ev, self.tone, self.mark_clipped)


class MapPanel(QFrame):
    """A map that follows a shared viewport; its layer is the person's choice where several are offered."""

    chosen = Signal(str)  # a layer

    def __init__(
        self,
        parent: QWidget | None,
        viewport: Viewport,
        background: Background,
        layers: Sequence[str],
        layer: str,
    ) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self._background = background
        self._showing: Showing | None = None
        self._drawn: Look | None = None
        self._drawn_of: Maps | None = None
        self.view = ImageView(self, viewport)
        self.legend = Legend(self)
        self.picker = QComboBox()
        self.picker.setObjectName("flat")
        self.picker.setAccessibleName(self.tr("Map"))
        self.picker.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        for key in layers:
            self.picker.addItem(told(LAYERS[key].title), key)
        self.picker.setCurrentIndex(self.picker.findData(layer))
        self.picker.currentIndexChanged.connect(self._pick)
        self.caption = QLabel()
        self.caption.setObjectName("dim")
        self.head = QHBoxLayout()
        self.head.setContentsMargins(4, 2, 8, 2)
        self.head.addWidget(self.picker)
        self.head.addWidget(self.caption, 1, Qt.AlignmentFlag.AlignRight)
        foot = QHBoxLayout()
        foot.setContentsMargins(8, 1, 8, 2)
        foot.addWidget(self.legend)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addLayout(self.head)
        layout.addWidget(self.view, 1)
        layout.addLayout(foot)
        self._name()

    @property
    def layer(self) -> str:
        return self.picker.currentData()

    def set_layer(self, layer: str) -> None:
        self.picker.setCurrentIndex(self.picker.findData(layer))

    def show_run(self, showing: Showing | None) -> None:
        """Draw the layer of a run, off the window's thread; nothing is drawn twice."""
        self._showing = showing
        if showing is None:
            self._drawn = None
            self._background.drop(self._key)
            self.view.show_picture(None)
            self.legend.show_scale(None)
            return
        if not self.isVisible():
            return
        look = showing.look(self.layer)
        if self._drawn == look and self._drawn_of is showing.maps:
            return
        self._drawn, self._drawn_of = look, showing.maps
        self._background.ask(
            self._key,
            lambda: maps.picture(showing.maps, look),
            lambda made: self._draw(look, made),
            self._fail,
        )

    def redraw(self) -> None:
        """Draw again, though nothing was chosen otherwise: a re-rendering arrived."""
        self._drawn = None
        self.show_run(self._showing)

    def image(self) -> QImage | None:
        """What is shown, at the photographs' size."""
        return self.view.full

    def showEvent(self, event) -> None:
        super().showEvent(event)
        self.show_run(self._showing)

    @property
    def _key(self) -> str:
        return f"panel {id(self)}"

    def _pick(self) -> None:
        self._name()
        self.show_run(self._showing)
        self.chosen.emit(self.layer)

    def _name(self) -> None:
        title = told(LAYERS[self.layer].title)
        self.view.setAccessibleName(title)
        self.picker.setToolTip(self.tr("Choose what this panel shows"))

    def _draw(self, look: Look, made: Picture | None) -> None:
        if made is None:
            self.view.show_picture(None, message=missing(look, self._showing))
            self.legend.show_scale(None)
            return
        numbers, inside = made.values, self._showing.maps.surface.mask if self._showing else None
        self.view.pixel_text = None
        if numbers is not None and inside is not None:
            self.view.pixel_text = lambda x, y: f"{numbers[y, x]:.3g}" if inside[y, x] else ""
        self.view.show_picture(made.levels)
        self.legend.show_scale(made.scale, told(made.note), look.layer, look.normal_frame)

    def _fail(self, fault: Trouble) -> None:
        self.view.show_picture(None, message=f"{fault.what}\n{fault.remedy}")
        self.legend.show_scale(None)


def missing(look: Look, showing: Showing | None) -> str:
    """Why a picture is not there."""
    if showing is None or showing.maps.frames is None:
        return told(
            QT_TRANSLATE_NOOP(
                "maps", "The brackets are not merged yet, or their result was removed; process the session"
            )
        )
    if look.layer in ("rerendered", "difference"):
        return told(
            QT_TRANSLATE_NOOP(
                "maps", "This view is not re-rendered yet: Re-render all views, under Swipe, does it"
            )
        )
    return told(QT_TRANSLATE_NOOP("maps", "Not there"))
