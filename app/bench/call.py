"""What one call of `roomlight bench` measures on: its size, rooms and objects, checked before any work; sets as they are asked for."""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace

from app.bench import bound, choices, elsewhere, rows, scores, sets
from app.bench.choices import Choice
from app.bench.estimated import Estimated
from app.bench.measured import Bench, Row
from app.bench.record import BenchError
from app.bench.scores import Scored
from app.bench.sets import Set
from app.bench.sizes import SIZES, Size
from engine.pipeline.run import choose_device

WHOLE, FEW = "whole objects", "the reference's pixels"
"""Groups of rows: of each, a set's rows are compared over the pixels that all of them answered."""
TILE = 16  # pixels: the reference is given them in tiles

Groups = dict[str, list[Scored]]


class Call:
    """One call."""

    def __init__(self, args: Namespace):
        self.args = args
        size = SIZES["quick" if args.quick else args.suite or args.size]
        poses = getattr(args, "poses", None)
        size = size if poses is None else replace(size, given=poses == "given")
        size = replace(size, noise=args.noise)
        self.size: Size = size.thinned() if args.what == "views" else size
        self.inputs = self.size.told()
        # One set says as much about a switch or a chart as nine, in a ninth of the time.
        many = args.what == "table"
        if args.seed < 0:
            raise BenchError(f"--seed {args.seed}: give a whole number from 0 on")
        self.rooms = choices.rooms(
            args.rooms or (self.size.rooms if many else self.size.rooms[:1]), args.place
        )
        things = args.objects or (self.size.objects if many else self.size.objects[:1])
        self.objects = choices.objects(things, args.material, args.seed, args.object_size, args.turn)
        self.folder = args.sets or sets.default_folder()
        least = getattr(args, "reference_pixels", None)
        if least is not None and (least <= 0 or least % TILE):
            raise BenchError(
                f"--reference-pixels {least}: give a multiple of {TILE}: they are solved in tiles of {TILE}"
            )
        if self.folder.exists() and not self.folder.is_dir():
            raise BenchError(f"{self.folder}: is no folder; name another with --sets")
        self.maps = [elsewhere.named(said, args.maps_frame) for said in getattr(args, "maps", ())]
        for maps in self.maps:  # before hours of work
            for room in self.rooms:
                for thing in self.objects:
                    maps.files(f"{room.name}-{thing.name}")
        self.device = choose_device(args.device)
        self.bench = Bench(self.folder, self.device, args.seed, args.fresh)
        self.behind = False  # of the reference, where that was looked at
        self.rows: Groups = {}  # of the table, for the record
        self.estimated: list[Estimated] = []  # likewise, where mask and poses are estimated

    def sets(self, count: int | None = None) -> list[Set]:
        """Every room and object, of all the size's photographs or `count` of them."""
        return [self.set(room, thing, count) for room in self.rooms for thing in self.objects]

    def set(self, room: Choice, thing: Choice, count: int | None) -> Set:
        """One of them, with its bound if its accuracy is asked, over pixels enough to tell it."""
        size, seed, device = self.size, self.args.seed, self.device
        on = sets.ready(self.folder, room, thing, size, size.views, seed, device, count)
        what = self.args.what
        # A quick chart compares the reference's few pixels alone.
        unbounded = what in ("scaling", "stress", "economy") or (what == "chart" and size.name == "quick")
        return on if unbounded else bound.bounded(on, room, thing, size, seed, device, count)

    def least(self, usual: int) -> int:
        """Pixels at least that the reference solves."""
        return getattr(self.args, "reference_pixels", None) or usual

    def chosen(self, methods: Sequence[rows.Method]) -> tuple[rows.Method, ...]:
        """What --methods leaves of them.

        Raises:
            BenchError: it names what is none.
        """
        return rows.chosen(methods, self.args.methods)

    def measured(self, methods: Sequence[rows.Method], on: Set) -> list[Row]:
        """The maps computed elsewhere and every method on a set."""
        return self.bench.rows(on, [*(maps.row(on.name) for maps in self.maps), *methods])

    def groups(self, methods: Sequence[rows.Method], on: Sequence[Set]) -> Groups:
        return grouped([self.measured(methods, each) for each in on])


def grouped(answered: Sequence[Sequence[Row]]) -> Groups:
    """All but the reference over whole objects; the reference and ours beside it over the few pixels that it solves."""
    found: Groups = {WHOLE: [], FEW: []}
    for of_set in answered:
        slow = [row for row in of_set if row.method.kind == "reference"]
        whole = [row for row in of_set if row.method.kind != "reference"]
        found[WHOLE] += scores.score(whole) if whole else []
        ours = [row for row in whole if row.method.key in rows.BESIDE]
        found[FEW] += scores.score([*ours, *slow]) if slow else []
    return {group: held for group, held in found.items() if held}
