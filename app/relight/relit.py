"""The recovered surface under another light, in real time: the room's own light turned, its lamps dimmed, or a panorama.

A worker child prepares the surface once (`app/relight/transfer.py`); here a light becomes a picture in a few
milliseconds, with numpy alone. Camera frame; turns are rotations about the object's middle; lamps are near: each
block of pixels sees them from its own place. Shadows and one bounce are those of the object; the room's own
furniture does not shade anew when the light is turned.
"""

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from app.inspect import falsecolour
from engine.geometry import fibonacci_sphere, sphere_solid_angle

CELLS = 2048  # directions that the surface answers to
LATTICE = 8192  # directions that a light is given in
TILE_UNIT = 0.05  # radiance of a tile of the object that weighs as much as unit energy from a direction
WHITE_PERCENTILE = 99.0


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """What light does to each pixel: per block a few rows over directions and each pixel's share of them."""

    mask: Bool[np.ndarray, "h w"]
    box: tuple[int, int, int, int]  # left, top, right, bottom of what is shown
    albedo: Float[np.ndarray, "p 3"]
    order: Int[np.ndarray, " p"]  # place of each pixel among the blocks' (of one size, filled up)
    middles: Float[np.ndarray, "b 3"]  # of the blocks
    basis: Float[np.ndarray, "k d"]  # all blocks' rows over directions, then tiles; the last row is zero
    rows: tuple[Int[np.ndarray, "b k"], Int[np.ndarray, "b k"]]  # of each block: diffuse, specular; filled up
    shares: tuple[Float[np.ndarray, "b n k"], Float[np.ndarray, "b n k"]]  # of them in each of its pixels
    middle: Float[np.ndarray, " 3"]  # of the object
    cube_index: Int[np.ndarray, "6 s s 3"]  # the cells around a direction, and their shares
    cube_share: Float[np.ndarray, "6 s s 3"]
    tile: Int[np.ndarray, " p"]  # of each pixel: it throws light as one
    rays: Float[np.ndarray, "bh bw 3"]  # of the box's pixels

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of the pictures."""
        left, top, right, bottom = self.box
        return bottom - top, right - left


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """A light around the object: energy from far directions, lamps near by, and a picture of it."""

    name: str
    energy: Float[np.ndarray, "m 3"]  # from the lattice's directions, radiance times solid angle
    panorama: Float[np.ndarray, "h w 3"]  # as engine.types.Panorama, without the lamps
    lamp_centre: Float[np.ndarray, "l 3"]
    lamp_radius: Float[np.ndarray, " l"]
    lamp_radiance: Float[np.ndarray, "l 3"]
    lamp_group: Int[np.ndarray, " l"]  # the strength that a lamp follows; -1: that of the room
    lamp_clipped: Bool[np.ndarray, " l"]  # inferred from the object: no photograph shows it unclipped

    @property
    def lamps(self) -> int:
        """How many lamps have a strength of their own, the strongest first."""
        return int(self.lamp_group.max(initial=-1)) + 1


@dataclass(frozen=True, slots=True)
class Setting:
    """How the light is to fall."""

    yaw_deg: float = (
        0.0  # about the picture's vertical; positive takes what is ahead of the camera to the right
    )
    pitch_deg: float = 0.0  # about its horizontal; positive takes what is ahead up
    roll_deg: float = 0.0  # about the viewing axis, clockwise
    room: float = 1.0  # strength of everything but the named lamps
    lamps: tuple[float, ...] = ()  # of each named lamp; those missing are 1
    spot: tuple[float, float] | None = None  # where the person's own lamp stands: see `spot_direction`
    spot_energy: float = 0.0  # radiance times solid angle of that lamp, which does not turn with the room

    def turn(self) -> Float[np.ndarray, "3 3"]:
        """turned_from_given of directions, camera frame."""
        return rotation(self.yaw_deg, self.pitch_deg, self.roll_deg)

    def strength(self, group: int) -> float:
        if group < 0:
            return self.room
        return self.lamps[group] if group < len(self.lamps) else 1.0


def relit(transfer: Transfer, light: Light, setting: Setting) -> Float[np.ndarray, "p 3"]:
    """Radiance of the mask's pixels under a light, and thrown once from one part of the object to another."""
    turn = setting.turn()
    far = cell_energy(transfer, light.energy * np.float32(setting.room), turn)
    if setting.spot is not None:
        index, share = cells_around(transfer, spot_direction(setting.spot)[None])
        far[index[0]] += share[0][:, None] * np.float32(setting.spot_energy)
    direct = _answer(transfer, transfer.basis[:, :CELLS] @ far, _lamps(transfer, light, setting, turn))
    count = np.bincount(transfer.tile)
    tiles = np.stack([np.bincount(transfer.tile, direct[:, c]) for c in range(3)], 1) / count[:, None]
    thrown = transfer.basis[:, CELLS:] @ (tiles * TILE_UNIT).astype(np.float32)
    return direct + _answer(transfer, thrown, None)


