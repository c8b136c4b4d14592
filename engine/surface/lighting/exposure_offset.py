"""How far the light of each view is off as a whole, where the surface is known already.

A shutter or a flickering mains makes a whole photograph brighter or darker by one factor, and so does light that is taken to
come from nearer or farther than it does; the object's own pixels tell it in closed form. `light_calibration` settles it
together with the light in the views of the coarse phases; the others get it here.
"""

import numpy as np
from jaxtyping import Float

from engine.surface.optimize.gauss_newton import PixelEstimate
from engine.surface.rendering.object_pixels import ObjectPixels
from engine.surface.rendering.transport import LightTransport, SurfaceGeometry, pixel_blocks, predict

EXPOSURE_SIGMA = 0.1
"""Spread of the logarithm of a view's factor that is expected: shutters and flicker make a few hundredths of it, sky that comes in
through windows and is taken for a light in the pane a tenth. Pixels tell a view's to a few permille, so that it decides little; with
0.01 the joint step stopped at 58 % of a drift of 3 %, where the prior outweighed what was left."""
EVERY = 4
"""Of the pixels one of so many is asked."""


def exposure_offset_of(
    state: PixelEstimate, transport: LightTransport, geometry: SurfaceGeometry, object_pixels: ObjectPixels
) -> Float[np.ndarray, " n"]:
    """The median log of photographed over rendered radiance in each view, of the better explained half of some pixels;
    0 where a view has none that is usable."""
    asked = np.median(state.residual_scale)
    # Of pixels of another size than was solved last nobody knows how well they are explained: all speak.
    parts = [
        part[::EVERY][~(state.residual_scale[part[::EVERY]] > asked)]
        for part in pixel_blocks(object_pixels.mask)
    ]
    parts = [part for part in parts if len(part)]
    logs = []
    for pixels, model in predict(transport, geometry, parts, state.normals, state.albedo, state.roughness):
        eps, seen = (
            object_pixels.observations.eps[pixels][:, None, None],
            object_pixels.observations.radiance[pixels].reshape(model.shape),
        )
        usable = object_pixels.observations.weight[pixels].reshape(model.shape) > 0
        logs.append(np.where(usable, np.log((seen + eps) / (np.maximum(model, 0) + eps)), np.nan))
    every = np.concatenate(logs).transpose(1, 0, 2).reshape(logs[0].shape[1], -1)
    told = np.isfinite(every).any(1)
    drift = np.zeros(len(every))
    drift[told] = np.nanmedian(every[told], axis=1)
    return drift
