"""A batch in the terminal: a bar for all and one for each session that is under way, with the time left; lines without a screen."""

import math
import threading
import time
from collections.abc import Callable, Sequence

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from app.batch.orders import Ended, Moved, Order
from app.exit_codes import ExitCode
from app.plan import told_seconds
from app.terminal import PLAIN_EVERY_S


class Display:
    """What is told of orders: `move` may be called from any thread, the rest from one."""

    def __init__(
        self,
        console: Console,
        orders: Sequence[Order],
        threads: int = 1,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            threads: orders that can be under way at once.
        """
        self._console, self._clock = console, clock
        self._running: dict[str, Moved] = {}
        self._begun: set[str] = set()
        self._workers: int | None = None  # nobody has looked
        self._ended: dict[str, Ended] = {}
        self._lock = threading.Lock()
        self._told = clock()
        self._bars = Progress(
            TextColumn("{task.description}"), BarColumn(bar_width=28), TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[note]}", style="dim"), console=console,
        )  # fmt: skip
        self._tasks: dict[str, TaskID] = {}
        self.expect(orders, threads)

    def __enter__(self) -> "Display":
        if self._console.is_terminal:
            self._bars.start()
            self._tasks[""] = self._bars.add_task("all", total=1.0, note="")
        return self

    def __exit__(self, *fault: object) -> None:
        if self._console.is_terminal:
            self._bars.stop()

    def expect(self, orders: Sequence[Order], threads: int) -> None:
        """These orders are all there are, and none is under way."""
        self._orders, self._threads = {order.name: order for order in orders}, threads
        with self._lock:
            self._running.clear()
        for name in set(self._tasks) - {""}:
            self._bars.remove_task(self._tasks.pop(name))

    def move(self, moved: Moved) -> None:
        with self._lock:
            if moved.name not in self._ended:
                self._running[moved.name] = moved
                if moved.stage:
                    self._begun.add(moved.name)

    def staff(self, workers: int) -> None:
        """How many workers there are."""
        if workers != self._workers:
            self._workers = workers
            if workers == 0:
                self.say("there is no worker now; orders wait for one")

    def begun(self, name: str) -> bool:
        """Whether an order was ever told to have begun a stage, and so held its session."""
        return name in self._begun

    def end(self, ended: Ended) -> None:
        with self._lock:
            self._ended[ended.name] = ended
            self._running.pop(ended.name, None)
        if ended.name in self._tasks:
            self._bars.remove_task(self._tasks.pop(ended.name))
        if ended.code is ExitCode.STOPPED:
            return  # told once, for all of them
        self.say(f"{ended.name}: {told(ended)}{self._summary(', ') if not self._console.is_terminal else ''}")

    def say(self, text: str) -> None:
        """A line that stays, above the bars."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def refresh(self) -> None:
        with self._lock:
            running = dict(self._running)
        if self._console.is_terminal:
            for name, moved in running.items():
                if name not in self._tasks:
                    self._tasks[name] = self._bars.add_task(escape(name), total=1.0, note="")
                note = escape(f"{moved.stage}  {moved.note}")
                self._bars.update(self._tasks[name], completed=self._fraction(name), note=note)
            self._bars.update(self._tasks[""], completed=self.fraction(), note=self._summary())
        elif running and self._clock() - self._told >= PLAIN_EVERY_S:
            self._told = self._clock()
            doing = ", ".join(f"{name} {m.stage} {100 * m.fraction:.0f} %" for name, m in running.items())
            self.say(f"{doing}{self._summary('; ')}")

    def fraction(self) -> float:
        """Of the whole batch, by the seconds that its orders are expected to take."""
        total = sum(self._weight(order) for order in self._orders.values())
        return 1 - self._left() / total if total else 1.0

    def eta_s(self) -> float:
        """Seconds until the end, at the pace of what has ended; NaN where nobody knows."""
        if any(math.isnan(order.seconds) for order in self._orders.values()):
            return math.nan
        known = [
            (end.seconds, self._orders[name].seconds) for name, end in self._ended.items() if end.code == 0
        ]
        expected = sum(seconds for _, seconds in known)
        pace = sum(seconds for seconds, _ in known) / expected if expected else 1.0
        left = len(self._orders) - len(self._ended)
        return pace * self._left() / max(1, min(self._threads, left))

    def _summary(self, before: str = "") -> str:
        eta_s = self.eta_s()
        left = (
            ""
            if math.isnan(eta_s) or len(self._ended) == len(self._orders)
            else f", about {told_seconds(eta_s)} left"
        )
        return f"{before}{len(self._ended)} of {len(self._orders)} ended{left}"

    def _left(self) -> float:
        with self._lock:
            names = [name for name in self._orders if name not in self._ended]
            return sum(self._weight(self._orders[name]) * (1 - self._fraction(name)) for name in names)

    def _weight(self, order: Order) -> float:
        return 1.0 if math.isnan(order.seconds) else max(order.seconds, 1e-3)

    def _fraction(self, name: str) -> float:
        """Of one order: the stages before the present one, and what of that is done."""
        moved, stages = self._running.get(name), self._orders[name].stages
        if moved is None:
            return 0.0
        total = sum(stages.values())
        if moved.stage not in stages or not total > 0:
            return moved.fraction
        before = list(stages)[: list(stages).index(moved.stage)]
        return (sum(stages[stage] for stage in before) + moved.fraction * stages[moved.stage]) / total


def told(ended: Ended) -> str:
    """How a session ended, in some words."""
    if ended.code is ExitCode.BUSY:
        return f"left out: {ended.message}"
    if ended.code is not ExitCode.DONE:
        return f"failed: {ended.message}"
    quality = ended.result.get("quality")
    return f"done in {told_seconds(ended.seconds)}" + (f", {quality['grade']}" if quality else "")
