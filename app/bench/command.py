"""`roomlight bench`: makes sets, measures rows, prints tables, keeps the record and holds it against a baseline.

Exit codes: 0 done, 1 something got worse than the baseline or a quick run finds ours behind the reference, and those of
every command.
"""

import shutil
import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile

from app.bench import (
    ablation_chart,
    beside,
    chart,
    choices,
    economy,
    estimated,
    gate,
    parts,
    pipeline,
    pipeline_chart,
    record,
    rows,
    scaling,
    scaling_chart,
    scores,
    tables,
)
from app.bench.call import FEW, TILE, WHOLE, Call, Groups, grouped
from app.bench.estimated import Estimated
from app.bench.record import BenchError, Metric, Record
from app.bench.scores import Scored
from app.bench.sizes import SIZES, Size
from app.bench.stress import chart as stress_chart
from app.bench.stress import dials as stress_dials
from app.bench.stress import scores as stress_scores
from app.bench.stress.measure import CLEAN, Stressed, measure, photographed
from engine.conventions import LEAST_VIEWS
from engine.io.session import nearest_existing
from engine.pipeline import stage_table


def run(args: Namespace) -> int:
    """Measure, print, write; 1 if the gate is red.

    Raises:
        RoomlightError: what was asked cannot be measured.
    """
    _check_outputs(args)  # before hours of work, as all that follows
    baseline = record.read(args.gate) if args.gate else None
    if getattr(args, "records", None):
        return _of_records(args)
    call = Call(args)
    metrics = WHAT[args.what](call)
    held = {group: [parts.row(one) for one in found] for group, found in call.rows.items()}
    measured = Record(
        args.what, call.size.name, call.inputs, args.seed, record.machine(call.device), record.versions(),
        tuple(metrics), held, [asdict(one) for one in call.estimated],
    )  # fmt: skip
    print(f"\n{call.inputs}\n{record.told(measured)}")
    if args.json:
        record.write(measured, args.json)
    if args.write_baseline:
        record.write(gate.baseline_of(measured), args.write_baseline)
    if args.quick and call.behind:
        print("ours, standard, does not beat the reference in time and every error", file=sys.stderr)
        return 1
    return _judge(measured, baseline) if baseline is not None else 0


def _check_outputs(args: Namespace) -> None:
    files = {"--json": args.json, "--write-baseline": args.write_baseline}
    for option, file in files.items():
        if file is not None and file.is_dir():
            raise BenchError(f"{file}: is a folder; name a file with {option}")
    folders = {option: file and file.parent for option, file in files.items()} | {
        "--out": getattr(args, "out", None)
    }
    for option, folder in folders.items():
        if folder is None:
            continue
        there = nearest_existing(folder)
        if not there.is_dir():
            raise BenchError(f"{there}: is no folder; name another with {option}")
        try:  # permissions alone do not say it: root has them everywhere
            with TemporaryFile(dir=there):
                pass
        except OSError as error:
            raise BenchError(
                f"{there}: may not be written to ({error.strerror}); name another with {option}"
            ) from error


def table(call: Call) -> list[Metric]:
    methods = call.chosen((*rows.preset_rows(), *rows.others(call.size, call.least(rows.FEW))))
    on = call.sets()
    call.estimated = [] if call.size.given else [estimated.of_set(each) for each in on]
    call.rows = call.groups(methods, on)
    _print_table(call.rows, call.estimated)
    _compare(call, call.rows)
    return _metrics(call.rows, scores.object_means)


def views(call: Call) -> list[Metric]:
    usual = tuple(method for method in rows.preset_rows() if method.key in rows.BESIDE)
    methods = call.chosen((*usual, *rows.others(call.size, call.least(rows.FEW))))
    counted: dict[int, Groups] = {}
    for count in call.size.counts:
        counted[count] = call.groups(methods, call.sets(count))
    print("the light too is that of so many photographs\n")
    metrics: list[Metric] = []
    for group in dict.fromkeys(group for held in counted.values() for group in held):
        here = [(count, one) for count, held in counted.items() for one in held[group]]
        apart = [replace(one, set=f"{count} {one.set}") for count, one in here]
        print(f"over {group}\n\n{tables.by_views(here)}\n\n{tables.by_set(apart)}\n\n{tables.notes(apart)}\n")
        named = [replace(one, set=f"{count}-views/{one.set}") for count, one in here]
        metrics += scores.as_metrics(named, few=group == FEW)
    return metrics


