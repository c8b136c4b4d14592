"""The Process page shows the plan and the run, and every edit of it is kept, shown and can be undone."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QCoreApplication, QEvent, Qt
from PySide6.QtGui import QImage
from pytestqt.qtbot import QtBot

from app import processing
from app.processing import CardState
from app.views.editors import Number
from app.views.pages import Shell
from app.views.process.page import ProcessPage
from app.views.process.stages import told
from app.views.trouble import TroubleDialog
from app.work.jobs import Job, JobState
from engine.results.quality import DOUBTFUL, Quality
from tests.app.plans import Questions
from tests.app.views.conftest import make_session, until
from tests.app.work.children import WILLING, job

PACED = """
emit("stage", name="poses", number=1, count=4)
emit("progress", fraction=0.25, note="matching")
while True:
    said = hear()
    if said is None or said["command"] == "cancel":
        emit("cancelled"); break
"""


@pytest.fixture
def script() -> str:
    return PACED


@pytest.fixture
def page(
    shell: Shell, session: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, script: str
) -> ProcessPage:
    def make(name: str, task: str, request: Mapping[str, Any]) -> Job:
        return job(script, name, task, request)

    monkeypatch.setattr(processing, "Job", make)
    shell.state.session.set(session)
    made = ProcessPage()
    qtbot.addWidget(made)
    made.use(shell)
    made.resize(1100, 640)
    made.show()
    until(qtbot, lambda: made.model is not None and made.model.plan.value is not None)
    return made


def asked(questions: Questions) -> list[dict[str, Any]]:
    return [question for question in questions.asked if question.get("keep")]


def number(page: ProcessPage, name: str) -> Number:
    control = page.parameters.fields[name].control
    assert isinstance(control, Number)
    return control


def test_the_column_shows_each_stage_and_chooses_the_first_to_run(page: ProcessPage) -> None:
    states = [page.column.card(row).state for row in range(page.column.count())]
    assert states == [CardState.DONE] * 2 + [CardState.STALE] * 4
    assert page.column.card(page.column.currentRow()).name == "poses"
    assert page.parameters.heading.text() == "Poses"
    assert page.bar.left.text() == "4 of 6 stages will run"
    assert page.bar.run.isEnabled()
    assert not page.bar.cancel.isEnabled()
    assert not page.grab().isNull()


def test_fields_stand_in_one_place_whatever_the_stage(page: ProcessPage, qtbot: QtBot) -> None:
    places = set()
    for stage in ("hdr", "light", "surface"):
        page.column.chosen.emit(stage)
        qtbot.wait(1)  # lets the layout settle
        places |= {field.x() for field in page.parameters.fields.values()}
    assert len(places) == 1


def test_what_another_page_or_program_made_stale_is_told_as_soon_as_the_page_is_seen_again(
    page: ProcessPage, questions: Questions, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    page.hide()
    questions.done = 1
    assert page.bar.left.text() == "4 of 6 stages will run"
    page.show()
    until(qtbot, lambda: page.bar.left.text() == "5 of 6 stages will run")
    questions.done = 6
    page.hide()
    page.show()
    until(qtbot, lambda: page.bar.left.text() == "all done")
    assert not page.bar.run.isEnabled()
    questions.done = 3
    monkeypatch.setattr(page, "isActiveWindow", lambda: True)
    QCoreApplication.sendEvent(page, QEvent(QEvent.Type.ActivationChange))
    until(qtbot, lambda: page.bar.left.text() == "3 of 6 stages will run")
    assert page.bar.run.isEnabled()


def test_a_gpu_that_is_found_stands_in_the_status_bar(
    shell: Shell, questions: Questions, qtbot: QtBot
) -> None:
    questions.gpu = "A card"
    page = ProcessPage()
    qtbot.addWidget(page)
    page.use(shell)
    until(
        qtbot,
        lambda: [(device.key, device.told) for device in shell.state.devices.value] == [("gpu", "A card")],
    )


def test_an_edit_is_kept_shows_what_it_touches_and_can_be_undone(
    page: ProcessPage, questions: Questions, qtbot: QtBot
) -> None:
    page.column.choose("hdr")
    number(page, "hdr.long_edge_px").setValue(1024)
    until(qtbot, lambda: page.column.card(0).state is CardState.STALE)
    assert asked(questions)[-1]["settings"]["hdr"] == {"long_edge_px": 1024}
    assert "longest edge" in told(page.column.card(0))
    assert page.undo_stack.undoText() == "Merge brackets: Longest edge"
    page.undo_stack.undo()
    until(qtbot, lambda: page.column.card(0).state is CardState.DONE)
    assert "hdr" not in asked(questions)[-1]["settings"]
    assert number(page, "hdr.long_edge_px").value() == 2048
    page.undo_stack.redo()
    until(qtbot, lambda: number(page, "hdr.long_edge_px").value() == 1024)


def test_edits_of_one_thing_in_a_row_are_one_undo(page: ProcessPage, qtbot: QtBot) -> None:
    page.column.choose("hdr")
    for value in (1024, 512, 256):
        number(page, "hdr.long_edge_px").setValue(value)
    assert page.undo_stack.count() == 1
    page.undo_stack.undo()
    until(qtbot, lambda: number(page, "hdr.long_edge_px").value() == 2048)


def test_quick_edits_back_and_forth_end_where_the_hand_left_them(
    page: ProcessPage, questions: Questions, qtbot: QtBot
) -> None:
    questions.at_once = False  # no plan arrives between the edits
    page.column.choose("surface")
    number(page, "surface.directions").setValue(4096)
    number(page, "surface.directions").setValue(2048)
    assert "surface" not in asked(questions)[-1]["settings"]


def test_defaults_bring_a_stage_back(page: ProcessPage, questions: Questions, qtbot: QtBot) -> None:
    page.column.choose("surface")
    number(page, "surface.directions").setValue(512)
    until(qtbot, lambda: page.parameters.back.isEnabled())
    page.parameters.back.click()
    assert "surface" not in asked(questions)[-1]["settings"]
    until(qtbot, lambda: not page.parameters.back.isEnabled())
    page.undo_stack.undo()
    until(qtbot, lambda: number(page, "surface.directions").value() == 512)


def test_preset_and_seed_are_edits(page: ProcessPage, questions: Questions, qtbot: QtBot) -> None:
    page.bar.preset.setFocus()
    qtbot.keyClick(page.bar.preset, Qt.Key.Key_Down)
    assert asked(questions)[-1]["settings"]["preset"] == "fine"
    page.bar.seed.setValue(5)
    assert asked(questions)[-1]["settings"]["seed"] == 5
    assert page.undo_stack.count() == 2


def test_advanced_parameters_wait_until_they_are_asked_for(page: ProcessPage) -> None:
    page.column.choose("hdr")
    assert list(page.parameters.fields) == ["hdr.long_edge_px"]
    page.parameters.all.click()
    assert "hdr.dark_sigmas" in page.parameters.fields


def test_a_run_shows_its_progress_and_ends_on_request(page: ProcessPage, qtbot: QtBot) -> None:
    page.start.trigger()
    until(qtbot, lambda: page.column.card(2).fraction == 0.25)
    assert page.column.card(2).state is CardState.RUNNING
    assert "25 %" in told(page.column.card(2))
    assert "matching" in told(page.column.card(2))
    assert not page.bar.run.isEnabled()
    assert page.bar.cancel.isEnabled()
    assert not page.grab().isNull()
    page.stop.trigger()
    until(qtbot, lambda: page.column.card(2).state is CardState.STALE)
    until(qtbot, lambda: page.bar.run.isEnabled())
    until(qtbot, lambda: "cancelled" in page.log.toPlainText())


@pytest.mark.parametrize(
    "script",
    [
        'emit("stage", name="poses", number=1, count=4); emit("failed", message="too few; take more", details="trace")'
    ],
)
def test_a_failure_is_told_once_on_the_card_and_in_a_dialog(page: ProcessPage, qtbot: QtBot) -> None:
    page.start.trigger()
    until(qtbot, lambda: page.column.card(2).state is CardState.FAILED)
    assert told(page.column.card(2)) == "Failed: too few; take more"
    until(qtbot, lambda: page.findChildren(TroubleDialog))
    assert page.model is not None
    page.model.refresh()
    qtbot.wait(20)
    (dialog,) = page.findChildren(TroubleDialog)
    assert (dialog.trouble.what, dialog.trouble.remedy, dialog.trouble.details) == (
        "too few",
        "take more",
        "trace",
    )
    dialog.close()


@pytest.mark.parametrize("script", [WILLING])
def test_processing_up_to_a_stage_asks_for_that(page: ProcessPage, shell: Shell, qtbot: QtBot) -> None:
    page.column.choose("light")
    page.parameters.run.click()
    (run,) = shell.board.queue
    assert run.request["until"] == "light"


def test_a_second_session_queues_behind_the_first(
    page: ProcessPage, shell: Shell, qtbot: QtBot, tmp_path: Path
) -> None:
    page.start.trigger()
    until(qtbot, lambda: page.bar.cancel.isEnabled())
    other = make_session(tmp_path / "bear.session")
    page.queue.added.emit(other)
    page.queue.added.emit(other)  # twice is once
    page.queue.added.emit(tmp_path / "nowhere")
    until(qtbot, lambda: page.queue.list.topLevelItemCount() == 2)
    assert [work.status.name for work in shell.board.queue] == ["lion", "bear"]
    assert str(other) not in shell.settings.value.recent  # which are those that were opened
    page.show_session(other)
    until(qtbot, lambda: page.column.count())
    assert not page.bar.run.isEnabled()
    assert page.bar.left.text() == "waits in the queue"
    assert page.bar.cancel.isEnabled()
    page.stop.trigger()
    assert shell.board.queue[1].status.state is JobState.CANCELLED
    assert shell.board.queue[0].status.active


def test_the_queue_is_moved_and_removed_by_hand(
    page: ProcessPage, shell: Shell, qtbot: QtBot, tmp_path: Path
) -> None:
    page.queue.hold.click()
    for name in ("bear", "owl", "fox"):
        page.queue.added.emit(make_session(tmp_path / f"{name}.session"))
    until(qtbot, lambda: page.queue.list.topLevelItemCount() == 3)
    page.tabs.setCurrentWidget(page.queue)
    page.queue.list.setCurrentItem(page.queue.list.topLevelItem(2))
    assert not page.queue.down.isEnabled()
    page.queue.up.click()
    until(qtbot, lambda: [work.status.name for work in shell.board.waiting] == ["bear", "fox", "owl"])
    until(qtbot, lambda: page.queue.list.indexOfTopLevelItem(page.queue.list.currentItem()) == 1)
    page.queue.remove.click()
    until(qtbot, lambda: [work.status.name for work in shell.board.queue] == ["bear", "owl"])


@pytest.mark.parametrize("script", ['emit("place", text="waits for one of 3 worker(s)")\n' + WILLING.replace(
    'emit("stage"', 'hear(); emit("place", text="on node7"); emit("stage"')])  # fmt: skip
def test_a_cluster_that_is_named_does_what_is_queued_and_rows_say_where(
    page: ProcessPage, shell: Shell, qtbot: QtBot
) -> None:
    page.queue.scheduler.setText(" tcp://head:8786 ")
    page.queue.scheduler.editingFinished.emit()
    assert shell.settings.value.scheduler == "tcp://head:8786"
    page.start.trigger()
    (run,) = shell.board.queue
    assert run.request["scheduler"] == "tcp://head:8786"
    until(qtbot, lambda: page.queue.told(run.status) == "waits for one of 3 worker(s)")
    run.send("go")
    until(qtbot, lambda: page.queue.told(run.status) == "on node7: Merge brackets, stage 1 of 1: 0 %")
    run.cancel()


def test_without_a_session_there_is_nothing_to_run(page: ProcessPage, qtbot: QtBot) -> None:
    page.show_session(None)
    until(qtbot, lambda: page.column.count() == 0)
    assert page.empty.what.text() == "No session is open"
    assert not page.bar.run.isEnabled()
    assert not page.parameters.isEnabled()


def test_undo_ends_at_the_session(page: ProcessPage, qtbot: QtBot, tmp_path: Path) -> None:
    page.column.choose("hdr")
    number(page, "hdr.long_edge_px").setValue(512)
    page.show_session(make_session(tmp_path / "bear.session"))
    assert page.undo_stack.count() == 0


def test_the_verdict_of_the_result_stands_over_the_stages_and_goes_with_it(page: ProcessPage) -> None:
    assert page.model is not None
    plan = page.model.plan.value
    assert plan is not None
    assert page.verdict.isHidden()
    doubted = Quality(DOUBTFUL, 1.4, "half of the normals are off.", "Add <views>.")
    page.model.plan.set(replace(plan, quality=doubted))
    page._show_plan()
    assert page.verdict.isVisible()
    assert page.verdict.text() == "<b>Quality: doubtful.</b> Half of the normals are off. Add &lt;views&gt;."
    page.model.plan.set(replace(plan, quality=None))
    page._show_plan()
    assert page.verdict.isHidden()


def picture(path: Path) -> Path:
    image = QImage(40, 30, QImage.Format.Format_RGB32)
    image.fill(Qt.GlobalColor.red)
    assert image.save(str(path))
    return path


def test_a_done_stage_shows_what_it_made(
    page: ProcessPage, questions: Questions, qtbot: QtBot, tmp_path: Path
) -> None:
    assert page.made.isHidden()  # of poses, which have not run
    facts = {"views": 8, "width": 480, "height": 360}
    questions.made = {"picture": str(picture(tmp_path / "made.png")), "facts": facts}
    page.column.choose("hdr")
    until(qtbot, page.made.isVisible)
    assert page.made.said.text().startswith("8 photographs of 480")
    assert page.made.picture.image.width() == 40
    page._plan_again()  # the same result is not asked for again
    qtbot.wait(20)
    assert [asked["stage"] for asked in questions.asked if asked["question"] == "made"] == ["hdr"]
    page.column.choose("poses")
    assert page.made.isHidden()


LOOKED_AT = """
emit("stage", name="surface", number=1, count=2)
for _ in range(2): emit("data", kind="preview", stage="surface", file=request["session"] + "/so-far.png")
emit("progress", fraction=0.25, note="solving pixels")
while hear() is not None: emit("done", result={}); break
"""


@pytest.mark.parametrize("script", [LOOKED_AT])
def test_normals_show_while_the_surface_is_solved(page: ProcessPage, session: Path, qtbot: QtBot) -> None:
    picture(session / "so-far.png")
    page.start.trigger()
    until(qtbot, page.made.isVisible)
    until(qtbot, lambda: "2. look" in page.made.said.text())
    page.stop.trigger()
    until(qtbot, page.made.isHidden)


def test_a_finished_run_leads_on_to_its_results(
    page: ProcessPage, shell: Shell, questions: Questions, qtbot: QtBot
) -> None:
    assert page.onward.isHidden()
    questions.done = 6
    assert page.model is not None
    page.model.refresh()
    until(qtbot, lambda: page.onward.isVisible())
    led: list[str] = []
    shell.wishes.show_page.connect(led.append)
    for button in page.leads.values():
        qtbot.mouseClick(button, Qt.MouseButton.LeftButton)
    assert led == ["maps", "view3d", "relight", "export"]
    questions.done = 4
    page.model.refresh()
    until(qtbot, lambda: page.onward.isHidden())