def spot_direction(spot: tuple[float, float]) -> Float[np.ndarray, " 3"]:
    """Towards a lamp on a half sphere before the object, camera frame: (right, up) as the viewer sees it, 1 at the rim."""
    right, up = np.array(spot) / max(1.0, float(np.hypot(*spot)))
    return np.array([right, -up, -np.sqrt(max(1 - right**2 - up**2, 0.0))], np.float32)


def _answer(
    transfer: Transfer,
    coefficients: Float[np.ndarray, "k 3"],
    lamps: tuple[Int[np.ndarray, "b c"], Float[np.ndarray, "b c 3"]] | None,
) -> Float[np.ndarray, "p 3"]:
    """Radiance from what each of the basis's rows receives, and from cells of energy that differ by block.

    A few large products instead of some for each block: each would hand the interpreter back and forth.
    """
    both = []
    for rows, shares in zip(transfer.rows, transfer.shares, strict=True):
        mine = coefficients[rows]
        if lamps is not None:
            cells, energy = lamps
            mine = mine + np.matmul(transfer.basis[rows[:, :, None], cells[:, None, :]], energy)
        both.append(np.matmul(shares, mine).reshape(-1, 3)[transfer.order])
    answer = transfer.albedo * both[0] + both[1]
    return np.maximum(answer, 0, out=answer)  # what compressing lost may be negative


def cell_energy(
    transfer: Transfer, energy: Float[np.ndarray, "m 3"], turn: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "d 3"]:
    """The lattice's energy, turned, in the cells that the surface answers to; the sum is kept."""
    index, share = cells_around(transfer, lattice() @ turn.T.astype(np.float32))
    flat = index.ravel()
    return np.stack(
        [np.bincount(flat, (share * energy[:, c : c + 1]).ravel(), CELLS) for c in range(3)], 1
    ).astype(np.float32)


