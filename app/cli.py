"""The command line: says what each command takes, runs it, and turns errors into one line and an exit code.

Exit codes: app/exit_codes.py. An exception that is not expected is a bug and keeps its traceback. Rooms are
imported inside the commands, so that help and faults in the command line cost no time.
"""

import argparse
import errno
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app import commands, cores, exports, simulating
from app.exit_codes import ExitCode, code_of
from app.relight.panoramas import NAMES as LIGHTS
from engine.errors import Cancelled, RoomlightError
from engine.pipeline.settings import AUTO, PRESETS, SOLVERS
from hardware.errors import HardwareError

# What the system may say of a name that a person gave, wherever that is first looked at.
_CLOSED = "no permission to open or enter it; change its permissions or choose another"
_UNFIT = {
    errno.EACCES: _CLOSED,
    errno.EPERM: _CLOSED,
    errno.ENAMETOOLONG: "the name is longer than this disk allows; choose a shorter one",
}


def main(argv: Sequence[str] | None = None) -> int:
    cores.prepare()
    args = _parser().parse_args(_joined(sys.argv[1:] if argv is None else argv))
    try:
        return args.run(args)
    except (Cancelled, KeyboardInterrupt):
        print("stopped; run again to resume", file=sys.stderr)
        return ExitCode.STOPPED
    except (RoomlightError, HardwareError) as error:
        print(f"roomlight: {' '.join(str(error).split())}", file=sys.stderr)
        return code_of(error)
    except BrokenPipeError:
        # The reader of our output left, as `roomlight plan ... | head` does; there is nobody to tell.
        sys.stderr.close()
        return ExitCode.DONE
    except OSError as error:
        if error.errno not in _UNFIT:
            raise
        print(f"roomlight: {error.filename}: {_UNFIT[error.errno]}", file=sys.stderr)
        return ExitCode.REFUSED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="roomlight",
        description="Recovers shape and reflectance of an object from the light of the room it stands in.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show program's version number and exit")
    add = parser.add_subparsers(dest="command", required=True, metavar="COMMAND").add_parser

    to_import = add("import", help="make a session of a folder of photographs")
    to_import.add_argument("folder", type=Path, help="RAW files, or linear EXR/HDR images")
    to_import.add_argument("session", type=Path, help="the session to make")
    to_import.add_argument("--poses", type=Path, help="transforms.json, COLMAP model folder or Metashape XML")
    to_import.add_argument("--mask", type=Path, help="PNG of the photographs' size, white on the object")
    to_import.add_argument("--bracket", type=_bracket, default=None, help="exposures a view, or auto")
    to_import.set_defaults(run=commands.run_import)

    process = add("process", help="run every stage that is not done")
    _add_session(process)
    _add_settings(process, (*PRESETS, AUTO))
    process.add_argument(
        "--budget",
        metavar="TIME",
        help="the richest preset that is expected to fit, as in 90s, 3min, 1h",
    )
    process.add_argument(
        "--without", type=_words, metavar="VIEW,VIEW",
        help="leave these photographs out, by name or number, as in 3,17, now and in later runs; none puts all back",
    )  # fmt: skip
    process.add_argument(
        "--scale", type=_scale, metavar="X,Y,X,Y=LENGTH",
        help="the true distance of two points of the object, as in 120,80,300.5,82=150mm: pixels of the photographs as they stand"
        " upright, from the upper left corner; now and in later runs; none removes it",
    )  # fmt: skip
    process.add_argument(
        "--until", metavar="STAGE|DEG",
        help="stop after this stage; or climb the presets until normals are known as well as this, as 0.5deg",
    )  # fmt: skip
    process.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"))
    process.add_argument(
        "--strict",
        action="store_true",
        help="exit code 3 where the result is not good (see the line quality:)",
    )
    process.set_defaults(run=commands.run_process)

    batch = add("batch", help="process many sessions side by side, here or on a cluster")
    _add_sessions(batch)
    _add_settings(batch)
    batch.add_argument("--until", metavar="STAGE", help="stop after this stage")
    batch.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"))
    batch.add_argument("--strict", action="store_true", help="exit code 3 where a result is not good")
    batch.add_argument(
        "--plan",
        action="store_true",
        help="say what would run, why, how long and in how much memory; changes nothing",
    )
    batch.set_defaults(run=commands.run_batch)

    pack = add("pack", help="write a session as one file, to hand over or archive")
    _add_session(pack)
    pack.add_argument("bundle", type=Path, metavar="FILE.zip")
    pack.add_argument(
        "--without-raw", action="store_true",
        help="leave the photographs out: results can be looked at, exported and relit, but not computed anew",
    )  # fmt: skip
    pack.set_defaults(run=commands.run_pack)
    unpack = add("unpack", help="make a session of such a file; every byte is checked")
    unpack.add_argument("bundle", type=Path, metavar="FILE.zip")
    unpack.add_argument("session", type=Path, help="the session to make")
    unpack.set_defaults(run=commands.run_unpack)

    plan = add("plan", help="say which stages would run and why; changes nothing")
    _add_session(plan)
    _add_settings(plan)
    plan.add_argument("--json", action="store_true", help="print JSON")
    plan.set_defaults(run=commands.run_plan)

    simulate = add("simulate", help="photograph a virtual object in a virtual room: OUT/session, OUT/truth")
    simulating.add_options(simulate)
    simulate.set_defaults(run=commands.run_simulate)

    _add_capture(add("capture", help="photograph an object pose by pose with a rig and a camera"))
    _add_rig(add("rig", help="list ports and cameras; ask, home, move or stop a rig"))

    export = add("export", help="write the results as EXR, PNG, PLY, GLB, COLMAP and transforms.json")
    _add_sessions(export)
    export.add_argument(
        "--to", type=Path, required=True, help="folder to write to; of several sessions DIR/NAME for each"
    )
    export.add_argument(
        "--normals",
        choices=("opengl", "directx"),
        help="green of the PNG normal maps up, or down; as processed, or as the program of --for wants it",
    )
    export.add_argument(
        "--for",
        dest="target",
        choices=tuple(exports.TARGETS),
        help="only what this program reads; all files if left out",
    )
    export.set_defaults(run=commands.run_export)

    relight = add(
        "relight", help="draw the surface under another light: a picture, a video, a page to give away"
    )
    _add_session(relight)
    relight.add_argument(
        "out", type=Path, help="OUT.png, .exr, .mp4, .html, or a folder for the video's frames as PNG"
    )
    relight.add_argument(
        "--light", default="", metavar="NAME|FILE", help=f"{', '.join(LIGHTS)}, or a panorama; as recovered"
    )
    relight.add_argument("--turn", type=float, default=0.0, metavar="DEG", help="turn the light to the right")
    relight.add_argument("--room", type=float, default=1.0, metavar="X", help="so many times as bright")
    relight.add_argument(
        "--lamp",
        type=float,
        nargs=2,
        metavar=("RIGHT", "UP"),
        help="a lamp on a half sphere before it; 1 is its rim",
    )
    relight.add_argument(
        "--lamp-strength", type=float, default=1.0, metavar="X", help="1 lights white paint white"
    )
    relight.add_argument("--ev", type=float, default=0.0, help="exposure")
    relight.add_argument("--behind", action="store_true", help="show the light behind the object")
    relight.add_argument("--seconds", type=float, default=8.0, metavar="S", help="of a video")
    relight.set_defaults(run=commands.run_relight)

    report = add("report", help="write one self-contained HTML page about the results")
    _add_sessions(report)
    report.add_argument(
        "--to", type=Path,
        help="HTML file; of several sessions a folder of NAME.html; SESSION/exports/report.html if left out",
    )  # fmt: skip
    report.add_argument("--truth", type=Path, help="a ground truth to show the errors against")
    report.set_defaults(run=commands.run_report)

    catalogue = add("catalogue", help="write an index of many sessions: one page with pictures, CSV and JSON")
    _add_places(catalogue)
    catalogue.add_argument("--to", type=Path, required=True, metavar="DIR", help="folder to write to")
    catalogue.add_argument("--title", default="Roomlight", help="heading of the page")
    catalogue.set_defaults(run=commands.run_catalogue)

    evaluate = add("evaluate", help="compare the results with a ground truth")
    _add_session(evaluate)
    evaluate.add_argument("truth", type=Path, help="a studio's truth folder, or an .npz")
    evaluate.add_argument("--json", action="store_true", help="print JSON")
    evaluate.set_defaults(run=commands.run_evaluate)

    demo = add("demo", help="process the bundled session from RAW to report")
    demo.add_argument("--to", type=Path, default=Path("out/demo"), help="folder to work in")
    demo.add_argument("--preset", choices=PRESETS, default=None)
    demo.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"))
    demo.set_defaults(run=commands.run_demo)

    _add_bench(add("bench", help="measure accuracy and speed on virtual sets, as tables and a chart"))

    gui = add("gui", help="open the window")
    gui.add_argument("session", type=Path, nargs="?", help="a session to open")
    gui.set_defaults(run=commands.run_gui)
    return parser


