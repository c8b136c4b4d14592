"""Hand orders to a crew, follow them, and say how each ended.

dask keeps the queue: it gives an order to a worker that has the memory, again where the worker died, and once more where the order
raised. What ended is what the child says; nothing is written down here, sessions on disk hold the state: after a scheduler was lost with
its queue, what had not ended is handed to the next, and children find what is done.
"""

import dataclasses
import functools
import math
import os
import queue
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError
from typing import Any, Protocol

from app.batch import cluster, errand
from app.batch.cluster import ANSWER_S, TOKEN, Crew, NotBack, SchedulerGone, Wanted
from app.batch.orders import NUMBERS, Ended, Moved, Order
from app.costs import told_gigabytes
from app.exit_codes import ExitCode
from app.plan import told_seconds
from app.sources import program
from engine.errors import Cancelled

LOOK_EVERY_S = 0.2
TRIES = 2
"""Of an order whose child was killed."""

ASK_EVERY_S = 2.0
"""How often the scheduler is asked for its workers."""
ENDING_S = 90.0
"""How long a session may be held by the child of a worker that was lost: dask's half minute for its threads, and a child's patience."""


class OrderListener(Protocol):
    """Who is told of orders, `move` from any thread."""

    def expect(self, orders: Sequence[Order], threads: int) -> None: ...
    def staff(self, workers: int) -> None: ...
    def move(self, moved: Moved) -> None: ...
    def begun(self, name: str) -> bool: ...
    def end(self, ended: Ended) -> None: ...
    def say(self, text: str) -> None: ...
    def refresh(self) -> None: ...


def carry_out(
    orders: Sequence[Order],
    wanted: Wanted,
    display: OrderListener,
    cancelled: Callable[[], bool],
    ended: list[Ended],
    complain: Callable[[str], None],
) -> None:
    """Do what fits; a scheduler that goes away is waited for, and given what had not ended. `ended` takes each order as it ends.

    Raises:
        BatchError: nothing can run.
    """
    largest_gb = max(order.memory_bytes for order in orders) / 1e9
    count, memory_gb = cluster.count_workers(wanted, largest_gb, len(orders))
    hire = functools.partial(cluster.open_crew, wanted, count, memory_gb)
    opened, fit, left = hire(), None, orders
    before: str = ""
    while left:
        try:
            with opened as crew:
                if fit is None:
                    fit = left = _choose(orders, crew, complain)
                if not left:
                    return
                display.expect(fit, crew.threads)
                if before:
                    crew.stop(before)
                before = crew.batch
                run(left, crew, display, cancelled, ended, wanted.wait_s)
                return
        except SchedulerGone as lost:
            names = {one.name for one in ended}
            left = [order for order in fit or () if order.name not in names]
            waits = f"it is waited for, up to {told_seconds(wanted.wait_s)}"
            display.say(f"{lost}, {len(left)} session(s) are left; {waits}")
            opened = cluster.open_again(hire, lost, wanted.wait_s, cancelled)
        except Cancelled:
            ended += [Ended(order.name, ExitCode.STOPPED) for order in left]
            return
        except NotBack as error:
            complain(str(error))
            return


def _choose(orders: Sequence[Order], crew: Crew, complain: Callable[[str], None]) -> Sequence[Order]:
    """The orders that a worker has the memory and the time for."""
    for address, why in crew.unfit.items():
        complain(f"worker {address} {why}; it is asked nothing")
    fit = []
    for order in orders:
        stage, seconds = max(order.stages.items(), key=lambda known: known[1], default=("", 0.0))
        if order.memory_bytes / 1e9 > (crew.memory_gb or math.inf):
            complain(
                f"{order.name}: needs about {told_gigabytes(order.memory_bytes)}, a worker has {crew.memory_gb:.1f} GB; take fewer"
                " --workers or more --memory"
            )
        elif seconds > crew.lifetime_s:
            complain(
                f"{order.name}: stage {stage} takes about {told_seconds(seconds)}, a worker works for"
                f" {told_seconds(crew.lifetime_s)}; take a longer --walltime"
            )
        else:
            fit.append(order)
    return fit


