"""The session folder: the one place that knows where photographs, hand edits and results lie on disk.

Layout: `session.json` (schema, facts), `params.toml` (what the user asked),
`shots/0007/` (files never changed after `shot.json`, which is written last and holds their sha256), `edits/`
(given masks, poses, strokes), `stages/<stage>/<fingerprint>/`, `exports/`, `run.lock`. Everything that must
not be half there is written beside its place, synced, and renamed.
"""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from engine import conventions
from engine.errors import BusyError, SessionError, reason

SCHEMA = 1

_REMEDY = {
    errno.ENOSPC: "the disk is full; free some space and run again",
    errno.EDQUOT: "your disk quota is used up; free some space and run again",
    errno.EACCES: "no permission to write here; change the folder's permissions or choose another folder",
    errno.EPERM: "writing here is not permitted; change the folder's permissions or choose another folder",
    errno.EROFS: "the disk is read-only; make it writable or choose another folder",
    errno.EFBIG: "the file grew over the size this disk or process allows; choose another disk",
    errno.ENOENT: "no such file or folder, or the drive takes no new ones; check the path and that its drive is there",
    errno.EISDIR: "is a folder; name a file",
    errno.EEXIST: "exists already; choose another name or remove it first",
    errno.ENOTEMPTY: "holds something already; choose another name or remove it first",
    errno.ENOTDIR: "a part of this path is a file and no folder; check the path",
    errno.ENAMETOOLONG: "the name is longer than this disk allows; choose a shorter one",
    errno.EIO: "the disk reported an input/output error; check the disk and copy the session elsewhere",
}


@dataclass(frozen=True, slots=True)
class Session:
    """An opened session; `facts` is `session.json` as it was read."""

    folder: Path
    facts: Mapping[str, Any]

    @property
    def kind(self) -> str:
        """ "raw" (bracketed mosaics) or "linear" (one radiance image per view)."""
        return self.facts["kind"]

    @property
    def orientation(self) -> int:
        """The flip (`engine/orientation.py`) that stands all photographs upright; 0 where no file told."""
        return self.facts["camera"].get("orientation", 0)


@dataclass(frozen=True, slots=True)
class Shot:
    """One view: its files in the session and what is known of them."""

    name: str  # what the person knows the view by, e.g. IMG_0412; names are unique in a session
    folder: Path
    files: tuple[Path, ...]
    sha256: tuple[str, ...]
    exposures: tuple[Mapping[str, Any], ...]  # per file: source, shutter_s, iso, aperture, time, ...
    rig: Mapping[str, Any] | None  # {"kind", "pan_deg", "tilt_deg"} as logged by the rig

    @property
    def fingerprint(self) -> str:
        return hashlib.sha256(json.dumps([self.name, *self.sha256]).encode()).hexdigest()[:16]


@contextlib.contextmanager
def told(path: Path) -> Iterator[None]:
    """Turn the system's refusals to write into an error that names file, cause and remedy."""
    try:
        yield
    except OSError as error:
        remedy = _REMEDY.get(error.errno or _full_disk(path))
        if remedy is None:
            raise
        # Of a rename or a copy, the second name is the one that was asked for; a file under way is nobody's.
        named = [name for name in (error.filename2, error.filename) if isinstance(name, str)]
        asked = [name for name in named[:1] if not name.endswith(".partial")]
        raise SessionError(f"{asked[0] if asked else path}: {remedy}") from error


def _full_disk(path: Path) -> int:
    """ENOSPC when the disk is full: libraries that write in C report a short write without its reason."""
    return errno.ENOSPC if shutil.disk_usage(nearest_existing(path)).free < 1 << 20 else 0


def nearest_existing(path: Path) -> Path:
    """The path, or of the folders that it would lie in the first that is there."""
    return next(place for place in (path, *path.absolute().parents) if place.exists())


