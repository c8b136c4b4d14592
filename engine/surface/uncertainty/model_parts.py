"""What each part of the model is worth to a scene: how much worse the views kept out of the fit are rendered without it.

The rest of the answer stays as it is, though it would make up for some of what is left out. So this is the most that a part can be
worth, and a part that is worth no more than its standard error is one that the scene does not ask for.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from engine.surface.data.scene import Scene
from engine.surface.estimate import Estimate, known
from engine.surface.reflectance.brdf import PAINT
from engine.surface.schedule import validation_error


@dataclass(frozen=True, slots=True)
class PartWorth:
    """A part of the model, and by how much the relative error of the views kept out is less with it."""

    part: str
    gain: float  # mean over the views of the pixels' median
    stderr: float


def part_worths(scene: Scene, found: Estimate) -> tuple[PartWorth, ...]:
    """Of every part that the answer holds; of none where fewer than two views are kept out."""
    if len(scene.validation) < 2:
        return ()
    least, worths = np.median(validation_error(scene, found), axis=1), []
    for part, (seen, simpler) in _without_each(scene, found).items():
        grown = np.median(validation_error(seen, simpler), axis=1) - least
        stderr = grown.std(ddof=1) / np.sqrt(len(grown))
        worths.append(PartWorth(part, float(grown.mean()), float(stderr)))
    return tuple(worths)


def _without_each(scene: Scene, found: Estimate) -> dict[str, tuple[Scene, Estimate]]:
    light, geometry, state = known(found.validation), found.geometry, known(found.state)
    made = np.tile(PAINT, (len(state.normals), 1)) if geometry.material is None else geometry.material
    changed: dict[str, dict[str, Any]] = {
        "light by place": {"validation": light.from_afar(geometry.points.mean(0))}
    }
    if geometry.visibility is not None:
        changed["visibility"] = {"geometry": replace(geometry, visibility=None)}
    if (made[:, 1] == 0).any():  # metals have nothing but gloss
        changed["gloss"] = {"geometry": replace(geometry, material=made * (made[:, 1:] > 0))}
    even = np.full_like(state.roughness, np.median(state.roughness))
    changed["roughness by pixel"] = {"state": replace(state, roughness=even)}
    without = {part: (scene, replace(found, **values)) for part, values in changed.items()}
    if geometry.visibility is not None and scene.params.models("interreflections"):
        params = replace(scene.params, without=(*scene.params.without, "interreflections"))
        without["interreflection"] = replace(scene, params=params), found
    return without
