"""Paint procedural albedo: wallpapers, planks, stones, posters, books that never repeat.

A painter takes a size in metres, the texel's size in metres and a generator, and returns linear Rec.709
albedo, float32 in [0.03, 0.9], first row at the top. Detail spans every scale from the texel to the
whole panel, as in the dead-leaves model of natural images (Lee, Mumford and Huang 2001: leaf sizes follow a
power law), so that feature matching finds something from near and from far.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

Albedo = Float[np.ndarray, "h w 3"]
Painter = Callable[[float, float, float, np.random.Generator], Albedo]  # height_m, width_m, texel_m, rng

DARKEST, BRIGHTEST = 0.03, 0.9


def wallpaper(base: tuple[float, float, float], contrast: float = 1.0) -> Painter:
    """A wall with a leafy pattern of muted colours around `base`."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        wall = np.ones((*texels(height_m, width_m, texel_m), 3), np.float32) * np.array(base, np.float32)
        wall *= 1 + 0.08 * contrast * noise(wall.shape[:2], texel_m, 0.8, rng)[..., None]
        hues = palette(rng, 14, value=float(np.mean(base)), spread=0.45 * contrast, saturation=0.5)
        leaves(wall, texel_m, rng, hues, smallest_m=0.014, largest_m=0.35, cover=1.3)
        wall *= 1 + 0.05 * contrast * noise(wall.shape[:2], texel_m, 0.04, rng)[..., None]
        return finish(wall)

    return paint


def plaster(base: tuple[float, float, float]) -> Painter:
    """Stained, cracked plaster."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        shape = texels(height_m, width_m, texel_m)
        wall = np.ones((*shape, 3), np.float32) * np.array(base, np.float32)
        wall *= np.exp(0.16 * noise(shape, texel_m, 0.6, rng, gain=0.75))[..., None]
        tint = noise(shape, texel_m, 1.0, rng)[..., None] * np.array([0.04, 0.0, -0.05], np.float32)
        wall *= 1 + tint
        stains = noise(shape, texel_m, 0.25, rng, gain=0.6)
        wall *= (1 - 0.45 * np.clip(2.5 * (stains - 1.1), 0, 1))[..., None]
        cracks = np.abs(noise(shape, texel_m, 0.5, rng, gain=0.55))
        wall *= (1 - 0.5 * np.exp(-((cracks / 0.02) ** 2)))[..., None]
        hues = palette(rng, 8, value=float(np.mean(base)) * 0.7, spread=0.5, saturation=0.35)
        leaves(wall, texel_m, rng, hues, smallest_m=0.008, largest_m=0.06, cover=0.14)
        return finish(wall)

    return paint


def planks(base: tuple[float, float, float], plank_m: float = 0.14) -> Painter:
    """Boards of uneven width with grain, knots and dark joints, running along the width."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        h, w = texels(height_m, width_m, texel_m)
        wood = np.zeros((h, w, 3), np.float32)
        row = 0
        while row < h:
            rows = min(max(6, round(plank_m * rng.uniform(0.6, 1.3) / texel_m)), h - row)
            column = -round(rng.uniform(0, 1.2) / texel_m)
            while column < w:
                columns = round(rng.uniform(0.5, 1.6) / texel_m)
                lo, hi = max(column, 0), min(column + columns, w)
                column += columns
                if hi - lo < 1:
                    continue
                grain = noise((rows, hi - lo), texel_m, 0.03, rng, gain=0.8, stretch=9.0)
                knots = noise((rows, hi - lo), texel_m, 0.12, rng, stretch=1.6)
                tone = np.array(base, np.float32) * rng.uniform(0.55, 1.35) * rng.uniform(0.9, 1.1, 3)
                board = tone * np.exp(0.17 * grain - 0.5 * np.clip(3 * (knots - 1.2), 0, 1))[..., None]
                board[:1] *= 0.35
                board[:, :1] *= 0.4
                wood[row : row + rows, lo:hi] = board
            row += rows
        return finish(wood)

    return paint


