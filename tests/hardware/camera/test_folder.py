"""The folder is filled by a script: each look at it is followed by the next step, and time is the script's."""

import itertools
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from hardware.camera.folder import FolderCamera, FolderConfig
from hardware.errors import AbsentError, DisconnectedError, ExposureError, SettingsError, StoppedError
from hardware.interfaces import Bracket, Exposure
from tests.hardware.camera import photographs

BRACKET = Bracket(Exposure(None))
Step = Callable[[], object]


class Script:
    """What happens after each look; a second passes, too."""

    def __init__(self, folder: Path, steps: list[Step] | None = None):
        self.folder, self.steps, self.asked, self.now = folder, steps or [], [], 0.0
        self.camera = FolderCamera(
            FolderConfig(folder, timeout_s=20.0), self.asked.append, lambda: self.now, self.sleep
        )

    def sleep(self, seconds: float) -> None:
        self.now += 1.0
        if self.steps:
            self.steps.pop(0)()

    def expose(self, *steps: Step, bracket: Bracket = BRACKET):
        self.steps = list(steps)
        return self.camera.expose(bracket)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "in").mkdir()
    return tmp_path / "in"


def put(folder: Path, name: str, ev: float = 0.0, seconds: float = 0.0, **facts) -> Step:
    """A step that stores a photograph `ev` from 1/64 s."""
    seed = sum(map(ord, name))
    return lambda: photographs.write(folder / name, 2.0**ev / 64, seconds=seconds, seed=seed, **facts)


def three(folder: Path, *names: str, evs: tuple[float, ...] = (0.0, -3.0, 3.0)) -> Step:
    puts = [put(folder, name, ev) for name, ev in zip(names, evs, strict=True)]
    return lambda: [step() for step in puts]


def test_files_are_told_apart_by_their_exposure_not_by_name_or_arrival(folder: Path):
    taken = Script(folder).expose(
        put(folder, "C.DNG", 3.0), put(folder, "A.DNG", 0.0), put(folder, "B.DNG", -3.0)
    )
    assert [(item.handle, item.ev) for item in taken] == [("B.DNG", -3.0), ("A.DNG", 0.0), ("C.DNG", 3.0)]
    assert [item.exposure.shutter_s for item in taken] == pytest.approx([1 / 512, 1 / 64, 1 / 8])


def test_stops_in_another_order_get_their_own_files(folder: Path):
    taken = Script(folder).expose(
        three(folder, "A.DNG", "B.DNG", "C.DNG", evs=(0.0, -2.0, 2.0)),
        bracket=Bracket(Exposure(None), (2.0, -2.0, 0.0)),
    )
    assert [(item.handle, item.ev) for item in taken] == [("C.DNG", 2.0), ("B.DNG", -2.0), ("A.DNG", 0.0)]


def test_a_file_that_still_grows_is_waited_for(folder: Path, tmp_path: Path):
    whole = photographs.write(tmp_path / "whole", 1 / 8).read_bytes()
    script = Script(folder)
    growing = [
        lambda end=end: (folder / "C.DNG").write_bytes(whole[:end]) for end in (0, 0, 0, 500, 900, len(whole))
    ]
    taken = script.expose(put(folder, "A.DNG"), put(folder, "B.DNG", -3.0), *growing)
    assert taken[2].handle == "C.DNG"
    assert not script.steps
    assert script.now >= len(growing) + 3  # and was seen unchanged once more


def test_what_lay_there_before_is_none_of_it(folder: Path):
    three(folder, "OLD1.DNG", "OLD2.DNG", "OLD3.DNG")()
    taken = Script(folder).expose(three(folder, "A.DNG", "B.DNG", "C.DNG"))
    assert {item.handle for item in taken} == {"A.DNG", "B.DNG", "C.DNG"}


def test_what_came_before_it_was_asked_for_is_not_used_and_said_to_be_so(folder: Path):
    script = Script(folder)
    put(folder, "TEST.DNG")()
    taken = script.expose(three(folder, "A.DNG", "B.DNG", "C.DNG"))
    assert "TEST.DNG" not in {item.handle for item in taken}
    assert "TEST.DNG" in script.asked[0]
    assert "-3, 0, +3 EV" in script.asked[0]


def test_sidecars_jpegs_and_unfinished_files_do_not_count(folder: Path):
    def others() -> None:
        for name in ("A.xmp", "A.JPG", ".B.DNG", "C.DNG.part", "notes.txt"):
            (folder / name).write_bytes(b"x")
        (folder / "D.DNG").mkdir()

    taken = Script(folder).expose(others, three(folder, "A.DNG", "B.DNG", "E.DNG"))
    assert {item.handle for item in taken} == {"A.DNG", "B.DNG", "E.DNG"}


def test_jpegs_count_where_they_are_asked_for(folder: Path):
    steps: list[Step] = [
        lambda name=name: (folder / name).write_bytes(b"jpeg") for name in ("1.JPG", "2.jpg", "3.jpg")
    ]
    camera = FolderCamera(
        FolderConfig(folder, suffix="jpg"),
        print,
        itertools.count().__next__,
        lambda s: steps and steps.pop(0)(),
    )
    taken = camera.expose(BRACKET)
    assert [item.handle for item in taken] == ["1.JPG", "2.jpg", "3.jpg"]
    assert camera.features.suffix == ".jpg"


