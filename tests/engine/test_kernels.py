"""How kernels are compiled."""

import importlib
from pathlib import Path
from types import ModuleType

from numba.core.dispatcher import Dispatcher

ROOT = Path(__file__).parents[2]


def kernels() -> set[Dispatcher]:
    """All of the engine's and the window's that run on the CPU."""
    files = [
        path
        for part in ("engine", "app")
        for path in (ROOT / part).rglob("*.py")
        if "njit" in path.read_text()
    ]
    modules = [
        importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts)) for path in files
    ]
    return {thing for module in modules for thing in vars(module).values() if isinstance(thing, Dispatcher)}


def callees(kernel: Dispatcher) -> set[Dispatcher]:
    """The kernels that it names, by themselves or with their module's name."""
    names = kernel.py_func.__code__.co_names
    named = [kernel.py_func.__globals__.get(name) for name in names]
    within = [
        getattr(thing, name, None) for thing in named if isinstance(thing, ModuleType) for name in names
    ]
    return {thing for thing in named + within if isinstance(thing, Dispatcher)}


def taken_in(kernel: Dispatcher) -> bool:
    return kernel.targetoptions.get("inline") == "always" or bool(kernel.targetoptions.get("forceinline"))


def test_kernels_that_kernels_call_are_taken_into_them() -> None:
    """Else which of several compiled copies serves, and so how a result rounds, hangs on what was in the cache."""
    called = {callee for kernel in kernels() for callee in callees(kernel)}
    assert len(called) > 20
    left = sorted(
        f"{callee.py_func.__module__}.{callee.__name__}" for callee in called if not taken_in(callee)
    )
    assert left == []
