"""The command line: every fault is one line on stderr and exit code 2, and the session stays as it was."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
import pytest

from app import commands
from app.cli import main
from app.exit_codes import ExitCode
from engine.io import session as sessions
from engine.results.quality import DOUBTFUL, GOOD, Quality
from tests.app.calls import ROOT, command, digest, refused
from tests.engine import folders
from tests.engine.folders import write_exr

VIEWS, WIDTH, HEIGHT = 8, 32, 24


def scene(seed: int, width: int = WIDTH) -> np.ndarray:
    return folders.scene(seed, width, HEIGHT)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "renders"
    place.mkdir()
    for i in range(VIEWS):
        write_exr(place / f"{i:04d}.exr", scene(i))
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[8:16, 10:20] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    return place


@pytest.fixture
def session(folder: Path, tmp_path: Path) -> Path:
    assert (
        main(["import", str(folder), str(tmp_path / "a.session"), "--mask", str(tmp_path / "mask.png")]) == 0
    )
    return tmp_path / "a.session"


def test_help_and_plan_load_no_library_that_they_do_not_use(session: Path) -> None:
    heavy = ("numpy", "torch", "numba", "mitsuba", "cv2", "PIL", "rich", "jaxtyping", "importlib.metadata")
    code = (
        "import sys; from app.cli import main\n"
        f"loaded = lambda: print([name for name in {heavy} if name in sys.modules])\n"
        "try: main(['--help'])\n"
        "except SystemExit: loaded()\n"
        f"main(['plan', {str(session)!r}]); loaded()"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert [line for line in answer.stdout.splitlines() if line.startswith("[")] == ["[]", "['numpy']"]


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"roomlight {version('roomlight')}\n"


def test_import_then_plan(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(session)]) == 0
    lines = capsys.readouterr().out.splitlines()[-6:]
    assert [line.split()[0] for line in lines] == ["hdr", "segment", "poses", "light", "surface", "export"]
    assert "never ran, will take what is given" in lines[1]
    assert all("never ran" in line for line in lines)


def test_what_import_has_to_say_is_printed(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_exr(folder / "0003.exr", scene(3) - 0.2)
    assert main(["import", str(folder), str(tmp_path / "b.session")]) == 0
    assert "1 of 8 pictures hold negative values, most 0003.exr: " in capsys.readouterr().out


def test_process_runs_until_the_stage_asked_and_plan_says_what_a_change_costs(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["process", str(session), "--until", "segment", "--seed", "3", "--device", "cpu"]) == 0
    capsys.readouterr()
    main(["plan", str(session)])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("done")
    assert lines[1].endswith("done (given)")
    assert "never ran" in lines[2]
    main(["plan", str(session), "--set", "hdr.long_edge_px=16"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("will run because params.long_edge_px 2048 -> 16")
    assert lines[1].endswith("will run because input hdr changed")
    assert sessions.read_params(sessions.open_session(session)) == {"preset": "standard", "seed": 3}


def test_bad_input_to_import_is_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to = tmp_path / "new.session"
    (tmp_path / "empty").mkdir()
    assert "no photographs in it (empty)" in refused(capsys, "import", tmp_path / "empty", to)
    assert "no such folder" in refused(capsys, "import", tmp_path / "nowhere", to)
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.full((5, 5), 255, np.uint8))
    assert "other.png: the mask is 5 x 5" in refused(capsys, "import", folder, to, "--mask", other)
    nothing = tmp_path / "nothing.json"
    assert "nothing.json: no such file" in refused(capsys, "import", folder, to, "--poses", nothing)
    image = scene(0)
    image[3, 4] = np.nan
    write_exr(folder / "0003.exr", image)
    assert "0003.exr: 3 of 2304 values are NaN" in refused(capsys, "import", folder, to)
    write_exr(folder / "0003.exr", scene(0, WIDTH + 1))
    assert "0003.exr: two sizes are mixed" in refused(capsys, "import", folder, to)
    for path in sorted(folder.iterdir())[3:]:
        path.unlink()
    assert "3 views of 3 files; at least 8 are needed" in refused(capsys, "import", folder, to)
    (folder / "0001.exr").write_bytes(b"v/1\x01\x02")
    assert "0001.exr: cannot be read" in refused(capsys, "import", folder, to)
    assert not to.exists()


@pytest.mark.parametrize(
    "words", [("plan",), ("process",), ("report",), ("export", "--to", "x"), ("evaluate", "x")]
)
def test_a_session_of_a_newer_schema_is_left_alone(
    session: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    facts = json.loads((session / "session.json").read_bytes())
    (session / "session.json").write_text(json.dumps(facts | {"schema": 99}))
    before = digest(session)
    name, *rest = words
    where = [session, *rest] if name != "evaluate" else [session, session]
    assert "session.json: has schema 99" in refused(capsys, name, *where)
    assert digest(session) == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--set", "surface.direction=5"), "did you mean 'directions'"),
        (("--set", "surface.directions=many"), "takes int"),
        (("--set", "surface.fine_iterations=0"), "surface.fine_iterations is 0; give 1 or more"),
        (("--until", "surfaces"), "there is no stage 'surfaces'"),
        (("--seed", "-1"), "seed must be a whole number"),
    ],
)
def test_what_is_misspelt_is_refused_and_not_kept(
    session: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], message: str
) -> None:
    before = digest(session)
    assert message in refused(capsys, "process", session, *words)
    assert digest(session) == before


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ("hdr.long_edge_px=0", "hdr.long_edge_px is 0; give 8 or more"),
        ("segment.margin_px=-2", "segment.margin_px is -2; give 0 or more"),
        ("poses.mapping.match_ratio=2", "poses.mapping.match_ratio is 2.0; give 0.1 to 1"),
        ("light.max_image_width=-3", "light.max_image_width is -3; give 32 or more"),
        ("light.epochs=[]", "light.epochs is []; give one number or more"),
        ("light.camera_clearance=nan", "light.camera_clearance is nan; give 0 or more"),
        ("surface.samples=0", "surface.samples is 0; give 1 or more"),
        ("export.normal_png=foo", 'export.normal_png is "foo"; give opengl or directx'),
    ],
)
def test_what_no_stage_could_work_with_is_refused_and_not_kept(
    session: Path, capsys: pytest.CaptureFixture[str], asked: str, told: str
) -> None:
    solver = ("--solver", "reference") if "samples" in asked else ()
    before = digest(session)
    for command_name in ("plan", "process"):
        assert told in refused(capsys, command_name, session, *solver, "--set", asked)
    assert digest(session) == before


def test_a_file_to_start_from_is_kept_where_it_is_from_every_folder(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["process", str(session), "--until", "hdr", "--device", "cpu"]
    assert main([*words, "--set", "surface.initial_normals=maps.npy"]) == 0
    kept = sessions.read_params(sessions.open_session(session))
    assert kept["surface"] == {"initial_normals": str(tmp_path / "maps.npy")}


def test_cuda_is_refused_where_there_is_none(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has CUDA")
    before = digest(session)
    assert "--device cuda: no CUDA device" in refused(capsys, "process", session, "--device", "cuda")
    assert digest(session) == before


def test_results_that_are_not_there_say_which_command_makes_them(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "run `roomlight process" in refused(capsys, "export", session, "--to", tmp_path / "out")
    truth = tmp_path / "truth.npz"
    ones = np.ones((HEIGHT, WIDTH))
    normal = np.zeros((HEIGHT, WIDTH, 3))
    normal[..., 2] = -1
    np.savez(truth, normal=normal, albedo=np.ones((HEIGHT, WIDTH, 3)), roughness=ones, depth=ones, mask=ones)
    assert "run `roomlight process" in refused(capsys, "evaluate", session, truth)


def test_a_damaged_record_of_a_stage_is_told_with_its_way_out(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["process", str(session), "--until", "segment", "--device", "cpu"]) == 0
    (folder,) = (session / "stages" / "segment").iterdir()
    (folder / "report.json").write_text("")
    line = refused(capsys, "report", session)
    assert f"{folder}/report.json: cannot be read back" in line
    assert f"remove the folder {folder} and process again" in line


def test_a_changed_photograph_stops_the_run(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = session / "shots" / "0003" / "radiance.exr"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    before = digest(session / "shots")
    error = refused(capsys, "process", session, "--until", "hdr", "--device", "cpu")
    assert "0003/radiance.exr: its bytes changed" in error
    assert digest(session / "shots") == before


def test_a_second_process_is_told_who_works_on_the_session(session: Path) -> None:
    with sessions.lock(sessions.open_session(session)):
        answer = command("process", session, "--until", "hdr")
    assert answer.returncode == ExitCode.BUSY
    assert answer.stderr.count("\n") == 1
    assert f"process {os.getpid()} is working on this session" in answer.stderr


def test_a_folder_without_write_permission_is_told(session: Path) -> None:
    powerless = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.getuid() == 0 else []
    before = digest(session)
    places = [session, *(path for path in session.rglob("*") if path.is_dir())]
    for place in places:
        place.chmod(0o555)
    try:
        words = [*powerless, sys.executable, "-m", "app.cli", "process", str(session), "--until", "hdr"]
        answer = subprocess.run(words, cwd=ROOT, capture_output=True, text=True)
    finally:
        for place in places:
            place.chmod(0o755)
    assert answer.returncode == 2
    assert answer.stderr.count("\n") == 1, answer.stderr
    assert "no permission to write here" in answer.stderr
    assert digest(session) == before


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of 600 kB."""
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=600k", "none", place], capture_output=True
    ).returncode:
        pytest.skip("mounting a small file system needs root")
    yield place
    subprocess.run(["umount", place], check=True)


