"""What the supervisor of the drawing process tells its listener."""

from dataclasses import dataclass

from app.viewer.protocol import Contents, Look, Probed


@dataclass(frozen=True, slots=True)
class Status:
    """How the view is doing.

    `state`: "off", "starting", "loading", "showing", "restarting", and, waiting for `retry`: "refused" (the session
    cannot be shown), "unable" (no graphics here), "failed" (restarted too often).
    """

    state: str = "off"
    message: str = ""
    remedy: str = ""
    details: str = ""  # for somebody who can help
    renderer: str = ""
    restarts: int = 0  # so far, all together

    @property
    def stuck(self) -> bool:
        """Whether nothing happens until a person asks for it."""
        return self.state in ("refused", "unable", "failed")


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What to show, as protocol.Frame has it: rows of blue green red unused."""

    pixels: bytes
    width: int
    height: int
    look: Look  # what it shows
    samples: int
    last: bool
    milliseconds: float


Event = Status | Picture | Contents | Probed
