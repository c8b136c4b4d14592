"""Captures among faults and kills, and what a pose costs beside motion, exposure and transfer. Prints what it finds.

    python -m tests.bench.capture [--poses 500] [--kills 100] [--emulated 500] [--to FOLDER]

Three parts: devices in memory that fail at random once in every ten poses, each failure a device error a capture
knows; processes killed at random moments; and, the same on the virtual studio's emulated controller and camera, with
faults on the wire. Ends with 1 if a shot was lost, doubled or mislabelled.
"""

import argparse
import random
import re
import shutil
import statistics
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from engine.io.session import file_sha256
from hardware.interfaces import Angles
from tests.app.capture.captures import faults_of, order
from tests.app.capture.faulty import (
    capture_among_faults,
    capture_on_emulators,
    kill_until_done,
    seconds_per_pose,
    some_time,
)

POSES_BETWEEN_KILLS = 120
LARGE = 3464  # 24 MB a photograph
NEAR_DEG = 0.05
LONGEST_S = 1.0  # from a start to a kill


def among_faults(folder: Path, poses: int, seed: int) -> int:
    wanted = order(poses)
    start = time.monotonic()
    outcome, happened, stops = capture_among_faults(folder, wanted, seed)
    wrong = faults_of(folder, wanted)
    print(
        f"faults: {outcome.taken} of {poses} poses in {time.monotonic() - start:.1f} s among {sum(happened.values())}"
        f" faults, {stops} of which stopped it with their message; {len(wrong)} shots wrong",
        flush=True,
    )
    for name, count in sorted(happened.items()):
        print(f"    {count:3} {name}")
    return _told(wrong)


def on_emulators(folder: Path, poses: int, firmware: str, seed: int) -> int:
    wanted = order(poses, stops=(0.0,))
    url = f"virtual:{firmware}?speed=50&faults=10&seed={seed}"
    start = time.monotonic()
    stood, messages, stops = capture_on_emulators(folder, wanted, url, "virtual:?size=32x32")

    def stood_at(file: Path, angles: Angles) -> bool:
        true = stood[file_sha256(file)]
        return abs(true.pan_deg - angles.pan_deg) + abs(true.tilt_deg - angles.tilt_deg) < NEAR_DEG

    wrong = faults_of(folder, wanted, stood_at=stood_at)
    print(
        f"emulated {firmware}: {poses} poses in {time.monotonic() - start:.0f} s among {len(messages)} failures, {stops} of"
        f" which stopped it with their message; {len(wrong)} shots wrong",
        flush=True,
    )
    kinds = Counter(re.sub(r"/dev/pts/\d+|-?\d+(\.\d+)?", "#", message)[:110] for message in messages)
    for name, count in kinds.most_common():
        print(f"    {count:3} {name}")
    return _told(wrong)


def among_kills(folder: Path, kills: int, seed: int) -> int:
    wait, done, sessions, bad = some_time(random.Random(seed), LONGEST_S), 0, 0, 0
    start = time.monotonic()
    wanted = order(POSES_BETWEEN_KILLS)
    while done < kills:
        done += kill_until_done(folder, POSES_BETWEEN_KILLS, kills - done, wait)
        sessions += 1
        bad += _told(faults_of(folder, wanted))
        shutil.rmtree(folder)
    print(
        f"kills: {done} in {sessions} captures of {POSES_BETWEEN_KILLS} poses, {time.monotonic() - start:.0f} s;"
        f" no finished shot lost or changed, {bad} captures with wrong shots",
        flush=True,
    )
    return bad


def overhead(folder: Path, poses: int, size: int) -> None:
    wanted = order(poses)
    seconds = []
    for _ in range(3):
        seconds.append(seconds_per_pose(folder, wanted, size))
        shutil.rmtree(folder)
    print(
        f"overhead: {1e3 * statistics.median(seconds):.1f} ms a pose of 3 photographs of {2e-6 * size**2:.3g} MB"
        f" (three runs: {', '.join(f'{1e3 * s:.1f}' for s in seconds)})",
        flush=True,
    )


def _told(wrong: list[str]) -> int:
    for line in wrong[:10]:
        print(f"    WRONG: {line}", flush=True)
    return len(wrong)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--poses", type=int, default=500)
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--emulated", type=int, default=500, help="poses on each emulated controller")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--to", type=Path, help="a folder on the disk to measure; a temporary one if left out"
    )
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=args.to) as scratch:
        folder = Path(scratch) / "session"
        bad = 0
        if args.poses:
            bad += among_faults(folder, args.poses, args.seed)
            shutil.rmtree(folder)
            overhead(folder, 100, 32)
            overhead(folder, 12, LARGE)
        for firmware in ("grbl", "zaber") if args.emulated else ():
            bad += on_emulators(folder, args.emulated, firmware, args.seed)
            shutil.rmtree(folder)
        if args.kills:
            bad += among_kills(folder, args.kills, args.seed)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