def cells_around(
    transfer: Transfer, directions: Float[np.ndarray, "n 3"]
) -> tuple[Int[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """The three cells around each direction, and the share of its light that each takes."""
    face, u, v = cube_place(directions, transfer.cube_index.shape[1])
    return transfer.cube_index[face, v, u], transfer.cube_share[face, v, u]


def cube_place(
    directions: Float[np.ndarray, "n 3"], side: int
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Face, column and row of directions in the cube map of `engine.light.incident.direction_grid`."""
    x, y, z = directions.T
    size = np.abs(directions)
    axis = size.argmax(1)
    face = np.choose(axis, [np.where(x > 0, 2, 3), np.where(y > 0, 4, 5), np.where(z > 0, 0, 1)])
    # Each face's own right and down, as the rows of FACES in engine/light/incident/direction_grid.py.
    right = np.choose(face, [x, -x, -z, z, x, x])
    down = np.choose(face, [y, y, y, y, -z, z])
    ahead = np.maximum(size[np.arange(len(axis)), axis], 1e-12)
    u = ((right / ahead + 1) * (side / 2)).astype(np.int32)
    v = ((down / ahead + 1) * (side / 2)).astype(np.int32)
    return face, np.minimum(u, side - 1), np.minimum(v, side - 1)


def behind(transfer: Transfer, light: Light, setting: Setting) -> Float[np.ndarray, "bh bw 3"]:
    """The light itself, as the camera would see it behind the object, lamps included."""
    height, width, _ = transfer.rays.shape
    # No finer than the panorama itself, and interpolated: a narrow lens would show its pixels as squares.
    pitch = float(np.linalg.norm(transfer.rays[0, -1] - transfer.rays[0, 0])) / max(width - 1, 1)
    step = max(1, int(2 * np.pi / len(light.panorama) / pitch))
    rows, columns = (np.unique(np.append(np.arange(0, size, step), size - 1)) for size in (height, width))
    rays = transfer.rays[rows[:, None], columns]
    coarse = _seen(light, transfer.middle, setting, rays.reshape(-1, 3)).reshape(*rays.shape)
    down, across = _between(rows, height), _between(columns, width)
    return np.einsum(
        "hr,rwc->hwc", down, np.einsum("wk,rkc->rwc", across, coarse, optimize=True), optimize=True
    )


def _between(kept: Int[np.ndarray, " k"], size: int) -> Float[np.ndarray, "size k"]:
    """Weights of linear interpolation from the places `kept` to all `size` places."""
    at = np.arange(size)
    right = (
        np.clip(np.searchsorted(kept, at, side="right"), 1, len(kept) - 1)
        if len(kept) > 1
        else np.zeros(size, int)
    )
    left = np.maximum(right - 1, 0)
    gap = np.maximum(kept[right] - kept[left], 1)
    share = (at - kept[left]) / gap
    weights = np.zeros((size, len(kept)), np.float32)
    weights[at, left] += 1 - share
    weights[at, right] += share
    return weights


def _seen(
    light: Light, middle: Float[np.ndarray, " 3"], setting: Setting, rays: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """What arrives at the object's middle from turned directions."""
    given = rays @ setting.turn().astype(np.float32)  # row vectors: the inverse turn
    height, width = light.panorama.shape[:2]
    polar = np.arccos(np.clip(-given[:, 1], -1, 1))
    azimuth = np.arctan2(given[:, 0], given[:, 2])
    row = np.minimum((polar / np.pi * height).astype(np.int32), height - 1)
    column = ((azimuth / (2 * np.pi) + 0.5) * width).astype(np.int32) % width
    picture = light.panorama[row, column] * np.float32(setting.room)
    for centre, radius, radiance, group in zip(
        light.lamp_centre, light.lamp_radius, light.lamp_radiance, light.lamp_group, strict=True
    ):
        towards = centre - middle
        far = float(np.linalg.norm(towards))
        inside = given @ (towards / far).astype(np.float32) > np.sqrt(max(1 - (radius / far) ** 2, 0))
        picture[inside] = radiance * setting.strength(int(group))
    return picture


@functools.cache
def _sphere(rows: int) -> Float[np.ndarray, "n 3"]:
    """Directions of a panorama's pixels, as engine.types.Panorama has them."""
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    azimuth = np.pi * (np.arange(2 * rows) + 0.5) / rows - np.pi
    polar, azimuth = np.meshgrid(polar, azimuth, indexing="ij")
    towards = [np.sin(polar) * np.sin(azimuth), -np.cos(polar), np.sin(polar) * np.cos(azimuth)]
    return np.stack(towards, -1).reshape(-1, 3).astype(np.float32)


def framed(
    transfer: Transfer, pixels: Float[np.ndarray, "p 3"], ground: Float[np.ndarray, "bh bw 3"] | None
) -> tuple[Float[np.ndarray, "bh bw 3"], Bool[np.ndarray, "bh bw"]]:
    """The box's picture and its mask; `ground` stands behind the object."""
    left, top, right, bottom = transfer.box
    whole = np.zeros((*transfer.mask.shape, 3), np.float32)
    whole[transfer.mask] = pixels
    picture, inside = whole[top:bottom, left:right], transfer.mask[top:bottom, left:right]
    if ground is not None:
        picture = np.where(inside[..., None], picture, ground)
    return picture, inside


def on_maps(
    transfer: Transfer, pixels: Float[np.ndarray, "p 3"], shape: tuple[int, int]
) -> Float[np.ndarray, "h w 3"]:
    """The pixels on the maps' own grid (`shape`: rows, columns), of which the preview's is a whole fraction."""
    small = np.zeros((*transfer.mask.shape, 3), np.float32)
    small[transfer.mask] = pixels
    # Cells at the rim that hold little of the object are not in the preview: they take what is beside them.
    known = transfer.mask.copy()
    for down, across in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        beside = np.roll(transfer.mask, (down, across), (0, 1)) & ~known
        small[beside] = np.roll(small, (down, across), (0, 1))[beside]
        known |= beside
    height, width = transfer.mask.shape
    by = min(shape[0] // height, shape[1] // width)
    row, column = (np.minimum(np.arange(n) // by, m - 1) for n, m in zip(shape, (height, width), strict=True))
    return small[row[:, None], column]


def white_of(pixels: Float[np.ndarray, "p 3"]) -> float:
    """The radiance to show as white: the 99th percentile of the brightest channel."""
    return float(np.percentile(pixels.max(-1), WHITE_PERCENTILE)) or 1.0


def drawn(
    transfer: Transfer,
    light: Light,
    setting: Setting,
    white: float,
    exposure_ev: float,
    tone: str,
    room: bool,
) -> UInt8[np.ndarray, "bh bw 4"]:
    """The picture for the screen (as in `app/inspect/falsecolour.py`), with the light behind the object if `room`."""
    pixels = relit(transfer, light, setting)
    ground = behind(transfer, light, setting) if room else None
    picture, inside = framed(transfer, pixels, ground)
    return falsecolour.radiance(picture, white, exposure_ev, tone, None if room else inside)


def rotation(yaw_deg: float, pitch_deg: float, roll_deg: float) -> Float[np.ndarray, "3 3"]:
    """Turns about y (down), then x (right), then z (away); positive as in `Setting`."""
    y, p, r = np.radians([yaw_deg, pitch_deg, roll_deg])
    # x right, y down, z away: yaw takes what is ahead to the right, pitch takes it up, roll takes up to the right.
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
    about_z = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    return about_z @ about_x @ about_y


@functools.cache
def lattice() -> Float[np.ndarray, "m 3"]:
    """The directions that lights are given in; float32."""
    return fibonacci_sphere(LATTICE).astype(np.float32)


def overview(
    light: Light, middle: Float[np.ndarray, " 3"], setting: Setting, white: float, rows: int = 96
) -> UInt8[np.ndarray, "h w 4"]:
    """The turned light as a small panorama, logarithmic; the middle is ahead of the camera."""
    picture = _seen(light, middle, setting, _sphere(rows))
    return falsecolour.radiance(picture.reshape(rows, 2 * rows, 3), white, 0.0, "log")


def _lamps(transfer: Transfer, light: Light, setting: Setting, turn: Float[np.ndarray, "3 3"]):
    """Cells [b, 3 l] and energies [b, 3 l, 3] of all lamps as every block sees them; None without lamps."""
    count = len(light.lamp_radius)
    if not count:
        return None
    centres = (light.lamp_centre - transfer.middle) @ turn.T + transfer.middle
    strength = np.array([setting.strength(int(group)) for group in light.lamp_group])
    middles = transfer.middles
    towards = centres[None] - middles[:, None]
    distance = np.linalg.norm(towards, axis=-1)
    solid = np.asarray(sphere_solid_angle(light.lamp_radius, distance))
    cells, share = cells_around(transfer, (towards / distance[..., None]).reshape(-1, 3).astype(np.float32))
    energy = solid[..., None] * (light.lamp_radiance * strength[:, None])
    shape = (len(middles), count, 3)
    each = share.reshape(*shape, 1) * energy[:, :, None, :]
    return cells.reshape(len(middles), -1), each.reshape(len(middles), 3 * count, 3).astype(np.float32)