def stones(base: tuple[float, float, float], stone_m: float = 0.16, squash: float = 1.0) -> Painter:
    """Irregular stones or tiles in mortar; no two alike."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        h, w = texels(height_m, width_m, texel_m)
        count = max(4, round(1.3 * height_m * width_m / (stone_m**2 * squash)))
        seeds = rng.uniform([-0.1, -0.1], [height_m + 0.1, width_m + 0.1], (count, 2)) * [1.0, squash]
        ys, xs = np.meshgrid((np.arange(h) + 0.5) * texel_m, (np.arange(w) + 0.5) * texel_m, indexing="ij")
        wobble = 0.012 * noise((h, w), texel_m, 0.1, rng)
        distance, nearest = KDTree(seeds).query(
            np.stack([ys + wobble, (xs + wobble) * squash], -1).reshape(-1, 2), k=2
        )
        edge = (distance[:, 1] - distance[:, 0]).reshape(h, w)
        tones = (
            np.array(base, np.float32)
            * np.exp(rng.normal(0, 0.35, (count, 1)))
            * rng.uniform(0.8, 1.2, (count, 3))
        )
        face = tones[nearest[:, 0].reshape(h, w)].astype(np.float32)
        face *= np.exp(0.18 * noise((h, w), texel_m, 0.08, rng, gain=0.75))[..., None]
        mortar = np.clip((edge - 0.006) / 0.006, 0, 1)[..., None]
        joint = (
            np.array([0.42, 0.4, 0.37], np.float32)
            * np.exp(0.15 * noise((h, w), texel_m, 0.02, rng))[..., None]
        )
        return finish((face * mortar + joint * (1 - mortar)).astype(np.float32))

    return paint


def poster(saturation: float = 0.8) -> Painter:
    """A picture: colour fields, crowded shapes and lines of what could be writing."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        h, w = texels(height_m, width_m, texel_m)
        hues = palette(rng, 10, value=0.4, spread=0.9, saturation=saturation)
        ramp = np.linspace(0, 1, h, dtype=np.float32)[:, None, None]
        sheet = np.broadcast_to(hues[0] * (1 - ramp) + hues[1] * ramp, (h, w, 3)).copy()
        leaves(sheet, texel_m, rng, hues, smallest_m=0.008, largest_m=0.3 * min(height_m, width_m), cover=1.5)
        if rng.uniform() < 0.7:
            top = int(h * rng.uniform(0.05, 0.6))
            _writing(sheet[top : top + int(0.3 * h), int(0.08 * w) : int(0.92 * w)], texel_m, rng)
        rim = max(2, round(0.012 / texel_m))
        frame = np.float32(rng.uniform(0.05, 0.7)) * rng.uniform(0.8, 1.2, 3).astype(np.float32)
        for edge in (sheet[:rim], sheet[-rim:], sheet[:, :rim], sheet[:, -rim:]):
            edge[:] = frame
        return finish(sheet)

    return paint


def books() -> Painter:
    """A row of spines, each with its own width, height, colour and title."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        h, w = texels(height_m, width_m, texel_m)
        row = np.full((h, w, 3), 0.05, np.float32)
        left = 0
        while left < w:
            right = min(w, left + max(3, round(rng.uniform(0.015, 0.05) / texel_m)))
            top = int(h * rng.uniform(0.02, 0.3))
            tone = palette(rng, 1, value=0.35, spread=0.9, saturation=0.7)[0]
            spine = row[top:, left:right]
            spine[:] = tone * (1 + 0.06 * noise(spine.shape[:2], texel_m, 0.03, rng))[..., None]
            band = rng.integers(0, max(1, spine.shape[0] - 4))
            spine[band : band + rng.integers(2, 9)] = palette(rng, 1, 0.6, 0.5, 0.5)[0]
            if spine.shape[1] > 4:
                _writing(spine[spine.shape[0] // 4 : spine.shape[0] // 2, 1:-1], texel_m, rng)
            row[:, right - 1 : right] *= 0.4
            left = right
        return finish(row)

    return paint


def rug() -> Painter:
    """A carpet of uneven stripes, borders and crowded motifs."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        h, w = texels(height_m, width_m, texel_m)
        hues = palette(rng, 9, value=0.3, spread=0.8, saturation=0.75)
        cloth = np.ones((h, w, 3), np.float32) * hues[0]
        inset = 0
        for hue in hues[1:5]:
            inset += max(2, round(rng.uniform(0.02, 0.09) / texel_m))
            if 2 * inset < min(h, w):
                cloth[inset : h - inset, inset : w - inset] = hue
        inner = cloth[inset : h - inset, inset : w - inset] if 2 * inset < min(h, w) else cloth
        leaves(inner, texel_m, rng, hues, smallest_m=0.02, largest_m=0.3, cover=1.6)
        cloth *= np.exp(0.12 * noise((h, w), texel_m, 0.02, rng, gain=0.8))[..., None]
        return finish(cloth)

    return paint


