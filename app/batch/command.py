"""`roomlight batch`, and `export` and `report` of several sessions: find them, plan, run what is left, say how it ended."""

import json
import math
import sys
from argparse import Namespace
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from app import exports, terminal
from app.batch import cluster, runner
from app.batch.agenda import Entry, agenda, find_sessions, order_of
from app.batch.cluster import Wanted
from app.batch.display import Display
from app.batch.orders import BatchError, Ended, Order
from app.batch.slurm import Slurm
from app.changes import Changes, changes_of, check
from app.costs import Cost, told_gigabytes
from app.exit_codes import ExitCode
from app.plan import told_seconds
from app.quality import quality_of

RESULT_SCHEMA = 1
PLAIN_WIDTH = 160  # of a table that goes to a file
EXPORT, REPORT = Cost(3.0, 400_000_000), Cost(6.0, 900_000_000)
"""What a session's copy and page take, measured on the demo."""


@dataclass(slots=True)
class Batch:
    """The sessions that a command was given, what is known of them, and what was asked of the workers."""

    entries: list[Entry]
    wanted: Wanted
    json: bool
    complaints: list[str] = field(default_factory=list)
    ended: list[Ended] = field(default_factory=list)

    def complain(self, line: str) -> None:
        self.complaints.append(line)
        print(f"roomlight: {line}", file=sys.stderr)

    @property
    def console(self) -> Console:
        """JSON has stdout for itself."""
        return Console(stderr=self.json)

    @property
    def code(self) -> ExitCode:
        """The worst that happened."""
        codes = {ended.code for ended in self.ended} | ({ExitCode.REFUSED} if self.complaints else set())
        return next((code for code in ExitCode if code in codes), ExitCode.DONE)


def run_batch(args: Namespace) -> int:
    batch = _open(args, changes_of(args), args.until)
    wait = [entry for entry in batch.entries if entry.waiting]
    if args.plan:
        return _show_plan(batch)
    _run(batch, [order_of(entry, args.device, args.until, changes_of(args)) for entry in wait])
    if args.strict:
        _doubt(batch)
    return _finish(batch, f"{len(batch.entries) - len(wait)} were done before")


def run_export(args: Namespace, green: str | None) -> int:
    """Copy the exports of several sessions to folders below `args.to`."""
    batch = _open(args, Changes(), None)
    for entry in tuple(batch.entries):
        step = entry.steps[-1]
        if not step.done:
            batch.entries.remove(entry)
            batch.complain(
                f"{entry.folder}: stage export {step.tell()}; run `roomlight process {entry.folder}` first"
            )
    places = _places(batch, args.to, "")

    def request(entry: Entry, to: Path) -> dict[str, Any]:
        files = exports.files_for(entry.steps[-1].folder, args.target) if args.target is not None else None
        return {"session": str(entry.folder.resolve()), "to": str(to), "green": green, "files": files}

    _run(batch, [
        Order(entry.name, "export", request(entry, to), EXPORT.seconds, EXPORT.memory_bytes) for entry, to in places
    ])  # fmt: skip
    return _finish(batch, f"exported to {args.to}")


def run_report(args: Namespace) -> int:
    """Write the pages of several sessions: below `args.to`, or each in its session."""
    batch = _open(args, Changes(), None)
    places = _places(batch, args.to, ".html") if args.to else [(entry, None) for entry in batch.entries]
    _run(batch, [
        Order(entry.name, "report", {"session": str(entry.folder.resolve()), "to": to and str(to)}, REPORT.seconds,
              REPORT.memory_bytes)
        for entry, to in places
    ])  # fmt: skip
    return _finish(batch, f"pages in {args.to or 'exports/report.html of each session'}")


