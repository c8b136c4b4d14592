"""What each command of the command line does: opens the session, calls the rooms, prints what matters."""

from argparse import Namespace
from pathlib import Path

from rich.console import Console

from app import terminal
from engine.pipeline import settings as asked


def run_import(args: Namespace) -> int:
    from engine import importing, session

    with terminal.job("import") as progress:
        made = importing.make_session(
            args.folder, args.session, args.poses, args.mask, args.bracket, progress
        )
    views = session.shots(made)
    print(
        f"{args.session}: {len(views)} views of {len(views[0].files)} exposure(s),"
        f" {made.facts['camera']['width']} x {made.facts['camera']['height']}"
    )
    print(f"next: roomlight process {args.session}")
    return 0


def run_plan(args: Namespace) -> int:
    from engine import session
    from engine.pipeline import stages, table

    opened = session.open_session(args.session)
    for step in stages.plan(opened, table.stages(), _settings(args, session.read_params(opened))):
        print(f"{step.stage.name:8} {step.fingerprint}  {step.tell()}")
    return 0


def run_process(args: Namespace) -> int:
    process(args.session, args.preset, args.seed, args.set, args.until, args.device)
    return 0


def process(
    folder: Path,
    preset: str | None,
    seed: int | None,
    assignments: list[str],
    until: str | None,
    device: str,
) -> None:
    """Run the stages with bars; what was asked is kept in params.toml: a resumed run needs no options."""
    from engine import session
    from engine.pipeline import run, stages, table

    opened = session.open_session(folder)
    before = session.read_params(opened)
    changed = asked.with_changes(asked.from_toml(before), preset, seed, assignments)
    rows = table.stages()
    stages.until(
        stages.plan(opened, rows, changed), until
    )  # refuses what is misspelt before anything is kept
    run.choose_device(device, needed=device == "cuda")
    console = Console()
    with terminal.stoppable() as cancelled, terminal.Display(console) as display:
        watcher = run.Watcher(
            lambda step: display.begin(step.stage.name),
            lambda step, fraction, note: display.move(fraction, note),
            lambda step, seconds: display.end(seconds),
            cancelled,
        )
        steps = run.process(opened, rows, changed, device, until, watcher)
    waiting = [step.stage.name for step in steps if not step.done]
    print(f"{folder}: {', '.join(waiting) or 'nothing to do, every stage'} done")


def _settings(args: Namespace, params: dict[str, object]) -> asked.Settings:
    return asked.with_changes(asked.from_toml(params), args.preset, args.seed, args.set)
