"""What walls that no photograph shows throw at the rest of the object, and how much of a pixel's light that is.

A wall is matt and of its rim's paint. It is lit by what it sees of the room, by its lamps, by the pixels across from it as
they were photographed, and by other walls as they are without one another's light. Camera frame.
"""

from collections import deque
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from engine.color import luminance
from engine.parallel import abreast
from engine.surface.optimize.gauss_newton import State
from engine.surface.rendering.transport import Incident, Responses, Sight, predict

ONCE_MORE = 2
"""Times that walls are lit: first as if other walls were black, then under what these threw."""


def lit(sight: Sight, light: Incident, photographed: Float[np.ndarray, "q v"]) -> Float[np.ndarray, "w v"]:
    """Radiance (float32) of the sight's walls under a light, in all views of it; `photographed` as in `Responses`."""
    walls = sight.occlusion and sight.occlusion.walls
    if not walls:
        return np.zeros((0, photographed.shape[1]), np.float32)
    count = len(walls.points)
    thrown = np.zeros((count, photographed.shape[1]), np.float32)
    # Matt: it looks the same from everywhere, so that its normal may stand for the direction it is seen from.
    around = Sight(walls.points, walls.normals, replace(walls.hidden, walls=walls))
    rough = np.ones((count, 1))
    for _ in range(ONCE_MORE):
        before = thrown
        thrown = np.empty_like(before)
        responses = Responses(light, photographed, False, True, "cpu", before)

        def shine(
            part: Int[np.ndarray, " _"], responses: Responses = responses, thrown: np.ndarray = thrown
        ) -> None:
            diffuse, _ = responses(responses.block(around, part), walls.normals[part][:, None], rough[part])
            thrown[part] = diffuse[:, 0] * np.tile(walls.albedo[part], diffuse.shape[2] // 3)

        deque(abreast(shine, walls.parts), 0)
    return thrown


def guessed_share(
    state: State, responses: Responses, sight: Sight, parts: list[Int[np.ndarray, " _"]]
) -> Float[np.ndarray, " p"]:
    """Of each pixel's light in all views the share that comes from walls that no photograph shows."""
    share = np.zeros(len(state.normals))
    if not len(responses.walls) or sight.occlusion is None:
        return share
    start, source = sight.occlusion.start, sight.occlusion.source
    before = np.concatenate([[0], np.cumsum(source >= len(responses.photographed))])
    lit_by_walls = np.diff(before[start]) > 0
    parts = [part[lit_by_walls[part]] for part in parts if lit_by_walls[part].any()]
    black = Responses(
        responses.incident, responses.photographed, responses.full_diffuse, responses.bounce, responses.device,
        np.zeros_like(responses.walls),
    )  # fmt: skip
    whole, without = (
        predict(one, sight, parts, state.normals, state.albedo, state.roughness) for one in (responses, black)
    )
    for (pixels, radiance), (_, rest) in zip(whole, without, strict=True):
        total = luminance(radiance).sum(1)
        share[pixels] = 1 - luminance(rest).sum(1) / np.maximum(total, 1e-30)
    return share
