"""`roomlight capture`: from words on the command line to a capture, and from its outcome to an exit code."""

import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

from app.capture import checks
from app.capture import folder as capture_folder
from app.capture import order as capture_order
from app.capture.order import CaptureError
from app.capture.run import Capture
from app.capture.status import Outcome
from app.capture.terminal import Screen, resume_with, told_missing
from engine.io import session as sessions
from hardware import find
from hardware import plan as plans
from hardware.errors import SettingsError
from hardware.interfaces import Bracket, Exposure
from hardware.rig import Rig

DEFAULT_STOPS = (-3.0, 0.0, 3.0)


def run(args: Namespace) -> int:
    """
    Raises:
        CaptureError, HardwareError, SessionError: why it did not start, stopped, or what is missing.
    """
    screen = Screen()
    capture = _resumed(args, screen) if args.resume else _new(args, screen)
    outcome = screen.run(capture, args.session)
    return _told(args.session, outcome)


def _new(args: Namespace, screen: Screen) -> Capture:
    """Opens the devices, for the plan may depend on what the rig can do; nothing moves."""
    if args.rig is None or args.camera is None:
        raise SettingsError(
            "which rig and which camera? As in --rig virtual: --camera virtual:, or see `roomlight rig list`"
        )
    if (args.plan is None) == (args.poses is None):
        raise SettingsError("which poses? Give either --plan FILE or --poses N")
    capture_folder.check_free_place(args.session)
    plan = plans.read_plan(args.plan) if args.plan else None
    bracket = Bracket(Exposure(args.shutter, args.iso, args.aperture), args.bracket or DEFAULT_STOPS)
    url = _with_file(args.rig, args.geometry)

    def connect() -> Rig:
        return find.open_rig(url, args.camera, progress=screen.progress)

    rig = connect()
    try:
        features = rig.motion.features
        plan = plan or plans.suited(args.poses, features)
        order = capture_order.planned(plan, rig, (url, args.camera), bracket, args.settle, args.any_format)
    except BaseException:
        rig.close()
        raise
    live = checks.watching(order)
    return Capture(
        args.session,
        order,
        _first(rig, connect),
        watch=live,
        reorder=checks.reordering(live, args.helpful_first),
        listener=screen.heard,
        warnings=checks.of_order(order),
    )


def _resumed(args: Namespace, screen: Screen) -> Capture:
    """Only devices may be named anew: a cable may be in another socket today."""
    fixed = ("plan", "poses", "bracket", "shutter", "iso", "aperture", "settle", "geometry")
    changed = [f"--{name}" for name in fixed if getattr(args, name) is not None]
    if changed:
        raise SettingsError(
            f"{', '.join(changed)} with --resume: a capture goes on as it was begun; leave it out, or begin a new session"
        )
    order = capture_order.read(args.session)

    def connect() -> Rig:
        return find.open_rig(args.rig or order.rig, args.camera or order.camera, progress=screen.progress)

    live = checks.watching(order)
    return Capture(
        args.session,
        order,
        connect,
        resumed=True,
        at_zero=args.at_zero,
        watch=live,
        reorder=checks.reordering(live, args.helpful_first),
        listener=screen.heard,
    )


def _with_file(rig: str, geometry: Path | None) -> str:
    """The rig's URL with the file that says where its axes are."""
    if geometry is None:
        return rig
    return f"{rig}{'&' if '?' in rig else '?'}file={quote(str(geometry.absolute()))}"


def _first(rig: Rig, connect: Callable[[], Rig]) -> Callable[[], Rig]:
    """Gives the rig that is open already, then opens others."""
    opened = [rig]
    return lambda: opened.pop() if opened else connect()


def _told(folder: Path, outcome: Outcome) -> int:
    if outcome.cancelled:
        kept = f"{outcome.taken} of {outcome.total} poses are kept: go on with {resume_with(folder)}"
        print(f"stopped; {kept if folder.exists() else 'nothing was begun'}", file=sys.stderr)
        return 130
    if outcome.missing:
        raise CaptureError(told_missing(outcome.missing, outcome.total, folder))
    camera = sessions.open_session(folder).facts["camera"]
    exposures = len(capture_order.read(folder).bracket.stops)
    size = f", {camera['width']} x {camera['height']}" if camera.get("width") else ""
    print(f"{folder}: {outcome.taken} poses of {exposures} exposure(s){size}")
    if size:
        print(f"next: roomlight process {folder}")
    return 0
