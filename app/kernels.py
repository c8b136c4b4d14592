"""Compile kernels before they are asked for: once for each text of them, on all cores.

`kernels.json` says of what types they are asked for by a session's run at the presets, by the 3D view and by the quick
benchmark. Whatever else asks compiles when it does, and keeps that too.

    python -m app.kernels; `python -m tests.bench.kernels` writes the list anew
"""

import hashlib
import importlib
import importlib.metadata
import json
import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from app import cores

LIST = Path(__file__).with_name("kernels.json")
"""Kernels by module and name, the dearest first, with their arguments' types as numba writes them."""


def compile_all() -> None:
    """Compile what is not kept yet, and say so; next to no time where all is."""
    cores.prepare()
    text = LIST.read_text()
    # Numba keeps kernels by their file's place.
    name = hashlib.sha256(f"{importlib.metadata.version('numba')} {LIST} {text}".encode()).hexdigest()[:16]
    done = Path(os.environ["NUMBA_CACHE_DIR"], f"compiled-{name}")
    if done.exists():
        return
    asked, start = json.loads(text), time.monotonic()
    print(f"roomlight: compiling {len(asked)} kernels (a minute, once)", file=sys.stderr, flush=True)
    # A process that is begun anew holds none of this one's threads.
    with ProcessPoolExecutor(len(os.sched_getaffinity(0)), multiprocessing.get_context("spawn")) as pool:
        for _ in pool.map(compile_one, asked, asked.values()):
            pass
    done.touch()
    print(f"roomlight: compiled them in {time.monotonic() - start:.0f} s", file=sys.stderr)


def compile_one(kernel: str, signatures: list[str]) -> None:
    """Compile a kernel for arguments of these types."""
    cores.prepare()
    from numba.core.sigutils import normalize_signature

    module, name = kernel.rsplit(".", 1)
    for signature in signatures:
        arguments, _ = normalize_signature(f"({signature},)")
        getattr(importlib.import_module(module), name).compile(arguments)


if __name__ == "__main__":
    compile_all()
