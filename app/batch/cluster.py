"""The workers of a batch: a cluster of our own on this machine, or any running cluster of dask.distributed.

Memory is handed out by tokens: a worker declares gigabytes under `TOKEN`, an order takes as many as its plan expects. Workers of our own
declare an equal share of what the batch may use; a foreign cluster's are started with `--resources roomlight_gb=16`, or
hand out none.
"""

import asyncio
import contextlib
import logging
import math
import os
import time
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.batch import errand
from app.batch.orders import BatchError
from app.batch.slurm import WORKER_GB, Slurm, open_cluster
from app.plan import told_seconds
from app.sources import program
from engine.errors import Cancelled

TOKEN = "roomlight_gb"
ANSWER_S = 15
"""How long a scheduler may take to answer."""
OURS = {
    "distributed.scheduler.allowed-failures": 10,
    "distributed.scheduler.unknown-task-duration": "1h",
}
"""Of a scheduler of our own. What dies with a session's memory is its child; a worker dies of other things, and more often in a long
session. A job of Slurm's is asked for where a session waits, not where a second's work does."""
RETRY_S = 2.0
"""Between two looks whether a scheduler is back."""
FREE_SHARE = 0.8
"""Of the memory that is free when the batch begins, what it may use unless --memory says otherwise."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a person asked of the workers; None: as this machine allows."""

    workers: int | None = None
    memory_gb: float | None = None
    scheduler: str | None = None
    slurm: Slurm | None = None
    wait_s: float = 600.0  # for a scheduler that went away


class SchedulerGone(BatchError):
    """The scheduler went away, or all workers did, while orders were under way."""


class NotBack(BatchError):
    """It did not come back."""


@dataclass(frozen=True, slots=True)
class Crew:
    """Workers that can be asked."""

    client: Any  # distributed.Client
    batch: str  # names this batch among all that the cluster has seen
    memory_gb: float | None  # that the largest worker hands out; None: nobody counts
    shares: Mapping[str, Sequence[int]]  # cores of each worker, by name; none in a foreign cluster
    unfit: Mapping[str, str]  # workers that are asked nothing, by address, and why
    place: str  # what a person calls the cluster
    threads: int  # orders that can be under way at once
    hires: bool = False  # whether workers may still come by themselves, however late
    lifetime_s: float = math.inf  # that a worker works at most
    again: bool = False  # in place of one whose scheduler went away

    def workers(self) -> Mapping[str, Mapping[str, Any]]:
        """What the scheduler knows of each, by address.

        Raises:
            SchedulerGone: it does not answer.
        """
        try:
            ask = self.client.scheduler.identity
            return self.client.sync(ask, n_workers=-1, callback_timeout=ANSWER_S)["workers"]
        except OSError as error:
            raise self.gone() from error

    def gone(self) -> SchedulerGone:
        return SchedulerGone(f"{self.place}: the scheduler went away")

    def stop(self, batch: str, wait: bool = False) -> None:
        """Ask the children of a batch to end."""
        with contextlib.suppress(OSError):  # workers without a scheduler end theirs themselves
            self.client.run(errand.stop, program(), batch, wait=wait, on_error="ignore")


def free_memory_gb() -> float:
    """What Linux could give to programs now."""
    for line in Path("/proc/meminfo").read_text().splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024 / 1e9
    raise BatchError("/proc/meminfo tells no free memory; say with --memory GB how much the batch may use")


def cores() -> list[int]:
    return sorted(os.sched_getaffinity(0))


def count_workers(wanted: Wanted, largest_gb: float, orders: int) -> tuple[int, float]:
    """How many workers of our own, and the gigabytes that each hands out.

    Left to us, as many as there are cores and orders, and no more than leave each enough memory for the largest session.
    """
    if wanted.slurm:
        if wanted.workers is None:
            raise BatchError("--slurm: say with --workers N how many jobs may run at once")
        each = wanted.memory_gb / wanted.workers if wanted.memory_gb else math.ceil(largest_gb + WORKER_GB)
        return wanted.workers, each
    memory_gb = wanted.memory_gb or FREE_SHARE * free_memory_gb()
    count = wanted.workers or max(1, min(len(cores()), orders, int(memory_gb / max(largest_gb, 0.1))))
    return count, memory_gb / count


