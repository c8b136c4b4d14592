"""What holds for every test."""

import dataclasses
import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jaxtyping
import pytest
from hypothesis import settings

from app import cores

# Two processes of tests on two cores, and the programs they start: what is compiled once serves all.
cores.prepare()

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("roomlight", deadline=None)
settings.load_profile("roomlight")


class Checks:
    """Shapes and types are looked at in the first calls of every function in every test, and in some of the others: what a solve
    calls ten thousand times it calls with the same, and looking took as long as solving. What looks is made when a function is
    first called: of a hundred functions that a process of tests imports it calls ten."""

    FIRST, EVERY = 20, 50
    test = 0


jaxtyped = jaxtyping.jaxtyped


def checked(*, typechecker: Any) -> Callable[[Any], Any]:
    """In the place of `jaxtyping.jaxtyped`, which makes two functions beside each that is defined."""

    def lazily(thing: Any) -> Any:
        if isinstance(thing, classmethod | staticmethod):
            return type(thing)(lazily(thing.__func__))
        if isinstance(thing, property):
            return property(*(one and lazily(one) for one in (thing.fget, thing.fset, thing.fdel)))
        if inspect.isclass(thing):
            if dataclasses.is_dataclass(thing) and "__init__" in vars(thing):
                thing.__init__ = lazily(thing.__init__)
            return thing
        looking, calls, test = None, 0, Checks.test

        @functools.wraps(thing)
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal looking, calls, test
            calls, test = calls + 1 if test == Checks.test else 1, Checks.test
            if calls > Checks.FIRST and calls % Checks.EVERY > 0:
                return thing(*args, **kwargs)
            if looking is None:
                looking = jaxtyped(thing, typechecker=typechecker)
            return looking(*args, **kwargs)

        return call

    return lazily


jaxtyping.jaxtyped = checked


def pytest_runtest_setup() -> None:
    Checks.test += 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Devices keep their own pace: who waits for them does so at first, while there is most else to compute, and not at the end."""
    items.sort(key=lambda item: not item.nodeid.startswith("tests/hardware/"))


class Deaths:
    """Says how a process of tests ended that died in the middle of them: pytest itself only says that it did."""

    def __init__(self, reporter: pytest.TerminalReporter) -> None:
        self.reporter = reporter

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: object, error: object) -> None:
        if error:
            memory = Path("/proc/meminfo")
            free = memory.read_text().splitlines()[2] if memory.exists() else "memory unknown"
            self.reporter.write_line(f"{node} ended with {ending(node)}; {free}")


def ending(node: object) -> str:
    """The exit code of a worker's process: minus the signal's number if one killed it (execnet keeps it inside)."""
    try:
        return str(node.gateway._io.popen.wait(10))  # type: ignore[attr-defined]
    except Exception as fault:
        return f"an unknown exit code ({fault!r})"


@pytest.hookimpl(trylast=True)  # after the reporter is there
def pytest_configure(config: pytest.Config) -> None:
    reporter = config.pluginmanager.getplugin("terminalreporter")
    if isinstance(reporter, pytest.TerminalReporter):
        config.pluginmanager.register(Deaths(reporter), "deaths")
