"""The report's pictures show what the numbers say."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from engine.results.report import embedded_images
from engine.types import Panorama
from tests.engine.ball import ball


def opened(uri: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))))


def test_maps_are_transparent_outside_the_object():
    surface = ball()
    image = opened(embedded_images.normals(surface.normal, surface.mask))
    assert (image[..., 3] == 255 * surface.mask).all()
    top = np.nonzero(surface.mask)[0].min()
    column = int(np.nonzero(surface.mask[top])[0].mean())
    assert image[top, column, 1] > 220  # green is up


def test_outside_the_object_no_colour_means_anything_even_where_transparency_is_not_known():
    inside = np.array([[True, False]])
    image = opened(embedded_images.scalar(np.array([[-1.0, -1.0]]), inside, -1.0, 1.0, "RdBu_r"))
    assert image[0, 0, 2] > image[0, 0, 0] + 60  # the map's blue end
    assert (image[0, 1] == [embedded_images.OUTSIDE] * 3 + [0]).all()


def test_scalars_take_the_colour_maps_ends():
    values = np.array([[0.0, 2.0, 9.0, -5.0]])
    image = opened(embedded_images.scalar(values, np.ones((1, 4), bool), 0.0, 2.0, "viridis"))
    ends = opened(embedded_images.bar("viridis"))
    assert (image[0, 1, :3] == image[0, 2, :3]).all()
    assert (image[0, 0, :3] == ends[0, 0]).all()
    assert (image[0, 2, :3] == ends[0, -1]).all()
    assert (image[0, 3, :3] == ends[0, 0]).all()


def test_the_crop_holds_the_object_with_a_margin():
    mask = np.zeros((50, 60), bool)
    mask[20:30, 0:20] = True
    rows, columns = embedded_images.crop(mask)
    assert (rows.start, rows.stop, columns.start, columns.stop) == (18, 32, 0, 22)
    assert embedded_images.crop(np.zeros((5, 5), bool)) == (slice(None), slice(None))


def test_the_seen_share_is_by_solid_angle():
    seen = np.zeros((90, 180))
    seen[:30] = 1  # the cap within 60 degrees of up is a quarter of the sphere
    light = Panorama("v", np.ones((90, 180, 3)), seen)
    assert embedded_images.seen_share(light) == pytest.approx(0.25, abs=1e-3)


def test_guessed_light_is_hatched_and_photographed_light_is_not():
    seen = np.ones((64, 128))
    seen[32:] = 0
    image = opened(embedded_images.panorama(Panorama("v", np.ones((64, 128, 3)), seen))).astype(int)
    reddish = (image[..., 0] - image[..., 2]) > 60
    half = image.shape[0] // 2
    assert not reddish[: half - 8].any()
    assert 0.1 < reddish[half + 8 :].mean() < 0.5
