"""The demo: takes a copy of the bundled session through every stage, from RAW files to the report."""

import shutil
from pathlib import Path

from app import commands, results
from app.changes import Changes
from engine.errors import SessionError
from engine.io import session as sessions

BUNDLED = Path(__file__).parents[1] / "demo"


def run(to: Path, preset: str | None, device: str) -> int:
    """Copy (unless a copy is there already: then resume), process, report, evaluate, and say where to look.

    Raises:
        SessionError: this is an installation without the bundled session.
    """
    source = BUNDLED / "session"
    if not (source / "session.json").is_file():
        raise SessionError(
            f"{source}: the bundled session comes with the repository only; run ./roomlight demo from a clone"
        )
    folder = to / "session"
    if not (folder / "session.json").is_file():
        copy(source, folder)
    print(f"demo: {len(sessions.shots(sessions.open_session(folder)))} RAW brackets in {folder}")
    commands.process(folder, Changes(preset), device=device)
    truth = BUNDLED / "truth"
    page = results.write_report(folder, to / "report.html", truth)
    print(results.told(results.evaluate(folder, truth)))
    print(f"look at  {page}")
    print(f"and into {folder / 'exports' / 'latest'}")
    return 0


def copy(source: Path, folder: Path) -> None:
    """Only what a capture is; the copy appears whole or not at all.

    Raises:
        SessionError: something else is there, or the disk refuses.
    """
    if folder.exists() and any(folder.iterdir()):
        raise SessionError(f"{folder}: holds something else; choose another folder with --to")
    partial = folder.with_name(f".{folder.name}.partial")
    with sessions.told(folder):
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        for name in ("stages", "exports"):
            (partial / name).mkdir()
        for name in ("shots", "edits"):
            if (source / name).is_dir():
                shutil.copytree(source / name, partial / name, copy_function=shutil.copyfile)
        shutil.copyfile(source / "session.json", partial / "session.json")
        if folder.exists():
            folder.rmdir()
        partial.rename(folder)
