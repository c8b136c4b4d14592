import io
import os
import threading
import time

import pytest

from hardware.errors import HardwareError, LimitError, StoppedError
from hardware.interfaces import Angles, State
from hardware.manual import Handheld, Manual, Request, ask_in_terminal
from tests.hardware.contracts.orders import Order, wait


class Person:
    """Keeps every request and answers none by itself."""

    def __init__(self) -> None:
        self.asked: list[Request] = []

    def __call__(self, request: Request) -> None:
        self.asked.append(request)


def test_a_move_waits_until_the_person_confirms():
    person = Person()
    rig = Manual(person)
    order = Order(lambda: rig.move(Angles(30.0, -10.0)))
    wait(lambda: bool(person.asked), "nobody was asked")
    time.sleep(0.05)
    assert order.is_alive()
    assert rig.status().state is State.MOVING
    assert rig.status().message == person.asked[0].text
    person.asked[0].confirm()
    assert order.finished() == Angles(30.0, -10.0)
    assert rig.status().angles == Angles(30.0, -10.0)


def test_the_person_is_told_angles_of_one_turn():
    texts: list[str] = []

    def person(request: Request) -> None:
        texts.append(request.text)
        request.confirm()

    Manual(person).move(Angles(370.0, 5.0))
    Manual(person, None).move(Angles(-90.0))
    Manual(person).home()
    assert "pan 10 degrees, tilt 5 degrees" in texts[0]
    assert "pan 270 degrees" in texts[1]
    assert "tilt" not in texts[1]
    assert "zero" in texts[2]


def test_stop_withdraws_the_request():
    person = Person()
    rig = Manual(person)
    order = Order(lambda: rig.move(Angles(30.0)))
    wait(lambda: bool(person.asked), "nobody was asked")
    rig.stop()
    assert isinstance(order.finished(), StoppedError)
    assert person.asked[0].is_over
    assert rig.status().angles is None


def test_a_late_answer_to_a_withdrawn_request_counts_for_nothing():
    person = Person()
    rig = Manual(person)
    order = Order(lambda: rig.move(Angles(30.0)))
    wait(lambda: bool(person.asked), "nobody was asked")
    rig.stop()
    person.asked[0].confirm()
    assert isinstance(order.finished(), StoppedError)
    person.asked[0].withdraw("again")


def test_what_was_confirmed_cannot_be_withdrawn():
    request = Request("Turn it", Angles(0.0))
    request.confirm()
    request.withdraw("stopped")
    assert request.wait() == ""


def test_angles_beyond_the_stand_ask_nobody():
    person = Person()
    with pytest.raises(LimitError, match="beyond -30 to 40"):
        Manual(person, (-30.0, 40.0)).move(Angles(0.0, 41.0))
    with pytest.raises(LimitError, match="only turns"):
        Manual(person, None).move(Angles(0.0, 1.0))
    assert not person.asked


def terminal() -> tuple[io.TextIOBase, int]:
    read, write = os.pipe()
    return os.fdopen(read, "r"), write


def test_enter_in_the_terminal_confirms():
    keyboard, hand = terminal()
    screen = io.StringIO()
    request = Request("Turn it", Angles(0.0))
    os.write(hand, b"\n")
    ask_in_terminal(request, keyboard, screen)
    assert request.wait() == ""
    assert screen.getvalue() == "Turn it, then press Enter\n"


def test_no_keyboard_withdraws_the_request():
    keyboard, hand = terminal()
    os.close(hand)
    rig = Manual(lambda request: ask_in_terminal(request, keyboard, io.StringIO()))
    with pytest.raises(StoppedError, match="no keyboard"):
        rig.move(Angles(0.0))


def test_stop_ends_a_question_in_the_terminal():
    keyboard, hand = terminal()
    rig = Manual(lambda request: ask_in_terminal(request, keyboard, io.StringIO()))
    order = Order(lambda: rig.move(Angles(5.0)))
    wait(lambda: rig.status().state is State.MOVING, "nobody was asked")
    threading.Timer(0.1, rig.stop).start()
    assert isinstance(order.finished(), StoppedError)
    os.close(hand)


def test_handheld_has_no_axes_and_asks_nobody():
    rig = Handheld()
    assert rig.features.axes == ()
    assert not rig.features.automatic
    assert rig.status().state is State.IDLE
    assert rig.status().angles is None
    assert rig.move(Angles(0.0)) == rig.home() == Angles(0.0)
    rig.stop()
    rig.hold()
    rig.resume()


@pytest.mark.parametrize(
    "angles", [Angles(1.0), Angles(0.0, -5.0), Angles(float("nan")), Angles(0.0, float("inf"))]
)
def test_handheld_cannot_be_sent_anywhere(angles: Angles):
    with pytest.raises(LimitError, match="nothing turns here"):
        Handheld().move(angles)


@pytest.mark.parametrize("rig", [Handheld(), Manual(lambda request: request.confirm())])
def test_closed_rigs_do_nothing_more(rig: Handheld | Manual):
    rig.close()
    rig.close()
    assert rig.status().state is State.OFFLINE
    with pytest.raises(HardwareError):
        rig.home()
