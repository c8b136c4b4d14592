"""Features are looked for at the sizes of which some are kept."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from engine.progress import Progress
from engine.sfm import features
from engine.sfm.params import FeatureParams
from engine.types import Frames, Masks


@pytest.mark.parametrize(("width", "octave"), [(300, -1), (620, -1), (1200, 0)])
def test_large_photographs_are_not_doubled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int, octave: int
) -> None:
    asked: list[int] = []
    monkeypatch.setattr(pycolmap, "extract_features", lambda *args: asked.append(args[5].sift.first_octave))
    shape = (1, 60, width)
    none = np.zeros(shape, bool)
    frames = Frames(("a",), np.ones((*shape, 3), np.float32), none, none, (0.0, 0.0))
    masks = Masks(none[0], ~none)
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=width, height=60, params=[width, width / 2, 30, 0.0])
    features.detect(frames, masks, lens, FeatureParams(), tmp_path, Progress())
    assert asked == [octave]
