"""Writes app/kernels.json anew: what runs of the bundled session at every preset compile, the dearest first.

Entries that only other programs ask for (the 3D view, the quick benchmark) stay as long as there is such a kernel.

    python -m tests.bench.kernels        a few minutes
"""

import importlib
import json
import os
import tempfile
import time
from pathlib import Path

import numba
from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.event import Event, Listener, install_listener

from app import kernels
from tests.end_to_end import bundled


class Compilations(Listener):
    """Notes kernels that are compiled, without those that are for the sake of another: seconds and types of each."""

    def __init__(self) -> None:
        self.found: dict[str, dict[str, float]] = {}
        self.begun: list[float] = []

    def on_start(self, event: Event) -> None:
        self.begun.append(time.monotonic())

    def on_end(self, event: Event) -> None:
        seconds = time.monotonic() - self.begun.pop()
        if not self.begun:
            kernel = event.data["dispatcher"].py_func
            arguments = ", ".join(map(written, event.data["args"]))
            self.found.setdefault(f"{kernel.__module__}.{kernel.__name__}", {})[arguments] = seconds


def written(kind: types.Type) -> str:
    """A type as one writes it in Python."""
    if not isinstance(kind, types.Array) or not kind.mutable:
        return repr(kind)
    axes = [":"] * kind.ndim
    if kind.layout != "A":
        axes[-1 if kind.layout == "C" else 0] = "::1"
    return f"{kind.dtype}[{','.join(axes)}]"


def is_kernel(kernel: str) -> bool:
    module, name = kernel.rsplit(".", 1)
    return isinstance(getattr(importlib.import_module(module), name, None), Dispatcher)


def main() -> None:
    """Run the presets with nothing kept, and write the list."""
    with tempfile.TemporaryDirectory() as work:
        # Numba has read its environment; the commands are not to look for a cache of their own.
        os.environ["NUMBA_CACHE_DIR"] = numba.config.CACHE_DIR = work
        from app.cli import main as roomlight

        session = bundled.copy(bundled.DEMO, Path(work) / "session", views=12)
        asked = Compilations()
        with install_listener("numba:compile", asked):
            for preset in ("draft", "standard", "fine"):
                roomlight(["process", str(session), "--preset", preset, "--set", "hdr.long_edge_px=160"])
    dearest = sorted(asked.found, key=lambda kernel: -sum(asked.found[kernel].values()))
    others = {
        kernel: arguments
        for kernel, arguments in json.loads(kernels.LIST.read_text()).items()
        if kernel not in asked.found and is_kernel(kernel)
    }
    kernels.LIST.write_text(
        json.dumps({k: sorted(asked.found[k]) for k in dearest} | others, indent=1) + "\n"
    )


if __name__ == "__main__":
    main()
