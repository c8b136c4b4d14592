"""One photograph large: its small picture at once, the large one as soon as the child has made it, what is clipped over it."""

import itertools
import tempfile
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QWidget

from app.inspect import falsecolour
from app.photographs import Photograph
from app.state import Trouble
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.pictures.view import ImageView
from app.work.enquiries import Answer, Enquiries

EDGE_PX = 3200
KEPT = 4  # files of large pictures: one may still be read while the next is written

Pixels = UInt8[np.ndarray, "h w 4"]  # as Qt draws them, premultiplied


class LargePhotograph(ImageView):
    """Zoom and place stay from one photograph to the next, so that they can be compared."""

    def __init__(self, looker: Enquiries, background: Background, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName(self.tr("Photograph"))
        self._looker, self._background = looker, background
        self._bridge = Bridge(self)
        self._scratch = tempfile.TemporaryDirectory(prefix="roomlight-photographs-")
        self._numbers = itertools.count(1)
        self._newest = 0  # of the large pictures asked for
        self._pictures: tuple[Pixels, Pixels] | None = None  # the large one, and what is clipped of it
        self._refused = False  # the photograph cannot be read: that stays told
        self._clipping = False

    def show_photograph(
        self, session: Path | None, photograph: Photograph | None, exposure: int | None
    ) -> None:
        """Another photograph, or another exposure of its bracket."""
        self._newest, self._pictures, self._refused = next(self._numbers), None, False
        if session is None or photograph is None:
            self.show_picture(None)
            return
        self.show_small(photograph)
        number, to = self._newest, Path(self._scratch.name) / f"large-{self._newest % KEPT}"
        arrived = self._bridge.queued(lambda answer: self._made(number, to, answer))
        self._looker.ask(
            "photograph", arrived, session=str(session), shot=photograph.shot, to=str(to), edge_px=EDGE_PX,
            exposure=exposure,
        )  # fmt: skip

    def show_small(self, photograph: Photograph) -> None:
        """In the large one's place until it is there."""
        self._background.ask("small", lambda: _pixels(photograph.kept), self._take_small)

    def show_clipping(self, shown: bool) -> None:
        self._clipping = shown
        self._draw()

    def close_files(self) -> None:
        self._scratch.cleanup()

    def _take_small(self, small: Pixels | None) -> None:
        if self._pictures is not None or self._refused:
            return
        if small is None:
            self.show_picture(None, message=self.tr("Reading the photograph…"))
            return
        known = self.viewport.picture
        if known.width <= 1 or abs(small.shape[1] / small.shape[0] * known.height / known.width - 1) > 0.05:
            self.viewport.show(small.shape[1], small.shape[0], None)
        self.show_picture([small])

    def _made(self, number: int, to: Path, answer: Answer) -> None:
        if number != self._newest:
            return
        if answer.trouble is not None:
            self._refuse(answer.trouble)
            return

        def arrived(pictures: tuple[Pixels | None, Pixels | None]) -> None:
            picture, clip = pictures
            if number == self._newest and picture is not None and clip is not None:
                self._pictures = picture, clip
                self.viewport.show(picture.shape[1], picture.shape[0], None)
                self._draw()

        clipped = to.with_name(f"{to.name}.clip")
        self._background.ask("large", lambda: (_pixels(to), _pixels(clipped)), arrived, self._refuse)

    def _refuse(self, fault: Trouble) -> None:
        self._refused = True
        self.show_picture(None, message=". ".join(part for part in (fault.what, fault.remedy) if part))

    def _draw(self) -> None:
        if self._pictures is None:
            return
        (picture, clip), marked = self._pictures, self._clipping
        self._background.ask(
            "draw", lambda: falsecolour.halves(_over(picture, clip) if marked else picture), self.show_picture
        )  # fmt: skip


def _pixels(base: Path) -> Pixels | None:
    """A picture that the child wrote; None where it is not there. In any thread."""
    image = QImage(str(base.with_name(f"{base.name}.png")))
    if image.isNull():
        return None
    image = image.convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)
    rows = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    return rows[:, : 4 * image.width()].reshape(image.height(), image.width(), 4).copy()


def _over(picture: Pixels, clip: Pixels) -> Pixels:
    """What is clipped laid over the picture."""
    under = 255 - clip[..., 3:].astype(np.uint16)
    return clip + (picture * under // 255).astype(np.uint8)
