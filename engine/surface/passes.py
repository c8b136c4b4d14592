"""One turn of the surface: pixels improve under what hides the room, then the depth follows them."""

from engine.progress import Progress
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.neighbour_propagation import ask
from engine.surface.optimize.roughness_prior import reconsidered
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import Subject, as_photographed
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
