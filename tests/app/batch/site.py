"""A cluster on loopback, of the programs that docs/automation.md starts: a scheduler, and workers that share nothing but the disk."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from distributed import Client

ROOT = Path(__file__).parents[3]
LONG_S = 120
WORKER = ("--nthreads", "1", "--memory-limit", "0", "--resources", "roomlight_gb=4", "--no-dashboard")


def free_port() -> int:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return asked.getsockname()[1]


class Site:
    """Its programs work in `folder`, and leave there what they say."""

    def __init__(self, folder: Path) -> None:
        self.folder, port = folder, free_port()
        self.address = f"tcp://127.0.0.1:{port}"
        self._scheduler = ("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
        self._all: list[subprocess.Popen[bytes]] = []

    def schedule(self) -> subprocess.Popen[bytes]:
        return self._start(*self._scheduler)

    def work(self, *options: str) -> subprocess.Popen[bytes]:
        return self._start("worker", self.address, *WORKER, "--local-directory", str(self.folder), *options)

    def settle(self, workers: int) -> None:
        """Wait until so many workers are there."""
        with Client(self.address, timeout=LONG_S, set_as_default=False) as client:
            client.wait_for_workers(workers, LONG_S)

    def close(self) -> None:
        for process in self._all:
            process.terminate()  # a worker takes its own children along
        for process in self._all:
            process.wait(LONG_S)

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        path = os.pathsep.join([str(ROOT), str(self.folder)])
        with (self.folder / f"{len(self._all)}-{words[0]}.log").open("wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", *words], stdout=log, stderr=subprocess.STDOUT, cwd=self.folder,
                env={**os.environ, "PYTHONPATH": path},
            )  # fmt: skip
        self._all.append(process)
        return process


def wait_until(what: Callable[[], Any]) -> None:
    end = time.monotonic() + LONG_S
    while not what() and time.monotonic() < end:
        time.sleep(0.02)
