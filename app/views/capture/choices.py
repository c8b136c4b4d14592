"""The buttons of the banner: what a person may do about what it says."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QCoreApplication

from app.capture.panel import PanelState
from app.capture.wanted import Captured
from app.state import Trouble
from app.views.capture.banner import Choice
from app.views.capture.notices import Matter

translate = QCoreApplication.translate


@dataclass(frozen=True, slots=True)
class Answers:
    """What the page does when it is asked to."""

    done: Callable[[], None]
    go_on: Callable[[], None]
    end: Callable[[], None]
    resume: Callable[[Path, bool], None]  # session, whether the rig was turned to its zero by hand
    process: Callable[[Path], None]
    details: Callable[[Trouble], None]
    put_away: Callable[[], None]


def choices(matter: Matter, state: PanelState, captured: Captured | None, answers: Answers) -> list[Choice]:
    """Those of one banner, the likeliest first."""
    put_away = Choice(translate("CaptureNotices", "Close"), answers.put_away)
    if matter is Matter.ASK:
        done = Choice(translate("CaptureNotices", "&Done"), answers.done, True)
        return [done] if state.ask is not None and state.ask.confirm else []
    if matter is Matter.STOPPED:
        return [
            Choice(translate("CaptureNotices", "&Resume"), answers.go_on, True),
            Choice(translate("CaptureNotices", "Fi&nish"), answers.end),
        ]
    if matter is Matter.TROUBLE and state.told is not None:
        told = state.told.trouble
        details = Choice(translate("CaptureNotices", "Details…"), lambda: answers.details(told))
        return [details, put_away] if told.details else [put_away]
    if matter is Matter.ENDED and state.ended is not None:
        ended = state.ended
        return [*_next_steps(ended.session, ended.total - ended.taken, ended.taken, state, answers), put_away]
    if captured is not None:
        taken = len(captured.done)
        return [*_next_steps(captured.session, captured.left, taken, state, answers), put_away]
    return [put_away]


def _next_steps(session: Path, left: int, taken: int, state: PanelState, answers: Answers) -> list[Choice]:
    """Resume what is left; else process."""
    steps = []
    if left:
        text = translate("CaptureNotices", "&Resume ({0} left)").format(left)
        steps.append(Choice(text, lambda: answers.resume(session, False), True))
        rig = state.rig
        if rig is not None and rig.automatic and rig.axes and not rig.homes:
            text = translate("CaptureNotices", "At zero: resume")
            tip = translate(
                "CaptureNotices", "The rig cannot find its zero by itself, and was turned there by hand"
            )
            steps.append(Choice(text, lambda: answers.resume(session, True), tip=tip))
    if taken:
        text = translate("CaptureNotices", "P&rocess")
        steps.append(Choice(text, lambda: answers.process(session), not left))
    return steps
