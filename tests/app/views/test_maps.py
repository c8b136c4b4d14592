"""The maps page shows a finished run, follows the mouse, swipes, compares, and never waits."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QAbstractButton, QAbstractSlider, QComboBox, QFileDialog, QInputDialog, QWidget
from pytestqt.qtbot import QtBot

from app.inspect import maps, runs
from app.views.maps.page import MapsPage
from app.views.maps.panel import MapPanel
from app.views.pages import Shell
from engine.io import scale_edit
from engine.io import session as sessions
from engine.io.scale_edit import ScaleBar
from tests.app import furnace
from tests.app.views.conftest import active, until
from tests.app.work.children import QUICK, WILLING, job

MIDDLE = QPointF(20.5 / 40, 15.5 / 40)


@pytest.fixture
def two_runs(tmp_path: Path) -> Path:
    """The newer run's roughness is 0.1 higher, and it asked for other directions."""
    session = furnace.finished(tmp_path / "lion.session", "older", 1e9)
    mask = furnace.surface().mask
    furnace.finished(session, "newer", 2e9, roughness=furnace.surface().roughness + 0.1 * mask)
    path = session / "stages" / "surface" / "newer" / "record.json"
    record = json.loads(path.read_text())
    record["params"]["directions"] = 2048
    path.write_text(json.dumps(record))
    return session


@pytest.fixture
def page(qtbot: QtBot, shell: Shell) -> MapsPage:
    made = MapsPage(None)
    qtbot.addWidget(made)
    made.use(shell)
    made.resize(1100, 700)
    made.show()
    return made


def settled(page: MapsPage, qtbot: QtBot) -> None:
    until(qtbot, lambda: page.showing is not None and not page._background.busy)


def drawn(panel: MapPanel) -> bool:
    return panel.view.full is not None


def shown(page: MapsPage, session: Path, qtbot: QtBot) -> MapsPage:
    page.show_session(session)
    settled(page, qtbot)
    return page


def test_without_results_it_says_what_to_do(page: MapsPage, qtbot: QtBot, tmp_path: Path) -> None:
    assert "No session is open" in page.empty.what.text()
    page.show_session(tmp_path)
    until(qtbot, lambda: "no finished surface" in page.empty.what.text())
    assert page.empty.isVisible()
    assert not page.body.isVisible()


