"""What the mask page reads of a session and writes to it, without Qt: pictures, the object found, strokes.

Strokes are painted on the grid of the developed photographs, which stand upright here, and kept as `edits/strokes.png`,
of the photographs' own size as the sensor lies (green adds to the object, red takes from it, with blue exactly). They wait in a file
beside it while another process works on the session, which must not see its inputs change; nothing painted is lost if
the window goes meanwhile.
"""

import io
import json
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from app.inspect import falsecolour
from app.masking import ADD, EXACT, NOTHING, TAKE, outline
from engine.errors import BusyError, MaskError, reason
from engine.io import session as sessions
from engine.orientation import back, turn_picture, turned
from engine.pipeline import artifacts
from engine.pipeline.stage_functions import on_grid
from engine.sampling import evenly_spaced
from engine.types import Frames, Masks

STROKES, WAITING = "strokes.png", ".strokes.waiting.png"
PALETTE = (0, 0, 0, 0, 255, 0, 255, 0, 0, 0, 255, 255, 255, 0, 255)  # of the labels: red, green, blue
MEAN_VIEWS = 32  # that the mean is taken over: enough to blur the room
WHITE_VIEWS = 8  # that decide the one exposure of all views


@dataclass(frozen=True, slots=True, eq=False)
class Developed:
    """A session as the page shows it."""

    session: Path
    hdr: Path  # where the photographs lie
    segment: Path | None  # where the object found lies
    names: tuple[str, ...]
    frames: Frames
    object: Bool[np.ndarray, "h w"] | None
    area: int  # of the object, pixels
    border: Int[np.ndarray, "n 4"]  # of the object, as `outline` gives it
    white: float  # radiance to show as white at 0 EV, the same for all views

    @property
    def shape(self) -> tuple[int, int]:
        return self.frames.radiance.shape[1:3]


def load(session: Path, hdr: Path, segment: Path, known: Developed | None) -> Developed | None:
    """The photographs, and the object found in them; `known` again where it still is so, None before the first run.

    Args:
        hdr, segment: folders as the plan has them; what was shown last, or else the stage's newest result, stands in
            for what has not run.

    Raises:
        SessionError: a result cannot be read back.
    """
    ours = known if known is not None and known.session == session else None
    pictures = _present(hdr, ours.hdr if ours is not None else None)
    found = _present(segment, ours.segment if ours is not None else None)
    if pictures is None:
        return None
    if known is not None and (known.session, known.hdr, known.segment) == (session, pictures, found):
        return known
    flip = sessions.open_session(session).orientation
    frames = turned(artifacts.load(pictures, "frames", Frames), flip)
    mask = None if found is None else turned(artifacts.load(found, "masks", Masks), flip).object
    if mask is not None and mask.shape != frames.radiance.shape[1:3]:
        mask, found = None, None  # of photographs developed to another size
    area, border = (0, np.zeros((0, 4), int)) if mask is None else (int(mask.sum()), outline(mask))
    return Developed(session, pictures, found, frames.names, frames, mask, area, border, _white(frames, mask))


def picture(developed: Developed, view: int | None, exposure_ev: float) -> list[UInt8[np.ndarray, "h w 4"]]:
    """A view, or the mean over the views, as `falsecolour` makes them."""
    radiance = mean(developed) if view is None else developed.frames.radiance[view]
    return falsecolour.halves(falsecolour.radiance(radiance, developed.white, exposure_ev))


def waiting(session: Path) -> bool:
    """Whether strokes wait beside their place."""
    return (session / "edits" / WAITING).is_file()


