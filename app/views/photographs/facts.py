"""What is known of the photograph that is shown large, in one strip below it."""

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app.capture.wanted import told_shutter
from app.photographs import Look, Photograph, told_blur, told_camera, told_time
from app.views.elided import Elided


class Facts(QFrame):
    """Name, exposures, time, sharpness, clipping, pose; and the tick that leaves the photograph out."""

    out_wanted = Signal(bool)
    exposure_picked = Signal()
    again_wanted = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self.name = Elided()
        self.name.setObjectName("heading")
        self.out = QCheckBox(self.tr("&Leave out"))
        self.out.setAccessibleName(self.tr("Leave out"))
        self.out.setToolTip(
            self.tr("Nothing but the merge of the brackets uses a photograph that is left out (Space)")
        )
        self.out.clicked.connect(self.out_wanted)
        self.exposure = QComboBox()
        self.exposure.setAccessibleName(self.tr("Exposure that is shown"))
        self.exposure.setToolTip(self.tr("Which exposure of the bracket is shown"))
        self.exposure.activated.connect(lambda index: self.exposure_picked.emit())
        top = QHBoxLayout()
        top.addWidget(self.name, 1)
        top.addWidget(self.exposure)
        self.again = QPushButton(self.tr("&Take again"))
        self.again.setAccessibleName(self.tr("Take again"))
        self.again.setToolTip(
            self.tr(
                "Put this photograph aside; the capture takes its pose again when it goes on (Ctrl+Z brings it back)"
            )
        )
        self.again.clicked.connect(self.again_wanted)
        top.addWidget(self.again)
        top.addSpacing(8)
        top.addWidget(self.out)
        grid = QGridLayout()
        grid.setHorizontalSpacing(14)
        grid.setVerticalSpacing(0)
        self.values: dict[str, QLabel] = {}
        for column, (key, text, tip) in enumerate(
            (
                ("camera", self.tr("Camera"), self.tr("ISO and f-number")),
                ("time", self.tr("Taken"), self.tr("By the camera's clock")),
                ("blur", self.tr("Sharpest edges"), self.tr("How wide they are, in pixels of the sensor: wider is blurrier")),
                ("clipped", self.tr("Clipped"), self.tr("In all exposures of the bracket: brighter than the shortest can hold")),
                ("dark", self.tr("Too dark"), self.tr("In all exposures of the bracket: below the sensor's noise")),
                ("pose", self.tr("Pose"), self.tr("Where the camera stood, as the latest run found it")),
            )
        ):  # fmt: skip
            caption, value = QLabel(text), QLabel()
            caption.setObjectName("dim")
            for label in (caption, value):
                label.setToolTip(tip)
            grid.addWidget(caption, 0, column)
            grid.addWidget(value, 1, column)
            self.values[key] = value
        grid.setColumnStretch(5, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(12, 8, 12, 8)
        column.setSpacing(6)
        column.addLayout(top)
        column.addLayout(grid)

    @property
    def chosen_exposure(self) -> int | None:
        """Of the bracket, shortest first; None where there is nothing to choose."""
        return self.exposure.currentIndex() if self.exposure.count() > 1 else None

    def show_photograph(self, photograph: Photograph | None, count: int) -> None:
        """Another photograph, or none; the same exposure of the bracket stays chosen."""
        self.setEnabled(photograph is not None)
        shutters = [] if photograph is None else [one.get("shutter_s") for one in photograph.exposures]
        told = [told_shutter(float(shutter)) for shutter in shutters if shutter]
        with QSignalBlocker(self.exposure):
            before = self.exposure.currentIndex() if self.exposure.count() == len(told) else len(told) // 2
            self.exposure.clear()
            self.exposure.addItems(told)
            self.exposure.setCurrentIndex(before)
        self.exposure.setVisible(bool(told))
        self.exposure.setEnabled(len(told) > 1)
        if photograph is None:
            self.name.setText("")
            for value in self.values.values():
                value.setText("")
            return
        self.name.setText(self.tr("{0}  ({1} of {2})").format(photograph.name, photograph.number, count))
        self.values["camera"].setText(told_camera(photograph) or self.tr("unknown"))
        self.values["time"].setText(told_time(photograph) or self.tr("unknown"))

    def show_look(self, look: Look | None) -> None:
        """What its pixels tell; None while nobody looked."""
        self.values["blur"].setText("…" if look is None else told_blur(look) or self.tr("unknown"))
        for key in ("clipped", "dark"):
            self.values[key].setText("…" if look is None else f"{100 * getattr(look, key):.1f} %")

    def show_use(self, photograph: Photograph | None, out: bool) -> None:
        """Whether it is left out, and what the latest run made of it."""
        with QSignalBlocker(self.out):
            self.out.setCheckState(Qt.CheckState.Checked if out else Qt.CheckState.Unchecked)
        if photograph is None:
            return
        told = {True: self.tr("placed"), False: self.tr("not placed"), None: self.tr("not looked for yet")}
        self.values["pose"].setText(told[photograph.placed])
