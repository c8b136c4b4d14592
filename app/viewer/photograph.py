"""The photograph of one view as a small picture, read straight from the session's results."""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from app.inspect import falsecolour
from app.viewer.reading import stages_of
from engine.errors import SessionError
from engine.io import session as sessions
from engine.orientation import turn_picture

LONGEST_PX = 480


def photograph(folder: Path, view: int) -> UInt8[np.ndarray, "h w 4"]:
    """Upright, exposed for its brighter parts, in falsecolour's byte order.

    Raises:
        SessionError: the session has no photographs merged, or not this one.
    """
    hdr = stages_of(folder).get("hdr")
    path = hdr / "frames.radiance.npy" if hdr is not None else None
    if path is None or not path.is_file():
        raise SessionError(f"{folder}: the photographs are not merged yet; process the session first")
    frames = np.load(path, mmap_mode="r", allow_pickle=False)
    if not 0 <= view < len(frames):
        raise SessionError(f"{path}: holds {len(frames)} views, not number {view}; process the session again")
    every = max(-(-max(frames.shape[1:3]) // LONGEST_PX), 1)
    flip = sessions.open_session(folder).orientation
    picture = turn_picture(np.asarray(frames[view, ::every, ::every], np.float32), flip)
    white = float(np.percentile(picture.max(-1), 98)) or 1.0
    return falsecolour.radiance(picture, white)
