"""Every camera keeps the promises of `Camera`: add its maker to `MAKERS` and it is held to them.

A maker is a function that returns a context manager: it yields a `Made` and takes everything down afterwards.
"""

from collections.abc import Iterator

import pytest

from tests.hardware.contracts import cameras
from tests.hardware.contracts.camera import CameraPromises, Made

MAKERS = [cameras.virtual, cameras.folder, cameras.canon, cameras.ptp_camera]


class TestCamera(CameraPromises):
    @pytest.fixture(params=MAKERS, ids=lambda maker: maker.__name__)
    def made(self, request: pytest.FixtureRequest) -> Iterator[Made]:
        with request.param() as made:
            yield made