def _add_capture(capture: argparse.ArgumentParser) -> None:
    _add_session(capture)
    capture.add_argument(
        "--rig", metavar="URL", help="as virtual:, grbl:///dev/ttyUSB0, manual:; see docs/capture.md"
    )
    capture.add_argument("--camera", metavar="URL", help="as virtual:, gphoto2:, folder:/path")
    capture.add_argument("--plan", type=Path, metavar="FILE", help="CSV with the line pan_deg,tilt_deg first")
    capture.add_argument(
        "--poses", type=int, metavar="N", help="so many poses, spread over what the rig can reach"
    )
    capture.add_argument(
        "--resume", action="store_true", help="go on with a capture; --rig and --camera may differ"
    )
    capture.add_argument(
        "--bracket", type=_stops, metavar="EV,EV,...", help="exposures of a pose; -3,0,3 if left out"
    )
    capture.add_argument(
        "--shutter", type=_seconds, metavar="S", help="at 0 EV, as 1/60 or 0.5; as the camera has it"
    )
    capture.add_argument("--iso", type=int, help="as the camera has it if left out")
    capture.add_argument(
        "--aperture", type=float, metavar="F", help="f-number; as the camera has it if left out"
    )
    capture.add_argument(
        "--settle", type=float, metavar="S", help="seconds from standing still to the first exposure"
    )
    capture.add_argument(
        "--geometry", type=Path, metavar="FILE", help="TOML that says where the rig's axes are"
    )
    _add_at_zero(capture, "on --resume: ")
    capture.add_argument(
        "--any-format", action="store_true", help="keep photographs that process cannot use, as JPEG"
    )
    capture.add_argument(
        "--helpful-first",
        action="store_true",
        help="take next what shows most of the room that no shot has shown; else in the plan's order",
    )
    capture.set_defaults(run=commands.run_capture)


