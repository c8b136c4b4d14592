"""Our PNG bytes as other libraries read them."""

import io

import cv2
import numpy as np
import pytest
from PIL import Image

from engine.errors import ExportError
from engine.io.png import encode, srgb


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(7, 5), (7, 5, 3), (1, 1), (300, 2, 3)])
def test_samples_come_back_bit_for_bit(dtype, shape):
    samples = np.random.default_rng(3).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    read = cv2.imdecode(np.frombuffer(encode(samples), np.uint8), cv2.IMREAD_UNCHANGED)
    assert read.dtype == dtype
    assert (read == (samples[..., ::-1] if samples.ndim == 3 else samples)).all()


def test_text_and_transfer_are_written_inside():
    image = Image.open(
        io.BytesIO(encode(np.zeros((2, 3), np.uint8), "linear", {"near": "0.5", "who": "Zoë"}))
    )
    image.load()
    assert image.info["near"] == "0.5"
    assert image.info["who"] == "Zoë"
    assert image.info["gamma"] == pytest.approx(1.0)
    assert Image.open(io.BytesIO(encode(np.zeros((2, 3, 3), np.uint8), "srgb"))).info["srgb"] == 0


def test_four_channels_are_refused():
    with pytest.raises(ExportError, match="h x w x 3"):
        encode(np.zeros((2, 2, 4), np.uint8))


def test_srgb_has_the_standards_values():
    assert srgb(np.array([0.0, 0.0031308, 0.18, 1.0, 7.0])) == pytest.approx(
        [0.0, 0.04045, 0.46135613, 1.0, 1.0], abs=2e-5
    )
