"""The benchmark's tables, in the forms of the paper's Tables 1 to 3: normals, albedo and roughness, method by method."""

import math
import statistics
from collections.abc import Sequence

from app.bench.markdown import markdown, shown
from app.bench.rows import OURS
from app.bench.scores import SCORES, Scored, by_method, mean, means, object_means, ratio, thing


def by_object(scored: Sequence[Scored]) -> str:
    """Table 1: objects as rows, averaged over rooms; methods as groups of columns; an average; seconds."""
    methods = by_method(scored)
    found = object_means(scored)
    lines = [["object", *(f"{group[0].title}: {s.title}" for group in methods.values() for s in SCORES)]]
    for name in dict.fromkeys(thing(one) for one in found):
        lines.append([name, *_cells([one for one in found if thing(one) == name])])
    lines.append(["average", *_cells([mean(group) for group in methods.values()])])
    return markdown(lines)


def by_set(scored: Sequence[Scored]) -> str:
    """Sets as rows, and their mean: the least error of normals that the photographs allow; of each method its own, how many
    times that it is, and depth within and between parts. Beside the bound, what the pixels' size takes from the truth."""
    methods = by_method(scored)
    heads = ("Normal ↓", "x bound ↓", "depth within px ↓", "between ↓")
    lines = [
        [
            "set",
            "bound deg",
            "pixel blur deg",
            *(f"{group[0].title}: {head}" for group in methods.values() for head in heads),
        ]
    ]
    rows = [[one for one in scored if one.set == name] for name in dict.fromkeys(one.set for one in scored)]
    for row in [*rows, *([means(scored)] if len(rows) > 1 else [])]:
        found = {one.method: one for one in row}
        cells = [_of_set(found[key]) if key in found else ["-"] * len(heads) for key in methods]
        lines.append(
            [
                row[0].set,
                _known(row[0].bound, 3),
                _known(row[0].blur, 2),
                *(cell for cells_of in cells for cell in cells_of),
            ]
        )
    return markdown(lines)


def _of_set(one: Scored) -> list[str]:
    depths = [_known(one.depth_within, 2), _known(one.depth_between, 2)]
    return [shown(one.values["normal"], 2), _known(one.to_bound, 2), *depths]


def by_views(scored: Sequence[tuple[int, Scored]]) -> str:
    """Table 2: numbers of views as rows, methods as groups of columns; each the mean over the sets."""
    methods = by_method(one for _, one in scored)
    lines = [["views", *(f"{group[0].title}: {s.title}" for group in methods.values() for s in SCORES)]]
    for count in sorted({count for count, _ in scored}):
        here = by_method(one for views, one in scored if views == count)
        lines.append([str(count), *_cells([mean(here[key]) for key in methods])])
    return markdown(lines)


def by_switch(scored: Sequence[Scored]) -> str:
    """Table 3: methods as rows, three scores, how many normals lie within their stated 95 %, the error of views kept out and
    rendered again, how many times the bound the error of normals is and how much larger than that of ours at its defaults (mean
    over sets and its standard error), seconds, and how many times as long as ours."""
    averages = means(scored)
    usual = yardstick(averages)
    heads = ["In band", "Validation views ↓", "x bound ↓", f"Normal more than {usual.method}", "seconds"]
    heads.append(f"x {usual.method}")
    lines = [["method", *(s.title for s in SCORES), *heads]]
    for one in averages:
        share = ratio(one, usual)
        told = [_share(one.in_band, 0), _share(one.rendered, 1)]
        told += [_known(one.to_bound, 2), more(scored, one.method, usual.method)]
        lines.append([one.title, *_cells([one]), *told, seconds(one, usual), shown(share, 2)])
    return markdown(lines)


def more(scored: Sequence[Scored], method: str, usual: str) -> str:
    """By how many degrees a method's normals are worse than another's, set by set: the mean and its standard error."""
    of = {(one.set, one.method): one.values["normal"] for one in scored}
    sets = dict.fromkeys(one.set for one in scored)
    apart = [
        of[each, method] - of[each, usual] for each in sets if {(each, method), (each, usual)} <= of.keys()
    ]
    if method == usual or not apart:
        return shown(None, 0)
    error = statistics.stdev(apart) / math.sqrt(len(apart)) if len(apart) > 1 else math.nan
    return f"{statistics.fmean(apart):+.2f}" + ("" if math.isnan(error) else f" ± {error:.2f}")


def yardstick(averages: Sequence[Scored]) -> Scored:
    """The row that the others are held against: ours at its defaults, or else the first."""
    return next((one for one in averages if one.method == OURS), averages[0])


def seconds(one: Scored, usual: Scored) -> str:
    """With `~` where extrapolated and `*` where other runs measured them than the yardstick's; - where nobody did."""
    if math.isnan(one.seconds):
        return shown(None, 0)
    digits = shown(one.seconds, 1 if one.seconds < 100 else 0)
    return f"{'~' if one.extrapolated else ''}{digits}{'' if one.runs == usual.runs else '*'}"


def notes(scored: Sequence[Scored]) -> str:
    """What the marks in a table mean, where it has any; and which pixels were compared."""
    averages = means(scored)
    usual = yardstick(averages)
    said = [
        f"{len({one.set for one in scored})} sets, {min(one.pixels for one in scored)} pixels or more each"
    ]
    if any(not math.isnan(one.bound) for one in scored):
        said.append(
            "bound: the least mean error that each pixel's photographs allow an unbiased estimate for itself"
        )
    if any(not math.isnan(one.blur) for one in scored):
        said.append(
            "pixel blur: mean angle between the truth, at pixel centres, and its mean over a pixel, which photographs show"
        )
    if any(not math.isnan(one.depth_within) for one in scored):
        said.append(
            "depth: mean error in pixel widths, each part of the true depth under its own factor; between parts"
        )
    if any(one.extrapolated for one in scored):
        said.append("~ extrapolated from fewer pixels, views or samples")
    if any(one.runs != usual.runs for one in averages if not math.isnan(one.seconds)):
        said.append(
            f"* seconds of other runs than those of {usual.title}, in no ratio with it (--fresh measures all again)"
        )
    return "; ".join(said)


def _known(value: float, decimals: int) -> str:
    return shown(None if math.isnan(value) else value, decimals)


def _share(value: float, decimals: int) -> str:
    return shown(None, 0) if math.isnan(value) else f"{100 * value:.{decimals}f} %"


def _cells(scored: Sequence[Scored]) -> list[str]:
    return [shown(one.values[s.key], s.decimals) for one in scored for s in SCORES]
