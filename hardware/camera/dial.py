"""A camera's settings as exposures: which it offers, which are nearest to what is asked, and setting them for sure.

A camera ignores what its mode dial does not allow without saying so; so every setting is read back. Seconds, EV.
"""

import contextlib
import itertools
from collections.abc import Callable, Mapping, Sequence

from hardware.camera import quirks as camera_quirks
from hardware.camera import values as camera_values
from hardware.camera.body import Body, Refused, Setting
from hardware.camera.quirks import OwnBracket, Quirks
from hardware.camera.values import nearest, offered, seconds
from hardware.errors import SettingsError
from hardware.interfaces import Bracket, CameraFeatures, Exposure

READS = 10  # of a setting until it is what was set
READ_AGAIN_S = 0.05


class Dial:
    """Finds its settings when made; `patiently` asks again while the camera is busy."""

    def __init__(
        self,
        body: Body,
        quirks: Quirks,
        patiently: Callable[[Callable[[], None]], None],
        sleep: Callable[[float], None],
    ):
        self._quirks, self._patiently, self._sleep = quirks, patiently, sleep
        self._settings = body.settings()
        self._shutter, self._aperture, self._quality = (
            self._first(names) for names in (quirks.shutter, quirks.aperture, quirks.quality)
        )
        self._iso = self._first(("iso",))
        self._shutters = offered(self._choices(self._shutter), seconds)
        self._isos = offered(self._choices(self._iso), camera_values.iso)
        self._apertures = offered(self._choices(self._aperture), camera_values.f_number)
        self._jpeg_only = body.jpeg_only()
        self._persons_shutter = self._left_shutter = ""  # as the person had it; as our last exposure left it
        self._found: dict[
            str, str
        ] = {}  # what the person had set of what we change and they would not expect

    @property
    def files(self) -> int:
        """How many files one exposure makes."""
        return 2 if self._quality and "+" in self._settings[self._quality].value else 1

    def store(self, body: Body, to_card: bool) -> None:
        """Say where photographs go, and that they be RAW if the camera can do that."""
        if choices := self._choices("capturetarget"):
            card = next((choice for choice in choices if "card" in choice.lower()), choices[-1])
            memory = next((choice for choice in choices if "ram" in choice.lower()), choices[0])
            self._set(body, "capturetarget", card if to_card else memory)
        raw = camera_quirks.raw_alone(self._choices(self._quality))
        if self._quality and raw:
            self._set(body, self._quality, raw)
            self._settings = {**self._settings, self._quality: body.setting(self._quality)}

    def features(self, model: str) -> CameraFeatures:
        return CameraFeatures(
            model,
            tuple(self._shutters),
            tuple(int(value) for value in self._isos),
            tuple(self._apertures),
            self._suffix(),
            sets_exposure=bool(self._shutters),
        )

    def plan(self, body: Body, bracket: Bracket) -> tuple[Exposure, ...]:
        """What the camera will be set to for each stop.

        Raises:
            SettingsError: something in it is not offered.
        """
        iso = self._near(body, self._iso, self._isos, bracket.base.iso, camera_values.iso, "ISO {}", 1.0)
        aperture = self._near(
            body,
            self._aperture,
            self._apertures,
            bracket.base.aperture,
            camera_values.f_number,
            "aperture of f/{}",
            2.0,
        )
        shutters = self._shutters_of(body, bracket)
        return tuple(
            Exposure(shutter_s, None if iso is None else int(iso), aperture) for shutter_s in shutters
        )

    def own_bracket(self, bracket: Bracket) -> OwnBracket | None:
        """How the camera takes this bracket at one release, if it can."""
        choices = {name: setting.choices for name, setting in self._settings.items() if not setting.readonly}
        return self._quirks.own_bracket(bracket.stops, choices)

    def turn(self, body: Body, exposure: Exposure, changes: Sequence[tuple[str, str]]) -> None:
        """Set an exposure as `plan` gave it, and other settings where the camera has them.

        Raises:
            SettingsError: the camera keeps something else.
        """
        for name, choice in changes:
            if choice in self._choices(name):
                self._found.setdefault(name, body.setting(name).value)
                self._set(body, name, choice)
        for name, choices, value in (
            (self._iso, self._isos, exposure.iso),
            (self._aperture, self._apertures, exposure.aperture),
            (self._shutter, self._shutters, exposure.shutter_s),
        ):
            if name is not None and value in choices:
                self._set(body, name, choices[value])
                if name == self._shutter:
                    self._left_shutter = choices[value]

    def restore(self, body: Body) -> None:
        """Put back what nobody expects to have changed: drive mode and bracketing."""
        for name, choice in self._found.items():
            with contextlib.suppress(Refused):
                body.set(name, choice)

    def battery(self, body: Body) -> float | None:
        """Charge left, 0 to 1; None where the camera does not tell."""
        if "batterylevel" not in self._settings:
            return None
        return camera_values.battery(body.setting("batterylevel").value)

    def _shutters_of(self, body: Body, bracket: Bracket) -> list[float | None]:
        if self._shutter is None or not self._shutters:
            if bracket.stops != (0.0,) or bracket.base.shutter_s is not None:
                raise SettingsError(
                    "this camera's shutter cannot be set from here; turn its mode dial to M, or set the bracket on the"
                    " camera and use folder: instead of gphoto2:"
                )
            return [None]
        base = bracket.base.shutter_s
        if base is None:
            now = body.setting(self._shutter).value
            if now != self._left_shutter:
                self._persons_shutter = now  # else every bracket would begin where the last one ended
            now = self._persons_shutter
            base = seconds(now)
            if base is None:
                raise SettingsError(
                    f"the camera's shutter is at {now!r}; turn its mode dial to M, or say a shutter time"
                )
        if not base > 0:
            raise SettingsError(f"a shutter of {base:g} s cannot be meant; say a time above 0")
        values = [
            nearest(
                base * 2**stop, list(self._shutters), f"shutter of {camera_values.told(base * 2**stop)} s"
            )
            for stop in bracket.stops
        ]
        for one, two in itertools.combinations(range(len(values)), 2):
            if values[one] == values[two] and bracket.stops[one] != bracket.stops[two]:
                raise SettingsError(
                    f"{bracket.stops[one]:+g} and {bracket.stops[two]:+g} EV would both be"
                    f" {camera_values.told(values[one])} s, the nearest this camera offers; choose stops further apart"
                )
        return list(values)

    def _near(self, body: Body, name: str | None, values: Mapping[float, str], asked: float | None,
              parse: Callable[[str], float | None], what: str, ev_per_octave: float) -> float | None:  # fmt: skip
        """The offered value nearest to `asked`; what the camera has now when nothing is asked."""
        if asked is None:
            return parse(body.setting(name).value) if name else None
        what = what.format(f"{asked:g}")
        if not values or not asked > 0:
            raise SettingsError(f"{what} cannot be set on this camera from here; set it on the camera")
        return nearest(asked, list(values), what, ev_per_octave)

    def _set(self, body: Body, name: str, choice: str) -> None:
        before = body.setting(name).value
        if before == choice:
            return
        self._patiently(lambda: body.set(name, choice))
        kept = before
        for _ in range(READS):
            kept = body.setting(name).value
            if kept == choice:
                return
            self._sleep(READ_AGAIN_S)
        raise SettingsError(
            f"the camera keeps {name} at {kept!r} though {choice!r} was set; turn its mode dial to M and close its menus"
        )

    def _suffix(self) -> str:
        if self._jpeg_only:
            return ".jpg"
        quality = self._settings[self._quality].value if self._quality else ""
        if any(word in quality.lower() for word in ("raw", "nef")):
            return self._quirks.raw_suffix
        return ".jpg" if any(word in quality.lower() for word in ("jpeg", "fine", "normal", "basic")) else ""

    def _first(self, names: Sequence[str]) -> str | None:
        return next((name for name in names if name in self._settings), None)

    def _choices(self, name: str | None) -> tuple[str, ...]:
        setting = self._settings.get(name or "", Setting(""))
        return () if setting.readonly else setting.choices
