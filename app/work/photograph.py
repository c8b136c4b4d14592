"""One photograph of a session as a person judges it: developed for the eye, what is clipped laid over it, how sharp it is.

Nothing needs to be computed of the session before. Pictures stand upright, as `to`.png and, what is clipped, `to`.clip.png.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from engine.io.session import Session, Shot


def look(content: Mapping[str, Any]) -> dict[str, Any]:
    """A small picture, and what the pixels tell: in `to`.json, written last, and as the answer.

    Question: session, shot (its folder's name), to, edge_px (at most). Facts: blur_px (None where nothing tells), clipped
    and dark (shares, in every exposure).
    """
    from engine.io import session as sessions

    session, shot, to = _asked(content)
    if session.kind == "linear":
        from engine.capture_checks.shot_preview import glance_linear
        from engine.io.images import read_radiance

        radiance = read_radiance(shot.files[0])
        seen = glance_linear(shot.name, radiance)
        clipped, dark = seen.share_clipped, seen.share_dark
        pictures = _linear(radiance, int(content["edge_px"]))
    else:
        from engine.capture_checks.display_image import picture
        from engine.capture_checks.shot_preview import learn, preview, read

        mosaics = read(shot.files)
        sensor = learn(mosaics)
        seen = preview(shot.name, mosaics, sensor)
        made = picture(mosaics, int(content["edge_px"]), sensor=sensor)
        clipped, dark, pictures = made.clipped, made.dark, (made.rgb, made.overlay)
    from engine.capture_checks.sharpness import blur_px

    blur = blur_px(seen)
    facts = {"blur_px": None if math.isnan(blur) else blur, "clipped": clipped, "dark": dark}
    _write(session, to, *pictures)
    sessions.write_atomic(to.with_name(to.name + ".json"), json.dumps(facts).encode())
    return facts


def show(content: Mapping[str, Any]) -> dict[str, Any]:
    """A large picture of one exposure.

    Question: as `look`'s, and exposure (of the bracket, shortest first; None: the middle one).
    """
    session, shot, to = _asked(content)
    if session.kind == "linear":
        from engine.io.images import read_radiance

        pictures = _linear(read_radiance(shot.files[0]), int(content["edge_px"]))
    else:
        from engine.capture_checks.display_image import picture
        from engine.capture_checks.shot_preview import read

        made = picture(read(shot.files), int(content["edge_px"]), content.get("exposure"))
        pictures = made.rgb, made.overlay
    _write(session, to, *pictures)
    return {"picture": f"{to}.png"}


def _asked(content: Mapping[str, Any]) -> tuple["Session", "Shot", Path]:
    from engine.io import session as sessions

    session = sessions.open_session(Path(content["session"]))
    shot = sessions.read_shot(session.folder / "shots" / content["shot"] / "shot.json")
    return session, shot, Path(content["to"])


def _linear(radiance: "np.ndarray", edge_px: int) -> tuple["np.ndarray", "np.ndarray"]:
    """Eight bits of a linear image, its own median as mid grey; and what its format could not hold."""
    import numpy as np

    from engine.capture_checks.display_image import LOST_RGB
    from engine.color import luminance
    from engine.hdr.develop import averaged
    from engine.hdr.merge import HALF_MAX
    from engine.io.images import tone_map

    small = averaged(radiance, max(1, math.ceil(max(radiance.shape[:2]) / edge_px)))
    rgb = tone_map(small, max(float(np.median(luminance(small))), 1e-6))
    clip = np.zeros((*rgb.shape[:2], 4), np.uint8)
    clip[np.any(small >= HALF_MAX, axis=-1)] = (*LOST_RGB, 255)
    return rgb, clip


def _write(session: "Session", to: Path, rgb: "np.ndarray", clip: "np.ndarray") -> None:
    import cv2
    import numpy as np

    from engine.io import session as sessions
    from engine.orientation import turn_picture

    with sessions.told(to):
        to.parent.mkdir(parents=True, exist_ok=True)
    for suffix, picture in ((".png", rgb), (".clip.png", clip)):
        upright = turn_picture(picture, session.orientation)
        bgr = np.concatenate([upright[..., 2::-1], upright[..., 3:]], axis=-1)
        coded = cv2.imencode(".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
        sessions.write_atomic(to.with_name(to.name + suffix), coded.tobytes())
