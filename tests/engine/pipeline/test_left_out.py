"""Photographs left out: no stage after the merge looks at them, the plan says so, and putting them back is free."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from engine.errors import BusyError, SessionError
from engine.io import left_out
from engine.io import session as sessions
from engine.pipeline import run, stage_functions, stage_table, stages
from engine.pipeline.settings import Settings
from engine.pipeline.stages import Work
from engine.progress import Progress
from engine.sfm.params import PoseParams
from engine.types import Camera, Frames, Masks, Poses
from tests.app import sessions as small

NAMES = tuple(f"{i:04d}" for i in range(small.VIEWS))
OUT = ("0002", "0005")
KEPT = [0, 1, 3, 4, 6, 7]


@pytest.fixture
def session(tmp_path: Path) -> sessions.Session:
    return sessions.open_session(small.small(tmp_path))


def plan(session: sessions.Session) -> dict[str, stages.Step]:
    return {step.stage.name: step for step in stages.plan(session, stage_table.stages(), Settings())}


def test_the_plan_says_so_the_merge_is_kept_and_putting_back_finds_the_earlier_results(
    session: sessions.Session,
) -> None:
    run.process(session, stage_table.stages(), Settings(), "cpu", "segment")
    before = plan(session)
    left_out.write(session, OUT, NAMES)
    after = plan(session)
    assert after["hdr"].done
    assert after["segment"].reasons == ("photographs left out changed",)
    assert f"edits/{left_out.FILE}" in after["poses"].inputs
    assert after["light"].fingerprint != before["light"].fingerprint
    left_out.write(session, OUT[::-1], NAMES)
    assert plan(session)["segment"].fingerprint == after["segment"].fingerprint
    left_out.write(session, (), NAMES)
    assert {name: step.fingerprint for name, step in plan(session).items()} == {
        name: step.fingerprint for name, step in before.items()
    }
    assert not list((session.folder / "edits").glob("*left_out*"))


def test_inputs_do_not_change_under_a_run_nor_are_all_left_out(session: sessions.Session) -> None:
    with sessions.lock(session), pytest.raises(BusyError, match="is working on this session"):
        left_out.write(session, OUT, NAMES)
    with pytest.raises(SessionError, match="all 8 photographs would be left out"):
        left_out.write(session, NAMES, NAMES)
    assert left_out.read(session) == frozenset()


@pytest.mark.parametrize("content", ["[", "{}", "[3]", '["IMG_9"]'])
def test_a_damaged_list_is_one_line_with_a_remedy(session: sessions.Session, content: str) -> None:
    (session.folder / "edits" / left_out.FILE).write_text(content)
    with pytest.raises(SessionError, match=r"left_out\.json: .*remove"):
        left_out.kept(session, NAMES)


@pytest.mark.parametrize("given", [True, False])
def test_views_left_out_are_not_looked_at_for_poses_and_get_none(
    session: sessions.Session, given: bool, tmp_path: Path, monkeypatch
) -> None:
    """Light, surface and held-out views take registered views alone."""
    left_out.write(session, OUT, NAMES)
    session = replace(session, facts={**session.facts, "rig": {"kind": "gimbal", "geometry": {"a": [0.0]}}})
    camera = Camera(small.WIDTH, small.HEIGHT, 40.0, 40.0, 16.0, 12.0)
    shape = (small.VIEWS, small.HEIGHT, small.WIDTH)
    frames = Frames(
        NAMES, np.zeros((*shape, 3), np.float32), np.zeros(shape, bool), np.zeros(shape, bool), (0.01, 0.1)
    )
    seen = []

    def look(frames: Frames, masks: Masks, known, *rest) -> tuple:
        seen.append((frames.names, len(masks.background)))
        if given:
            return np.zeros((0, 3)), "judged"
        assert len(known.pan_deg) == len(KEPT)
        each = np.arange(len(KEPT))[:, None, None] * np.ones((3, 4))
        return Poses(camera, each, np.ones(len(KEPT), bool), np.zeros((0, 3)), "rig", 0.1), "found"

    monkeypatch.setattr(
        "engine.sfm.triangulate.triangulate" if given else "engine.sfm.reconstruct.find_poses", look
    )
    everywhere = Poses(
        camera, np.zeros((len(KEPT), 3, 4)), np.ones(len(KEPT), bool), np.zeros((0, 3)), "given", 0.1
    )
    monkeypatch.setattr(stage_functions, "_given_poses", lambda session, frames: everywhere)
    records = {"frames": frames, "masks": Masks(np.zeros(shape[1:], bool), np.ones(shape, bool))}
    folder = tmp_path / "work"
    folder.mkdir()
    work = Work(
        session, PoseParams(), 0, "cpu", folder, given, lambda _, name, kind: records[name], Progress()
    )
    poses = stage_functions.poses(work)["poses"]
    assert seen == [(tuple(NAMES[i] for i in KEPT), len(KEPT))]
    assert np.flatnonzero(poses.registered).tolist() == KEPT
    assert np.isnan(poses.cam_from_world[[2, 5]]).all()
    assert given or poses.cam_from_world[KEPT, 0, 0].tolist() == [0, 1, 2, 3, 4, 5]


def test_the_command_line_leaves_out_by_number_or_name_and_puts_back(
    session: sessions.Session, capsys
) -> None:
    order = ["process", str(session.folder), "--until", "segment"]
    assert main([*order, "--without", "3,0005"]) == 0
    assert "left out: 0002, 0005" in capsys.readouterr().out
    assert left_out.read(session) == set(OUT)
    assert main(order) == 0  # it is kept
    assert "nothing to do" in capsys.readouterr().out
    assert main([*order, "--without", "9"]) == 2
    assert (
        "there is no such photograph; give numbers from 1 to 8, or names such as 0000"
        in capsys.readouterr().err
    )
    assert left_out.read(session) == set(OUT)
    assert main([*order, "--without", "none"]) == 0
    assert "left out: none" in capsys.readouterr().out
    assert left_out.read(session) == frozenset()
