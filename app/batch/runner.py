"""Hand orders to a crew, follow them, and say how each ended.

dask keeps the queue: it gives an order to a worker that has the memory, again where the worker died, and once more where the order
raised. What ended is what the child says; nothing is written down here, sessions on disk hold the state.
"""

import dataclasses
import math
import os
import queue
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from app.batch import errand
from app.batch.cluster import TOKEN, Crew
from app.batch.display import Display
from app.batch.orders import NUMBERS, BatchError, Ended, Moved, Order
from app.exit_codes import ExitCode
from app.sources import program

LOOK_EVERY_S = 0.2
TRIES = 2
"""Of an order whose child was killed."""


class SchedulerGone(BatchError):
    """The scheduler went away while orders were under way."""


def run(orders: Sequence[Order], crew: Crew, display: Display, cancelled: Callable[[], bool]) -> list[Ended]:
    """Do the orders.

    Raises:
        SchedulerGone: what has ended by then was shown; sessions on disk hold what is done.
    """
    news: queue.SimpleQueue[Any] = queue.SimpleQueue()
    waiting: dict[Any, Order] = {}
    unfit = dict(crew.unfit)
    ended: list[Ended] = []
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
        display.move(Moved(told["name"], told["stage"], told["fraction"], told["note"]))

    crew.client.subscribe_topic(crew.batch, hear)
    submit(orders)
    stopping = False
    while waiting:
        if cancelled() and not stopping:
            stopping = True
            crew.client.run(errand.stop, program(), crew.batch, wait=False)
        display.refresh()
        try:
            future = news.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            if crew.client.status != "running":
                raise _gone(crew, len(waiting)) from None
            continue
        if future.status == "cancelled":
            raise _gone(crew, len(waiting))
        order, error = waiting.pop(future), future.exception()
        answer = future.result() if error is None else {}
        if "unfit" in answer:
            unfit[answer["worker"]] = answer["unfit"]
            display.say(f"{answer['worker']} {answer['unfit']}")
            if _fit(crew, unfit):
                submit([order], len(unfit))
                continue
            answer = {"name": order.name, "code": ExitCode.REFUSED, "message": "no worker can be used"}
        told: dict[str, Any] = answer if error else {**answer, "code": ExitCode(answer["code"])}
        end = _failed(order, error) if error else Ended(**told)
        ended.append(end)
        display.end(end)
    crew.client.unsubscribe_topic(crew.batch)
    return ended


def _tokens(order: Order, most_gb: float | None) -> float:
    """Tenths of a gigabyte, of which few kinds are left; 0 where nobody counts."""
    return 0.0 if most_gb is None else min(math.ceil(order.memory_bytes / 1e8) / 10, most_gb)


def _fit(crew: Crew, unfit: Mapping[str, str]) -> list[str]:
    return [address for address in crew.client.scheduler_info()["workers"] if address not in unfit]


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


def _gone(crew: Crew, left: int) -> SchedulerGone:
    return SchedulerGone(
        f"{crew.place}: the scheduler went away, {left} session(s) were not done; start it again with its workers and give the same"
        " command, which goes on with what is left"
    )