def paint_of(tone: tuple[float, float, float], grain: float = 0.1) -> Painter:
    """Nearly one colour with faint wear: furniture sides, frames, and the walls of the plain room."""

    def paint(height_m: float, width_m: float, texel_m: float, rng: np.random.Generator) -> Albedo:
        shape = texels(height_m, width_m, texel_m)
        fine = noise(shape, texel_m, 0.05, rng, gain=0.7)
        coarse = noise(shape, texel_m, 0.7, rng)
        return finish(
            (np.exp(grain * (0.6 * fine + coarse))[..., None] * np.array(tone, np.float32)).astype(np.float32)
        )

    return paint


def texels(height_m: float, width_m: float, texel_m: float) -> tuple[int, int]:
    """Rows and columns of a panel's texture."""
    return max(2, round(height_m / texel_m)), max(2, round(width_m / texel_m))


def finish(albedo: Albedo) -> Albedo:
    """Soft limits: nothing reflects more than white paint or less than soot."""
    return np.clip(albedo, DARKEST, BRIGHTEST).astype(np.float32)


def palette(
    rng: np.random.Generator, count: int, value: float, spread: float, saturation: float
) -> Float[np.ndarray, "count 3"]:
    """Colours of log-normal brightness around `value`; `saturation` 0 is grey, 1 vivid."""
    hue = rng.uniform(0, 2 * np.pi, (count, 1)) + np.array([0, 2.1, 4.2])
    colour = 1 + saturation * rng.uniform(0.2, 1, (count, 1)) * np.cos(hue)
    return np.clip(value * np.exp(spread * rng.normal(size=(count, 1))) * colour, 0.03, 0.9).astype(
        np.float32
    )


def noise(
    shape: tuple[int, int],
    texel_m: float,
    coarsest_m: float,
    rng: np.random.Generator,
    gain: float = 0.5,
    stretch: float = 1.0,
) -> Float[np.ndarray, "h w"]:
    """Band-limited noise of zero mean and unit deviation; each octave half the size and `gain` as strong.

    `stretch` makes it that much longer along the width, as grain is in wood.
    """
    total = np.zeros(shape, np.float32)
    power, amplitude, cell = 0.0, 1.0, coarsest_m / texel_m
    while cell >= 1.5:
        total += amplitude * _lattice(shape, cell, cell * stretch, rng)
        power += amplitude**2
        amplitude, cell = amplitude * gain, cell / 2
    return total / np.float32(np.sqrt(max(power, 1e-9) * 0.38))  # 0.38: variance of the interpolated lattice


def _lattice(
    shape: tuple[int, int], rows: float, columns: float, rng: np.random.Generator
) -> Float[np.ndarray, "h w"]:
    """One octave: unit normals on a lattice, interpolated with smooth steps."""

    def along(count: int, cell: float) -> tuple[np.ndarray, np.ndarray, int]:
        at = (np.arange(count) + 0.5) / cell + rng.uniform(0, 1)
        low = np.floor(at).astype(int)
        t = (at - low).astype(np.float32)
        return low, t * t * (3 - 2 * t), int(low[-1]) + 2

    y, ty, nodes_y = along(shape[0], rows)
    x, tx, nodes_x = along(shape[1], columns)
    nodes = rng.normal(size=(nodes_y, nodes_x)).astype(np.float32)
    lines = nodes[y] * (1 - ty[:, None]) + nodes[y + 1] * ty[:, None]
    return lines[:, x] * (1 - tx) + lines[:, x + 1] * tx


