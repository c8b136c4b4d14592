"""One order on its worker: a child of its own from beginning to end.

dask sets the number libraries' thread counts in its workers' environments; the child gets those of the command line instead, so
that it computes what `roomlight process` would. Its threads are limited by the cores it may use alone, on which no result depends.
"""

import asyncio
import os
import signal
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

from distributed import Status, Worker, get_worker

from app.batch.orders import NUMBERS, Order
from app.exit_codes import ExitCode
from app.work import worker as engine
from app.work.jobs import Job, JobState, JobStatus, child_command

TELL_EVERY_S = LOOK_EVERY_S = 0.5

LEAVING = (Status.closing, Status.closed, Status.failed)
"""A worker whose time is over, or whose scheduler went away: its order is done elsewhere."""

_running: dict[str, set[Job]] = {}  # by batch
_stopped: set[str] = set()


class Killed(Exception):
    """The child ended by a signal. dask tries an order that raises once more, where there is another worker, there."""


def dask_setup(worker: Worker) -> None:
    """dask calls this in every worker of our own: Ctrl-C in the terminal is for the command line, which ends its workers in order."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def command(task: str, request: Mapping[str, Any]) -> Sequence[str]:
    return [*child_command(task, request), engine.UNATTENDED]


def run(batch: str, order: Mapping[str, Any], surroundings: Mapping[str, Any]) -> dict[str, Any]:
    """Do an order; fields of `Ended`.

    Args:
        surroundings: "numbers", the command line's variables of `NUMBERS`; "shares", the cores that each worker of a cluster
            of our own may use, by its name.

    Raises:
        Killed: the child was killed, or crashed.
    """
    asked, worker = Order(**order), get_worker()
    if batch in _stopped:
        return {"name": asked.name, "code": ExitCode.STOPPED}
    start, told_at, stage = time.monotonic(), 0.0, ""

    def tell(status: JobStatus) -> None:
        nonlocal told_at, stage
        if status.active and (status.stage != stage or time.monotonic() - told_at >= TELL_EVERY_S):
            told_at, stage = time.monotonic(), status.stage
            worker.log_event(
                batch, {"name": asked.name, "stage": status.stage, "fraction": status.fraction, "note": status.note,
                        "machine": socket.gethostname()}
            )  # fmt: skip

    others = {name: value for name, value in os.environ.items() if name not in NUMBERS}
    environment = {**others, **surroundings["numbers"]}
    job = Job(asked.name, asked.task, asked.request, command=command, environment=environment)
    job.listen(tell)
    share = surroundings["shares"].get(str(worker.name))
    if share:
        os.sched_setaffinity(0, share)  # of this thread, and of the child that it starts
    _running.setdefault(batch, set()).add(job)
    try:
        job.start()
        if batch in _stopped:  # in the meantime
            job.cancel()
        while not (status := job.wait(LOOK_EVERY_S)).ended:
            if worker.status in LEAVING:
                job.cancel()
    finally:
        _running[batch].discard(job)
    return ended(asked.name, status, time.monotonic() - start)


def ended(name: str, status: JobStatus, seconds: float) -> dict[str, Any]:
    if status.state is JobState.CANCELLED:
        code = ExitCode.STOPPED
    elif status.code is not None and status.code < 0:
        raise Killed(status.message)
    else:
        code = ExitCode(status.code) if status.code in list(ExitCode) else ExitCode.FAULT
    return {
        "name": name,
        "code": int(code),
        "message": status.message,
        "seconds": seconds,
        "result": dict(status.result),
    }


async def stop(batch: str) -> None:
    """Ask a batch's children here to end, start no further ones, and wait until they have ended."""
    _stopped.add(batch)
    for job in tuple(_running.get(batch, ())):
        job.cancel()
    while _running.get(batch):
        await asyncio.sleep(LOOK_EVERY_S)
