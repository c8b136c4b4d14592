"""What a folder of photographs holds, before anything is made of it: how many, in which brackets, and some of them small."""

import tempfile
from pathlib import Path

from PySide6.QtCore import QSize, Qt, QTimer, Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from app.state import Trouble
from app.views.bridge import Bridge
from app.words import sentence
from app.work.enquiries import Answer, Enquiries

SHOWN, PICTURE = 6, QSize(88, 62)
PATIENCE_MS = 250  # a path that is being typed names many folders on its way


class FolderLook(QWidget):
    """Looks at one folder after the other; `looked` tells that `ready` may have changed."""

    looked = Signal()

    def __init__(self, enquiries: Enquiries, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._enquiries = enquiries
        self._bridge = Bridge(self)
        self._scratch = tempfile.TemporaryDirectory(prefix="roomlight-import-")
        self._folder, self._number = "", 0
        self._bracket: int | None = None
        self.ready = False  # the folder can be imported
        self.told = QLabel()
        self.told.setWordWrap(True)
        self.told.setTextFormat(Qt.TextFormat.PlainText)
        self.told.setMinimumHeight(2 * self.told.fontMetrics().lineSpacing())
        self.told.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.told.setAccessibleName(self.tr("What the folder holds"))
        self.pictures = [QLabel() for _ in range(SHOWN)]
        row = QHBoxLayout()
        row.setSpacing(6)
        for picture in self.pictures:
            picture.setFixedSize(PICTURE)
            picture.setAlignment(Qt.AlignmentFlag.AlignCenter)
            row.addWidget(picture)
        row.addStretch(1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(6)
        column.addWidget(self.told)
        column.addLayout(row)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._ask)
        # Qt takes this widget down with its dialog, which may be later than the last reference to it.
        scratch = self._scratch
        self.destroyed.connect(lambda gone: scratch.cleanup())

    def look(self, folder: str, bracket: int | None, at_once: bool = False) -> None:
        """Look at a folder, soon; `bracket` exposures a view, None: found out."""
        self._folder, self._bracket = folder, bracket
        self._number += 1
        self.ready = False
        for picture in self.pictures:
            picture.clear()
        self.told.setText(self.tr("Looking at the folder…") if folder else "")
        self._timer.start(0 if at_once else PATIENCE_MS)
        self.looked.emit()

    def _ask(self) -> None:
        if not self._folder:
            return
        take, number = self._bridge.queued(self._take), self._number
        self._enquiries.ask(
            "folder", lambda answer: take(number, answer), folder=self._folder, bracket=self._bracket, shown=SHOWN
        )  # fmt: skip

    def _take(self, number: int, answer: Answer) -> None:
        if number != self._number:
            return
        content = answer.content
        self.ready = content is not None
        self.told.setProperty("grade", "good" if self.ready else "doubted")
        self.told.style().polish(self.told)
        if content is None:
            self.told.setText(_refusal(answer.trouble or Trouble("")))
            self.looked.emit()
            return
        kind = self.tr("RAW files") if content["kind"] == "raw" else self.tr("linear images")
        told = [self.tr("{0} {1}").format(content["files"], kind)]
        if content["exposures"] > 1:
            told.append(
                self.tr("{0} brackets of {1} exposures").format(content["views"], content["exposures"])
            )
        told += [content["camera"]] if content["camera"] else []
        told.append(self.tr("{0} x {1}").format(content["width"], content["height"]))
        self.told.setText("\n".join(["  ·  ".join(told), *content["notes"]]))
        ratio = round(self.devicePixelRatioF() + 0.49)
        for place, file in enumerate(content["shown"]):
            arrived = self._bridge.queued(self._show)
            self._enquiries.ask(
                "preview", lambda answer, place=place, arrived=arrived: arrived(number, place, answer), file=file,
                edge_px=PICTURE.height() * ratio, to=str(Path(self._scratch.name) / f"{number}-{place}.png"),
            )  # fmt: skip
        self.looked.emit()

    def _show(self, number: int, place: int, answer: Answer) -> None:
        picture = None if answer.content is None else answer.content["picture"]
        if number != self._number or picture is None:
            return
        ratio = self.devicePixelRatioF()
        keep, smooth = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
        shown = QPixmap(str(picture)).scaled(PICTURE * ratio, keep, smooth)
        shown.setDevicePixelRatio(ratio)
        self.pictures[place].setPixmap(shown)


def _refusal(fault: Trouble) -> str:
    return sentence(". ".join(part for part in (fault.what, sentence(fault.remedy)) if part))
