"""Call the command line, and hold a session against what it was before."""

import hashlib
import subprocess
import sys
from pathlib import Path

import pytest

from app.cli import main

ROOT = Path(__file__).parents[2]


def digest(session: Path) -> str:
    content = hashlib.sha256()
    for path in sorted(session.rglob("*")):
        if path.is_file() and path.name != "run.lock":
            content.update(str(path.relative_to(session)).encode() + path.read_bytes())
    return content.hexdigest()


def refused(capsys: pytest.CaptureFixture[str], *argv: object) -> str:
    """Run a command that must fail; its one line."""
    capsys.readouterr()
    code = main([str(word) for word in argv])
    error = capsys.readouterr().err
    assert code == 2
    assert error.count("\n") == 1, error
    assert "Traceback" not in error
    return error


def command(*argv: object, **options) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "app.cli", *map(str, argv)]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, **options)
