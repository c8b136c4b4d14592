"""Which rig and which camera: choose, connect, and how both are.

Any device URL may be typed; what was found on this machine is in the lists.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QComboBox, QGridLayout, QHBoxLayout, QLabel, QProgressBar, QWidget

from app.capture.wanted import VIRTUAL_CAMERA, VIRTUAL_RIG, Choice, camera_choices, rig_choices
from app.views import theme
from app.views.boxes import widened
from app.views.capture.parts import Section, button, dim, row
from app.views.elided import Elided


@dataclass(frozen=True, slots=True)
class Live:
    """How a device is, in a few words."""

    name: str = ""
    told: str = ""
    well: bool = True


class Devices(Section):
    """Lists before the devices are open, what they say of themselves while they are."""

    connect_wanted = Signal(str, str)  # URLs of rig and camera
    disconnect_wanted = Signal()
    look_wanted = Signal()  # for ports and cameras, again

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("", parent)
        self.setAccessibleName(self.tr("Devices"))
        self.heading.setText(self.tr("Devices"))
        self._open = self._opening = self._locked = False
        grid = self.rows()
        self.rig, self.camera = _box(), _box()
        self._labels = (
            row(grid, self.tr("&Rig"), self.rig, self.tr("Rig, as a device URL")),
            row(grid, self.tr("Ca&mera"), self.camera, self.tr("Camera, as a device URL")),
        )
        self.rig_live, self.camera_live = _LiveLine(self.tr("Rig")), _LiveLine(self.tr("Camera"))
        self.hint = dim(
            self.tr(
                "The virtual studio needs no hardware: an object stands in a furnished room that is photographed as it turns."
            )
        )
        self.note = Elided()
        self.note.setObjectName("dim")
        self.bar = QProgressBar()
        self.bar.setTextVisible(False)
        self.bar.setAccessibleName(self.tr("Progress of connecting"))
        self.look = button(self.tr("Refresh &list"), self.tr("Look for ports and cameras again"))
        self.toggle = button(self.tr("&Connect"), look="primary")
        buttons = QHBoxLayout()
        buttons.setSpacing(6)
        buttons.addWidget(self.look)
        buttons.addStretch()
        buttons.addWidget(self.toggle)
        for part in (self.rig_live, self.camera_live, self.hint, self.note, self.bar):
            self.body.addWidget(part)
        self.body.addLayout(buttons)
        self.look.clicked.connect(self.look_wanted)
        self.toggle.clicked.connect(self._toggle)
        for box in (self.rig, self.camera):
            box.editTextChanged.connect(self._show)
            box.activated.connect(lambda i, box=box: _write(box, box.itemData(i).url))
        self.show_found((), (), ())
        self.choose(VIRTUAL_RIG, VIRTUAL_CAMERA)
        self._show()

    @property
    def urls(self) -> tuple[str, str]:
        """Rig and camera as they stand in the fields."""
        return self.rig.currentText().strip(), self.camera.currentText().strip()

    def choose(self, rig: str, camera: str) -> None:
        for box, url in ((self.rig, rig), (self.camera, camera)):
            _write(box, url)

    def show_found(self, examples: Sequence[str], ports: Sequence, cameras: Sequence) -> None:
        """What there is to choose from; what stands in the fields stays."""
        for box, choices in (
            (self.rig, rig_choices(examples, ports)),
            (self.camera, camera_choices(cameras)),
        ):
            if [box.itemData(i) for i in range(box.count())] == list(choices):
                continue
            said = box.currentText()
            with QSignalBlocker(box):
                box.clear()
                for choice in choices:
                    box.addItem(self._told(choice, box is self.rig), choice)
                _write(box, said)
            widened(box)

    def show_open(self, is_open: bool, opening: bool, locked: bool) -> None:
        """
        Args:
            opening: they are being opened.
            locked: a capture uses them.
        """
        self._open, self._opening, self._locked = is_open, opening, locked
        self._show()

    def show_live(self, rig: Live, camera: Live) -> None:
        self.rig_live.show_live(rig)
        self.camera_live.show_live(camera)

    def show_progress(self, fraction: float | None, note: str) -> None:
        """How far opening is; None: it does not say."""
        self.bar.setRange(0, 0 if fraction is None else 1000)
        if fraction is not None:
            self.bar.setValue(round(1000 * fraction))
        self.note.setText(note)

    def _show(self) -> None:
        choosing = not self._open
        for part in (self.rig, self.camera, *self._labels):
            part.setVisible(choosing)
            part.setEnabled(not self._opening)
        self.look.setVisible(choosing)
        self.look.setEnabled(not self._opening)
        self.rig_live.setVisible(not choosing)
        self.camera_live.setVisible(not choosing)
        virtual = any(url.startswith("virtual:") for url in self.urls)
        policy = self.hint.sizePolicy()
        policy.setRetainSizeWhenHidden(choosing)  # the button below stays under the mouse
        self.hint.setSizePolicy(policy)
        self.hint.setVisible(choosing and virtual and not self._opening)
        self.note.setVisible(self._opening)
        self.bar.setVisible(self._opening)
        text = self.tr("&Connect") if choosing else self.tr("Dis&connect")
        if self._opening:
            text = self.tr("&Connecting…")
        self.toggle.setText(text)
        self.toggle.setAccessibleName(text.replace("&", ""))
        look = "primary" if choosing else ""
        if look != self.toggle.objectName():
            self.toggle.setObjectName(look)
            self.toggle.style().polish(self.toggle)
        self.toggle.setEnabled(not self._opening and not self._locked and (self._open or all(self.urls)))

    def _toggle(self) -> None:
        if self._open:
            self.disconnect_wanted.emit()
        else:
            self.connect_wanted.emit(*self.urls)

    def _told(self, choice: Choice, rig: bool) -> str:
        words = {
            "virtual": self.tr("Virtual studio")
            if rig
            else self.tr("Virtual camera: an object in a parlour"),
            "manual": self.tr("A stand that I turn when asked"),
            "none": self.tr("No rig (handheld)"),
            "grbl": self.tr("GRBL controller"),
            "zaber": self.tr("Zaber stages"),
            "folder": self.tr("Watched folder"),
        }
        told = words.get(choice.kind, choice.kind)
        parts = (choice.about,) if choice.kind == "gphoto2" else (told, choice.about)
        return "   ".join((", ".join(part for part in parts if part), choice.url))


class _LiveLine(QWidget):
    """A device's name, and under it how it is, with a dot that is green while all is well."""

    def __init__(self, kind: str) -> None:
        super().__init__()
        self._kind, self._live = kind, Live()
        self.setAccessibleName(kind)
        self.name, self.told, self.sign = Elided(), Elided(), QLabel("●")
        self.told.setObjectName("dim")
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(6)
        grid.setVerticalSpacing(0)
        grid.addWidget(self.sign, 0, 0)
        grid.addWidget(self.name, 0, 1)
        grid.addWidget(self.told, 1, 1)
        grid.setColumnStretch(1, 1)

    def show_live(self, live: Live) -> None:
        if live == self._live:
            return
        self._live = live
        self.name.setText(live.name)
        self.told.setText(live.told)
        self.setAccessibleDescription(f"{live.name}, {live.told}")
        self._dress()

    def changeEvent(self, event) -> None:
        super().changeEvent(event)
        if event.type() == event.Type.PaletteChange and hasattr(self, "sign"):
            self._dress()

    def _dress(self) -> None:
        ours = theme.colours(self)
        sheet = f"color: {ours.good if self._live.well else ours.bad};"
        if self.sign.styleSheet() != sheet:
            self.sign.setStyleSheet(sheet)


def _write(box: QComboBox, url: str) -> None:
    """The beginning of a URL says more than its end."""
    box.setEditText(url)
    line = box.lineEdit()
    assert line is not None
    line.setCursorPosition(0)
    box.setToolTip(url)


def _box() -> QComboBox:
    box = QComboBox()
    box.setEditable(True)
    box.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)
    box.setMinimumContentsLength(10)
    box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
    box.setCompleter(None)  # pyrefly: ignore[bad-argument-type] a URL is no prefix of what a list shows
    return box
