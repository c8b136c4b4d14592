"""Which light the object received was photographed, which only clipped, and which is a guess; in a worker child.

Seen from the object's middle in the session's middle view (as in the exported panorama), under the brightness that
the surface's shading settled. "Seen" is the share of a direction whose Gaussians lie on some view's background;
"clipped" where every view that shows it is saturated there in all exposures: its radiance is then inferred from the
object. Panoramas as in `engine.types.Panorama`; kept as `derived/coverage/FINGERPRINT/coverage.npz`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.inspect.rerendering import find, open_run, upright
from app.relight.files import keep
from app.relight.lights import coverage_file
from engine.orientation import turned
from engine.pipeline import artifacts
from engine.pipeline.stage_functions import middle_view, panorama
from engine.types import Masks

if TYPE_CHECKING:
    from app.work.worker import Link

ROWS = 128


def serve(request: Mapping[str, Any], link: "Link") -> Mapping[str, Any]:
    """Task "coverage": {session, fingerprint}."""
    run = find(Path(request["session"]), request["fingerprint"])
    to = coverage_file(run)
    if to.is_file():
        return {"file": str(to)}
    progress = link.progress()
    progress.step(0.0, "reading the light")
    solved = upright(open_run(run))
    masks = turned(artifacts.load(run.folder("segment"), "masks", Masks), run.flip)
    view = middle_view(solved.poses)
    progress.step(0.2, "the light at the object")
    light, clipped = panorama(solved.surface, solved.emitters, solved.poses, view, solved.frames, masks, ROWS)
    arrays = {
        "radiance": light.radiance,
        "seen": light.seen,
        "clipped": clipped,
        "view": np.array(light.view),
    }
    keep(to, arrays)
    return {"file": str(to)}
