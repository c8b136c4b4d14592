"""What can go wrong with devices and with the virtual studio; every message names a cause and a remedy."""


class HardwareError(Exception):
    """Base of every device error a person can do something about."""


class StudioError(HardwareError):
    """The virtual studio was asked for something it cannot build or photograph."""
