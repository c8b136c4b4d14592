"""What is peculiar to a family of cameras: names of settings, brackets of their own, RAW formats. One small class each.

Source: libgphoto2 2.5.34, camlibs/ptp2/config.c, for names and choices; its pull request 1027 and issue 968 for how
an EOS R8 brackets. A camera that is missing here works as `AnyCamera`: shutters are set one by one.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from hardware.camera.values import bracket_ev

Choices = Mapping[str, Sequence[str]]  # of each setting the camera has, by its name


@dataclass(frozen=True, slots=True)
class OwnBracket:
    """How a camera takes a whole bracket at one release."""

    changes: tuple[tuple[str, str], ...]  # setting and choice
    order: tuple[float, ...]  # EV of its files in the order they come


class Quirks(ABC):
    """What the driver asks about a camera."""

    shutter: ClassVar[tuple[str, ...]]  # names the setting may have, the best first
    aperture: ClassVar[tuple[str, ...]]
    quality: ClassVar[tuple[str, ...]]  # RAW or JPEG
    raw_suffix: ClassVar[str]  # ".cr3"; "" if it is only known by looking
    single: ClassVar[tuple[tuple[str, str], ...]]  # settings under which one release is one photograph
    busy_s: ClassVar[float]  # how long to ask again while it says that it is busy

    @abstractmethod
    def knows(self, model: str) -> bool: ...

    @abstractmethod
    def own_bracket(self, stops: Sequence[float], choices: Choices) -> OwnBracket | None:
        """None: it cannot take these stops by itself, or we do not know how."""


class CanonEosR8(Quirks):
    """Brackets by `aeb`; nothing tells when it is ready again, so it is asked until it does not say busy."""

    shutter = ("shutterspeed",)
    aperture = ("aperture",)
    quality = ("imageformat",)
    raw_suffix = ".cr3"
    single = (("aeb", "off"), ("drivemode", "Single"))
    busy_s = 10.0

    def knows(self, model: str) -> bool:
        return model.startswith("Canon EOS R8")

    def own_bracket(self, stops: Sequence[float], choices: Choices) -> OwnBracket | None:
        """In continuous drive one release takes all three; menu order "0, -, +", as it leaves the factory."""
        step = max(stops, default=0.0)
        widths = [
            choice for choice in choices.get("aeb", ()) if abs((bracket_ev(choice) or 0.0) - step) < 0.05
        ]
        drives = [choice for choice in choices.get("drivemode", ()) if choice.startswith("Continuous")]
        if step <= 0 or sorted(stops) != [-step, 0.0, step] or not widths or not drives:
            return None
        drive = next((choice for choice in drives if "high" in choice), drives[0])
        return OwnBracket((("aeb", widths[0]), ("drivemode", drive)), (0.0, -step, step))


class CanonEos(Quirks):
    """Other EOS bodies. Some take one photograph of a bracket per release: shutters are set one by one."""

    shutter = ("shutterspeed",)
    aperture = ("aperture",)
    quality = ("imageformat",)
    raw_suffix = ""
    single = (("aeb", "off"), ("drivemode", "Single"))
    busy_s = 8.0

    def knows(self, model: str) -> bool:
        return model.startswith("Canon EOS")

    def own_bracket(self, stops: Sequence[float], choices: Choices) -> OwnBracket | None:
        return None


class Nikon(Quirks):
    """Says shutters twice, in its own fractions and in tenths of milliseconds; the fractions are finer."""

    shutter = ("shutterspeed2", "shutterspeed")
    aperture = ("f-number", "aperture")
    quality = ("imagequality",)
    raw_suffix = ".nef"
    single = (("capturemode", "Single Shot"),)
    busy_s = 8.0

    def knows(self, model: str) -> bool:
        return model.startswith("Nikon")

    def own_bracket(self, stops: Sequence[float], choices: Choices) -> OwnBracket | None:
        return None


class SonyAlpha(Quirks):
    """Its brackets are drive modes with steps of at most 3 EV whose order is set in a menu: left alone."""

    shutter = ("shutterspeed",)
    aperture = ("f-number", "aperture")
    quality = ("imagequality",)
    raw_suffix = ".arw"
    single = (("capturemode", "Single Shot"),)
    busy_s = 8.0

    def knows(self, model: str) -> bool:
        return model.startswith("Sony")

    def own_bracket(self, stops: Sequence[float], choices: Choices) -> OwnBracket | None:
        return None


class AnyCamera(Quirks):
    """What libgphoto2 calls things on most cameras."""

    shutter = ("shutterspeed", "shutterspeed2", "exptime")
    aperture = ("aperture", "f-number")
    quality = ("imageformat", "imagequality")
    raw_suffix = ""
    single = ()
    busy_s = 8.0

    def knows(self, model: str) -> bool:
        return True

    def own_bracket(self, stops: Sequence[float], choices: Choices) -> OwnBracket | None:
        return None


ALL: tuple[Quirks, ...] = (CanonEosR8(), CanonEos(), Nikon(), SonyAlpha(), AnyCamera())


def of(model: str) -> Quirks:
    """The first that knows this model as libgphoto2 calls it."""
    return next(quirks for quirks in ALL if quirks.knows(model))


def raw_alone(choices: Sequence[str]) -> str | None:
    """The choice that stores a full RAW file and nothing else: 'RAW', 'NEF (Raw)', 'NEF+Fine' not; None if none does."""
    single = [choice for choice in choices if "raw" in choice.lower() and "+" not in choice]
    # cRAW, mRAW and sRAW are smaller or lossy; 'NEF (Raw)' and 'RAW' are neither.
    return next(
        (choice for choice in single if "RAW" in choice.replace("(Raw)", "RAW").split()), None
    ) or next(iter(single), None)