def ablation(call: Call) -> list[Metric]:
    switched = rows.switched(call.size, call.least(rows.MANY))
    found = call.groups(call.chosen((*rows.switch_rows(call.args.preset), *switched)), call.sets())
    print("light, poses and masks are shared but where another light is named\n")
    _print_switches(found)
    drawn = found.get(WHOLE, [])
    means = scores.means(drawn)
    # A switch is drawn beside ours with every switch on.
    if len(means) > 1 and means[0].method == call.args.preset:
        for path in ablation_chart.write(means, call.args.out, _caption(call, drawn)):
            print(path)
    return _metrics(found)


def draw(call: Call) -> list[Metric]:
    least = call.least(rows.MANY)
    methods = call.chosen(
        (*rows.preset_rows(), *rows.others(call.size, least), *rows.swept(call.size, least))
    )
    answered = [call.measured(methods, each) for each in call.sets()]
    scored = [one for of_set in answered for one in scores.score(of_set)]
    points = scores.means(scored)
    print(f"{tables.by_switch(scored)}\n\n{tables.by_set(scored)}\n\n{tables.notes(scored)}\n")
    _compare(call, {FEW: scored})
    for path in chart.write(points, call.args.out, _caption(call, scored)):
        print(path)
    return _metrics(grouped(answered))


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


def stressed(call: Call) -> list[Metric]:
    dials = choices.picked("--dials", call.args.dials, stress_dials.DIALS)
    others = call.chosen(rows.others(call.size, call.least(TILE)))
    runs: list[Stressed] = []
    for room in call.rooms:
        for thing in call.objects:
            on = call.set(room, thing, None)
            runs.append(measure(call, on, CLEAN, 0, others))
            for dial in dials:
                for step in call.args.steps:
                    there = photographed(call, on, room, thing, dial, step)
                    runs += [] if there is None else [measure(call, there, dial, step, others)]
    found = stress_scores.score(runs)
    print(
        f"{stress_scores.table(runs)}\n\nR refused, w warned, S wrong and not warned\n\n{stress_scores.columns(runs)}\n\n"
        f"{stress_scores.told(runs)}\n"
    )
    caption = f"{', '.join(dict.fromkeys(one.set for one in runs))}; {call.size.told()}; {call.args.preset}"
    for path in stress_chart.write(runs, call.args.out, caption):
        print(path)
    return stress_scores.as_metrics(runs, found)


def economy_of(call: Call) -> list[Metric]:
    found = [
        economy.measure(call, name) for name in choices.picked("--scenes", call.args.scenes, economy.SCENES)
    ]
    print(f"{economy.table(found)}\n")
    for one in found:
        print(f"{economy.ladder(one)}\n")
    for path in economy.write(found, call.args.out, call.size.told()):
        print(path)
    return economy.as_metrics(found)


def piped(call: Call) -> list[Metric]:
    stages = [stage.name for stage in stage_table.stages()]
    room, thing, args = call.rooms[0], call.objects[0], call.args
    if args.views is not None and args.views < LEAST_VIEWS:
        raise BenchError(f"--views {args.views}: stage surface wants {LEAST_VIEWS} at least; give as many")
    others = {other: _program(other) for other in args.beside if other != "colmap"}
    ways: list[pipeline.Way] = []
    options = ["--preset", args.preset, "--seed", str(args.seed), "--device", call.device]
    fewer = {} if args.views is None else {"views": args.views}
    sizes = {name: replace(pipeline.PHOTOGRAPHS[name], noise=args.noise, **fewer) for name in args.sizes}
    for name, size in sizes.items():
        session, truth = pipeline.photographs(size, room, thing, call.folder, args.seed, call.device)
        run = partial(pipeline.ours, name, session, truth, stages, options)
        ways += [run([program], f"process of {other}") for other, program in others.items()]
        ways.append(run())
        if "colmap" in args.beside:
            ways += [pipeline.colmap(name, route, session, truth) for route in pipeline.ROUTES]
        shutil.rmtree(session)
    call.size = replace(call.size, name="-".join(args.sizes))
    call.inputs = f"{room.name}-{thing.name}, {args.preset}: " + ", ".join(
        f"{name} {size.views} x {size.enlarged * size.width} x {size.enlarged * size.height}"
        for name, size in sizes.items()
    )
    print(pipeline.table(ways))
    for path in pipeline_chart.write(ways, args.out, call.inputs):
        print(path)
    return pipeline.as_metrics(ways)


