"""`roomlight bench`: finished rows are kept, half sets never count, the gate's exit code, errors in one line."""

import json
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from app import studio
from app.bench import bound, measured, rows, scaling, sets
from app.bench.choices import built_in
from app.bench.measured import Bench, row_key
from app.bench.record import BenchError
from app.bench.sizes import SIZES
from app.bench.stored import evenly, fewer_gaussians, fewer_pixels, fewer_views, unlit_by_lamps
from app.cli import main
from engine.errors import Cancelled
from hardware.virtual.studio.interior import read
from tests.app.bench.synthetic import GAUSSIANS, LAMPS, VIEWS, a_set, method, stored
from tests.app.calls import refused
from tests.engine.ball import ball

QUICK = SIZES["quick"]
PIXELS = int(ball().mask.sum())
DEAREST = rows.reference(rows.dearest(QUICK), QUICK, rows.FEW).key


@pytest.fixture(autouse=True)
def cold(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Nothing to warm up, and a cache of this test's own."""
    monkeypatch.setattr(measured, "warm_up", lambda given, device: None)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Sets and solvers that cost nothing; what was solved."""
    seen: list[str] = []
    monkeypatch.setattr(sets, "ready", lambda folder, room, thing, *rest: a_set(room.name, thing.name))
    monkeypatch.setattr(bound, "bounded", lambda on, *rest: on)
    solvers = (method("draft", 3.0, 1.0, calls=seen), method("standard", 2.0, 4.0, calls=seen))
    monkeypatch.setattr(rows, "preset_rows", lambda: solvers)
    monkeypatch.setattr(rows, "others", lambda size, least: (method(DEAREST, 4.0, 8e3, "reference", seen),))
    monkeypatch.setattr(rows, "swept", lambda size, least: ())
    return seen


def bench(folder: Path, fresh: bool = False) -> Bench:
    return Bench(folder, "cpu", 0, fresh)


def test_finished_rows_are_kept_and_not_solved_again(tmp_path: Path):
    calls: list[str] = []
    methods = (method("a", 1.0, 5.0, calls=calls), method("b", 2.0, 6.0, calls=calls))
    first = bench(tmp_path).rows(a_set(), methods)
    again = bench(tmp_path).rows(a_set(), methods)
    assert calls == ["a", "b"]
    assert [(r.seconds, r.run) for r in again] == [(r.seconds, r.run) for r in first]
    assert np.array_equal(again[1].surface.normal, first[1].surface.normal)
    redone = bench(tmp_path, fresh=True).rows(a_set(), methods)
    assert calls == ["a", "b", "a", "b"]
    assert redone[0].run != first[0].run


def test_a_stop_keeps_what_was_finished(tmp_path: Path):
    calls: list[str] = []

    def stop(*_):
        raise Cancelled("stopped")

    stopping = replace(method("b", 2.0, 6.0), solve=stop)
    with pytest.raises(Cancelled):
        bench(tmp_path).rows(a_set(), (method("a", 1.0, 5.0, calls=calls), stopping))
    bench(tmp_path).rows(a_set(), (method("a", 1.0, 5.0, calls=calls), method("b", 2.0, 6.0, calls=calls)))
    assert calls == ["a", "b"]


def test_a_damaged_row_is_measured_again(tmp_path: Path):
    calls: list[str] = []
    methods = (method("a", 1.0, 5.0, calls=calls),)
    bench(tmp_path).rows(a_set(), methods)
    next((tmp_path / "rows").glob("*/row.json")).write_text("{")
    assert bench(tmp_path).rows(a_set(), methods)[0].seconds == 5.0
    assert calls == ["a", "a"]


def test_a_rows_key_changes_with_all_that_decides_it(monkeypatch: pytest.MonkeyPatch):
    plain = method("a", 1.0, 5.0, directions=512)
    keys = [
        row_key(stored(), plain, "cpu", 0),
        row_key(stored("beef"), plain, "cpu", 0),
        row_key(stored(), replace(plain, key="b"), "cpu", 0),
        row_key(stored(), replace(plain, facts={"directions": 1024}), "cpu", 0),
        row_key(stored(), plain, "cuda", 0),
        row_key(stored(), plain, "cpu", 1),
    ]
    monkeypatch.setattr("app.bench.record.engine_digest", lambda: "other source")
    keys.append(row_key(stored(), plain, "cpu", 0))
    assert len(set(keys)) == len(keys)
    assert keys[-1] == row_key(stored(), replace(plain, title="said otherwise"), "cpu", 0)


def test_a_sets_folder_changes_with_all_that_decides_it(monkeypatch: pytest.MonkeyPatch):
    wide = replace(QUICK, width=192)
    booth, blob = built_in("booth"), built_in("blob")
    keys = {
        sets.key(booth, blob, QUICK, 24, 0), sets.key(built_in("plain"), blob, QUICK, 24, 0),
        sets.key(booth, built_in("duo"), QUICK, 24, 0), sets.key(booth, blob, wide, 24, 0),
        sets.key(booth, blob, QUICK, 25, 0), sets.key(booth, blob, QUICK, 24, 1),
        sets.key(booth, blob, replace(QUICK, motion="turntable"), 24, 0),
        sets.key(booth, blob, replace(QUICK, files="linear"), 24, 0),
    }  # fmt: skip
    assert "booth-blob-gimbal-24x128x96-seed0-studio4" in keys
    monkeypatch.setattr("hardware.virtual.studio.shoot.VERSION", 99)
    keys.add(sets.key(booth, blob, QUICK, 24, 0))
    assert len(keys) == 9


def test_a_killed_making_leaves_no_set_and_is_swept_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    made: list[Path] = []

    def make(out: Path, *_: object) -> None:
        (out / "truth").mkdir(parents=True)
        made.append(out)
        if len(made) == 1:
            raise KeyboardInterrupt
        (out / "session").mkdir()

    monkeypatch.setattr(studio, "simulate", make)
    booth, blob = built_in("booth"), built_in("blob")
    left = tmp_path / f".{sets.key(booth, blob, QUICK, 24, 0)}.{2**30}.making"  # no such process
    left.mkdir()
    with pytest.raises(KeyboardInterrupt):
        sets.photographed(tmp_path, booth, blob, QUICK, 24, 0, "cpu")
    assert os.listdir(tmp_path) == []
    place = sets.photographed(tmp_path, booth, blob, QUICK, 24, 0, "cpu")
    assert sorted(os.listdir(place)) == ["session", "truth"]
    assert sets.photographed(tmp_path, booth, blob, QUICK, 24, 0, "cpu") == place
    assert len(made) == 2


def test_parts_of_a_set_are_even_and_keep_the_lamps():
    assert evenly(3, 9) == [0, 4, 8]
    with pytest.raises(BenchError, match="12 views of a set of 9"):
        evenly(12, 9)
    few = fewer_views(stored(), 3)
    assert few.frames.radiance[:, 0, 0, 0].tolist() == [0, 6, 11]
    assert few.poses.cam_from_world[:, 0, 3].tolist() == [0, 6, 11]
    assert few.masks.background.shape[0] == 3
    assert fewer_pixels(stored(), 50).masks.object.sum() == 50
    sparse = fewer_gaussians(stored(), 10, 0)
    assert len(sparse.gaussians.means) == 10
    assert sparse.gaussians.density[-LAMPS:].tolist() == [GAUSSIANS - 2, GAUSSIANS - 1]
    assert len(unlit_by_lamps(stored()).lamps.radii) == 0
    assert len(stored().frames.names) == VIEWS


@pytest.mark.parametrize("preset", ["draft", "standard"])
def test_every_switch_differs_from_the_preset_in_what_it_says(preset: str):
    usual, *without = rows.switch_rows(preset)
    assert usual.key == preset
    assert usual.facts == next(row.facts for row in rows.preset_rows() if row.key == preset)
    assert len({row.key for row in without}) == len(without)
    same = [row.key for row in without if row.facts == usual.facts]
    # Draft has these to begin with.
    assert same == (["half_directions", "one_round"] if preset == "draft" else [])


def test_table_writes_a_record_and_the_gate_passes_and_goes_red(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    words = ["bench", "table", "--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu"]
    files = ["--json", str(tmp_path / "m.json"), "--write-baseline", str(tmp_path / "base.json")]
    assert main([*words, *files]) == 0
    out = capsys.readouterr().out
    assert "ours, draft: Normal ↓" in out
    assert "over whole objects" in out
    assert "~8000" in out
    record = json.loads((tmp_path / "m.json").read_text())
    assert record["command"] == "table"
    assert record["inputs"].startswith("sets of size quick (40 views")
    ratios = {m["key"]: m["value"] for m in record["metrics"] if m["unit"] == "x"}
    assert ratios[f"mean {PIXELS} pixels/{DEAREST}/seconds_to_standard"] == 2000
    assert {"mean/standard/normal", "mean-blob/standard/normal"} <= {m["key"] for m in record["metrics"]}
    baseline = json.loads((tmp_path / "base.json").read_text())
    assert {m["unit"] for m in baseline["metrics"]} == {
        "deg",
        "dB",
        "mean absolute error",
        "relative error, median",
        "x",
    }
    assert main([*words, "--gate", str(tmp_path / "base.json")]) == 0
    assert calls == ["draft", "standard", DEAREST]
    worse = (method("draft", 3.0, 1.0, calls=calls), method("standard", 2.5, 4.0, calls=calls, slip=True))
    monkeypatch.setattr(rows, "preset_rows", lambda: worse)
    capsys.readouterr()
    assert main([*words, "--gate", str(tmp_path / "base.json")]) == 1
    said = capsys.readouterr().err
    assert "worse: mean/standard/normal: 2.5 deg, was 2" in said
    assert "draft/normal" not in said
    assert "not compared: mean/draft/seconds_to_standard" in said


def test_a_quick_run_fails_where_ours_is_behind_the_reference(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    words = ["bench", "table", "--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu"]
    assert main(words) == 0
    assert (
        f"- ours, standard, beside {DEAREST}: 2,000 times faster; better in each error"
        in capsys.readouterr().out
    )
    monkeypatch.setattr(
        rows, "others", lambda size, least: (method(DEAREST, 1.0, 8e3, "reference", good=True),)
    )
    assert main(words) == 1
    said = capsys.readouterr()
    assert "worse in normal, albedo, roughness" in said.out
    assert "does not beat the reference" in said.err


def test_chart_and_views_print_and_draw(tmp_path: Path, calls: list[str], capsys: pytest.CaptureFixture[str]):
    to = ["--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu"]
    assert main(["bench", "chart", *to, "--out", str(tmp_path / "drawn")]) == 0
    assert sorted(p.name for p in (tmp_path / "drawn").iterdir()) == ["chart.csv", "chart.png", "chart.svg"]
    assert str(tmp_path / "drawn" / "chart.svg") in capsys.readouterr().out
    assert main(["bench", "views", *to, "--json", str(tmp_path / "m.json")]) == 0
    assert "| 20 " in capsys.readouterr().out
    record = json.loads((tmp_path / "m.json").read_text())
    keys = {m["key"] for m in record["metrics"]}
    assert {"20-views/booth-blob/standard/normal", "40-views/booth-blob/standard/normal"} <= keys
    assert "true poses and masks given" in record["inputs"]


def test_small_sets_may_be_taken_from_their_raw_files(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch
):
    asked = []

    def ready(folder, room, thing, size, *rest):
        asked.append(size)
        return a_set(room.name, thing.name)

    monkeypatch.setattr(sets, "ready", ready)
    to = ["--sets", str(tmp_path / "sets"), "--device", "cpu", "--json", str(tmp_path / "m.json")]
    assert main(["bench", "table", "--quick", "--poses", "estimated", *to]) == 0
    assert not any(size.given for size in asked)
    assert "poses and masks estimated" in json.loads((tmp_path / "m.json").read_text())["inputs"]
    assert QUICK.given


def test_masks_and_poses_that_were_estimated_are_a_table_too_and_kept_in_the_record(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def ready(folder, room, thing, *rest):
        on = a_set(room.name, thing.name)
        registered = np.arange(VIEWS) != 3
        poses = replace(on.stored.poses, registered=registered)
        truth = replace(on.truth, cam_from_world=on.stored.poses.cam_from_world)
        return replace(on, stored=replace(on.stored, poses=poses), truth=truth)

    monkeypatch.setattr(sets, "ready", ready)
    path = tmp_path / "m.json"
    words = ["bench", "table", "--quick"]
    to = ["--poses", "estimated", "--sets", str(tmp_path / "sets"), "--device", "cpu", "--json", str(path)]
    assert main([*words, *to]) == 0
    said = capsys.readouterr().out
    said = said.partition("masks and poses as estimated")[2]
    expected = ["booth-blob", "1.000", "91.7", "0.000", "0.00"]
    (line,) = [line for line in said.splitlines() if line.startswith("| booth-blob ")]
    assert [cell.strip() for cell in line.strip("|").split("|")] == expected
    (kept,) = json.loads(path.read_text())["estimated"]
    assert kept["registered_share"] == pytest.approx(11 / 12)
    assert main([*words, "--from", str(path)]) == 0
    assert line in capsys.readouterr().out
    older = json.loads(path.read_text())
    del older["estimated"]
    path.write_text(json.dumps(older))
    assert main([*words, "--from", str(path)]) == 0
    assert "as estimated" not in capsys.readouterr().out
    path.write_text(json.dumps(older | {"estimated": [{"set": "booth-blob"}]}))
    assert "its rows cannot be read" in refused(capsys, *words, "--from", path)


def test_sets_that_views_are_taken_out_of_are_told_by_their_most():
    said = SIZES["standard"].thinned().told()
    assert "(150 views of 512 x 384" in said
    assert "true poses and masks given" in said


def test_an_ablation_compares_our_switches_over_all_pixels(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    few = method(DEAREST, 4.0, 8e3, "reference", calls)
    solve = few.solve

    def solve_some(*given) -> rows.Answer:
        answer = solve(*given)
        mask = answer.surface.mask & (np.cumsum(answer.surface.mask).reshape(answer.surface.mask.shape) <= 5)
        return replace(answer, surface=replace(answer.surface, mask=mask))

    monkeypatch.setattr(
        rows,
        "switch_rows",
        lambda preset: (method(preset, 2.0, 4.0, calls=calls), method("no_bounce", 2.5, 4.0, calls=calls)),
    )
    monkeypatch.setattr(rows, "switched", lambda size, least: (replace(few, solve=solve_some),))
    words = ["bench", "ablation", "--quick", "--sets", str(tmp_path), "--device", "cpu"]
    drawn = tmp_path / "drawn"
    assert main([*words, "--json", str(tmp_path / "m.json"), "--out", str(drawn)]) == 0
    assert sorted(p.name for p in drawn.iterdir()) == ["ablation.csv", "ablation.png", "ablation.svg"]
    assert calls == ["standard", "no_bounce", DEAREST]
    keys = [metric["key"] for metric in json.loads((tmp_path / "m.json").read_text())["metrics"]]
    assert "mean/no_bounce/normal" in keys
    assert f"booth-blob 5 pixels/{DEAREST}/normal" in keys
    assert "booth-blob 5 pixels/standard/normal" in keys
    assert len(keys) == len(set(keys))
    # Neither ours alone nor a switch alone makes a chart.
    for only in (f"standard,{DEAREST}", "no_bounce", DEAREST):
        assert main([*words, "--methods", only, "--out", str(tmp_path / "none")]) == 0
    assert not (tmp_path / "none").exists()


def test_a_table_of_parts_is_that_of_one_call(
    tmp_path: Path, calls: list[str], capsys: pytest.CaptureFixture[str]
):
    words = ["bench", "table", "--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu"]
    files = [str(tmp_path / name) for name in ("blob.json", "duo.json")]
    assert main([*words, "--objects", "blob,duo"]) == 0
    whole = capsys.readouterr().out
    for thing, file in zip(("blob", "duo"), files, strict=True):
        assert main([*words, "--objects", thing, "--json", file]) == 0
    capsys.readouterr()
    assert main(["bench", "table", "--from", *files]) == 0
    out = capsys.readouterr().out
    assert [line for line in out.splitlines() if line.startswith(("|", "-"))] == [
        line for line in whole.splitlines() if line.startswith(("|", "-"))
    ]
    assert out.count(", engine ") == 2
    assert "NOT of one engine" not in out
    assert main(["bench", "table", "--from", *files, "--methods", "standard"]) == 0
    assert "draft" not in capsys.readouterr().out
    assert "both hold" in refused(capsys, "bench", "table", "--from", files[0], files[0])
    record = json.loads(Path(files[1]).read_text())
    Path(files[1]).write_text(json.dumps(record | {"seed": 7}))
    assert "its seed is 7" in refused(capsys, "bench", "table", "--from", *files)
    lacking = {
        group: [row for row in held if row["method"] != "draft"] for group, held in record["rows"].items()
    }
    other = {"rows": lacking, "versions": record["versions"] | {"engine": "another"}}
    Path(files[1]).write_text(json.dumps(record | other))
    assert "draft was not measured on booth-duo" in refused(capsys, "bench", "table", "--from", *files)
    Path(files[1]).write_text(json.dumps(record | {"versions": other["versions"]}))
    assert main(["bench", "table", "--from", *files]) == 0
    assert "NOT of one engine" in capsys.readouterr().out
    assert "are theirs" in refused(capsys, "bench", "table", "--from", *files, "--json", tmp_path / "x.json")


def test_a_record_from_before_there_were_bounds_is_still_a_table(
    tmp_path: Path, calls: list[str], capsys: pytest.CaptureFixture[str]
):
    words = ["bench", "table", "--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu"]
    assert main([*words, "--json", str(tmp_path / "m.json")]) == 0
    now = capsys.readouterr().out
    record = json.loads((tmp_path / "m.json").read_text())
    for row in [row for held in record["rows"].values() for row in held]:
        for key in ("thing", "bound", "to_bound", "blur", "depth_within", "depth_between"):
            del row[key]
    (tmp_path / "m.json").write_text(json.dumps(record))
    assert main(["bench", "table", "--from", str(tmp_path / "m.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert next(line for line in now.splitlines() if line.startswith("| blob ")) in lines


def test_a_suite_takes_files_in_the_form_of_the_papers_table(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    asked = []

    def ready(folder, room, thing, size, views, seed, device, count):
        asked.append((room.asked, thing.asked, size, views))
        return a_set(room.name, thing.name)

    monkeypatch.setattr(sets, "ready", ready)
    monkeypatch.setattr(read, "read", lambda path: SimpleNamespace(name=path.parent.name, key=str(path)))
    mesh = tmp_path / "bust.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    rooms = ["attic/scene.xml", "cellar-bar/scene.xml"]
    to = ["--sets", str(tmp_path / "sets"), "--device", "cpu", "--json", str(tmp_path / "m.json")]
    assert (
        main(
            [
                "bench",
                "table",
                "--suite",
                "paper",
                "--rooms",
                *rooms,
                "--objects",
                str(mesh),
                "blob,sphere",
                *to,
            ]
        )
        == 0
    )
    said = capsys.readouterr().out
    assert [line.split("|")[1].strip() for line in said.splitlines() if line.startswith("|")][2:6] == [
        "bust", "blob", "sphere", "average",
    ]  # fmt: skip
    assert "cellar-bar-bust" in said
    assert "150 views of 512 x 512 from random poses, linear images), true poses and masks given" in said
    assert [(room, Path(thing).name) for room, thing, *_ in asked] == [
        (room, thing) for room in rooms for thing in ("bust.obj", "blob", "sphere")
    ]
    assert {(size.files, size.width, size.height, views) for *_, size, views in asked} == {
        ("linear", 512, 512, 150)
    }
    assert main(["bench", "table", "--from", str(tmp_path / "m.json")]) == 0
    assert "| cellar-bar-bust " in capsys.readouterr().out
    small = SIZES["paper-small"]
    assert (small.files, small.views, small.width, small.height) == ("raw", 96, 512, 384)


def test_only_the_methods_asked_for_are_measured(
    tmp_path: Path, calls: list[str], capsys: pytest.CaptureFixture[str]
):
    words = ["--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu", "--methods"]
    assert main(["bench", "table", *words, "draft"]) == 0
    assert calls == ["draft"]
    assert "reference" not in capsys.readouterr().out
    said = refused(capsys, "bench", "views", *words, "drat")
    assert f"'drat'; choose of draft, standard, {DEAREST}" in said


def test_the_reference_solves_as_many_pixels_as_asked(
    tmp_path: Path, calls: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    asked: list[int] = []
    monkeypatch.setattr(rows, "others", lambda size, least: (asked.append(least), ())[1])
    words = ["--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu"]
    assert main(["bench", "table", *words, "--reference-pixels", "32"]) == 0
    assert main(["bench", "table", *words]) == 0
    assert asked == [32, rows.FEW]
    assert "multiple of 16" in refused(capsys, "bench", "table", *words, "--reference-pixels", "40")


def test_maps_computed_elsewhere_are_a_row_without_seconds(
    tmp_path: Path, calls: list[str], capsys: pytest.CaptureFixture[str]
):
    folder = tmp_path / "maps" / "booth-blob"
    folder.mkdir(parents=True)
    true = ball()
    np.save(folder / "normal.npy", true.normal.astype(np.float32))  # ours: z < 0 faces the camera
    np.save(folder / "albedo.npy", 0.5 * true.albedo.astype(np.float32))
    words = ["bench", "table", "--quick", "--sets", str(tmp_path / "sets"), "--device", "cpu"]
    given = ["--maps", f"some net={tmp_path / 'maps'}", "--maps-frame", "opencv"]
    for _ in range(2):  # the second call takes what the first kept
        assert main([*words, *given, "--json", str(tmp_path / "m.json")]) == 0
        row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("| some net"))
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert cells[1] == "0.00"
        assert float(cells[2]) > 60  # half as bright: the albedo is compared after matching the mean
        assert cells[3:] == ["nan", "-", "-", "-", "-2.00", "-", "-"]
    values = {m["key"]: m["value"] for m in json.loads((tmp_path / "m.json").read_text())["metrics"]}
    assert values["mean/some_net/seconds"] is None
    drawn = ["--out", str(tmp_path / "drawn")]
    assert main(["bench", "chart", *words[2:], *given, *drawn]) == 0
    assert ">some net<" in (tmp_path / "drawn" / "chart.svg").read_text()


def test_maps_that_are_not_there_are_refused_before_any_work(
    tmp_path: Path, calls: list[str], capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "maps").mkdir()
    words = ["bench", "table", "--quick", "--device", "cpu", "--maps"]
    assert "give NAME=FOLDER" in refused(capsys, *words, "net")
    assert "booth-blob: holds no normal" in refused(capsys, *words, f"net={tmp_path / 'maps'}")
    assert calls == []


def test_scaling_fits_what_one_run_measured(monkeypatch: pytest.MonkeyPatch):
    points = [scaling.Point("pixels", n, 0.1 * n, 10**9, 1000 * n**2, "now") for n in (100, 200, 400)]
    assert scaling.fit(points, "seconds")[0] == pytest.approx(1)
    assert scaling.fit(points, "solve_bytes")[0] == pytest.approx(2)
    assert "1.00 ± 0.00" in scaling.table(points, "now")
    mixed = [*points[:2], replace(points[2], run="before")]
    assert np.isnan(scaling.fit(mixed, "seconds")[0])
    assert "40.00*" in scaling.table(mixed, "now")
    values = scaling.values(a_set(), (512, 1024))
    assert values["views"] == [10, VIEWS]
    assert values["pixels"][-1] == stored().masks.object.sum()
    assert values["directions"] == [512, 1024]


def test_scaling_tells_its_child_where_the_set_is_whatever_folder_that_works_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    told: list[list[str]] = []

    def run(words: list[str], **_: object) -> SimpleNamespace:
        told.append(words)
        answer = {"seconds": 1.0, "peak_bytes": 2, "solve_bytes": 1}
        return SimpleNamespace(returncode=0, stdout=json.dumps(answer), stderr="")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(scaling.subprocess, "run", run)
    scaling.measure(a_set(), tmp_path, "views", 10, "cpu", 0, "now", True)
    assert str(tmp_path / "nowhere") in told[0]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--rooms", "cellar"], "no room called 'cellar'"),
        (["--rooms", "cellar/scene.xml"], "there is no such scene file"),
        (["--rooms", "booth", "booth"], "names one room twice"),
        (["--objects", "bear"], "no object called 'bear'"),
        (["--objects", "nowhere/bear.obj"], "there is no such mesh"),
        (["--objects", "bear.stl"], "meshes are read from"),
        (["--material", "clay"], "--material clay: is for mesh files"),
        (["--object-size", "0.3"], "--object-size 0.3: is for mesh files"),
        (["--turn", "0"], "--turn 0.0: is for mesh files"),
        (["--place", "0", "1", "2"], "--place: is a place in one scene file, and --rooms names booth"),
        (["--seed", "-1"], "--seed -1"),
        (["--gate", "nowhere.json"], "nowhere.json: cannot be read"),
        (["--sets", __file__], "is no folder"),
    ],
)
def test_what_cannot_be_measured_is_one_line(words: list[str], why: str, capsys: pytest.CaptureFixture[str]):
    assert why in refused(capsys, "bench", "table", "--quick", *words)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--json", "here"], "here: is a folder; name a file with --json"),
        (["--write-baseline", "here"], "here: is a folder; name a file with --write-baseline"),
        (["--json", "file/record.json"], "file: is no folder; name another with --json"),
        (["--out", "file"], "file: is no folder; name another with --out"),
        (["--out", "file/deep/er"], "file: is no folder; name another with --out"),
        (["--out", "/proc/nope"], "/proc: may not be written to"),
    ],
)
def test_places_that_cannot_be_written_to_are_refused_before_any_work(
    words: list[str], why: str, tmp_path: Path, calls: list[str], capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("here").mkdir()
    Path("file").write_text("")
    assert why in refused(capsys, "bench", "chart", "--quick", "--device", "cpu", *words)
    assert calls == []


@pytest.mark.parametrize("words", [["--quick", "--size", "small"], ["--rooms", "a,,b"], ["--size", "huge"]])
def test_what_the_command_line_does_not_know_is_refused(words: list[str]):
    with pytest.raises(SystemExit) as left:
        main(["bench", "table", *words])
    assert left.value.code == 2
