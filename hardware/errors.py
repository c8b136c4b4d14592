"""What can go wrong with devices and with the virtual studio; every message names a cause and a remedy.

Whether the same pose is worth another try, once the devices are ready again, is part of an error's class. What that
takes is for the devices to say: after `DisconnectedError` they are opened anew, after `PositionLostError` the rig is homed.
"""

from typing import ClassVar


class HardwareError(Exception):
    """Base of every device error a person can do something about."""

    transient: ClassVar[bool] = False  # the same request may succeed when it is made again


class StudioError(HardwareError):
    """The virtual studio was asked for something it cannot build or photograph."""


class AbsentError(HardwareError):
    """The named port or device is not there."""


class BusyError(HardwareError):
    """Another program holds the port or device."""


class AccessError(HardwareError):
    """This user may not open the port or device."""


class WrongDeviceError(HardwareError):
    """Something answers, but not what was named: another firmware, version or baud rate."""


class SettingsError(HardwareError):
    """A device URL, a plan file or a setting that cannot be meant."""


class LimitError(HardwareError):
    """Angles beyond the rig's travel; nothing was sent."""


class ReplyError(HardwareError):
    """An answer was late, damaged or not the one expected."""

    transient = True


class RefusedError(HardwareError):
    """The device understood and said no; the message gives its own code by name."""


class StoppedError(HardwareError):
    """Somebody pressed stop while the rig moved; it stands where it stopped."""


class NoZeroError(HardwareError):
    """The rig does not know where it stands and cannot find out: a person must turn it to its zero and say so."""


class PositionLostError(HardwareError):
    """Alarm, stall, reset or stop in motion: home the rig before it moves again."""

    transient = True


class DisconnectedError(HardwareError):
    """The cable or the device's power went while it was in use; of a rig opened again its status says what it knows."""

    transient = True


class ExposureError(HardwareError):
    """The camera did not take, or did not hand over, a photograph that may succeed when tried again."""

    transient = True


class StoreFullError(HardwareError):
    """The camera's card or memory is full."""


class BatteryError(HardwareError):
    """The camera's battery is too low to go on."""