def sync(path: Path) -> None:
    """Make a file's bytes, or names just created or renamed in a folder, survive a power cut."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_atomic(path: Path, content: bytes) -> None:
    """Replace `path` by `content`: a reader sees the old bytes or the new, never a mixture."""
    beside = path.with_name(f".{path.name}.partial")
    with told(path):
        try:
            with beside.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)
            sync(path.parent)
        except OSError:
            with contextlib.suppress(OSError):
                beside.unlink(missing_ok=True)
            raise


def file_sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def create(
    folder: Path,
    kind: str,
    camera: Mapping[str, Any],
    rig: Mapping[str, Any] | None = None,
    notes: Sequence[str] = (),
) -> Session:
    """Make a new, empty session.

    Args:
        kind: "raw" or "linear".
        camera: facts such as model, width, height, and orientation where it is not 0.
        rig: {"kind", "geometry"} in the frame of the camera at pan = tilt = 0, metres; None when handheld.
        notes: what a person should know of how it was made, in sentences.

    Raises:
        SessionError: something is there already, or the disk refuses.
    """
    with told(folder):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise SessionError(f"{folder}: exists already; choose another name or remove it first")
        for part in ("shots", "edits", "stages", "exports"):
            (folder / part).mkdir(parents=True, exist_ok=True)
    facts = {"schema": SCHEMA, "kind": kind, "camera": dict(camera), "rig": dict(rig) if rig else None}
    facts |= {"notes": list(notes)} if notes else {}
    write_atomic(folder / "session.json", json.dumps(facts, indent=1).encode())
    return Session(folder, facts)


def describe(session: Session, camera: Mapping[str, Any]) -> Session:
    """The session with what its first photographs told of the camera, as in `create`."""
    facts = {**session.facts, "camera": dict(camera)}
    write_atomic(session.folder / "session.json", json.dumps(facts, indent=1).encode())
    return Session(session.folder, facts)


def open_session(folder: Path) -> Session:
    """Read a session.

    Raises:
        SessionError: not a session, damaged, or written by a newer version.
    """
    path = folder / "session.json"
    try:
        facts = json.loads(path.read_bytes())
        schema = facts["schema"]
    except (FileNotFoundError, NotADirectoryError):
        raise SessionError(
            f"{folder}: not a session (no session.json); make one with `roomlight import`"
        ) from None
    except PermissionError:
        raise SessionError(f"{path}: no permission to read it; change the file's permissions") from None
    except (ValueError, KeyError, TypeError) as error:
        raise SessionError(
            f"{path}: damaged ({reason(error)}); restore it from a copy or import the photographs again"
        ) from None
    if not isinstance(schema, int) or schema > SCHEMA:
        raise SessionError(
            f"{path}: has schema {schema}, this roomlight reads up to {SCHEMA}; install a newer roomlight"
        )
    if facts.get("kind") not in ("raw", "linear"):
        raise SessionError(f"{path}: damaged (kind {facts.get('kind')!r}); import the photographs again")
    camera, sentences = facts.get("camera"), facts.get("notes", [])
    whole = isinstance(camera, dict) and camera.get("orientation", 0) in tuple(conventions.QUARTERS)
    if not (whole and isinstance(sentences, list) and all(isinstance(one, str) for one in sentences)):
        raise SessionError(
            f"{path}: damaged (camera {camera!r}, notes {sentences!r}); restore it from a copy or import the photographs"
            " again"
        )
    return Session(folder, facts)


def add_shot(
    session: Session,
    name: str,
    files: Sequence[Path],
    exposures: Sequence[Mapping[str, Any]],
    rig: Mapping[str, Any] | None = None,
    names: Sequence[str] | None = None,
    taken_over: Sequence[str] | None = None,
) -> Shot:
    """Copy one view's files into the session; it exists once its `shot.json` does.

    A folder without `shot.json`, left by a crash, is overwritten.

    Args:
        names: what the files are called in the session; None: e0, e1, ... or radiance, with their suffix.
        taken_over: the files lie on the session's disk, have just been found to have these sha256, and are moved
            instead of copied; when that fails they are gone.

    Raises:
        SessionError: the disk refuses; the session stays as it was.
    """
    number = 1 + max((int(p.parent.name) for p in (session.folder / "shots").glob("*/shot.json")), default=-1)
    folder = session.folder / "shots" / f"{number:04d}"
    if names is None:
        stems = ["radiance" if session.kind == "linear" else f"e{index}" for index in range(len(files))]
        names = [stem + source.suffix.lower() for stem, source in zip(stems, files, strict=True)]
    entries = []
    with told(folder):
        shutil.rmtree(folder, ignore_errors=True)
        try:
            folder.mkdir()
            known = taken_over or [""] * len(files)
            for source, called, facts, sha256 in zip(files, names, exposures, known, strict=True):
                target = folder / called
                if sha256:
                    _move(source, target)
                digest = sha256 or _copy(source, target)
                entry = {"name": target.name, "sha256": digest, "bytes": target.stat().st_size}
                entries.append({**entry, "source": source.name, **facts})
            sync(folder)
            sync(folder.parent)
        except OSError:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    shot = {"name": name, "files": entries, "rig": dict(rig) if rig else None}
    write_atomic(folder / "shot.json", json.dumps(shot, indent=1).encode())
    return read_shot(folder / "shot.json")


def _copy(source: Path, target: Path) -> str:
    """Copy bytes, return their sha256; what is there already stays."""
    with source.open("rb") as reader, target.open("xb") as writer:
        sha256 = copy_hashed(reader.read, writer.write)
        writer.flush()
        os.fsync(writer.fileno())
    return sha256


def copy_hashed(
    read: Callable[[int], bytes],
    write: Callable[[bytes], int],
    copied: Callable[[int], None] = lambda count: None,
) -> str:
    """Copy bytes, return their sha256; `copied` hears of every block's length."""
    digest = hashlib.sha256()
    while block := read(1 << 22):
        digest.update(block)
        write(block)
        copied(len(block))
    return digest.hexdigest()


