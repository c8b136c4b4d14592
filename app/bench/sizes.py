"""How large the benchmark's sets are, and which rooms and objects each size takes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hardware.virtual.studio.order import RENDER_NOISE

OBJECTS = ("blob", "sphere", "vase", "relief", "thin", "duo")
ROOMS = ("study", "lamps", "window")
PUBLISHED = ((16, 64, 256), (10, 25, 50, 100))
"""Samples and epochs of the reference, up to those that the paper has."""


@dataclass(frozen=True, slots=True)
class Size:
    """One size of sets."""

    name: str
    views: int
    width: int  # pixels
    height: int
    rooms: tuple[str, ...]
    objects: tuple[str, ...]
    given: bool  # the truth's poses and mask: such photographs are too small to place views by
    counts: tuple[int, ...]  # views that `bench views` compares; its sets hold the most of them
    directions: tuple[int, ...]  # that `bench scaling` compares
    samples: tuple[int, ...]  # per pixel, that the reference is charted at; the last is the table's
    epochs: tuple[int, ...]
    reference_work: int  # pixels x views x samples x epochs of one row of it: 5 microseconds each, about
    training: float  # share of the published iterations that the paper's own light is trained for
    emitters: int  # Gaussians that it may have: so few iterations make no use of millions
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # of stages; none: as shipped
    # How the studio carries camera and object: every way up, so that most of the room is seen even in few views.
    motion: str = "gimbal"
    noise: float = RENDER_NOISE  # that the path tracer may leave on the object
    enlarged: int = 1  # photographs are so many times as wide and high as what the studio draws
    panoramas: bool = True  # of the light at the object, in the truth: for tests.bench.light, no row asks
    files: str = "raw"  # brackets of RAW files; or "linear": one float image a view, without a camera's noise

    @property
    def inputs(self) -> str:
        return "true poses and masks given" if self.given else "poses and masks estimated"

    def told(self) -> str:
        """For a table's head."""
        light = ", a light of few Gaussians" if self.settings else ""
        held = {"handheld": "hand-held", "random": "from random poses"}.get(self.motion)
        held = held or f"on a {self.motion}"
        views = f"{self.views} views of {self.width} x {self.height} {held}"
        views += "" if self.files == "raw" else f", {self.files} images"
        views += "" if self.noise == RENDER_NOISE else f", {100 * self.noise:g} % noise of the path tracer"
        return f"sets of size {self.name} ({views}), {self.inputs}{light}"

    def thinned(self) -> "Size":
        """As `bench views` takes it: sets of the most views, which fewer are taken out of with the truth's poses and mask."""
        return replace(self, views=max(self.counts), given=True)


SIZES = {
    "quick": Size(
        "quick", 40, 128, 96, ("booth",), ("blob",), True, (20, 40), (512, 1024, 2048), (64,), (12,), 2_000_000,
        0.001, 100_000,
        # The machinery is what is tried: a light of few Gaussians does, and one setting of the reference.
        {"light": {"max_gaussians": 3000, "max_image_width": 96}}, panoramas=False,
    ),
    # A light of few Gaussians costs such photographs little and takes a third of the seconds: for many runs.
    "tiny": Size(
        "tiny", 48, 160, 120, ROOMS, OBJECTS, True, (12, 24, 48), (512, 1024, 2048, 4096),
        *PUBLISHED, 5_000_000, 0.1, 60_000, {"light": {"max_gaussians": 2000}}, panoramas=False,
    ),
    "small": Size(
        "small", 48, 320, 240, ROOMS, OBJECTS, True, (10, 20, 40, 80, 150), (512, 1024, 2048, 4096),
        *PUBLISHED, 20_000_000, 0.1, 60_000,
    ),
    "standard": Size(
        "standard", 96, 512, 384, ROOMS, ("blob", "relief", "duo"), False, (10, 20, 40, 80, 150),
        (512, 1024, 2048, 4096), *PUBLISHED, 60_000_000, 0.1, 60_000,
    ),
    "paper": Size(
        "paper", 150, 512, 512, ROOMS, OBJECTS, True, (40, 80, 150), (512, 1024, 2048, 4096), *PUBLISHED,
        60_000_000, 0.1, 60_000, motion="random", files="linear",
    ),
    "paper-small": Size(
        "paper-small", 96, 512, 384, ROOMS, OBJECTS, True, (40, 80, 96), (512, 1024, 2048, 4096), *PUBLISHED,
        60_000_000, 0.1, 60_000, motion="random",
    ),
}  # fmt: skip
SUITES = ("paper", "paper-small")
"""Of these, those that are protocols: the paper's own (its Sec. 4.1: 150 HDR images of 512 x 512 from poses every way, three
rooms by six objects, poses and masks given), and its twin from RAW files that a day is enough for. Files take the
places of our rooms and objects."""
