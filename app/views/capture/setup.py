"""The panel beside the picture: histogram, devices, turning, exposures, poses, session; the stop button at its foot."""

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QCheckBox, QFrame, QLabel, QVBoxLayout, QWidget

from app.capture.panel import PanelState
from app.capture.panel_state import Picture, Where
from app.capture.wanted import told_angle
from app.views.capture.bracket import BracketBox, Offered
from app.views.capture.devices import Devices, Live
from app.views.capture.histogram import Histogram
from app.views.capture.jog import Jog
from app.views.capture.place import PlaceBox
from app.views.capture.plan import PlanBox
from app.views.column import Column
from app.views.page_actions import action_button, tell_keys
from app.views.theme import LIGHT
from app.words import QT_TRANSLATE_NOOP
from hardware.interfaces import CameraStatus, State

WIDTH = 304
STOP_HEIGHT = 46

STATES = {
    State.UNHOMED: QT_TRANSLATE_NOOP("CaptureSetup", "not homed yet"),
    State.IDLE: QT_TRANSLATE_NOOP("CaptureSetup", "idle"),
    State.MOVING: QT_TRANSLATE_NOOP("CaptureSetup", "moving"),
    State.HOMING: QT_TRANSLATE_NOOP("CaptureSetup", "homing…"),
    State.HELD: QT_TRANSLATE_NOOP("CaptureSetup", "held"),
    State.FAULT: QT_TRANSLATE_NOOP("CaptureSetup", "fault"),
    State.OFFLINE: QT_TRANSLATE_NOOP("CaptureSetup", "does not answer"),
}  # fmt: skip


class CaptureSetup(QFrame):
    """Shows a `PanelState` in its sections."""

    def __init__(self, parent: QWidget | None, stop: QAction, clipping: QAction) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self.histogram = Histogram()
        self.clipping = QCheckBox(clipping.text())
        self.clipping.setAccessibleName(clipping.text().replace("&", ""))
        tell_keys(self.clipping, clipping)
        self.clipping.setChecked(clipping.isChecked())
        self.clipping.toggled.connect(clipping.setChecked)
        clipping.toggled.connect(self.clipping.setChecked)
        self.shares = QLabel()
        self.shares.setObjectName("dim")
        self.shares.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.shares.setAccessibleName(self.tr("How much is clipped and how much is dark"))
        self.devices, self.jog, self.bracket = Devices(), Jog(), BracketBox()
        self.plan, self.place = PlanBox(), PlaceBox()
        top = QVBoxLayout()
        top.setContentsMargins(14, 10, 14, 6)
        top.setSpacing(4)
        for part in (self.histogram, self.shares, self.clipping):
            top.addWidget(part)
        sections = QWidget()
        column = QVBoxLayout(sections)
        column.setContentsMargins(14, 6, 14, 12)
        column.setSpacing(14)
        for section in (self.devices, self.jog, self.bracket, self.plan, self.place):
            column.addWidget(section)
        column.addStretch(1)
        scroll = Column(sections, WIDTH, self)
        scroll.setAccessibleName(self.tr("Capture settings"))
        for part in (sections, scroll.viewport()):
            part.setAutoFillBackground(False)
        self.stop = action_button(stop, "stop")
        self.stop.setFixedHeight(STOP_HEIGHT)
        # The same red in both themes, as on the machines themselves.
        self.stop.setStyleSheet(
            f"QPushButton {{ background: {LIGHT.bad}; color: {LIGHT.on_accent}; font-size: 14pt; border: 2px solid {LIGHT.bad}; }}"
        )
        foot = QVBoxLayout()
        foot.setContentsMargins(14, 8, 14, 10)
        foot.addWidget(self.stop)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addLayout(top)
        layout.addWidget(scroll, 1)
        layout.addLayout(foot)

    def show_state(self, state: PanelState) -> None:
        """Everything as it is; asks for nothing."""
        found, rig, camera = state.found, state.rig, state.camera
        ports = [
            {"path": port.path, "description": port.description, "likely": port.likely}
            for port in found.ports
        ]
        cameras = [{"url": url, "name": name} for url, name in found.cameras]
        self.devices.show_found(found.rigs, ports, cameras)
        opening = state.order == "open"
        self.devices.show_open(state.open, opening, bool(state.order))
        if opening:
            share, words = state.working if state.working is not None else (None, "")
            self.devices.show_progress(share, words)
        self.devices.show_live(
            Live(
                rig.name if rig else "",
                self.tr("stopping…") if state.asked == "stop" else self._told_rig(state.where),
                state.rig_well,
            ),
            Live(camera.name if camera else "", self._told_camera(state.camera_now), _well(state.camera_now)),
        )
        axes = frozenset(axis.name for axis in rig.axes) if rig is not None else frozenset()
        free = state.open and not state.order
        if state.capturing:
            axes = frozenset()
        homes, lost = rig is None or rig.homes, rig is not None and state.where.pan_deg is None
        self.jog.show_able(axes, free and rig is not None, free and not lost, homes)
        self.jog.show_where(state.where.pan_deg, state.where.tilt_deg)
        if camera is not None:
            offered = Offered(camera.shutters_s, camera.isos, camera.apertures, camera.sets_exposure)
            self.bracket.show_offered(offered)
        self.bracket.show_able(free)
        for section in (self.bracket, self.plan, self.place):
            section.setEnabled(not state.capturing)
        self.place.show_under_way(state.session if state.capturing else None)
        self._show_picture(state.picture)

    def _show_picture(self, picture: Picture | None) -> None:
        counts = picture.histogram if picture is not None else None
        if picture is None or counts is None:
            self.histogram.show_counts({}, None)
        else:
            channels = {"r": counts.red, "g": counts.green, "b": counts.blue}
            self.histogram.show_counts(channels, counts.white)
        told = ""
        if picture is not None:
            told = self.tr("Clipped in all: {0:.1%}. Too dark: {1:.1%}").format(picture.clipped, picture.dark)
        self.shares.setText(told)

    def _told_rig(self, where: Where) -> str:
        parts = [self.tr(STATES[where.state])]
        if where.message:
            parts.append(where.message)
        elif where.pan_deg is not None:
            parts.append(told_angle(where.pan_deg))
            if where.tilt_deg is not None:
                parts.append(told_angle(where.tilt_deg))
        return "  ".join(parts)

    def _told_camera(self, now: CameraStatus | None) -> str:
        if now is None:
            return ""
        parts = [] if now.ready else [now.message or self.tr("not ready")]
        if now.battery is not None:
            parts.append(self.tr("battery {0:.0%}").format(now.battery))
        if now.free_shots is not None:
            parts.append(self.tr("room for {0}").format(now.free_shots))
        return ", ".join(parts) or self.tr("ready")


def _well(now: CameraStatus | None) -> bool:
    return now is None or now.ready
