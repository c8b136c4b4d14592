"""Features lie where they are in the photographs, and are looked for at the sizes of which some are kept."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from engine.progress import Progress
from engine.sfm import features
from engine.sfm.params import FeatureParams
from engine.types import Frames, Masks


@pytest.mark.parametrize(("count", "most"), [(48, 2500), (150, 1600), (1000, 800)])
def test_where_there_are_many_views_each_keeps_fewer_features(count: int, most: int) -> None:
    assert features.most_of_a_view(count, FeatureParams()) == most
    assert features.most_of_a_view(count, FeatureParams(maximum=500)) == 500


@pytest.mark.parametrize(
    ("width", "enlarged", "sought"), [(300, 2, 600), (620, 1, 620), (1200, 1, 600)]
)  # SIFT doubles what it is given
def test_spots_are_found_where_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int, enlarged: int, sought: int
) -> None:
    rng, shape, sigma = np.random.default_rng(0), (width // 2, width), width / 120
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    across = np.linspace(0.1, 0.9, 9) * width
    spots = np.stack(np.meshgrid(across, across[:4]), -1).reshape(-1, 2) + rng.uniform(-1, 1, (36, 2))
    light = sum(np.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * sigma**2)) for a, b in spots)
    none = np.zeros((1, *shape), bool)
    radiance = np.repeat((0.1 + light)[None, ..., None], 3, -1).astype(np.float32)
    frames, masks = Frames(("a",), radiance, none, none, (0.0, 0.0)), Masks(none[0], ~none)
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=width, height=shape[0], params=[width, 0, 0, 0.0])
    sizes, sift = [], features.sift
    monkeypatch.setattr(
        features, "sift", lambda picture, *rest: sizes.append(picture.shape[1]) or sift(picture, *rest)
    )

    database = features.detect(frames, masks, lens, FeatureParams(), tmp_path, Progress())
    with pycolmap.Database.open(database) as opened:
        found = opened.read_keypoints(1)[:, :2] / enlarged
        raw = np.asarray(opened.read_descriptors(1).data, float)
    assert sizes == [sought]
    off = found[:, None] - spots
    nearest = off[np.linalg.norm(off, axis=2).argmin(0), np.arange(len(spots))]
    hit = nearest[np.linalg.norm(nearest, axis=1) < sigma / 2]
    assert len(hit) > 0.8 * len(spots)
    np.testing.assert_allclose(
        hit.mean(0), 0, atol=1e-4 * width
    )  # half a pixel of the doubled picture is 4e-4
    np.testing.assert_allclose(hit.std(0), 0, atol=2e-4 * width)
    np.testing.assert_allclose(np.linalg.norm(raw, axis=1), 512, rtol=0.01)
