"""How the GRBL emulator speaks: as GRBL 1.1h itself, as grblHAL, or as FluidNC.

Source: GRBL 1.1 documentation, "Interface"; grblHAL, protocol.c (what still stands after a start is told once more) and
report.c (`$I`, sub-states of alarms); FluidNC wiki, "GRBL compatibility" and "Startup message".
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Dialect:
    """Vary one by `dataclasses.replace`."""

    firmware: str
    greeting: str  # after every reset
    build: tuple[str, ...]  # lines of `$I`; {} is the build text that `$I=` stored
    message: str = "[MSG:{}]"
    program_end: str = "Pgm End"
    line_characters: int = 79  # as many as a line may have
    tells_in_alarm: bool = True  # answers `?` where an alarm wants a reset
    tells_homing: bool = False  # answers `?` while it homes
    homes_each: bool = False  # knows `$HX`
    homing_required: bool = False  # tells alarm 11 after every start until homed; `$X` does not end it
    axes: int = 3  # in reports; of more than three the others stand still
    fields: str = ""  # at the end of every report
    boot: tuple[str, ...] = ()  # said with power, before it greets


GRBL = Dialect(
    "GRBL", "Grbl 1.1h ['$' for help]", ("[VER:1.1h.20190825:{}]", "[OPT:V,15,128]"), tells_in_alarm=False
)
GRBLHAL = Dialect(
    "grblHAL",
    "GrblHAL 1.1f ['$' or '$HELP' for help]",
    (
        "[VER:1.1f.20240330:{}]", "[OPT:VNMHSL,35,1024,3,0]", "[AXS:3:XYZ]", "[NEWOPT:ENUMS,RT+,HOME,TC,SED]",
        "[FIRMWARE:grblHAL]", "[DRIVER VERSION:240330]",
    ),
    line_characters=256,
    homes_each=True,
    homing_required=True,
)  # fmt: skip
FLUIDNC = Dialect(
    "FluidNC",
    "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]",
    ("[VER:3.7 FluidNC v3.7.8:{}]", "[OPT:PHS]"),
    message="[MSG:INFO: {}]",
    program_end="Program End",
    line_characters=254,
    tells_homing=True,
    homes_each=True,
)
