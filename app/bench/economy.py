"""What a scene asks of the model, where that is known: scenes made to need a part or not, and what the solver says of each.

What a scene needs follows from how it is made: room and lamps far away need no light by place, a convex object nothing that hides or
is bounced, a coat of one roughness no roughness by pixel. The solver says that a part is needed where it is worth more than its
standard error (engine/surface/uncertainty/model_parts.py). A rung is a preset, or draft without a part; the rung to choose is the quickest
that renders the views kept out no worse than the best by more than the standard error of the difference over the views.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.auto import gained
from app.bench import choices, drawing, rows
from app.bench.call import Call
from app.bench.markdown import markdown
from app.bench.measured import Row
from app.bench.record import Metric
from engine.results import metrics
from engine.results.quality import is_needed

PLACE, HIDDEN, BOUNCED, GLOSS, ROUGH = PARTS = (
    "light by place", "visibility", "interreflection", "gloss", "roughness by pixel",
)  # fmt: skip
RUNGS = ("far_light", "no_self_shadowing", "no_interreflections")
"""Of `rows.switch_rows`, at draft."""
CHALK = "clay:specular=0"
ACROSS, PANEL_IN = 4, 1.7
NAMES = {"far_light": "far light", "no_self_shadowing": "no shadows", "no_interreflections": "no bounces"}
"""Of rungs beside their points."""


@dataclass(frozen=True, slots=True)
class Scene:
    """A room and an object, and the parts of the model that they need."""

    title: str
    room: str
    thing: str
    material: str
    needs: tuple[str, ...]


SCENES = {
    "far_room": Scene("chalk ball, walls 14 m away", "booth:side=28", "sphere", CHALK, ()),
    "even_light": Scene("chalk ball, light nearly even", "booth:side=28:glow=0.2", "sphere", CHALK, ()),
    "near_room": Scene("chalk ball, walls 1.4 m away", "booth", "sphere", CHALK, (PLACE,)),
    "near_lamp": Scene("chalk ball, lamp at .5 m", "booth:lamp=0.5", "sphere", CHALK, (PLACE,)),
    "painted": Scene("painted ball, far room", "booth:side=28", "sphere", "paint", (GLOSS, ROUGH)),
    "glossy_vase": Scene("glazed vase, far room", "booth:side=28", "vase", "glaze", (HIDDEN, BOUNCED, GLOSS)),
    "recessed": Scene("chalk bowl, near room", "booth", "bowl", CHALK, (PLACE, HIDDEN, BOUNCED)),
}


@dataclass(frozen=True, slots=True)
class Found:
    """What the rungs made of a scene; the first is draft."""

    name: str
    rungs: tuple[Row, ...]
    normal_deg: tuple[float, ...]  # mean errors

    @property
    def scene(self) -> Scene:
        return SCENES[self.name]


def measure(call: Call, name: str) -> Found:
    """Make a scene's photographs and solve every rung."""
    scene = SCENES[name]
    thing = choices.thing(scene.thing, scene.thing, scene.material, call.args.seed)
    on = call.set(choices.built_in(scene.room), thing, None)
    switches = {method.key: method for method in rows.switch_rows("draft")}
    presets = {method.key: method for method in rows.preset_rows()}
    methods = [presets["draft"], presets["standard"], *(switches[key] for key in RUNGS)]
    rungs = tuple(call.bench.rows(on, methods))
    return Found(name, rungs, tuple(metrics.evaluate(row.surface, on.truth).normal_mean_deg for row in rungs))


def choice(rungs: Sequence[Row]) -> int:
    """The quickest rung that is no worse than the best by more than the standard error of the difference."""
    errors = [np.array(row.by_view) for row in rungs]
    best = min(errors, key=np.mean)
    close = [k for k, error in enumerate(errors) if np.less_equal(*gained(error, best))]
    return min(close, key=lambda k: rungs[k].seconds)


def needed(row: Row, part: str) -> tuple[float, float, bool]:
    """What a part is worth, its standard error, and whether that says it is needed; a part that the answer does without is worth 0."""
    gain, stderr = next(((one.gain, one.stderr) for one in row.worths if one.part == part), (0.0, 0.0))
    return gain, stderr, is_needed(gain, stderr, float(np.mean(row.by_view)))


def right(found: Sequence[Found]) -> list[bool]:
    """Cell by cell, whether draft says what the scene needs."""
    return [needed(one.rungs[0], part)[2] == (part in one.scene.needs) for one in found for part in PARTS]