def _add_at_zero(order: argparse.ArgumentParser, when: str = "") -> None:
    order.add_argument(
        "--at-zero", action="store_true", help=f"{when}a rig that cannot find its zero was put there by hand"
    )


def _add_rig(rig: argparse.ArgumentParser) -> None:
    rig.set_defaults(run=commands.run_rig)
    add = rig.add_subparsers(dest="order", required=True, metavar="ORDER").add_parser
    add("list", help="ports and cameras that are plugged in")
    for name, text in (
        ("status", "what it is and where it stands; cameras too"),
        ("home", "find the zero of every axis"),
        ("move", "go to angles"),
        ("stop", "stop at once"),
    ):
        order = add(name, help=text)
        order.add_argument("url", metavar="URL", help="as grbl:///dev/ttyUSB0")
        if name == "move":
            order.add_argument("--pan", type=float, metavar="DEG", help="stays as it is if left out")
            order.add_argument("--tilt", type=float, metavar="DEG", help="stays as it is if left out")
            _add_at_zero(order)


def _add_bench(bench: argparse.ArgumentParser) -> None:
    bench.set_defaults(run=commands.run_bench)
    add = bench.add_subparsers(dest="what", required=True, metavar="WHAT").add_parser
    for name, text in (
        ("table", "normals, albedo and roughness of every solver, object by object"),
        ("views", "the same with fewer and more photographs"),
        ("ablation", "the same with one part of the solver taken away after the other; a chart"),
        ("chart", "error against seconds: PNG, SVG, CSV"),
        ("scaling", "seconds and memory against views, pixels, Gaussians and directions; a chart"),
        ("pipeline", "seconds and memory of every stage from RAW files on, at four sizes; a chart"),
        (
            "economy",
            "what scenes of known need ask of the model, and what each preset and part buys; a chart",
        ),
        ("stress", "good sets made worse step by step: where it breaks, and whether it knows; a heat map"),
    ):
        order = add(name, help=text)
        if name == "pipeline":
            _add_pipeline(order)
        else:
            _add_size(order)
        if name not in ("views", "pipeline"):
            order.add_argument(
                "--poses", choices=("given", "estimated"),
                help="the truth's poses and mask, or those found from the RAW files; as the size has it if left out",
            )  # fmt: skip
        if name == "economy":
            _add_economy(order)
        else:
            order.add_argument(
                "--rooms", type=_names, nargs="+", action=_Together, metavar="ROOM",
                help="names, or Mitsuba 3 scene files; as the size has them if left out",
            )  # fmt: skip
            order.add_argument(
                "--objects", type=_names, nargs="+", action=_Together, metavar="OBJECT",
                help="names, or meshes: OBJ, PLY, GLB",
            )  # fmt: skip
            simulating.add_object_options(order, "a built-in object keeps its own;")
        order.add_argument(
            "--sets",
            type=Path,
            metavar="FOLDER",
            help="where sets and finished rows are kept; a cache if left out",
        )
        order.add_argument("--json", type=Path, metavar="FILE", help="write the measurement as JSON")
        order.add_argument("--gate", type=Path, metavar="BASELINE", help="exit code 1 if a metric got worse")
        order.add_argument(
            "--write-baseline", type=Path, metavar="FILE", help="write what --gate compares with"
        )
        order.add_argument("--fresh", action="store_true", help="measure again what is kept of earlier runs")
        order.add_argument("--seed", type=int, default=0, help="of the sets and the solvers")
        order.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"))
        if name not in ("scaling", "pipeline", "economy"):
            few = name == "stress"
            order.add_argument(
                "--methods",
                type=_names,
                default=("far_field",) if few else (),
                metavar="KEY,KEY",
                help=f"only these rows{' beside ours; far_field' if few else '; all'} if left out",
            )
            order.add_argument(
                "--reference-pixels", type=int, metavar="N",
                help="pixels that the reference solves at least, a multiple of 16: its seconds are extrapolated",
            )  # fmt: skip
        if name == "table":
            order.add_argument(
                "--from", dest="records", type=Path, nargs="+", metavar="RECORD",
                help="measure nothing: the table of these records of --json, each of other rooms or objects",
            )  # fmt: skip
        if name in ("ablation", "stress", "pipeline"):
            order.add_argument("--preset", choices=PRESETS, default="standard", help="of our solver")
        if name == "stress":
            order.add_argument(
                "--dials", type=_names, default=(), metavar="NAME,NAME", help="only these; all if left out"
            )
            order.add_argument(
                "--steps", type=int, nargs="+", choices=range(1, 6), default=[1, 2, 3, 4, 5], metavar="N",
                help="from 1, harmless, to 5, hopeless",
            )  # fmt: skip
        if name in ("table", "chart"):
            order.add_argument(
                "--maps",
                action="append",
                default=[],
                metavar="NAME=FOLDER",
                help="one more row: maps computed elsewhere, in FOLDER/ROOM-OBJECT/normal.exr and the like",
            )
            order.add_argument(
                "--maps-frame", choices=("opengl", "opencv"), default="opengl", help="axes of their normals"
            )
        if name in ("chart", "ablation", "scaling", "stress", "pipeline", "economy"):
            order.add_argument("--out", type=Path, default=Path("out/bench"), help="folder to draw into")


