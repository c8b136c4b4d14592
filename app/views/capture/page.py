"""The Capture page: rig and camera, the photographs as they come, the poses, the light they cover, and what to mend.

What happens lies in the desk's child; `PanelState` is all that this page shows of it. Leaving the page lets a
capture go on; closing the window asks first, and the session resumes.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from PySide6.QtGui import QCloseEvent, QShowEvent
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from app.capture import dots as capture_dots
from app.capture import wanted
from app.capture.dots import Course
from app.capture.panel import Panel, PanelState
from app.capture.wanted import Captured
from app.state import Device, Trouble
from app.views.background import Background
from app.views.bridge import Bridge
from app.views.capture import actions as capture_actions
from app.views.capture.actions import Intents
from app.views.capture.banner import Banner
from app.views.capture.bar import CaptureBar
from app.views.capture.choices import Answers, choices
from app.views.capture.notices import Matter, Seen, notice, stops
from app.views.capture.scene import CaptureScene
from app.views.capture.setup import CaptureSetup
from app.views.page_column import lay_out
from app.views.pages import Shell

OPENING = frozenset({"open", "resume"})


class CapturePage(QWidget):
    """The scene in the middle, a bar and a banner over it, settings beside."""

    def __init__(self, parent: QWidget | None = None, make_panel: Callable[[], Panel] = Panel) -> None:
        super().__init__(parent)
        self.title = self.tr("Capture")
        self.setAccessibleName(self.title)
        self.panel = panel = make_panel()
        self.state: PanelState = panel.state
        self.captured: Captured | None = None  # the open session, where it is a capture
        self._shell: Shell | None = None
        self._folder: Path | None = None
        self._looked = False  # for what is plugged in
        self._seen = Seen()
        self._course = Course()
        self._background = Background(self, "capture")
        self._bridge = Bridge(self)
        self.does = actions = capture_actions.make(
            self, Intents(self._start, self._pause, panel.end, panel.stop, panel.answer)
        )
        self._answers = Answers(
            panel.answer, self._go_on, panel.end, self._resume, self._process, self._tell, self._put_away
        )
        self.bar = CaptureBar(self, actions.start, actions.pause, actions.end)
        self.banner, self.scene = Banner(), CaptureScene()
        self.setup = CaptureSetup(self, actions.stop, actions.clipping)
        self._lay_out()
        self._connect()
        panel.listen(self._bridge.latest(lambda state: self._show(panel.state)))
        self.destroyed.connect(lambda: panel.shut())
        self._show(self.state)

    # The contract with the window

    def use(self, shell: Shell) -> None:
        self._shell = shell
        self._offer_place()
        self.show_session(shell.state.session.value)

    def show_session(self, folder: Path | None) -> None:
        """Look whether the open session is a capture, and how much of it is left."""
        self._folder = folder
        if folder is None:
            self._background.drop("captured")
            self._take_captured(None)
        else:
            self._background.ask("captured", lambda: wanted.captured(folder), self._take_captured)

    def new_capture(self) -> None:
        """Make ready for a new session; a capture under way goes on."""
        if self.state.capturing:
            return
        self._see(told=self.state.troubles, ended=self.state.ended, captured=self.captured)
        self.setup.place.named = False
        self._offer_place()
        (self.setup.plan.kind if self.state.open else self.setup.devices.toggle).setFocus()

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        if not self._looked:
            self._looked = True
            self.panel.look()
            self._ask_plan()
        self.show_session(self._folder)  # a pose may have been put aside since, to be taken again

    def closeEvent(self, event: QCloseEvent) -> None:
        self.panel.shut()
        super().closeEvent(event)

    # Building

    def _lay_out(self) -> None:
        left = QVBoxLayout()
        left.setSpacing(0)
        left.addWidget(self.banner)
        left.addWidget(self.scene, 1)
        across = QHBoxLayout()
        across.setSpacing(0)
        across.addLayout(left, 1)
        across.addWidget(self.setup)
        lay_out(self, self.bar, across)

    def _connect(self) -> None:
        setup, panel = self.setup, self.panel
        setup.devices.connect_wanted.connect(lambda rig, camera: panel.open(rig, camera))
        setup.devices.disconnect_wanted.connect(lambda: panel.close())
        setup.devices.look_wanted.connect(lambda: panel.look())
        setup.jog.jog_wanted.connect(lambda pan, tilt: panel.jog(pan, tilt))
        setup.jog.move_wanted.connect(lambda pan, tilt: panel.move(pan, tilt))
        setup.jog.home_wanted.connect(lambda: panel.home())
        setup.bracket.preview_wanted.connect(lambda: panel.preview(**setup.bracket.exposure()))
        setup.bracket.changed.connect(self._show_able)
        setup.plan.changed.connect(self._ask_plan)
        setup.place.changed.connect(self._show_able)
        self.does.clipping.toggled.connect(self.scene.picture.show_clipping)

    # State to widgets

    def _show(self, state: PanelState) -> None:
        before, self.state = self.state, state
        if state.capturing and not before.capturing:
            self._begun(state)
        self._course.follow(before, state, self.captured)
        self.setup.show_state(state)
        self._show_scene()
        self._show_plan()
        self._show_able()
        self._show_banner()
        self._show_devices(before)
        if state.open and not before.open:
            self._ask_plan()  # what suits depends on the rig
        # A short one may have begun since the last state that was shown.
        if not state.capturing and (before.capturing or state.ended != before.ended):
            self._ended()

    def _show_scene(self) -> None:
        state, planned, done = self.state, self.state.planned, self._course.done
        poses = planned.poses if planned is not None else ()
        going = None
        if state.capturing or (state.ended is not None and state.ended != self._seen.ended):
            poses, going = self._course.poses, state.going
            if going is not None and not state.capturing:
                going = replace(going, pose=None)
        elif self.captured is not None and self.captured != self._seen.captured:
            poses, done = capture_dots.planned(self.captured), self.captured.done
        else:
            done = frozenset()
        dots = capture_dots.dots(poses, done, going)
        self.scene.show_state(state, dots, len(poses) - len(dots))

    def _show_able(self) -> None:
        state, setup = self.state, self.setup
        complete = (
            setup.plan.plan() is not None
            and setup.bracket.stops is not None
            and setup.place.path is not None
            and not self._plan_trouble()
        )
        self.does.start.setVisible(not state.capturing)
        self.does.start.setEnabled(state.open and not state.order and complete)
        self.does.pause.setVisible(state.capturing)
        self.does.pause.setText(self.tr("&Resume") if state.paused else self.tr("&Pause"))
        self.does.end.setVisible(state.capturing)
        for does in (self.does.pause, self.does.end):
            does.setEnabled(not state.ending)
        self.does.stop.setVisible(state.open or state.order in OPENING)
        self.does.answer.setEnabled(state.ask is not None and state.ask.confirm)
        self.bar.show_state(state, self._idle(complete))

    def _idle(self, complete: bool) -> str:
        """What stands where a capture's phase would."""
        state = self.state
        if state.order == "open":
            return self.tr("connecting…")
        if not state.open:
            return self.tr("connect rig and camera to begin")
        if state.order:
            return self.tr("one moment…")
        if not complete:
            return self.tr("poses, bracket or session are not complete")
        return self._count()

    def _plan_trouble(self) -> str:
        """What is wrong with the plan that stands there, or ""."""
        fault = self.state.plan_fault
        if fault is None:
            return ""
        return f"{fault.what}; {fault.remedy}" if fault.remedy else fault.what

    def _count(self) -> str:
        """What the plan comes to; "" before it is known."""
        planned = self.state.planned
        if planned is None:
            return ""
        poses = len(planned.poses)
        photographs = poses * len(self.setup.bracket.stops or (0.0,))
        return self.tr("{0} poses, {1} photographs").format(poses, photographs)

    def _show_plan(self) -> None:
        planned = self.state.planned
        warnings = "\n".join(planned.warnings) if planned is not None else ""
        self.setup.plan.show_about(self._plan_trouble() or warnings)

    def _show_devices(self, before: PanelState) -> None:
        """In the status bar of the window."""
        state = self.state
        if self._shell is None or (state.rig, state.camera, state.rig_well) == (
            before.rig, before.camera, before.rig_well
        ):  # fmt: skip
            return
        if state.rig is None or state.camera is None:
            for key in ("rig", "camera"):
                self._shell.state.drop_device(key)
            return
        self._shell.state.set_device(Device("rig", self.tr("rig"), state.rig_well, state.rig.name))
        self._shell.state.set_device(Device("camera", self.tr("camera"), True, state.camera.name))

    # The banner

    def _show_banner(self) -> None:
        found = notice(self.state, self.captured, self._seen)
        steps = () if found is None else choices(found[0], self.state, self.captured, self._answers)
        self.banner.show_notice(None if found is None else found[1], steps)
        self.bar.head.lead(not any(step.primary for step in steps))  # one blue button

    def _put_away(self) -> None:
        """What the banner says was read."""
        found = notice(self.state, self.captured, self._seen)
        state = self.state
        if found is not None and found[0] is Matter.TROUBLE:
            self._see(told=state.troubles)
        else:
            self._see(ended=state.ended, captured=self.captured)

    def _see(self, **facts) -> None:
        self._seen = replace(self._seen, **facts)
        self._show_scene()
        self._show_banner()

    # Intent

    def _start(self) -> None:
        setup, plan = self.setup, self.setup.plan.plan()
        session, bracket = setup.place.path, setup.bracket.stops
        if plan is None or session is None or bracket is None:
            return
        if self._shell is not None:
            self._shell.settings.change(last_folder=str(session.parent))
        exposure = setup.bracket.exposure()
        self.panel.start(
            session, plan, bracket, **exposure, settle_s=setup.plan.settle_s,
            helpful_first=setup.plan.helpful.isChecked(), any_format=setup.plan.any_format.isChecked(),
        )  # fmt: skip

    def _pause(self) -> None:
        if self.state.paused:
            self._go_on()
        else:
            self.panel.pause()

    def _go_on(self) -> None:
        self._see(stops=len(stops(self.state)))
        self.panel.go_on()

    def _resume(self, session: Path, at_zero: bool) -> None:
        self.panel.resume(session, self.setup.plan.helpful.isChecked(), at_zero)

    def _process(self, session: Path) -> None:
        if self._shell is not None:
            self._shell.wishes.open_session.emit(session)
            self._shell.wishes.show_page.emit("process")

    def _tell(self, trouble: Trouble) -> None:
        if self._shell is not None:
            self._shell.wishes.trouble.emit(trouble)

    def _ask_plan(self) -> None:
        plan = self.setup.plan.plan()
        known = plan is not None and (plan["kind"] != "suited" or self.state.open)
        if plan is not None and known and self._looked and not self.state.capturing:
            self.panel.plan(plan)
        self._show_able()

    # What follows from a capture's begin and end, and from the session that is open

    def _begun(self, state: PanelState) -> None:
        self._seen = Seen(told=state.troubles, captured=self.captured)
        if self._shell is not None and self.panel.job is not None:
            self._shell.board.start(self.panel.job)  # closing the window asks now

    def _ended(self) -> None:
        if self._shell is not None and self.panel.job is not None:
            self._shell.board.leave(self.panel.job)
        self._ask_plan()  # the one that is shown was the capture's
        ended = self.state.ended
        if ended is None or self._shell is None or not ended.taken:
            return
        self.setup.place.named = False
        self._offer_place()
        if ended.session == self._folder:
            self.show_session(ended.session)
        elif self.isVisible() or self._folder is None:
            # Somebody at work on another session is not torn away from it; the banner leads here later.
            self._shell.wishes.open_session.emit(ended.session)
        self._shell.wishes.say.emit(self.tr("The capture of {0} has ended").format(ended.session.stem))

    def _take_captured(self, captured: Captured | None) -> None:
        if (
            self.state.ended is not None
            and captured is not None
            and captured.session == self.state.ended.session
        ):
            self._course.done = captured.done
        self.captured = captured
        self._show_scene()
        self._show_banner()

    def _offer_place(self) -> None:
        if self._shell is None:
            return
        folder = self._shell.settings.place
        self._background.ask("place", lambda: wanted.free_place(folder), self.setup.place.offer)