def _open(args: Namespace, changes: Changes, until: str | None) -> Batch:
    check(changes, until)
    of_job = ("partition", "account", "walltime", "cores")
    stray = next((name for name in of_job if getattr(args, name) is not None), None)
    if stray and not args.slurm:
        raise BatchError(f"--{stray}: is of a job of Slurm's; give --slurm too, or leave it out")
    slurm = Slurm(args.partition, args.account, args.walltime, args.cores) if args.slurm else None
    wanted = Wanted(args.workers, args.memory, args.scheduler, slurm)
    batch = Batch([], wanted, args.json)
    folders, complaints = find_sessions(args.sessions)
    each = max(1, len(cluster.cores()) // (wanted.workers or max(1, min(len(cluster.cores()), len(folders)))))
    each = (slurm and slurm.cores) or each
    entries, damaged = agenda(folders, changes, until, each)
    for line in (*complaints, *damaged):
        batch.complain(line)
    batch.entries = [entry for entry in entries if args.where in (None, entry.standing.value)]
    return batch


def _places(batch: Batch, to: Path, suffix: str) -> list[tuple[Entry, Path]]:
    """Where each session's result goes; of those that are called alike none does, for one would replace the other."""
    alike: dict[str, list[Entry]] = defaultdict(list)
    for entry in batch.entries:
        alike[entry.called].append(entry)
    for name, entries in alike.items():
        if len(entries) > 1:
            folders = ", ".join(str(entry.folder) for entry in entries)
            batch.complain(
                f"{folders}: are all called {name}; rename them, or give one after the other with its own --to"
            )
    return [
        (entries[0], to.resolve() / f"{name}{suffix}") for name, entries in alike.items() if len(entries) == 1
    ]


def _run(batch: Batch, orders: Sequence[Order]) -> None:
    if not orders:
        return
    with terminal.stoppable() as cancelled, Display(batch.console, orders) as display:
        runner.carry_out(orders, batch.wanted, display, cancelled, batch.ended, batch.complain)


def _doubt(batch: Batch) -> None:
    """With --strict: a result that is not good, of this batch or of an earlier one."""
    doubted = [
        ended for ended in batch.ended if ended.result.get("quality", {}).get("grade", "good") != "good"
    ]
    batch.ended += [Ended(ended.name, ExitCode.DOUBTED) for ended in doubted]
    for entry in batch.entries:
        verdict = None if entry.waiting else quality_of({s.stage.name: s.folder for s in entry.steps})
        if verdict is not None and not verdict.good:
            batch.ended.append(Ended(entry.name, ExitCode.DOUBTED, str(verdict)))


def _finish(batch: Batch, besides: str) -> int:
    done = [ended for ended in batch.ended if ended.code == ExitCode.DONE]
    if batch.json:
        print(json.dumps({
            "schema": RESULT_SCHEMA,
            "code": int(batch.code),
            "sessions": [_plain(ended) | {"code": int(ended.code)} for ended in batch.ended],
            "complaints": batch.complaints,
        }, indent=1))  # fmt: skip
    else:
        if batch.code is ExitCode.STOPPED:
            besides = "stopped; the same command goes on with what is left"
        failed = len(
            {ended.name for ended in batch.ended if ended.code not in (ExitCode.DONE, ExitCode.DOUBTED)}
        )
        left = f", {failed} not" if failed else ""
        print(f"{len(done)} of {len(batch.entries)} sessions done{left}; {besides}")
    return batch.code


def _plain(record: Any) -> dict[str, Any]:
    return {name: getattr(record, name) for name in record.__slots__}


def _show_plan(batch: Batch) -> int:
    if batch.json:
        print(json.dumps({
            "schema": RESULT_SCHEMA,
            "code": int(batch.code),
            "sessions": [entry.content() for entry in batch.entries],
            "complaints": batch.complaints,
        }, indent=1))  # fmt: skip
        return batch.code
    table = Table(box=None, pad_edge=False)
    for head in ("session", "standing", "would run", "why"):
        table.add_column(head, overflow="fold")
    for head in ("about", "memory"):
        table.add_column(head, justify="right", no_wrap=True)
    wait = [entry for entry in batch.entries if entry.waiting]
    for entry in batch.entries:
        stages = ", ".join(step.stage.name for step in entry.waiting)
        told = (
            (_told_s(entry.cost.seconds), told_gigabytes(entry.cost.memory_bytes))
            if entry.waiting
            else ("", "")
        )
        table.add_row(entry.name, entry.standing.value, stages, entry.reason, *told)
    console = batch.console
    Console(width=None if console.is_terminal else PLAIN_WIDTH).print(table)
    largest = max((entry.cost.memory_bytes for entry in wait), default=0)
    count, memory_gb = cluster.count_workers(batch.wanted, largest / 1e9, max(len(wait), 1))
    seconds = sum(entry.cost.seconds for entry in wait)
    kind = "job(s) of Slurm's" if batch.wanted.slurm else "worker(s)"
    where = batch.wanted.scheduler or f"{count} {kind} of {memory_gb:.1f} GB"
    longest = max((entry.cost.seconds for entry in wait), default=0.0)
    print(
        f"{len(wait)} of {len(batch.entries)} sessions would run on {where}"
        + (f", about {_told_s(max(seconds / count, longest))}" if wait and not batch.wanted.scheduler else "")
    )
    return batch.code


def _told_s(seconds: float) -> str:
    return "unknown" if math.isnan(seconds) else told_seconds(seconds)
