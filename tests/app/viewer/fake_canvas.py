"""A canvas that draws nothing but remembers what it was asked: one flat colour, with depth in the left half."""

from collections.abc import Mapping

import numpy as np

from app.viewer.canvas import Eye, Picture
from app.viewer.parts import Part

SEEN_DEPTH = 3.0


class FakeCanvas:
    name = "Fake"

    def __init__(self) -> None:
        self.shown: dict[int, set[str]] = {}
        self.drawn: list[tuple[int, Eye]] = []

    def show(self, level: int, parts: Mapping[str, Part]) -> None:
        self.shown[level] = set(parts)

    def draw(self, level: int, eye: Eye) -> Picture:
        self.drawn.append((level, eye))
        depth = np.zeros((eye.height, eye.width), np.float32)
        depth[:, : eye.width // 2] = SEEN_DEPTH
        return np.full((eye.height, eye.width, 3), 0.5, np.float32), depth
