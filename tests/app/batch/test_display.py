"""What the terminal says of a batch."""

import io
import math

from rich.console import Console

from app.batch.display import Display
from app.batch.orders import Ended, Moved, Order
from app.exit_codes import ExitCode


def order(name: str, seconds: float = 100.0) -> Order:
    return Order(name, "process", {}, seconds, 0, {"hdr": 0.2 * seconds, "light": 0.8 * seconds})


def display(*orders: Order, threads: int = 2) -> tuple[Display, io.StringIO]:
    out = io.StringIO()
    clock = iter(range(0, 10_000, 20))
    return Display(Console(file=out), orders, threads, lambda: next(clock)), out


def test_the_time_left_follows_from_what_has_ended_and_how_far_the_rest_is() -> None:
    shown, _ = display(order("a"), order("b"), order("c"), order("d"))
    assert shown.eta_s() == 200.0
    shown.end(Ended("a", ExitCode.DONE, seconds=150.0))  # half as long again as expected
    assert shown.eta_s() == 1.5 * 300 / 2
    shown.move(Moved("b", "light", 0.5, ""))  # 20 of its 100 seconds, and half of 80
    assert shown.eta_s() == 1.5 * 240 / 2
    shown.end(Ended("c", ExitCode.REFUSED, "no", 1.0))  # tells nothing of the pace
    assert shown.eta_s() == 1.5 * 140 / 2
    shown.end(Ended("d", ExitCode.DONE, seconds=150.0))
    assert shown.eta_s() == 1.5 * 40  # one worker has nothing to do


def test_what_nobody_knows_is_not_told() -> None:
    shown, out = display(order("a", math.nan), order("b"))
    assert math.isnan(shown.eta_s())
    shown.end(Ended("b", ExitCode.DONE, seconds=3.0))
    assert out.getvalue() == "b: done in 3 s, 1 of 2 ended\n"


def test_lines_tell_each_session_and_all(monkeypatch) -> None:
    shown, out = display(order("a"), order("b"))
    shown.move(Moved("a", "hdr", 0.4, "merging"))
    shown.refresh()
    shown.end(Ended("a", ExitCode.DONE, "", 100.0, {"quality": {"grade": "doubtful"}}))
    shown.end(Ended("b", ExitCode.BUSY, "process 7 is working on this session"))
    lines = out.getvalue().splitlines()
    assert lines[0] == "a hdr 40 %; 0 of 2 ended, about 1 min 36 s left"
    assert lines[1] == "a: done in 1 min 40 s, doubtful, 1 of 2 ended, about 1 min 40 s left"
    assert lines[2] == "b: left out: process 7 is working on this session, 2 of 2 ended"
