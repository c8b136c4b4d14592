"""What the light does at every pixel, in all views at once: I = E T.

Camera and object are rigid, so a pixel's rows T (reflectance, cosine, visibility for every direction) are
the same in all views and the pictures follow from one matrix product with the incident energy E. E is known
at a small lattice of probe points around the object and interpolated to every pixel: the pixels of a block share the
mean of their light, which is all that small changes of their rows are told under, and two or three ways in which it
differs among them (decision 42). Lamps are left out of E and shine on every pixel from their own place (`area_lights`).

Camera frame throughout; energies are radiance times solid angle; arrays over views keep (view, channel)
flattened to one axis `v` = 3 n, view-major.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol, no_type_check, runtime_checkable

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

from engine.geometry import fibonacci_sphere, unproject
from engine.parallel import abreast
from engine.surface.reflectance.brdf import lobe_floor, of_pixels, optics, rows
from engine.surface.rendering.area_lights import AreaLights, add_lamps
from engine.surface.visibility.ray_visibility import SparseVisibility
from engine.types import Camera

BLOCK = 16
"""Pixels along one side of a block that shares products with one light."""


@dataclass(frozen=True, slots=True, eq=False)
class ProbeGrid:
    """Probe points on a regular lattice in (x / z, y / z, log z) that encloses the object."""

    low: Float[np.ndarray, " 3"]  # x / z, y / z, z
    high: Float[np.ndarray, " 3"]
    shape: tuple[int, int, int]

    def depths(self) -> Float[np.ndarray, " k"]:
        """z of the lattice's layers."""
        if self.shape[2] == 1:
            return np.array([np.sqrt(self.low[2] * self.high[2])])
        return np.geomspace(self.low[2], self.high[2], self.shape[2])

    def points(self) -> Float[np.ndarray, "m 3"]:
        """The probes, camera frame, last lattice axis fastest."""
        spans = zip(self.low[:2], self.high[:2], self.shape[:2], strict=True)
        axes = [np.linspace(lo, hi, k) if k > 1 else np.array([(lo + hi) / 2]) for lo, hi, k in spans]
        x, y, z = np.meshgrid(*axes, self.depths(), indexing="ij")
        return np.stack([x * z, y * z, z], -1).reshape(-1, 3)

    def weights(self, points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p m"]:
        """Trilinear weights of the probes at some points; points outside take the nearest face's values."""
        at = np.stack([points[:, 0] / points[:, 2], points[:, 1] / points[:, 2], np.log(points[:, 2])])
        low, high = (np.append(corner[:2], np.log(corner[2])) for corner in (self.low, self.high))
        every, per_axis = np.arange(len(points)), []
        for i, count in enumerate(self.shape):
            axis = np.zeros((len(points), count))
            if count == 1:
                axis[:] = 1
            else:
                t = np.clip((at[i] - low[i]) / (high[i] - low[i]), 0, 1) * (count - 1)
                k = np.minimum(t.astype(int), count - 2)
                axis[every, k], axis[every, k + 1] = 1 - (t - k), t - k
            per_axis.append(axis)
        return np.einsum("pi,pj,pk->pijk", *per_axis).reshape(len(points), -1)


def probe_grid_around(
    camera: Camera, mask: Bool[np.ndarray, "h w"], depth: tuple[float, float], shape: tuple[int, int, int]
) -> ProbeGrid:
    """The lattice that spans the mask's bounding box and the depth range."""
    v, u = np.nonzero(mask)
    corners = np.array([[u.min(), v.min()], [u.max() + 1.0, v.max() + 1.0]], dtype=float)
    xy = unproject(camera, corners)
    return ProbeGrid(np.append(xy.min(0), depth[0]), np.append(xy.max(0), depth[1]), shape)


@numba.njit(nogil=True, fastmath=True, cache=True)
@no_type_check
def _mixed(energy, probes, weights):
    """Weighted sums of some probes' energy, four probes at a time: so one pass over a row of sums serves all four."""
    directions, size = energy.shape[1], energy.shape[2]
    count, out = len(probes), np.zeros((len(weights), directions, size), np.float32)
    for d in range(directions):
        for j in range(len(weights)):
            row = out[j, d]
            for k in range(0, count - 3, 4):
                a, b, c, e = weights[j, k], weights[j, k + 1], weights[j, k + 2], weights[j, k + 3]
                one, two = energy[probes[k], d], energy[probes[k + 1], d]
                three, four = energy[probes[k + 2], d], energy[probes[k + 3], d]
                for v in range(size):
                    row[v] += a * one[v] + b * two[v] + c * three[v] + e * four[v]
            for k in range(count - count % 4, count):
                a, one = weights[j, k], energy[probes[k], d]
                for v in range(size):
                    row[v] += a * one[v]
    return out


@dataclass(frozen=True, slots=True, eq=False)
class IncidentLight:
    """The light at the lattice: energy per view and direction cell, view-major in the last axis; and the lamps."""

    probe_grid: ProbeGrid
    directions: Float[np.ndarray, "d 3"]  # camera frame
    energy: Float[np.ndarray, "m d v"]  # float32, radiance times solid angle; of all that is no lamp
    area_lights: AreaLights

    def at(self, point: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "d v"]:
        """Energy at a point of the camera frame, without the lamps."""
        return self._sums(self.probe_grid.weights(point[None]))[0]

    def from_afar(self, point: Float[np.ndarray, " 3"]) -> "IncidentLight":
        """The light that reaches this point, everywhere."""
        everywhere = np.broadcast_to(self.at(point), self.energy.shape)
        return replace(
            self, energy=np.ascontiguousarray(everywhere), area_lights=self.area_lights.from_afar(point)
        )

    def among(self, points: Float[np.ndarray, "p 3"]) -> "LightModes":
        """What reaches some points, without the lamps."""
        told = self.shares(points)
        sums = self._sums(np.concatenate([told.mean[None], told.modes]))
        return replace(told, mean=sums[0], modes=sums[1:])

    def shares(self, points: Float[np.ndarray, "p 3"]) -> "LightModes":
        """The same in weights of the probes: their principal components at the points."""
        weights = self.probe_grid.weights(points)
        middle = weights.mean(0)
        apart = weights - middle
        strength, modes = np.linalg.eigh(apart.T @ apart / len(points))
        # The rest is what the weakest leave out, which come first: the weights may be off by so much, root mean square.
        told = np.sqrt(np.cumsum(np.maximum(strength, 0))) > 0.01
        modes = modes.T[told]
        return LightModes(middle, modes, (apart @ modes.T).astype(np.float32))

    def _sums(self, weights: Float[np.ndarray, "j m"]) -> Float[np.ndarray, "j d v"]:
        probes = np.nonzero(weights.any(0))[0]
        return _mixed(self.energy, probes, weights[:, probes].astype(np.float32))

    def views(self, index: Int[np.ndarray, " k"]) -> "IncidentLight":
        """The same light for some of its views."""
        m, d, v = self.energy.shape
        energy = self.energy.reshape(m, d, v // 3, 3)[:, :, index].reshape(m, d, -1)
        return IncidentLight(
            self.probe_grid, self.directions, np.ascontiguousarray(energy), self.area_lights.views(index)
        )

    def beside(self, other: "IncidentLight") -> "IncidentLight":
        """Its views, and another's after them, at the same probes."""
        energy = np.concatenate([self.energy, other.energy], 2)
        return IncidentLight(
            self.probe_grid, self.directions, energy, self.area_lights.beside(other.area_lights)
        )


@dataclass(frozen=True, slots=True, eq=False)
class LightModes:
    """What neighbouring points share of the light, and the ways in which theirs differs from it."""

    mean: Float[np.ndarray, " *c"]
    modes: Float[np.ndarray, "r *c"]
    coefficients: Float[np.ndarray, "p r"]  # how far each point's light does so in each


def pixel_blocks(mask: Bool[np.ndarray, "h w"]) -> list[Int[np.ndarray, " _"]]:
    """Indices (into the mask's pixels in row order) of each block's pixels."""
    v, u = np.nonzero(mask)
    tile = (v // BLOCK) * (mask.shape[1] // BLOCK + 1) + u // BLOCK
    order = np.argsort(tile, kind="stable")
    cuts = np.nonzero(np.diff(tile[order]))[0] + 1
    return [part.astype(np.int64) for part in np.split(order, cuts)]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceGeometry:
    """Where the pixels' points are, what they are made of, and what they see of the object itself."""

    points: Float[np.ndarray, "p 3"]
    views: Float[np.ndarray, "p 3"]  # unit, from the point to the camera
    visibility: SparseVisibility | None  # None: nothing hides anything
    material: Float[np.ndarray, "p 2"] | None = None  # as `brdf` has it; None: all of paint

    def at(self, scale: float) -> "SurfaceGeometry":
        """The same with the object so many times as far away: what hides what does not change."""
        occlusion = self.visibility and self.visibility.at(scale)
        return replace(self, points=self.points * scale, visibility=occlusion)

    def part(self, pixels: Int[np.ndarray, " k"]) -> "SurfaceGeometry":
        """The same of a few pixels."""
        hidden = self.visibility and self.visibility.part(pixels)
        return SurfaceGeometry(
            self.points[pixels], self.views[pixels], hidden, of_pixels(self.material, pixels)
        )


@numba.njit(nogil=True, fastmath=True, cache=True)
@no_type_check
def _bounce(table, start, direction, source, photographed, walls, cell, variants, out):
    """Move each occluded entry's light from the room's to what the photograph saw there, or to what walls throw.

    Rows are the variants of every pixel, diffuse and then specular: each row of light is read once for all.
    """
    pixels, known = len(start) - 1, len(photographed)
    for p in range(pixels):
        for k in range(start[p], start[p + 1]):
            d, q = direction[k], source[k]
            if d < 0:
                continue
            light = walls[q - known] if q >= known else photographed[max(q, 0)]
            for half in range(2):
                for row in range((half * pixels + p) * variants, (half * pixels + p + 1) * variants):
                    t = table[row, d] * cell
                    table[row, d] = 0
                    if t != 0 and q >= 0:
                        for v in range(out.shape[1]):
                            out[row, v] += t * light[v]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Some neighbouring pixels and what reaches them, whatever their normals and roughness are."""

    geometry: SurfaceGeometry
    light: LightModes  # of all but the lamps: energies
    lamps: Float[np.ndarray, "p n l"]  # the share of each lamp that each pixel sees

    def part(self, pixels: Int[np.ndarray, " k"]) -> "Block":
        """The same of a few of them; the light they share stays that of all."""
        light = replace(self.light, coefficients=self.light.coefficients[pixels])
        return Block(self.geometry.part(pixels), light, self.lamps[pixels])

    def under(self, energy: Float[np.ndarray, "d v"]) -> "Block":
        """The same under another light, which is the same for all of them."""
        alike = np.zeros((0, *energy.shape), np.float32), self.light.coefficients[:, :0]
        return replace(self, light=LightModes(energy, *alike))

    def add_lamps(
        self,
        lamps: AreaLights,
        radiance: Float[np.ndarray, "n l c"],
        normals: Float[np.ndarray, "p k 3"],
        roughness: Float[np.ndarray, "p k"],
        full_diffuse: bool,
        sent: Float[np.ndarray, "2 p k n c"],
    ) -> None:
        """Add what all lamps send at some radiance, diffuse and specular, to variants of each pixel; no albedo applied."""
        at = self.geometry
        views, normals, roughness = (
            np.ascontiguousarray(x, np.float32) for x in (at.views, normals, roughness)
        )
        add_lamps(
            at.points, views, normals, roughness, optics(at.material, len(views)), lamps.centres, lamps.radii, self.lamps,
            full_diffuse, radiance, sent[0], sent[1],
        )  # fmt: skip

    def each_lamp(
        self,
        lamps: AreaLights,
        normals: Float[np.ndarray, "p k 3"],
        roughness: Float[np.ndarray, "p k"],
        full_diffuse: bool,
    ) -> Float[np.ndarray, "2 p k n l"]:
        """The same of every lamp at unit radiance; float32."""
        # As if every lamp shone in a channel of its own.
        apart = np.tile(np.eye(len(lamps.radii), dtype=np.float32), (len(lamps.centres), 1, 1))
        sent = np.zeros((2, *roughness.shape, *self.lamps.shape[1:]), np.float32)
        self.add_lamps(lamps, apart, normals, roughness, full_diffuse, sent)
        return sent


@runtime_checkable
class Light(Protocol):
    """What the rows of a block are multiplied with."""

    def at(self, point: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "d v"]:
        """The light at a point of the camera frame; `d` counts directions or other functions on the sphere."""
        ...


@runtime_checkable
class TransportModel(Protocol):
    """What search and Gauss-Newton ask of a model of reflectance and light: `LightTransport`, or a poorer one."""

    @property
    def incident(self) -> Light:
        """The light."""
        ...

    def block(self, geometry: SurfaceGeometry, pixels: Int[np.ndarray, " p"]) -> Block:
        """What reaches a block of pixels."""
        ...

    def __call__(
        self, block: Block, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "p k v"], Float[np.ndarray, "p k v"]]:
        """(diffuse, specular) of `k` variants of each of the block's pixels, which lean little from the first; no albedo
        applied."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class LightTransport:
    """Diffuse and specular responses of blocks of pixels in every view, under one light."""

    incident: IncidentLight
    photographed: Float[np.ndarray, "q v"]  # of all the object's pixels, which throw light at one another
    full_diffuse: bool
    bounce: bool
    device: str
    # What the geometry's walls throw (`interreflection.radiance_of_hidden_patches`); left out: it has none.
    walls: Float[np.ndarray, "w _"] = field(default_factory=lambda: np.zeros((0, 0), np.float32))

    @property
    def floor(self) -> float:
        """What a direction cell's extent adds to alpha**2."""
        return lobe_floor(len(self.incident.directions))

    @property
    def cell(self) -> np.float32:
        """Solid angle of a direction cell, steradians."""
        return np.float32(4 * np.pi / len(self.incident.directions))

    def check(self, geometry: SurfaceGeometry) -> None:
        """Whether what throws light is what this geometry knows.

        Raises:
            ValueError: the geometry knows other walls than were lit.
        """
        hides = geometry.visibility and geometry.visibility.hidden_surfaces
        if self.bounce and geometry.visibility and len(self.walls) != (len(hides.points) if hides else 0):
            raise ValueError(f"{len(self.walls)} walls are lit, but not those that the geometry knows")

    def block(self, geometry: SurfaceGeometry, pixels: Int[np.ndarray, " p"]) -> Block:
        """What reaches a block of pixels.

        Raises:
            ValueError: as `check`.
        """
        self.check(geometry)
        part = geometry.part(pixels)
        lamps = self.incident.area_lights.visible(part.points, part.visibility)
        return Block(part, self.incident.among(part.points), lamps)

    def __call__(
        self, block: Block, normals: Float[np.ndarray, "p k 3"], roughness: Float[np.ndarray, "p k"]
    ) -> tuple[Float[np.ndarray, "p k v"], Float[np.ndarray, "p k v"]]:
        """(diffuse, specular) of `k` variants of each of the block's pixels; no albedo applied. What sets a pixel's light apart
        from the block's is told for its first variant, and taken to be the same for the others."""
        at, variants = block.geometry, roughness.shape[1]
        # Neighbouring pixels share a horizon: directions below all of theirs need no row and no product.
        first = normals[:, 0].astype(np.float32)
        lean = np.linalg.norm(normals - normals[:, :1], axis=2).max()
        kept = np.nonzero((first @ self.incident.directions.T.astype(np.float32)).max(0) > -lean)[0]
        table = rows(
            normals.reshape(-1, 3), roughness.reshape(-1), np.repeat(at.views, variants, 0),
            self.incident.directions[kept], self.full_diffuse, self.floor,
            None if at.material is None else np.repeat(at.material, variants, 0),
        ).reshape(2 * roughness.size, len(kept))  # fmt: skip
        out = np.zeros((len(table), block.light.mean.shape[1]), np.float32)
        if at.visibility is not None and len(at.visibility.direction):
            self._throw(at.visibility, kept, variants, table, out)
        out += table @ block.light.mean[kept]
        if len(block.light.modes):
            first, apart = table[::variants], np.tile(block.light.coefficients.T, 2)[..., None]
            modes = [(first @ mode[kept]) * far for mode, far in zip(block.light.modes, apart, strict=True)]
            # No view may be kept out: of nothing, numpy cannot tell how many rows there are.
            every = out.reshape(len(out) // variants, variants, out.shape[1])
            every += np.sum(modes, 0)[:, None]
        sent = out.reshape(2, *roughness.shape, -1)
        lamps = self.incident.area_lights
        if len(lamps.radii):
            by_view = sent.reshape(*sent.shape[:3], len(lamps.centres), 3)
            block.add_lamps(lamps, lamps.radiance, normals, roughness, self.full_diffuse, by_view)
        return sent[0], sent[1]

    def _throw(self, hidden: SparseVisibility, kept, variants, table, out) -> None:
        """Add what stands before hidden directions throws, whose entries in the table of the `kept` become 0."""
        column = np.full(len(self.incident.directions), -1, np.int32)
        column[kept] = np.arange(len(kept))
        source = hidden.occluder if self.bounce else np.full_like(hidden.occluder, -1)
        _bounce(
            table, hidden.start, column[hidden.direction], source, self.photographed, self.walls, self.cell, variants, out
        )  # fmt: skip


def direction_cells(count: int) -> Float[np.ndarray, "d 3"]:
    """The direction grid of the solver, camera frame."""
    return fibonacci_sphere(count)


def predict(
    transport: TransportModel,
    geometry: SurfaceGeometry,
    blocks: list[Int[np.ndarray, " _"]],
    normals: Float[np.ndarray, "p 3"],
    albedo: Float[np.ndarray, "p 3"],
    roughness: Float[np.ndarray, " p"],
) -> Iterator[tuple[Int[np.ndarray, " b"], Float[np.ndarray, "b n 3"]]]:
    """Re-rendered radiance of each block of pixels in every view of the responses' light."""

    def sent(pixels: Int[np.ndarray, " b"]) -> tuple[Int[np.ndarray, " b"], Float[np.ndarray, "b n 3"]]:
        diffuse, specular = transport(
            transport.block(geometry, pixels), normals[pixels][:, None], roughness[pixels][:, None]
        )
        shape = (len(pixels), -1, 3)
        return pixels, diffuse.reshape(shape) * albedo[pixels][:, None] + specular.reshape(shape)

    yield from abreast(sent, blocks)
