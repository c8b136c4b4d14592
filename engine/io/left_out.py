"""Photographs that a person leaves out of everything computed: `edits/left_out.json`, the names of the views, sorted.

Stage *hdr* merges them all the same, so that leaving one out, or putting it back, is cheap; stage *segment* does not look
at them, and stage *poses* gives them no pose, which keeps them out of all that follows.
"""

import json
from collections.abc import Collection, Sequence

from engine.errors import SessionError, reason
from engine.io.session import Session, drop_edit, lock, write_edit

FILE = "left_out.json"


def read(session: Session) -> frozenset[str]:
    """The names of the views left out; none where nobody left any out.

    Raises:
        SessionError: the file is damaged.
    """
    path = session.folder / "edits" / FILE
    try:
        names = json.loads(path.read_bytes())
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError("not a list of names")
    except FileNotFoundError:
        return frozenset()
    except (OSError, ValueError) as error:
        raise SessionError(
            f"{path}: cannot be read ({reason(error)}); remove it and leave the photographs out again"
        ) from error
    return frozenset(names)


def write(session: Session, names: Collection[str], views: Collection[str]) -> None:
    """Leave exactly these of the session's `views` out; none puts all back, as if none had ever been left out.

    Raises:
        SessionError: it would leave none in, or the disk refuses.
        BusyError: another process works on the session, and its inputs must not change.
    """
    if views and set(names) >= set(views):
        raise SessionError(f"{session.folder}: all {len(views)} photographs would be left out; keep some")
    with lock(session):
        if names:
            write_edit(session, FILE, json.dumps(sorted(names)).encode())
        else:
            drop_edit(session, FILE)


def kept(session: Session, names: Sequence[str]) -> list[int]:
    """Which of the views, by index, are to be used.

    Raises:
        SessionError: the file is damaged, or names a view that there is not.
    """
    out = read(session)
    if unknown := out.difference(names):
        raise SessionError(
            f"{session.folder / 'edits' / FILE}: there is no photograph {min(unknown)}; remove the file and leave"
            " the photographs out again"
        )
    return [index for index, name in enumerate(names) if name not in out]