def test_files_that_tell_nothing_count_in_the_order_they_came(folder: Path):
    def put_blank(name: str) -> Step:
        return lambda: (folder / name).write_bytes(name.encode())

    taken = Script(folder).expose(put_blank("Z.CR3"), put_blank("M.CR3"), put_blank("A.CR3"))
    assert [(item.handle, item.ev) for item in taken] == [("Z.CR3", -3.0), ("M.CR3", 0.0), ("A.CR3", 3.0)]
    assert taken[0].exposure == Exposure(None)


def test_one_file_too_many_is_told_by_name_and_spoils_no_later_bracket(folder: Path):
    script = Script(folder)
    with pytest.raises(ExposureError, match=r"4 photographs .* A\.DNG, B\.DNG, C\.DNG, D\.DNG"):
        script.expose(three(folder, "A.DNG", "B.DNG", "C.DNG"), put(folder, "D.DNG"))
    taken = script.expose(three(folder, "E.DNG", "F.DNG", "G.DNG"))
    assert {item.handle for item in taken} == {"E.DNG", "F.DNG", "G.DNG"}


def test_a_second_cameras_file_is_told_by_name(folder: Path):
    script = Script(folder)
    with pytest.raises(ExposureError, match=r"C\.DNG is from Roomlight Guest"):
        script.expose(
            put(folder, "A.DNG"), put(folder, "B.DNG", -3.0), put(folder, "C.DNG", 3.0, model="Guest")
        )


def test_a_whole_bracket_of_a_second_camera_is_told(folder: Path):
    script = Script(folder)
    script.expose(three(folder, "A.DNG", "B.DNG", "C.DNG"))
    with pytest.raises(ExposureError, match="one camera"):
        script.expose(*(put(folder, f"G{ev}.DNG", ev, model="Guest") for ev in (-3.0, 0.0, 3.0)))


@pytest.mark.parametrize("evs", [(0.0, -2.0, 2.0), (0.0, 0.0, 0.0), (0.0, 3.0, 9.0)])
def test_another_bracket_than_asked_for_is_told_with_its_stops(folder: Path, evs):
    with pytest.raises(ExposureError, match=r"\+3\.0, \+6\.0 EV were expected"):
        Script(folder).expose(three(folder, "A.DNG", "B.DNG", "C.DNG", evs=evs))


def test_shutters_that_are_rounded_are_still_the_bracket(folder: Path):
    assert len(Script(folder).expose(three(folder, "A.DNG", "B.DNG", "C.DNG", evs=(0.0, -2.9, 3.17)))) == 3


def test_too_few_files_are_told_when_time_is_up(folder: Path):
    script = Script(folder)
    with pytest.raises(ExposureError, match=r"only A\.DNG, B\.DNG came within 20 s where 3"):
        script.expose(put(folder, "A.DNG"), put(folder, "B.DNG"))
    assert script.now == pytest.approx(23, abs=2)


def test_each_new_file_gives_more_time(folder: Path):
    waits: list[Step] = [lambda: None] * 15
    script = Script(folder)
    script.expose(
        *waits, put(folder, "A.DNG"), *waits, put(folder, "B.DNG", -3.0), *waits, put(folder, "C.DNG", 3.0)
    )
    assert script.now > 45


def test_nothing_at_all_is_told_with_what_to_do(folder: Path):
    with pytest.raises(ExposureError, match=r"no RAW file came.*suffix=\.jpg"):
        Script(folder).expose()


def test_a_name_may_come_again_after_the_folder_was_emptied(folder: Path):
    script = Script(folder)
    for _ in range(2):
        assert len(script.expose(three(folder, "A.DNG", "B.DNG", "C.DNG"))) == 3
        for path in folder.iterdir():
            path.unlink()


def test_stop_ends_the_wait(folder: Path):
    script = Script(folder)
    with pytest.raises(StoppedError):
        script.expose(lambda: None, script.camera.stop)


def test_files_of_a_bracket_that_was_stopped_spoil_no_later_one(folder: Path):
    script = Script(folder)
    with pytest.raises(StoppedError):
        script.expose(put(folder, "A.DNG"), script.camera.stop)
    taken = script.expose(three(folder, "E.DNG", "F.DNG", "G.DNG"))
    assert {item.handle for item in taken} == {"E.DNG", "F.DNG", "G.DNG"}


def test_a_folder_that_vanishes_is_told(folder: Path):
    with pytest.raises(DisconnectedError, match=str(folder)):
        Script(folder).expose(lambda: shutil.rmtree(folder))


def test_a_folder_that_is_not_there_is_told_at_once(tmp_path: Path):
    with pytest.raises(AbsentError, match="make it"):
        FolderCamera(FolderConfig(tmp_path / "nowhere"), print)
    (tmp_path / "file").touch()
    with pytest.raises(AbsentError):
        FolderCamera(FolderConfig(tmp_path / "file"), print)


def test_what_cannot_be_meant_is_refused(folder: Path):
    for config in (
        FolderConfig(folder, suffix=".exe"), FolderConfig(folder, timeout_s=0), FolderConfig(folder, poll_s=-1),
        FolderConfig(folder, bracket=0),
    ):  # fmt: skip
        with pytest.raises(SettingsError):
            FolderCamera(config, print)


def test_a_bracket_the_camera_does_not_make_is_refused_before_anybody_is_asked(folder: Path):
    asked: list[str] = []
    camera = FolderCamera(FolderConfig(folder, bracket=5), asked.append)
    with pytest.raises(SettingsError, match="5 files make one pose there, but 3"):
        camera.expose(BRACKET)
    assert not asked
