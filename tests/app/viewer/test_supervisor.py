"""The window's side of the drawing process: it never waits, and brings the picture back after a hang or a crash."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from app.viewer import supervisor as supervisors
from app.viewer.events import Event, Picture, Status
from app.viewer.frames import MemoryFull
from app.viewer.orbit import Orbit
from app.viewer.protocol import Contents, Probed, Style
from app.viewer.supervisor import Supervisor
from app.viewer.watch import Patience

EYE = Orbit((0.0, 0.0, 0.0), 1.0)
STYLE = Style()
CALM = Patience(ready=120, loaded=120, frame=120, pong=120)  # nothing is late on a busy machine
BRIEF = Patience(ready=120, loaded=120, frame=120, pong=120, restarts=1)
SHARP = Patience(ready=120, loaded=120, frame=1.5, pong=1.5)
BOUND_S = 60.0
SESSION = Path("/some/session")


class Heard:
    """What a listener was told."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.events: list[Event] = []

    def __call__(self, event: Event) -> None:
        with self.changed:
            self.events.append(event)
            self.changed.notify_all()

    def until(self, right: Callable[[list[Event]], object]) -> None:
        with self.changed:
            assert self.changed.wait_for(lambda: right(self.events), BOUND_S), self.statuses

    @property
    def statuses(self) -> list[Status]:
        return [event for event in self.events if isinstance(event, Status)]

    @property
    def pictures(self) -> list[Picture]:
        return [event for event in self.events if isinstance(event, Picture)]

    def state(self, state: str) -> None:
        self.until(lambda events: self.statuses and self.statuses[-1].state == state)

    def picture(self, number: int) -> Picture:
        self.until(lambda events: any(p.look.number == number for p in self.pictures))
        return [p for p in self.pictures if p.look.number == number][-1]


Make = Callable[..., tuple[Supervisor, Heard]]


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[Supervisor] = []

    def one(*words: str, patience: Patience = CALM) -> tuple[Supervisor, Heard]:
        heard = Heard()
        command = (sys.executable, "-m", "tests.app.viewer.fake_child", *words)
        made.append(Supervisor(heard, command, patience))
        return made[-1], heard

    yield one
    for supervisor in made:
        supervisor.close()


def look(supervisor: Supervisor, size: tuple[int, int] = (20, 10)) -> int:
    return supervisor.look(EYE, *size, True, STYLE)


def pid(supervisor: Supervisor) -> int:
    assert supervisor._child is not None
    return supervisor._child.pid


def test_nothing_is_started_before_there_is_something_to_show(make: Make) -> None:
    supervisor, heard = make()
    look(supervisor)
    supervisor.probe(0.5, 0.5)
    time.sleep(0.05)
    assert heard.events == []