def test_a_run_is_drawn_in_every_panel_with_its_legend(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    assert all(drawn(panel) for panel in page.grid.panels[:6])
    legends = {panel.layer: panel.legend.accessibleDescription() for panel in page.grid.panels[:6]}
    assert legends["depth"].endswith("scene units")
    assert legends["stderr_normal"].endswith("degrees")
    assert legends["roughness"].startswith("0 … 1")
    assert "OpenGL" in legends["normal"]
    assert page.bar.run_box.count() == 2
    assert "directions of light 2048" in page.bar.run_box.currentText()
    assert "validation" in page.bar.view_box.currentText()


def test_results_that_arrive_later_appear(page: MapsPage, qtbot: QtBot, tmp_path: Path) -> None:
    session = tmp_path / "late.session"
    session.mkdir()
    page.show_session(session)
    until(qtbot, lambda: page.empty.isVisible() and not page._background.busy)
    furnace.finished(session)
    page.refresh()
    settled(page, qtbot)
    assert page.body.isVisible()


def test_photographs_appear_once_their_brackets_are_merged(
    page: MapsPage, qtbot: QtBot, two_runs: Path, shell: Shell, tmp_path: Path
) -> None:
    hdr = two_runs / "stages" / "hdr"
    hdr.rename(tmp_path / "hdr")
    shown(page, two_runs, qtbot)
    assert "not merged yet" in page.grid.panels[0].view.message
    (tmp_path / "hdr").rename(hdr)
    shell.board.hold(True)  # anything that happens on the board
    until(qtbot, lambda: drawn(page.grid.panels[0]))


def test_closing_the_session_empties_the_page(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    page.show_session(None)
    assert page.empty.isVisible()
    assert page.showing is None


def test_the_values_under_the_cursor_are_read_out(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    page.viewport.point(MIDDLE)
    assert page.readout.text("Pixel") == "20, 15"
    surface = page.showing.maps.surface  # type: ignore[union-attr]
    assert page.readout.text("Roughness").startswith(f"{surface.roughness[15, 20]:.3f} ±")
    assert page.readout.text("Depth").endswith("scene units")
    opengl = page.readout.text("Normal")
    page.bar.frames.actions()[2].trigger()
    assert page.readout.text("Normal") != opengl
    until(qtbot, lambda: "camera frame" in page.grid.panels[1].legend.accessibleDescription())
    page.viewport.point(None)
    assert page.readout.text("Roughness") == "\u2013"


def test_exposure_redraws_the_photograph_and_nothing_else(
    page: MapsPage, qtbot: QtBot, two_runs: Path
) -> None:
    shown(page, two_runs, qtbot)
    photograph, normal = page.grid.panels[0].view.full, page.grid.panels[1].view.full
    assert photograph is not None
    before = photograph.pixelColor(1, 1).red()
    page.bar.ev.setValue(-6)
    until(qtbot, lambda: page.grid.panels[0].view.full.pixelColor(1, 1).red() < before)  # type: ignore[union-attr]
    assert page.bar.ev_label.text() == "\u22122.0 EV"
    settled(page, qtbot)
    assert page.grid.panels[1].view.full == normal


def test_a_double_click_enlarges_a_panel_and_brings_all_back(
    page: MapsPage, qtbot: QtBot, two_runs: Path
) -> None:
    shown(page, two_runs, qtbot)
    page.grid.panels[3].view.activated.emit()
    assert page.grid.count == 1
    assert page.grid.panels[0].layer == "roughness"
    settled(page, qtbot)
    page.grid.panels[0].view.activated.emit()
    assert page.grid.count == 6
    settled(page, qtbot)
    assert all(drawn(panel) for panel in page.grid.panels[:6])


def test_another_layer_is_drawn_when_it_is_chosen(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    panel = page.grid.panels[2]
    panel.set_layer("residual")
    until(qtbot, lambda: panel.legend.accessibleDescription().endswith("% of the radiance"))
    assert panel.view.accessibleName() == "Rendering error"


def test_keys_change_mode_and_view(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    active(page, qtbot)
    page.grid.panels[0].view.setFocus()
    before = page.bar.view_box.currentIndex()
    qtbot.keyClick(page.grid.panels[0].view, Qt.Key.Key_BracketRight)
    until(qtbot, lambda: page.bar.view_box.currentIndex() == before + 1)
    qtbot.keyClick(page.grid.panels[0].view, Qt.Key.Key_S)
    until(qtbot, lambda: page.pane is page.swipe)


def test_a_held_out_view_is_swiped_at_once(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    page.set_mode(1)
    until(qtbot, lambda: page.swipe.view.swipes)
    # The re-rendering was written ten percent too bright.
    assert "validation view" in page.swipe.said.text()
    assert "median 10.0 %" in page.swipe.said.text()
    assert page.swipe.difference.legend.accessibleDescription().startswith("\u221230 … 30 %")


def rerendering(page: MapsPage, session: Path, qtbot: QtBot, script: str) -> None:
    """The swipe pane at a view of the fit, with a stand-in for the child."""
    shown(page, session, qtbot)
    page.set_mode(1)
    page.bar.view_box.setCurrentIndex(0)
    settled(page, qtbot)
    page.swipe.errand._make_job = lambda name, task, request: job(script, name, task, request)


def test_arrows_stay_in_the_swipe_that_was_clicked(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    active(page, qtbot)
    page.bar.mode_picked.emit(1)
    assert page.swipe.view.hasFocus()
    qtbot.keyClick(page.swipe.view, Qt.Key.Key_Left)
    assert page.pane is page.swipe


def test_a_view_is_re_rendered_on_demand(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    script = """
emit("progress", fraction=0.5, note="view00")
hear()
emit("data", view=request["view"])
hear()
emit("done", result={})
"""
    rerendering(page, two_runs, qtbot, script)
    assert not page.swipe.view.swipes
    assert "not re-rendered" in page.swipe.said.text()
    page.swipe.errand.start.click()
    until(qtbot, lambda: page.swipe.errand.bar.value() == 500)
    run = runs.runs_of(two_runs)[0]
    found = maps.load(run)
    assert found.frames is not None
    folder = maps.rerendered_folder(run)
    folder.mkdir(parents=True)
    np.save(folder / "0000.npy", 0.8 * found.frames.radiance[0][found.surface.mask])
    page.swipe.errand.send("go")
    until(qtbot, lambda: page.swipe.view.swipes)
    until(qtbot, lambda: "median 20.0 %" in page.swipe.said.text())
    page.swipe.errand.send("go")
    until(qtbot, lambda: not page.swipe.errand.busy)


def test_another_view_is_wished_for_while_the_child_is_at_work(
    page: MapsPage, qtbot: QtBot, two_runs: Path
) -> None:
    script = """
said = hear()
emit("data", view=100 + said["view"])
hear()
"""
    rerendering(page, two_runs, qtbot, script)
    with qtbot.waitSignal(page.swipe.rendered, timeout=20_000) as heard:
        page.swipe.begin()
        page.bar.view_box.setCurrentIndex(5)
    assert heard.args == [105]
    page.swipe.errand.stop()


def test_the_child_goes_on_when_the_page_is_left(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    rerendering(page, two_runs, qtbot, WILLING)
    page.swipe.begin()
    child = page.swipe.errand._job
    assert child is not None
    page.hide()
    assert page.swipe.errand.busy
    page.swipe.errand.cancel.click()
    assert child.wait(20).ended


def test_a_childs_failure_is_told(page: MapsPage, qtbot: QtBot, two_runs: Path, shell: Shell) -> None:
    rerendering(
        page, two_runs, qtbot, 'emit("failed", message="the light is gone; process again", details="why")'
    )
    with qtbot.waitSignal(shell.wishes.trouble, timeout=20_000) as heard:
        page.swipe.begin()
    (fault,) = heard.args
    assert (fault.what, fault.remedy, fault.details) == ("the light is gone", "process again", "why")
    assert page.swipe.errand.start.isVisible()


def test_two_runs_are_compared_with_numbers(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    page.set_mode(2)
    until(qtbot, lambda: page.compare.comparison is not None)
    settled(page, qtbot)
    row = 2  # roughness
    assert [page.compare.table.item(row, column).text() for column in (0, 1, 4)] == [  # type: ignore[union-attr]
        "Roughness, 0 to 1", "0.1", "\u22120.1",
    ]  # fmt: skip
    assert "directions of light 2048 → 600" in page.compare.changed.text()
    page.compare.quantity.setCurrentIndex(row)
    until(qtbot, lambda: page.compare.difference.full is not None)
    until(qtbot, lambda: page.compare.legend.accessibleDescription().startswith("\u22120.1 … 0.1"))
    assert drawn(page.compare.first)
    assert drawn(page.compare.second)


def test_a_view_picked_elsewhere_is_turned_to_now_or_when_it_is_there(
    page: MapsPage, qtbot: QtBot, two_runs: Path, shell: Shell
) -> None:
    shell.state.session.set(two_runs)
    shell.state.view.set(7)
    shown(page, two_runs, qtbot)
    assert page.showing is not None
    assert page.showing.view == 7
    page.bar.step_view(1)
    assert shell.state.view.value == 8
    shell.state.view.set(7)
    assert page.showing.view == 7
    shell.state.session.set(None)
    assert shell.state.view.value is None


def test_another_session_can_stand_beside(
    page: MapsPage, qtbot: QtBot, two_runs: Path, tmp_path: Path
) -> None:
    other = furnace.finished(tmp_path / "bear.session", albedo=furnace.surface().albedo * 0.5)
    (other / "session.json").write_text("{}")
    shown(page, two_runs, qtbot)
    page.set_mode(2)
    page.compare_with_session(other)
    until(qtbot, lambda: page.compare.with_run.currentText().startswith("bear: "))
    until(
        qtbot,
        lambda: page.compare.comparison is not None and page.compare.comparison.of("albedo").known.max() < 0,
    )


def test_what_cannot_be_compared_says_why(
    page: MapsPage, qtbot: QtBot, two_runs: Path, tmp_path: Path
) -> None:
    other = furnace.finished(tmp_path / "bear.session", mask=~furnace.surface().mask)
    (other / "session.json").write_text("{}")
    shown(page, two_runs, qtbot)
    page.set_mode(2)
    page.compare_with_session(other)
    until(qtbot, lambda: "different objects" in page.compare.difference.message)


def test_a_folder_that_is_no_session_is_refused(
    page: MapsPage, qtbot: QtBot, two_runs: Path, shell: Shell
) -> None:
    shown(page, two_runs, qtbot)
    with qtbot.waitSignal(shell.wishes.trouble, timeout=5000):
        page.compare_with_session(two_runs / "stages")


def test_the_chosen_picture_is_saved_at_its_own_size(
    page: MapsPage, qtbot: QtBot, two_runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown(page, two_runs, qtbot)
    to = tmp_path / "normal.png"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *args: (str(to), ""))
    page.grid.panels[1].view.setFocus()
    page.save_picture()
    saved = QImage(str(to))
    assert (saved.width(), saved.height()) == (40, 30)
    page.copy_picture()


def test_a_run_that_was_removed_meanwhile_is_told(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    shutil.rmtree(two_runs / "stages" / "surface" / "older")
    page.bar.run_box.setCurrentIndex(1)
    page.bar.run_picked.emit(1)
    until(qtbot, lambda: "cannot be read back" in page.empty.what.text())


def test_every_control_has_a_name(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    shown(page, two_runs, qtbot)
    for mode in range(3):
        page.set_mode(mode)
        assert nameless(page) == []


def nameless(page: QWidget) -> list[QWidget]:
    controls = [
        *page.findChildren(QAbstractButton), *page.findChildren(QComboBox), *page.findChildren(QAbstractSlider),
    ]  # fmt: skip
    ours = [w for w in controls if w.isVisible() and not w.objectName().startswith("qt_")]
    return [
        w
        for w in ours
        if not (w.accessibleName() or w.text() if isinstance(w, QAbstractButton) else w.accessibleName())
    ]


def test_a_child_that_ends_at_once_leaves_the_button(page: MapsPage, qtbot: QtBot, two_runs: Path) -> None:
    rerendering(page, two_runs, qtbot, QUICK)
    page.swipe.begin()
    until(qtbot, lambda: not page.swipe.errand.busy)
    assert page.swipe.errand.start.isVisible()


def test_the_verdict_of_the_run_stands_over_its_maps(page: MapsPage, qtbot: QtBot, tmp_path: Path) -> None:
    session = furnace.finished(tmp_path / "lion.session")
    (report,) = session.glob("stages/surface/*/report.json")
    content = json.loads(report.read_text())
    content["values"] |= {"held_out_error": 0.5}
    report.write_text(json.dumps(content))
    shown(page, session, qtbot)
    assert page.verdict.isVisible()
    assert "not to be trusted" in page.verdict.text()
    assert "by 50 %" in page.verdict.text()
    page.show_session(None)
    assert page.verdict.isHidden()


# Measuring, and the scale


@pytest.fixture
def measured(page: MapsPage, tmp_path: Path, qtbot: QtBot) -> MapsPage:
    """The ball, with the row that measures."""
    camera = {"make": "", "model": "", "width": 40, "height": 30}
    sessions.create(tmp_path / "ball.session", "linear", camera)
    shown(page, furnace.finished(tmp_path / "ball.session"), qtbot)
    active(page, qtbot)
    page.setFocus()
    qtbot.keyClick(page, Qt.Key.Key_D)
    return page


def click(page: MapsPage, at: QPointF, qtbot: QtBot) -> None:
    view = page.grid.panels[1].view
    qtbot.mouseClick(view, Qt.MouseButton.LeftButton, pos=view.from_picture(at).toPoint())


ENDS = (QPointF(14.5 / 40, 15.5 / 40), QPointF(25.5 / 40, 15.5 / 40))


def test_two_clicks_measure_and_a_length_sets_the_scale_which_can_be_undone(
    measured: MapsPage, qtbot: QtBot
) -> None:
    row = measured.scale
    for end in ENDS:
        assert not row.set.isEnabled()
        click(measured, end, qtbot)
    apart = float(row.said.text().split()[0])
    assert row.said.text().endswith("scene units apart")
    assert 0.18 < apart < 0.21  # 11 of 44 pixels of focal length, at a depth of 0.75 to 0.8
    row.length.setValue(50.0)
    row.set.click()
    until(qtbot, lambda: measured.showing is not None and measured.showing.maps.unit == "mm")
    assert row.said.text() == "50 mm apart"
    folder = measured._session
    assert folder is not None
    kept = scale_edit.read(folder)
    assert kept is not None
    assert (kept.size, kept.length_m) == ((40, 30), 0.05)
    assert measured.showing is not None
    assert measured.showing.maps.unit_factor == pytest.approx(50.0 / apart, rel=1e-3)
    measured.undo_stack.undo()
    until(qtbot, lambda: measured.showing is not None and measured.showing.maps.unit == "scene units")
    assert scale_edit.read(folder) is None


def test_a_drag_marks_nothing_and_what_is_off_the_object_is_told(measured: MapsPage, qtbot: QtBot) -> None:
    view = measured.grid.panels[1].view
    qtbot.mousePress(view, Qt.MouseButton.LeftButton, pos=QPoint(60, 60))
    qtbot.mouseMove(view, QPoint(90, 60))
    qtbot.mouseRelease(view, Qt.MouseButton.LeftButton, pos=QPoint(90, 60))
    assert measured.viewport.marks == ()
    measured.viewport.fit("all")
    click(measured, ENDS[0], qtbot)
    click(measured, QPointF(0.5 / 40, 0.5 / 40), qtbot)
    measured.scale.length.setValue(50.0)
    assert "is off the object" in measured.scale.said.text()
    assert not measured.scale.set.isEnabled()


def test_a_scale_given_on_the_command_line_is_shown_without_a_new_run(
    measured: MapsPage, qtbot: QtBot
) -> None:
    folder = measured._session
    assert folder is not None
    bar = ScaleBar(((14.5, 15.5), (25.5, 15.5)), (40, 30), 0.05)
    scale_edit.write(sessions.open_session(folder), bar)
    measured.refresh()
    until(qtbot, lambda: measured.scale.said.text() == "50 mm apart")
    assert measured.scale.remove.isVisible()


def test_a_run_is_named_and_its_box_says_so(
    page: MapsPage, two_runs: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown(page, two_runs, qtbot)
    monkeypatch.setattr(QInputDialog, "getText", lambda *_, **__: ("curtain drawn", True))
    page.bar.name_wanted.emit()
    until(qtbot, lambda: page.bar.run_box.currentText() == "curtain drawn")
    assert "curtain drawn" not in page.bar.run_box.itemText(1)
