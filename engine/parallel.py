"""Blocks of pixels several at a time, each by one thread alone.

What a block comes out at then depends on no other, and not on how many cores there are. The kernels let go of Python's lock, and
products of matrices are one thread's as well where `app.cores` has prepared the process: divided among threads they would
sum in another order.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from engine.progress import Progress

Thing = TypeVar("Thing")
Answer = TypeVar("Answer")

WAITING = 2
"""Things that wait for each thread: enough that none stands idle, few enough that a stop is soon."""


def abreast(
    work: Callable[[Thing], Answer], things: Sequence[Thing], most: int | None = None
) -> Iterator[Answer]:
    """What `work` makes of each of the things, in their order; at most `most` at once, where memory asks for it."""
    threads = min(len(os.sched_getaffinity(0)), len(things), most or len(things))
    if threads <= 1:
        yield from map(work, things)
        return
    pool, waiting = ThreadPoolExecutor(threads), deque[Future[Answer]]()
    try:
        for thing in things:
            waiting.append(pool.submit(work, thing))
            if len(waiting) > WAITING * threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def each(work: Callable[[Thing], None], things: Sequence[Thing], progress: Progress, doing: str) -> None:
    """`work` on each of the things; what is done shows, and a stop gets through."""
    for i, _ in enumerate(abreast(work, things)):
        progress.step(i / len(things), doing)
