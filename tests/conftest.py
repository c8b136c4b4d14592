"""What holds for every test."""

from pathlib import Path

import jaxtyping
import pytest
from hypothesis import settings

from app import cores

# Two processes of tests on two cores, and the programs they start: what is compiled once serves all.
cores.prepare()

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("roomlight", deadline=None)
settings.load_profile("roomlight")


class Sparing(type(jaxtyping.config)):
    """Shapes and types are looked at in the first calls of every test, and in some of the others: what a solve calls ten thousand
    times it calls with the same, and looking took as long as solving."""

    FIRST, EVERY = 2000, 50
    calls = 0

    @property
    def jaxtyping_disable(self) -> bool:
        self.calls += 1
        spared = self.calls > self.FIRST and self.calls % self.EVERY > 0
        return spared or self.__dict__["jaxtyping_disable"]  # what a person set (JAXTYPING_DISABLE)


jaxtyping.config.__class__ = Sparing


def pytest_runtest_setup() -> None:
    jaxtyping.config.calls = 0


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