def _add_size(order: argparse.ArgumentParser) -> None:
    size = order.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="tiny sets: tries the machinery in minutes")
    size.add_argument("--size", choices=("tiny", "small", "standard"), default="standard", help="of the sets")
    size.add_argument(
        "--suite", choices=("paper", "paper-small"),
        help="the paper's protocol: 150 HDR images of 512 x 512; or its twin, 96 brackets of RAW files of 512 x 384",
    )  # fmt: skip


def _add_economy(order: argparse.ArgumentParser) -> None:
    order.set_defaults(
        size="tiny", rooms=(), objects=(), place=None, material=None, object_size=None, turn=None
    )
    order.add_argument(
        "--scenes", type=_names, default=(), metavar="NAME,NAME", help="only these; all if left out"
    )
    order.add_argument("--noise", type=float, default=0.015, metavar="SHARE", help="of the path tracer")


def _add_pipeline(order: argparse.ArgumentParser) -> None:
    order.set_defaults(quick=False, suite=None, size="standard")
    order.add_argument(
        "--sizes", nargs="+", choices=("small", "standard", "large", "real"), default=["small", "standard", "large"],
        help="of the photographs: 48 x 320 x 240, 96 x 512 x 384, 150 x 616 x 462, or 100 brackets of 6000 x 4000 (8 GB)",
    )  # fmt: skip
    order.add_argument(
        "--views", type=_count, metavar="N", help="photographs of each size; its own if left out"
    )
    order.add_argument(
        "--beside",
        nargs="+",
        default=(),
        metavar="colmap|PROGRAM",
        help="COLMAP's exhaustive and sequential routes on the same photographs too; or another roomlight's `process`, such as "
        "that of an earlier version",
    )


