"""The page of a study: its document, and what it says of each run."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from spherecal import __version__
from spherecal.base.resources import resource_path
from spherecal_documents.report.model import Cell, Figure, Paragraph, Report, Section, Strong, Table
from spherecal_documents.report.pdf import page_pictures, pdf_bytes
from spherecal_documents.report.style import (
    BAD,
    CAUTION,
    GOOD,
    INK,
    MARKS,
    NONE,
    SERIES,
    SMALL_PT,
    SOFT,
    PageBox,
    Sheet,
    significant,
)
from spherecal_sim.rigs import rig_design
from spherecal_study.study_agreement import LEAST_RUNS, TESTS, Estimate, Judged

Figures = Sequence[float | Estimate]  # estimates are drawn with their standard errors
_HEIGHT_MM = 62.0  # of a drawing


@dataclass(frozen=True)
class PaperComparison:
    """A line of the table paper / ours; `pipeline` is the method that it is of."""

    what: str
    paper: str
    ours: str
    judged: Judged
    why: str = ""
    pipeline: str = ""


_TEXTS = tomllib.loads(resource_path("studies.toml").read_text(encoding="utf-8"))


def paper_line(study: str, name: str, judged: Judged, /, **values: object) -> PaperComparison:
    """A line of resources/studies.toml with these figures."""
    said = {part: text.format(**values) for part, text in _TEXTS[study][name].items()}
    return PaperComparison(judged=judged, **said)


class Document:
    """Collects blocks; to be made into a PDF within `report_style`. `compared`: the lines of its table paper / ours."""

    def __init__(self, heading: str, text: Sequence[str] = (), kind: str = "Study", title: str = "") -> None:
        self.heading = heading
        self.compared: tuple[PaperComparison, ...] = ()
        title, foot = title or f"SphereCal study: {heading}", f"{kind} by SphereCal {__version__}"
        self._report = Report(title, heading, "", (), foot)
        self._sections = [Section("", "", ())]
        for paragraph in text:
            self.paragraph(paragraph)

    def begin_section(self, title: str) -> None:
        """A section with its heading."""
        self._sections.append(Section("", title, ()))

    def _add(self, block: Paragraph | Table | Figure) -> None:
        last = self._sections[-1]
        self._sections[-1] = replace(last, blocks=(*last.blocks, block))

    def paragraph(self, text: str) -> None:
        """A paragraph."""
        self._add(Paragraph(text))

    def caption(self, text: str) -> None:
        """A paragraph in small grey type."""
        self._add(Paragraph(text, "note"))

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[Any]], left: int = 1) -> None:
        """A table whose first `left` columns hold words; of numbers three significant digits, None is not known."""
        self._add(Table(tuple(columns), tuple(tuple(map(_cell, row)) for row in rows), left))

    def figure(self, name: str, height_mm: float, draw: Callable[[Sheet, PageBox], object]) -> None:
        """A drawing as wide as the text."""
        self._add(Figure(name, height_mm, draw))

    def curves(
        self,
        series: Mapping[str, Mapping[int, float] | Mapping[int, Estimate]],
        x_label: str,
        y_label: str,
        log: bool = False,
        lines: Mapping[str, float] | None = None,
    ) -> None:
        """Curves over a number, each with its own mark."""

        def draw(sheet: Sheet, box: PageBox) -> None:
            axes = _axes(sheet, box)
            for number, (name, found) in enumerate(series.items()):
                style = {"color": SERIES[number % len(SERIES)], "marker": MARKS[number % len(MARKS)], "markersize": 3.5}
                y, errors = _drawn(list(found.values()))
                axes.errorbar(list(found), y, yerr=errors, label=name, capsize=2, elinewidth=0.8, **style)
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            for (name, level), style in zip((lines or {}).items(), ("--", ":", "-."), strict=False):
                axes.axhline(level, color=SOFT, linestyle=style, linewidth=0.9, label=name)
            if log:
                _log(axes)
            else:
                axes.set_ylim(bottom=0)
            _finish(axes, x_label, y_label)

        self.figure(y_label, _HEIGHT_MM, draw)

    def columns(
        self,
        groups: Sequence[str],
        series: Mapping[str, Figures],
        y_label: str,
        height: float = _HEIGHT_MM,
        log: bool = False,
        paper: Mapping[str, float] | None = None,
    ) -> None:
        """Columns side by side for each group, `height` mm high."""

        def draw(sheet: Sheet, box: PageBox) -> None:
            axes = _axes(sheet, box)
            width = 0.8 / max(len(series), 1)
            for number, (name, found) in enumerate(series.items()):
                x = np.arange(len(groups)) + (number - (len(series) - 1) / 2) * width
                values, errors = _drawn(found)
                known = np.nan_to_num(np.array(values, dtype=float))
                axes.bar(x, known, 0.92 * width, color=SERIES[number % len(SERIES)], label=name)
                if errors is not None:
                    axes.errorbar(x, values, yerr=errors, fmt="none", ecolor=INK, elinewidth=0.7, capsize=1.5)
            for name, level in (paper or {}).items():
                axes.axhline(level, color=SOFT, linestyle="--", linewidth=0.8, label=name)
            axes.set_xticks(np.arange(len(groups)), groups)
            if log:
                _log(axes)
            _finish(axes, "", y_label)

        self.figure(y_label, height, draw)

    def against_paper(self, rows: Sequence[PaperComparison], pipeline: str = "") -> Self:
        """The table paper / ours at its end, the reasons below it; `pipeline` of lines that name none."""
        self.compared = tuple(replace(row, pipeline=row.pipeline or pipeline) for row in rows)
        self.begin_section("Paper and ours")
        words: dict[str | None, Cell] = {
            "yes": Strong("yes", GOOD), "differs": Strong("differs", BAD),
            "cannot tell": Strong("cannot tell", CAUTION), None: NONE,
        }  # fmt: skip
        cells = [(row.what, row.paper, row.ours, words[row.judged.agrees], str(row.judged.runs)) for row in rows]
        self.table(("quantity", "paper", "ours", "agrees", "runs"), cells, 4)
        for test in dict.fromkeys(row.judged.test for row in rows if row.judged.test):
            self.caption(
                f"Test: {TESTS[test]}; on the other side it differs; fewer than {LEAST_RUNS} runs cannot tell."
            )
        for row in rows:
            if row.why:
                self.caption(f"{row.what}: {row.why}")
        return self

    def pdf(self) -> bytes:
        """The document as a PDF."""
        return pdf_bytes(self._whole())

    def pictures(self, dpi: float) -> list[bytes]:
        """Its pages as PNG files."""
        return page_pictures(self._whole(), dpi)

    def _whole(self) -> Report:
        return replace(self._report, sections=tuple(self._sections))


@dataclass(frozen=True)
class Options:
    """What all studies have as options: repetitions (seeds), image noise, the first seed, another rig."""

    runs: int
    sigma_px: float | None = 0.04  # None: rendered images, by default of the demo's small rig
    seed: int = 1
    preset: str | None = None
    known: bool = False  # intrinsics are, as in Algorithm 1 of [Tao21]
    paths: tuple[float, float, float, float] | None = None  # xi1, xi2, TH_er px, b

    @property
    def images(self) -> bool:
        """Whether images are rendered."""
        return self.sigma_px is None

    def rig(self, of_the_paper: str) -> str:
        """The preset of a study: the requested one, else the paper's, or the demo's where images are rendered."""
        return self.preset or ("demo" if self.images else of_the_paper)

    def plain(self, of_the_paper: str) -> dict[str, Any]:
        """The settings that all trials of a study have in common, but for the seed."""
        out: dict[str, Any] = {"preset": self.rig(of_the_paper), "sigma_px": self.sigma_px}
        if self.known:
            out["known"] = True
        if self.paths is not None:
            out["paths"] = list(self.paths)
        return out

    def rig_words(self, of_the_paper: str) -> str:
        """The rig in words, with the number of its cameras."""
        preset = self.rig(of_the_paper)
        name = {"rigA": "Rig A", "rigB": "Rig B", "demo": "The demo's rig"}.get(preset, f"Rig {preset}")
        return f"{name} ({self.cameras(of_the_paper)} cameras)"

    def cameras(self, of_the_paper: str) -> int:
        """How many cameras the rig has."""
        return len(rig_design(self.rig(of_the_paper)).places_mm)

    @property
    def seeds(self) -> range:
        """One seed a repetition."""
        return range(self.seed, self.seed + self.runs)

    def begin(self, title: str, study: str, **values: object) -> Document:
        """A document with its title and what was done, as resources/studies.toml says it."""
        document = Document(title, [text.format(**values) for text in _TEXTS[study]["about"]])
        seeds = f"seed {self.seed}" if self.runs == 1 else f"seeds {self.seed} to {self.seeds.stop - 1}"
        source = (
            "Rendered images, detected as recorded ones are"
            if self.sigma_px is None
            else f"Simulated observations, image noise {self.sigma_px:g} px a coordinate"
        )
        document.caption(
            f"{source}, {seeds}; the same seeds give the same page. Paper: [Tao21], IEEE TIM 70 (2021) 5016715."
        )
        if self.images or self.preset:
            document.caption("The paper's rig is another one: its figures can be compared in kind only.")
        return document


def _cell(value: Any) -> Cell:
    if isinstance(value, (str, Strong)):
        return value
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        return str(value)
    return significant(None if value is None else float(value), 3)


def _drawn(found: Figures) -> tuple[list[float], list[float] | None]:
    """Values and their standard errors, None where they have none."""
    estimates = [one for one in found if isinstance(one, Estimate)]
    if len(estimates) == len(found):
        return [one.mean for one in estimates], [one.error for one in estimates]
    return [one for one in found if not isinstance(one, Estimate)], None


def _axes(sheet: Sheet, box: PageBox) -> Axes:
    return sheet.axes(box.inset(15.0, 3.0, 46.0, 11.0))


def _log(axes: Axes) -> None:
    """A logarithmic axis with numbers as people write them."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    crowded = high > 500 * low
    axes.yaxis.set_minor_formatter(NullFormatter() if crowded else FuncFormatter(lambda value, _: _two_or_five(value)))


def _two_or_five(value: float) -> str:
    """The number where it is 2 or 5 of its decade, which are enough; else nothing."""
    return f"{float(f'{value:.1g}'):g}" if f"{value:.0e}"[0] in "25" else ""


def _finish(axes: Axes, x_label: str, y_label: str) -> None:
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.grid(axis="y", linewidth=0.3)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=SMALL_PT)
