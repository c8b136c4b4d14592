"""*Open demo*: the first time a child lays this person's own copy out, afterwards it is a session like any other."""

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject

from app import demo
from app.state import called, trouble
from app.views.bridge import Bridge
from app.work.jobs import Job, JobState, JobStatus

if TYPE_CHECKING:
    from app.views.main_window import MainWindow


class Demo(QObject):
    """Opens it, and lets what does not ship be made in the background."""

    def __init__(self, window: "MainWindow") -> None:
        super().__init__(window)
        self._window = window
        self._bridge = Bridge(self)
        self._job: Job | None = None

    def open(self) -> None:
        """Show its results; at once where it was opened before."""
        folder = demo.place()
        if (folder / "session.json").is_file():
            self._show(folder)
        elif self._job is None:
            shell = self._window.shell
            self._job = Job(self.tr("Open demo"), "demo", {"session": str(folder)})
            self._job.listen(self._bridge.latest(self._follow))
            shell.wishes.say.emit(self.tr("The demo is being unpacked…"))
            shell.board.start(self._job)

    def _follow(self, status: JobStatus) -> None:
        if not status.ended:
            return
        self._job = None
        shell = self._window.shell
        if status.state is JobState.FAILED:
            shell.wishes.trouble.emit(trouble(status.message, status.details))
        elif status.state is JobState.DONE:
            folder = Path(str(status.result["session"]))
            self._show(folder)
            request = {"device": shell.settings.value.device, **status.result}
            shell.board.enqueue(Job(called(folder), "process", request))

    def _show(self, folder: Path) -> None:
        if self._window.open_session(folder):
            self._window.show_page("maps")
