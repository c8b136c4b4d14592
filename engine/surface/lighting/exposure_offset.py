"""How far the light of each view is off as a whole, where the surface is known already.

A shutter or a flickering mains makes a whole photograph brighter or darker by one factor, and so does light that is taken to
come from nearer or farther than it does; the object's own pixels tell it in closed form. `light_calibration` settles it
together with the light in the views of the coarse phases; the others get it here.
"""

import numpy as np
from jaxtyping import Float

from engine.surface.optimize.gauss_newton import PixelEstimate, PixelProblem
from engine.surface.rendering.transport import predict


def exposure_offset_of(state: PixelEstimate, problem: PixelProblem) -> Float[np.ndarray, " n"]:
    """The median log of photographed over rendered radiance in each view, of the better explained half of a quarter of the pixels;
    0 where a view has none that is usable."""
    asked = np.median(state.residual_scale)
    # Of pixels of another size than was solved last nobody knows how well they are explained: all speak.
    parts = [part[::4][~(state.residual_scale[part[::4]] > asked)] for part in problem.blocks]
    rendered = predict(
        problem.transport, problem.geometry, [part for part in parts if len(part)], state.normals, state.albedo,
        state.roughness,
    )  # fmt: skip
    logs, observations = [], problem.observations
    for pixels, model in rendered:
        eps = observations.eps[pixels][:, None, None]
        seen, weight = (x[pixels].reshape(model.shape) for x in (observations.radiance, observations.weight))
        logs.append(np.where(weight > 0, np.log((seen + eps) / (np.maximum(model, 0) + eps)), np.nan))
    every = np.concatenate(logs).transpose(1, 0, 2).reshape(logs[0].shape[1], -1)
    told = np.isfinite(every).any(1)
    drift = np.zeros(len(every))
    drift[told] = np.nanmedian(every[told], axis=1)
    return drift
