"""The lamps as JSON, each field with its plain name; frame and units are said inside. World frame."""

import json

from engine.types import Lamps


def lamps_json(lamps: Lamps, unit: str) -> bytes:
    """Strict JSON (no NaN); numbers keep all their digits."""
    content = {
        "frame": "world, that of light.ply and of the poses",
        "unit_of_length": unit,
        "shape": "spheres of even radiance",
        "radiance": "linear Rec.709, the session's scale",
        "clipped": "true where every photograph is saturated: the radiance is what the object's shading told"
        " (of the reference solver's result: a lower bound)",
        "lamps": [
            {
                "centre": centre.tolist(),
                "radius": float(radius),
                "radiance": radiance.tolist(),
                "clipped": bool(clipped),
            }
            for centre, radius, radiance, clipped in zip(
                lamps.centres, lamps.radii, lamps.radiance, lamps.clipped, strict=True
            )
        ],
    }
    return (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()
