"""One session of the window's queue on a cluster: a batch of one order in a child of the window's, told in the words of `process`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from app.batch import runner
from app.batch.agenda import entry, order_of
from app.batch.cluster import Wanted
from app.batch.orders import BatchError, Ended, Moved, Order
from app.changes import Changes
from app.exit_codes import ExitCode
from app.state import called
from app.work.worker import Link
from engine.errors import BusyError, Cancelled


class Relay:
    """Passes on what becomes of the order; `place` says where it is."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stage, self._begun = "", False
        self._stages: tuple[str, ...] = ()

    def expect(self, orders: Sequence[Order], threads: int) -> None:
        self._stage = ""
        self._stages = tuple(orders[0].stages)

    def staff(self, workers: int) -> None:
        if not self._stage:
            self._place(f"waits for one of {workers} worker(s)" if workers else "waits, there is no worker")

    def move(self, moved: Moved) -> None:
        if moved.stage != self._stage:
            self._stage, self._begun = moved.stage, self._begun or bool(moved.stage)
            number = self._stages.index(moved.stage) + 1 if moved.stage in self._stages else 0
            self._place(f"on {moved.machine}")
            self._link.emit("stage", name=moved.stage, number=number, count=len(self._stages))
            self._link.log(f"{moved.stage}: on {moved.machine}")
        self._link.move(moved.fraction, moved.note)

    def begun(self, name: str) -> bool:
        return self._begun

    def end(self, ended: Ended) -> None:
        pass  # told as this child's own end

    def say(self, text: str) -> None:
        self._link.log(text)
        self._place("the cluster does not answer")

    def refresh(self) -> None:
        pass

    def _place(self, text: str) -> None:
        self._link.emit("place", text=text)


def process(request: Mapping[str, Any], link: Link) -> Mapping[str, Any]:
    """As `app.work.tasks.process`, on the cluster at request["scheduler"]."""
    folder = Path(request["session"])
    planned = entry(folder, called(folder), Changes(), request.get("until"))
    if not planned.waiting:
        return {"ran": []}
    ended: list[Ended] = []
    complaints: list[str] = []
    order = order_of(planned, request.get("device", "auto"), request.get("until"), Changes())
    runner.carry_out(
        [order], Wanted(scheduler=request["scheduler"]), Relay(link), link.cancelled, ended, complaints.append
    )
    if not ended:
        raise BatchError("; ".join(complaints))
    (end,) = ended
    if end.code is ExitCode.STOPPED:
        raise Cancelled
    if end.code is not ExitCode.DONE:
        raise (BusyError if end.code is ExitCode.BUSY else BatchError)(end.message)
    return end.result