def test_a_session_is_shown(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    picture = heard.picture(look(supervisor))
    assert (picture.width, picture.height) == (20, 10)
    assert picture.pixels == bytes([picture.look.number % 251]) * 800
    heard.state("showing")
    states = [status.state for status in heard.statuses]
    assert list(dict.fromkeys(states)) == ["starting", "loading", "showing"]
    assert any(isinstance(event, Contents) and event.folder == str(SESSION) for event in heard.events)
    assert os.getsid(pid(supervisor)) != os.getsid(0)  # what it computes is not counted as the window's


def test_of_many_wishes_the_newest_is_drawn_and_few_of_the_others(make: Make) -> None:
    supervisor, heard = make("--slow", "0.1")
    supervisor.show(SESSION)
    heard.state("showing")
    for _ in range(200):
        last = look(supervisor)
        time.sleep(0.002)
    heard.picture(last)
    assert len(heard.pictures) < 100  # some four, on a machine that is not busy
    numbers = [picture.look.number for picture in heard.pictures]
    assert numbers == sorted(numbers)


def test_a_larger_picture_gets_larger_memory(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    for size in ((8, 4), (64, 48), (300, 200), (8, 4)):
        picture = heard.picture(look(supervisor, size))
        assert len(picture.pixels) == 4 * size[0] * size[1]


def test_an_enormous_picture_is_drawn_smaller(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    picture = heard.picture(look(supervisor, (8000, 4000)))
    assert picture.width * picture.height <= supervisors.MOST_PIXELS
    assert picture.width / picture.height == pytest.approx(2.0, rel=0.01)


def test_a_killed_child_is_started_again_with_the_same_wish(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    number = look(supervisor)
    heard.picture(number)
    before = len(heard.pictures)
    os.kill(pid(supervisor), signal.SIGKILL)
    heard.until(lambda events: len(heard.pictures) > before)
    assert heard.pictures[-1].look.number == number
    again = [status for status in heard.statuses if status.state == "restarting"]
    assert again
    assert all("SIGKILL" in status.message for status in again)
    assert heard.statuses[-1].restarts == 1


def test_a_stopped_child_is_noticed_and_replaced(make: Make) -> None:
    supervisor, heard = make(patience=SHARP)
    supervisor.show(SESSION)
    heard.picture(look(supervisor))
    old = pid(supervisor)
    os.kill(old, signal.SIGSTOP)
    number = look(supervisor)
    heard.picture(number)
    assert any("did not answer" in status.message for status in heard.statuses)
    assert pid(supervisor) != old
    with pytest.raises(ProcessLookupError):
        os.kill(old, 0)


def test_a_stopped_child_is_noticed_even_if_nothing_is_asked(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisors, "PING_EVERY_S", 0.2)
    supervisor, heard = make(patience=SHARP)
    supervisor.show(SESSION)
    heard.picture(look(supervisor))
    os.kill(pid(supervisor), signal.SIGSTOP)
    heard.until(lambda events: any("pong" in status.message for status in heard.statuses))


def test_no_call_waits_for_a_stopped_child(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    heard.picture(look(supervisor))
    os.kill(pid(supervisor), signal.SIGSTOP)
    start = time.monotonic()
    for _ in range(3000):
        look(supervisor)
        supervisor.probe(0.5, 0.5)
        supervisor.show(SESSION)
    assert time.monotonic() - start < 5.0
    supervisor.close()


def test_after_too_many_restarts_the_view_stops_and_says_so(make: Make) -> None:
    supervisor, heard = make("--die-at", "load")
    supervisor.show(SESSION)
    heard.state("failed")
    assert heard.statuses[-1].restarts == CALM.restarts
    assert heard.statuses[-1].stuck
    assert "exit code 17" in heard.statuses[-1].message
    assert "fake: dying at load" in heard.statuses[-1].details
    assert supervisor._child is None


def test_retry_begins_anew_after_that(make: Make) -> None:
    supervisor, heard = make("--die-at", "ready", patience=BRIEF)
    supervisor.show(SESSION)
    heard.state("failed")
    before = len(heard.statuses)
    supervisor.retry()
    heard.until(lambda events: len(heard.statuses) > before)
    heard.state("failed")
    assert [status.state for status in heard.statuses[before:]].count("restarting") >= BRIEF.restarts


def test_a_machine_without_graphics_is_told_and_not_tried_again(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    supervisor, heard = make("--unable")
    supervisor.show(SESSION)
    heard.state("unable")
    assert "it is a fake" in heard.statuses[-1].message
    assert heard.statuses[-1].remedy == "use a real one"
    assert heard.statuses[-1].restarts == 0


def test_the_screen_is_used_only_if_nothing_else_works(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":77")
    supervisor, heard = make("--needs-screen")
    supervisor.show(SESSION)
    heard.picture(look(supervisor))
    assert heard.statuses[-1].state == "showing"


def test_a_damaged_session_is_told_and_the_next_one_shown(make: Make) -> None:
    supervisor, heard = make("--refuse")
    supervisor.show(SESSION)
    heard.state("refused")
    assert "damaged" in heard.statuses[-1].message
    child = pid(supervisor)
    supervisor.retry()
    heard.until(lambda events: [s.state for s in heard.statuses].count("refused") == 2)
    assert pid(supervisor) == child


def test_what_libraries_print_is_no_message(make: Make) -> None:
    supervisor, heard = make("--noise")
    supervisor.show(SESSION)
    heard.picture(look(supervisor))


def test_a_renderer_that_fell_is_not_used_again(make: Make) -> None:
    supervisor, heard = make("--filament-dies")
    supervisor.show(SESSION)
    heard.picture(look(supervisor))
    assert heard.statuses[-1].renderer == "Fake"
    assert heard.statuses[-1].restarts == 1


def test_a_probe_is_answered_also_when_there_is_nobody_to_ask(make: Make) -> None:
    supervisor, heard = make("--die-at", "ready", patience=BRIEF)
    supervisor.show(SESSION)
    heard.state("failed")
    number = supervisor.probe(0.25, 0.5)
    heard.until(lambda events: Probed(number, ()) in events)

    supervisor, heard = make()
    supervisor.show(SESSION)
    heard.state("showing")
    number = supervisor.probe(0.25, 0.5)
    heard.until(lambda events: Probed(number, (0.25, 0.5, 1.0)) in events)


def test_painted_layers_come_back_after_a_restart(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    heard.state("showing")

    def painted(events: list[Event]) -> int:
        return sum(isinstance(event, Contents) and "relit" in event.surfaces for event in events)

    supervisor.paint("relit", Path("/relit.npy"))
    heard.until(lambda events: painted(events) == 1)
    os.kill(pid(supervisor), signal.SIGKILL)
    heard.until(lambda events: painted(events) == 2)


def test_another_session_is_loaded_into_the_same_child(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    heard.state("showing")
    child = pid(supervisor)
    supervisor.show(Path("/other"))
    heard.until(lambda events: any(isinstance(e, Contents) and e.folder == "/other" for e in events))
    assert pid(supervisor) == child


def test_no_memory_for_pictures_is_told(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(size: int) -> None:
        raise MemoryFull("/dev/shm: full")

    monkeypatch.setattr(supervisors, "FrameReader", full)
    supervisor, heard = make()
    supervisor.show(SESSION)
    look(supervisor)
    heard.state("failed")
    assert "full" in heard.statuses[-1].remedy


def test_closing_ends_the_child_and_leaves_no_memory(make: Make) -> None:
    supervisor, heard = make()
    supervisor.show(SESSION)
    heard.picture(look(supervisor))
    child, memory = pid(supervisor), supervisor._reader
    assert memory is not None
    supervisor.close()
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)
    assert not Path("/dev/shm", memory.name).exists()
    supervisor.close()
    look(supervisor)  # nobody listens, nothing happens
