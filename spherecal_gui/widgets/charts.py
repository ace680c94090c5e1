"""The charts, drawn by pyqtgraph in the window's colours."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QResizeEvent
from PySide6.QtWidgets import QSizePolicy

from spherecal.base.arrays import FloatArray, IntArray
from spherecal_gui import coverage as cov
from spherecal_gui import languages, theme
from spherecal_gui.presenters.bars_presenter import Errors
from spherecal_gui.widgets.basic import plain

pg.setConfigOptions(imageAxisOrder="row-major", antialias=True)


def _text(text: str, colour: str, size: float, anchor: tuple[float, float] = (0.5, 0.5), bold: bool = False):
    item = pg.TextItem(text, color=QColor(colour), anchor=anchor)
    item.setFont(theme.font(size, bold))
    return item


def _write_by_locale(axis: Any) -> None:  # Any: pyqtgraph has no types, and a method is put in place of its own
    plainly = axis.tickStrings
    axis.tickStrings = lambda *given: [languages.by_locale(text) for text in plainly(*given)]


_ROW_LINES = 5.5  # the height in lines of text that a row of coverage needs for names and shares above and below
_CAPTION_LINES = 2.8  # the name above and the share below, with their margins
_GAP_CELLS = 1.6  # between two grids
_TINT = 0.5  # of its colour in a cell that is covered: numbers and frames are read before it


class Chart(pg.PlotWidget):
    """A plot in the window's colours that leaves wheel and mouse alone."""

    def __init__(self) -> None:
        super().__init__()
        self.plot_item: Any = self.getPlotItem()  # pyqtgraph has no types
        self._drawn: object = None
        self.setMenuEnabled(False)
        self.hideButtons()
        self.setMouseEnabled(x=False, y=False)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        for side in ("left", "bottom"):
            _write_by_locale(self.getAxis(side))
        self.dress()

    def _is_drawn(self, *shown: object) -> bool:
        """Whether this was drawn last, in the size and look of now: a drawing takes 60 to 110 ms."""
        wanted = (theme.now(), theme.pt(1.0), self.width(), self.height(), *shown)
        same, self._drawn = wanted == self._drawn, wanted
        return same

    def span(self, x: tuple[float, float], y: tuple[float, float]) -> None:
        """Show exactly this range."""
        self.plot_item.setRange(xRange=x, yRange=y, padding=0)

    def dress(self) -> None:
        """Take the palette's colours."""
        c = theme.now()
        self.setBackground(c.surface)
        # room for the upper half of a number that stands at the very top
        self.plot_item.layout.setContentsMargins(0.0, QFontMetricsF(theme.font(10)).height() / 2, 0.0, 0.0)
        for side in ("left", "bottom"):
            axis = self.getAxis(side)
            axis.setPen(c.border)
            axis.setTextPen(c.soft)
            axis.setTickFont(theme.font(10))
            axis.setSIPrefixEnableRanges([])  # else pyqtgraph shows 0.01 as 10, and says so nowhere
            axis.enableAutoSIPrefix(False)

    def begin(self) -> theme.Colours:
        """Draw all again: nothing is in it any more, and it has the colours of now."""
        self.clear()
        self.dress()
        return theme.now()

    def names(self, bottom: str = "", left: str = "") -> None:
        """Name the axes."""
        for side, text in (("bottom", bottom), ("left", left)):
            self.getAxis(side).setLabel(text, color=theme.now().soft, **{"font-size": f"{theme.pt(10):.0f}pt"})


