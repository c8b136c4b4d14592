"""Make a session of a folder of photographs, with poses and a mask where they are given.

RAW files of any kind LibRaw reads are grouped into brackets; linear EXR or Radiance HDR images are one view
each. Everything is read and checked before the session appears, and it appears by one rename: a fault leaves
nothing behind.
"""

import filecmp
import json
import math
import os
import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from engine import conventions
from engine.errors import ImportFault
from engine.hdr.brackets import Taken, group, natural, note
from engine.hdr.linear_input import check_values
from engine.hdr.params import HdrParams
from engine.io import png
from engine.io import session as sessions
from engine.io.images import read_radiance
from engine.io.poses import developed
from engine.io.poses.pose_files import GivenPoses, read_poses
from engine.io.raw import read_facts, read_mosaic
from engine.io.session import Session
from engine.io.suffixes import LINEAR_SUFFIXES, PICTURE_SUFFIXES, RAW_SUFFIXES
from engine.progress import Progress

FEWEST_VIEWS = 8
END_BYTES = 4096
MERGE = HdrParams()  # what its later merge would refuse is refused here


@dataclass(frozen=True, slots=True)
class View:
    """One view to be: its files and the facts of each."""

    name: str
    files: tuple[Path, ...]
    facts: tuple[dict[str, Any], ...]


@dataclass(frozen=True, slots=True)
class Survey:
    """What an import of a folder would begin with, told by names and headers alone."""

    kind: str  # "raw" or "linear"
    views: tuple[tuple[Path, ...], ...]  # files of each
    camera: dict[str, Any]  # model, width, height
    notes: tuple[str, ...]


def survey(folder: Path, bracket: int | None = None) -> Survey:
    """Look at a folder without decoding photographs.

    Raises:
        RoomlightError: what an import would refuse before it decodes any.
    """
    kind, files = find_photographs(folder)
    if kind == "raw":
        views, camera, notes = _raw_views(files, bracket, None)
    else:
        height, width = read_radiance(files[0]).shape[:2]
        views, notes = [View(_name(path, files), (path,), ({},)) for path in files], ()
        camera = {"model": None, "width": width, "height": height}
    _check_enough(folder, views, files, notes)
    return Survey(kind, tuple(view.files for view in views), camera, notes)


def make_session(
    folder: Path,
    to: Path,
    poses: Path | None = None,
    mask: Path | None = None,
    bracket: int | None = None,
    progress: Progress | None = None,
) -> Session:
    """Check everything in `folder`, then make the session `to`.

    Args:
        bracket: exposures a view; None finds out.

    Raises:
        RoomlightError: what does not fit, naming the file; no session is made.
    """
    progress = progress or Progress()
    with sessions.told(to):
        taken = to.exists() and (not to.is_dir() or any(to.iterdir()))
    if taken:
        raise ImportFault(f"{to}: exists already; choose another name for the session or remove it first")
    kind, files = find_photographs(folder)
    reading = progress.part(0.0, 0.6)
    if kind == "raw":
        views, camera, notes = _raw_views(files, bracket, reading)
    else:
        views, camera, notes = _linear_views(files, reading)
    _check_enough(folder, views, files, notes)
    size, flips = (camera["width"], camera["height"]), _flips(views)
    flip = conventions.common(flips)
    camera |= {"orientation": flip} if flip else {}
    given, painted = None, b""
    if poses is not None:
        pose_file = poses
        given, said = developed.poses(
            lambda chosen, shown: given_poses(pose_file, [views[i] for i in chosen], folder, shown),
            flips,
            size,
        )
        notes += said
    if mask is not None:
        on_sensor, said = developed.mask(mask, size, flip)
        painted = png.encode(on_sensor.astype(np.uint8) * 255) if flip else mask.read_bytes()
        notes += said
    partial = to.with_name(f".{to.name}.partial")
    with sessions.told(to):
        shutil.rmtree(partial, ignore_errors=True)
        to.parent.mkdir(parents=True, exist_ok=True)
    try:
        session = sessions.create(partial, kind, camera, notes=notes)
        for i, view in enumerate(views):
            progress.step(0.6 + 0.4 * i / len(views), f"copying {view.name}")
            sessions.add_shot(session, view.name, view.files, view.facts)
        if given is not None:
            sessions.write_edit(session, "poses.json", encode_poses(given, [view.name for view in views]))
        if painted:
            sessions.write_edit(session, "mask.png", painted)
        with sessions.told(to):
            if to.exists():
                to.rmdir()
            partial.rename(to)
            sessions.sync(to.parent)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    progress.step(1.0, f"{len(views)} views")
    return sessions.open_session(to)


def _check_enough(folder: Path, views: Sequence[View], files: Sequence[Path], notes: Sequence[str]) -> None:
    if len(views) < FEWEST_VIEWS:
        raise ImportFault(
            f"{folder}: {len(views)} view{'s' if len(views) != 1 else ''} of {len(files)} files; at least"
            f" {FEWEST_VIEWS} are needed, and 50 or more are better: photograph more. {' '.join(notes)}".rstrip(
                ". "
            )
        )


