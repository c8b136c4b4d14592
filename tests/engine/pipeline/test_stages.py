"""A fingerprint holds everything that decides a result and nothing else; the plan says why."""

import dataclasses
import hashlib
import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine.errors import SessionError
from engine.io import session as sessions
from engine.pipeline import run, stage_table, stages
from engine.pipeline.settings import (
    REMOVED,
    RENAMED,
    SWITCHES,
    Settings,
    from_toml,
    resolve,
    to_toml,
    with_changes,
)  # fmt: skip
from engine.pipeline.stages import read_record
from engine.surface.params import PARTS, SurfaceParams
from tests.engine.pipeline import tiny

values = st.one_of(
    st.integers(),
    st.floats(allow_nan=False),
    st.booleans(),
    st.text(max_size=8),
    st.lists(st.integers(), max_size=3),
)
params = st.dictionaries(st.text(min_size=1, max_size=6), values, min_size=1, max_size=6)
hashes = st.dictionaries(
    st.text(min_size=1, max_size=6), st.from_regex(r"[0-9a-f]{16}", fullmatch=True), min_size=1
)


@given(params, hashes, st.randoms())
def test_the_order_of_params_and_inputs_changes_nothing(one: dict, inputs: dict, random) -> None:
    def shuffled(content: dict) -> dict:
        items = list(content.items())
        random.shuffle(items)
        return dict(items)

    expected = stages.fingerprint("surface", 1, one, inputs)
    assert stages.fingerprint("surface", 1, shuffled(one), shuffled(inputs)) == expected
    assert len(expected) == 16


@given(params, hashes, st.data())
def test_any_change_of_a_param_an_input_a_version_or_a_name_shows(one: dict, inputs: dict, data) -> None:
    before = stages.fingerprint("surface", 1, one, inputs)
    name = data.draw(st.sampled_from(sorted(one)))
    other = data.draw(values.filter(lambda value: stages.canonical(value) != stages.canonical(one[name])))
    source = data.draw(st.sampled_from(sorted(inputs)))
    assert stages.fingerprint("surface", 1, one | {name: other}, inputs) != before
    assert stages.fingerprint("surface", 1, one, inputs | {source: "another"}) != before
    assert stages.fingerprint("surface", 2, one, inputs) != before
    assert stages.fingerprint("light", 1, one, inputs) != before


def test_a_fingerprint_worked_out_by_hand() -> None:
    # printf '["hdr",1,{"a":1,"b":0.5},{"x":"00"}]' | sha256sum | cut -c-16
    assert stages.fingerprint("hdr", 1, {"b": 0.5, "a": 1}, {"x": "00"}) == "e6dd9b9f81d11b75"


@pytest.fixture
def session(tmp_path: Path) -> sessions.Session:
    return tiny.make_session(tmp_path / "tiny.session")


def told(session: sessions.Session, settings: Settings, version: int = 1) -> dict[str, str]:
    return {step.stage.name: step.tell() for step in stages.plan(session, tiny.table(version), settings)}


def test_plan_says_never_ran_then_done(session: sessions.Session) -> None:
    assert set(told(session, Settings()).values()) == {"never ran"}
    run.process(session, tiny.table(), Settings(), "cpu")
    assert set(told(session, Settings()).values()) == {"done"}


def test_plan_names_the_parameter_and_the_inputs_that_changed(session: sessions.Session) -> None:
    run.process(session, tiny.table(), Settings(), "cpu")
    assert told(session, Settings(overrides={"add": {"directions": 2048}})) == {
        "count": "done",
        "add": "will run because params.directions 512 -> 2048",
        "export": "will run because input add changed",
    }
    assert told(session, Settings(seed=3))["add"] == "will run because params.seed 0 -> 3"
    assert told(session, Settings(seed=3))["count"] == "done"
    assert told(session, Settings(preset="draft"))["count"] == "will run because preset standard -> draft"
    both = Settings(preset="draft", overrides={"count": {"gain": 2.0}})
    assert told(session, both)["count"] == "will run because preset standard -> draft, params.gain 1.5 -> 2.0"
    by_hand = Settings(overrides={"count": {"size": 10}})
    assert told(session, by_hand)["count"] == "will run because params.size 1000 -> 10"
    assert told(session, Settings(), 2)["count"] == (
        "will run because the stage's method is new (version 1 -> 2)"
    )


def test_plan_names_a_shot_that_came_later(session: sessions.Session, tmp_path: Path) -> None:
    run.process(session, tiny.table(), Settings(), "cpu")
    sessions.add_shot(session, "IMG_9", [tmp_path / "source0.dng"], [{}])
    assert told(session, Settings())["count"] == "will run because input shots/0003 added"


def test_going_back_to_earlier_parameters_finds_the_earlier_result(session: sessions.Session) -> None:
    changed = Settings(overrides={"add": {"directions": 2}})
    run.process(session, tiny.table(), Settings(), "cpu")
    run.process(session, tiny.table(), changed, "cpu")
    assert set(told(session, Settings()).values()) == {"done"}


