"""The charts page draws what the records hold, works out what is missing, and hands numbers out."""

import csv
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PySide6.QtCore import QPointF
from PySide6.QtGui import QFontMetrics, QImage
from pytestqt.qtbot import QtBot

from app.inspect import runs
from app.inspect.charting import TITLES
from app.relight.lights import coverage_file
from app.views.charts.page import ChartsPage
from app.views.pages import Shell
from tests.app import furnace
from tests.app.inspect.test_charting import half_seen
from tests.app.views.conftest import until
from tests.app.views.test_maps import nameless
from tests.app.work.children import WILLING, job


@pytest.fixture
def session(tmp_path: Path) -> Path:
    made = tmp_path / "lion.session"
    furnace.finished(made, "older", 1e9)
    return furnace.finished(made, "newer", 2e9)


@pytest.fixture
def page(qtbot: QtBot, shell: Shell, session: Path) -> ChartsPage:
    made = ChartsPage(None)
    qtbot.addWidget(made)
    made.use(shell)
    made.resize(1000, 640)
    made.show()
    made.show_session(session)
    until(qtbot, lambda: made.chart is not None)
    return made


def choose(page: ChartsPage, key: str, qtbot: QtBot) -> None:
    page.list.setCurrentRow(list(TITLES).index(key))
    until(qtbot, lambda: page.chart is not None and page.chart.key == key and not page._background.busy)


def keep_light(session: Path) -> None:
    light = half_seen()
    path = coverage_file(runs.runs_of(session)[0])
    path.parent.mkdir(parents=True)
    np.savez(path, radiance=light.radiance, seen=light.seen, clipped=light.clipped, view=np.array(light.view))


def test_without_results_it_says_what_to_do(qtbot: QtBot, shell: Shell, tmp_path: Path) -> None:
    page = ChartsPage(None)
    qtbot.addWidget(page)
    page.show()
    assert "No session is open" in page.message.what.text()
    page.show_session(tmp_path)
    until(qtbot, lambda: "no finished surface" in page.message.what.text())
    assert not page.export.isEnabled()


@pytest.mark.parametrize("key", list(TITLES))
def test_every_chart_is_drawn(page: ChartsPage, qtbot: QtBot, session: Path, key: str) -> None:
    keep_light(session)
    choose(page, key, qtbot)
    assert page.stack.currentWidget() is page._view
    assert page.heading.text()
    assert "{" not in page.said.text()
    assert page._view is not None
    image = page._view.grab().toImage()
    colours = {
        image.pixel(x, y) for x in range(60, image.width(), 9) for y in range(20, image.height() - 40, 5)
    }
    assert len(colours) > 2  # more than an empty frame
    assert nameless(page) == []


def test_bars_of_runs_keep_their_names_and_the_readout_goes_with_its_chart(
    page: ChartsPage, qtbot: QtBot
) -> None:
    choose(page, "times", qtbot)
    assert page.chart is not None
    assert [series.name for series in page.chart.series][:2] == ["Merge brackets", "Mask"]
    assert page._view is not None
    axis = page._view._plots[0][0].getAxis("left")
    widest = max(
        QFontMetrics(axis.style["tickFont"]).horizontalAdvance(name) for name in page.chart.ticks.values()
    )
    assert axis.minimumWidth() > widest
    narrowest = page.minimumSizeHint().width()
    page._view.pointed.emit(" · ".join(series.labels[0] for series in page.chart.series))
    assert page.pointed.text().count("standard") == 1
    assert page.minimumSizeHint().width() == narrowest
    choose(page, "distance", qtbot)
    assert page.pointed.text() == ""
    levels = page._view._plots[0][0].getAxis("bottom")._tickLevels
    assert len([at for at, _ in levels[0] if 0 <= at < 1]) <= 10


def drawn(page: ChartsPage) -> list[object]:
    """What stands on the plots; where the layout has put it to the pixel is settled only after some events."""
    assert page._view is not None
    facts: list[object] = []
    plot: Any
    for plot, _ in page._view._plots:
        box = plot.getViewBox()
        facts.append([type(item).__name__ for item in plot.items])
        facts.append([label.text for _, label in plot.legend.items])
        facts.append((plot.legend.isVisible(), box.yInverted(), box.state["limits"]["yLimits"]))
        facts.append([np.round(span, 2).tolist() for span in box.viewRange()])
        for name in ("bottom", "left"):
            axis = plot.getAxis(name)
            facts.append((axis.labelText, axis.label.isVisible(), axis.logMode, axis._tickLevels, axis.grid))
    return facts


def test_charts_follow_one_another_without_traces(page: ChartsPage, qtbot: QtBot, session: Path) -> None:
    """The same chart looks the same whatever was drawn before it, painted or not."""
    keep_light(session)
    keys = [key for key in TITLES if key != "views"]
    choose(page, "views", qtbot)
    first = drawn(page)
    for paint in (False, True):
        for key in keys:
            choose(page, key, qtbot)
            if paint:
                page.grab()
            choose(page, "views", qtbot)
            assert drawn(page) == first, key