class CoverageChart(Chart):
    """The 10 x 10 cells of every camera's image: filled where any placement, lighter where this one, has dots."""

    def show_cells(
        self, cameras: Sequence[str], before: Sequence[IntArray], live: Sequence[IntArray], levels: Sequence[str]
    ) -> None:
        """Show the grids. `before`: dots in the cells (10, 10) of each camera, of the placements taken."""
        grids = tuple(grid.tobytes() for grid in (*before, *live))
        if self._is_drawn(tuple(cameras), grids, tuple(levels)):
            return
        c = self.begin()
        columns = max(1, int(np.ceil(np.sqrt(len(cameras)))))
        rows = max(1, int(np.ceil(len(cameras) / columns)))
        low = self.height() < rows * _ROW_LINES * self.fontMetrics().height()  # then the name is in the frame
        step_x = cov.CELLS + _GAP_CELLS
        gap = _GAP_CELLS if low else self._caption_cells(columns * step_x, rows)
        step_y = cov.CELLS + gap
        plot = self.plot_item
        plot.hideAxis("left")
        plot.hideAxis("bottom")
        plot.getViewBox().invertY(True)
        plot.getViewBox().setAspectLocked(True)
        for index, camera in enumerate(cameras):
            left, top = (index % columns) * step_x, (index // columns) * step_y
            item = pg.ImageItem(self._picture(before[index], live[index]), levels=(0, 255))
            item.setRect(QRectF(left, top, cov.CELLS, cov.CELLS))
            self.addItem(item)
            x, y = left + cov.CELLS * np.array([0, 1, 1, 0, 0]), top + cov.CELLS * np.array([0, 0, 1, 1, 0])
            self.addItem(pg.PlotCurveItem(x, y, pen=pg.mkPen(c.of(levels[index]), width=2.5)))
            share = round(100 * float(((before[index] + live[index]) > 0).mean()))
            name = _text(camera, c.text, 12, (0.5, 0.5 if low else 1.0), bold=True)
            name.setPos(left + cov.CELLS / 2, top + (cov.CELLS / 2 if low else 0.0))
            self.addItem(name)
            if low:
                continue
            level = "good" if share >= 100 * cov.LITTLE_COVERAGE else "caution"
            percent = _text(f"{share} %", c.of(level), 12, (0.5, 0.0), bold=True)
            percent.setPos(left + cov.CELLS / 2, top + cov.CELLS)
            self.addItem(percent)
        self.setRange(QRectF(-_GAP_CELLS / 2, -gap / 2, columns * step_x, rows * step_y), padding=0.01)

    def _caption_cells(self, across: float, rows: int) -> float:
        """The height in cells of the name above and the share below a grid, as large as the cells will be drawn."""
        captions = _CAPTION_LINES * QFontMetricsF(theme.font(12, bold=True)).height()
        cell = min(self.width() / across, (self.height() / rows - captions) / cov.CELLS)
        return captions / max(cell, 1.0)

    @staticmethod
    def _picture(before: IntArray, live: IntArray) -> np.ndarray:
        c = theme.now()
        picture = np.empty((*before.shape, 3), np.uint8)
        picture[:] = theme.rgb(c.window)
        for covered, colour in ((live, c.accent), (before, c.good)):
            picture[covered > 0] = theme.rgb(theme.mixed(c.window, colour, _TINT))
        return picture


class PairMatrix(Chart):
    """The dots that each two cameras have in common: numbers, red where too few, amber where weak, empty for none."""

    def show_common(self, cameras: Sequence[str], common: IntArray) -> None:
        """Show the matrix. `common`: the common dots of each two (c, c)."""
        if self._is_drawn(tuple(cameras), common.tobytes()):
            return
        c = self.begin()
        count = len(cameras)
        plot = self.plot_item
        plot.getViewBox().invertY(True)
        picture = np.empty((count, count, 3), np.uint8)
        picture[:] = theme.rgb(c.window)
        size = 12 if count <= 8 else 9
        while size > 7 and (count + 1) * QFontMetricsF(theme.font(size, True)).horizontalAdvance("0000") > self.width():
            size -= 1
        levels: dict[tuple[int, int], str] = {}
        for (i, j), dots in np.ndenumerate(common):
            if i != j and dots:
                levels[i, j] = "bad" if dots < cov.MIN_COMMON else "caution" if dots < cov.WEAK_COMMON else "good"
                picture[i, j] = theme.rgb(c.tint(levels[i, j]))
        if count:
            image = pg.ImageItem(picture, levels=(0, 255))
            image.setRect(QRectF(-0.5, -0.5, count, count))
            self.addItem(image)
        for (i, j), one in levels.items():
            if count <= 12:
                text = _text(str(common[i, j]), c.of(one), size, bold=True)
                text.setPos(j, i)
                self.addItem(text)
        for edge in np.arange(-0.5, count):
            for angle in (0, 90):
                self.addItem(pg.InfiniteLine(edge, angle=angle, pen=pg.mkPen(c.surface, width=2)))
        for side in ("left", "bottom"):
            self.getAxis(side).setTicks([list(enumerate(cameras))])
            self.getAxis(side).setTickFont(theme.font(size, True))
        widest = max((QFontMetricsF(theme.font(size, True)).horizontalAdvance(name) for name in cameras), default=0.0)
        self.getAxis("left").setWidth(int(widest) + 12)  # its own width is that of numbers
        self.setRange(QRectF(-0.5, -0.5, max(count, 1), max(count, 1)), padding=0.0)


class ConvergenceChart(Chart):
    """The cost of each iteration as a share of the first; two curves that stay, as a new plot stalls 5 times longer."""

    def __init__(self) -> None:
        super().__init__()
        self._earlier, self._latest = pg.PlotCurveItem(connect="finite"), pg.PlotCurveItem()
        self.addItem(self._earlier)
        self.addItem(self._latest)
        self.getAxis("left").setLogMode(True)
        self.getAxis("left").setStyle(maxTextLevel=0)
        self.getAxis("left").tickValues = lambda low, high, _: _decades(low, high)
        self._worn: tuple[theme.Colours, float] | None = None
        self._empty = False
        self.show_runs(())

    def show_runs(self, runs: Sequence[Sequence[float]]) -> None:
        """Show the costs of each run."""
        self._wear(theme.now())
        # each run against its own start: one of more dots costs more, and would look like a step back
        parts = [_fall(run) for run in runs]
        ends = np.cumsum([0.0, *(part[-1] for part in parts)])
        log = np.concatenate([part + end for part, end in zip(parts, ends[:-1], strict=True)] or [np.empty(0)])
        at, begun = np.arange(len(log), dtype=float), len(log) - (len(parts[-1]) if parts else 0)
        self._earlier.setData(at[: begun + 1], log[: begun + 1])
        self._latest.setData(at[begun:], log[begun:])
        if bool(runs) == self._empty:  # an axis that is shown again is laid out again, 20 ms
            self._empty = not runs
            for side in ("left", "bottom"):
                self.showAxis(side, bool(runs))
        if np.isfinite(log).any():
            low, high = float(np.nanmin(log)), float(np.nanmax(log))
            margin = 0.05 * (high - low) or 0.5
            self.span((0.0, max(len(log) - 1.0, 1.0)), (low - margin, high + margin))

    def _wear(self, colours: theme.Colours) -> None:
        if (colours, theme.pt(10)) == self._worn:
            return
        self._worn = colours, theme.pt(10)
        self.dress()
        self._earlier.setPen(pg.mkPen(colours.idle, width=2))
        self._latest.setPen(pg.mkPen(colours.accent, width=3))
        self.names(self.tr("iteration"), self.tr("misfit, 1 at the start"))


def _decades(low: float, high: float) -> list[tuple[float | None, list[float]]]:
    """Ticks with labels, then those without, of a logarithmic axis; nine labels in a decade covered each other."""
    exponents = range(math.floor(low), math.ceil(high) + 1)
    ticks = {digit: [e + math.log10(digit) for e in exponents] for digit in range(1, 10)}
    message = (1,) if high - low > 1.0 else (1, 2, 5)
    told = sorted(t for d in message for t in ticks[d] if low <= t <= high)
    return [(1.0, told), (None, sorted(t for d in ticks if d not in message for t in ticks[d] if low <= t <= high))]


def _fall(run: Sequence[float]) -> FloatArray:
    """Decimal logarithm of an adjustment's costs against its first, (n,); a cost of nothing counts as the least."""
    costs = np.asarray(run, dtype=float)
    some = costs[costs > 0]
    costs = np.maximum(costs, some.min() if len(some) else 1.0)
    return np.log10(costs / costs[0])


class ErrorChart(Chart):
    """The error of each measured length with its uncertainty interval k u, and the zero line."""

    _names: Sequence[str] = ()

    def show_errors(self, shown: Errors) -> None:
        """Show errors with k u, and where there is a limit that with its guard band."""
        names, errors, allowed, exceeding = shown.names, shown.errors, shown.allowed, shown.exceeding
        c = self.begin()
        self.addItem(pg.InfiniteLine(0.0, angle=0, pen=pg.mkPen(c.text, width=1.5)))
        where = np.arange(len(errors), dtype=float)
        self.addItem(pg.BarGraphItem(x=where, y0=-allowed, y1=allowed, width=0.62, brush=QColor(c.border), pen=None))
        self._draw_limit(where, shown)
        brushes = [QColor(c.bad if beyond else c.good) for beyond in exceeding]
        symbols = ["x" if beyond else "o" for beyond in exceeding]
        texts = (f"{' '.join(name.split())}\n{error:+.3f} mm" for name, error in zip(names, errors, strict=True))
        said = [plain(languages.by_locale(text)) for text in texts]
        look = {"size": 14, "brush": brushes, "symbol": symbols, "pen": pg.mkPen(c.surface, width=1)}
        dots = pg.ScatterPlotItem(where, errors, **look, data=said, hoverable=True, tip=lambda x, y, data: str(data))
        self.addItem(dots)
        self._names = names
        self._label()
        self.getAxis("bottom").setHeight(int(theme.pt(44)))
        permitted = shown.permitted if shown.permitted is not None else np.zeros(1)
        most = float(max(*(np.abs(one).max(initial=0) for one in (allowed, errors, permitted)))) or 1.0
        self.span((-0.6, max(len(errors) - 0.4, 0.6)), (-1.15 * most, 1.15 * most))
        self.names("", "mm")

    def _label(self) -> None:
        """As many names as there is room for: all, else one for each pose of the bar, else some of these."""
        ticks = list(enumerate(self._names))
        if not ticks:
            return
        metrics = QFontMetricsF(theme.font(10))
        room = max(self.width() - theme.pt(70), 100.0)

        def fits(shown: list[tuple[float, str]]) -> bool:
            widest = max(metrics.horizontalAdvance(line) for _, name in shown for line in name.split("\n"))
            return len(shown) * (widest + 8) <= room

        found: list[tuple[float, str]] = [(float(i), name) for i, name in ticks]
        if not fits(found):
            poses: dict[str, list[int]] = {}
            for i, name in ticks:
                poses.setdefault(name.split("\n")[0], []).append(i)
            found = [(sum(at) / len(at), pose) for pose, at in poses.items()]
        while len(found) > 1 and not fits(found):
            found = found[::2]
        self.getAxis("bottom").setTicks([found])

    def resizeEvent(self, ev: QResizeEvent) -> None:
        """There is room for more names, or for fewer."""
        super().resizeEvent(ev)
        self._label()

    def _draw_limit(self, where: FloatArray, shown: Errors) -> None:
        """The limit on both sides and, inside it, the guard band in which nothing can be decided."""
        if shown.permitted is None or shown.guard is None:
            return
        c, inner = theme.now(), np.maximum(shown.permitted - shown.guard, 0.0)
        amber = QColor(c.caution)
        amber.setAlpha(70)
        edges = np.repeat(where, 2) + np.tile([-0.5, 0.5], len(where))
        for side in (1.0, -1.0):
            ends = {"y0": side * inner, "y1": side * shown.permitted}
            self.addItem(pg.BarGraphItem(x=where, **ends, width=1.0, brush=amber, pen=pg.mkPen(None)))
            self.plot(edges, side * np.repeat(shown.permitted, 2), pen=pg.mkPen(c.bad, width=2))


class HistogramChart(Chart):
    """How often residuals of each size occur."""

    def show_values(self, values: FloatArray, limit: float) -> None:
        """Show residuals. `values`: residuals (n,), px; `limit`: largest size that is shown, px."""
        c = self.begin()
        counts, edges = np.histogram(np.clip(values, -limit, limit), bins=41, range=(-limit, limit))
        width = float(edges[1] - edges[0])
        middles = (edges[:-1] + edges[1:]) / 2
        self.addItem(pg.BarGraphItem(x=middles, height=counts, width=0.92 * width, brush=c.accent, pen=None))
        self.span((-1.04 * limit, 1.04 * limit), (0, 1.08 * max(counts.max(initial=0), 1)))
        self.names(self.tr("residual, px"), self.tr("dots"))
