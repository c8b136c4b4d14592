"""What draws meshes and lines; two can: Open3D's older OpenGL renderer, and Filament where there is hardware for it.

A canvas belongs to the thread that made it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from app.viewer.parts import Part


class NoGraphics(Exception):
    """This machine cannot draw; holds (reason, remedy)."""

    def __init__(self, reason: str, remedy: str) -> None:
        super().__init__(reason, remedy)
        self.reason, self.remedy = reason, remedy


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """A pinhole whose axis goes through the picture's middle; focal length in pixels, depths in scene units."""

    cam_from_world: Float[np.ndarray, "3 4"]
    focal: float
    width: int
    height: int
    near: float
    far: float


Picture = tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w"]]
"""Colours 0 to 1, and depths, 0 where nothing is; the caller may write into both."""


class Canvas(Protocol):
    """Draws parts; `level` names one of several independent sets of them, made on first use."""

    name: str

    def show(self, level: int, parts: Mapping[str, Part]) -> None:
        """From now on exactly these parts are on this level; parts it has already cost nothing."""
        ...

    def draw(self, level: int, eye: Eye) -> Picture: ...
