"""What each command of the command line does: calls the rooms and prints what matters."""

import json
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.changes import Changes, changes_of, open_changed
from app.exit_codes import ExitCode
from engine.pipeline.settings import AUTO, PRESETS, SOLVERS

if TYPE_CHECKING:
    from engine.pipeline.stages import Step
    from engine.results.quality import Quality


def run_import(args: Namespace) -> int:
    from app import terminal
    from engine import importing
    from engine.io import session

    with terminal.quiet(), terminal.job("import") as progress:
        made = importing.make_session(
            args.folder, args.session, args.poses, args.mask, args.bracket, progress
        )
    views = session.shots(made)
    print(
        f"{args.session}: {len(views)} views of {len(views[0].files)} exposure(s),"
        f" {made.facts['camera']['width']} x {made.facts['camera']['height']}"
    )
    for note in session.notes(made):
        print(f"note: {note}")
    print(importing.describe_poses(made))
    print(f"next: roomlight process {args.session}")
    return 0


def run_pack(args: Namespace) -> int:
    from app import terminal
    from engine.io import bundle, session

    with terminal.job("pack") as progress:
        count = bundle.pack(session.open_session(args.session), args.bundle, not args.without_raw, progress)
    print(f"{args.bundle}: {count} files, {args.bundle.stat().st_size / 1e6:.1f} MB")
    return 0


def run_unpack(args: Namespace) -> int:
    from app import terminal
    from engine.io import bundle

    with terminal.job("unpack") as progress:
        bundle.unpack(args.bundle, args.session, progress)
    print(f"{args.session}: every file is as it was packed\nnext: roomlight process {args.session}")
    return 0


def run_plan(args: Namespace) -> int:
    from engine.pipeline import stages

    if args.json:
        from app.batch import agenda

        entry = agenda.entry(args.session, str(args.session), changes_of(args))
        print(json.dumps(entry.content(), indent=1))
        return ExitCode.DONE
    asked = open_changed(args.session, changes_of(args))
    steps = stages.plan(asked.session, asked.rows, asked.settings)
    for note in asked.settings.notes:
        print(f"note: {note}")
    for step in steps:
        print(f"{step.stage.name:8} {step.fingerprint}  {step.tell()}")
    return ExitCode.DONE


def run_process(args: Namespace) -> int:
    from app import auto
    from engine.errors import SessionError

    if args.without is not None:
        leave_out(args.session, args.without)
    if args.scale is not None:
        set_scale(args.session, args.scale)
    choosing = args.budget is not None or auto.asks_for_error(args.until)
    if args.preset == AUTO or (choosing and args.preset is None):
        verdict = process_auto(args)
    elif choosing:
        raise SessionError(f"--budget and --until DEG choose the preset; leave out --preset {args.preset}")
    else:
        verdict = process(args.session, changes_of(args), args.until, args.device)
    doubted = args.strict and verdict is not None and not verdict.good
    return ExitCode.DOUBTED if doubted else ExitCode.DONE


def leave_out(folder: Path, words: Sequence[str]) -> None:
    """Leave out exactly the photographs that these words mean, from now on: names, or numbers from 1."""
    from engine.errors import SessionError
    from engine.io import left_out, session

    opened = session.open_session(folder)
    views = [shot.name for shot in session.shots(opened)]
    meant = {str(number): name for number, name in enumerate(views, 1)} | {name: name for name in views}
    if unknown := [word for word in words if word not in meant]:
        raise SessionError(
            f"--without {unknown[0]}: there is no such photograph; give numbers from 1 to {len(views)}, or names such as"
            f" {', '.join(views[:1])}"
        )
    names = {meant[word] for word in words}
    left_out.write(opened, names, views)
    print(f"left out: {', '.join(name for name in views if name in names) or 'none'}")


def set_scale(folder: Path, given: tuple[float, ...]) -> None:
    """x and y of two points of the upright photographs and the metres between them, from now on; nothing: no longer known."""
    from app import results
    from engine.io import scale_edit, session
    from engine.io.scale_edit import ScaleBar
    from engine.orientation import size

    opened = session.open_session(folder)
    if not given:
        scale_edit.write(opened, None)
        print("scale: none")
        return
    ax, ay, bx, by, metres = given
    camera = opened.facts["camera"]
    upright = size((camera["width"], camera["height"]), opened.orientation)
    bar = ScaleBar(((ax, ay), (bx, by)), upright, metres)
    results.check_scale(folder, bar)
    scale_edit.write(opened, bar)
    print(f"scale: {1000 * metres:g} mm from {ax:g}, {ay:g} to {bx:g}, {by:g}")


def process_auto(args: Namespace) -> "Quality | None":
    """Climb the presets as far as they pay and the budget allows; the session is left at the one that stays."""
    import os

    from app import auto, results
    from app.batch import agenda
    from engine.errors import SessionError

    goal = auto.goal_of(args.budget, args.until)
    asked, cores = changes_of(args), len(os.sched_getaffinity(0))
    if (solver := open_changed(args.session, replace(asked, preset=None)).settings.solver) != SOLVERS[0]:
        raise SessionError(
            f"only presets of solver {SOLVERS[0]} are chosen so; add --solver {SOLVERS[0]}, or name a preset of {solver}"
        )

    def predict(preset: str) -> float:
        return agenda.entry(args.session, "", replace(asked, preset=preset), None, cores).cost.seconds

    def reach(preset: str) -> auto.Rung:
        run_stages(args.session, replace(asked, preset=preset), "surface", args.device)
        return results.rung(args.session, preset)

    print("auto: " + ", ".join(f"{preset} in about {predict(preset):.0f} s" for preset in PRESETS))
    stays = auto.climb(PRESETS, goal, reach, predict, lambda words: print(f"auto: {words}"))
    return process(args.session, replace(asked, preset=stays.preset), None, args.device)


