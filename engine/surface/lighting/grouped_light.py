"""The light at a lattice of probes, told apart by the groups of emitters that it comes from.

Camera frame of each view; groups as `emitter_groups.py` numbers them.
"""

from dataclasses import dataclass
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from engine.color import luminance
from engine.surface.lighting.emitter_groups import CLIPPED, UNSEEN, EnvironmentPatches
from engine.surface.rendering.area_lights import AreaLights
from engine.surface.rendering.transport import IncidentLight


@dataclass(frozen=True, slots=True, eq=False)
class GroupedLight:
    """The light at a lattice of probes, by groups of emitters: the room's, each lamp, and what was filled in."""

    incident: IncidentLight  # without the lamps
    group: Int[np.ndarray, "m d n"]  # of each cell of it
    area_lights: AreaLights  # the lamps, as recorded: the groups just before the last
    kind: UInt8[np.ndarray, " k"]  # of every group, see `emitter_groups.py`; the last is what was filled in
    clipped_share: Float[np.ndarray, " k"]  # of every group's light: recorded as a lower bound
    gain_sigma: float  # spread of the log gain of a known one
    cam_from_world_rotation: Float[np.ndarray, "n 3 3"]  # world to camera
    lamp_tangents: Float[np.ndarray, "l 2 3"]  # world: a lamp's step per radian, two ways
    exposure_sigma: float = 0.0  # spread of a view's log exposure; 0: none drifts
    lamp_offset_sigma: float = 0.0  # spread of a lamp's direction, radians; 0: none is
    patches: EnvironmentPatches | None = None  # what closes the room where no photograph looked
    patch: Int[np.ndarray, "m d n"] | None = None  # which of it each cell shows; -1: none

    @property
    def of_lamps(self) -> slice:
        """The lamps' groups."""
        return slice(len(self.kind) - 1 - len(self.area_lights.radii), len(self.kind) - 1)

    @property
    def clipped(self) -> Bool[np.ndarray, " k"]:
        """Groups of whose brightness a part is only a lower bound."""
        return self.kind == CLIPPED

    @property
    def unseen(self) -> Bool[np.ndarray, " k"]:
        """Groups that no photograph shows."""
        return self.kind == UNSEEN

    def at(
        self, point: Float[np.ndarray, " 3"], gain: Float[np.ndarray, "k 3"]
    ) -> Float[np.ndarray, "k d v"]:
        """Every group's energy at a point, under its gain; nothing of the lamps."""
        weights = self.incident.probe_grid.weights(point[None])[0].astype(np.float32)
        gain = gain.astype(np.float32)
        out = np.zeros((len(gain), *self.incident.energy.shape[1:]), np.float32)
        for k in np.nonzero(weights)[0]:
            _add_by_group(self.incident.energy[k], self.group[k], weights[k] * gain, out)
        return out

    def lamps_moved(self, aside: Float[np.ndarray, "l 2"]) -> AreaLights:
        """The lamps in other directions, as recorded otherwise."""
        return self.area_lights.moved(
            np.einsum("nij,lj->nli", self.cam_from_world_rotation, self.lamp_shift(aside))
        )

    def lamp_shift(self, aside: Float[np.ndarray, "l 2"]) -> Float[np.ndarray, "l 3"]:
        """How far lamps have moved that are so many radians aside, world frame."""
        return np.einsum("lk,lkj->lj", aside, self.lamp_tangents)

    def with_gains(
        self, gain: Float[np.ndarray, "k 3"], aside: Float[np.ndarray, "l 2"] | None = None
    ) -> IncidentLight:
        """All the light, every group under its gain, the lamps `aside` radians from where they were found."""
        m, d, v = self.incident.energy.shape
        energy = self.incident.energy.reshape(m, d, v // 3, 3) * gain.astype(np.float32)[self.group]
        near = (self.area_lights if aside is None else self.lamps_moved(aside)).under(gain[self.of_lamps])
        return IncidentLight(
            self.incident.probe_grid, self.incident.directions, energy.reshape(m, d, v), near
        )

    def levels(self) -> Float[np.ndarray, "k 3"]:
        """The groups' share of the light before any gain, summed over probes, directions and views."""
        energy = self.incident.energy.reshape(-1, 3)
        flat = self.group.ravel()
        sums = np.stack([np.bincount(flat, energy[:, c], minlength=len(self.kind)) for c in range(3)], 1)
        sums[self.of_lamps] = self.area_lights.levels(self.incident.probe_grid.points())
        return sums

    def shares(self, gain: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
        """Every group's share of the light, under its gains."""
        light = luminance(self.levels() * gain)
        return light / max(light.sum(), 1e-30)

    def unseen_share(self, gain: Float[np.ndarray, "k 3"]) -> float:
        """The share of all light, under its gains, that comes from where no photograph looked."""
        return float(self.shares(gain)[self.unseen].sum())


@numba.njit(cache=True)
@no_type_check
def _add_by_group(energy, group, gain, out):
    for d in range(group.shape[0]):
        for n in range(group.shape[1]):
            k = group[d, n]
            for c in range(3):
                out[k, d, 3 * n + c] += gain[k, c] * energy[d, 3 * n + c]
