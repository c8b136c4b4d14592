"""The bar over the picture: which session, what the capture is doing, how far, how long still, and its buttons."""

from PySide6.QtCore import QCoreApplication
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QLabel, QProgressBar, QVBoxLayout, QWidget

from app.capture.panel import PanelState
from app.capture.panel_state import Going
from app.capture.status import Phase
from app.plan import told_seconds
from app.views.head import Head
from app.views.page_actions import action_button
from app.words import QT_TRANSLATE_NOOP

PHASES = {
    Phase.PREPARING: QT_TRANSLATE_NOOP("CaptureBar", "preparing"),
    Phase.HOMING: QT_TRANSLATE_NOOP("CaptureBar", "finding the zero"),
    Phase.MOVING: QT_TRANSLATE_NOOP("CaptureBar", "moving"),
    Phase.EXPOSING: QT_TRANSLATE_NOOP("CaptureBar", "photographing"),
    Phase.DOWNLOADING: QT_TRANSLATE_NOOP("CaptureBar", "downloading"),
    Phase.FILING: QT_TRANSLATE_NOOP("CaptureBar", "checking and keeping"),
    Phase.RECOVERING: QT_TRANSLATE_NOOP("CaptureBar", "trying again"),
    Phase.PAUSED: QT_TRANSLATE_NOOP("CaptureBar", "paused"),
    Phase.LOOKING: QT_TRANSLATE_NOOP("CaptureBar", "looking at the last photographs"),
    Phase.ENDED: QT_TRANSLATE_NOOP("CaptureBar", "ended"),
}  # fmt: skip


class CaptureBar(QWidget):
    """Shows what it is told; its buttons are the page's actions."""

    def __init__(self, parent: QWidget | None, start: QAction, pause: QAction, cancel: QAction) -> None:
        super().__init__(parent)
        self.head = Head(self, start)
        self.name, self.phase = self.head.name, self.head.state
        self.phase.setAccessibleName(self.tr("What the capture is doing"))
        self.left = QLabel()
        self.left.setAccessibleName(self.tr("How far, and how long still"))
        self.bar = QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedHeight(4)
        policy = self.bar.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.bar.setSizePolicy(policy)
        self.bar.setAccessibleName(self.tr("Progress of the capture"))
        self.head.add(self.left, action_button(pause), action_button(cancel))
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.head)
        column.addWidget(self.bar)

    def show_state(self, state: PanelState, idle: str) -> None:
        """
        Args:
            idle: what stands in place of a phase while nothing is captured.
        """
        going = state.going if state.capturing else None
        named = state.session if going is not None else None
        if named != self.head.session:
            self.head.show_session(named)
        if named is None:
            self.head.show_name(self.tr("New capture"))
        if state.ending:
            self.phase.setText(
                self.tr("stopping…") if state.asked == "stop" else self.tr("ending after this exposure…")
            )
        elif state.working is not None:
            # A virtual room is built when its camera first exposes.
            share, words = state.working
            self.phase.setText(self.tr("building the virtual room, {0:.0%}: {1}").format(share, words))
        else:
            self.phase.setText(idle if going is None else _told_phase(going, state.paused))
        self.left.setText("" if going is None else self._told_left(going))
        self.bar.setVisible(going is not None or state.working is not None)
        share = going.taken / going.total if going is not None and going.total else 0.0
        self.bar.setValue(round(1000 * (state.working[0] if state.working is not None else share)))

    def _told_left(self, going: Going) -> str:
        if not going.total:
            return ""
        count = self.tr("{0} of {1} poses").format(going.taken, going.total)
        if going.left_s is None or going.taken >= going.total:
            return count
        return self.tr("{0}, about {1} left").format(count, told_seconds(going.left_s))


def _told_phase(going: Going, paused: bool) -> str:
    phase = QCoreApplication.translate("CaptureBar", PHASES[going.phase])
    if paused and going.phase is not Phase.PAUSED:
        phase = QCoreApplication.translate("CaptureBar", "{0}, then pauses").format(phase)
    about = going.message or (going.pose or "")
    return f"{phase}: {about}" if about else phase
