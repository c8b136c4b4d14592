"""Whether the system has a graphics card that speaks Vulkan: a renderer in software does not count.

Source: the Vulkan 1.3 specification, "Devices and queues"; the loader's own C interface.
"""

import ctypes
import ctypes.util
from dataclasses import dataclass

_CARDS = {1: "integrated", 2: "discrete", 3: "virtual"}  # VkPhysicalDeviceType; 0 is other, 4 a processor
_NAME_AT, _NAME_BYTES, _TYPE_AT = 20, 256, 16  # in VkPhysicalDeviceProperties
_PROPERTIES_BYTES = 2048  # the record has 824; some room for what a driver adds


@dataclass(frozen=True, slots=True)
class Card:
    name: str
    kind: str


def cards() -> tuple[Card, ...]:
    """The system's graphics cards; none where there is no loader or no driver."""
    library = ctypes.util.find_library("vulkan")
    if library is None:
        return ()
    try:
        loader = ctypes.CDLL(library)
    except OSError:
        return ()
    # VkInstanceCreateInfo with everything left out: sType 1, then null pointers and zero counts.
    wanted = (ctypes.c_uint64 * 8)(1)
    instance = ctypes.c_void_p()
    if loader.vkCreateInstance(ctypes.byref(wanted), None, ctypes.byref(instance)) != 0:
        return ()
    try:
        count = ctypes.c_uint32()
        if loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None) != 0:
            return ()
        devices = (ctypes.c_void_p * count.value)()
        if loader.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices) < 0:
            return ()
        return tuple(card for device in devices if (card := _card(loader, device)) is not None)
    finally:
        loader.vkDestroyInstance(instance, None)


def _card(loader: ctypes.CDLL, device: int | None) -> Card | None:
    record = (ctypes.c_uint8 * _PROPERTIES_BYTES)()
    loader.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), ctypes.byref(record))
    kind = _CARDS.get(int.from_bytes(record[_TYPE_AT : _TYPE_AT + 4], "little"))
    if kind is None:
        return None
    name = bytes(record[_NAME_AT : _NAME_AT + _NAME_BYTES]).split(b"\0")[0].decode(errors="replace")
    return Card(name, kind)