def _move(source: Path, target: Path) -> None:
    """Rename and sync; what is there already stays."""
    if target.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
    source.rename(target)
    with target.open("rb") as file:
        os.fsync(file.fileno())


def shots(session: Session) -> tuple[Shot, ...]:
    """All finished shots in the order they were taken.

    Raises:
        SessionError: a `shot.json` is damaged, or a file it names is gone or of another size.
    """
    paths = sorted((session.folder / "shots").glob("*/shot.json"))
    return tuple(read_shot(path, not session.facts.get("without_raw", False)) for path in paths)


def read_shot(path: Path, there: bool = True) -> Shot:
    """The shot that a `shot.json` describes; its files are not looked for where they are known not to be `there`.

    Raises:
        SessionError: as `shots`.
    """
    try:
        shot = json.loads(path.read_bytes())
        entries = shot["files"]
        files = tuple(path.parent / entry["name"] for entry in entries)
        sizes = [entry["bytes"] for entry in entries]
        result = Shot(
            shot["name"], path.parent, files, tuple(entry["sha256"] for entry in entries), tuple(entries),
            shot["rig"],
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SessionError(
            f"{path}: damaged ({reason(error)}); restore it or import the photographs again"
        ) from None
    for file, size in zip(files, sizes, strict=True) if there else ():
        if not file.is_file():
            raise SessionError(f"{file}: is missing; shots never change, so restore it from your copy")
        if file.stat().st_size != size:
            raise SessionError(
                f"{file}: has {file.stat().st_size} bytes, {size} were taken; restore it from your copy"
            )
    return result


def notes(session: Session) -> tuple[str, ...]:
    """What a person should know of how the session was made, in sentences."""
    flips = [
        facts.get("orientation", session.orientation) for shot in shots(session) for facts in shot.exposures
    ]
    return (*session.facts.get("notes", ()), *conventions.differing(flips, session.orientation))


def verify(shot: Shot) -> None:
    """Check a shot's files against the hashes taken when they arrived.

    Raises:
        SessionError: a file's bytes changed, or it is not there.
    """
    for file, sha256 in zip(shot.files, shot.sha256, strict=True):
        if not file.is_file():
            raise SessionError(
                f"{file}: is not here, the session was packed without its photographs; unpack a bundle that holds them"
            )
        if file_sha256(file) != sha256:
            raise SessionError(f"{file}: its bytes changed since it was taken; restore it from your copy")


def edits(session: Session) -> dict[str, str]:
    """sha256[:16] of every hand-made or given input, by its name in `edits/`."""
    folder = session.folder / "edits"
    files = sorted(path for path in folder.glob("*") if path.is_file() and not path.name.startswith("."))
    return {path.name: file_sha256(path)[:16] for path in files}


def write_edit(session: Session, name: str, content: bytes) -> None:
    """Put a given or hand-made input (mask, strokes, poses) into the session."""
    with told(session.folder / "edits"):
        (session.folder / "edits").mkdir(exist_ok=True)
    write_atomic(session.folder / "edits" / name, content)


def drop_edit(session: Session, name: str) -> None:
    """Take a hand-made input out of the session; nothing where there is none."""
    path = session.folder / "edits" / name
    with told(path):
        path.unlink(missing_ok=True)


def read_params(session: Session) -> dict[str, Any]:
    """What the user asked: `params.toml`, empty when there is none."""
    path = session.folder / "params.toml"
    try:
        return tomllib.loads(path.read_text())
    except FileNotFoundError:
        return {}
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SessionError(f"{path}: not valid TOML ({error}); correct or remove it") from None


def write_params(session: Session, params: Mapping[str, Any]) -> None:
    write_atomic(session.folder / "params.toml", tomli_w.dumps(dict(params)).encode())


@contextlib.contextmanager
def lock(session: Session) -> Iterator[None]:
    """Hold the session for writing; the system lets go of it when this process ends, however it ends.

    Raises:
        BusyError: another process holds it.
    """
    path = session.folder / "run.lock"
    with told(path):
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, 32).decode(errors="replace").strip() or "unknown"
            raise BusyError(
                f"{session.folder}: process {holder} is working on this session; wait for it or stop it first"
            ) from None
        # A full disk may refuse the pid; the lock itself needs no space and still holds.
        with contextlib.suppress(OSError):
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(handle)
