"""CUDA without a device: the kernels in numba's simulator, their compilation, and what is refused."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from engine.errors import LightError
from engine.light import kernels_cuda, on_cuda
from engine.light.rasterise import workers

HERE = Path(__file__).parent
SIMULATED = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"


def python(*words: str, **environment: str) -> subprocess.CompletedProcess:
    """A child of this very Python, in the project's root."""
    return subprocess.run(
        [sys.executable, *words], cwd=HERE.parents[2], env={**os.environ, **environment},
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip


def test_the_kernels_agree_in_the_simulator() -> None:
    # The simulator is slow enough without types that are looked at.
    options = ("-p", "no:cacheprovider", "-p", "no:xdist", "-o", "addopts=-q")
    done = python("-m", "pytest", *options, str(HERE / "test_kernels_cuda.py"), NUMBA_ENABLE_CUDASIM="1")
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert "passed" in done.stdout
    assert "skipped" not in done.stdout


def test_no_device_is_refused_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_cuda, "available", lambda: False)
    with pytest.raises(LightError, match="use device cpu"), workers(1, "cuda"):
        pass


def test_without_numbas_cuda_the_module_imports_and_nothing_is_available() -> None:
    done = python(
        "-c",
        "import sys; sys.modules['numba.cuda'] = None\n"
        "from engine.light import kernels_cuda, on_cuda\n"
        "assert kernels_cuda.cuda is None and not on_cuda.available()",
    )
    assert done.returncode == 0, done.stderr


def _arguments(name: str) -> tuple:
    """Of the types, not the sizes, that `on_cuda` launches with."""

    def f32(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.float32)

    one, columns = np.float32(0), (f32(1, 64), f32(1, 64), np.zeros((1, 64), np.int32))
    starts, image, grads = np.zeros(2, np.int64), f32(1, 1, 5), f32(1, 18)
    tiled = (f32(1, 17), starts, np.zeros(1, np.int32), np.zeros(4), one, 0, *columns, image)
    loss = (f32(1, 1, 3), f32(1, 1), np.zeros((1, 1), bool), one, one, f32(1, 1))
    return {
        "forward": tiled,
        "backward": (*tiled, *loss, f32(1, 64), f32(1, 64), grads),
        "collect": (grads, starts, starts, grads),
    }[name]


@pytest.mark.parametrize("name", ["forward", "backward", "collect"])
def test_kernels_compile_for_a_device_in_single_precision(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if SIMULATED or kernels_cuda.cuda is None:
        pytest.skip("no compiler in the simulator")
    import numba
    from numba.cuda import dispatcher
    from numba.cuda.cudadrv import nvvm
    from numba.cuda.cudadrv.error import NvvmSupportError

    try:
        nvvm.NVVM()
    except NvvmSupportError:
        pytest.skip("no libNVVM here")

    class Device:
        compute_capability = (8, 0)

    monkeypatch.setattr(dispatcher, "get_current_device", Device)  # there may be none
    signature = tuple(numba.typeof(argument) for argument in _arguments(name))
    code, _ = kernels_cuda.cuda.compile_ptx(getattr(kernels_cuda, name).py_func, signature, cc=(8, 0))
    assert ".visible .entry" in code
    assert "cvt.f64.f32" not in code  # a constant without np.float32 would widen what it touches
    assert "call" not in code  # nothing allocates, nothing raises
