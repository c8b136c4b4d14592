"""`roomlight rig`: what is plugged in, and one rig asked, homed, moved or stopped by hand."""

import contextlib
import signal
import threading
from argparse import Namespace
from collections.abc import Callable, Iterator
from types import FrameType

from hardware import find
from hardware.errors import AbsentError, HardwareError
from hardware.interfaces import Angles, Axis, Camera, Motion, MotionStatus, State
from hardware.rig import find_zero


def run(args: Namespace) -> int:
    """
    Raises:
        HardwareError: what the device says; exit code 2.
    """
    if args.order == "list":
        return _list()
    if args.order == "status" and args.url.partition(":")[0] in find.CAMERAS.keys() - find.RIGS.keys():
        with contextlib.closing(find.open_camera(args.url)) as camera:
            _tell_camera(camera)
        return 0
    with contextlib.closing(find.open_motion(args.url)) as motion:
        match args.order:
            case "status":
                _tell(motion)
            case "home":
                stands = _angles(_ordered(motion, motion.home))
                print(
                    f"{motion.name}: {'stands at' if motion.features.homes else 'takes where it stands for'} {stands}"
                )
            case "move":
                _move(motion, args.pan, args.tilt, args.at_zero)
            case _:
                motion.stop()
                print(f"{motion.name}: stopped; {_state(motion.status())}")
    return 0


def _move(motion: Motion, pan: float | None, tilt: float | None, at_zero: bool) -> None:
    """What is left out stays as it is. Opening its port makes many a rig forget where it stands: it homes first then."""
    status, homes = motion.status(), motion.features.homes
    if status.state in (State.UNHOMED, State.FAULT) or (at_zero and not homes):
        if homes:
            print(f"{motion.name}: does not know where it stands; homing first")
        _ordered(motion, lambda: find_zero(motion, at_zero, "move"))
        status = motion.status()
    now = status.angles or Angles(0.0)
    axes = {axis.name: axis for axis in motion.features.axes}
    wanted = Angles(
        within(now.pan_deg, axes.get("pan")) if pan is None else pan,
        within(now.tilt_deg, axes.get("tilt")) if tilt is None else tilt,
    )
    print(f"{motion.name}: stands at {_angles(_ordered(motion, lambda: motion.move(wanted)))}")


def within(angle_deg: float, axis: Axis | None) -> float:
    """The angle, or the end of the travel next to it: switches for homing may lie beyond."""
    if axis is None or axis.lowest_deg is None or axis.highest_deg is None:
        return angle_deg
    return min(max(angle_deg, axis.lowest_deg), axis.highest_deg)


def _list() -> int:
    ports = find.ports()
    for port in ports:
        kind = f"{port.likely or 'grbl'}://{port.path}"
        print(f"rig     {kind:32} {port.description}{'' if port.likely else ' (if it is one)'}")
    if not ports:
        print("rig     no serial port has anything plugged in; manual: and none: need none")
    for url, model in _cameras():
        print(f"camera  {url:32} {model}")
    print("        virtual:                         a rig and a camera without hardware")
    return 0


def _cameras() -> list[tuple[str, str]]:
    from hardware.camera import body as gphoto_body

    try:
        found = gphoto_body.detect()
    except AbsentError as error:
        return [("folder:/path/to/tethered", f"any camera with a tether program ({error})")]
    listed = [(f"gphoto2:{camera.port}", camera.model) for camera in found]
    return [*listed, ("folder:/path/to/tethered", "any camera with a tether program")]


def _tell(motion: Motion) -> None:
    print(motion.name)
    features = motion.features
    for axis in features.axes:
        print(
            f"  {axis.name:5} {_travel(axis)}, {axis.resolution_deg:.3g} degrees fine, up to {axis.fastest_deg_s:.3g} degrees/s"
        )
    words = [
        "moves by itself" if features.automatic else "is turned by a person",
        "finds its zero" if features.homes else "cannot find its zero",
        "can pause in motion" if features.holds else "",
    ]
    print(f"  {', '.join(filter(None, words)) if features.axes else 'nothing turns'}")
    print(f"  {_state(motion.status())}")


def _tell_camera(camera: Camera) -> None:
    features, status = camera.features, camera.status()
    print(camera.name)
    shutters = (
        f"shutters {features.shutters_s[0]:.3g} to {features.shutters_s[-1]:.3g} s"
        if features.shutters_s
        else ""
    )
    words = [features.suffix and f"writes {features.suffix}", shutters]
    print(f"  {', '.join(filter(None, words)) or 'tells nothing of its settings'}")
    told = ["ready" if status.ready else "not ready", status.message]
    told += [f"battery {status.battery:.0%}"] if status.battery is not None else []
    told += [f"room for {status.free_shots} photographs"] if status.free_shots is not None else []
    print(f"  {', '.join(filter(None, told))}")


def _travel(axis: Axis) -> str:
    if axis.lowest_deg is None or axis.highest_deg is None:
        return "turns endlessly"
    return f"{axis.lowest_deg:.4g} to {axis.highest_deg:.4g} degrees"


def _state(status: MotionStatus) -> str:
    words = [status.state.value, f"at {_angles(status.angles)}" if status.angles else "", status.message]
    return ", ".join(word for word in words if word)


def _angles(angles: Angles) -> str:
    return f"pan {angles.pan_deg:.3f}, tilt {angles.tilt_deg:.3f} degrees"


def _ordered(motion: Motion, order: Callable[[], Angles]) -> Angles:
    """Give an order in a thread of its own, so that Ctrl-C stops the rig and not only this program."""
    ended: list[Angles | HardwareError] = []

    def work() -> None:
        try:
            ended.append(order())
        except HardwareError as error:
            ended.append(error)

    thread = threading.Thread(target=work, name="order", daemon=True)
    with _stopping() as asked:
        thread.start()
        while thread.is_alive():
            thread.join(0.05)
            if asked.is_set():
                asked.clear()
                motion.stop()
    result = ended[0]
    if isinstance(result, HardwareError):
        raise result
    return result


@contextlib.contextmanager
def _stopping() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets."""
    asked = threading.Event()

    def hear(number: int, frame: FrameType | None) -> None:
        asked.set()

    before = signal.signal(signal.SIGINT, hear)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)
