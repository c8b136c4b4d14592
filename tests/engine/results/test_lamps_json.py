"""Lamps as JSON: any reader finds the record's own numbers, and what they mean."""

import json
from typing import NoReturn

import numpy as np
import pytest

from engine.results.lamps_json import lamps_json
from engine.types import Lamps
from tests.engine.results.test_export import lamps


def no_nan(word: str) -> NoReturn:
    raise AssertionError(f"{word} is no JSON")


@pytest.mark.parametrize("count", [0, 1, 3])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_lamps_read_back_are_the_lamps_of_the_record(count: int, kind: type):
    drawn = lamps(count)
    written = Lamps(*(a.astype(kind) for a in (drawn.centres, drawn.radii, drawn.radiance)), drawn.clipped)
    content = json.loads(lamps_json(written, "metre"), parse_constant=no_nan)
    assert content["unit_of_length"] == "metre"
    assert "world" in content["frame"]
    assert "Rec.709" in content["radiance"]
    assert "shading told" in content["clipped"]
    assert "lower bound" in content["clipped"]
    assert len(content["lamps"]) == count
    for name, field in (
        ("centre", "centres"),
        ("radius", "radii"),
        ("radiance", "radiance"),
        ("clipped", "clipped"),
    ):
        wanted = getattr(written, field)
        read = np.array([lamp[name] for lamp in content["lamps"]], wanted.dtype).reshape(wanted.shape)
        np.testing.assert_array_equal(read, wanted)


def test_a_lamp_that_is_no_number_is_not_written():
    broken = Lamps(np.full((1, 3), np.nan), np.ones(1), np.ones((1, 3)), np.zeros(1, bool))
    with pytest.raises(ValueError, match="not JSON compliant"):
        lamps_json(broken, "metre")
