"""What each stage does: loads its inputs, calls its room's function, names the records to keep.

Given masks and poses (`edits/mask.png`, `edits/poses.json`) become records here without any computing beyond
bringing them to the pixel grid of the frames. Rooms are imported where they are used: a run that stops
early loads no more than it needs.
"""

import json
import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Int

from engine.errors import MaskError, PoseError, SurfaceError
from engine.geometry import inverse, rays, transform
from engine.io import left_out
from engine.io.session import Session, shots, verify
from engine.orientation import turned
from engine.pipeline import artifacts
from engine.pipeline.stages import Work
from engine.scale_bar import factor_of, scaled
from engine.types import (
    Camera,
    CapturedScene,
    Emitters,
    Frames,
    Gaussians,
    Lamps,
    Masks,
    Panorama,
    Poses,
    SolvedScene,
    Surface,
)

if TYPE_CHECKING:
    from engine.segmentation.segment import Strokes

Records = Mapping[str, Any]

PANORAMA_ROWS = 256


def hdr(work: Work) -> Records:
    """frames, report."""
    from engine.hdr.merge import merge, stack
    from engine.io.raw import Bracket

    views = shots(work.session)
    checking, merging = work.progress.part(0.0, 0.05), work.progress.part(0.05, 1.0)
    for i, view in enumerate(views):
        checking.step(i / len(views), f"checking {view.name}")
        verify(view)
    if work.session.kind == "raw":
        place = partial(artifacts.place, work.folder, "frames.radiance")
        brackets = [Bracket(view.name, view.files) for view in views]
        frames, report = merge(brackets, work.params, merging, left_out.read(work.session), place)
    else:
        names, paths = [view.name for view in views], [view.files[0] for view in views]
        frames, report = stack(names, paths, work.params, merging)
    return {"frames": frames, "report": report}


def segment(work: Work) -> Records:
    """masks, report."""
    from engine.io.images import read_mask
    from engine.segmentation.segment import from_object, report_on, segment

    frames = work.load("hdr", "frames", Frames)
    views = np.array(left_out.kept(work.session, frames.names))
    camera, folder = work.session.facts["camera"], work.session.folder / "edits"
    grid, painted = frames.dark.shape[1:], None
    if (folder / "strokes.png").is_file():
        painted = read_strokes(folder / "strokes.png", camera["height"], camera["width"], grid)
    if not work.given:
        masks, report = segment(frames, work.params, painted, work.progress, views)
        return {"masks": masks, "report": report}
    mask = on_grid(read_mask(folder / "mask.png", camera["height"], camera["width"]), grid)
    if painted is not None:
        mask = (mask | painted.add) & ~painted.remove
    masks = from_object(frames, mask, work.params)
    return {"masks": masks, "report": report_on(frames, mask, work.params, views)}


def read_strokes(path: Path, height: int, width: int, grid: tuple[int, ...]) -> "Strokes":
    """`edits/strokes.png` on a grid: green adds to the object, red takes from it, with blue exactly there.

    Raises:
        MaskError: not a colour image of the photographs' size.
    """
    from engine.io.images import UNREADABLE_PICTURE, opened
    from engine.segmentation.segment import Strokes

    try:
        with opened(path) as image:
            if image.size != (width, height):
                raise ValueError("of another size")
            rgb = np.asarray(image.convert("RGB"))
    except UNREADABLE_PICTURE as fault:
        raise MaskError(
            f"{path}: must be a colour PNG of {width} x {height}, green where the object is and red where it"
            " is not; paint it again on a photograph"
        ) from fault
    red, green, blue = (rgb[..., channel] > 127 for channel in range(3))
    return Strokes(*(on_grid(painted, grid) for painted in (green & ~red, red & ~green, blue)))