class _Version(argparse.Action):
    """Looked up where it is asked for: the library that knows takes longer to load than all of this."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        from importlib.metadata import version

        print(f"roomlight {version('roomlight')}")
        parser.exit()


class _Together(argparse.Action):
    """The tuples of several words as one."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        setattr(namespace, self.dest, tuple(name for names in values for name in names))


def _names(text: str) -> tuple[str, ...]:
    """Names with commas between; or one file's, whatever it is called."""
    if Path(text).is_file():
        return (text,)
    names = tuple(word.strip() for word in text.split(","))
    if not all(names) or len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f"{text!r}: give different names with commas, as in study,lamps")
    return names


def _words(text: str) -> tuple[str, ...]:
    """Words with commas between; the word none is no word."""
    return tuple(word.strip() for word in text.split(",") if word.strip()) if text != "none" else ()


def _scale(text: str) -> tuple[float, ...]:
    """x and y of two points, and the metres between them; the word none is no scale."""
    if text == "none":
        return ()
    places, _, length = text.partition("=")
    number = length.rstrip("cm")
    try:
        points = tuple(float(part) for part in places.split(","))
        metres = float(number) * {"mm": 1e-3, "cm": 1e-2, "m": 1.0}[length[len(number) :]]
    except (ValueError, KeyError):
        points, metres = (), 0.0
    if len(points) != 4:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no scale; write X,Y,X,Y=LENGTH, as in 120,80,300.5,82=150mm (mm, cm or m), or none"
        )
    return *points, metres


