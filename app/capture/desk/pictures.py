"""Pictures for the page: photographs and the room's coverage as PNG files in the desk's own folder.

A file is never written twice, and the last few are kept: the page may still be reading the one before.
"""

import itertools
import threading
from collections import defaultdict, deque
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from engine.errors import RawError, RoomlightError
from engine.io.session import told

if TYPE_CHECKING:
    import numpy as np

    from app.work.worker import Link

EDGE_PX = 1024
KEPT = 8  # of a kind
CLIPPED_CODE, DARK_CODE = 254, 2  # of a developed picture


class Pictures:
    """Writes and tells; any thread."""

    def __init__(self, link: "Link", folder: Path) -> None:
        self._link, self._folder = link, folder
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self._there: defaultdict[str, deque[Path]] = defaultdict(deque)

    def show(self, files: Sequence[Path], pose: str, flip: int | None = None) -> None:
        """Tell a `picture` of one shot; that it cannot be shown is worth a line in the log only.

        Args:
            flip: stands it upright (`engine/orientation.py`); None: as its own tag says.
        """
        try:
            self._link.emit("data", kind="picture", pose=pose, **self._facts(files, flip))
        except RoomlightError as error:
            self._link.log(f"{pose or 'the photograph'} cannot be shown: {error}")

    def write(self, kind: str, rgb: "np.ndarray") -> Path:
        """An RGB or RGBA picture of 8 bits as a new file.

        Raises:
            SessionError: the disk refuses.
        """
        import cv2
        import numpy as np

        bgr = np.concatenate([rgb[..., 2::-1], rgb[..., 3:]], axis=-1)
        coded = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
        with self._lock:
            path = self._folder / f"{kind}-{next(self._numbers):06d}.png"
            there = self._there[kind]
            there.append(path)
            old = there.popleft() if len(there) > KEPT else None
        with told(path):
            path.write_bytes(coded.tobytes())
            if old is not None:
                old.unlink(missing_ok=True)
        return path

    def _facts(self, files: Sequence[Path], flip: int | None) -> dict[str, Any]:
        """
        Raises:
            RawError: they cannot be read.
            SessionError: the disk refuses.
        """
        # These take a second to load, which the devices need not wait for.
        from engine.capture_checks import shot_preview
        from engine.capture_checks.display_image import PER_EV, WHITE_BIN, picture
        from engine.importing import RAW_SUFFIXES
        from engine.orientation import turn_picture

        if not all(file.suffix.lower() in RAW_SUFFIXES for file in files):
            return self._developed(files[len(files) // 2])
        mosaics = shot_preview.read(files)
        made = picture(mosaics, EDGE_PX)
        flip = mosaics[0].facts.orientation if flip is None else flip
        counts = {name: channel.tolist() for name, channel in zip("rgb", made.histogram, strict=True)}
        return {
            "png": str(self.write("picture", turn_picture(made.rgb, flip))),
            "clip_png": str(self.write("clip", turn_picture(made.overlay, flip))),
            "clipped": made.clipped,
            "clipped_here": made.clipped_here,
            "dark": made.dark,
            "histogram": {**counts, "white": WHITE_BIN, "per_ev": PER_EV},
            "shutter_s": made.shutter_s,
        }

    def _developed(self, file: Path) -> dict[str, Any]:
        """A JPEG or the like as it is, upright; how much light its pixels stand for nobody knows."""
        import cv2

        image = cv2.imread(str(file), cv2.IMREAD_COLOR_RGB)
        if image is None:
            raise RawError(f"{file}: cannot be read as a picture; look at it in another program")
        share = min(1.0, EDGE_PX / max(image.shape))
        small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        clipped = float((image.max(axis=-1) >= CLIPPED_CODE).mean())
        return {
            "png": str(self.write("picture", small)),
            "clip_png": None,
            "clipped": clipped,
            "clipped_here": clipped,
            "dark": float((image.max(axis=-1) <= DARK_CODE).mean()),
            "histogram": None,
            "shutter_s": None,
        }
