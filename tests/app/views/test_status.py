"""The status bar shows room on the disk, devices, and the job under way."""

import shutil

import pytest
from pytestqt.qtbot import QtBot

from app.state import Device
from app.views.pages import Shell
from app.views.status import StatusBar
from tests.app.views.conftest import until
from tests.app.work.children import WILLING, job


@pytest.fixture
def bar(shell: Shell, qtbot: QtBot) -> StatusBar:
    made = StatusBar(None, shell.state, shell.board)
    qtbot.addWidget(made)
    made.show()
    return made


def test_free_space_is_shown_and_warned_of(
    bar: StatusBar, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, shell: Shell, tmp_path
) -> None:
    until(qtbot, lambda: bar.disk.accessibleDescription().endswith("free"))
    plain = bar.disk.text()
    usage = shutil.disk_usage(tmp_path)._replace(free=300_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: usage)
    shell.state.session.set(tmp_path)
    until(qtbot, lambda: bar.disk.accessibleDescription() == "300 MB free")
    assert bar.disk.text().split(">")[0] != plain.split(">")[0]
    assert bar.disk.toolTip() == str(tmp_path)


def test_a_disk_that_does_not_answer_is_no_fault(
    bar: StatusBar, qtbot: QtBot, shell: Shell, tmp_path
) -> None:
    until(qtbot, lambda: bar.disk.accessibleDescription().endswith("free"))
    shell.state.session.set(tmp_path / "unplugged")
    until(qtbot, lambda: bar.disk.accessibleDescription() == "disk?")


def test_devices_come_and_go(bar: StatusBar, shell: Shell) -> None:
    shell.state.set_device(Device("rig", "turntable", details="virtual:"))
    assert "turntable" in bar.devices.accessibleDescription()
    assert bar.devices.toolTip() == "virtual:"
    shell.state.drop_device("rig")
    assert "turntable" not in bar.devices.accessibleDescription()


@pytest.mark.parametrize("name", ["Report", "Export"])
def test_a_job_of_one_stage_is_named_once(bar: StatusBar, shell: Shell, qtbot: QtBot, name: str) -> None:
    task = name.lower()
    script = f'emit("stage", name="{task}", number=1, count=1); emit("progress", fraction=0.5, left_s=40)\n'
    shell.board.enqueue(job(script + WILLING.split("\n", 2)[2], name, task))
    until(qtbot, lambda: bar.bar.value() == 500)
    assert bar.job.text() == f"{name}  40 s left"  # the time that the task itself told
    shell.board.cancel_all()
    until(qtbot, lambda: not bar.job.isVisibleTo(bar))


def test_the_job_under_way_is_shown_with_how_many_follow(bar: StatusBar, shell: Shell, qtbot: QtBot) -> None:
    assert not bar.job.isVisibleTo(bar)
    script = (
        'emit("stage", name="light", number=1, count=1); emit("progress", fraction=0.5)\n'
        + WILLING.split("\n", 2)[2]
    )
    run = job(script, "lion")
    shell.board.enqueue(run)
    shell.board.enqueue(job(WILLING, "bear"))
    until(qtbot, lambda: bar.bar.value() == 500)
    assert bar.job.text() == "lion  Light  +1 more"
    assert bar.job.isVisibleTo(bar)
    with qtbot.waitSignal(bar.show_job):
        bar.job.click()
    shell.board.cancel_all()
    until(qtbot, lambda: not bar.job.isVisibleTo(bar))