def _add_session(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path)


def _add_sessions(parser: argparse.ArgumentParser) -> None:
    """One session or many, and who works on many."""
    _add_places(parser)
    parser.add_argument(
        "--where", choices=("new", "unfinished", "stale", "done"),
        help="only sessions that stand so: new: no stage has run; stale: settings, inputs or versions changed since",
    )  # fmt: skip
    parser.add_argument(
        "--workers", type=_count, metavar="N", help="sessions at once; as cores and memory allow if left out"
    )
    parser.add_argument(
        "--memory",
        type=_gigabytes,
        metavar="GB",
        help="of all workers together; four fifths of what is free if left out",
    )
    place = parser.add_mutually_exclusive_group()
    place.add_argument(
        "--scheduler", metavar="ADDRESS", help="a running cluster of dask.distributed, as tcp://head:8786"
    )
    place.add_argument("--slurm", action="store_true", help="workers are jobs of Slurm's, --workers at most")
    job = parser.add_argument_group(
        "a job of Slurm's", "as dask's configuration says (jobqueue.slurm) if left out"
    )
    job.add_argument("--partition", metavar="NAME")
    job.add_argument("--account", metavar="NAME")
    job.add_argument("--walltime", metavar="TIME", help="as 4:00:00; longer than a session's longest stage")
    job.add_argument("--cores", type=_count, metavar="N", help="of each job")
    parser.add_argument("--json", action="store_true", help="print JSON, and progress on stderr")


def _add_places(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "sessions",
        type=Path,
        nargs="+",
        metavar="SESSION",
        help="sessions, or folders that hold them at any depth",
    )


def _add_settings(parser: argparse.ArgumentParser, presets: Sequence[str] = PRESETS) -> None:
    """What changes params.toml; left out, what is written there holds."""
    parser.add_argument("--preset", choices=presets, default=None)
    parser.add_argument(
        "--solver",
        choices=SOLVERS,
        default=None,
        help="of the surface: ours, or the paper's as published (hours)",
    )
    parser.add_argument("--seed", type=int, default=None)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="STAGE.PARAM=VALUE",
        help="as in surface.directions=2048",
    )


def _joined(words: Sequence[str]) -> list[str]:
    """`--bracket -3,0,3` as one word: argparse takes what begins with a minus for an option."""
    joined: list[str] = []
    for word in words:
        if joined and joined[-1] == "--bracket" and word.startswith("-"):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _count(text: str) -> int:
    if not (text.isdigit() and int(text) >= 1):
        raise argparse.ArgumentTypeError(f"{text!r} is no count; give 1 or more")
    return int(text)


def _gigabytes(text: str) -> float:
    try:
        gigabytes = float(text)
    except ValueError:
        gigabytes = 0.0
    if not 0 < gigabytes < 1e6:
        raise argparse.ArgumentTypeError(f"{text!r} is no amount of memory; write gigabytes, as in 16")
    return gigabytes


def _stops(text: str) -> tuple[float, ...]:
    from app.capture.wanted import CaptureError, parse_stops

    try:
        return parse_stops(text)
    except CaptureError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _seconds(text: str) -> float:
    top, slash, bottom = text.partition("/")
    try:
        seconds = float(top) / float(bottom if slash else 1)
    except (ValueError, ZeroDivisionError):
        seconds = 0.0
    if not 0 < seconds < 3600:
        raise argparse.ArgumentTypeError(f"{text!r} is no shutter time; write it as in 1/60 or 0.5")
    return seconds


def _bracket(text: str) -> int | None:
    if text == "auto":
        return None
    if text.isdigit() and int(text) >= 1:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is neither auto nor a number of exposures")


if __name__ == "__main__":
    sys.exit(main())