@contextlib.contextmanager
def open_crew(wanted: Wanted, count: int, memory_gb: float) -> Iterator[Crew]:
    """
    Raises:
        BatchError: dask is not installed, the scheduler does not answer, or no worker is fit.
    """
    # Read when distributed is first imported, here and in the workers; what matters is told in the house's words.
    os.environ.setdefault("DASK_LOGGING__DISTRIBUTED", "critical")
    try:
        import cloudpickle
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise BatchError(
            f"a batch needs dask.distributed ({error}); install it with `pip install 'roomlight[batch]'`"
        ) from None
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    cloudpickle.register_pickle_by_value(errand)
    with contextlib.ExitStack() as stack:
        shares: dict[str, Sequence[int]] = {}
        stack.enter_context(config.set(OURS))
        if wanted.slurm:
            jobs, lifetime_s = open_cluster(wanted.slurm, count, memory_gb, TOKEN)
            client = stack.enter_context(Client(stack.enter_context(jobs), set_as_default=False))
            yield Crew(client, _name(), memory_gb, {}, {}, "Slurm", count, True, lifetime_s)
            return
        if wanted.scheduler is None:
            each = max(1, len(cores()) // count)
            shares = {
                str(i): [cores()[(i * each + k) % len(cores())] for k in range(each)] for i in range(count)
            }
            local = LocalCluster(
                n_workers=count, threads_per_worker=1, processes=True, memory_limit=None, dashboard_address="127.0.0.1:0",
                resources={TOKEN: memory_gb}, silence_logs=logging.CRITICAL, preload=["app.batch.child"],
            )  # fmt: skip
            address: Any = stack.enter_context(local)
        else:
            address = wanted.scheduler
        try:
            if wanted.scheduler:
                _greet(wanted.scheduler)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of versions that differ: what would not work is found below
                client = stack.enter_context(Client(address, timeout=ANSWER_S, set_as_default=False))
                crew = _muster(client, shares, wanted.scheduler or "this machine")
        except (OSError, ValueError, TypeError, MemoryError) as error:
            told = (
                "another program is there" if isinstance(error, MemoryError) else " ".join(str(error).split())
            )
            raise BatchError(
                f"{address}: no scheduler of dask.distributed answers there ({told[:120] or f'silent for {ANSWER_S} s'}); check the"
                " address, and that the scheduler and this program have the same version of distributed"
            ) from None
        yield crew


def _greet(address: str) -> None:
    """See that a scheduler answers: a client waits for ever for one that is silent, and takes what another server says for a length.

    Raises:
        OSError, ValueError, TypeError, MemoryError: as what is there answers.
    """
    from distributed.core import rpc
    from distributed.security import Security

    async def ask() -> str:
        asked: Any = rpc(address, connection_args=Security().get_connection_args("client"))
        async with asked as there:
            return (await there.identity())["type"]

    kind = asyncio.run(asyncio.wait_for(ask(), ANSWER_S))
    if kind != "Scheduler":
        raise ValueError(f"it is a {kind}")


@contextlib.contextmanager
def open_again(
    hire: Callable[[], AbstractContextManager[Crew]],
    lost: SchedulerGone,
    wait_s: float,
    cancelled: Callable[[], bool],
) -> Iterator[Crew]:
    """The crew of a scheduler that went away, as soon as it is back with a worker.

    Raises:
        NotBack: it is not in time.
        Cancelled: a person does not wait.
    """
    end = time.monotonic() + wait_s
    with contextlib.ExitStack() as stack:
        while True:
            if cancelled():
                raise Cancelled
            try:
                crew = stack.enter_context(hire())
                break
            except BatchError as error:
                if time.monotonic() >= end:
                    raise NotBack(
                        f"{lost}; nobody was back after {told_seconds(wait_s)} ({error}); start it again with its workers and give"
                        " the same command, which goes on with what is left"
                    ) from error
            time.sleep(RETRY_S)
        yield replace(crew, again=True)


def _muster(client: Any, shares: Mapping[str, Sequence[int]], place: str) -> Crew:
    answers = client.run(errand.unfit, program(), on_error="return")
    unfit = {
        address: answer if isinstance(answer, str) else f"does not answer ({answer})"
        for address, answer in answers.items()
        if answer != ""
    }
    known = client.scheduler_info(n_workers=-1)["workers"]
    fit = [facts for address, facts in known.items() if address not in unfit]
    counted = [facts["resources"][TOKEN] for facts in fit if TOKEN in facts["resources"]]
    if not fit:
        raise BatchError(
            f"{place}: no worker can be used: "
            + (
                "; ".join(f"{a} {why}" for a, why in unfit.items())
                or "there is none; start one with `dask worker`"
            )
        )
    threads = sum(facts["nthreads"] for facts in fit)
    return Crew(
        client, _name(), max(counted, default=None), shares, unfit, place, threads, hires=bool(shares)
    )


def _name() -> str:
    return f"roomlight-{uuid.uuid4().hex}"
