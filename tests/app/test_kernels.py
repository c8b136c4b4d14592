"""Set-up compiles kernels once. That a run then compiles none is tested where all stages run: tests/end_to_end/test_process.py."""

import importlib
import json
import os
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.sigutils import normalize_signature

from app import kernels

ASKED = json.loads(kernels.LIST.read_text())


@pytest.mark.parametrize("kernel", ASKED)
def test_what_is_listed_is_a_kernel_with_so_many_arguments(kernel: str) -> None:
    module, name = kernel.rsplit(".", 1)
    found = getattr(importlib.import_module(module), name)
    assert isinstance(found, Dispatcher)
    for signature in ASKED[kernel]:
        assert len(normalize_signature(f"({signature},)")[0]) == found.py_func.__code__.co_argcount


def test_kernels_are_compiled_in_other_processes_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = tmp_path / "kernels.json"
    listed.write_text(json.dumps({"engine.light.gaussians.rasterize_kernels.longest": ["int64[::1]"]}))
    monkeypatch.setattr(kernels, "LIST", listed)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    (tmp_path / "kept").mkdir()
    kernels.compile_all()
    assert "compiling 1 kernels" in capsys.readouterr().err
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "kept").rglob("*.nbc")}
    assert len(kept) == 1
    kernels.compile_all()
    assert capsys.readouterr().err == ""
    listed.write_text(json.dumps({"engine.light.gaussians.rasterize_kernels.longest": ["int64[::1]"] * 2}))
    kernels.compile_all()  # as after an update; what is kept already is not compiled anew
    assert "compiling" in capsys.readouterr().err
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "kept").rglob("*.nbc")} == kept
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "kept")
