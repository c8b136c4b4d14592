"""The virtual PTP camera that comes with python-gphoto2: another's camera, spoken to through all of libgphoto2.

libgphoto2 finds it where its port drivers are `vusb` and `VCAMERADIR` is set; both are asked for at each opening. It is
called a Nikon D750, hands out the one JPEG of its folder for every photograph, tells no Exif, and has no more room after
26 photographs of one session.
"""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import gphoto2
from PIL import Image

PHOTOGRAPHS = 26  # until its store is full
DRIVERS = Path(gphoto2.__file__).parent / "libgphoto2" / "vusb"


@contextlib.contextmanager
def plugged_in(size: tuple[int, int] = (64, 48)) -> Iterator[bytes]:
    """Within, it answers on 'usb:001,001'; gives the bytes of its photograph."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "DCIM" / "100VCAM" / "A0001.JPG"
        path.parent.mkdir(parents=True)
        Image.effect_noise(size, 60).save(path, quality=95)
        with mock.patch.dict(os.environ, {"VCAMERADIR": f"{folder}/", "IOLIBS": str(DRIVERS)}):
            yield path.read_bytes()
