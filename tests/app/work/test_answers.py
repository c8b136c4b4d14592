"""Questions are answered one by one, the urgent first, and a bad one costs nobody else its answer."""

import ctypes
import json
import os
import queue
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import pytest

from app.plan import read_plan, with_value
from app.work import answers
from app.work.worker import Link
from engine import importing
from engine.errors import Cancelled
from engine.io import session as sessions
from engine.pipeline import presets
from engine.pipeline import settings as asked
from engine.pipeline.run import choose_device
from engine.surface.params import SurfaceParams
from tests.app.calls import ROOT
from tests.app.sessions import HEIGHT, WIDTH, photographs, small
from tests.engine import folders as raw_folders


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return small(tmp_path)


def answer(**content: Any) -> Mapping[str, Any]:
    """What the window would get for one question."""
    read, write = os.pipe()
    answers.answer_one(7, content, Link(write))
    os.close(write)
    with os.fdopen(read) as file:
        (event,) = [json.loads(line) for line in file]
    assert (event["event"], event["kind"], event["id"]) == ("data", "answer", 7)
    return event


def test_a_plan_says_everything_the_page_shows(session: Path) -> None:
    plan = read_plan(answer(question="plan", session=str(session))["answer"])
    assert [row.name for row in plan.rows] == ["hdr", "segment", "poses", "light", "surface", "export"]
    assert all(row.reasons == ("never ran",) and row.took_s is None for row in plan.rows)
    assert [row.given for row in plan.rows] == [False, True, False, False, False, False]
    directions = plan.parameter("surface.directions")
    assert directions is not None
    assert (directions.value, directions.default, directions.kind) == (0, 0, "int")
    kinds = {p.name: p.kind for row in plan.rows for p in row.parameters}
    assert kinds["light.camera_clearance"] == "float?"
    assert kinds["light.epochs"] == "list"
    assert kinds["poses.mapping.match_ratio"] == "float"
    assert kinds["surface.full_phase"] == "bool"
    assert kinds["surface.without"] == "words"


@pytest.mark.parametrize("solver", asked.SOLVERS)
def test_a_session_can_be_planned_with_every_solver(session: Path, solver: str) -> None:
    plan = read_plan(answer(question="plan", session=str(session), settings={"solver": solver})["answer"])
    assert {p.kind.rstrip("?") for row in plan.rows for p in row.parameters} <= {
        "int",
        "float",
        "bool",
        "str",
        "list",
        "words",
    }


def test_a_parameter_of_few_words_offers_them(session: Path) -> None:
    plan = read_plan(
        answer(question="plan", session=str(session), settings={"solver": "reference"})["answer"]
    )
    emitter = plan.parameter("surface.emitter")
    assert emitter is not None
    assert (emitter.kind, emitter.value) == ("str", "ours")
    assert emitter.meaning.choices == ("ours", "two_stage", "one_stage")


def test_a_preset_moves_the_defaults_with_it(session: Path) -> None:
    plan = read_plan(answer(question="plan", session=str(session), settings={"preset": "draft"})["answer"])
    rounds = plan.parameter("surface.coarse_iterations")
    assert rounds is not None
    drafted = presets.of_stage("surface")["draft"]["coarse_iterations"]
    assert drafted != SurfaceParams().coarse_iterations
    assert (rounds.value, rounds.default, rounds.changed) == (drafted, drafted, False)


def test_an_edit_is_written_only_when_it_is_to_be_kept(session: Path) -> None:
    opened = sessions.open_session(session)
    plan = read_plan(answer(question="plan", session=str(session))["answer"])
    directions = plan.parameter("surface.directions")
    assert directions is not None
    settings = asked.to_toml(with_value(plan.settings, directions, 256))
    answer(question="plan", session=str(session), settings=settings)
    assert sessions.read_params(opened) == {}
    answer(question="plan", session=str(session), settings=settings, keep=True)
    assert sessions.read_params(opened)["surface"] == {"directions": 256}


def test_settings_that_cannot_be_meant_are_refused_and_not_written(session: Path) -> None:
    said = answer(question="plan", session=str(session), settings={"surface": {"direction": 5}}, keep=True)
    assert "did you mean 'directions'" in said["fault"]
    assert not (session / "params.toml").exists()


def test_a_question_that_fails_is_answered_with_its_fault(session: Path, tmp_path: Path) -> None:
    assert "not a session" in answer(question="plan", session=str(tmp_path))["fault"]
    said = answer(question="nonsense")
    assert "a fault in Roomlight itself" in said["fault"]
    assert "KeyError" in said["details"]


