"""About how far the object is, in scene units, from the light's own parallax: a first guess from nothing.

The object never moves in the camera's frame, so it cannot be triangulated; but near lights shift against the
object as the rig moves, by an amount that depends on how far in front of the camera the object is. A small
subset of pixels is solved at a few distances, flat and with nothing hidden; the one with the least misfit
wins. `relight` refines it once the shape is known. In a far room the distance is unobservable and also does
not matter.
"""

from dataclasses import dataclass

from engine.progress import Progress
from engine.surface import newton
from engine.surface.pixels import SurfaceParams
from engine.surface.relight import Parts, Sample, settle, untouched
from engine.surface.start import global_start

CANDIDATES = 150
PASSES = 3
ROUNDS = 3


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
) -> tuple[float, tuple[float, ...], tuple[float, ...]]:
    """The best of the lattice's layers, and the curve: distances and their misfits."""
    layers = parts.incident.lattice.depths()
    settings = []
    for i, z in enumerate(layers):
        span = progress.part(i / len(layers), (i + 1) / len(layers))
        setting = untouched(parts, float(z))
        light = parts.under(setting.gain)
        state = newton.begin(
            *global_start(
                sample.responses(light), sample.at(float(z)), sample.seen, sample.regions, CANDIDATES,
                span.part(0, 0.4),
            )
        )  # fmt: skip
        rounds = ROUNDS if params.relight else 0
        setting, _ = settle(
            setting, parts, sample, state, False, params.relight, rounds, PASSES, span.part(0.4, 1)
        )
        settings.append(setting)
    best = min(settings, key=lambda setting: setting.misfit)
    return best.distance, tuple(map(float, layers)), tuple(setting.misfit for setting in settings)
