"""The verdict of a session's result, over what it is of."""

from html import escape

from PySide6.QtWidgets import QLabel, QWidget

from app.words import sentence
from engine.results.quality import Quality


class Verdict(QLabel):
    """One line that wraps; nothing while there is no result."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWordWrap(True)
        self.setContentsMargins(16, 4, 16, 6)
        self.setAccessibleName(self.tr("Quality of the result"))
        self.show_quality(None)

    def show_quality(self, quality: Quality | None) -> None:
        self.setVisible(quality is not None)
        if quality is None:
            self.clear()
            return
        self.setProperty("grade", "good" if quality.good else "doubted")
        self.style().polish(self)
        told = f"{quality.reason} {quality.remedy}".strip()
        self.setText(
            self.tr("<b>Quality: {0}.</b> {1}").format(escape(quality.grade), escape(sentence(told)))
        )
