"""Starts the window: fonts and colours, translations, crash reports, and the session named on the command line."""

import os
import signal
import sys
import threading
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QCoreApplication, QLibraryInfo, QLocale, Qt, QTimer, QTranslator
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QWidget

from app import crash
from app.settings import Settings
from app.state import Trouble
from app.views import pages, theme
from app.views.bridge import Bridge
from app.views.cycles import collect_here
from app.views.main_window import MainWindow
from app.views.screen import need_screen
from app.views.trouble import show_trouble

TRANSLATIONS = Path(__file__).parents[1] / "translations"
SIGNAL_LOOK_MS = 200
PRELOAD_MS = 500  # after the window was shown, so that the window comes first

translate = QCoreApplication.translate


def run(session: Path | None) -> int:
    """Open the window and stay until it is closed; returns the exit code.

    Raises:
        NoScreen: there is nothing to show it on.
    """
    need_screen(sys.platform, os.environ)
    app = make()
    settings = Settings()
    theme.install(app, settings.value.theme)
    window = MainWindow(settings)
    collect_here(window)
    faults = Faults(window)
    faults.install()
    _, report = crash.watch()
    window.show()
    if report is not None:
        text = translate("Faults", "Roomlight crashed last time. A report was kept: {0}").format(report)
        window.status.say(text)
    if session is not None:
        QTimer.singleShot(0, window, lambda: window.go_to_session(session.absolute()))
    QTimer.singleShot(PRELOAD_MS, window, pages.preload)
    _heed_ctrl_c(window)
    return app.exec()


def make() -> QApplication:
    """The QApplication, with its name and translations."""
    QGuiApplication.setHighDpiScaleFactorRoundingPolicy(Qt.HighDpiScaleFactorRoundingPolicy.PassThrough)
    app = QApplication.instance() or QApplication(sys.argv[:1])
    assert isinstance(app, QApplication)
    app.setApplicationName("roomlight")
    app.setApplicationDisplayName("")  # the window's title says it already
    app.setDesktopFileName("roomlight")
    locale = QLocale()
    for name, folder in (
        ("qtbase", QLibraryInfo.path(QLibraryInfo.LibraryPath.TranslationsPath)),
        ("roomlight", str(TRANSLATIONS)),
    ):
        translator = QTranslator(app)
        if translator.load(locale, name, "_", folder):
            app.installTranslator(translator)
    return app


class Faults:
    """Faults nobody caught: kept as a report and told, wherever they happened; the window goes on."""

    def __init__(self, window: QWidget, keep=crash.keep) -> None:
        self._window, self._keep = window, keep
        self._open = False  # one dialog at a time: a fault in painting comes back with every frame
        self._tell = Bridge(window).queued(self._show)

    def install(self) -> None:
        sys.excepthook = self.take
        threading.excepthook = lambda args: self.take(
            args.exc_type, args.exc_value or args.exc_type(), args.exc_traceback
        )

    def take(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        """One fault."""
        text = crash.told(kind, error, trace)
        sys.stderr.write(text)
        if issubclass(kind, KeyboardInterrupt):
            return
        self._tell(f"{kind.__name__}: {error}", text, self._keep(text))

    def _show(self, what: str, text: str, kept: Path | None) -> None:
        if self._open:
            return
        self._open = True
        where = translate("Faults", "a report was kept in {0}").format(kept) if kept is not None else ""
        remedy = translate("Faults", "Your session is on the disk and safe; go on, or start Roomlight again")
        told = Trouble(
            translate("Faults", "A fault in Roomlight itself: {0}").format(what),
            f"{remedy}; {where}" if where else remedy,
            text,
        )
        show_trouble(self._window, told).finished.connect(self._closed)

    def _closed(self, code: int) -> None:
        self._open = False


def _heed_ctrl_c(window: QWidget) -> None:
    """Ctrl-C in the terminal closes the window in order; Python hears it only while its own code runs."""
    asked = threading.Event()
    signal.signal(signal.SIGINT, lambda number, frame: asked.set())

    def look() -> None:
        # Closing in the handler itself would cut into whatever the window's code was doing.
        if asked.is_set():
            asked.clear()
            window.close()

    timer = QTimer(window)
    timer.timeout.connect(look)
    timer.start(SIGNAL_LOOK_MS)
