"""A record reads back as it was written, says where it was measured, and a wrong file is refused."""

import json
import math
from dataclasses import fields
from pathlib import Path

import pytest

from app.bench import record
from app.bench.record import BenchError, Metric, Record

METRICS = (
    Metric("booth-blob/standard/normal", 3.25, "deg", "lower", 0.1),
    Metric("booth-blob/reference/seconds", 9000.0, "s", "lower", None, True),
)


def a_record() -> Record:
    return Record("table", "quick", "given", 3, record.machine("cpu"), record.versions(), METRICS)


def test_a_record_reads_back_as_it_was(tmp_path: Path):
    record.write(a_record(), tmp_path / "m.json")
    assert record.read(tmp_path / "m.json") == a_record()


def test_the_same_measurement_is_the_same_file_and_tells_no_time(tmp_path: Path):
    record.write(a_record(), tmp_path / "a.json")
    record.write(a_record(), tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    content = json.loads((tmp_path / "a.json").read_text())
    assert set(content) == {"schema", *(f.name for f in fields(Record))}
    assert set(content["metrics"][0]) == {"key", "value", "unit", "direction", "tolerance", "extrapolated"}
    assert content["machine"]["processor"]
    assert content["machine"]["cores"] >= 1
    assert content["machine"]["gpu"] is None
    assert {"studio", "engine", "python", "roomlight"} <= set(content["versions"])


def test_no_answer_is_null_in_the_file_and_nan_in_memory(tmp_path: Path):
    endless = Metric("a/b/albedo", math.inf, "dB", "higher", 0.2)
    record.write(Record("table", "quick", "given", 0, {}, {}, (endless,)), tmp_path / "m.json")
    assert json.loads((tmp_path / "m.json").read_text())["metrics"][0]["value"] is None
    assert math.isnan(record.read(tmp_path / "m.json").metrics[0].value)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("not json", "no record"),
        ("[]", "no record"),
        ('{"schema": 99}', "schema is not 1"),
        ('{"schema": 1, "metrics": [{"key": "a"}]}', "no record"),
        (
            '{"schema": 1, "metrics": [{"key": "a", "value": 1, "unit": "s", "direction": "sideways"}]}',
            "sideways",
        ),
        (
            '{"schema": 1, "metrics": [{"key": "a", "value": 1, "unit": "s", "direction": "lower", "tolerance": -1}]}',
            "tolerance -1",
        ),
    ],
)
def test_a_file_that_is_no_record_is_refused(tmp_path: Path, text: str, why: str):
    path = tmp_path / "m.json"
    path.write_text(text)
    with pytest.raises(BenchError, match=why):
        record.read(path)