def on_grid(mask: Bool[np.ndarray, "hh ww"], grid: tuple[int, ...]) -> Bool[np.ndarray, "h w"]:
    """A mask painted on a photograph, on the (height, width) of frames averaged down from it: by majority."""
    height, width = grid
    by = max(mask.shape[1] // width, 1)
    blocks = mask[: height * by, : width * by].reshape(height, by, width, by)
    return np.asarray(blocks.mean(axis=(1, 3)) >= 0.5)


def poses(work: Work) -> Records:
    """poses, and the report of how they were found, or of what the photographs say of those that were given."""
    frames = work.load("hdr", "frames", Frames)
    count, views = len(frames.names), np.array(left_out.kept(work.session, frames.names))
    some = len(views) < count
    frames = frames.views(views) if some else frames
    given = _given_poses(work.session, frames) if work.given else None
    from engine.sfm.reconstruct import find_poses
    from engine.sfm.triangulate import triangulate

    masks = work.load("segment", "masks", Masks)
    masks = masks.views(views) if some else masks
    scratch = work.folder / "scratch"
    scratch.mkdir()
    if given is not None:
        points, report = triangulate(frames, masks, given, work.params, scratch, work.progress)
        found = given if len(given.points) else replace(given, points=points)
    else:
        found, report = find_poses(
            frames, masks, rig_log(work.session, views), work.params, scratch, work.progress
        )
    shutil.rmtree(scratch)
    return {"poses": found.among(views, count), "report": report}


def _given_poses(session: Session, frames: Frames) -> Poses:
    path = session.folder / "edits" / "poses.json"
    height, width = frames.dark.shape[1:]
    matrices = np.full((len(frames.names), 3, 4), np.nan)
    try:
        content = json.loads(path.read_bytes())
        camera = Camera(**content["camera"])
        by = camera.width // width
        # Averaging by a whole factor drops the last columns and rows that do not fill a block.
        camera = replace(
            camera, width=width, height=height, fx=camera.fx / by, fy=camera.fy / by, cx=camera.cx / by,
            cy=camera.cy / by,
        )  # fmt: skip
        for row, name in enumerate(frames.names):
            if content["views"].get(name) is not None:
                matrices[row] = content["views"][name]
        points = np.array(content["points"], dtype=np.float64).reshape(-1, 3)
        scale = str(content["scale"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ZeroDivisionError) as error:
        raise PoseError(
            f"{path}: cannot be read ({type(error).__name__}: {error}); import the poses again, or remove the file"
            " to have them found"
        ) from error
    registered = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    if not registered.any():
        raise PoseError(f"{path}: holds no pose of any view of this session; import the poses again")
    return Poses(camera, matrices, registered, points, scale, math.nan)


def rig_log(session: Session, views: Int[np.ndarray, " k"]) -> Any:
    """What the rig reported of these views, NaN where a view has no report; None for a session without a rig of known geometry."""
    from engine.sfm.rig_alignment import RigLog

    rig, taken = session.facts.get("rig"), shots(session)
    if not rig or not rig.get("geometry"):
        return None
    pan, tilt = (
        np.array([float((view.rig or {}).get(key, math.nan)) for view in (taken[i] for i in views)])
        for key in ("pan_deg", "tilt_deg")
    )
    return RigLog(rig["kind"], pan, tilt, rig["geometry"])


def light(work: Work) -> Records:
    """gaussians, lamps (the last of the Gaussians), report."""
    from engine.light.fitting.fit import fit

    gaussians, lamps, report = fit(
        work.load("hdr", "frames", Frames), work.load("segment", "masks", Masks),
        work.load("poses", "poses", Poses), work.params, work.seed, work.progress,
    )  # fmt: skip
    return {"gaussians": gaussians, "lamps": lamps, "report": report}


def surface(work: Work) -> Records:
    """surface, renders of the views kept out, report; the light it was solved under, for further renders."""
    from engine.surface.solve import solve

    return _solved(work, solve)


def reference(work: Work) -> Records:
    """The same by the paper's solver."""
    from engine.reference.solver import solve

    return _solved(work, solve)


def _solved(work: Work, solve: Callable[..., SolvedScene]) -> Records:
    captured = CapturedScene(
        work.load("hdr", "frames", Frames), work.load("segment", "masks", Masks),
        work.load("poses", "poses", Poses), work.load("light", "gaussians", Gaussians),
        work.load("light", "lamps", Lamps),
    )  # fmt: skip
    found = solve(captured, work.params, work.device, work.seed, work.progress, work.session.orientation)
    return {name: getattr(found, name) for name in ("surface", "renders", "emitters", "report")}


def export(work: Work) -> Records:
    """The files other programs read, and for the report the panorama and what its light rests on; all upright."""
    from engine.light.incident.provenance import provenance_of
    from engine.results.export import write_files

    def load(stage: str, record: str, kind: type) -> Any:
        return turned(work.load(stage, record, kind), work.session.orientation)

    frames, placed, masks = (
        load("hdr", "frames", Frames),
        load("poses", "poses", Poses),
        load("segment", "masks", Masks),
    )
    found, emitters = load("surface", "surface", Surface), load("surface", "emitters", Emitters)
    view = middle_view(placed)
    seen, clipped = panorama(found, emitters, placed, view, frames, masks, PANORAMA_ROWS)
    grounds = provenance_of(seen, clipped, found.normal[found.mask])
    by = factor_of(work.session.folder, found, placed.camera)
    if by is not None:
        found, placed, emitters = scaled(found, by), scaled(placed, by), scaled(emitters, by)
    write_files(
        work.folder, found, emitters.gaussians, emitters.lamps, placed, frames.names, seen, grounds,
        frames.radiance, work.params, work.progress,
    )  # fmt: skip
    return {"panorama": seen, "grounds": grounds}


def middle_view(placed: Poses) -> int:
    """The registered view whose camera is nearest to the middle of all."""
    usable = np.nonzero(placed.registered)[0]
    centres = inverse(placed.cam_from_world[usable])[:, :, 3]
    return int(usable[np.linalg.norm(centres - np.median(centres, axis=0), axis=1).argmin()])


def panorama(
    found: Surface,
    emitters: Emitters,
    placed: Poses,
    view: int,
    frames: Frames,
    masks: Masks,
    rows: int,
) -> tuple[Panorama, Bool[np.ndarray, "h w"]]:
    """What arrives at the middle of the object in one view, small holes filled; and which directions are clipped in
    every view that shows them."""
    from engine.light.incident import probes
    from engine.light.incident.provenance import photographed

    known = found.mask & (found.depth > 0)
    if not known.any():
        raise SurfaceError(
            "the surface has no depth, so the object's place in the room is unknown; process again"
        )
    ray = rays(placed.camera)[known]
    middle = np.median(ray / ray[:, 2:] * found.depth[known][:, None], axis=0)
    cam_from_world = placed.cam_from_world[view]
    origin = transform(inverse(cam_from_world), middle)
    turn = cam_from_world[:, :3]
    radiance, opacity = probes.panorama(emitters.gaussians, origin, turn, rows, fill=True)
    shown, clipped = photographed(emitters.photographed(), origin, turn, rows, frames, masks, placed)
    return Panorama(frames.names[view], radiance, opacity * shown), clipped