def _flips(views: Sequence[View]) -> list[int]:
    """How each view is turned to stand upright; linear images are as they stand.

    Raises:
        RawError: a tag says that its picture is mirrored.
    """
    flips = [int(view.facts[0].get("orientation", 0)) for view in views]
    for view, flip in zip(views, flips, strict=True):
        conventions.check(flip, str(view.files[0]))
    return flips


def find_photographs(folder: Path) -> tuple[str, list[Path]]:
    """("raw" or "linear", files): those of `folder` itself, else those of the folders in it.

    Raises:
        ImportFault: no such folder, nothing to import in it, or RAW and linear images mixed.
    """
    if not folder.is_dir():
        raise ImportFault(f"{folder}: no such folder; give the folder that holds the photographs")
    known = RAW_SUFFIXES | LINEAR_SUFFIXES
    try:
        for found in (folder.iterdir(), _files_below(folder)):
            files = [path for path in found if path.suffix.lower() in known and path.is_file()]
            files = sorted((path for path in files if not path.name.startswith(".")), key=natural)
            if files:
                break
        else:
            there = sorted({path.suffix.lower() or "no suffix" for path in _files_below(folder)})
            only = f"only {', '.join(there[:6])}" if there else "empty"
            # Of what is made for the eye, light cannot be told.
            why = ", not linear in light" if PICTURE_SUFFIXES.intersection(there) else ""
            raise ImportFault(
                f"{folder}: no photographs in it ({only}{why}); it must hold RAW files, or linear .exr or .hdr images"
            )
    except PermissionError as fault:
        raise ImportFault(f"{fault.filename}: no permission to read it; change its permissions") from fault
    for path in files:
        try:
            str(path).encode()
        except UnicodeEncodeError as fault:
            # A session's own files are UTF-8, and LibRaw opens no other names.
            raise ImportFault(f"{str(path)!a}: its name is not written in UTF-8; rename it") from fault
    linear = [path for path in files if path.suffix.lower() in LINEAR_SUFFIXES]
    raw = [path for path in files if path.suffix.lower() in RAW_SUFFIXES]
    if linear and raw:
        raise ImportFault(
            f"{linear[0]}: linear images ({len(linear)}) and RAW files ({len(raw)}) are mixed; put one kind"
            " in a folder of its own"
        )
    try:
        _check_twins(files)
    except OSError as fault:
        raise ImportFault(
            f"{fault.filename or folder}: cannot be read ({fault.strerror}); change its permissions or copy it again"
        ) from fault
    return ("raw", raw) if raw else ("linear", linear)


def _files_below(folder: Path) -> Iterator[Path]:
    """Files in `folder` and the folders in it, also behind links; each folder once, or links in a circle had no end."""
    seen: set[str] = set()
    for here, below, names in os.walk(folder, followlinks=True):
        real = os.path.realpath(here)
        if real in seen:
            below.clear()
            continue
        seen.add(real)
        below.sort()
        yield from (Path(here) / name for name in names)


def _check_twins(files: Sequence[Path]) -> None:
    """Refuse what would be one view twice: two formats of one name, or the same file in two folders or under two names.

    Renders of an even room may be alike without being copies: of linear images only those of one name are compared.

    Raises:
        ImportFault: naming both, and how many there are.
    """
    named: dict[str, Path] = {}
    alike: dict[tuple[int, bytes, str], list[Path]] = {}
    twins = []
    for path in files:
        first = named.setdefault(path.stem.lower(), path)
        size, end = _size_and_end(path)
        name = path.stem.lower() if path.suffix.lower() in LINEAR_SUFFIXES else ""
        others = alike.setdefault((size, end, name), []) if size else []
        same = next((other for other in others if filecmp.cmp(other, path, shallow=False)), None)
        others.append(path)
        if same is not None or first.suffix.lower() != path.suffix.lower():
            twins.append((first if same is None else same, path))
    if twins:
        first, path = twins[0]
        more = f", and {len(twins) - 1} more such pairs" if len(twins) > 1 else ""
        raise ImportFault(
            f"{path}: the same photograph as {first.name} in {first.parent}{more}; put one of each pair in a folder of its own"
        )


def _size_and_end(path: Path) -> tuple[int, bytes]:
    """What only copies have in common: the end of a file is pixels, and no two photographs have the same noise."""
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - END_BYTES))
        return size, file.read()