def table(found: Sequence[Found]) -> str:
    """Scenes as rows, parts as columns: what draft says that each is worth, and whether it is needed."""
    lines = [["worth to validation views, %", *PARTS]]
    for one in found:
        cells = []
        for part in PARTS:
            gain, stderr, asked = needed(one.rungs[0], part)
            verdict = "needed" if asked else "not"
            wrong = "" if asked == (part in one.scene.needs) else ", WRONG"
            cells.append(f"{100 * gain:.2f} ± {100 * stderr:.2f} {verdict}{wrong}")
        lines.append([one.scene.title, *cells])
    said = right(found)
    return f"{markdown(lines)}\n\n{sum(said)} of {len(said)} as the scene is made"


def ladder(one: Found) -> str:
    """A scene's rungs, the one to choose marked."""
    best = choice(one.rungs)
    lines = [[one.scene.title, "seconds", "validation views", "normals", ""]]
    for k, (row, off) in enumerate(zip(one.rungs, one.normal_deg, strict=True)):
        error = f"{100 * np.mean(row.by_view):.2f} %"
        lines.append(
            [row.method.title, f"{row.seconds:.1f}", error, f"{off:.2f} deg", "chosen" * (k == best)]
        )
    return markdown(lines)


def as_metrics(found: Sequence[Found]) -> list[Metric]:
    """Every rung's errors and every part's worth; the share of right cells alone is gated."""
    said = right(found)
    metrics = [Metric("economy/right", sum(said) / len(said), "share", "higher", 0.1)]
    for one in found:
        for part in PARTS:
            gain, stderr, _ = needed(one.rungs[0], part)
            at = f"{one.name}/{part.replace(' ', '_')}"
            metrics.append(Metric(f"{at}/worth", gain, "relative error", "higher"))
            metrics.append(Metric(f"{at}/stderr", stderr, "relative error", "lower"))
        for k, (row, off) in enumerate(zip(one.rungs, one.normal_deg, strict=True)):
            at = f"{one.name}/{row.method.key}"
            metrics.append(Metric(f"{at}/normal", off, "deg", "lower"))
            metrics.append(Metric(f"{at}/kept_out", float(np.mean(row.by_view)), "relative error", "lower"))
            metrics.append(Metric(f"{at}/seconds", row.seconds, "s", "lower"))
            metrics.append(Metric(f"{at}/chosen", float(k == choice(one.rungs)), "", "higher"))
    return metrics


def write(found: Sequence[Found], folder: Path, caption: str) -> list[Path]:
    """economy.png, economy.svg and economy.csv in `folder`.

    Raises:
        BenchError: the disk refuses.
    """
    lines: list[Sequence[object]] = [["scene", "rung", "seconds", "kept_out", "normal_deg", "chosen"]]
    for one in found:
        for k, row in enumerate(one.rungs):
            values = [f"{x:.6g}" for x in (row.seconds, np.mean(row.by_view), one.normal_deg[k])]
            lines.append([one.name, row.method.key, *values, int(k == choice(one.rungs))])
    return drawing.write(draw(found, caption), folder, "economy", drawing.csv_of(lines))


def draw(found: Sequence[Found], caption: str):
    """A matplotlib figure: of every scene the error of the views kept out against seconds, the choice ringed."""
    from matplotlib.figure import Figure

    down = math.ceil(len(found) / ACROSS)
    figure = Figure(figsize=(drawing.WIDTH_IN, PANEL_IN * down + 0.4), dpi=drawing.DPI, layout="constrained")
    panels = figure.subplots(down, ACROSS, squeeze=False).ravel()
    for one, axes in zip(found, panels, strict=False):
        best = choice(one.rungs)
        for k, row in enumerate(one.rungs):
            at = row.seconds, 100 * float(np.mean(row.by_view))
            spread = 100 * float(np.std(row.by_view, ddof=1)) / math.sqrt(len(row.by_view))
            whole = row.method.key in ("draft", "standard")
            colour = drawing.BLUE if whole else drawing.VERMILION
            axes.errorbar(*at, spread, fmt="o" if whole else "s", color=colour, ms=3, lw=0.6, zorder=3)
            if k == best:
                axes.plot(*at, "o", color=drawing.GREEN, ms=9, mfc="none", zorder=4)
            name = NAMES.get(row.method.key, row.method.key)
            axes.annotate(name, at, (3, 2), textcoords="offset points", fontsize=4.5, color="0.25")
        axes.set_title(one.scene.title, fontsize=6)
        axes.margins(x=0.25, y=0.15)
        drawing.plain(axes)
        axes.tick_params(labelsize=5)
    for axes in panels[len(found) :]:
        axes.axis("off")
    figure.suptitle(
        "blue: presets, red: draft without a part, or less of it; ringed: the choice", fontsize=6.5
    )
    figure.supylabel("validation views: error and its standard error, %", fontsize=6)
    figure.supxlabel(f"seconds\n{caption}", fontsize=5.5, color="0.35")
    return figure
