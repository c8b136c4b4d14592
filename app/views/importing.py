"""The dialog that makes a session of a folder of photographs; the work itself is a job."""

from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QDialog, QFileDialog, QLineEdit, QWidget

from app.importing import Request, proposed, suggest_mask, suggest_poses
from app.state import called
from app.views.folder_look import FolderLook
from app.views.forms import JobFoot, browsed, form, hint, label
from app.views.pages import Shell


class ImportDialog(QDialog):
    """Asks for a `Request`, runs it, and opens the session it made."""

    def __init__(self, parent: QWidget | None, shell: Shell, folder: Path | None = None) -> None:
        super().__init__(parent)
        self._shell = shell
        self._named = False  # the person chose the session's place; it follows the photographs no more
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle(self.tr("Import photographs"))
        self.setMinimumWidth(680)
        self.folder, folder_row = self._path(self.tr("Photographs"), self._ask_folder)
        self.session, session_row = self._path(self.tr("New session"), self._ask_session)
        self.poses, poses_row = self._path(self.tr("Poses"), self._ask_poses)
        self.object_mask, mask_row = self._path(self.tr("Mask"), self._ask_mask)
        self.poses.setPlaceholderText(self.tr("found from the photographs"))
        self.object_mask.setPlaceholderText(self.tr("found from the photographs"))
        self.bracket = QComboBox()
        self.bracket.setAccessibleName(self.tr("Exposures of each view"))
        self.bracket.addItem(self.tr("found from the files"), None)
        for count in range(1, 10):
            self.bracket.addItem(str(count), count)
        self._suggested = {self.poses: "", self.object_mask: ""}  # what stands there unless the person chose
        self.found = FolderLook(shell.enquiries)
        self.found.looked.connect(self._check)
        self.found.looked.connect(self._grow)
        self.bracket.activated.connect(lambda index: self._look(at_once=True))
        self.folder.textChanged.connect(self._folder_changed)
        self.session.textEdited.connect(self._name)
        self.session.textChanged.connect(self._check)

        rows = form()
        rows.addRow(label(self.tr("&Photographs"), self.folder), folder_row)
        rows.addRow(
            "",
            hint(self.tr("RAW files, or linear .exr or .hdr images: at least 8 views, better 50 or more")),
        )
        rows.addRow(label(self.tr("New &session"), self.session), session_row)
        rows.addRow(label(self.tr("P&oses"), self.poses), poses_row)
        rows.addRow(
            "",
            hint(self.tr("transforms.json, a COLMAP model's folder, or a Metashape XML; optional")),
        )
        rows.addRow(label(self.tr("&Mask"), self.object_mask), mask_row)
        rows.addRow("", hint(self.tr("PNG of the photographs' size, white on the object; optional")))
        rows.addRow(label(self.tr("&Exposures a view"), self.bracket), self.bracket)

        self.foot = JobFoot(self, shell.board, self.tr("&Import"), rows, self.found)
        self.foot.wanted.connect(self._start)
        self.foot.changed.connect(self._check)
        self.foot.done.connect(self._done)
        if folder is not None:
            self.folder.setText(str(folder))
            self._look(at_once=True)
        self._check()

    def request(self) -> Request:
        """What the fields say."""
        poses, mask = self.poses.text().strip(), self.object_mask.text().strip()
        return Request(
            Path(self.folder.text().strip()),
            Path(self.session.text().strip()),
            Path(poses) if poses else None,
            Path(mask) if mask else None,
            self.bracket.currentData(),
        )

    def reject(self) -> None:
        """Cancel the import under way, or leave."""
        self.foot.leave()

    def _start(self) -> None:
        request = self.request()
        name = self.tr("Import {0}").format(request.folder.name)
        self.foot.begin(name, "import", request.content())

    def _done(self, result: dict) -> None:
        session, wishes = Path(str(result["session"])), self._shell.wishes
        wishes.open_session.emit(session)
        wishes.show_page.emit("photographs")
        wishes.say.emit(self.tr("{0}: {1} photographs imported").format(called(session), result["views"]))
        self.accept()

    def _check(self) -> None:
        running = self.foot.running
        said = bool(self.folder.text().strip() and self.session.text().strip())
        self.foot.go.setEnabled(said and self.found.ready and not running)
        for field in (self.folder, self.session, self.poses, self.object_mask, self.bracket):
            field.setEnabled(not running)

    def _name(self) -> None:
        self._named = True

    def _folder_changed(self, text: str) -> None:
        if text.strip() and not self._named:
            self.session.setText(str(proposed(Path(text.strip()))))
        for field, suggest in ((self.poses, suggest_poses), (self.object_mask, suggest_mask)):
            found = suggest(Path(text.strip())) if text.strip() else None
            if field.text() == self._suggested[field]:
                self._suggested[field] = "" if found is None else str(found)
                field.setText(self._suggested[field])
        self._look()

    def _grow(self) -> None:
        """Make room for what was found; fields would give way instead."""
        self.resize(self.width(), max(self.height(), self.minimumSizeHint().height()))

    def _look(self, at_once: bool = False) -> None:
        self.found.look(self.folder.text().strip(), self.bracket.currentData(), at_once)

    def _path(self, name: str, ask: Callable[[], str]) -> tuple[QLineEdit, QWidget]:
        field = QLineEdit()
        return field, browsed(field, name, ask, lambda: self._name() if field is self.session else None)

    def _ask_folder(self) -> str:
        said = QFileDialog.getExistingDirectory(
            self, self.tr("Photographs"), self.folder.text() or self._shell.settings.value.last_folder
        )
        if said:
            self._shell.settings.change(last_folder=str(Path(said).parent))
        return said

    def _ask_session(self) -> str:
        return QFileDialog.getSaveFileName(self, self.tr("New session"), self.session.text())[0]

    def _ask_poses(self) -> str:
        kinds = self.tr("Poses (*.json *.xml *.bin *.txt)")
        said = QFileDialog.getOpenFileName(self, self.tr("Poses"), self.folder.text(), kinds)[0]
        # A COLMAP model is a folder; its files stand for it.
        return str(Path(said).parent) if said.endswith((".bin", ".txt")) else said

    def _ask_mask(self) -> str:
        kinds = self.tr("Masks (*.png)")
        return QFileDialog.getOpenFileName(self, self.tr("Mask"), self.folder.text(), kinds)[0]