def test_the_error_is_the_persons_choice(page: ChartsPage, qtbot: QtBot) -> None:
    choose(page, "errors", qtbot)
    page.error_box.setCurrentIndex(page.error_box.findData("stderr_normal_deg"))
    until(qtbot, lambda: page.chart is not None and "degrees" in page.chart.y_label)
    assert page.chart is not None
    assert page.chart.series[0].y == (1.1, 1.1)


def test_a_truth_can_be_chosen(page: ChartsPage, qtbot: QtBot, tmp_path: Path, shell: Shell) -> None:
    s = furnace.surface()
    names = ("normal", "albedo", "roughness", "depth", "mask")
    np.savez(tmp_path / "truth.npz", **{name: getattr(s, name) for name in names})
    page.use_truth(tmp_path / "truth.npz")
    until(qtbot, lambda: page.chart is not None and "truth" in page.chart.y_label and not page.chart.missing)
    with qtbot.waitSignal(shell.wishes.trouble, timeout=5000):
        page.use_truth(tmp_path / "nothing.npz")


def test_what_is_pointed_at_is_told(page: ChartsPage, qtbot: QtBot) -> None:
    choose(page, "views", qtbot)
    assert page._view is not None
    plot = page._view._plots[0][0]
    page._view._point(plot.getViewBox().mapViewToScene(QPointF(furnace.HELD_OUT[1], 4.0)))
    assert page.pointed.text().startswith("view06: median 10.0 %")


def test_numbers_and_pictures_are_handed_out(
    page: ChartsPage, qtbot: QtBot, tmp_path: Path, session: Path
) -> None:
    keep_light(session)
    for key in ("times", "coverage"):
        choose(page, key, qtbot)
        page.save_csv(tmp_path / "a.csv")
        page.save_picture(tmp_path / "a.png")
        page.save_picture(tmp_path / "a.svg")
        rows = list(csv.reader((tmp_path / "a.csv").open()))
        assert len(rows) > 3
        image = QImage(str(tmp_path / "a.png"))
        assert image.width() >= 1000
        root = ElementTree.parse(tmp_path / "a.svg").getroot()
        assert root.tag.endswith("svg")
        assert len(list(root.iter())) > 30


def test_a_place_that_may_not_be_written_is_told(
    page: ChartsPage, qtbot: QtBot, tmp_path: Path, shell: Shell
) -> None:
    choose(page, "times", qtbot)
    for save, name in ((page.save_csv, "a.csv"), (page.save_picture, "a.png"), (page.save_picture, "a.svg")):
        with qtbot.waitSignal(shell.wishes.trouble, timeout=5000) as heard:
            save(tmp_path / "no" / name)
        assert name in heard.args[0].what


def test_coverage_is_worked_out_on_demand(page: ChartsPage, qtbot: QtBot, session: Path) -> None:
    choose(page, "coverage", qtbot)
    assert page.stack.currentWidget() is page.message
    asked: list[tuple[str, dict]] = []

    def make(name, task, request):
        asked.append((task, dict(request)))
        keep_light(session)
        return job('emit("done", result={})', name, task, request)

    page.errand._make_job = make
    page.errand.start.click()
    until(qtbot, lambda: page.stack.currentWidget() is page._view)
    assert asked[0][0] == "coverage"
    assert asked[0][1]["fingerprint"] == "newer"
    assert not page.errand.start.isVisible()


def test_residuals_of_all_views_are_offered_and_go_on_until_they_are_stopped(
    page: ChartsPage, qtbot: QtBot
) -> None:
    choose(page, "views", qtbot)
    assert "2 of 9 views" in page.said.text()
    assert page.errand.start.isVisible()
    page.errand._make_job = lambda name, task, request: job(WILLING, name, task, request)
    page.errand.start.click()
    child = page.errand._job
    assert child is not None
    assert child.task == "rerender"
    page.hide()
    assert page.errand.busy
    page.errand.cancel.click()
    assert child.wait(20).ended


def test_charts_of_one_run_follow_the_run(page: ChartsPage, qtbot: QtBot, session: Path) -> None:
    report = session / "stages" / "surface" / "older" / "report.json"
    content = json.loads(report.read_text())
    del content["values"]["history"]  # as until version 46
    content["values"]["rough_residuals"] = [8.0, 4.0, 2.0]
    report.write_text(json.dumps(content))
    choose(page, "settling", qtbot)
    assert page.chart is not None
    assert page.chart.series[0].y == (3.0, 1.5)
    page.run_box.setCurrentIndex(1)
    page.run_box.activated.emit(1)
    until(qtbot, lambda: page.chart is not None and len(page.chart.series[0].y) == 3)
