"""Another text has another name."""

from pathlib import Path

from app import sources


def test_another_source_has_another_digest(tmp_path: Path):
    (tmp_path / "a.py").write_text("x = 1\n")
    before = sources.digest(tmp_path)
    assert sources.digest(tmp_path) == before
    (tmp_path / "a.py").write_text("x = 2\n")
    assert sources.digest(tmp_path) != before