def test_a_thumbnail_is_a_picture_of_the_session(session: Path, tmp_path: Path) -> None:
    to = tmp_path / "cache" / "thumbnails" / "a.png"
    said = answer(question="thumbnail", session=str(session), to=str(to), edge_px=12)
    assert said["answer"] == {"picture": str(to)}
    picture = cv2.imread(str(to))
    assert picture is not None
    assert picture.shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert picture.std() > 5


def test_a_session_without_photographs_has_no_thumbnail(tmp_path: Path) -> None:
    sessions.create(tmp_path / "empty.session", "raw", {})
    to = tmp_path / "a.png"
    said = answer(question="thumbnail", session=str(tmp_path / "empty.session"), to=str(to), edge_px=12)
    assert said["answer"] == {"picture": None}
    assert not to.exists()


def test_a_machine_says_its_gpu_as_torch_does(monkeypatch: pytest.MonkeyPatch) -> None:
    torch = SimpleNamespace(is_available=lambda: False, get_device_name=lambda index: f"card {index}")
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(cuda=torch))
    monkeypatch.setattr(ctypes, "CDLL", lambda driver: None)
    assert answer(question="gpu")["answer"] == {"name": ""}
    torch.is_available = lambda: True
    assert answer(question="gpu")["answer"] == {"name": "card 0"}


def test_where_no_driver_is_nobody_waits_for_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(driver: str) -> None:
        raise OSError(driver)

    monkeypatch.setattr(ctypes, "CDLL", absent)
    monkeypatch.setitem(sys.modules, "torch", None)  # whoever loads it fails
    assert answer(question="gpu")["answer"] == {"name": ""}
    assert choose_device("auto") == "cpu"


def test_a_plan_waits_for_no_torch(session: Path) -> None:
    code = (
        "import sys; from app.work import answers\n"
        f"answers.plan({{'session': {str(session)!r}}})\n"
        "print([name for name in ('torch', 'open3d', 'mitsuba') if name in sys.modules])"
    )
    said = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert said.stdout.splitlines()[-1] == "[]"


def test_plans_go_before_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pipe()
    link = Link(write)
    for number, question in enumerate(("gpu", "thumbnail", "thumbnail", "plan")):
        link.take(json.dumps({"command": "ask", "id": number, "question": question}).encode())
    order: queue.Queue[int] = queue.Queue()

    def one(number: int, content: Mapping[str, Any], link: Link) -> None:
        order.put(number)
        if order.qsize() == 4:
            link.take(b'{"command": "cancel"}')

    monkeypatch.setattr(answers, "answer_one", one)
    with pytest.raises(Cancelled):
        answers.serve({}, link)
    assert [order.get_nowait() for _ in range(4)] == [3, 1, 2, 0]
    os.close(write)
    os.close(read)


def test_a_thumbnail_stands_as_its_session_does_whatever_its_own_photograph_says(tmp_path: Path) -> None:
    raw = raw_folders.write_raw(tmp_path / "card")
    files = sorted(raw.iterdir())
    raw_folders.tag([file for file in files if not "IMG_0012" <= file.stem < "IMG_0015"], 6)
    importing.make_session(raw, tmp_path / "s")
    to = tmp_path / "a.png"
    answer(question="thumbnail", session=str(tmp_path / "s"), to=str(to), edge_px=1000)
    assert cv2.imread(str(to)).shape == (raw_folders.WIDTH // 2, raw_folders.HEIGHT // 2, 3)


def test_a_folder_is_told_by_names_and_headers_before_it_is_imported(tmp_path: Path) -> None:
    renders = photographs(tmp_path / "renders")
    content = answer(question="folder", folder=str(renders), bracket=None, shown=3)["answer"]
    assert {key: content[key] for key in ("kind", "files", "views", "exposures", "width", "height")} == {
        "kind": "linear", "files": 8, "views": 8, "exposures": 1, "width": WIDTH, "height": HEIGHT,
    }  # fmt: skip
    assert [Path(file).name for file in content["shown"]] == ["0000.exr", "0003.exr", "0007.exr"]
    made = answer(question="preview", file=content["shown"][1], edge_px=12, to=str(tmp_path / "small.png"))
    assert cv2.imread(made["answer"]["picture"]).shape == (12, 16, 3)
    raw = raw_folders.write_raw(tmp_path / "raw")
    content = answer(question="folder", folder=str(raw), bracket=None, shown=3)["answer"]
    assert (content["kind"], content["views"] * content["exposures"]) == ("raw", content["files"])
    assert content["exposures"] > 1
    (tmp_path / "jpegs").mkdir()
    (tmp_path / "jpegs" / "a.JPG").write_bytes(b"")
    told = answer(question="folder", folder=str(tmp_path / "jpegs"), bracket=None, shown=3)["fault"]
    assert "no photographs in it (only .jpg, not linear in light); it must hold RAW files" in told
