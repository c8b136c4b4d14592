"""Pictures of `app/inspect/falsecolour.py` as Qt draws them, without copying."""

import numpy as np
from jaxtyping import UInt8
from PySide6.QtGui import QImage


def image_of(pixels: UInt8[np.ndarray, "h w 4"]) -> QImage:
    """A QImage over the array's own memory, which it keeps alive."""
    pixels = np.ascontiguousarray(pixels)
    height, width = pixels.shape[:2]
    image = QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_ARGB32_Premultiplied)
    image.pixels = pixels  # pyrefly: ignore[missing-attribute] the image does not own its memory
    return image
