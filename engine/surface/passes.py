"""One turn of the surface: pixels improve under what hides the room, then the depth follows them."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from engine.progress import Progress
from engine.surface.depth import step_heights
from engine.surface.depth.horizon_relaxation import relaxed
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.neighbour_propagation import ask, prices
from engine.surface.optimize.roughness_prior import reconsidered
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import Subject, as_photographed, depth_of, lifted
from engine.surface.rendering.transport import Incident, Sight, blocks


def improve(
    who: Subject,
    state: gauss_newton.State,
    light: Incident,
    sight: Sight,
    params: SurfaceParams,
    device: str,
    progress: Progress,
) -> gauss_newton.State:
    """Gauss-Newton on every pixel; then each looks at what is expected of it and at what its neighbours found, and again.

    `sight` is what the depth says hides the room; the photographs may know better.
    """
    responses, parts = who.responses(light, params, device, sight), blocks(who.mask)

    def settled(state: gauss_newton.State, passes: int, span: Progress) -> tuple[gauss_newton.State, Sight]:
        seeing = as_photographed(who, state, sight, light.directions)
        return gauss_newton.iterate(
            state, responses, seeing, parts, who.seen, passes, span, anew=True
        ), seeing

    state, seeing = settled(state, params.passes, progress.part(0, 0.3))
    if params.gloss:
        span = progress.part(0.3, 0.4)
        state = reconsidered(state, responses, seeing, parts, who.seen, who.mask, params.passes, span)
    if params.ask:
        # Of an object that was asked before and hides next to nothing from itself, horizons are chance.
        bare = seeing.occlusion is not None and seeing.occlusion.bare and bool(state.level.any())
        state = ask(who, state, light, sight, params, progress.part(0.4, 0.8), not bare)
        state, _ = settled(state, 3, progress.part(0.8, 1))
    return state


def relief(
    who: Subject,
    state: gauss_newton.State,
    light: Incident,
    sight: Sight,
    distance: float,
    params: SurfaceParams,
    progress: Progress,
    relaxing: bool = True,
) -> tuple[gauss_newton.State, Float[np.ndarray, "h w"]]:
    """The state with the steps that its horizons tell, and its depth; `sight` is that under which it was solved. Where it is not
    `relaxing`, whole regions move alone.
    """
    believed = state.lift
    state = replace(state, lift=np.zeros(len(believed)))
    depth = depth_of(who, state, distance, progress.part(0, 0.4))
    if not params.steps or not state.level.any():
        return state, depth
    hidden = as_photographed(who, state, sight, light.directions).occlusion
    if hidden is None or hidden.bare:
        return state, depth
    speaking = step_heights.speakers(who.mask)
    cost = prices(who, state, light, sight, speaking, params, progress.part(0.4, 0.7))
    pitch, slant = who.pitch, who.rays[:, 2]
    cast_z = sight.points[:, 2] if sight.cast_z is None else sight.cast_z
    before, now = (np.log(z / slant) / pitch for z in (cast_z, depth[who.mask]))
    told = step_heights.tell(state.level, speaking, cost, before, who.mask, pitch)
    lift = step_heights.lifts(who.mask, now, told, pitch, believed / pitch, progress.part(0.7, 0.9))
    if relaxing:
        lift = relaxed(who.mask, now, told, pitch, lift, progress.part(0.9, 1))
    return replace(state, lift=pitch * lift), lifted(who.mask, depth, pitch * lift, distance)
