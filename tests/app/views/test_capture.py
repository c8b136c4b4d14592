"""The Capture page shows what the desk says, asks of it what a person wants, and never moves anything by itself."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor, QImage, QPixmap
from PySide6.QtWidgets import QApplication, QPushButton
from pytestqt.qtbot import QtBot

from app.capture import order as capture_order
from app.capture.dots import Dot
from app.capture.order import Order, Pose
from app.views.capture.page import CapturePage
from app.views.main_window import MainWindow
from app.views.pages import Shell
from app.views.theme import colours
from app.work.jobs import JobState
from hardware.interfaces import Angles, Bracket, Exposure
from tests.app.views.conftest import make_session, until
from tests.app.views.played_desk import PlayedDesk
from tests.app.views.test_theme import contrast


@pytest.fixture
def desk() -> PlayedDesk:
    return PlayedDesk()


@pytest.fixture
def page(desk: PlayedDesk, shell: Shell, qtbot: QtBot, tmp_path: Path) -> Iterator[CapturePage]:
    shell.settings.change(last_folder=str(tmp_path))
    made = CapturePage(None, lambda: desk.panel)
    qtbot.addWidget(made)
    made.resize(1160, 720)
    made.use(shell)
    with qtbot.waitExposed(made):
        made.show()
    made.activateWindow()
    yield made
    desk.job.kill()


def ready(page: CapturePage, desk: PlayedDesk, qtbot: QtBot, poses: int = 4) -> None:
    """Devices open, a plan, a place for the session."""
    desk.open()
    desk.plan(poses)
    until(qtbot, lambda: page.does.start.isEnabled())


def captured(folder: Path, poses: int, taken: int) -> Path:
    """A session that was captured as far as the page looks."""
    session = make_session(folder)
    places = tuple(Pose(i, Angles(10.0 * i, 0.0)) for i in range(poses))
    bracket = Bracket(Exposure(None), (0.0,))
    capture_order.write(session, Order("virtual:", "virtual:", "gimbal", places, bracket))
    for i in range(taken):
        (session / "shots" / f"{i:04d}").mkdir()
        (session / "shots" / f"{i:04d}" / "shot.json").write_text(f'{{"name": "pose{i:04d}"}}')
    return session


def pressed(page: CapturePage, text: str) -> None:
    """Press a button of the banner."""
    button = next(button for button in page.banner.buttons if text in button.text().replace("&", ""))
    button.click()


def banner_buttons(page: CapturePage) -> list[str]:
    return [button.text().replace("&", "") for button in page.banner.buttons]


def test_a_newcomer_connects_the_virtual_studio_with_one_click(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    assert "needs no hardware" in page.setup.devices.hint.text()
    assert page.setup.devices.hint.isVisible()
    at = page.setup.devices.toggle.y()
    page.setup.devices.choose("manual:", "gphoto2:")
    page.setup.devices.layout().activate()
    assert not page.setup.devices.hint.isVisible()
    assert page.setup.devices.toggle.y() == at
    page.setup.devices.choose("virtual:", "virtual:?room=parlour&object=blob")
    qtbot.mouseClick(page.setup.devices.toggle, Qt.MouseButton.LeftButton)
    assert desk.last("open") == {"rig": "virtual:", "camera": "virtual:?room=parlour&object=blob"}


def test_what_was_found_is_listed_and_the_fields_stay_as_they_are(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    assert desk.commands[0] == "list"
    port = {"path": "/dev/ttyACM3", "description": "Arduino Uno", "likely": "grbl"}
    desk.say(
        "devices", ports=[port], cameras=[{"url": "gphoto2:usb:001,004", "name": "EOS R8"}],
        rigs=["grbl:///dev/ttyUSB0?axes=xy", "zaber:///dev/ttyUSB0?axes=1.1", "manual:", "virtual:"],
    )  # fmt: skip
    rig, camera = page.setup.devices.rig, page.setup.devices.camera
    until(qtbot, lambda: rig.count() == 3)
    assert [rig.itemData(i).url for i in range(3)] == ["virtual:", "grbl:///dev/ttyACM3?axes=xy", "manual:"]
    assert page.setup.devices.urls[0] == "virtual:"
    camera.setCurrentIndex(1)
    camera.activated.emit(1)
    assert page.setup.devices.urls[1] == "gphoto2:usb:001,004"


def test_the_building_of_a_room_is_told_with_its_progress(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    desk.say("order", command="open")
    desk.job.emit("progress", fraction=0.34, note="light of the study")
    until(qtbot, lambda: "34%" in page.bar.phase.text())
    assert page.setup.devices.bar.value() == 340
    assert not page.does.start.isEnabled()


@pytest.mark.parametrize("opened", [False, True])
def test_the_stop_button_is_there_while_devices_are_open(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, opened: bool
) -> None:
    if opened:
        ready(page, desk, qtbot)
    assert page.setup.stop.isVisible() is opened
    assert page.setup.stop.height() >= 40 or not opened
    assert page.setup.stop.styleSheet().startswith("QPushButton {")  # its tip is none
    if opened:
        for order in ("move", "preview"):
            desk.say("order", command=order)
            qtbot.wait(1)
            assert page.setup.stop.isVisible()
            assert page.setup.stop.isEnabled()
        desk.say("order", command="")
        desk.say("closed")
        until(qtbot, lambda: not page.setup.stop.isVisible())


@pytest.mark.parametrize("where", ["sphere", "poses", "bracket", "stop"])
def test_escape_stops_wherever_the_focus_is(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, where: str
) -> None:
    ready(page, desk, qtbot)
    setup = page.setup
    widget = {
        "sphere": page.scene.sphere, "poses": setup.plan.poses, "bracket": setup.bracket.bracket,
        "stop": setup.stop,
    }[where]  # fmt: skip
    widget.setFocus()
    qtbot.keyClick(QApplication.focusWidget() or page, Qt.Key.Key_Escape)
    assert desk.commands[-1] == "stop"


def test_arrow_keys_on_the_pad_jog_by_the_step_that_was_chosen(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    ready(page, desk, qtbot)
    jog = page.setup.jog
    jog.steps.button(2).click()
    jog.arrows["up"].setFocus()
    qtbot.keyClick(jog.arrows["up"], Qt.Key.Key_Left)
    assert desk.last("jog") == {"pan": -45.0, "tilt": 0.0}
    qtbot.keyClick(jog.arrows["up"], Qt.Key.Key_Up)
    assert desk.last("jog") == {"pan": 0.0, "tilt": 45.0}
    jog.steps.button(0).click()
    qtbot.mouseClick(jog.arrows["right"], Qt.MouseButton.LeftButton)
    assert desk.last("jog") == {"pan": 1.0, "tilt": 0.0}
    jog.arrows["right"].setFocus()
    desk.say("order", command="jog")
    until(qtbot, lambda: not jog.arrows["right"].isEnabled())
    assert jog.hasFocus()
    desk.say("order", command="")
    until(qtbot, lambda: jog.arrows["right"].hasFocus())


def test_an_axis_that_is_not_there_and_a_rig_that_is_busy_or_lost_are_not_turned(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    axis = {"name": "pan", "lowest_deg": None, "highest_deg": None, "fastest_deg_s": 90.0}
    desk.open(axes=[axis])
    jog = page.setup.jog
    until(qtbot, lambda: jog.arrows["left"].isEnabled())
    assert not jog.arrows["up"].isEnabled()
    desk.say("order", command="move")
    until(qtbot, lambda: not jog.arrows["left"].isEnabled())
    desk.say("order", command="")
    desk.say("where", state="not homed", pan=None, tilt=None, message="")
    until(qtbot, lambda: jog.home.isEnabled())
    assert not jog.arrows["left"].isEnabled()
    jog.home.click()
    assert desk.commands[-1] == "home"


def test_a_rig_that_cannot_find_its_zero_is_said_to_stand_there(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    desk.open(homes=False)
    desk.say("where", state="not homed", pan=None, tilt=None, message="")
    jog = page.setup.jog
    until(qtbot, lambda: jog.where.text() == "Turn it to its zero first")
    assert (jog.home.text().replace("&", ""), jog.go.isEnabled()) == ("At zero", False)
    jog.home.click()
    assert desk.commands[-1] == "home"
    desk.say("where", state="idle", pan=0.0, tilt=0.0, message="")
    until(qtbot, lambda: jog.go.isEnabled())


def test_start_asks_for_what_stands_on_the_page(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    setup = page.setup
    setup.plan.kind.setCurrentIndex(setup.plan.kind.findData("gimbal"))
    setup.plan.poses.setValue(20)
    setup.plan.lowest.setValue(-45)
    setup.bracket.bracket.setEditText("−2, 0, 2")  # noqa: RUF001 a minus as the page writes it
    setup.bracket.shutter.setCurrentIndex(setup.bracket.shutter.findData(0.1))
    setup.plan.helpful.setChecked(True)
    page.does.start.trigger()
    assert desk.last("start") == {
        "session": str(tmp_path / "capture-1.session"),
        "plan": {"kind": "gimbal", "poses": 20, "lowest": -45.0, "highest": 70.0},
        "bracket": [-2.0, 0.0, 2.0], "shutter": 0.1, "iso": None, "aperture": None, "settle": None,
        "helpful_first": True, "any_format": False,
    }  # fmt: skip


@pytest.mark.parametrize("fault", ["bracket", "place", "plan"])
def test_what_is_not_complete_cannot_be_started(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, fault: str
) -> None:
    ready(page, desk, qtbot)
    if fault == "bracket":
        page.setup.bracket.bracket.setEditText("-3 many")
    elif fault == "place":
        page.setup.place.folder.setText("relative/name")
    else:
        desk.say("trouble", command="plan", text="no such poses; choose another plan")
    until(qtbot, lambda: not page.does.start.isEnabled())
    page.does.start.trigger()
    assert "start" not in desk.commands


def test_a_name_that_is_taken_is_not_offered(page: CapturePage, qtbot: QtBot, tmp_path: Path) -> None:
    until(qtbot, lambda: page.setup.place.folder.text() == str(tmp_path / "capture-1.session"))
    (tmp_path / "capture-1.session").mkdir()
    page.new_capture()
    until(qtbot, lambda: page.setup.place.folder.text() == str(tmp_path / "capture-2.session"))


def test_what_suits_the_rig_is_asked_once_it_is_open(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    with qtbot.waitSignal(page.setup.plan.changed):
        page.setup.plan.poses.setValue(5)
    assert "plan" not in desk.commands  # nobody knows yet
    desk.open()
    until(qtbot, lambda: "plan" in desk.commands)


def test_an_edited_plan_is_worked_out_and_drawn(page: CapturePage, desk: PlayedDesk, qtbot: QtBot) -> None:
    ready(page, desk, qtbot, poses=6)
    assert len(page.scene.sphere.dots) == 6
    page.setup.plan.poses.setValue(9)
    until(qtbot, lambda: desk.last("plan") == {"plan": {"kind": "suited", "poses": 9}})
    desk.plan(9, warnings=("the ceiling is not seen",))
    until(qtbot, lambda: len(page.scene.sphere.dots) == 9)
    assert "ceiling" in page.setup.plan.about.text()
    assert "27 photographs" in page.bar.phase.text()


def test_the_sphere_tells_poses_done_under_way_missing_and_to_come(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot, poses=5)
    desk.begin(tmp_path / "a.session")
    missing = [{"pose": "pose0001", "reason": "x"}]
    for phase, pose, taken, lost in (
        ("moving", 0, 0, []), ("checking and keeping", 0, 1, []), ("moving", 1, 1, []), ("moving", 2, 1, missing),
        ("checking and keeping", 2, 2, missing), ("moving", 3, 2, missing),
    ):  # fmt: skip
        desk.status(phase, pose, taken, 5, missing=lost)
        until(qtbot, lambda: page.state is desk.panel.state)
    assert [dot.state for dot in page.scene.sphere.dots] == ["done", "missing", "done", "current", "todo"]
    assert page.bar.bar.value() == 400
    assert "about" in page.bar.left.text()


def test_the_sphere_shows_the_plan_that_is_captured_and_then_the_one_that_stands_on_the_page(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot, poses=6)
    desk.begin(tmp_path / "a.session")
    desk.plan(2)
    until(qtbot, lambda: len(page.scene.sphere.dots) == 2)
    asked = desk.commands.count("plan")
    desk.end(tmp_path / "a.session", 2, 2)
    until(qtbot, lambda: desk.commands.count("plan") > asked)


def test_the_sphere_turns_by_drag_and_by_keys(page: CapturePage, qtbot: QtBot) -> None:
    sphere = page.scene.sphere
    before = sphere.place(0.0, 0.0)[0]
    qtbot.keyClick(sphere, Qt.Key.Key_Right)
    assert sphere.place(0.0, 0.0)[0].x() > before.x()  # what is seen follows the key
    turned = sphere.turn_deg
    middle = sphere.rect().center()
    qtbot.mousePress(sphere, Qt.MouseButton.LeftButton, pos=middle)
    qtbot.mouseMove(sphere, middle + QPoint(20, 0))
    qtbot.mouseRelease(sphere, Qt.MouseButton.LeftButton, pos=middle + QPoint(20, 0))
    assert sphere.turn_deg < turned
    qtbot.keyClick(sphere, Qt.Key.Key_Home)
    assert sphere.place(0.0, 0.0)[0] == before
    assert sphere.place(0.0, 0.0)[1]
    assert not sphere.place(180.0, 0.0)[1]


def test_a_pose_taken_on_the_far_side_is_seen_and_stands_out_from_the_cross(page: CapturePage) -> None:
    sphere = page.scene.sphere
    sphere.show_dots([Dot("far", 180.0, 0.0, "done"), Dot("here", 0.0, 0.0, "done")])
    sphere.show_here(0.0, 0.0)
    seen, ours = sphere.grab().toImage(), colours(sphere)
    far, here = (sphere.place(pan, 0.0)[0].toPoint() for pan in (180.0, 0.0))
    assert contrast(seen.pixelColor(far).name(), ours.field) > 3
    assert contrast(seen.pixelColor(here + QPoint(3, 0)).name(), ours.good) < 2  # the cross leaves it free


def test_what_is_not_seen_yet_is_hatched_at_twice_the_scale_too(page: CapturePage) -> None:
    panorama = page.scene.coverage.panorama
    picture = QPixmap(panorama.size() * 2)
    picture.setDevicePixelRatio(2.0)
    panorama.render(picture)
    seen, line = picture.toImage(), QColor(colours(panorama).line)
    row = [seen.pixelColor(x, 40) == line for x in range(seen.width())]
    assert any(one and other for one, other in pairwise(row))  # lines of two pixels


def test_a_shot_is_shown_with_its_histogram_and_clipping_can_be_hidden(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    for name, colour in (("shot", "#204060"), ("clip", "#ff0000")):
        image = QImage(64, 48, QImage.Format.Format_ARGB32)
        image.fill(QColor(colour))
        image.save(str(tmp_path / f"{name}.png"))
    counts = {"r": [1, 9, 1], "g": [1, 2, 1], "b": [0, 0, 1], "white": 2, "per_ev": 1}
    desk.say(
        "picture", png=str(tmp_path / "shot.png"), clip_png=str(tmp_path / "clip.png"), pose="pose0003",
        clipped=0.01, clipped_here=0.02, dark=0.0, histogram=counts, shutter_s=1 / 60,
    )  # fmt: skip
    picture = page.scene.picture
    until(qtbot, lambda: picture.image is not None)
    middle = picture.rect().center()
    assert picture.grab().toImage().pixelColor(middle) == QColor("#ff0000")
    assert "pose0003" in picture.caption
    assert "1/60 s" in picture.caption
    assert "1.0%" in page.setup.shares.text()
    page.setup.clipping.click()
    assert picture.grab().toImage().pixelColor(middle) == QColor("#204060")
    page.does.clipping.trigger()
    assert page.setup.clipping.isChecked()
    assert not page.grab().isNull()


def test_coverage_grows_and_says_what_would_help(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    for number, share in ((1, 0.2), (2, 0.4)):
        image = QImage(72, 36, QImage.Format.Format_RGB32)
        image.fill(QColor(number, 0, 0))
        path = tmp_path / f"{number}.png"
        image.save(str(path))
        desk.say(
            "coverage", png=str(path), share=share, share_unclipped=share - 0.1, next="tilt up by 30 degrees"
        )
        shown = page.scene.coverage
        until(qtbot, lambda: shown.panorama.image and shown.panorama.image.pixelColor(3, 3).red() == number)  # noqa: B023
        assert f"{share:.0%}" in shown.share.text()
    assert shown.next.text() == "Tilt up by 30 degrees"


def test_warnings_are_listed_newest_first_with_what_to_do(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    findings = page.scene.findings
    desk.say("finding", pose="pose0001", text="it is blurred; hold still", severity="warning")
    desk.say("finding", pose="pose0002", text="it is dark; expose longer", severity="note")
    until(qtbot, lambda: findings.count() == 2)
    assert findings.item(0).text() == "pose0002: it is dark\nExpose longer"
    findings.setCurrentRow(1)
    findings.setFocus()
    qtbot.keyClick(findings, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    assert QApplication.clipboard().text() == "pose0001: it is blurred\nHold still"
    assert page.banner.notice is None


def test_a_finding_that_stops_asks_whether_to_go_on(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    desk.begin(tmp_path / "a.session")
    desk.say("finding", pose="pose0001", text="the object moved; fasten it", severity="stop")
    desk.status("paused", 1, 1, 4, paused=True)
    until(qtbot, lambda: page.banner.isVisible())
    assert "the object moved" in page.banner.what.text()
    assert banner_buttons(page) == ["Resume", "Finish"]
    pressed(page, "Resume")
    assert desk.commands[-1] == "go_on"
    assert not page.banner.isVisible()  # decided: a pause by hand later does not ask this again
    desk.status("moving", 2, 1, 4)
    desk.say("finding", pose="pose0002", text="it moved again; fasten it", severity="stop")
    desk.status("paused", 2, 2, 4, paused=True)
    until(qtbot, lambda: page.banner.isVisible())
    pressed(page, "Finish")
    assert desk.commands[-1] == "end"


def test_a_request_to_the_person_is_answered_with_space(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    assert not page.does.answer.isEnabled()
    desk.begin(tmp_path / "a.session")
    desk.say("ask", text="turn the stand to 30 degrees", confirm=True)
    until(qtbot, lambda: page.banner.isVisible())
    assert page.banner.what.text() == "Turn the stand to 30 degrees"
    page.scene.sphere.setFocus()
    qtbot.keyClick(page.scene.sphere, Qt.Key.Key_Space)
    assert desk.commands[-1] == "answer"
    desk.say("answered")
    until(qtbot, lambda: not page.banner.isVisible())


def test_a_request_that_is_noticed_by_itself_has_no_button(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    desk.say("ask", text="press the shutter", confirm=False)
    until(qtbot, lambda: page.banner.isVisible())
    assert page.banner.buttons == []
    assert not page.does.answer.isEnabled()


def test_pause_go_on_and_end_go_to_the_desk(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    desk.begin(tmp_path / "a.session")
    desk.status("moving", 0, 0, 4)
    until(qtbot, lambda: page.does.pause.isVisible())
    assert not page.does.start.isVisible()
    qtbot.keyClick(page, Qt.Key.Key_F6)
    assert desk.commands[-1] == "pause"
    desk.status("moving", 0, 0, 4, paused=True)
    until(qtbot, lambda: page.does.pause.text() == "&Resume")
    assert "then pauses" in page.bar.phase.text()
    qtbot.keyClick(page, Qt.Key.Key_F6)
    assert desk.commands[-1] == "go_on"
    qtbot.keyClick(page, Qt.Key.Key_Period, Qt.KeyboardModifier.ControlModifier)
    assert desk.commands[-1] == "end"


def test_pause_end_and_stop_are_seen_at_once_however_long_the_desk_takes(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    desk.begin(tmp_path / "a.session")
    desk.status("moving", 0, 0, 4)
    until(qtbot, lambda: page.does.pause.isVisible())
    page.does.pause.trigger()
    until(qtbot, lambda: "then pauses" in page.bar.phase.text())
    assert page.does.pause.text() == "&Resume"
    desk.status("moving", 0, 0, 4)  # of before
    qtbot.wait(1)
    assert page.does.pause.text() == "&Resume"
    page.does.end.trigger()
    until(qtbot, lambda: "ending" in page.bar.phase.text())
    assert not page.does.pause.isEnabled()
    desk.say("where", state="offline", pan=None, tilt=None, message="")
    page.does.stop.trigger()
    until(qtbot, lambda: page.bar.phase.text() == "stopping…")
    assert page.setup.devices.rig_live.told.text() == "stopping…"
    assert page.does.stop.isEnabled()
    desk.end(tmp_path / "a.session", 0, 4, cancelled=True)
    until(qtbot, lambda: page.does.start.isVisible())
    assert "stopping" not in page.bar.phase.text()


def test_only_a_capture_counts_as_running(
    page: CapturePage, desk: PlayedDesk, shell: Shell, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    assert desk.job.status.state is JobState.RUNNING
    assert shell.board.active == ()  # closing does not ask for a desk that does nothing
    desk.begin(tmp_path / "a.session")
    until(qtbot, lambda: shell.board.active == (desk.job,))
    desk.end(tmp_path / "a.session", 0, 4, cancelled=True)
    until(qtbot, lambda: shell.board.active == ())
    assert desk.job.status.state is JobState.RUNNING


def test_a_finished_capture_is_opened_and_offered_to_be_processed(
    page: CapturePage, desk: PlayedDesk, shell: Shell, qtbot: QtBot, tmp_path: Path
) -> None:
    opened: list[Path] = []
    shown: list[str] = []
    shell.wishes.open_session.connect(opened.append)
    shell.wishes.show_page.connect(shown.append)
    ready(page, desk, qtbot)
    session = captured(tmp_path / "a.session", 4, 4)
    desk.begin(session)
    desk.status("moving", 0, 0, 4)
    desk.end(session, 4, 4)
    until(qtbot, lambda: opened == [session])
    assert shown == []
    assert page.banner.what.text() == "a: all 4 poses are taken"
    pressed(page, "Process")
    assert shown == ["process"]


def test_poses_that_are_missing_can_be_taken_again(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    session = tmp_path / "a.session"
    desk.begin(session)
    desk.end(session, 3, 4, missing=[{"pose": "pose0002", "reason": "the camera was busy"}])
    until(qtbot, lambda: page.banner.isVisible())
    assert "the camera was busy" in page.banner.remedy.text()
    pressed(page, "Resume (1 left)")
    assert desk.last("resume") == {"session": str(session), "helpful_first": False, "at_zero": False}


def test_an_unfinished_session_offers_to_resume_and_a_finished_one_to_process(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    page.show_session(captured(tmp_path / "b.session", 5, 2))
    until(qtbot, lambda: page.banner.isVisible())
    assert page.banner.what.text() == "b: 2 of 5 poses are taken"
    assert banner_buttons(page)[0] == "Resume (3 left)"
    assert page.bar.head.primary.objectName() == ""  # one blue button
    assert [dot.state for dot in page.scene.sphere.dots] == ["done", "done", "todo", "todo", "todo"]
    page.show_session(captured(tmp_path / "c.session", 2, 2))
    until(qtbot, lambda: banner_buttons(page)[0] == "Process")
    page.new_capture()
    assert not page.banner.isVisible()


def test_an_imported_session_says_nothing(page: CapturePage, qtbot: QtBot, tmp_path: Path) -> None:
    page.show_session(captured(tmp_path / "b.session", 5, 2))
    until(qtbot, lambda: page.captured is not None)
    page.show_session(make_session(tmp_path / "imported.session"))
    until(qtbot, lambda: page.captured is None)
    assert not page.banner.isVisible()


def test_a_resumed_capture_shows_what_was_done_before(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot, tmp_path: Path
) -> None:
    session = captured(tmp_path / "b.session", 3, 2)
    page.show_session(session)
    until(qtbot, lambda: page.captured is not None)
    desk.open()
    offered = page.setup.place.folder.text()
    desk.begin(session, "resume")
    desk.status("moving", 2, 2, 3)
    until(qtbot, lambda: page.scene.sphere.dots and page.scene.sphere.dots[2].state == "current")
    assert [dot.state for dot in page.scene.sphere.dots] == ["done", "done", "current"]
    assert page.setup.place.folder.text() == str(session)
    desk.end(session, 2, 3, cancelled=True)
    until(qtbot, lambda: page.setup.place.folder.text() == offered)


def test_a_desk_that_dies_is_told_and_the_capture_can_be_resumed(
    page: CapturePage, desk: PlayedDesk, shell: Shell, qtbot: QtBot, tmp_path: Path
) -> None:
    ready(page, desk, qtbot)
    session = tmp_path / "a.session"
    desk.begin(session)
    desk.status("moving", 2, 2, 4)
    until(qtbot, lambda: shell.board.active)
    desk.job.die("the worker crashed; run it again")
    until(qtbot, lambda: page.banner.isVisible() and not page.state.capturing)
    assert page.banner.what.text() == "The worker crashed"
    assert shell.board.active == ()
    pressed(page, "Close")
    assert "Resume (2 left)" in banner_buttons(page)


def test_troubles_are_told_until_they_are_put_away(page: CapturePage, desk: PlayedDesk, qtbot: QtBot) -> None:
    for _ in range(2):  # told again, seen again
        desk.say("trouble", command="move", text="pan 400 lies beyond 365; choose less")
        until(qtbot, lambda: page.banner.isVisible())
        assert page.banner.remedy.text() == "Choose less"
        pressed(page, "Close")
        assert not page.banner.isVisible()


def test_a_trouble_goes_when_the_next_order_is_given_and_a_faulty_plan_stays_one(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    desk.say("trouble", command="open", text="'canon' is no camera; choose another")
    until(qtbot, lambda: page.banner.isVisible())
    desk.open()
    until(qtbot, lambda: not page.banner.isVisible())
    desk.say("trouble", command="plan", text="no such poses; choose another plan")
    desk.say("order", command="jog")
    desk.say("trouble", command="jog", text="pan 400 lies beyond 365; choose less")
    desk.say("order", command="")
    until(qtbot, lambda: page.banner.isVisible())
    assert "no such poses" in page.setup.plan.about.text()
    assert not page.does.start.isEnabled()


def test_every_control_has_a_name_while_everything_shows(
    page: CapturePage, desk: PlayedDesk, qtbot: QtBot
) -> None:
    ready(page, desk, qtbot)
    desk.say("ask", text="turn it", confirm=True)
    until(qtbot, lambda: page.banner.isVisible())
    nameless = [button for button in page.findChildren(QPushButton) if not button.accessibleName()]
    assert nameless == []


def test_the_desk_ends_with_the_page(page: CapturePage, desk: PlayedDesk) -> None:
    page.close()
    assert desk.commands[-1] == "cancel"


def test_a_virtual_capture_from_connecting_to_the_end(
    window: MainWindow, qtbot: QtBot, tmp_path: Path
) -> None:
    """With the real desk in its child, a virtual rig and a drawn card."""
    window.shell.settings.change(last_folder=str(tmp_path))
    window.new_capture()
    page = window.page("capture")
    assert isinstance(page, CapturePage)
    setup = page.setup
    setup.devices.choose("virtual:", "virtual:?room=card&size=192x128")
    setup.plan.poses.setValue(3)
    setup.bracket.bracket.setEditText("0")
    setup.devices.toggle.click()
    until(
        qtbot,
        lambda: page.state.told is not None or (page.does.start.isEnabled() and page.scene.sphere.dots),
        60_000,
    )
    assert page.state.told is None
    until(qtbot, lambda: len(page.scene.sphere.dots) == 3)
    assert window.closing.may_close()
    page.does.start.trigger()
    until(qtbot, lambda: page.state.capturing)
    assert not window.closing.may_close()
    assert window.closing.question is not None
    window.closing.question.reject()
    window.show_page("start")
    window.status.job.click()
    assert window.stack.currentWidget() is page
    until(qtbot, lambda: page.state.ended is not None and not page.state.capturing, 120_000)
    assert page.state.ended is not None
    assert page.state.ended.taken == 3, page.state
    assert window.shell.state.session.value == tmp_path / "capture-1.session"
    assert window.stack.currentWidget() is page
    until(qtbot, lambda: page.scene.picture.image is not None)
    until(qtbot, lambda: [dot.state for dot in page.scene.sphere.dots] == ["done"] * 3)
    job = page.panel.job
    page.close()
    assert job is not None
    assert job.wait(60).ended
