"""Shots put aside, never deleted: their poses are taken again by the capture that goes on.

It loads none of what captures need: the window uses it.
"""

from pathlib import Path

from app.capture import order as capture_order
from engine.errors import SessionError
from engine.io import session as sessions
from engine.io.session import Session


def take_again(session: Session, shot: str) -> Path:
    """Put a shot (its folder's name) aside, so that a capture that goes on takes its pose again; returns where it is kept.

    Raises:
        BusyError: another process works on the session.
        SessionError: the disk refuses.
    """
    with sessions.lock(session):
        return put_aside(session, session.folder / "shots" / shot, "again")


def bring_back(session: Session, kept: Path, shot: str) -> None:
    """Undo `take_again`.

    Raises:
        BusyError: another process works on the session.
        SessionError: the pose has been taken again, or the disk refuses.
    """
    name = sessions.read_shot(kept / "shot.json").name
    with sessions.lock(session):
        if any(one.name == name for one in sessions.shots(session)):
            raise SessionError(
                f"{session.folder}: {name} has been taken again; the earlier one stays in {kept}"
            )
        place = session.folder / "shots" / shot
        with sessions.told(place):
            kept.rename(place)
            sessions.sync(place.parent)


def put_aside(session: Session, folder: Path, where: str) -> Path:
    """Move a shot's folder to `capture/WHERE`; the session's lock is held."""
    aside = capture_order.folder(session.folder) / where
    with sessions.told(aside):
        aside.mkdir(exist_ok=True)
        number = sum(1 for _ in aside.iterdir())
        kept = folder.rename(aside / f"{folder.name}-{number}")
        sessions.sync(folder.parent)
    return kept
