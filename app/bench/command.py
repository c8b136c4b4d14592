"""`roomlight bench`: makes sets, measures rows, prints tables, keeps the record and holds it against a baseline.

Exit codes: 0 done, 1 something got worse than the baseline or a quick run finds ours behind the reference, and those of
every command.
"""

import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import replace

from app.bench import (
    ablation_chart,
    beside,
    chart,
    elsewhere,
    gate,
    record,
    rows,
    scaling,
    scaling_chart,
    scores,
    sets,
    tables,
)
from app.bench.measured import Bench
from app.bench.record import BenchError, Metric, Record
from app.bench.scores import Scored
from app.bench.sets import Set
from app.bench.sizes import SIZES, Size
from engine.pipeline.run import choose_device


class Call:
    """What one call of the command measures on; sets are made as they are asked for."""

    def __init__(self, args: Namespace):
        self.args = args
        self.size: Size = SIZES["quick" if args.quick else args.size]
        # One set says as much about a switch or a chart as nine, in a ninth of the time.
        many = args.what == "table"
        self.rooms = args.rooms or (self.size.rooms if many else self.size.rooms[:1])
        self.objects = args.objects or (self.size.objects if many else self.size.objects[:1])
        self.folder = args.sets or sets.default_folder()
        sets.check_names(self.rooms, self.objects)
        if args.seed < 0:
            raise BenchError(f"--seed {args.seed}: give a whole number from 0 on")
        if self.folder.exists() and not self.folder.is_dir():
            raise BenchError(f"{self.folder}: is no folder; name another with --sets")
        self.maps = [elsewhere.named(said, args.maps_frame) for said in getattr(args, "maps", ())]
        for maps in self.maps:  # before hours of work
            for room in self.rooms:
                for thing in self.objects:
                    maps.files(f"{room}-{thing}")
        self.device = choose_device(args.device)
        self.bench = Bench(self.folder, self.device, args.seed, args.fresh)
        self.behind = False  # of the reference, where that was looked at

    def sets(self, views: int | None = None, count: int | None = None) -> list[Set]:
        """Every room and object, of `views` photographs (the size's if None) or `count` of them."""
        return [
            sets.ready(
                self.folder,
                room,
                thing,
                self.size,
                views or self.size.views,
                self.args.seed,
                self.device,
                count,
            )
            for room in self.rooms
            for thing in self.objects
        ]

    def scored(self, methods: Sequence[rows.Method], on: Sequence[Set]) -> list[Scored]:
        """Every method on every set, and the maps computed elsewhere, compared over the same pixels."""
        return [
            one
            for each in on
            for one in scores.score(
                self.bench.rows(each, [*(maps.row(each.name) for maps in self.maps), *methods])
            )
        ]


def run(args: Namespace) -> int:
    """Measure, print, write; 1 if the gate is red.

    Raises:
        RoomlightError: what was asked cannot be measured.
    """
    baseline = record.read(args.gate) if args.gate else None  # before hours of work
    call = Call(args)
    metrics = WHAT[args.what](call)
    measured = Record(
        args.what, call.size.name, call.size.told(), args.seed, record.machine(call.device), record.versions(),
        tuple(metrics),
    )  # fmt: skip
    print(f"\n{call.size.told()}\n{record.told(measured)}")
    if args.json:
        record.write(measured, args.json)
    if args.write_baseline:
        record.write(gate.baseline_of(measured), args.write_baseline)
    if args.quick and call.behind:
        print("ours, standard, does not beat the reference in time and every error", file=sys.stderr)
        return 1
    return _judge(measured, baseline) if baseline is not None else 0


def table(call: Call) -> list[Metric]:
    scored = call.scored((*rows.preset_rows(), *rows.others(call.size, rows.FEW)), call.sets())
    points = scores.means(scored)
    print(tables.by_object(scored) + "\n")
    print(tables.by_switch(scored))
    print("\n" + tables.notes(scored, call.bench.run))
    _compare(call, points)
    return scores.as_metrics([*scored, *points])