def process(
    folder: Path, changes: Changes, until: str | None = None, device: str = "auto"
) -> "Quality | None":
    """Run the stages with bars; what was asked is kept in params.toml: a resumed run needs no options.

    Returns the verdict of the result; None where there is no surface, or not one of our solver.
    """
    steps = run_stages(folder, changes, until, device)
    ran, verdict = [step.stage.name for step in steps if not step.done], None
    if any(step.stage.name == "surface" for step in steps):
        from app import results
        from app.quality import quality_of

        verdict = quality_of({step.stage.name: step.folder for step in steps})
        for line in results.cautions(folder):
            print(f"careful: {line}")
        if verdict is not None:
            print(f"quality: {verdict}")
    print(f"{folder}: {', '.join(ran)} done" if ran else f"{folder}: nothing to do, every stage is done")
    return verdict


def run_stages(folder: Path, changes: Changes, until: str | None, device: str) -> "tuple[Step, ...]":
    """Run what is not done, with bars."""
    from rich.console import Console

    from app import terminal
    from engine.pipeline import run

    asked = open_changed(folder, changes)
    for note in asked.settings.notes:
        print(f"note: {note}")
    with terminal.stoppable() as cancelled, terminal.Display(Console()) as display:
        watcher = run.Watcher(
            lambda step: display.begin(step.stage.name),
            lambda step, fraction, note: display.move(fraction, note),
            lambda step, seconds: display.end(seconds),
            cancelled,
        )
        return run.process(asked.session, asked.rows, asked.settings, device, until, watcher)


def run_simulate(args: Namespace) -> int:
    from app import simulating, studio, terminal

    request = simulating.asked(args)
    with terminal.job("simulate") as progress:
        notes = studio.simulate(request.out, request.order, request.vignetting, progress)
    for note in notes:
        print(note)
    print(f"{args.out}/session: {args.views} views of {args.object} in {args.room}, {args.motion}")
    print(f"next: roomlight process {args.out}/session")
    print(f"      roomlight evaluate {args.out}/session {args.out}/truth")
    return 0


def run_capture(args: Namespace) -> int:
    from app.capture import command as capture_command

    return capture_command.run(args)


def run_rig(args: Namespace) -> int:
    from app import rigs

    return rigs.run(args)


def run_batch(args: Namespace) -> int:
    from app.batch import command

    return command.run_batch(args)


def run_export(args: Namespace) -> int:
    from app import exports
    from engine.results import export

    green = export.GREEN[args.normals] if args.normals else None
    if green is None and args.target is not None:
        green = exports.TARGETS[args.target].green
    if not _is_one(args.sessions):
        from app.batch import command

        return command.run_export(args, green)
    from app import results

    finished = results.finished(args.sessions[0], "export").folder
    files = exports.files_for(finished, args.target) if args.target is not None else None
    export.copy(finished, args.to, green, files)
    print(f"{args.to}: exported from {args.sessions[0]}")
    return ExitCode.DONE


def run_relight(args: Namespace) -> int:
    from app import terminal
    from app.relight import panoramas, pictures

    if args.seconds <= 0:
        from engine.errors import SessionError

        raise SessionError(
            f"--seconds {args.seconds:g}: a video lasts longer than that; give a number above 0"
        )
    light = str(panoramas.file(args.light)) if args.light in panoramas.NAMES else args.light
    lamp = args.lamp and tuple(args.lamp)
    wish = pictures.Wish(
        str(args.session), str(args.out), light, setting={"yaw_deg": args.turn, "room": args.room, "spot": lamp},
        spot=args.lamp_strength, exposure_ev=args.ev, room=args.behind, seconds=args.seconds,
    )  # fmt: skip
    with terminal.job("relight") as progress:
        print(pictures.make(wish, progress))
    return ExitCode.DONE


def run_report(args: Namespace) -> int:
    if not _is_one(args.sessions):
        from app.batch import command

        if args.truth:
            from engine.errors import SessionError

            raise SessionError("--truth: is of one session; give its report alone")
        return command.run_report(args)
    from app import results

    print(results.write_report(args.sessions[0], args.to, args.truth))
    return ExitCode.DONE


def _is_one(places: Sequence[Path]) -> bool:
    """One place that is a session, or should be; several, and folders of sessions, are done side by side."""
    place = places[0]
    return len(places) == 1 and ((place / "session.json").is_file() or not any(place.rglob("session.json")))


def run_catalogue(args: Namespace) -> int:
    from app.catalogue import command

    return command.run(args)


def run_evaluate(args: Namespace) -> int:
    from app import results

    scores = results.evaluate(args.session, args.truth)
    print(json.dumps(scores, indent=1) if args.json else results.told(scores))
    return 0


def run_demo(args: Namespace) -> int:
    from app import demo

    return demo.run(args.to, args.preset, args.device)


def run_bench(args: Namespace) -> int:
    from app.bench import command

    return command.run(args)


def run_gui(args: Namespace) -> int:
    from app.views import application

    return application.run(args.session)
