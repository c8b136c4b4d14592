"""What the exit code of a command says; docs/automation.md tells the authors of other programs."""

import enum

from engine.errors import BusyError


class ExitCode(enum.IntEnum):
    """Of several that fit, as of a batch's sessions, the one that stands first here is given."""

    STOPPED = 130  # by Ctrl-C; the same command goes on
    FAULT = 1  # in Roomlight itself
    REFUSED = 2  # a person can put it right: one line on stderr says how
    BUSY = 4  # another process holds the session; the same may succeed when that has ended
    DOUBTED = 3  # with --strict: the result is there and not good
    DONE = 0


def code_of(error: Exception) -> ExitCode:
    """Of an error that a person can do something about."""
    return ExitCode.BUSY if isinstance(error, BusyError) else ExitCode.REFUSED
