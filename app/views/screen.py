"""Is there a screen to open a window on? Asked before Qt, which would abort the process and guess at missing packages."""

import re
import socket
from collections.abc import Mapping

from engine.errors import RoomlightError

WAIT_S = 5.0
FIRST_PORT = 6000
"""Of display 0 over TCP; display N listens N ports further on (X(7), "Display names")."""


class NoScreen(RoomlightError):
    """A window was asked for where none can be shown."""


def need_screen(platform: str, environment: Mapping[str, str]) -> None:
    """Find out whether a window can be shown.

    Raises:
        NoScreen: on Linux, with no display named, or an X display that nobody answers for.
    """
    if platform != "linux" or environment.get("WAYLAND_DISPLAY") or environment.get("QT_QPA_PLATFORM"):
        return
    display = environment.get("DISPLAY", "")
    if not display:
        fault = "neither DISPLAY nor WAYLAND_DISPLAY is set"
    elif not answers(display):
        fault = f"nothing answers for DISPLAY={display}"
    else:
        return
    raise NoScreen(
        f"no screen to open a window on: {fault}; start it on a desktop, through `ssh -X` or `xvfb-run`, or use the"
        " command line (`roomlight process`), which needs none"
    )


def answers(display: str) -> bool:
    """Whether an X server takes connections for a display name, `[host]:N[.screen]`; True for a name of another form."""
    parts = re.fullmatch(r"(?P<host>[^:]*):(?P<number>\d+)(\.\d+)?", display)
    if parts is None:
        return True
    host, number = parts["host"], int(parts["number"])
    if host not in ("", "unix"):
        try:
            socket.create_connection((host, FIRST_PORT + number), WAIT_S).close()
        except OSError:
            return False
        return True
    # A file, and on Linux the same name without one.
    return any(_listens(prefix + f"/tmp/.X11-unix/X{number}") for prefix in ("", "\0"))


def _listens(address: str) -> bool:
    with socket.socket(socket.AF_UNIX) as there:
        there.settimeout(WAIT_S)
        return there.connect_ex(address) == 0
