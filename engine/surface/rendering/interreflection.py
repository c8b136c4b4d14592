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
from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem
from engine.surface.rendering.transport import IncidentLight, LightTransport, SurfaceGeometry, predict


def radiance_of_hidden_patches(
    geometry: SurfaceGeometry, light: IncidentLight, photographed: Float[np.ndarray, "q v"]
) -> Float[np.ndarray, "w v"]:
    """Radiance (float32) of the geometry's walls under a light, in all views of it; `photographed` as in `LightTransport`."""
    walls = geometry.visibility and geometry.visibility.hidden_surfaces
    if not walls:
        return np.zeros((0, photographed.shape[1]), np.float32)
    count = len(walls.points)
    thrown = np.zeros((count, photographed.shape[1]), np.float32)
    # Matt: it looks the same from everywhere, so that its normal may stand for the direction it is seen from.
    around = SurfaceGeometry(walls.points, walls.normals, replace(walls.hidden, hidden_surfaces=walls))
    rough = np.ones((count, 1))
    for _ in range(2):  # first as if other walls were black, then under what these threw
        before = thrown
        thrown = np.empty_like(before)
        transport = LightTransport(light, photographed, False, True, "cpu", before)

        def shine(
            part: Int[np.ndarray, " _"], transport: LightTransport = transport, thrown: np.ndarray = thrown
        ) -> None:
            diffuse, _ = transport(transport.block(around, part), walls.normals[part][:, None], rough[part])
            thrown[part] = diffuse[:, 0] * np.tile(walls.albedo[part], diffuse.shape[2] // 3)

        deque(abreast(shine, walls.parts), 0)
    return thrown


def hidden_light_fraction(state: PixelEstimate, problem: PixelProblem) -> Float[np.ndarray, " p"]:
    """Of each pixel's light in all views the share that comes from walls that no photograph shows."""
    share, transport, geometry = np.zeros(len(state.normals)), problem.transport, problem.geometry
    if not isinstance(transport, LightTransport) or not len(transport.walls) or geometry.visibility is None:
        return share
    start, source = geometry.visibility.start, geometry.visibility.occluder
    before = np.concatenate([[0], np.cumsum(source >= len(transport.photographed))])
    lit_by_walls = np.diff(before[start]) > 0
    blocks = [part[lit_by_walls[part]] for part in problem.blocks if lit_by_walls[part].any()]
    black = replace(transport, walls=np.zeros_like(transport.walls))
    whole, without = (
        predict(one, geometry, blocks, state.normals, state.albedo, state.roughness)
        for one in (transport, black)
    )
    for (pixels, radiance), (_, rest) in zip(whole, without, strict=True):
        total = luminance(radiance).sum(1)
        share[pixels] = 1 - luminance(rest).sum(1) / np.maximum(total, 1e-30)
    return share
