"""Order a capture of the quick devices, and hold a captured session against its plan."""

import re
from collections.abc import Callable
from pathlib import Path

from app.capture.order import Order, Pose, kind_of, poses_of
from app.capture.recovery import Patience
from engine.io import session as sessions
from engine.io.raw import read_facts
from hardware import plan
from hardware.interfaces import Angles, Bracket, Exposure
from tests.app.capture import quick_devices

HASTY = Patience(wait_s=0.0, poll_s=0.001, still_s=0.05, ready_s=0.05)
STOPS = (-3.0, 0.0, 3.0)


def order(poses: int, stops: tuple[float, ...] = STOPS, any_format: bool = False) -> Order:
    places = poses_of(plan.gimbal(poses))
    return Order(
        "quick:", "quick:", kind_of(places), places, Bracket(Exposure(0.02), stops), any_format=any_format
    )


StoodAt = Callable[[Path, Angles], bool]


def faults_of(
    folder: Path, wanted: Order, complete: bool = True, stood_at: StoodAt = quick_devices.stood_at
) -> list[str]:
    """What is wrong with a session: shots lost, doubled, mislabelled, half-written or changed.

    Args:
        stood_at: was this photograph taken at these angles?
    """
    session = sessions.open_session(folder)
    shots = sessions.shots(session)
    wrong = [
        f"{path} is half-written"
        for path in (folder / "shots").iterdir()
        if not (path / "shot.json").exists()
    ]
    names = [shot.name for shot in shots]
    poses = {pose.name: pose for pose in wanted.poses}
    wrong += [f"{name} is there {names.count(name)} times" for name in set(names) if names.count(name) > 1]
    wrong += [f"{name} was never asked for" for name in set(names) - poses.keys()]
    if complete:
        wrong += [f"{name} is missing" for name in poses.keys() - set(names)]
    for shot in shots:
        sessions.verify(shot)
        wrong += _faults_of_shot(shot, poses[shot.name], wanted.bracket.stops, stood_at)
    hashes = [sha256 for shot in shots for sha256 in shot.sha256]
    wrong += ["one photograph is in two places"] * (len(set(hashes)) < len(hashes))
    incoming = folder / "capture" / "incoming"
    return wrong + [f"{incoming} was left"] * (complete and incoming.exists())


def _faults_of_shot(
    shot: sessions.Shot, pose: Pose, stops: tuple[float, ...], stood_at: StoodAt
) -> list[str]:
    there = {path.name for path in shot.folder.iterdir()}
    wrong = [
        f"{shot.name}: {name} is stray" for name in there - {"shot.json"} - {file.name for file in shot.files}
    ]
    told = [re.fullmatch(r"pose(\d{4})_ev([-+]?[\d.]+)_IMG_\d+\.DNG", file.name) for file in shot.files]
    evs = [float(found[2]) for found in told if found and int(found[1]) == pose.index]
    if evs != sorted(stops):
        wrong.append(f"{shot.name} has {[file.name for file in shot.files]}")
    shutters = [read_facts(file).shutter_s for file in shot.files]
    if shutters != sorted(shutters):
        wrong.append(f"{shot.name}: exposures {shutters} do not ascend")
    assert pose.angles is not None
    assert shot.rig is not None
    off = abs(shot.rig["pan_deg"] - pose.angles.pan_deg) + abs(shot.rig["tilt_deg"] - pose.angles.tilt_deg)
    if off > 0.05:
        wrong.append(f"{shot.name} says {shot.rig}, {pose.angles} was asked")
    wrong += [f"{file.name} was taken elsewhere" for file in shot.files if not stood_at(file, pose.angles)]
    return wrong
