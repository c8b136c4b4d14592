"""Relit pictures as files: a still at the photographs' own size, or the light going round as a video; made in a child or by the command line.

A still is PNG with the object's mask as alpha, or EXR with linear radiance; a video MP4 (VP9, which browsers and players show), or a folder
of PNG files. `app/relight/relit.py` tells what the settings mean.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from app.frame_writer import VIDEO, FrameWriter
from app.inspect import runs
from app.relight import files, sources, transfer
from app.relight import relit as relighting
from app.relight.relit import Light, Setting, Transfer
from engine.errors import SessionError
from engine.io.session import told
from engine.orientation import turned
from engine.pipeline import artifacts
from engine.types import Surface

if TYPE_CHECKING:
    from app.work.worker import Link
    from engine.progress import Progress

STILLS, PAGE = (".png", ".exr"), ".html"
FPS, SECONDS = 30, 8.0
LEAST_PX = 720  # of a video's longer side, about: players show small ones small


@dataclass(frozen=True, slots=True)
class Wish:
    """What to draw, in plain values."""

    session: str
    to: str
    light: str = ""  # a panorama's file; empty: what was recovered
    view: int | None = None  # whose recovered light; None: one in the middle
    setting: Mapping[str, Any] = dataclasses.field(default_factory=dict)  # fields of `Setting`
    spot: float = 0.0  # strength of the person's own lamp; 1 lights white paint white
    exposure_ev: float = 0.0
    tone: str = "srgb"
    room: bool = False  # the light behind the object
    seconds: float = SECONDS  # of a video


def serve(request: Mapping[str, Any], link: "Link") -> Mapping[str, Any]:
    """Task "relit": {the fields of `Wish`}; gives {to}."""
    link.emit("stage", name="relit", number=1, count=1)
    return {"to": str(make(Wish(**request), link.progress()))}


def make(wish: Wish, progress: "Progress") -> Path:
    """Draw and write.

    Raises:
        SessionError: there is no finished surface, or the file cannot be written.
        ExportError: a video cannot, or a folder for PNG files holds others.
        LightError: the panorama cannot be used.
        Cancelled: `progress` said so; nothing was written.
    """
    to, session = Path(wish.to), Path(wish.session)
    if to.suffix.lower() not in (*STILLS, VIDEO, PAGE, ""):
        raise SessionError(f"{to}: is none of .png, .exr, .mp4, .html or a folder; choose another name")
    run = runs.current(runs.runs_of(session))
    if run is None:
        raise SessionError(f"{session}: has no finished surface; run `roomlight process {session}` first")
    if to.suffix.lower() == PAGE:
        from app.relight import page

        page.write(session, to)
        return to
    still = to.suffix.lower() in STILLS
    surface, light = _prepared(run, wish, still, progress.part(0, 0.8 if still else 0.4))
    given: dict[str, Any] = {**wish.setting, "lamps": tuple(wish.setting.get("lamps", ()))}
    spot = given.get("spot")
    given["spot"] = None if spot is None else tuple(spot)
    setting = Setting(**given)
    white = relighting.white_of(relighting.relit(surface, light, Setting()))
    setting = dataclasses.replace(setting, spot_energy=float(np.pi * white * wish.spot))
    with told(to):
        to.parent.mkdir(parents=True, exist_ok=True)
    if still:
        _still(to, surface, light, setting, white, wish)
    else:
        _turn(to, surface, light, setting, white, wish, progress.part(0.4, 1))
    return to


def _prepared(run: runs.Run, wish: Wish, full: bool, progress: "Progress") -> tuple[Transfer, Light]:
    """The surface's answer, at the photographs' own size if `full`, and the light; what was made before is read."""
    known = files.lights_of(run)
    if (
        not files.transfer_file(run).is_file()
        or not known
        or (wish.view is not None and wish.view not in known)
    ):
        transfer.prepare(run, wish.view, progress.part(0, 0.4))
    view = files.lights_of(run)[0] if wish.view is None else wish.view
    light = files.load_light(files.light_file(run, view))
    if wish.light:
        progress.step(0.45, Path(wish.light).name)
        light = sources.panorama(Path(wish.light))
    surface = files.load_transfer(files.transfer_file(run))
    size = turned(artifacts.load(run.folder("surface"), "surface", Surface), run.flip).mask.shape
    if full and surface.mask.shape != size:
        whole = files.transfer_file(run, full=True)
        if not whole.is_file():
            transfer.prepare_full(run, progress.part(0.5, 1))
        surface = files.load_transfer(whole)
    return surface, light


def _still(to: Path, surface: Transfer, light: Light, setting: Setting, white: float, wish: Wish) -> None:
    if to.suffix.lower() == ".exr":
        ground = relighting.behind(surface, light, setting) if wish.room else None
        picture, inside = relighting.framed(surface, relighting.relit(surface, light, setting), ground)
        files.save_exr(to, picture, inside, f"{light.name}, {setting}")
        return
    _write_png(to, relighting.drawn(surface, light, setting, white, wish.exposure_ev, wish.tone, wish.room))


def _write_png(to: Path, picture: np.ndarray) -> None:
    with told(to):
        to.write_bytes(cv2.imencode(".png", picture)[1].tobytes())


def _turn(
    to: Path,
    surface: Transfer,
    light: Light,
    setting: Setting,
    white: float,
    wish: Wish,
    progress: "Progress",
) -> None:
    """The room's light once round the object; a lamp of the person's own once round its half sphere."""
    count = max(2, round(FPS * wish.seconds))
    by = max(1, round(LEAST_PX / max(surface.size)))
    height, width = (by * size // 2 * 2 for size in surface.size)
    writer = FrameWriter(to, FPS)
    try:
        for k in range(count):
            progress.step(k / count, f"frame {k + 1} of {count}")
            moved = dataclasses.replace(setting, yaw_deg=setting.yaw_deg + 360 * k / count)
            if setting.spot is not None:
                angle, reach = 2 * np.pi * k / count, max(float(np.hypot(*setting.spot)), 0.5)
                moved = dataclasses.replace(moved, spot=(reach * np.sin(angle), reach * np.cos(angle)))
            picture = relighting.drawn(surface, light, moved, white, wish.exposure_ev, wish.tone, wish.room)
            if to.suffix:
                picture = cv2.resize(picture[..., :3], (width, height), interpolation=cv2.INTER_CUBIC)
            writer.write(picture)
        writer.finish()
    finally:
        writer.drop()
