"""What stands around the rig, built in or out of a scene file: its light for the object, its look for photographs."""

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Bool, Float

from hardware.virtual.studio import bake, mirror, relight, render, rooms, tracer
from hardware.virtual.studio.glow import Glow
from hardware.virtual.studio.objects import Body

Progress = bake.Progress


class Surroundings(Protocol):
    """A baked room."""

    @property
    def name(self) -> str: ...

    @property
    def key(self) -> str:
        """Of all that decides how it looks."""
        ...

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Where the rig stands, world."""
        ...

    def lights(self, body: Body) -> relight.Lights | None:
        """For the path tracer; None: Mitsuba has no vectorised variant here, `foreground` has to do."""
        ...

    def foreground(self, body: Body, touched: Bool[np.ndarray, "h w"]) -> render.Foreground:
        """The plain way."""
        ...

    def backdrop(self) -> render.Back:
        """For what the body does not cover."""
        ...


class BuiltIn:
    """A room of `rooms`."""

    def __init__(self, name: str, cache: Path, device: str, progress: Progress):
        """
        Raises:
            StudioError: no such room, or the device is not there.
        """
        furnished = rooms.furnish(name)
        self.device, self.centre, self.name = device, furnished.centre, furnished.name
        self.room, self.atlas = mirror.reflected(furnished, bake.bake(furnished, cache, device, progress))
        self.key = bake.digest(self.room)

    def lights(self, body: Body) -> relight.Lights | None:
        mi: Any = tracer.load(self.device)
        return Glow(mi, self.room, self.atlas) if tracer.is_vectorised(mi) else None

    def foreground(self, body: Body, touched: Bool[np.ndarray, "h w"]) -> render.Foreground:
        return render.Foreground(self.room, self.atlas, body, touched, self.device)

    def backdrop(self) -> render.Back:
        return render.Backdrop(self.room, self.atlas, self.device)
