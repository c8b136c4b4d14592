"""Masks and poses that were made on developed, upright pictures, as they are of the sensor's.

Other programs develop a photograph before they show it, and turn it as its Orientation tag says; a program that does
not, or files whose tags were lost, leave it as the sensor lies. By a quarter of a turn width and height change places,
which tells the two apart; by half a turn nothing does: upright is taken, and said.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from engine import conventions, orientation
from engine.conventions import WORDS
from engine.errors import MaskError, PoseError
from engine.io.images import read_mask
from engine.io.poses.pose_files import GivenPoses
from engine.orientation import turn_camera, turn_picture, turn_poses
from engine.types import Camera

ALIKE = 0.02
"""Share of the picture's longer edge by which cameras of pictures turned otherwise may differ and still be one."""
Size = tuple[int, int]  # width, height


def mask(path: Path, size: Size, flip: int) -> tuple[Bool[np.ndarray, "h w"], tuple[str, ...]]:
    """A mask painted on the upright picture, or else on the sensor's, on the grid of the sensor's of `size`; notes.

    Raises:
        MaskError: as `read_mask`.
    """
    first: MaskError | None = None
    for turn in dict.fromkeys((flip, 0)):
        width, height = orientation.size(size, turn)
        try:
            painted = turn_picture(read_mask(path, height, width), orientation.back(turn))
            return np.ascontiguousarray(painted), _notes("The mask was", size, [turn], [flip])
        except MaskError as fault:
            first = first or fault
    assert first is not None
    raise first


def poses(
    read: Callable[[Sequence[int], Size], GivenPoses], flips: Sequence[int], size: Size
) -> tuple[GivenPoses, tuple[str, ...]]:
    """Poses of upright pictures, or else of those that lie as the sensor, in the sensor's frame; notes.

    Args:
        read: gives the poses of some views, by index, whose pictures are of a size.
        flips: of each view; every one's pose is turned by its own, or by the most frequent one where the file's cameras
            say that all pictures were turned alike.
        size: of the sensor's pictures.

    Raises:
        PoseError: as `read`, or cameras of pictures turned otherwise are not one.
    """
    first: PoseError | None = None
    alike = [conventions.common(flips)] * len(flips)
    for turns in dict.fromkeys(map(tuple, (flips, alike, [0] * len(flips)))):
        try:
            return _read(read, turns, size), _notes("The poses were", size, turns, flips)
        except PoseError as fault:
            first = first or fault
    assert first is not None
    raise first


def _read(read: Callable[[Sequence[int], Size], GivenPoses], turns: Sequence[int], size: Size) -> GivenPoses:
    """Poses of pictures that were turned so, turned back."""
    sizes = [orientation.size(size, turn) for turn in turns]
    groups = {one: [i for i, other in enumerate(sizes) if other == one] for one in dict.fromkeys(sizes)}
    parts = {one: read(views, one) for one, views in groups.items()}
    most = conventions.common(turns)
    cam_from_world, registered = np.full((len(turns), 3, 4), np.nan), np.zeros(len(turns), bool)
    cameras: dict[int, Camera] = {}
    for one, views in groups.items():
        registered[views] = parts[one].registered
        for view, pose in zip(views, parts[one].cam_from_world, strict=True):
            undo = orientation.back(turns[view])
            cam_from_world[view] = turn_poses(pose, undo)
            cameras[turns[view]] = turn_camera(parts[one].camera, undo)
    apart = max(_apart(cameras[most], other) for other in cameras.values())
    if apart > ALIKE:
        raise PoseError(
            f"the cameras of pictures turned {' and '.join(WORDS[turn] for turn in sorted(cameras))} differ by"
            f" {100 * apart:.1f} % of the picture, where a session has one camera; make the poses on pictures turned alike"
        )
    notes = tuple(dict.fromkeys(note for part in parts.values() for note in part.notes))
    first = parts[sizes[0]]
    return replace(
        first, camera=cameras[most], cam_from_world=cam_from_world, registered=registered, notes=notes
    )


def _apart(one: Camera, other: Camera) -> float:
    """The largest difference of focal lengths and principal points, in longer edges of the picture."""
    terms = ("fx", "fy", "cx", "cy")
    return max(abs(getattr(one, term) - getattr(other, term)) for term in terms) / max(one.width, one.height)


def _notes(what: str, size: Size, turns: Sequence[int], flips: Sequence[int]) -> tuple[str, ...]:
    """What was taken, where the tags say otherwise or sizes do not tell."""
    if any(flips) and not any(turns):
        return (f"{what} taken as of pictures of {size[0]} x {size[1]}, as the sensor lies, and not turned.",)
    unclear = sorted({turn for turn in turns if turn and orientation.size(size, turn) == size})
    return tuple(
        f"{what} taken as of upright pictures and turned {WORDS[turn]}, which their size cannot tell; if that is wrong,"
        " correct the photographs' Orientation tags and import again."
        for turn in unclear
    )
