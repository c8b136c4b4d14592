"""What kernels answer in a process of its own, where a cache of kernels is empty or full."""

import contextlib
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np


def answer(module: str, cache: Path, *words: Path) -> str:
    """What a module of tests prints when it is run with these words, and finds and keeps its kernels in `cache`."""
    child = subprocess.run(
        [sys.executable, "-m", module, *words], cwd=Path(__file__).parents[2],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)}, stdout=subprocess.PIPE, text=True, check=True,
    )  # fmt: skip
    return child.stdout


def copied(to: Path, without: str) -> None:
    """The kernels that this process keeps, but for some, in a cache of its own. Others may be writing there."""
    for file in Path(os.environ["NUMBA_CACHE_DIR"]).rglob("*.nb[ci]"):
        if not file.match(without):
            (to / file.parent.name).mkdir(exist_ok=True)
            with contextlib.suppress(FileNotFoundError):
                shutil.copy2(file, to / file.parent.name)


def digest(*answers: np.ndarray) -> str:
    """A hash of every bit of them."""
    return hashlib.sha256(b"".join(np.ascontiguousarray(x).tobytes() for x in answers)).hexdigest()


def tell(*answers: np.ndarray) -> None:
    """Print that hash."""
    print(digest(*answers))
