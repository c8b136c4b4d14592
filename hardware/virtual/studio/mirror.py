"""A polished floor: under it stands the same room upside down and darker, and the floor itself is open.

That is what a flat mirror is to every ray that comes from above, so that no renderer has to know of it. The object and
the camera are not in the mirror, as they are not in the room's light either.
"""

from dataclasses import replace

import numpy as np

from hardware.virtual.studio.bake import Atlas, pack
from hardware.virtual.studio.rooms import Globe, Panel, Room, Sheet

FLAT_M = 1e-6  # a panel as low as this is the floor


def reflected(room: Room, atlas: Atlas) -> tuple[Room, Atlas]:
    """The room with its own image under a floor that is polished, and the light of both; as it is without."""
    if room.polish == 0:
        return room, atlas
    pictures = _pictures(atlas)
    standing = [k for k, panel in enumerate(room.panels) if not _is_floor(panel)]
    panels, lit = [room.panels[k] for k in standing], [pictures[k] for k in standing]
    below = [Panel(*_edges(panel), panel.albedo[:, ::-1]) for panel in panels]
    globes = [
        Globe(_down(globe.centre), globe.radius_m, room.polish * globe.radiance) for globe in room.globes
    ]
    sheets = [Sheet(*_edges(sheet), room.polish * sheet.radiance[:, ::-1]) for sheet in room.sheets]
    both = replace(
        room, panels=(*panels, *below), globes=(*room.globes, *globes), sheets=(*room.sheets, *sheets)
    )
    return both, pack(both.panels, [*lit, *(room.polish * picture[:, ::-1] for picture in lit)])


def _pictures(atlas: Atlas) -> list[np.ndarray]:
    """The atlas taken apart: one picture per panel."""
    size = np.array(atlas.picture.shape[1::-1])
    low, high = (np.rint(edge * size).astype(int) for edge in (atlas.low, atlas.high))
    return [atlas.picture[y0:y1, x0:x1] for (x0, y0), (x1, y1) in zip(low, high, strict=True)]


def _is_floor(panel: Panel) -> bool:
    corners = panel.corner[2] + np.array([0.0, panel.right[2], panel.down[2], panel.right[2] + panel.down[2]])
    return bool(np.abs(corners).max() < FLAT_M)


def _edges(quad: Panel | Sheet) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corner and edges of a rectangle's image, begun at its other side: a mirror would turn its front to the back."""
    return _down(quad.corner + quad.right), -_down(quad.right), _down(quad.down)


def _down(vector: np.ndarray) -> np.ndarray:
    return vector * [1.0, 1.0, -1.0]
