"""Draws a chart of `app/inspect/charting.py` with pyqtgraph, in the colours of the theme; exports it as PNG or SVG.

pyqtgraph takes a second to load: this module is imported only once a chart is to be drawn.
"""

# pyqtgraph adds its classes' methods at run time.
# pyrefly: ignore-errors[missing-attribute]

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QBuffer, QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFont, QFontMetrics, QImage, QPaintDevice, QPainter
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QGraphicsScene, QStackedLayout, QWidget

from app.inspect.charting import Chart, Series
from app.views.theme import Palette, colours

BAR = 0.72
NEAR_PX = 24.0
NAMED = 8  # points that still have room for their names
SLOTS = 4  # rows of lying bars there is room for at least: one alone is no wall
AXIS_PX = (
    60,
    44,
)  # width on the left, height below: fitted to their ticks, charts would jump when another is chosen
TICK_PX = 16  # a tick, and the space between it and its name


class ChartView(QWidget):
    """One chart; tells what is under the mouse.

    Plots are kept from chart to chart: making one takes a twentieth of a second of the window's thread.
    """

    pointed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._chart: Chart | None = None
        self._stack = QStackedLayout(self)
        self._single = self._canvas()
        self._plot = self._single.addPlot()
        self._pair: tuple[pg.GraphicsLayoutWidget, Any, Any] | None = None  # canvas, panorama, shares
        self._plots: list[tuple[pg.PlotItem, tuple[Series, ...]]] = []

    @property
    def canvas(self) -> pg.GraphicsLayoutWidget:
        """What is shown."""
        return self._stack.currentWidget()  # pyrefly: ignore[bad-return]

    def show_chart(self, chart: Chart) -> None:
        """Draw; an empty chart says why it is empty in the page's own words, not here."""
        self._chart = chart
        ours = colours(self)
        if chart.image is not None:
            self._draw_panorama(chart, ours)
        else:
            self._stack.setCurrentWidget(self._single)
            self._plot.clear()
            self._dress(self._plot, chart, ours)
            self._draw(self._plot, chart, ours)
            self._plots = [(self._plot, chart.series)]
        self.canvas.setBackground(QColor(ours.field))
        self.canvas.setAccessibleDescription(f"{chart.title}. {chart.said}".format(**chart.facts))

    def _canvas(self) -> pg.GraphicsLayoutWidget:
        canvas = pg.GraphicsLayoutWidget(self)
        canvas.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        canvas.setAccessibleName(self.tr("Chart"))
        canvas.scene().sigMouseMoved.connect(self._point)
        self._stack.addWidget(canvas)
        return canvas

    def save(self, to: Path) -> None:
        """Write the chart as it stands, as PNG (twice the size on the screen) or SVG.

        Raises:
            OSError: the file cannot be written.
        """
        scene, size = self.canvas.scene(), self.canvas.size()
        if to.suffix.lower() == ".svg":
            # pyqtgraph's own SVG stumbles over paths of this Qt; Qt's generator takes what is painted.
            drawing = QSvgGenerator()
            drawing.setOutputDevice(buffer := QBuffer())
            drawing.setSize(size)
            drawing.setViewBox(QRectF(QPointF(0, 0), size.toSizeF()))
            drawing.setTitle(self._chart.title if self._chart else "")
            self._paint(drawing, scene, QRectF(QPointF(0, 0), size.toSizeF()))
            to.write_bytes(bytes(buffer.data().data()))
            return
        image = QImage(size * 2, QImage.Format.Format_RGB32)
        self._paint(image, scene, QRectF(image.rect()))
        buffer = QBuffer()
        image.save(buffer, "PNG")  # pyrefly: ignore[no-matching-overload] wants no bytes
        to.write_bytes(bytes(buffer.data().data()))

    def _paint(self, device: QPaintDevice, scene: QGraphicsScene, on: QRectF) -> None:
        painter = QPainter(device)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(on, QColor(colours(self).field))
        scene.render(painter, on, QRectF(QPointF(0, 0), self.canvas.size().toSizeF()))
        painter.end()

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange and self._chart is not None:
            self.show_chart(self._chart)
        super().changeEvent(event)

    # Drawing

    def _dress(self, plot: pg.PlotItem, chart: Chart, ours: Palette) -> None:
        plot.setMenuEnabled(False)
        plot.hideButtons()
        plot.setMouseEnabled(True, True)
        plot.invertY(chart.lying)
        plot.getViewBox().setLimits(yMin=-1e307)  # none
        plot.setLogMode(x=chart.log_x, y=chart.log_y)
        plot.showGrid(x=chart.lying or not chart.ticks, y=not chart.lying, alpha=0.18)
        small = QFont(self.font())
        small.setPixelSize(11)
        below, above = (chart.y_label, "") if chart.lying else (chart.x_label, chart.y_label)
        # Over the plot it is read without turning one's head, and is whole in a low window.
        plot.setTitle(above or None, color=ours.dim, size="9pt", justify="left")
        named = "left" if chart.lying else "bottom"
        for name in ("bottom", "left"):
            axis = plot.getAxis(name)
            axis.setPen(pg.mkPen(ours.line))
            axis.setTextPen(pg.mkPen(ours.dim))
            axis.setTickFont(small)
            axis.enableAutoSIPrefix(False)
            ticks = [list(chart.ticks.items())] if chart.ticks and name == named else None
            if chart.log_x if name == "bottom" else chart.log_y:
                ticks = _round([value for s in chart.series for value in (s.x if name == "bottom" else s.y)])
            axis.setTicks(ticks)
        plot.setLabel("bottom", below, **{"color": ours.dim, "font-size": "9pt"})
        plot.showLabel("bottom", bool(below))
        names = QFontMetrics(small)
        widest = max(map(names.horizontalAdvance, chart.ticks.values()), default=0) if chart.lying else 0
        plot.getAxis("left").setWidth(max(AXIS_PX[0], widest + TICK_PX))
        plot.getAxis("bottom").setHeight(AXIS_PX[1])
        legend = plot.addLegend(offset=(-12, 8), labelTextSize="9pt")
        legend.setLabelTextColor(ours.text)
        legend.setBrush(pg.mkBrush(QColor(ours.panel)))
        legend.setPen(pg.mkPen(ours.line))
        legend.setVisible(len(chart.series) > 1)
        # Lying bars leave room below, standing ones above.
        end, aside = (1, -8) if chart.lying else (0, 8)
        legend.anchor((1, end), (1, end), offset=(-12, aside))

    def _draw(self, plot: pg.PlotItem, chart: Chart, ours: Palette) -> None:
        if chart.lying:
            self._draw_lying(plot, chart, ours)
            return
        below: dict[float, float] = {}
        bars = [series for series in chart.series if series.kind == "bars"]
        for series in chart.series:
            colour = QColor(ours.series[series.colour % len(ours.series)])
            x, y = np.array(series.x, float), np.array(series.y, float)
            if series.kind == "bars":
                base = (
                    np.array([below.get(at, 0.0) for at in series.x]) if chart.stacked else np.zeros(len(x))
                )
                plot.addItem(
                    pg.BarGraphItem(
                        x=x,
                        height=y,
                        y0=base,
                        width=BAR,
                        brush=colour,
                        pen=pg.mkPen(ours.field),
                        name=series.name,
                    )
                )
                if series.upper:
                    top = np.array(series.upper) - y
                    plot.addItem(
                        pg.ErrorBarItem(
                            x=x, y=y, top=top, bottom=0 * top, beam=BAR / 3, pen=pg.mkPen(ours.dim)
                        )
                    )
                for at, value in zip(series.x, series.y, strict=True):
                    below[at] = below.get(at, 0.0) + value
            elif series.kind == "mark":
                at = float(np.log10(x[0])) if chart.log_x else float(x[0])
                pen = pg.mkPen(colour, width=2, style=Qt.PenStyle.DashLine)
                plot.addItem(pg.InfiniteLine(at, 90, pen=pen))
                plot.plot([], [], pen=pen, name=series.name)
            else:
                line = pg.mkPen(colour, width=2) if series.kind == "line" and len(x) > 1 else None
                plot.plot(
                    x, y, pen=line, symbol="o", symbolSize=9, symbolBrush=colour, symbolPen=pg.mkPen(ours.field),
                    name=series.name, antialias=True,
                )  # fmt: skip
                if len(series.labels) <= NAMED:
                    for i, (at, value, label) in enumerate(zip(x, y, series.labels, strict=False)):
                        # Above and below by turns, and towards the middle: names of near points stay apart.
                        aside = 1.0 if at > 0.6 * max(x) else 0.5
                        text = pg.TextItem(label, QColor(ours.dim), anchor=(aside, -0.5 if i % 2 else 1.5))
                        text.setFont(plot.getAxis("left").style["tickFont"])
                        text.setPos(at, value)
                        plot.addItem(text, ignoreBounds=True)
        tops = [*below.values(), *(u for s in bars for u in s.upper)]
        if not bars and not chart.log_y:
            tops = [value for series in chart.series for value in series.y]
        if tops and not chart.log_y:
            plot.setYRange(0, (max(tops) or 1.0) * (1.06 if bars else 1.2), padding=0)
            plot.getViewBox().setLimits(yMin=0)
        if chart.log_y and len(chart.series) > 1:
            # Room for the legend, which else lies over what rises to the right.
            heights = [math.log10(value) for series in chart.series for value in series.y if value > 0]
            room = max(0.3 * (max(heights) - min(heights)), 0.1)
            plot.setYRange(min(heights) - 0.1 * room, max(heights) + room, padding=0)
        ends = [value for series in chart.series for value in series.x]
        if chart.x_range is not None:
            plot.setXRange(*chart.x_range, padding=0)
        elif not bars and not chart.log_x and ends:
            # From zero: a time of one run alone would else stand on an axis of tenths of seconds.
            plot.setXRange(0, 1.12 * max(ends), padding=0)

    def _draw_lying(self, plot: pg.PlotItem, chart: Chart, ours: Palette) -> None:
        left: dict[float, float] = {}
        for series in chart.series:
            start = np.array([left.get(at, 0.0) for at in series.x])
            colour = QColor(ours.series[series.colour % len(ours.series)])
            plot.addItem(
                pg.BarGraphItem(
                    x0=start, width=np.array(series.y), y=np.array(series.x), height=0.6, brush=colour,
                    pen=pg.mkPen(ours.field), name=series.name,
                )
            )  # fmt: skip
            for at, value in zip(series.x, series.y, strict=True):
                left[at] = left.get(at, 0.0) + value
        plot.setMouseEnabled(False, False)
        plot.setXRange(0, max(left.values(), default=1.0) * 1.02, padding=0)
        rows = len(left)
        plot.setYRange(-0.7, max(rows, SLOTS) - 0.3, padding=0)

    def _draw_panorama(self, chart: Chart, ours: Palette) -> None:
        """The panorama, and under it two lying bars: of the sphere, and of the light."""
        assert chart.image is not None
        if self._pair is None:
            canvas = self._canvas()
            self._pair = canvas, canvas.addPlot(row=0, col=0), canvas.addPlot(row=1, col=0)
        canvas, above, below = self._pair
        self._stack.setCurrentWidget(canvas)
        above.clear()
        below.clear()
        frame = Chart("", "", "azimuth [degrees]: 0 ahead, -90 left, +90 right", "from up [degrees]", ())
        self._dress(above, frame, ours)
        above.showGrid(x=False, y=False)
        image = pg.ImageItem(chart.image[..., [2, 1, 0, 3]], axisOrder="row-major")
        image.setRect(QRectF(-180, 0, 360, 180))
        above.addItem(image)
        above.invertY(True)
        above.setMouseEnabled(False, False)
        above.getViewBox().setAspectLocked(True)
        above.setRange(xRange=(-180, 180), yRange=(0, 180), padding=0)
        above.getAxis("bottom").setTicks([[(at, f"{at}") for at in range(-180, 181, 45)]])
        above.getAxis("left").setTicks([[(at, f"{at}") for at in range(0, 181, 45)]])
        self._dress(below, chart, ours)
        self._draw_lying(below, chart, ours)
        below.setYRange(-1.5, 1.5, padding=0)
        below.setFixedHeight(160)
        below.legend.setColumnCount(len(chart.series))
        below.legend.anchor((1, 0), (1, 0), offset=(-8, 0))
        self._plots = [(below, chart.series)]

    # Pointing

    def _point(self, scene_at: QPointF) -> None:
        if self._chart is None:
            return
        best, text = NEAR_PX, ""
        for plot, all_series in self._plots:
            box = plot.getViewBox()
            if not plot.sceneBoundingRect().contains(scene_at):
                continue
            lying = self._chart.lying
            for series in all_series:
                for x, y, label in zip(series.x, series.y, series.labels, strict=False):
                    at = QPointF(
                        float(np.log10(x)) if self._chart.log_x and x > 0 else x,
                        float(np.log10(y)) if self._chart.log_y and y > 0 else y,
                    )
                    there = box.mapViewToScene(at)
                    if lying:
                        there = box.mapViewToScene(QPointF(box.mapSceneToView(scene_at).x(), x))
                        away = abs(there.y() - scene_at.y())
                    elif series.kind == "bars":
                        away = abs(there.x() - scene_at.x())
                    else:
                        away = (there - scene_at).manhattanLength()
                    if away < best:
                        best, text = away, label
                    elif away == best and label:
                        text = f"{text} · {label}"
        self.pointed.emit(text)


def _round(values: Sequence[float]) -> list[list[tuple[float, str]]]:
    """Where a logarithmic axis has numbers: few a decade, unless there is but one."""
    few = max(values, default=1.0) > 10 * min(values, default=1.0)
    digits = (1, 2, 5) if few else (1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9)
    return [[(k + math.log10(digit), f"{digit * 10.0**k:g}") for k in range(-6, 7) for digit in digits]]
