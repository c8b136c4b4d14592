"""One turn of the surface: pixels improve under what hides the room."""

from engine.progress import Progress
from engine.surface.optimize import gauss_newton
from engine.surface.optimize.roughness_prior import reconsidered
from engine.surface.params import SurfaceParams
from engine.surface.rendering.object_pixels import Subject
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
    """Gauss-Newton on every pixel; then each looks at what is expected of it, and again."""
    responses, parts = who.responses(light, params, device, sight), blocks(who.mask)
    span = progress.part(0, 0.7)
    state = gauss_newton.iterate(state, responses, sight, parts, who.seen, params.passes, span, anew=True)
    if params.gloss:
        span = progress.part(0.7, 1)
        state = reconsidered(state, responses, sight, parts, who.seen, who.mask, params.passes, span)
    return state
