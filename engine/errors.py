"""What can go wrong, one class a room; every message names the file, the cause and the remedy.

The command line turns any `RoomlightError` into one line on stderr and exit code 2. Anything else that
escapes is a bug and keeps its traceback.
"""

LONGEST_REASON = 160  # characters


class RoomlightError(Exception):
    """Base of every error a person can do something about."""


class SessionError(RoomlightError):
    """The session folder is missing, locked, damaged or of a newer schema."""


class BusyError(SessionError):
    """Another process works on the session; what was asked may succeed when it has ended."""


class ImportFault(RoomlightError):
    """Photographs, poses or masks given to `import` do not fit together."""


class RawError(RoomlightError):
    """A RAW or EXR file cannot be read or holds values that no camera makes."""


class HdrError(RoomlightError):
    """A bracket is incomplete, or no exposure of it holds usable pixels."""


class MaskError(RoomlightError):
    """The object could not be told from the background, or a given mask does not fit."""


class PoseError(RoomlightError):
    """Too few views could be placed, or given poses are not rigid transforms."""


class LightError(RoomlightError):
    """The background does not determine a light."""


class SurfaceError(RoomlightError):
    """The surface cannot be solved from these views and this light."""


class ExportError(RoomlightError):
    """A result could not be written."""


class TruthError(RoomlightError):
    """A ground truth cannot be read, or does not fit the result it is held against."""


class Cancelled(RoomlightError):
    """The person asked for a stop; what was finished stays finished."""


def reason(fault: BaseException) -> str:
    """What a library said, on one line and no longer than a person reads."""
    text = " ".join(str(fault).split())
    text = text if len(text) <= LONGEST_REASON else f"{text[: LONGEST_REASON - 3]}..."
    # A KeyError says the key and nothing else, some say nothing at all.
    return f"{type(fault).__name__} {text}".rstrip() if isinstance(fault, KeyError) or not text else text
