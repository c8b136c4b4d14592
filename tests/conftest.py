"""What holds for every test."""

from pathlib import Path

import pytest
from hypothesis import settings

from app import cores

# Two processes of tests on two cores, and the programs they start: what is compiled once serves all.
cores.prepare()

# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile("roomlight", deadline=None)
settings.load_profile("roomlight")


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