def _raw_views(
    files: Sequence[Path], bracket: int | None, checking: Progress | None
) -> tuple[list[View], dict[str, Any], tuple[str, ...]]:
    """By the files' headers; their pixels are checked where there is a progress to tell of it."""
    taken = [Taken(path, read_facts(path)) for path in files]
    first = taken[0]
    for item in taken[1:]:
        _check_same(first.path, first.facts.camera, item.path, item.facts.camera, "cameras")
        sizes = [f"{facts.width} x {facts.height}" for facts in (first.facts, item.facts)]
        _check_same(first.path, sizes[0], item.path, sizes[1], "sizes")
    grouping = group(taken, bracket)
    brackets = grouping.brackets
    views = [
        View(
            _name(items[0].path, files),
            tuple(item.path for item in items),
            tuple(_exposure_facts(item) for item in items),
        )
        for items in brackets
    ]
    if checking is not None:
        _check_pixels(brackets, checking)
    facts = first.facts
    camera = {"model": facts.camera, "width": facts.width, "height": facts.height}
    return views, camera, tuple(filter(None, [note(grouping)]))


def _check_pixels(brackets: Sequence[Sequence[Taken]], progress: Progress) -> None:
    """Decode every file once, so that a truncated or burnt-out one is told now and not after an hour."""

    def clipped_share(item: Taken) -> float:
        mosaic = read_mosaic(item.path)
        black, white = min(mosaic.black), min(mosaic.white)
        return float((mosaic.counts >= black + MERGE.saturation_share * (white - black)).mean())

    with ThreadPoolExecutor(4) as pool:
        try:
            for i, items in enumerate(brackets):
                progress.step(i / len(brackets), f"checking {items[0].path.name}")
                shares = list(pool.map(clipped_share, items))
                if min(shares) > MERGE.hopeless_share:
                    darkest = min(items, key=lambda item: item.ev)
                    raise ImportFault(
                        f"{darkest.path}: {min(shares):.0%} of the pixels are clipped even in the darkest"
                        f" of the view's {len(items)} exposures; take it again with a shorter one, or drop it"
                    )
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _linear_views(
    files: Sequence[Path], progress: Progress
) -> tuple[list[View], dict[str, Any], tuple[str, ...]]:
    size, views, notes = "", [], ()
    shape, negative = (0, 0), {}
    for i, path in enumerate(files):
        progress.step(i / len(files), f"checking {path.name}")
        radiance = read_radiance(path)
        negative[path] = check_values(path, radiance)
        shape = radiance.shape[:2]
        told = f"{shape[1]} x {shape[0]}"
        size = size or told
        _check_same(files[0], size, path, told, "sizes")
        views.append(View(_name(path, files), (path,), ({},)))
    if any(negative.values()):
        most = max(negative, key=lambda path: negative[path])
        notes = (
            f"{sum(map(bool, negative.values()))} of {len(files)} pictures hold negative values, most {most.name}:"
            f" {negative[most]} of {3 * shape[0] * shape[1]} (colours outside Rec.709, noise about zero, or the"
            " undershoot of a filter); they are kept as they are.",
        )
    return views, {"model": None, "width": shape[1], "height": shape[0]}, notes


def _check_same(first: Path, value: str, other: Path, other_value: str, what: str) -> None:
    if value != other_value:
        raise ImportFault(
            f"{other}: two {what} are mixed: {other_value} here but {value} in {first.name}; import the"
            " photographs of one camera at one size"
        )


def _name(path: Path, files: Sequence[Path]) -> str:
    """What the person calls the view: its file's name, with folders only where the files lie in several."""
    return path.relative_to(os.path.commonpath([file.parent for file in files])).with_suffix("").as_posix()


def _exposure_facts(item: Taken) -> dict[str, Any]:
    facts = item.facts
    return {
        "shutter_s": facts.shutter_s,
        "iso": facts.iso,
        "aperture": None if math.isnan(facts.aperture) else facts.aperture,
        "time_s": None if math.isnan(facts.time_s) else facts.time_s,
        "orientation": facts.orientation,
    }


def given_poses(path: Path, views: Sequence[View], folder: Path, size: tuple[int, int]) -> GivenPoses:
    """Poses for the views; a bracket is known by whichever of its exposures the other program was shown.

    Raises:
        PoseError: the poses are unreadable, not rigid, or of other photographs.
    """
    names = [tuple(file.relative_to(folder).as_posix() for file in view.files) for view in views]
    return read_poses(path, names, size)


def encode_poses(given: GivenPoses, names: Sequence[str]) -> bytes:
    """`edits/poses.json`: given poses in our convention, by view name; null where a view has none."""
    views = {
        name: pose.tolist() if registered else None
        for name, pose, registered in zip(names, given.cam_from_world, given.registered, strict=True)
    }
    content = {
        "camera": asdict(given.camera),
        "scale": given.scale,
        "views": views,
        "points": given.points.tolist(),
        "notes": list(given.notes),
    }
    return json.dumps(content).encode()


def describe_poses(session: Session) -> str:
    """How many views were given a pose, which have none, and what was converted, in one line."""
    if "poses.json" not in sessions.edits(session):
        return "poses: none given; `process` finds them"
    content = json.loads((session.folder / "edits" / "poses.json").read_bytes())
    views = content["views"].values()
    placed = f"{sum(pose is not None for pose in views)} of {len(views)} views have one"
    return "; ".join([f"poses: {placed}", *content["notes"]])
