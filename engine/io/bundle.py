"""A session as one file to hand over or archive: a ZIP (PKWARE APPNOTE 6.3, stored, not compressed) with a list of its files' sha256.

What is in it is what makes a session: photographs, edits, finished stages, exports; not what a run leaves half done or what may be
made again at any time (`derived/`). The same session gives the same bytes: names in order, one date, no compression. Nothing
outside the session is read or written: paths are relative and without `..`, links point inside.
"""

import contextlib
import json
import os
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from engine.errors import SessionError
from engine.io.session import Session, copy_hashed, lock, open_session, told, write_atomic
from engine.progress import Progress

LIST = "bundle.json"
SCHEMA = 1
FIRST = (1980, 1, 1, 0, 0, 0)  # the earliest date that a ZIP can say
TOPS = ("session.json", "params.toml", "shots", "edits", "stages", "exports")


def pack(session: Session, to: Path, with_raw: bool, progress: Progress) -> int:
    """Write the bundle `to`; how many files are in it. Without RAW files finished stages stay what they are, but none before them runs again.

    Raises:
        SessionError: `to` exists, the disk refuses, or a link of the session leads out of it.
        BusyError: somebody works on the session.
    """
    if to.exists():
        raise SessionError(f"{to}: exists already; choose another name or remove it first")
    partial = to.with_name(f".{to.name}.{os.getpid()}.partial")
    with lock(session), told(to):
        files, links = _contents(session.folder, with_raw)
        copied = _counter(sum(path.stat().st_size for path in files.values()), progress)
        hashes = {}
        try:
            with zipfile.ZipFile(partial, "x", zipfile.ZIP_STORED) as bundle:
                for name, path in files.items():
                    with path.open("rb") as source, bundle.open(_entry(name, path), "w") as target:
                        hashes[name] = copy_hashed(source.read, target.write, copied)
                listed = {"schema": SCHEMA, "with_raw": with_raw, "files": hashes, "links": links}
                bundle.writestr(_entry(LIST), json.dumps(listed, sort_keys=True, indent=1) + "\n")
            with partial.open("rb") as file:
                os.fsync(file.fileno())
            partial.rename(to)
        finally:
            partial.unlink(missing_ok=True)
    return len(files)


def unpack(bundle: Path, to: Path, progress: Progress) -> Session:
    """Make the session `to` of a bundle; it appears whole, every file's hash compared, or not at all.

    Raises:
        SessionError: `to` exists, the file is no bundle, damaged, of a newer version, or holds what would lie outside the session.
    """
    if to.exists():
        raise SessionError(f"{to}: exists already; choose another name or remove it first")
    with told(to), contextlib.ExitStack() as undo:
        to.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{to.name}.", suffix=".partial", dir=to.parent))
        undo.callback(shutil.rmtree, scratch, ignore_errors=True)
        with _opened(bundle) as archive:
            listed = _listed(bundle, archive)
            _extract(bundle, archive, listed, scratch, progress)
        for folder in ("shots", "edits"):
            (scratch / folder).mkdir(exist_ok=True)
        made = open_session(scratch)
        if not listed["with_raw"]:
            write_atomic(
                scratch / "session.json", json.dumps({**made.facts, "without_raw": True}, indent=1).encode()
            )
        scratch.chmod(0o755)  # a scratch folder is its owner's alone
        scratch.rename(to)
    return open_session(to)


def _counter(total: int, progress: Progress) -> Callable[[int], None]:
    """What hears of copied bytes, of `total` in all, and tells the progress."""
    done = 0

    def copied(count: int) -> None:
        nonlocal done
        done += count
        progress.step(done / max(total, 1))

    return copied


