"""Find what is plugged in, and open rigs and cameras by their device URL.

Importing this costs nothing: each kind of device is loaded when it is opened. What a URL may say is in `RIGS`,
`CAMERAS` and `RIG_WORDS`, and in the configuration of each driver.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hardware.errors import SettingsError
from hardware.interfaces import Angles, Camera, Geometry, Motion
from hardware.rig import Rig
from hardware.urls import DeviceUrl, UnknownSettingError, Word, number, parse, read_words, triple, yes

if TYPE_CHECKING:
    from hardware.manual import Ask

RIGS = {
    "grbl": "grbl:///dev/ttyUSB0?axes=xy",
    "zaber": "zaber:///dev/ttyUSB0?axes=1.1,1.2",
    "manual": "manual:",
    "none": "none:",
    "virtual": "virtual:",
}
CAMERAS = {
    "gphoto2": "gphoto2: or gphoto2:usb:001,004",
    "folder": "folder:/path/to/tethered",
    "virtual": "virtual:?room=parlour&object=blob",
}

# Settings of every rig, whatever its kind. Axes and points as `interfaces.Geometry` has them.
RIG_WORDS = {
    "settle": Word(number(0.0, 600.0), "0.5 (seconds)"),
    "file": Word(str, "rig.toml (a file with these settings, and those of the device)"),
    "pan_axis": Word(triple, "0,-1,0"),
    "pan_point": Word(triple, "0.03,0.06,0.25 (metres)"),
    "tilt_axis": Word(triple, "1,0,0"),
    "tilt_point": Word(triple, "0.03,0.04,0.265 (metres)"),
}
# Of hands: the time to hold it another way before the next photograph.
SETTLE_S = {"grbl": 0.3, "zaber": 0.3, "manual": 1.0, "none": 3.0, "virtual": 0.0}
_AXES = ("pan_axis", "pan_point", "tilt_axis", "tilt_point")

Progress = Callable[[float, str], None]


@dataclass(frozen=True, slots=True)
class Port:
    """A serial port, what the system says of it, and which rigs use such an adapter ("" if none is known to)."""

    path: str
    description: str
    likely: str


# USB vendors (usb.ids) of controllers and of the adapters that are soldered to them.
_VENDORS = {
    0x2939: "zaber", 0x2341: "grbl", 0x2A03: "grbl", 0x1A86: "grbl", 0x10C4: "grbl", 0x303A: "grbl", 0x0403: "grbl",
}  # fmt: skip


def ports(listed: Callable[[], Iterable[Any]] | None = None) -> tuple[Port, ...]:
    """The serial ports of this machine that something is plugged into, likely ones first."""
    from serial.tools import list_ports

    found = []
    for port in (listed or list_ports.comports)():
        if port.vid is None and (port.hwid or "n/a") == "n/a":
            continue  # a socket on the board with nothing known behind it
        description = port.description if port.description not in (None, "n/a") else port.hwid
        found.append(Port(port.device, description, _VENDORS.get(port.vid or 0, "")))
    return tuple(sorted(found, key=lambda port: (not port.likely, port.path)))


def open_motion(url: str, ask: "Ask | None" = None) -> Motion:
    """The part of a rig that turns.

    Args:
        ask: shows a person what to do, for `manual:`; in the terminal if None.

    Raises:
        SettingsError: the URL cannot be meant; the message says what is possible.
        HardwareError: as the driver says.
    """
    return _motion(_rig_settings(url)[0], ask)


def open_camera(
    url: str,
    where: Callable[[], Angles] | None = None,
    tell: Callable[[str], None] | None = None,
    progress: Progress | None = None,
    kind: str = "gimbal",
) -> Camera:
    """A camera.

    Args:
        where: where the rig truly stands, for `virtual:`; at its zero if None.
        tell: tells a person to take a photograph, for `folder:`; in the terminal if None.
        progress: of baking a virtual room, which takes minutes the first time.
        kind: of the virtual rig under a virtual camera.

    Raises:
        SettingsError: the URL cannot be meant; the message says what is possible.
        HardwareError: as the driver says.
    """
    from hardware.camera.urls import open_url

    return open_url(parse(url, "camera", CAMERAS), where, tell, progress, kind)


def open_rig(
    rig_url: str,
    camera_url: str,
    ask: "Ask | None" = None,
    tell: Callable[[str], None] | None = None,
    progress: Progress | None = None,
) -> Rig:
    """A whole rig; arguments as `open_motion` and `open_camera` have them.

    Raises:
        SettingsError: a URL cannot be meant; the message says what is possible.
        HardwareError: as the drivers say; nothing stays open then.
    """
    url, common = _rig_settings(rig_url)
    parse(camera_url, "camera", CAMERAS)  # before a rig is opened for nothing
    motion = _motion(url, ask)
    try:
        geometry, kind = _geometry(common), "gimbal"

        def where() -> Angles:
            return motion.status().angles or Angles(0.0)

        if url.scheme == "virtual":
            from hardware.virtual.rig import VirtualHands, VirtualRig

            assert isinstance(motion, VirtualRig | VirtualHands)
            where, kind = motion.angles, motion.config.kind
            geometry = geometry or motion.geometry
        camera = open_camera(camera_url, where, tell, progress, kind)
    except BaseException:
        motion.close()
        raise
    return Rig(motion, camera, geometry, common.get("settle", SETTLE_S[url.scheme]))


def _motion(url: DeviceUrl, ask: "Ask | None") -> Motion:
    try:
        return _opened(url, ask)
    except UnknownSettingError as error:
        raise SettingsError(f"{error}, and of every rig {', '.join(RIG_WORDS)}") from None


def _opened(url: DeviceUrl, ask: "Ask | None") -> Motion:
    match url.scheme:
        case "grbl":
            from hardware.grbl.opening import GrblConfig, open_grbl

            return open_grbl(GrblConfig.from_query(_port(url), url.query))
        case "zaber":
            from hardware.zaber.opening import ZaberConfig, open_zaber

            return open_zaber(ZaberConfig.from_query(_port(url), url.query))
        case "virtual":
            from hardware.virtual.rig import VirtualConfig, open_virtual

            return open_virtual(VirtualConfig.from_query(url.place, url.query))
        case "manual":
            from hardware.manual import TILT_DEG, Manual, ask_in_terminal

            _no_place(url)
            tilts = read_words("manual", url.query, {"tilt": Word(yes, "no (a stand that only turns)")})
            return Manual(ask or ask_in_terminal, TILT_DEG if tilts.get("tilt", True) else None)
        case _:
            from hardware.manual import Handheld

            _no_place(url)
            read_words("none", url.query, {})
            return Handheld()


def _port(url: DeviceUrl) -> str:
    if not url.place:
        raise SettingsError(
            f"{url.scheme}: which port? Write {RIGS[url.scheme]}; `roomlight rig list` lists the ports"
        )
    return url.place


def _no_place(url: DeviceUrl) -> None:
    if url.place:
        raise SettingsError(f"{url.scheme}:{url.place}: nothing stands after the colon; write {url.scheme}:")


def _rig_settings(text: str) -> tuple[DeviceUrl, dict[str, Any]]:
    """The URL with the settings of its own device, and the values of those that every rig has.

    Raises:
        SettingsError: as its message says.
    """
    url = parse(text, "rig", RIGS)
    query = dict(url.query)
    if "file" in query:
        path = Path(os.path.expanduser(query.pop("file")))
        query = {**_from_file(path), **query}  # what the URL says itself counts
    common = {word: value for word, value in query.items() if word in RIG_WORDS}
    own = {word: value for word, value in query.items() if word not in RIG_WORDS}
    return replace(url, query=own), read_words(url.scheme, common, RIG_WORDS)


def _from_file(path: Path) -> dict[str, str]:
    """The settings in a TOML file, as a URL would say them."""
    import tomllib

    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: no TOML ({error}); correct the rig's file") from None
    except OSError as error:
        raise SettingsError(
            f"{path}: cannot be read ({error.strerror}); check file= in the device URL"
        ) from None
    return {word: _as_text(path, word, value) for word, value in content.items()}


def _as_text(path: Path, word: str, value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ",".join(_as_text(path, word, part) for part in value)
    if isinstance(value, str | int | float):
        return str(value)
    raise SettingsError(
        f"{path}: {word} is neither number, text, yes or no nor a list of these; correct the rig's file"
    )


def _geometry(common: Mapping[str, Any]) -> Geometry | None:
    """Where the axes are, if that was said; of a rig without tilt axis the pan's point stands in for its."""
    told = {word: common[word] for word in _AXES if word in common}
    if not told:
        return None
    missing = [word for word in ("pan_axis", "pan_point") if word not in told]
    if ("tilt_axis" in told) != ("tilt_point" in told):
        missing += [word for word in ("tilt_axis", "tilt_point") if word not in told]
    if missing:
        raise SettingsError(
            f"of the rig's geometry {', '.join(told)} was said but not {', '.join(missing)}; "
            f"write it like {missing[0]}={RIG_WORDS[missing[0]].example}"
        )
    for word in ("pan_axis", "tilt_axis"):
        if word in told and not any(told[word]):
            raise SettingsError(
                f"{word}=0,0,0 is no direction; write it like {word}={RIG_WORDS[word].example}"
            )
    return Geometry(**{"tilt_axis": (1.0, 0.0, 0.0), "tilt_point": told["pan_point"], **told})
