from pathlib import Path

import numpy as np
import pytest

from engine.color import CIE_XYZ, REC709, as_rec709, rec709_from, xyz_from
from engine.errors import RawError

ACES = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)


def test_rec709_of_itself_is_the_identity():
    np.testing.assert_allclose(rec709_from(REC709), np.eye(3), atol=1e-12)


def test_luminance_of_rec709_is_that_of_the_standard():
    np.testing.assert_allclose(xyz_from(REC709)[1], (0.2126, 0.7152, 0.0722), atol=1e-4)


@pytest.mark.parametrize("primaries", [ACES, CIE_XYZ])
def test_primaries_that_are_no_colours_keep_white(primaries):
    np.testing.assert_allclose(rec709_from(primaries).sum(axis=1), 1, atol=1e-9)


def test_aces_by_its_published_matrix():
    # SMPTE ST 2065-1's matrix from AP0 to CIE XYZ, row of Y.
    np.testing.assert_allclose(xyz_from(ACES)[1], (0.3439664498, 0.7281660966, -0.0721325464), atol=1e-7)


@pytest.mark.parametrize(
    "primaries",
    [(0.0,) * 8, (0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3), (np.nan,) * 8, (*REC709[:6], 0.3, 0.0), (*REC709[:6], 0.7, 0.1)],
)  # fmt: skip
def test_primaries_that_span_no_colours_are_refused(primaries):
    with pytest.raises(RawError, match=r"a\.exr: its primaries .* span no colours"):
        as_rec709(Path("a.exr"), np.ones((2, 2, 3), np.float32), primaries)