def run(
    orders: Sequence[Order],
    crew: Crew,
    display: OrderListener,
    cancelled: Callable[[], bool],
    ended: list[Ended],
    wait_s: float = 0.0,
) -> None:
    """Do the orders; `ended` takes each as it ends.

    Args:
        wait_s: how long there may be no worker.

    Raises:
        SchedulerGone: what has ended by then was shown; sessions on disk hold what is done.
        NotBack: there was no worker for so long.
    """
    news: queue.SimpleQueue[Any] = queue.SimpleQueue()
    waiting: dict[Any, Order] = {}
    held: dict[str, float] = {}  # sessions whose own lost child holds them -> since when
    unfit = dict(crew.unfit)
    surroundings = {
        "numbers": {name: os.environ[name] for name in NUMBERS if name in os.environ},
        "shares": crew.shares,
    }

    def submit(orders: Sequence[Order], attempt: int = 0) -> None:
        """All that need the same memory at once: dask takes a thousand orders as soon as one."""
        alike: dict[float, list[Order]] = defaultdict(list)
        for order in orders:
            alike[_tokens(order, crew.memory_gb)].append(order)
        for tokens, group in alike.items():
            futures = crew.client.map(
                errand.run, [dataclasses.asdict(order) for order in group], program=program(), batch=crew.batch,
                surroundings=surroundings, key=[f"{crew.batch}-{order.name}-{attempt}" for order in group], pure=False,
                retries=TRIES - 1, workers=_fit(crew, unfit) if unfit else None,
                resources={TOKEN: tokens} if tokens else {},
            )  # fmt: skip
            waiting.update(zip(futures, group, strict=True))
            for future in futures:
                future.add_done_callback(news.put)

    def hear(event: tuple[float, Mapping[str, Any]]) -> None:
        told = event[1]
        display.move(Moved(told["name"], told["stage"], told["fraction"], told["note"], told["machine"]))

    def again(order: Order) -> None:
        """An order that another worker can do, or the same one later."""
        nonlocal attempt
        attempt += 1
        submit([order], attempt)

    attempt, stopping, asked_at, staffed_at = 0, False, -math.inf, time.monotonic()
    crew.client.subscribe_topic(crew.batch, hear)
    submit(orders)
    while waiting:
        if cancelled() and not stopping:
            stopping = True
            crew.stop(crew.batch)
            crew.client.cancel([future for future, order in waiting.items() if not display.begun(order.name)])
        now = time.monotonic()
        if now - asked_at >= ASK_EVERY_S:
            asked_at, present = now, crew.workers()
            staffed_at = now if present or crew.hires else staffed_at
            display.staff(len(present))
            if now - staffed_at > wait_s:
                raise NotBack(
                    f"{crew.place}: there was no worker for {told_seconds(wait_s)}, {len(waiting)} session(s) are left; start some and"
                    " give the same command, which goes on with them"
                )
        display.refresh()
        try:
            future = news.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            continue
        try:
            error = future.exception(ANSWER_S)
            answer: dict[str, Any] = future.result(ANSWER_S) if error is None else {}
        except (OSError, CancelledError) as lost:
            if not stopping:
                raise crew.gone() from lost
            error, answer = None, {"name": waiting[future].name, "code": ExitCode.STOPPED}
        order = waiting.pop(future)
        if "unfit" in answer:
            unfit[str(answer["worker"])] = str(answer["unfit"])
            display.say(f"{answer['worker']} {answer['unfit']}")
            if _fit(crew, unfit):
                again(order)
                continue
            answer = {"name": order.name, "code": ExitCode.REFUSED, "message": "no worker can be used"}
        # Its own child of before, on a worker that was lost, may still hold it.
        own = answer.get("code") == ExitCode.BUSY and (crew.again or display.begun(order.name))
        if own and time.monotonic() - held.setdefault(order.name, time.monotonic()) < ENDING_S:
            again(order)
            continue
        told: dict[str, Any] = answer if error else {**answer, "code": ExitCode(answer["code"])}
        end = _failed(order, error) if error else Ended(**told)
        ended.append(end)
        display.end(end)
    if stopping:
        crew.stop(crew.batch, wait=True)  # children that had begun unheard too
    crew.client.unsubscribe_topic(crew.batch)


def _tokens(order: Order, most_gb: float | None) -> float:
    """Tenths of a gigabyte, of which few kinds are left; 0 where nobody counts."""
    return 0.0 if most_gb is None else min(math.ceil(order.memory_bytes / 1e8) / 10, most_gb)


def _fit(crew: Crew, unfit: Mapping[str, str]) -> list[str]:
    return [address for address in crew.workers() if address not in unfit]


def _failed(order: Order, error: BaseException) -> Ended:
    """What the orders that raised are told of."""
    from distributed import KilledWorker

    from app.batch.child import Killed

    if isinstance(error, Killed):
        return Ended(order.name, ExitCode.REFUSED, f"{error} (tried {TRIES} times)")
    if isinstance(error, KilledWorker):
        return Ended(
            order.name, ExitCode.REFUSED, "its worker died again and again, most likely because memory ran out; give the batch"
            " fewer workers, or the session more memory",
        )  # fmt: skip
    told = " ".join(f"{type(error).__name__}: {error}".split())
    return Ended(
        order.name, ExitCode.FAULT, f"a fault in Roomlight itself ({told}); run it again, and send this line if it repeats"
    )  # fmt: skip
