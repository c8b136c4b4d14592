"""Which of all that could be said stands in the banner, most urgent first; what its buttons do is the page's business."""

from dataclasses import dataclass
from enum import Enum, auto

from PySide6.QtCore import QCoreApplication

from app.capture.panel import PanelState
from app.capture.panel_state import Ended, Noticed
from app.capture.status import Severity
from app.capture.wanted import Captured
from app.state import Trouble, trouble
from app.views.capture.banner import Notice

translate = QCoreApplication.translate


class Matter(Enum):
    """What a banner is about."""

    ASK = auto()  # a person shall do something
    STOPPED = auto()  # a finding paused the capture
    TROUBLE = auto()
    ENDED = auto()
    UNFINISHED = auto()  # the open session's capture
    FINISHED = auto()  # likewise


@dataclass(frozen=True, slots=True)
class Seen:
    """What a person has answered or put away."""

    stops: int = 0  # findings that stopped a capture
    told: int = 0  # number of the trouble
    ended: Ended | None = None
    captured: Captured | None = None


def stops(state: PanelState) -> tuple[Noticed, ...]:
    """The findings that stopped this capture."""
    return tuple(finding for finding in state.findings if finding.severity is Severity.STOP)


def notice(state: PanelState, captured: Captured | None, seen: Seen) -> tuple[Matter, Notice] | None:
    """
    Args:
        captured: how far the open session's capture is; None: none is open, or it was imported.
    """
    if state.ask is not None:
        remedy = translate("CaptureNotices", "Then press Done, or Space") if state.ask.confirm else ""
        return Matter.ASK, Notice(_sentence(state.ask.text), remedy, "accent")
    found = stops(state)
    if state.paused and len(found) > seen.stops:
        told = trouble(found[-1].text)
        about = f"{found[-1].pose}: {told.what}" if found[-1].pose else told.what
        return Matter.STOPPED, Notice(
            translate("CaptureNotices", "Paused. {0}").format(about), _sentence(told.remedy), "bad"
        )
    if state.told is not None and state.told.number > seen.told:
        return Matter.TROUBLE, _of_trouble(state.told.trouble)
    if state.capturing:
        return None
    if state.ended is not None and state.ended != seen.ended:
        return Matter.ENDED, _of_end(state.ended)
    if captured is not None and captured != seen.captured:
        name, total = captured.session.stem, len(captured.order.poses)
        if captured.left:
            text = translate("CaptureNotices", "{0}: {1} of {2} poses are taken").format(
                name, total - captured.left, total
            )
            return Matter.UNFINISHED, Notice(
                text, translate("CaptureNotices", "The capture goes on where it stopped"), "warn"
            )
        text = translate("CaptureNotices", "{0}: all {1} poses are taken").format(name, total)
        return Matter.FINISHED, Notice(text, "", "good")
    return None


def _of_trouble(told: Trouble) -> Notice:
    return Notice(_sentence(told.what), _sentence(told.remedy), "bad")


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _of_end(ended: Ended) -> Notice:
    name = ended.session.stem
    kept = translate("CaptureNotices", "{0}: {1} of {2} poses are kept").format(
        name, ended.taken, ended.total
    )
    if ended.trouble is not None:
        return Notice(_sentence(ended.trouble.what), _sentence(ended.trouble.remedy) or kept, "bad")
    if ended.cancelled:
        return Notice(
            kept, translate("CaptureNotices", "The capture goes on from there when you resume it"), "warn"
        )
    if ended.missing:
        first = ended.missing[0]
        return Notice(
            kept, translate("CaptureNotices", "{0} is missing: {1}").format(first.pose, first.reason), "warn"
        )
    return Notice(
        translate("CaptureNotices", "{0}: all {1} poses are taken").format(name, ended.total), "", "good"
    )