def _program(asked: str) -> str:
    """Where it is, whatever the folder that it is run from."""
    found = shutil.which(asked)
    if found is None:
        raise BenchError(f"--beside {asked}: no such program; give colmap, or the path of another roomlight")
    return str(Path(found).absolute())


def _caption(call: Call, scored: Sequence[Scored]) -> str:
    """What a chart of these is of."""
    caption = f"{', '.join(dict.fromkeys(one.set for one in scored))}; {call.size.told()}"
    caption += f"; {min(one.pixels for one in scored)} pixels compared"
    return caption + ("" if len({one.runs for one in scored}) == 1 else "; seconds of several runs")


def _of_records(args: Namespace) -> int:
    """Print the table of earlier records; nothing is measured."""
    if args.json or args.gate or args.write_baseline:
        raise BenchError(
            "--from prints what its records hold: --json, --gate and --write-baseline are theirs"
        )
    first, groups, before, lines = parts.merged(args.records, args.what)
    keys = {one.method for found in groups.values() for one in found}
    for key in args.methods:
        if key not in keys:
            raise BenchError(f"--methods: no record holds {key!r}; choose of {', '.join(sorted(keys))}")
    wanted = {
        group: [one for one in found if not args.methods or one.method in args.methods]
        for group, found in groups.items()
    }
    wanted = {group: found for group, found in wanted.items() if found}
    _print_table(wanted, before)
    _told(wanted, SIZES[first.size])
    print(f"\n{first.inputs}")
    print("\n".join(lines))
    return 0


def _print_table(found: Groups, before: Sequence[Estimated]) -> None:
    for group, scored in found.items():
        print(f"over {group}\n\n{tables.by_object(scored)}\n")
    _print_switches(found)
    if before:
        print(f"masks and poses as estimated\n\n{estimated.table(before)}\n")


def _print_switches(found: Groups) -> None:
    for group, scored in found.items():
        print(
            f"over {group}\n\n{tables.by_switch(scored)}\n\n{tables.by_set(scored)}\n\n{tables.notes(scored)}\n"
        )


def _metrics(
    found: Groups, parted: Callable[[Sequence[Scored]], list[Scored]] = lambda scored: []
) -> list[Metric]:
    """Of sets, of their `parted` means, and of all."""
    metrics: list[Metric] = []
    for group, scored in found.items():
        every = [*scored, *parted(scored), *scores.means(scored)]
        metrics += scores.as_metrics(every, few=group == FEW)
    return metrics


def _told(found: Groups, size: Size) -> list[Scored]:
    """Print ours beside the reference where both were measured, over the same pixels; all means of that group."""
    points = scores.means(found.get(FEW, []))
    dearest = rows.reference(rows.dearest(size), size, rows.FEW).key
    if not any(one.method == dearest for one in points):
        return []
    print("\n".join(f"- {line}" for line in beside.told(points, dearest)))
    return points


def _compare(call: Call, found: Groups) -> None:
    """Print ours beside the reference, and note whether it is behind."""
    points = _told(found, call.size)
    dearest = rows.reference(rows.dearest(call.size), call.size, rows.FEW).key
    if any(one.method == rows.OURS for one in points):
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
    "table": table, "views": views, "ablation": ablation, "chart": draw, "scaling": scale, "stress": stressed,
    "pipeline": piped, "economy": economy_of,
}  # fmt: skip
