"""Which Gaussians shine together, and of which only a lower bound was photographed."""

import numpy as np

from engine.geometry import project
from engine.light.gaussians.gaussians import isotropic_gaussians
from engine.surface.lighting.emitter_groups import _pixels_of, clipped_shares
from engine.types import Camera, Frames, Masks, Poses


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


def test_the_clipped_share_of_a_group_is_that_of_its_light_in_the_views_that_show_it():
    camera = Camera(40, 30, 40.0, 40.0, 20.0, 15.0)
    # Left and right; the right one is half a lamp three times as bright as its other half.
    means = np.array([[-1.0, 0, 4], [1.0, 0.5, 4], [1.0, -0.5, 4]])
    upright = np.tile([1.0, 0, 0, 0], (3, 1))
    radiance = np.array([[1.0] * 3, [3.0] * 3, [1.0] * 3])
    lights = isotropic_gaussians(means, upright, np.full((3, 3), 0.1), 5.0, radiance, 1)
    clipped = np.zeros((4, 30, 40), bool)
    clipped[:2, 18:, 25:] = True  # the bright half, in two of the four views
    frames = Frames(tuple("abcd"), np.ones((4, 30, 40, 3), np.float32), clipped, ~clipped & False, (0.0, 0.0))
    background = np.ones((4, 30, 40), bool)
    background[3] = False  # a view that shows nothing says nothing
    still = np.tile(np.eye(4)[:3], (4, 1, 1))
    poses = Poses(camera, still, np.ones(4, bool), np.zeros((0, 3)), "given", 0.0)
    group = np.array([0, 1, 1])
    shares = clipped_shares(lights, group, frames, Masks(background[3], background), poses)
    np.testing.assert_allclose(shares, [0, 3 / 4 * 2 / 3], rtol=1e-6)