def leaves(
    canvas: Albedo,
    texel_m: float,
    rng: np.random.Generator,
    hues: Float[np.ndarray, "k 3"],
    smallest_m: float,
    largest_m: float,
    cover: float,
) -> None:
    """Lay ellipses, boxes and wedges on `canvas` until they would cover it `cover` times; sizes ~ size^-3."""
    h, w = canvas.shape[:2]
    smallest_m = min(max(smallest_m, 1.6 * texel_m), largest_m)  # what is smaller no texel shows
    area, goal, sizes = 0.0, cover * h * w * texel_m**2, []
    while area < goal:
        u = rng.uniform(size=256)
        drawn = (smallest_m**-2 + u * (largest_m**-2 - smallest_m**-2)) ** -0.5
        # The power law alone gives nearly all small leaves; a tenth are drawn evenly so that big ones appear.
        drawn = np.where(rng.uniform(size=256) < 0.1, rng.uniform(smallest_m, largest_m, 256), drawn)
        sizes.append(drawn)
        area += float((drawn**2).sum()) * 0.4
    every = np.concatenate(sizes)
    every = every[: max(1, round(len(every) * goal / area))]
    for size in np.sort(every)[::-1]:
        _leaf(canvas, size / texel_m, rng, hues[rng.integers(len(hues))])


def _leaf(canvas: Albedo, size: float, rng: np.random.Generator, hue: np.ndarray) -> None:
    h, w = canvas.shape[:2]
    cy, cx, angle = rng.uniform(0, h), rng.uniform(0, w), rng.uniform(0, np.pi)
    half_a, half_b = size * 0.5, size * 0.5 * rng.uniform(0.35, 1.0)
    y0, y1 = max(0, int(cy - size * 0.75)), min(h, int(cy + size * 0.75) + 2)
    x0, x1 = max(0, int(cx - size * 0.75)), min(w, int(cx + size * 0.75) + 2)
    y, x = np.arange(y0, y1)[:, None], np.arange(x0, x1)
    a = ((x + 0.5 - cx) * np.cos(angle) + (y + 0.5 - cy) * np.sin(angle)) / half_a
    b = ((y + 0.5 - cy) * np.cos(angle) - (x + 0.5 - cx) * np.sin(angle)) / half_b
    kind = rng.integers(4)
    if kind == 0:
        inside = a * a + b * b < 1
    elif kind == 1:
        inside = (np.abs(a) < 0.85) & (np.abs(b) < 0.85)
    elif kind == 2:
        inside = (b > -0.7) & (b + 1.6 * np.abs(a) < 0.8)
    else:
        ring = a * a + b * b
        inside = (ring < 1) & (ring > 0.45)
    opacity = np.float32(rng.uniform(0.5, 1.0))
    patch = canvas[y0:y1, x0:x1]
    patch[inside] = patch[inside] * (1 - opacity) + hue * (opacity * np.float32(rng.uniform(0.75, 1.25)))


def _writing(block: Albedo, texel_m: float, rng: np.random.Generator) -> None:
    """Strokes in rows, as of print too small to read."""
    h, w = block.shape[:2]
    line = max(3, round(0.022 * rng.uniform(0.7, 1.5) / texel_m))
    if h <= line:
        return  # too low for one row of print; perhaps no texel at all
    ink = np.float32(0.04 if block.mean() > 0.3 else 0.75)
    for top in range(0, h - line, round(line * 1.6)):
        x = 0
        while x < w - 2:
            letter = max(1, int(line * rng.uniform(0.15, 0.6)))
            if rng.uniform() < 0.8:
                upper = int(line * rng.uniform(0, 0.5))
                lower = max(upper + 1, int(line * rng.uniform(0.5, 1)))
                block[top + upper : top + lower, x : x + letter] = ink
            x += letter + max(1, int(line * 0.2))
