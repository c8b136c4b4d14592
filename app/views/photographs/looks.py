"""What was seen of photographs: kept by an earlier look, or else the child's turn, one photograph after the other."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QImage

from app import photographs
from app.photographs import Look, Photograph
from app.state import Trouble
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.photographs.sheet import shrunk
from app.work.enquiries import Answer, Enquiries


class Looks(QObject):
    """Looks at one session's photographs; `left` changes with `changed`."""

    seen = Signal(Photograph, Look, QImage)
    failed = Signal(Photograph, Trouble)
    changed = Signal()

    def __init__(self, looker: Enquiries, background: Background, parent: QObject) -> None:
        super().__init__(parent)
        self._looker, self._background = looker, background
        self._bridge = Bridge(self)
        self._session: Path | None = None
        self._wanted: tuple[Photograph, ...] = ()
        self._waiting: deque[Photograph] = deque()  # nobody looked at these yet
        self._at: Photograph | None = None  # the child is at it

    @property
    def left(self) -> int:
        """Photographs that nobody looked at yet."""
        return len(self._waiting) + (self._at is not None)

    def want(self, session: Path | None, wanted: Sequence[Photograph]) -> None:
        """These are to be seen, and no others."""
        self._session, self._wanted = session, tuple(wanted)
        self._waiting.clear()
        for photograph in wanted:
            self._look_up(photograph)

    def go_on(self, first: Photograph | None = None) -> None:
        """Let the child look at one more, unless it is at one: at `first`, if that waits."""
        if self._at is not None or not self._waiting or self._session is None:
            return
        if first is not None and first in self._waiting:
            self._waiting.remove(first)
            self._waiting.appendleft(first)
        photograph = self._at = self._waiting.popleft()
        take = self._bridge.queued(lambda answer: self._looked(photograph, answer))
        self._looker.ask(
            "look", take, session=str(self._session), shot=photograph.shot, to=str(photograph.kept),
            edge_px=photographs.THUMBNAIL_EDGE_PX,
        )  # fmt: skip

    def _look_up(self, photograph: Photograph) -> None:
        def read() -> tuple[Look | None, QImage]:
            look = photographs.look(photograph.kept)
            file = photograph.kept.with_name(f"{photograph.kept.name}.png")
            picture = QImage() if look is None else shrunk(QImage(str(file)))
            return (None if picture.isNull() else look), picture

        def arrived(found: tuple[Look | None, QImage]) -> None:
            look, picture = found
            if photograph not in self._wanted:
                return
            if look is not None:
                self.seen.emit(photograph, look, picture)
            elif photograph not in self._waiting:
                self._waiting.append(photograph)
                self.changed.emit()

        self._background.ask(photograph.shot, read, arrived)

    def _looked(self, photograph: Photograph, answer: Answer) -> None:
        self._at = None
        if answer.trouble is not None:
            self.failed.emit(photograph, answer.trouble)
        elif photograph in self._wanted:
            self._look_up(photograph)
        self.changed.emit()
