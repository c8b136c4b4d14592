"""Maps of an object that were computed elsewhere, as a solver begins at them.

Camera frame, as the sensor lies; files are of the upright picture.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from engine.errors import ImportFault, SurfaceError
from engine.io import normal_maps
from engine.orientation import back, turn_picture, turn_vectors


@dataclass(frozen=True, slots=True, eq=False)
class InitialMaps:
    """What the files hold of the mask's pixels."""

    mask: Bool[np.ndarray, "h w"]
    normals: Float[np.ndarray, "p 3"]  # unit
    roughness: Float[np.ndarray, " p"] | None
    albedo: Float[np.ndarray, "p 3"] | None  # linear, of a scale of its own

    def downsampled(self, small: Bool[np.ndarray, "h2 w2"]) -> "InitialMaps":
        """Means over the object's pixels of each 2 x 2, as `Picture.downsampled` has the photographs; `small` is its mask."""
        v, u = np.nonzero(self.mask)
        v, u = v // 2, u // 2
        height, width = small.shape
        kept = (v < height) & (u < width)  # an odd last row or column is cut off
        cell = v[kept] * width + u[kept]
        count = np.maximum(np.bincount(cell, minlength=height * width), 1)

        def mean(values: Float[np.ndarray, " p"]) -> Float[np.ndarray, " q"]:
            return (np.bincount(cell, values[kept], height * width) / count)[small.ravel()]

        normals = np.stack([mean(x) for x in self.normals.T], 1)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        roughness = None if self.roughness is None else mean(self.roughness)
        albedo = None if self.albedo is None else np.stack([mean(x) for x in self.albedo.T], 1)
        return InitialMaps(small, normals / np.maximum(length, 1e-9), roughness, albedo)


def read(
    path: Path,
    roughness: Path | None,
    frame: str,
    mask: Bool[np.ndarray, "h w"],
    coloured: bool,
    flip: int = 0,
) -> InitialMaps:
    """The maps at the photographs' size as they are processed, see `normal_maps`.

    Roughness is `roughness`'s, or what an .npz holds beside its normals; so is albedo where `coloured` asks for it.
    The photographs' `flip` stands them upright (`engine/orientation.py`), as the maps are.

    Raises:
        SurfaceError: a file cannot be read or does not fit, or a pixel of the object has no normal.
    """
    upright = turn_picture(mask, flip)

    def inside(values: np.ndarray) -> np.ndarray:
        return turn_picture(values, back(flip))[mask]

    try:
        normal = turn_vectors(inside(normal_maps.read_normals(path, upright, frame)), back(flip))
        beside = roughness or (path if normal_maps.holds(path, "roughness") else None)
        rough = inside(normal_maps.read_roughness(beside, upright)) if beside else None
        coloured = coloured and normal_maps.holds(path, "albedo")
        albedo = inside(normal_maps.read_albedo(path, upright, "linear")) if coloured else None
    except ImportFault as fault:
        raise SurfaceError(f"start maps: {fault}") from fault
    missing = int((~normal.any(1)).sum())
    if missing:
        raise SurfaceError(
            f"start maps: {path}: {missing} of {len(normal)} object pixels have no normal; make the map with the"
            " session's mask, or do without it"
        )
    return InitialMaps(mask, normal, rough, albedo)
