"""A capture desk whose virtual rig has a loose plug: while the file `out` of the request is there, its cable is out.

`python -m tests.end_to_end.loose_desk desk '{"out": PATH}'` is the worker `app.work.worker desk {}` but for that.
Its captures wait hardly at all before they try again.
"""

import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.capture.desk.serving import Desk
from app.capture.recovery import Patience
from app.work import worker
from hardware import find
from hardware.errors import AbsentError
from hardware.rig import Rig
from hardware.virtual.rig import VirtualRig

LOOK_S = 0.02
HASTY = Patience(wait_s=0.01, poll_s=0.01)


def serve(request: Mapping[str, Any], link: worker.Link) -> Mapping[str, Any]:
    """Task "desk" of this module."""
    out = Path(request["out"])

    def opened(rig_url: str, camera_url: str, **words: Any) -> Rig:
        if out.exists():
            raise AbsentError(f"{rig_url}: there is no such port; plug the rig in")
        rig = find.open_rig(rig_url, camera_url, **words)
        assert isinstance(rig.motion, VirtualRig)
        threading.Thread(target=pull_when, args=(out, rig.motion), name="plug", daemon=True).start()
        return rig

    with tempfile.TemporaryDirectory(prefix="roomlight-desk-") as folder:
        Desk(link, Path(folder), opened, HASTY).serve()
    return {}


def pull_when(out: Path, motion: VirtualRig) -> None:
    """Wait for the file, and pull the cable."""
    while not out.exists():
        time.sleep(LOOK_S)
    motion.pull()


if __name__ == "__main__":
    worker.TASKS["desk"] = "__main__:serve"
    sys.exit(worker.main(sys.argv[1:]))
