"""The dialog that photographs a virtual object in a virtual room, with the truth beside it; the work itself is a job."""

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QDialog,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QWidget,
)

from app.simulating import USUAL, Request, parse_place, proposed
from app.state import trouble
from app.views.editors import Number
from app.views.forms import JobFoot, browsed, form, hint, label
from app.views.pages import Shell
from app.views.trouble import show_trouble
from hardware.errors import StudioError
from hardware.virtual.studio.order import (
    DEVICES,
    MATERIALS,
    MESH_KINDS,
    MESH_SIZE_M,
    MOTIONS,
    OBJECTS,
    ROOMS,
    SCENE_KINDS,
    Order,
)


class SimulateDialog(QDialog):
    """Asks for a `Request`, runs it, says what was simplified, and opens the session it made."""

    def __init__(self, parent: QWidget | None, shell: Shell) -> None:
        super().__init__(parent)
        self._shell = shell
        self._named = False  # the person chose the folder; it follows room and object no more
        self._made: Path | None = None
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Simulate photographs"))
        self.setMinimumWidth(640)
        self.out = QLineEdit()
        self.room, self.thing = QComboBox(), QComboBox()
        for box, names in ((self.room, ROOMS), (self.thing, OBJECTS)):
            box.setEditable(True)
            box.addItems(list(names))
            box.currentTextChanged.connect(self._follow)
        self.object_size = self._number(self.tr("Size"), 0, 1000, 0, False)
        self.object_size.setSuffix(self.tr(" m"))
        self.object_size.setSpecialValueText(
            self.tr("a built-in object's own, {0} m for a mesh").format(f"{MESH_SIZE_M:g}")
        )
        self.material = self._choice(self.tr("Material"), MATERIALS)
        self.material.insertItem(0, self.tr("a built-in object's own, paint for a mesh"), None)
        self.material.setCurrentIndex(0)
        self.turn = self._number(self.tr("Turn"), -360, 360, USUAL.turn_deg, False)
        self.turn.setSuffix(self.tr("°"))
        self.noise = self._number(self.tr("Noise left"), 0.1, 100, 100 * USUAL.noise, False)
        self.noise.setSuffix(self.tr(" %"))
        self.place = QLineEdit()
        self.place.setAccessibleName(self.tr("Place of the rig"))
        self.place.setPlaceholderText(self.tr("searched"))
        self.motion = self._choice(self.tr("Motion"), MOTIONS)
        self.views = self._number(self.tr("Views"), 1, 9999, USUAL.views)
        self.wide = self._number(self.tr("Width"), 16, 9998, USUAL.width)
        self.high = self._number(self.tr("Height"), 16, 9998, USUAL.height)
        self.vignetting = self._number(self.tr("Vignetting"), 0, 0.99, 0, False)
        self.seed = self._number(self.tr("Seed"), 0, 2**31 - 1, USUAL.seed)
        self.device = self._choice(self.tr("Device"), DEVICES)
        self._fields = QWidget()
        self._lay_out(self._fields)

        self.notes = QPlainTextEdit()
        self.notes.setReadOnly(True)
        self.notes.setAccessibleName(self.tr("What was done"))
        self.notes.hide()
        self.foot = JobFoot(self, shell.board, self.tr("&Simulate"), self._fields, self.notes)
        self.foot.wanted.connect(self._start)
        self.foot.changed.connect(self._check)
        self.foot.done.connect(self._done)
        self.out.textEdited.connect(self._name)
        self.out.textChanged.connect(self._check)
        self._follow()

    def request(self) -> Request:
        """What the fields say.

        Raises:
            StudioError: the place is not three numbers.
        """
        order = Order(
            self.room.currentText().strip(),
            self.thing.currentText().strip(),
            round(self.views.value()),
            round(self.wide.value()),
            round(self.high.value()),
            self.motion.currentData(),
            round(self.seed.value()),
            self.device.currentData(),
            self.object_size.value() or None,
            parse_place(self.place.text()),
            self.material.currentData(),
            self.turn.value(),
            self.noise.value() / 100,
        )
        return Request(Path(self.out.text().strip()), order, self.vignetting.value())

    def reject(self) -> None:
        """Cancel the simulation under way, or leave."""
        self.foot.leave()

    def _start(self) -> None:
        if self._made is not None:
            self._open(self._made)
            return
        try:
            request = self.request()
        except StudioError as fault:
            show_trouble(self, trouble(str(fault)))
            return
        self.foot.begin(self.tr("Simulate {0}").format(request.out.name), "simulate", request.content())

    def _done(self, result: dict) -> None:
        self._made = Path(str(result["session"]))
        if not result["notes"]:
            self._open(self._made)
            return
        self._fields.hide()
        self.notes.setPlainText("\n".join((str(self._made), "", *result["notes"])))
        self.notes.show()
        self.foot.ended(self.tr("&Open the session"))

    def _open(self, session: Path) -> None:
        self._shell.wishes.open_session.emit(session)
        self.accept()

    def _check(self) -> None:
        texts = (self.out.text(), self.room.currentText(), self.thing.currentText())
        self.foot.go.setEnabled(all(text.strip() for text in texts) and not self.foot.running)
        self._fields.setEnabled(not self.foot.running)

    def _name(self) -> None:
        self._named = True

    def _follow(self) -> None:
        if not self._named:
            self.out.setText(
                str(proposed(self._shell.settings.place, self.room.currentText(), self.thing.currentText()))
            )
        self._check()

    # --- building

    def _lay_out(self, fields: QWidget) -> None:
        rows = form()
        rows.setContentsMargins(0, 0, 0, 0)
        fields.setLayout(rows)
        pixels = QHBoxLayout()
        pixels.addWidget(self.wide, 1)
        pixels.addWidget(QLabel("\u00d7"))
        pixels.addWidget(self.high, 1)
        rows.addRow(label(self.tr("&Room"), self.room), browsed(self.room, self.tr("Room"), self._ask_room))
        rows.addRow("", hint(self.tr("built in, or any Mitsuba 3 scene.xml, in metres")))
        rows.addRow(label(self.tr("&Place"), self.place), self.place)
        rows.addRow(
            "", hint(self.tr("X Y Z of the rig, in the scene file's own frame; left empty, a free one"))
        )
        rows.addRow(
            label(self.tr("&Object"), self.thing), browsed(self.thing, self.tr("Object"), self._ask_object)
        )
        rows.addRow("", hint(self.tr("built in, or a mesh: OBJ, PLY, GLB")))
        rows.addRow(label(self.tr("Si&ze"), self.object_size), self.object_size)
        rows.addRow(label(self.tr("&Material"), self.material), self.material)
        rows.addRow(label(self.tr("&Turn"), self.turn), self.turn)
        rows.addRow(label(self.tr("Mot&ion"), self.motion), self.motion)
        rows.addRow(label(self.tr("&Views"), self.views), self.views)
        rows.addRow(label(self.tr("Pi&xels"), self.wide), pixels)
        rows.addRow(label(self.tr("Vi&gnetting"), self.vignetting), self.vignetting)
        rows.addRow(label(self.tr("Noise &left"), self.noise), self.noise)
        rows.addRow(
            "",
            hint(self.tr("by the path tracer on the object; twice as much takes a third of the time")),
        )
        rows.addRow(label(self.tr("Se&ed"), self.seed), self.seed)
        rows.addRow(label(self.tr("&Device"), self.device), self.device)
        rows.addRow(
            label(self.tr("&New folder"), self.out),
            browsed(self.out, self.tr("New folder"), self._ask_out, self._name),
        )

    def _number(self, name: str, low: float, high: float, usual: float, whole: bool = True) -> Number:
        field = Number(whole)
        field.setAccessibleName(name)
        field.setRange(low, high)
        field.setValue(usual)
        return field

    def _choice(self, name: str, words: tuple[str, ...]) -> QComboBox:
        box = QComboBox()
        box.setAccessibleName(name)
        for word in words:
            box.addItem(word, word)
        return box

    def _ask_room(self) -> str:
        return self._ask_file(self.tr("Room"), self.tr("Mitsuba scenes ({0})"), SCENE_KINDS)

    def _ask_object(self) -> str:
        return self._ask_file(self.tr("Object"), self.tr("Meshes ({0})"), MESH_KINDS)

    def _ask_file(self, title: str, kinds: str, suffixes: tuple[str, ...]) -> str:
        patterns = kinds.format(" ".join(f"*{suffix}" for suffix in suffixes))
        return QFileDialog.getOpenFileName(self, title, self._shell.settings.value.last_folder, patterns)[0]

    def _ask_out(self) -> str:
        return QFileDialog.getSaveFileName(self, self.tr("New folder"), self.out.text())[0]
