"""Graphics cards that speak Vulkan."""

import ctypes
import ctypes.util

import pytest

from app.viewer import vulkan


def test_without_a_loader_there_are_no_cards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None)
    assert vulkan.cards() == ()


def test_a_loader_that_cannot_be_opened_is_no_card(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: "/nonexistent.so")
    assert vulkan.cards() == ()


class FakeLoader:
    """Two devices: a processor (type 4), and a discrete card (type 2)."""

    def __init__(self, answer: int = 0) -> None:
        self.answer, self.destroyed = answer, 0

    def vkCreateInstance(self, wanted: object, allocator: object, instance: object) -> int:
        return self.answer

    def vkDestroyInstance(self, instance: object, allocator: object) -> None:
        self.destroyed += 1

    def vkEnumeratePhysicalDevices(self, instance: object, count, devices) -> int:
        count._obj.value = 2
        if devices is not None:
            devices[0], devices[1] = 11, 22
        return 0

    def vkGetPhysicalDeviceProperties(self, device, record) -> None:
        kind, name = {11: (4, b"llvmpipe"), 22: (2, b"A Card")}[device.value]
        record._obj[16] = kind
        for k, byte in enumerate(name):
            record._obj[20 + k] = byte


def test_a_renderer_in_software_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    loader = FakeLoader()
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: "vulkan")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: loader)
    assert vulkan.cards() == (vulkan.Card("A Card", "discrete"),)
    assert loader.destroyed == 1


def test_a_loader_without_a_driver_is_no_card(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: "vulkan")
    monkeypatch.setattr(ctypes, "CDLL", lambda name: FakeLoader(-9))
    assert vulkan.cards() == ()


def test_this_machine_can_be_asked() -> None:
    assert all(card.kind in ("integrated", "discrete", "virtual") for card in vulkan.cards())
