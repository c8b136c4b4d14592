"""Promises of `tests.bench.fuzz`: what breaks is counted, and little of every kind of file breaks nothing."""

import os
import time
from pathlib import Path

import pytest

from tests.bench import fuzz, fuzz_samples
from tests.bench.fuzz_samples import Sample


def _write(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "a").write_bytes(b"whole")
    return folder / "a"


def _dies(path: Path) -> None:
    os.abort()


def _raises(path: Path) -> None:
    raise ZeroDivisionError("of a library")


def _sleeps(path: Path) -> None:
    time.sleep(60)


@pytest.mark.parametrize(
    ("reader", "verdict"),
    [(_dies, "died (-6)"), (_raises, "ZeroDivisionError: of a library"), (_sleeps, "never ends")],
)
def test_what_breaks_is_counted_and_the_next_file_is_read(tmp_path, monkeypatch, reader, verdict):
    def read(path: Path) -> None:
        if path.read_bytes() != b"whole":
            reader(path)

    monkeypatch.setitem(fuzz_samples.KINDS, "own", Sample(_write, read))
    if reader is _sleeps:
        monkeypatch.setattr(fuzz, "LONGEST_S", 0.2)
    outcomes = fuzz.run(2, 0, ["own"], keep=tmp_path)
    assert [one.verdict for one in outcomes] == [verdict] * 2
    assert all(one.broken for one in outcomes)
    assert len(list(tmp_path.glob("own-*/a"))) == 2


def test_damaged_files_of_every_kind_are_read_or_refused():
    outcomes = fuzz.run(10 * len(fuzz_samples.KINDS), 7, list(fuzz_samples.KINDS))
    assert not [one for one in outcomes if one.broken]
    assert {one.verdict for one in outcomes} == {fuzz.READ, fuzz.REFUSED}
