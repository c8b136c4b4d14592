"""The benchmark's tables, in the forms of the paper's Tables 1 to 3: normals, albedo and roughness, method by method."""

import math
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
    rendered again, seconds, and how many times as long as ours at its defaults."""
    averages = means(scored)
    usual = yardstick(averages)
    lines = [["method", *(s.title for s in SCORES), "In band", "Kept-out views ↓", "seconds", f"x {OURS}"]]
    for one in averages:
        share = ratio(one, usual) if usual.method == OURS else None
        told = [_share(one.in_band, 0), _share(one.rendered, 1)]
        lines.append([one.title, *_cells([one]), *told, seconds(one, usual), shown(share, 2)])
    return markdown(lines)


def yardstick(averages: Sequence[Scored]) -> Scored:
    """The row whose runs the others' times are held against: ours at its defaults, or else the last."""
    return next((one for one in averages if one.method == OURS), averages[-1])


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
    if any(one.extrapolated for one in scored):
        said.append("~ extrapolated from fewer pixels, views or samples")
    if any(one.runs != usual.runs for one in averages if not math.isnan(one.seconds)):
        said.append(
            f"* seconds of other runs than those of {usual.title}, in no ratio with it (--fresh measures all again)"
        )
    return "; ".join(said)


def _share(value: float, decimals: int) -> str:
    return shown(None, 0) if math.isnan(value) else f"{100 * value:.{decimals}f} %"


def _cells(scored: Sequence[Scored]) -> list[str]:
    return [shown(one.values[s.key], s.decimals) for one in scored for s in SCORES]
