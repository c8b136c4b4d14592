"""The demo: takes a copy of the bundled session through every stage, from RAW files to the report, or opens it finished.

Finished results ship beside the photographs, but for what is large and made of them in seconds: frames and exports.
`python -m app.demo SESSION` packs them anew, of a copy that was processed; `roomlight demo` makes one.
"""

import shutil
import sys
import zipfile
from pathlib import Path

from app import places
from app.changes import Changes
from engine.errors import SessionError
from engine.io import session as sessions

BUNDLED = Path(__file__).parents[1] / "demo"
RESULTS = BUNDLED / "results.zip"
SHIPPED = ("params.toml", "stages/segment", "stages/poses", "stages/light", "stages/surface")


def run(to: Path, preset: str | None, device: str) -> int:
    """Copy (unless a copy is there already: then resume), process, report, evaluate, and say where to look.

    Raises:
        SessionError: this is an installation without the bundled session.
    """
    from app import commands, results

    source = bundled()
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


def bundled() -> Path:
    """
    Raises:
        SessionError: this is an installation without the bundled session.
    """
    source = BUNDLED / "session"
    if not (source / "session.json").is_file():
        raise SessionError(
            f"{source}: the bundled session comes with the repository only; run ./roomlight demo from a clone"
        )
    return source


def place() -> Path:
    """Where this person's own copy lies, that the window opens."""
    return places.data() / "demo"


def copy(source: Path, folder: Path, results: Path | None = None) -> None:
    """Only what a capture is, and packed results of it; the copy appears whole or not at all.

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
        if results is not None:
            shutil.unpack_archive(results, partial)
        if folder.exists():
            folder.rmdir()
        partial.rename(folder)


def pack(folder: Path, to: Path = RESULTS) -> None:
    """Write what ships of a finished copy of the bundled session; the same results give the same bytes.

    Raises:
        SessionError: something of it is not there; what shipped before stays.
    """
    if missing := [name for name in SHIPPED if not (folder / name).exists()]:
        raise SessionError(f"{folder}: has no {missing[0]}; run `roomlight demo` and give its session")
    with zipfile.ZipFile(to, "w", zipfile.ZIP_LZMA) as archive:
        for name in SHIPPED:
            for path in sorted([folder / name, *(folder / name).rglob("*")]):
                if path.is_file():
                    entry = zipfile.ZipInfo(path.relative_to(folder).as_posix())
                    archive.writestr(entry, path.read_bytes(), zipfile.ZIP_LZMA)


if __name__ == "__main__":
    pack(Path(sys.argv[1]))