def object_box(mask: Bool[np.ndarray, "h w"]) -> tuple[int, int, int, int] | None:
    """Left, top, right, bottom of the object, in pixels."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def mean(developed: Developed) -> Float32[np.ndarray, "h w 3"]:
    """Over evenly chosen views: the room blurs, the object stays. Lamps count as white, or they would outshine all."""
    frames = developed.frames
    chosen = evenly_spaced(len(frames.names), MEAN_VIEWS)
    total = np.zeros(frames.radiance.shape[1:], np.float32)
    for view in chosen:
        total += np.minimum(frames.radiance[view], np.float32(developed.white))
    return total / np.float32(len(chosen))


def read_labels(session: Path, shape: tuple[int, int]) -> UInt8[np.ndarray, "h w"]:
    """The strokes on the grid of the developed and upright photographs, by majority as the engine takes them.

    Raises:
        MaskError: the file is no picture of the photographs' size.
    """
    from engine.io.images import UNREADABLE_PICTURE, opened

    edits = session / "edits"
    path = next((edits / name for name in (WAITING, STROKES) if (edits / name).is_file()), None)
    if path is None or path.stat().st_size == 0:
        return np.zeros(shape, np.uint8)
    listed = sessions.open_session(session)
    height, width = _camera(listed)
    try:
        with opened(path) as image:
            if image.size != (width, height):
                raise MaskError(
                    f"{path}: is {image.width} x {image.height}, the photographs are {width} x {height}; remove it to"
                    " paint anew"
                )
            rgb = np.asarray(image.convert("RGB"))
    except UNREADABLE_PICTURE as error:
        raise MaskError(
            f"{path}: cannot be read as a picture ({reason(error)}); remove it to paint anew"
        ) from error
    red, green, blue = (rgb[..., channel] > 127 for channel in range(3))
    labels = np.zeros(shape, np.uint8)
    on_sensor = turn_picture(labels, back(listed.orientation))
    for label, painted in ((ADD, green & ~red), (TAKE, red & ~green)):
        for more, part in ((0, ~blue), (EXACT, blue)):
            on_sensor[on_grid(painted & part, on_sensor.shape)] = label + more
    return labels


class Keeper:
    """Writes strokes, the newest last, from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._written: dict[Path, int] = {}

    def keep(self, session: Path, labels: UInt8[np.ndarray, "h w"], number: int) -> str:
        """Write strokes unless newer ones were; tells why they wait, "" where they are in their place.

        Raises:
            SessionError: the disk refuses, or this is no session.
        """
        opened = sessions.open_session(session)
        with self._lock:
            if number > self._written.get(session, 0):
                on_sensor = turn_picture(labels, back(opened.orientation))
                sessions.write_edit(opened, WAITING, encoded(on_sensor, _camera(opened)))
                self._written[session] = number
            return _settle(opened)

    def settle(self, session: Path) -> str:
        """Put strokes that wait in their place, if that is possible now; tells as `keep`."""
        with self._lock:
            return _settle(sessions.open_session(session))


def encoded(labels: UInt8[np.ndarray, "h w"], camera: tuple[int, int]) -> bytes:
    """The PNG of a painting, height and width as the camera's; empty where nothing is painted."""
    from PIL import Image

    if not labels.any():
        return b""
    height, width = camera
    by = max(width // labels.shape[1], 1)
    full = np.full((height, width), NOTHING, np.uint8)
    enlarged = labels.repeat(by, axis=0).repeat(by, axis=1)
    full[: enlarged.shape[0], : enlarged.shape[1]] = enlarged
    image = Image.fromarray(full)
    image.putpalette(PALETTE)
    content = io.BytesIO()
    image.save(content, "PNG", compress_level=4)
    return content.getvalue()


def _settle(session: sessions.Session) -> str:
    waiting = session.folder / "edits" / WAITING
    if not waiting.is_file():
        return ""
    try:
        with sessions.lock(session):
            content = waiting.read_bytes()
            if content:
                sessions.write_edit(session, STROKES, content)
            else:
                sessions.drop_edit(session, STROKES)
            sessions.drop_edit(session, WAITING)
    except BusyError as error:
        return str(error)
    return ""


def _present(folder: Path, shown: Path | None) -> Path | None:
    """This result, or else the one that was shown last, or else the stage's newest."""
    for known in (folder, shown):
        if known is not None and (known / "record.json").is_file():
            return known
    return newest(folder.parent)


def newest(stage: Path) -> Path | None:
    """The latest finished result in a stage's folder."""
    finished = []
    for record in stage.glob("*/record.json"):
        try:
            if record.parent.suffix != ".partial":
                finished.append((float(json.loads(record.read_bytes())["finished"]), record.parent))
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return max(finished)[1] if finished else None


def _camera(session: sessions.Session) -> tuple[int, int]:
    """Height and width of the photographs.

    Raises:
        MaskError: the session does not say.
    """
    camera = session.facts["camera"]
    if not camera.get("height") or not camera.get("width"):
        raise MaskError(f"{session.folder}: does not say how large its photographs are; import them again")
    return camera["height"], camera["width"]


def _white(frames: Frames, mask: Bool[np.ndarray, "h w"] | None) -> float:
    """The 99th percentile of the object's brightest channel over some views, or the 90th of everything."""
    views = evenly_spaced(len(frames.names), WHITE_VIEWS)
    known = mask is not None and bool(mask.any())
    seen: list[Float[np.ndarray, " m"]] = []
    for view in views:
        brightest = frames.radiance[view].max(axis=-1)
        seen.append(brightest[mask] if known else brightest[::4, ::4].ravel())
    return float(np.percentile(np.concatenate(seen), 99 if known else 90)) or 1.0
