"""The newest photograph of a capture, large, with what is clipped marked in it."""

from pathlib import Path

from PySide6.QtCore import QRectF, QSize, QSizeF, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from app.views import theme
from app.views.background import Background


class CapturePicture(QWidget):
    """Shows picture files as they come; reads them away from the window's thread, and keeps the newest alone."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._background = Background(self, "capture picture")
        self._asked: tuple[str, str] = ("", "")
        self._image: QImage | None = None
        self._clip: QImage | None = None
        self._clipping = True
        self.caption = ""
        self.message = ""  # in place of a picture
        self.setMinimumSize(160, 90)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setAccessibleName(self.tr("Photograph"))

    def sizeHint(self) -> QSize:
        return QSize(640, 420)

    @property
    def image(self) -> QImage | None:
        return self._image

    @property
    def clip(self) -> QImage | None:
        """The overlay, while it is shown."""
        return self._clip if self._clipping else None

    def show_files(self, png: str, clip_png: str, caption: str) -> None:
        """A photograph and its overlay ("": none); the one before stays until it is read."""
        if not png:
            self._background.drop("picture")
            self._asked, self._image, self._clip, self.caption = ("", ""), None, None, ""
            self.update()
            return
        if (png, clip_png) == self._asked:
            return
        self._asked = (png, clip_png)

        def read() -> tuple[QImage, QImage]:
            return read_picture(png), read_picture(clip_png)

        def arrived(pictures: tuple[QImage, QImage]) -> None:
            image, clip = pictures
            if image.isNull():
                return  # a newer one has taken its place on the disk already
            self._image, self._clip, self.caption = image, None if clip.isNull() else clip, caption
            self.setAccessibleDescription(caption)
            self.update()

        self._background.ask("picture", read, arrived)

    def show_clipping(self, shown: bool) -> None:
        self._clipping = shown
        self.update()

    def say(self, message: str) -> None:
        """What stands here while there is no picture."""
        if message != self.message:
            self.message = message
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        ours = theme.colours(self)
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(ours.picture))
        if self._image is None:
            painter.setPen(QColor(ours.dim))
            box = self.rect().adjusted(40, 12, -40, -12)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap, self.message)
            return
        target = self._fitted(self._image)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(target, self._image)
        if self._clip is not None and self._clipping:
            painter.drawImage(target, self._clip)
        if self.caption:
            self._caption(painter, ours, target)

    def _fitted(self, image: QImage) -> QRectF:
        """The whole picture, as large as it goes, and no pixel larger than two."""
        room = QSizeF(self.size())
        size = QSizeF(image.size()).scaled(room, Qt.AspectRatioMode.KeepAspectRatio)
        most = QSizeF(image.size()) * 2
        size = size.boundedTo(most) if size.width() > most.width() else size
        return QRectF(
            (room.width() - size.width()) / 2,
            (room.height() - size.height()) / 2,
            size.width(),
            size.height(),
        )

    def _caption(self, painter: QPainter, ours: theme.Palette, target: QRectF) -> None:
        metrics = painter.fontMetrics()
        box = QRectF(0, 0, metrics.horizontalAdvance(self.caption) + 14, metrics.height() + 6)
        box.moveBottomLeft(target.bottomLeft())
        box.translate(8, -8)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(theme.colour(ours.panel, 0.85))
        painter.drawRoundedRect(box, 3, 3)
        painter.setPen(QColor(ours.text))
        painter.drawText(box, Qt.AlignmentFlag.AlignCenter, self.caption)


def read_picture(path: str) -> QImage:
    """A picture that may be gone already; in any thread."""
    image = QImage(path) if path and Path(path).is_file() else QImage()
    # What a painter draws quickest: the conversion would otherwise be made at every painting, in the window's thread.
    return image if image.isNull() else image.convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)