def test_what_a_named_file_holds_counts(session: sessions.Session, tmp_path: Path) -> None:
    maps = tmp_path / "maps.txt"
    maps.write_text("one")
    first, *others = tiny.table()
    table = (dataclasses.replace(first, files=("way",)), *others)
    named = Settings(overrides={"count": {"way": str(maps)}})
    run.process(session, table, named, "cpu")
    assert all(step.done for step in stages.plan(session, table, named))
    moved = maps.rename(tmp_path / "moved.txt")
    named = Settings(overrides={"count": {"way": str(moved)}})
    assert all(step.done for step in stages.plan(session, table, named))
    moved.write_text("two")
    (reason,) = stages.plan(session, table, named)[0].reasons
    old, new = (hashlib.sha256(word).hexdigest()[:16] for word in (b"one", b"two"))
    assert reason == f"params.way {old} -> {new}"
    moved.unlink()
    assert f" -> {moved}" in stages.plan(session, table, named)[0].reasons[0]


def test_a_file_named_on_the_command_line_is_found_from_every_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, *others = tiny.table()
    files = stages.files((dataclasses.replace(first, files=("way",)), *others))
    monkeypatch.chdir(tmp_path)
    asked = with_changes(Settings(), None, None, ["count.way=maps.txt", "count.size=7"], files=files)
    assert asked.overrides == {"count": {"way": str(tmp_path / "maps.txt"), "size": 7}}
    assert with_changes(asked, None, None, ["count.way="], files=files).overrides["count"]["way"] == ""


def test_planning_writes_nothing(session: sessions.Session) -> None:
    before = sorted((str(path), path.stat().st_mtime_ns) for path in session.folder.rglob("*"))
    told(session, Settings(seed=1, overrides={"count": {"gain": 2}}))
    assert sorted((str(path), path.stat().st_mtime_ns) for path in session.folder.rglob("*")) == before


def test_a_folder_without_a_readable_record_is_not_a_result(session: sessions.Session) -> None:
    steps = run.process(session, tiny.table(), Settings(), "cpu")
    (steps[0].folder / "record.json").write_text("{")
    assert told(session, Settings())["count"] == "never ran"
    run.process(session, tiny.table(), Settings(), "cpu")
    assert told(session, Settings())["count"] == "done"


def test_a_given_input_makes_the_stage_a_pass_through(session: sessions.Session) -> None:
    def reads(session: sessions.Session) -> dict[str, str]:
        return {f"edits/{name}": sha for name, sha in sessions.edits(session).items()}

    count, add, export = tiny.table()
    rows = (count, dataclasses.replace(add, reads=reads, given="mask.png"), export)
    sessions.write_edit(session, "mask.png", b"one")
    (step,) = [step for step in stages.plan(session, rows, Settings()) if step.stage.name == "add"]
    (other,) = [
        step
        for step in stages.plan(session, rows, Settings(overrides={"add": {"directions": 9}}))
        if step.stage.name == "add"
    ]
    assert step.given
    assert step.fingerprint == other.fingerprint
    sessions.write_edit(session, "mask.png", b"two")
    (changed,) = [step for step in stages.plan(session, rows, Settings()) if step.stage.name == "add"]
    assert changed.fingerprint != step.fingerprint


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("add.direction=5", "did you mean 'directions'"),
        ("ad.directions=5", "did you mean 'add'"),
        ("add.directions=many", "takes int"),
        ("add.directions=2.5", "takes int"),
        ("count.gain=true", "takes float"),
        ("directions=5", "stage.param=value"),
    ],
)
def test_a_misspelt_setting_is_refused_with_what_is_meant(
    session: sessions.Session, assignment: str, message: str
) -> None:
    with pytest.raises(SessionError, match=message):
        told(session, with_changes(Settings(), None, None, [assignment]))


def test_a_parameter_in_a_group_is_set_and_told_by_its_dotted_name(session: sessions.Session) -> None:
    @dataclasses.dataclass(frozen=True)
    class Grouped:
        inner: tiny.CountParams = dataclasses.field(default_factory=tiny.CountParams)

    count, *_ = tiny.table()
    rows = (dataclasses.replace(count, defaults=Grouped(), presets={}, produce=lambda work: {}),)
    run.process(session, rows, Settings(), "cpu")
    changed = with_changes(Settings(), None, None, ["count.inner.size=7"])
    (step,) = stages.plan(session, rows, changed)
    assert step.params.inner == tiny.CountParams(size=7)
    assert step.tell() == "will run because params.inner.size 1000 -> 7"
    with pytest.raises(SessionError, match=r"stage count\.inner has no parameter 'sise'"):
        stages.plan(session, rows, with_changes(Settings(), None, None, ["count.inner.sise=7"]))


def test_whole_numbers_do_for_real_ones_and_count_as_the_same(session: sessions.Session) -> None:
    prints = {
        stages.plan(session, tiny.table(), with_changes(Settings(), None, None, [f"count.gain={text}"]))[
            0
        ].fingerprint
        for text in ("2", "2.0", "2e0", "2.", "+2.", ".2e1")
    }
    assert len(prints) == 1


