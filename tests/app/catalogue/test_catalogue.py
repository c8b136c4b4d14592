"""The catalogue of sessions: a page from disk, a table, JSON, and pictures in three sizes."""

import csv
import json
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.catalogue import page
from app.catalogue.rows import Row
from app.cli import main
from tests.app.calls import refused
from tests.app.sessions import small
from tests.engine.results.report.test_report_seen import BROWSER, LONG_S

EVIL = "</script><img src=x onerror=alert(1)>"


def give_results(session: Path, fingerprint: str = "e1", side: int = 500) -> Path:
    """What surface and export would leave of a square object in the middle of a picture."""
    export, surface = (session / "stages" / stage / fingerprint for stage in ("export", "surface"))
    for folder, stage in ((export, "export"), (surface, "surface")):
        folder.mkdir(parents=True)
        record = {"stage": stage, "version": 1, "params": {}, "inputs": {}, "seconds": 1.0, "finished": 1e9,
                  "software": {"roomlight": "0.1.0"}}  # fmt: skip
        (folder / "record.json").write_text(json.dumps(record))
    facts = {"stderr_normal_deg": 7.0, "held_out_error": 0.05}
    (surface / "report.json").write_text(json.dumps({"values": facts}))
    (export / "export.json").write_text(json.dumps({"unit_of_length": "metre", "files": []}))
    mask = np.zeros((2 * side, 2 * side), np.uint8)
    mask[side // 2 : -side // 2, side // 2 : -side // 2] = 255
    Image.fromarray(mask).save(export / "mask.png")
    for name, colour in (
        ("photograph", (10, 200, 10)),
        ("albedo", (200, 10, 10)),
        ("normal", (128, 128, 255)),
    ):
        Image.new("RGB", mask.shape, colour).save(export / f"{name}.png")
    return export


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with results, one without, a damaged one."""
    folder = tmp_path_factory.mktemp("catalogue")
    lion = small(folder, "shelf/lion.session")
    for name in ("=vase.session", "torn.session"):
        shutil.copytree(lion, lion.parent / name)
    give_results(lion)
    (lion.parent / "torn.session" / "session.json").write_text("[")
    return lion.parent


@pytest.fixture(scope="module")
def catalogue(shelf: Path) -> Path:
    to = shelf.parent / "to"
    assert main(["catalogue", str(shelf), "--to", str(to)]) == 2  # one is damaged
    return to


def listed(catalogue: Path) -> dict[str, dict]:
    return {row["name"]: row for row in json.loads((catalogue / "catalogue.json").read_text())["sessions"]}


def test_rows_say_where_a_session_stands_and_how_sure_it_is(catalogue: Path) -> None:
    rows = listed(catalogue)
    assert sorted(rows) == ["=vase", "lion"]
    lion, vase = rows["lion"], rows["=vase"]
    assert (lion["standing"], vase["standing"]) == ("stale", "new")
    assert lion["stale"].startswith("surface will run because the stage's method is new (version 1 ->")
    assert (lion["verdict"], lion["stderr_normal_deg"], lion["unit_of_length"]) == ("doubtful", 7.0, "metre")
    assert lion["reason"].startswith("Half of the normals have a standard error of 7 degrees")
    assert (lion["views"], lion["width"], lion["height"]) == (8, 32, 24)
    assert (vase["verdict"], vase["stderr_normal_deg"], vase["export"]) == ("", None, None)


def test_a_spreadsheet_computes_nothing_of_a_name(catalogue: Path) -> None:
    with (catalogue / "catalogue.csv").open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == ["'=vase", "lion"]
    assert rows[1]["stderr_normal_deg"] == "7.0"


def test_pictures_are_cut_to_the_object_in_three_sizes_and_never_enlarged(catalogue: Path) -> None:
    lion = listed(catalogue)["lion"]
    folder = catalogue / "images" / lion["key"] / "e1"
    sizes = {path.name: Image.open(path).size for path in folder.iterdir()}
    assert len(sizes) == 9
    # 500 pixels of object and a margin of 6 % on either side.
    assert (sizes["albedo-150.jpg"], sizes["albedo-400.jpg"]) == ((150, 150), (400, 400))
    assert sizes["albedo-1000.jpg"][0] == pytest.approx(560, abs=2)
    albedo = np.asarray(Image.open(folder / "albedo-150.jpg")).astype(int)
    assert np.abs(albedo[75, 75] - [200, 10, 10]).max() < 8
    assert np.abs(albedo[2, 2] - 128).max() < 8  # no albedo outside of the object


def test_pictures_follow_the_newest_export_and_are_kept_else(
    shelf: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session, to = Path(shutil.copytree(shelf / "lion.session", tmp_path / "lion.session")), tmp_path / "to"
    for fingerprint in ("e1", "e1", "e2"):
        if not (session / "stages" / "export" / fingerprint).exists():
            export = give_results(session, fingerprint, side=60)
            record = json.loads((export / "record.json").read_text()) | {"finished": 2e9}
            (export / "record.json").write_text(json.dumps(record))
        assert main(["catalogue", str(session), "--to", str(to)]) == 0
        (pictures,) = (to / "images").glob("*/*")
        assert pictures.name == fingerprint
        (pictures / "kept").touch()
    (to / "images" / "gone-12345678").mkdir()
    (session / "stages" / "export" / "e2" / "albedo.png").write_bytes(b"no picture")
    shutil.rmtree(pictures)
    assert main(["catalogue", str(session), "--to", str(to)]) == 2
    assert "e2/albedo.png: cannot be read" in capsys.readouterr().err
    assert not (to / "images" / "gone-12345678").exists()


def test_a_folder_of_other_things_is_refused(shelf: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "something else than a catalogue" in refused(capsys, "catalogue", shelf, "--to", shelf)


def row(number: int, name: str) -> Row:
    """A made-up session."""
    grade = ("good", "doubtful", "")[number % 3]
    return Row(
        f"k{number}", name, f"/archive/{number:04d}", ("done", "stale")[number % 2], "", grade, "Why.", 48, 320, 240, float(number),
        "NIKON Z 7", "2026-01-02", "2026-02-03", "0.1.0, surface 45", None if number % 3 == 2 else number / 100, None, "metre", None,
        None, None,
    )  # fmt: skip


class Outline(HTMLParser):
    """Elements of a page, and what its first script holds."""

    def __init__(self) -> None:
        super().__init__()
        self.kinds: list[str] = []
        self.data = ""
        self._within = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.kinds.append(tag)
        self._within = ("id", "rows") in attrs

    def handle_data(self, data: str) -> None:
        self.data += data if self._within else ""


def test_a_name_is_text_and_the_page_points_nowhere_outside() -> None:
    outline = Outline()
    text = page.html([row(0, EVIL)], [None], EVIL, "today")
    outline.feed(text)
    assert json.loads(outline.data)[0]["name"] == EVIL
    assert "img" not in outline.kinds
    assert "http" not in text


@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed here")
def test_a_browser_filters_sorts_and_draws_what_is_seen_of_2000(tmp_path: Path) -> None:
    names = [EVIL if i == 7 else f"object {i}" for i in range(2000)]
    rows = [row(i, name) for i, name in enumerate(names)]
    (tmp_path / "index.html").write_text(page.html(rows, [None] * len(rows), "All", "today"))

    def dumped(query: str) -> str:
        words = [
            BROWSER,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            f"--user-data-dir={tmp_path / 'profile'}",
        ]
        address = (tmp_path / "index.html").as_uri() + query
        done = subprocess.run(
            [*words, "--dump-dom", address], capture_output=True, check=True, timeout=LONG_S
        )
        return done.stdout.decode()

    every = dumped("")
    assert "2000 of 2000 sessions" in every
    assert 60 <= every.count("<article>") < 400  # the first screens, not all
    assert "<img src=x" not in every
    some = dumped("?search=nikon+object&standing=done&verdict=good&sort=-stderr_normal_deg")
    assert f"{len(range(0, 2000, 6))} of 2000 sessions" in some
    first = some.index("<h2>")
    assert some[first:].startswith("<h2>object 1998</h2>")