def views(call: Call) -> list[Metric]:
    usual = tuple(method for method in rows.preset_rows() if method.key == rows.OURS)
    methods = (*usual, *rows.others(call.size, rows.FEW))
    counted: list[tuple[int, Scored]] = []
    for count in call.size.counts:
        on = call.sets(max(call.size.counts), count)
        counted += [(count, one) for one in call.scored(methods, on)]
    print("the light too is that of so many photographs; true poses and masks given\n")
    print(tables.by_views(counted))
    print("\n" + tables.notes([one for _, one in counted], call.bench.run))
    return scores.as_metrics([replace(one, set=f"{count}-views/{one.set}") for count, one in counted])


def ablation(call: Call) -> list[Metric]:
    on, switches = call.sets(), rows.switch_rows()
    ours = call.scored(switches, on)
    # The reference solves few of the pixels: held against those alone, our switches would differ by chance.
    usual = next(method for method in switches if method.key == rows.OURS)
    theirs = [
        replace(one, set=f"{one.set} {one.pixels} pixels")
        for one in call.scored((usual, *rows.switched(call.size)), on)
    ]
    print("light, poses and masks are shared but where another light is named\n")
    for group in (ours, theirs):
        print(tables.by_switch(group))
        print("\n" + tables.notes(group, call.bench.run) + "\n")
    points = scores.means(ours)
    for path in ablation_chart.write(points, call.args.out, _caption(call, ours)):
        print(path)
    return scores.as_metrics([*ours, *points, *theirs])


def draw(call: Call) -> list[Metric]:
    methods = (*rows.preset_rows(), *rows.others(call.size, rows.MANY), *rows.swept(call.size))
    scored = call.scored(methods, call.sets())
    points = scores.means(scored)
    print(tables.by_switch(scored))
    print("\n" + tables.notes(scored, call.bench.run))
    _compare(call, points)
    for path in chart.write(points, call.args.out, _caption(call, scored)):
        print(path)
    return scores.as_metrics([*scored, *points])


def scale(call: Call) -> list[Metric]:
    metrics: list[Metric] = []
    drawn: list[tuple[str, scaling.Point]] = []
    for on in call.sets():
        points = [
            scaling.measure(
                on, call.folder, axis, value, call.device, call.args.seed, call.bench.run, call.args.fresh
            )
            for axis, values in scaling.values(on, call.size.directions).items()
            for value in values
        ]
        print(f"{on.name}, ours at its defaults, each point in a process of its own\n")
        print(scaling.table(points, call.bench.run))
        if any(point.run != call.bench.run for point in points):
            print(
                "\n* seconds of an earlier run; exponents are fitted within one run (--fresh measures all again)"
            )
        metrics += scaling.as_metrics(points, on.name)
        drawn += [(on.name, point) for point in points]
    caption = (
        f"{', '.join(dict.fromkeys(name for name, _ in drawn))}; {call.size.told()}; ours at its defaults"
    )
    for path in scaling_chart.write(drawn, call.bench.run, call.args.out, caption):
        print(path)
    return metrics


def _caption(call: Call, scored: Sequence[Scored]) -> str:
    """What a chart of these is of."""
    caption = f"{', '.join(dict.fromkeys(one.set for one in scored))}; {call.size.told()}"
    caption += f"; {min(one.pixels for one in scored)} pixels compared"
    return caption + ("" if len({one.run for one in scored}) == 1 else "; seconds of several runs")


def _compare(call: Call, points: Sequence[Scored]) -> None:
    """Print ours beside the reference, and note whether it is behind."""
    dearest = rows.reference(rows.dearest(call.size), call.size, rows.FEW).key
    print("\n" + "\n".join(f"- {line}" for line in beside.told(points, dearest)))
    call.behind = not beside.dominates(points, dearest)


def _judge(measured: Record, baseline: Record) -> int:
    worse, skipped = gate.check(measured, baseline)
    for line in skipped:
        print(f"not compared: {line}", file=sys.stderr)
    for line in worse:
        print(f"worse: {line}", file=sys.stderr)
    gated = len([m for m in baseline.metrics if m.tolerance is not None]) - len(skipped)
    print(f"gate: {len(worse)} of {gated} metrics got worse", file=sys.stderr)
    return 1 if worse else 0


WHAT: dict[str, Callable[[Call], list[Metric]]] = {
    "table": table, "views": views, "ablation": ablation, "chart": draw, "scaling": scale,
}  # fmt: skip