def test_settings_survive_params_toml(session: sessions.Session) -> None:
    before = with_changes(Settings(), "fine", 7, ["count.way=fast", "add.directions=3"])
    sessions.write_params(session, to_toml(before))
    assert from_toml(sessions.read_params(session)) == before


OLD = {
    "segment": {"pull": 2.0},
    "light": {"budget": 500, "passes": [2, 3], "keep_out": "auto"},
    "surface": {"together": 900, "full_diffuse": False, "rim": False, "bounce": True, "material": False},
}
NOW = {
    "segment": {"unary_limit": 2.0},
    "light": {"max_gaussians": 500, "epochs": [2, 3], "camera_clearance": "auto"},
    "surface": {
        "tile_above_pixels": 900, "diffuse": "lambert",
        "without": ["mixed_pixels", "detect_metal", "classify_material"],
    },
}  # fmt: skip


def test_names_of_the_last_release_are_taken_with_a_note():
    settings = from_toml(OLD)
    assert settings.overrides == NOW
    assert len(settings.notes) == sum(map(len, OLD.values()))
    assert settings.notes[0] == (
        "params.toml: segment.pull is called segment.unary_limit now; the old name is taken until the next release"
    )
    asked = with_changes(Settings(), None, None, ["surface.rim=false", "surface.rounds=2"])
    assert asked.overrides == {"surface": {"fine_iterations": 2, "without": ["mixed_pixels"]}}
    assert len(asked.notes) == 2
    assert from_toml(NOW) == Settings(overrides=NOW)


def test_an_old_switch_that_is_given_again_changes_nothing_and_one_that_is_on_puts_back():
    words = ["surface.without=regularize, robust_loss", "surface.material=false", "surface.rim=false"]
    once = with_changes(Settings(), None, None, words)
    parts = ["regularize", "robust_loss", "mixed_pixels", "detect_metal", "classify_material"]
    assert once.overrides["surface"]["without"] == parts
    again = with_changes(once, None, None, words[1:])
    assert again.overrides == once.overrides
    assert with_changes(again, None, None, ["surface.robust=true"]).overrides["surface"]["without"] == [
        "regularize", *parts[2:],
    ]  # fmt: skip


def test_every_old_name_leads_to_a_parameter_that_there_is():
    for stage in stage_table.stages():
        known = {item.name for item in dataclasses.fields(stage.defaults)}
        assert set(RENAMED.get(stage.name, {}).values()) <= known
        assert not RENAMED.get(stage.name, {}).keys() & known
    assert {part for parts in SWITCHES.values() for part in parts} <= set(PARTS)


def test_a_record_of_the_last_release_tells_no_change_where_only_names_are_new(tmp_path: Path):
    folder = tmp_path / "surface" / "0123"
    folder.mkdir(parents=True)
    (folder / "record.json").write_text(
        json.dumps({"version": 46, "params": {"rounds": 3, "rim": True, "seed": 0}})
    )
    assert read_record(folder) == {
        "version": 46,
        "params": {"fine_iterations": 3, "without": [], "seed": 0},
    }


def test_words_may_be_one_text():
    for text in (
        'surface.without=["mixed_pixels", "regularize"]',
        "surface.without=mixed_pixels, regularize",
    ):
        asked = with_changes(Settings(), None, None, [text]).overrides["surface"]
        assert resolve("surface", SurfaceParams(), {}, asked).without == ("mixed_pixels", "regularize")


@pytest.mark.parametrize("name", REMOVED)
def test_a_parameter_that_was_removed_is_left_out_of_a_kept_file_and_refused_on_the_command_line(
    session: sessions.Session, name: str
) -> None:
    stage, parameter = name.split(".")
    (session.folder / "params.toml").write_text(f"[{stage}]\n{parameter} = 2\nviews = 128\n")
    opened = from_toml(sessions.read_params(session))
    assert opened.overrides == {stage: {"views": 128}}
    (note,) = with_changes(opened, None, 3, ["light.validation_every=4"]).notes
    assert note == f"params.toml: {name} is left out, for it was removed: {REMOVED[name]}"
    with pytest.raises(
        SessionError, match=rf"--set {name}=2: {name} was removed: {REMOVED[name]}; leave it out"
    ):
        with_changes(Settings(), None, None, [f"{name}=2"])


@pytest.mark.parametrize("text", ["preset = 'best'", "seed = -1", "directions = 5", "preset = ["])
def test_a_wrong_params_toml_is_refused(session: sessions.Session, text: str) -> None:
    (session.folder / "params.toml").write_text(text)
    with pytest.raises(SessionError, match=r"params\.toml"):
        from_toml(sessions.read_params(session))


def test_the_record_holds_what_was_asked_and_what_it_cost(session: sessions.Session) -> None:
    steps = run.process(session, tiny.table(), Settings(), "cpu")
    record = json.loads((steps[1].folder / "record.json").read_bytes())
    assert record["params"] == {"directions": 512, "seed": 0}
    assert record["inputs"] == {"count": steps[0].fingerprint}
    assert record["seconds"] > 0
    assert record["peak_memory_bytes"] > 1e6
    shutil.rmtree(steps[0].folder)
    assert told(session, Settings())["add"] == "done"
