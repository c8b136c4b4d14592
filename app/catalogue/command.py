"""`roomlight catalogue`: an index of sessions as one page, a table and JSON, in a folder of its own."""

import csv
import datetime
import hashlib
import io
import json
import os
import shutil
import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path

from app import terminal
from app.batch.agenda import find_sessions
from app.catalogue import page, thumbnails
from app.catalogue.rows import Row, row
from app.exit_codes import ExitCode
from app.state import called
from engine.errors import RoomlightError, SessionError
from engine.io.session import told, write_atomic
from engine.parallel import abreast

SCHEMA = 1
INDEX = "catalogue.json"


def run(args: Namespace) -> int:
    """
    Raises:
        SessionError: the folder holds other things, or the disk refuses.
    """
    to: Path = args.to
    if to.exists() and not (to / INDEX).is_file() and (not to.is_dir() or any(to.iterdir())):
        raise SessionError(f"{to}: holds something else than a catalogue; name a new or empty folder")
    folders, complaints = find_sessions(args.sessions)
    with told(to):
        (to / "images").mkdir(parents=True, exist_ok=True)
    rows = []
    with terminal.job("catalogue") as progress:
        for i, answer in enumerate(abreast(lambda folder: _entry(folder, to), folders)):
            progress.step(i / len(folders), called(folders[i]))
            rows += [answer] if isinstance(answer, Row) else []
            complaints += [answer] if isinstance(answer, str) else []
    for line in complaints:
        print(f"roomlight: {line}", file=sys.stderr)
    _write(rows, to, args.title)
    for left in {path.name for path in (to / "images").iterdir()} - {one.key for one in rows}:
        shutil.rmtree(to / "images" / left)
    print(f"{to / 'index.html'}: {len(rows)} sessions")
    return ExitCode.REFUSED if complaints else ExitCode.DONE


def _entry(folder: Path, to: Path) -> Row | str:
    """A session's row, its pictures drawn; or what is wrong with it."""
    place = hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:8]
    try:
        made = row(folder, str(folder), f"{called(folder)}-{place}")
        thumbnails.draw(made, to / "images")
    except RoomlightError as error:
        return " ".join(str(error).split())
    return made


def _write(rows: Sequence[Row], to: Path, title: str) -> None:
    rows = sorted(rows, key=lambda one: (one.name, one.folder))
    links = [None if one.report is None else os.path.relpath(one.report, to.resolve()) for one in rows]
    now = datetime.datetime.now()
    table = io.StringIO()
    writer = csv.DictWriter(table, [field.name for field in fields(Row)])
    writer.writeheader()
    writer.writerows({name: _in_a_cell(value) for name, value in asdict(one).items()} for one in rows)
    index = {
        "schema": SCHEMA, "title": title, "made": now.isoformat(timespec="seconds"), "image_edges": thumbnails.EDGES,
        "images": "images/{key}/{export_fingerprint}/{photograph|albedo|normals}-{edge}.jpg",
        "sessions": [asdict(one) for one in rows],
    }  # fmt: skip
    write_atomic(
        to / "catalogue.csv", table.getvalue().encode("utf-8-sig")
    )  # which spreadsheets take for Unicode
    write_atomic(to / INDEX, (json.dumps(index, indent=1) + "\n").encode())
    write_atomic(to / "index.html", page.html(rows, links, title, f"{now:%Y-%m-%d %H:%M}").encode())


def _in_a_cell(value: object) -> object:
    """Spreadsheets compute what begins like a formula, such as a session's name."""
    return f"'{value}" if isinstance(value, str) and value[:1] in ("=", "+", "-", "@") else value
