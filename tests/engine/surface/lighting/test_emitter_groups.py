"""Which Gaussians shine together, and of which only a lower bound was photographed."""

import numpy as np

from engine.geometry import project
from engine.surface.lighting.emitter_groups import _pixels_of
from engine.types import Camera


def test_what_distortion_folds_back_into_the_picture_is_not_in_it():
    camera = Camera(2048, 1365, 2200.0, 2200.0, 1024.0, 682.5, k1=-0.1)
    angle = np.radians([10.0, 20.0, 40.0, 72.0, 73.0])
    points = np.stack([np.sin(angle), np.zeros(5), np.cos(angle)], 1)
    folded = project(camera, points)
    assert 0 < folded[3, 0] < 2048  # the lens's polynomial alone says that it is seen
    inside, (u, v) = _pixels_of(camera, np.eye(4)[:3], points, 2048, 1365)
    assert inside.tolist() == [True, True, False, False, False]
    assert np.abs(u - folded[:2, 0]).max() < 1
    assert (v == 682).all()
