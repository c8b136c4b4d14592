"""How the mask page stands, in words: what is missing, what runs, whether strokes are used and saved."""

from dataclasses import dataclass
from pathlib import Path

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QProgressBar, QWidget

from app.mask_files import Developed
from app.plan import Row, told_reason
from app.state import Trouble
from app.views.elided import Elided
from app.words import sentence
from app.work.jobs import JobState, JobStatus

NOTHING = "\u2013"


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """All that the words depend on."""

    session: Path | None
    hdr: Row | None  # of the plan; None until it arrives
    segment: Row | None
    fault: Trouble | None  # why there is no plan
    developed: Developed | None  # the photographs that are shown, and the object found in them
    job: JobStatus | None  # a run of this session that waits or runs
    painted: bool  # there are strokes
    saved: bool  # and they are on disk
    planned: bool  # and the plan knows them
    waits: str  # why saved strokes are not in their place yet

    @property
    def may_find(self) -> bool:
        """Whether finding again would do anything."""
        return self.job is None and self.segment is not None and not (self.segment.done and self.planned)


def why_nothing(now: Standing) -> Trouble:
    """What stands in place of the photographs of an open session while there are none."""

    def tr(text: str) -> str:
        return QCoreApplication.translate("MaskPage", text)

    if now.fault is not None:
        return now.fault
    if now.hdr is None:
        return Trouble(tr("Reading the session…"))
    if now.job is not None:
        return Trouble(tr("The photographs are being developed"), tr("they appear here when that is done"))
    if now.hdr.done:
        return Trouble(tr("Reading the photographs…"))
    return Trouble(
        tr("The photographs of this session are not developed yet"),
        tr(
            "developing merges each bracket into one picture and finds the object; then it can be corrected here"
        ),
    )


class StatusLine(QFrame):
    """The strip below: words, progress, the pixel under the cursor."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self.setAccessibleName(self.tr("State of the mask"))
        self.words, self.pixel, self.bar = Elided(), QLabel(NOTHING), QProgressBar()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.bar.setFixedWidth(160)
        self.bar.setAccessibleName(self.tr("Progress"))
        self.pixel.setMinimumWidth(self.pixel.fontMetrics().horizontalAdvance("0000, 0000 "))
        self.pixel.setAccessibleName(self.tr("Pixel under the cursor"))
        self.pixel.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        row = QHBoxLayout(self)
        row.setContentsMargins(12, 4, 12, 4)
        row.setSpacing(10)
        row.addWidget(self.bar)
        row.addWidget(self.words, 1)
        row.addWidget(self.pixel)

    def show_pixel(self, pixel: tuple[int, int] | None) -> None:
        self.pixel.setText(NOTHING if pixel is None else f"{pixel[0]}, {pixel[1]}")

    def show_standing(self, now: Standing) -> None:
        self.setVisible(now.developed is not None or now.job is not None)
        self.bar.setVisible(now.job is not None and now.job.state is not JobState.QUEUED)
        self.bar.setValue(round(1000 * now.job.fraction) if now.job is not None else 0)
        said = self._job(now.job) if now.job is not None else self._found(now)
        kept = self._kept(now)
        self.words.setText(f"{said}   ·   {kept}" if said and kept else said or kept)

    def _job(self, job: JobStatus) -> str:
        if job.state is JobState.QUEUED:
            return self.tr("Waits in the queue")
        if job.state is JobState.CANCELLING:
            return self.tr("Stopping…")
        stages = {"hdr": self.tr("Developing the photographs"), "segment": self.tr("Finding the object")}
        at = stages.get(job.stage, job.stage) or self.tr("Starting…")
        return f"{at}: {job.note}" if job.note else at

    def _found(self, now: Standing) -> str:
        if now.segment is None or now.developed is None:
            return ""
        if not now.planned:
            return self.tr("Strokes changed. Update the mask to see the result")
        if not now.segment.done:
            if now.developed.object is None:
                return self.tr("The object was not found yet; find it, or paint it and find it then")
            why = ", ".join(told_reason(reason, "segment") for reason in now.segment.reasons)
            return self.tr("{0}. Update the mask to see the result").format(sentence(why))
        if now.developed.object is None:
            return ""
        if now.segment.given:
            return self.tr("The given mask, corrected where strokes are painted")
        share = 100 * now.developed.area / now.developed.object.size
        return self.tr("Object: {0} px, {1} % of the picture").format(
            f"{now.developed.area:,}", f"{share:.1f}"
        )

    def _kept(self, now: Standing) -> str:
        if not now.saved:
            return self.tr("saving strokes…")
        if now.waits:
            return self.tr("strokes are kept and will be taken over: {0}").format(now.waits)
        if now.painted:
            return self.tr("strokes saved")
        return self.tr("one mask serves all photographs; strokes are hints, unless exact")
