"""What is seen of a capture: the newest photograph large, below it poses, coverage and warnings side by side."""

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QSplitter, QVBoxLayout, QWidget

from app.capture.dots import Dot
from app.capture.panel import PanelState
from app.capture.panel_state import Picture
from app.capture.status import Severity
from app.capture.wanted import told_shutter
from app.views.capture.coverage import Coverage
from app.views.capture.findings import Findings, Told
from app.views.capture.picture import CapturePicture
from app.views.capture.sphere import Sphere

LOWEST_PX = 164  # of the strip below: a panorama over five lines of text
WORDS = {Severity.STOP: "stop", Severity.WARNING: "warn", Severity.NOTE: "note"}


class CaptureScene(QSplitter):
    """Shows a `PanelState`."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Vertical, parent)
        self.picture = CapturePicture()
        self.sphere, self.coverage, self.findings = Sphere(), Coverage(), Findings()
        self.warnings = QLabel()
        self.warnings.setTextFormat(Qt.TextFormat.PlainText)
        self.warnings.setContentsMargins(4, 0, 0, 0)
        told = QWidget()
        column = QVBoxLayout(told)
        column.setContentsMargins(6, 0, 0, 0)
        column.setSpacing(2)
        column.addWidget(self.warnings)
        column.addWidget(self.findings, 1)
        self.below = QSplitter()
        self.below.setContentsMargins(8, 6, 8, 8)
        self.below.setMinimumHeight(LOWEST_PX)
        for part, share in ((self.sphere, 3), (self.coverage, 5), (told, 5)):
            self.below.addWidget(part)
            self.below.setStretchFactor(self.below.count() - 1, share)
        self.below.setSizes([190, 330, 330])
        self.addWidget(self.picture)
        self.addWidget(self.below)
        self.setStretchFactor(0, 3)
        self.setStretchFactor(1, 1)
        self.setSizes([440, 210])
        for splitter in (self, self.below):
            splitter.setChildrenCollapsible(False)

    def show_state(self, state: PanelState, dots: Sequence[Dot], free: int) -> None:
        """
        Args:
            dots: poses that have a place.
            free: poses that have none.
        """
        self.picture.say(self._waiting_for(state))
        picture = state.picture
        if picture is None:
            self.picture.show_files("", "", "")
        else:
            clip = "" if picture.clip_png is None else str(picture.clip_png)
            self.picture.show_files(str(picture.png), clip, self._caption(picture))
        self.sphere.show_dots(
            dots, self.tr("{0} free poses").format(free) if free else self.tr("no poses yet")
        )
        self.sphere.show_here(state.where.pan_deg, state.where.tilt_deg)
        seen = state.coverage
        self.coverage.show_file("" if seen is None else str(seen.png))
        if seen is None:
            self.coverage.show_shares(None, None, "")
        else:
            self.coverage.show_shares(seen.share, seen.share_unclipped, seen.next)
        told = [Told(found.pose, found.text, WORDS[found.severity]) for found in state.findings]
        self.findings.show_findings(told)
        self.warnings.setText(
            self.tr("Warnings of the checks ({0})").format(len(told)) if told else self.tr("No warnings")
        )

    def _waiting_for(self, state: PanelState) -> str:
        if state.capturing or state.order == "preview":
            return self.tr("The photograph is on its way")
        if state.open:
            return self.tr("Take a test shot, or start the capture")
        return self.tr(
            "The photographs appear here.\n\nChoose rig and camera on the right and connect them: the virtual studio"
            " needs no hardware."
        )

    def _caption(self, picture: Picture) -> str:
        parts = [picture.pose or self.tr("a look, not kept")]
        if picture.shutter_s is not None:
            parts.append(told_shutter(picture.shutter_s))
        if picture.clipped_here > 0:
            parts.append(self.tr("{0:.1%} clipped in this exposure").format(picture.clipped_here))
        return ",  ".join(parts)
