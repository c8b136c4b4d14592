"""Where a capture lies in its session, how the session appears, and what of it is finished.

`capture/order.json` (written once), `capture/journal.jsonl`, `capture/incoming/` (downloads under way, wiped),
`capture/damaged/` (shots whose bytes changed, put aside), `capture/again/` (shots that a person wants taken again). Finished
is what the session's shots say.
"""

import shutil
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.capture import frames as capture_frames
from app.capture import order as capture_order
from app.capture.aside import put_aside
from app.capture.frames import Checked
from app.capture.order import CaptureError, Order, Pose
from engine.errors import SessionError
from engine.io import session as sessions
from engine.io.session import Session, Shot
from hardware.interfaces import Angles
from hardware.plan import fitted
from hardware.rig import Rig


def incoming(session: Path) -> Path:
    return capture_order.folder(session) / "incoming"


def journal(session: Path) -> Path:
    return capture_order.folder(session) / "journal.jsonl"


def check_free_place(session: Path) -> None:
    """
    Raises:
        CaptureError: a new capture would go over something that is there.
    """
    if session.exists() and (not session.is_dir() or any(session.iterdir())):
        resumes = f", or go on with it: `roomlight capture --resume {session}`"
        raise CaptureError(
            f"{session}: exists already; choose another name"
            f"{resumes if (capture_order.folder(session) / 'order.json').is_file() else ''}"
        )


def check_devices(order: Order, rig: Rig) -> None:
    """
    Raises:
        LimitError: a pose lies beyond what the rig can reach; nothing was sent.
        CaptureError: the camera does not write RAW.
    """
    fitted(capture_order.plan_of(order.poses), rig.motion.features)
    camera = rig.camera.features
    if camera.suffix and not order.any_format:
        capture_frames.check_suffix(camera.suffix, camera.model)


def create(session: Path, order: Order) -> Session:
    """A new, empty session with its order; it appears whole, by one rename.

    Raises:
        CaptureError: something is there already.
        SessionError: the disk refuses.
    """
    check_free_place(session)
    partial = session.with_name(f".{session.name}.partial")
    rig = {"kind": order.kind, "geometry": None if order.geometry is None else asdict(order.geometry)}
    with sessions.told(session):
        shutil.rmtree(partial, ignore_errors=True)
        session.parent.mkdir(parents=True, exist_ok=True)
    try:
        sessions.create(partial, "raw", {"model": None}, rig if order.kind != "handheld" else None)
        capture_order.write(partial, order)
        with sessions.told(session):
            if session.exists():
                session.rmdir()
            partial.rename(session)
            sessions.sync(session.parent)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return sessions.open_session(session)


def with_camera(session: Session, camera: Mapping[str, Any]) -> Session:
    """The session with what its first photograph told of the camera; later ones must tell the same, but for their
    orientation: the first one's is the session's.

    Raises:
        CaptureError: another camera, or another size.
    """
    fixed = {name: value for name, value in camera.items() if name != "orientation"}
    known = {name: session.facts["camera"].get(name) for name in fixed}
    if known == fixed:
        return session
    if any(value is not None for value in known.values()):
        told = [f"{facts['model']} at {facts['width']} x {facts['height']}" for facts in (camera, known)]
        raise CaptureError(
            f"{session.folder}: now the camera is {told[0]}, earlier poses were taken with {told[1]}; use that camera"
            " and size again, or begin a new session"
        )
    return sessions.describe(session, camera)


def keep(
    session: Session, order: Order, pose: Pose, angles: Angles | None, checked: Sequence[Checked]
) -> Shot:
    """The pose's bracket as a shot of the session; its files are moved there.

    Args:
        angles: where the rig said it stood; None: nobody can tell.

    Raises:
        SessionError: the disk refuses; there is no such shot then.
    """
    rig = None
    if angles is not None:
        pan_deg, tilt_deg = round(angles.pan_deg, 4), round(angles.tilt_deg, 4)
        rig = {"kind": order.kind, "pan_deg": pan_deg, "tilt_deg": tilt_deg}
    return sessions.add_shot(
        session,
        pose.name,
        [item.frame.path for item in checked],
        [item.facts for item in checked],
        rig,
        names=[item.name for item in checked],
        taken_over=[item.frame.sha256 for item in checked],
    )


def sort_out(
    session: Session, names: Collection[str], telling: Callable[[str], None]
) -> tuple[dict[str, Shot], list[tuple[str, str]]]:
    """(finished shots by pose, damaged ones as (name, reason)) of a session whose lock is held.

    Half-written shots and downloads are wiped; shots whose bytes changed are put aside, never deleted.

    Args:
        telling: hears the name of each shot before it is read; may raise to give up.

    Raises:
        SessionError: the disk refuses.
    """
    shutil.rmtree(incoming(session.folder), ignore_errors=True)
    finished: dict[str, Shot] = {}
    damaged: list[tuple[str, str]] = []
    for folder in sorted((session.folder / "shots").iterdir()):
        if not (folder / "shot.json").exists():
            shutil.rmtree(folder, ignore_errors=True)
            continue
        telling(folder.name)
        try:
            shot = sessions.read_shot(folder / "shot.json")
            sessions.verify(shot)
            if shot.name in finished:
                raise SessionError(
                    f"{folder}: is {shot.name} once more, which {finished[shot.name].folder} is"
                )
        except SessionError as error:
            damaged.append((folder.name, str(error)))
            put_aside(session, folder, "damaged")
        else:
            finished[shot.name] = shot
    return {name: shot for name, shot in finished.items() if name in names}, damaged
