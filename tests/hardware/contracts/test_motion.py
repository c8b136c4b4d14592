"""Every rig keeps the promises of `Motion`: add its maker to `MAKERS` and it is held to them.

A maker is a function that returns a context manager: it yields a `Made` and takes everything down afterwards.
"""

from collections.abc import Iterator

import pytest

from tests.hardware.contracts import grbl_rigs, manual_rigs, zaber_rigs
from tests.hardware.contracts.motion import Made, MotionPromises

MAKERS = [
    grbl_rigs.turntable, grbl_rigs.gimbal, grbl_rigs.endless, grbl_rigs.fluidnc, grbl_rigs.grblhal,
    zaber_rigs.zaber_turntable, zaber_rigs.zaber_ended, zaber_rigs.zaber_gimbal, zaber_rigs.zaber_chain,
    manual_rigs.manual, manual_rigs.manual_tilting,
]  # fmt: skip


class TestMotion(MotionPromises):
    @pytest.fixture(params=MAKERS, ids=lambda maker: maker.__name__)
    def made(self, request: pytest.FixtureRequest) -> Iterator[Made]:
        with request.param() as made:
            yield made
