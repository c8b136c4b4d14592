"""Pixels look beyond their own valley: at what neighbours found, and at what other horizons would cost.

Gauss-Newton finds the bottom of the valley it stands in; what a neighbour found may lie in a deeper one. A lower
misfit alone is no proof, though: in a shadowed corner of two bodies half of the pixels that ended more
than 15 degrees off explain their photographs better than the truth would. A pixel that stands apart from those
around it therefore has to explain its photographs the better. Camera frame.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from engine.parallel import each
from engine.progress import Progress
from engine.surface.data.observations import Observations, aside
from engine.surface.optimize import horizon_search
from engine.surface.optimize.gauss_newton import FRESH, State, facing
from engine.surface.params import SurfaceParams
from engine.surface.rendering.interreflection import lit
from engine.surface.rendering.object_pixels import Subject
from engine.surface.rendering.transport import Incident, Responses, Sight, blocks

REACH = (1, 3)
"""How many pixels away the neighbours are that a pixel asks."""
ASKING = 1.15
"""Pixels whose residuals spread this many times the median's ask their neighbours; the others explain well."""
CONVINCED = 0.98
"""A neighbour's answer must lower the misfit to this share: noise alone is no reason to jump."""
APART = np.radians(10.0), 0.2
"""Between two neighbours' normals, and the logs of their albedos, where they stand half apart. A pixel apart from all
its neighbours in both has to explain three times as well. On two bodies among lamps this took the pixels more than
15 degrees off from 3.3 to 2.6 %, and spared albedo the 1.3 dB that each turn had cost it."""
VIEWS = 48
"""Views that are enough to compare answers."""


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """Pixels that share their light, and what `horizon_search.explain` has to know of them."""

    pixels: Int[np.ndarray, " k"]
    responses: Responses
    sight: Sight
    energy: Float[np.ndarray, "d v"]
    around: tuple[Int[np.ndarray, " d"], Int[np.ndarray, " d"]]
    seen: Observations
    beside: Int[np.ndarray, "p s"]
    facing: Float[np.ndarray, "p 3"]  # the normals of those beside, float32
    spread: Float[np.ndarray, " p"]
    gloss: Float[np.ndarray, "p 2"]
    usual: float

    def explain(
        self,
        of: Int[np.ndarray, " k"],
        normals: Float[np.ndarray, "k 3"],
        roughness: Float[np.ndarray, " k"],
        level: Int[np.ndarray, "k s"],
        sweeps: int,
        prices: Float[np.ndarray, "k s l"] | None = None,
    ) -> tuple[Int[np.ndarray, "k s"], Float[np.ndarray, " k"], Float[np.ndarray, "k 3"]]:
        """`horizon_search.explain` for some of the mask's pixels."""
        return horizon_search.explain(
            self.responses, self.sight, of, normals, roughness, level, self.energy, self.around,
            self.seen.part(of), self.spread[of], self.gloss[of], self.usual, self.beside, self.facing, sweeps, prices,
        )  # fmt: skip


def inquire(
    who: Subject,
    state: State,
    light: Incident,
    sight: Sight,
    params: SurfaceParams,
    work: Callable[[Asked], None],
    progress: Progress,
    doing: str,
) -> None:
    """Have the `work` done on the object's pixels, block by block and several blocks at a time, without its rim: that holds
    some background, which horizons would explain."""
    beside = horizon_search.beside(who.mask)
    count = light.energy.shape[2] // 3
    every = np.arange(0, count, -(-count // VIEWS))
    light, seen = light.views(every), who.seen.part(np.arange(len(state.normals)), every)
    walls = horizon_search.by_channel(lit(sight, light, seen.radiance)) if params.bounce else None
    seen = replace(
        seen, radiance=horizon_search.by_channel(seen.radiance), weight=horizon_search.by_channel(seen.weight)
    )
    responses = Responses(light, seen.radiance, params.full_diffuse, params.bounce, "cpu", walls)
    usual, facing = float(np.median(state.spread)), state.normals.astype(np.float32)

    def some(block: Int[np.ndarray, " _"]) -> None:
        pixels = block[~seen.edge[block]]
        if len(pixels):
            energy = horizon_search.by_channel(responses.whole_energy(sight, block))
            around = horizon_search.compass(light.directions, sight.middle(block))
            work(Asked(
                pixels, responses, sight, energy, around, seen, beside, facing, state.spread, state.gloss, usual,
            ))  # fmt: skip

    each(some, blocks(who.mask), progress, doing)


def ask(
    who: Subject,
    state: State,
    light: Incident,
    sight: Sight,
    params: SurfaceParams,
    progress: Progress,
    looking: bool = True,
) -> State:
    """Let every pixel look for its horizon, unless none is `looking`, and those that explain badly try their neighbours' answers."""
    everybody = np.arange(len(state.normals))
    sweeps = horizon_search.SWEEPS if looking and params.horizons and sight.occlusion is not None else 0
    restless = state.spread > ASKING * np.median(state.spread)
    others = neighbours(who.mask).T
    # A pixel that stands for a missing neighbour, or holds some background, has no voice.
    voices = (others != everybody) & ~who.seen.edge[others]
    kept = state.copy()

    def answer(block: Asked) -> None:
        pixels = block.pixels
        least = np.full(len(pixels), np.inf)
        for turn, other in enumerate((everybody, everybody, *others)):
            # First what it holds, then what the depth has, then the neighbours.
            of = np.arange(len(pixels)) if turn < 2 else np.nonzero(restless[pixels])[0]
            if turn == 1:
                of = np.nonzero(state.level[pixels].any(1))[0]
            if not len(of):
                continue
            mine, theirs = pixels[of], other[pixels[of]]
            normals = facing(state.normals[theirs], sight.views[mine])
            level = state.level[theirs] if turn != 1 else np.zeros_like(state.level[theirs])
            level, misfit, albedo = block.explain(mine, normals, state.roughness[theirs], level, sweeps)
            misfit *= 1 + dissent(normals, albedo, state, others[:, mine], voices[:, mine])
            better = misfit < least[of] * (CONVINCED if turn > 1 else 1)
            won = mine[better]
            least[of[better]] = misfit[better]
            kept.normals[won], kept.roughness[won] = normals[better], state.roughness[theirs[better]]
            kept.albedo[won], kept.level[won], kept.damping[won] = albedo[better], level[better], FRESH

    inquire(who, state, light, sight, params, answer, progress, "asking the neighbours")
    return kept


def dissent(
    normals: Float[np.ndarray, "k 3"],
    albedo: Float[np.ndarray, "k 3"],
    state: State,
    others: Int[np.ndarray, "n k"],
    voices: Bool[np.ndarray, "n k"],
) -> Float[np.ndarray, " k"]:
    """How far an answer stands apart from what those others hold that have a voice: 0 when like all, 2 when unlike all."""
    tilt = 2 - 2 * np.minimum((normals * state.normals[others]).sum(-1), 1)
    tint = ((np.log(albedo) - np.log(state.albedo[others])) ** 2).mean(-1)
    doubts = np.sum([away / (away + apart**2) for away, apart in zip((tilt, tint), APART, strict=True)], 0)
    return (doubts * voices).sum(0) / np.maximum(voices.sum(0), 1)


def neighbours(mask: Bool[np.ndarray, "h w"]) -> Int[np.ndarray, "p k"]:
    """The pixels (in mask order) that each pixel asks; itself where the object ends."""
    steps = [step for r in REACH for step in ((0, r), (0, -r), (r, 0), (-r, 0))]
    others = aside(mask, np.array(steps))
    return np.where(others >= 0, others, np.arange(len(others))[:, None])