def test_a_full_disk_is_told_and_the_session_survives_it(session: Path, small_disk: Path) -> None:
    moved = small_disk / "a.session"
    shutil.copytree(session, moved)
    (small_disk / "ballast").write_bytes(bytes(max(shutil.disk_usage(small_disk).free - 8192, 0)))
    before = digest(moved)
    answer = command("process", moved, "--until", "hdr")
    assert answer.returncode == 2, answer.stderr
    assert answer.stderr.count("\n") == 1, answer.stderr
    assert "disk is full; free some space" in answer.stderr
    (moved / "params.toml").unlink(missing_ok=True)
    assert digest(moved) == before
    (small_disk / "ballast").unlink()
    answer = command("process", moved, "--until", "hdr")
    assert answer.returncode == 0, answer.stderr


def test_ctrl_c_stops_says_how_to_resume_and_the_next_run_resumes(session: Path) -> None:
    words = [sys.executable, "-m", "app.cli", "process", str(session), "--device", "cpu"]
    child = subprocess.Popen(
        words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert child.stdout is not None
    while "hdr: begins" not in (line := child.stdout.readline()):
        assert line, child.communicate()[1]
    child.send_signal(signal.SIGINT)
    time.sleep(0.2)
    output, error = child.communicate(timeout=60)
    # Eight featureless views cannot be placed: had the stop come too late, this would be exit code 2.
    assert child.returncode == 130, (output, error)
    assert "stopped; run again to resume" in error
    assert "Traceback" not in error
    assert command("process", session, "--until", "segment").returncode == 0


def test_the_demo_says_where_its_session_is_when_it_is_not_bundled(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from app import demo

    monkeypatch.setattr(demo, "BUNDLED", tmp_path / "nowhere")
    assert "run ./roomlight demo from a clone" in refused(capsys, "demo", "--to", tmp_path / "out")


def test_the_demo_never_writes_over_something_else(
    tmp_path: Path, session: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from app import demo

    (tmp_path / "bundle").mkdir()
    session.rename(tmp_path / "bundle" / "session")
    monkeypatch.setattr(demo, "BUNDLED", tmp_path / "bundle")
    (tmp_path / "out" / "session").mkdir(parents=True)
    (tmp_path / "out" / "session" / "thesis.txt").write_text("years of work")
    assert "holds something else" in refused(capsys, "demo", "--to", tmp_path / "out")
    assert (tmp_path / "out" / "session" / "thesis.txt").read_text() == "years of work"


@pytest.mark.parametrize(
    ("grade", "strict", "code"), [(DOUBTFUL, True, 3), (DOUBTFUL, False, 0), (GOOD, True, 0)]
)
def test_a_strict_process_of_a_doubted_result_ends_with_3(
    monkeypatch: pytest.MonkeyPatch, grade: str, strict: bool, code: int
) -> None:
    monkeypatch.setattr(commands, "process", lambda *asked: Quality(grade, 1.0, "why.", "what to do."))
    assert main(["process", "lion.session", *(["--strict"] if strict else [])]) == code
