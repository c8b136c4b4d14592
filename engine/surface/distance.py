"""About how far the object is, in scene units, from the light's own parallax: a first guess from nothing.

The object never moves in the camera's frame, so it cannot be triangulated; but near lights shift against the
object as the rig moves, by an amount that depends on how far in front of the camera the object is. A small
subset of pixels is solved at a few distances, flat and with nothing hidden; the one with the least misfit
wins. `relight` refines it once the shape is known. In a far room the distance is unobservable and also does
not matter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

from engine.progress import Progress
from engine.surface import newton
from engine.surface.pixels import SurfaceParams
from engine.surface.relight import Parts, Sample, Setting, settle, untouched
from engine.surface.start import global_start

CANDIDATES = 150
PASSES = 3
ROUNDS = 3
LEVELS = (1.0, 5.0)
"""How bright what no photograph shows is at first, in units of its surroundings: normals that are sought under too dark a
ceiling all look up to it, and no gain leads away from there."""
AGAIN, FALLEN = 4, 0.98
"""Where there is any, normals are sought so often once more under the best gains so far, as long as the misfit falls so far."""


_misfit = attrgetter("misfit")


@dataclass(frozen=True, slots=True)
class Distance:
    """Camera to object along z, scene units, with one standard error; `source` is "given" or "light".

    `tried` and `misfit` are the first look's curve, for the report.
    """

    value: float
    stderr: float
    source: str
    tried: tuple[float, ...] = ()
    misfit: tuple[float, ...] = ()


def find_distance(
    parts: Parts, sample: Sample, params: SurfaceParams, progress: Progress
) -> tuple[Setting, tuple[float, ...], tuple[float, ...]]:
    """The best of the lattice's layers, with the light that suits it; and the curve: distances and their misfits.

    What no photograph shows, where there is any, is as bright as suits the object best; one brightness serves to begin
    with at every distance, for it hardly depends on that.
    """
    layers = parts.incident.lattice.depths()
    levels = LEVELS if parts.unseen.any() and params.relight else (1.0,)
    times = len(levels) + (AGAIN if len(levels) > 1 else 0)

    def looked(begun: Sequence[Setting], span: Progress) -> list[Setting]:
        each = [span.part(i / len(layers), (i + 1) / len(layers)) for i in range(len(layers))]
        return [_settled(one, parts, sample, params, share) for one, share in zip(begun, each, strict=True)]

    turns = [progress.part(k / times, (k + 1) / times) for k in range(times)]
    best: list[Setting] = []
    for level, span in zip(levels, turns, strict=False):
        best = _better(best, looked([untouched(parts, float(z), level) for z in layers], span))
    for span in turns[len(levels) :]:
        least = min(best, key=_misfit)
        best = _better(best, looked([replace(least, distance=float(z)) for z in layers], span))
        if _misfit(min(best, key=_misfit)) > FALLEN * least.misfit:
            break
    return min(best, key=_misfit), tuple(map(float, layers)), tuple(map(_misfit, best))


def _settled(
    begun: Setting, parts: Parts, sample: Sample, params: SurfaceParams, progress: Progress
) -> Setting:
    """The light that suits normals which are sought from nothing under it as it is begun."""
    responses, sight = sample.responses(parts.under(begun.gain)), sample.at(begun.distance)
    start = global_start(responses, sight, sample.seen, sample.regions, CANDIDATES, progress.part(0, 0.4))
    rounds = ROUNDS if params.relight else 0
    return settle(
        begun,
        parts,
        sample,
        newton.begin(*start),
        False,
        params.relight,
        rounds,
        PASSES,
        progress.part(0.4, 1),
    )[0]


def _better(some: Sequence[Setting], others: Sequence[Setting]) -> list[Setting]:
    return [min(pair, key=_misfit) for pair in zip(some, others, strict=True)] if some else list(others)