def _contents(folder: Path, with_raw: bool) -> tuple[dict[str, Path], dict[str, str]]:
    """Name to path of every file, and to target of every link, in order."""
    files, links, root = {}, {}, folder.resolve()
    for top in TOPS:
        for path in sorted([folder / top, *(folder / top).rglob("*")]):
            name = path.relative_to(folder).as_posix()
            if any(
                part.startswith(".") or part.endswith(".partial") for part in path.relative_to(folder).parts
            ):
                continue
            if path.is_symlink():
                if not path.resolve().is_relative_to(root):
                    raise SessionError(
                        f"{path}: is a link that leads out of the session; replace it by what it links to"
                    )
                links[name] = os.readlink(path)
            elif path.is_file() and (with_raw or top != "shots" or path.name == "shot.json"):
                files[name] = path
    return files, links


def _entry(name: str, path: Path | None = None) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, FIRST)
    entry.external_attr = (stat.S_IFREG | 0o644) << 16
    entry.create_system = 3  # Unix, wherever it is written
    if path is not None:
        entry.file_size = path.stat().st_size  # tells zipfile whether it needs 64 bits
    return entry


@contextlib.contextmanager
def _opened(bundle: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(bundle) as archive:
            yield archive
    except FileNotFoundError as error:
        raise SessionError(f"{bundle}: no such file; check the path") from error
    except IsADirectoryError as error:
        raise SessionError(f"{bundle}: is a folder; name a bundle made with `roomlight pack`") from error
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError) as error:
        raise SessionError(
            f"{bundle}: no ZIP file, or damaged ({error}); copy it again from where it came from"
        ) from error


def _listed(bundle: Path, archive: zipfile.ZipFile) -> dict[str, Any]:
    """The bundle's list, after its names have been looked at."""
    names = archive.namelist()
    if LIST not in names:
        raise SessionError(
            f"{bundle}: holds no {LIST}: not made with `roomlight pack`; unpack it with another program"
        )
    try:
        listed = json.loads(archive.read(LIST))
        schema, files, links = listed["schema"], listed["files"], listed["links"]
        listed["with_raw"] = bool(listed["with_raw"])
        if schema > SCHEMA:
            raise SessionError(
                f"{bundle}: has schema {schema}, this roomlight reads up to {SCHEMA}; install a newer roomlight"
            )
        whole = sorted(names) == sorted([*files, LIST]) and all(isinstance(t, str) for t in links.values())
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise SessionError(
            f"{bundle}: its {LIST} is damaged ({error}); copy it again from where it came from"
        ) from error
    if not whole:
        raise SessionError(
            f"{bundle}: does not hold what its {LIST} says; copy it again from where it came from"
        )
    outside = [name for name in [*files, *links] if not _inside(name)]
    outside += [name for name, target in links.items() if not _leads_inside(name, target)]
    if outside:
        raise SessionError(
            f"{bundle}: {outside[0]!r} would lie outside the session; do not trust who made this file"
        )
    return listed


def _inside(name: str) -> bool:
    path = PurePosixPath(name)
    parts = path.parts
    return (
        bool(parts)
        and not path.is_absolute()
        and parts[0] in TOPS
        and not {"..", "."} & set(parts)
        and "\\" not in name
    )


def _leads_inside(name: str, target: str) -> bool:
    depth = len(PurePosixPath(name).parts) - 1
    for part in PurePosixPath(target).parts:
        depth += -1 if part == ".." else 1
        if depth < 0 or part == "/":
            return False
    return True


def _extract(
    bundle: Path, archive: zipfile.ZipFile, listed: dict[str, Any], to: Path, progress: Progress
) -> None:
    total = sum(entry.file_size for entry in archive.infolist())
    if total > (free := shutil.disk_usage(to).free):
        raise SessionError(
            f"{bundle}: needs {total / 1e9:.1f} GB and {to.parent} has {free / 1e9:.1f}; free some space or choose another disk"
        )
    copied = _counter(total, progress)
    for name, expected in listed["files"].items():
        path = to / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(name) as source, path.open("xb") as target:
            sha256 = copy_hashed(source.read, target.write, copied)
        if sha256 != expected:
            raise SessionError(
                f"{bundle}: {name} is damaged (sha256 differs); copy the bundle again from where it came from"
            )
    for name, target in listed["links"].items():  # last: no file is written through one
        (to / name).parent.mkdir(parents=True, exist_ok=True)
        (to / name).symlink_to(target)
