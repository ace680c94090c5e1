"""The page of a study: its document, and what it says of each run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from spherecal import __version__
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
from spherecal_study.executor import Trial
from spherecal_study.study_agreement import LEAST_RUNS, TESTS, Verdict


class Document:
    """Collects blocks; to be made into a PDF within `report_style`."""

    def __init__(self, title: str, heading: str, foot: str) -> None:
        self.heading = heading
        self._report = Report(title, heading, "", (), foot)
        self._sections = [Section("", "", ())]

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

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[Cell]], left: int = 1) -> None:
        """A table whose first `left` columns hold words."""
        self._add(Table(tuple(columns), tuple(map(tuple, rows)), left))

    def figure(self, name: str, height_mm: float, draw: Callable[[Sheet, PageBox], object]) -> None:
        """A drawing as wide as the text."""
        self._add(Figure(name, height_mm, draw))

    def pdf(self) -> bytes:
        """The document as a PDF."""
        return pdf_bytes(self._whole())

    def pictures(self, dpi: float) -> list[bytes]:
        """Its pages as PNG files."""
        return page_pictures(self._whole(), dpi)

    def _whole(self) -> Report:
        return replace(self._report, sections=tuple(self._sections))


Results = list[dict[str, Any]]


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


@dataclass(frozen=True)
class PaperComparison:
    """A line of the table paper / ours."""

    what: str
    paper: str
    ours: str
    agrees: Verdict | None  # None where it is no matter of agreeing
    why: str = ""
    test: str = ""  # one of study_agreement.TESTS
    runs: int = 0  # behind the line
    pipeline: str = ""  # which method it is of


def begin(title: str, options: Options, text: Sequence[str]) -> Document:
    """A document with its title and what was done."""
    document = Document(f"SphereCal study: {title}", title, f"Study by SphereCal {__version__}")
    for paragraph in text:
        document.paragraph(paragraph)
    seeds = f"seed {options.seed}" if options.runs == 1 else f"seeds {options.seed} to {options.seeds.stop - 1}"
    source = (
        "Rendered images, detected as recorded ones are"
        if options.sigma_px is None
        else f"Simulated observations, image noise {options.sigma_px:g} px a coordinate"
    )
    document.caption(
        f"{source}, {seeds}; the same seeds give the same page. Paper: [Tao21], IEEE TIM 70 (2021) 5016715."
    )
    if options.images or options.preset:
        document.caption("The paper's rig is another one: its figures can be compared in kind only.")
    return document


def with_seeds(listed: Sequence[Trial], results: Results) -> list[tuple[Trial, dict[str, Any]]]:
    """Trials and their results, each result with the seed of its trial."""
    return [(t, {**r, "seed": t.settings["seed"]}) for t, r in zip(listed, results, strict=True)]


def pairs(one: Results, other: Results) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Results of two methods on the same seeds: a series that is not finished may lack some of either."""
    by_seed = {r["seed"]: r for r in other}
    return [(r, by_seed[r["seed"]]) for r in one if r["seed"] in by_seed]


@dataclass(frozen=True)
class StudyPage:
    """A study's page and the lines of its table paper / ours."""

    document: Document
    compared: tuple[PaperComparison, ...]


def paper_table(document: Document, rows: Sequence[PaperComparison], pipeline: str = "") -> StudyPage:
    """The page with the table paper / ours at its end, the reasons below it; `pipeline` of lines that name none."""
    rows = [replace(row, pipeline=row.pipeline or pipeline) for row in rows]
    document.begin_section("Paper and ours")
    words: dict[str | None, Cell] = {
        "yes": Strong("yes", GOOD), "differs": Strong("differs", BAD), "cannot tell": Strong("cannot tell", CAUTION),
        None: NONE,
    }  # fmt: skip
    cells = [(row.what, row.paper, row.ours, words[row.agrees], str(row.runs)) for row in rows]
    document.table(("quantity", "paper", "ours", "agrees", "runs"), cells, 4)
    for test in dict.fromkeys(row.test for row in rows if row.test):
        document.caption(
            f"Test: {TESTS[test]}; on the other side it differs; fewer than {LEAST_RUNS} runs cannot tell."
        )
    for row in rows:
        if row.why:
            document.caption(f"{row.what}: {row.why}")
    return StudyPage(document, tuple(rows))


def table(document: Document, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Add a table to a document; numbers have three significant digits, None is shown as not known."""
    document.table(columns, [[_cell(value) for value in row] for row in rows])


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        return str(value)
    return significant(None if value is None else float(value), 3)


def curves(
    document: Document,
    series: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    x_label: str,
    y_label: str,
    height: float = 62.0,
    log: bool = False,
    lines: Mapping[str, float] | None = None,
    errors: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Add curves over a number to a document, each with its own mark, `height` mm high."""

    def draw(sheet: Sheet, box: PageBox) -> None:
        axes = _axes(sheet, box)
        for number, (name, (x, y)) in enumerate(series.items()):
            style = {"color": SERIES[number % len(SERIES)], "marker": MARKS[number % len(MARKS)], "markersize": 3.5}
            axes.errorbar(x, y, yerr=(errors or {}).get(name), label=name, capsize=2, elinewidth=0.8, **style)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        for (name, level), style in zip((lines or {}).items(), ("--", ":", "-."), strict=False):
            axes.axhline(level, color=SOFT, linestyle=style, linewidth=0.9, label=name)
        if log:
            _log(axes)
        else:
            axes.set_ylim(bottom=0)
        _finish(axes, x_label, y_label)

    document.figure(y_label, height, draw)


def columns_by_group(
    document: Document,
    groups: Sequence[str],
    series: Mapping[str, Sequence[float]],
    y_label: str,
    height: float = 62.0,
    log: bool = False,
    paper: Mapping[str, float] | None = None,
    errors: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Add columns side by side for each group to a document, `height` mm high."""

    def draw(sheet: Sheet, box: PageBox) -> None:
        axes = _axes(sheet, box)
        width = 0.8 / max(len(series), 1)
        for number, (name, values) in enumerate(series.items()):
            x = np.arange(len(groups)) + (number - (len(series) - 1) / 2) * width
            known = np.nan_to_num(np.array(values, dtype=float))
            axes.bar(x, known, 0.92 * width, color=SERIES[number % len(SERIES)], label=name)
            if errors and name in errors:
                axes.errorbar(x, values, yerr=errors[name], fmt="none", ecolor=INK, elinewidth=0.7, capsize=1.5)
        for name, level in (paper or {}).items():
            axes.axhline(level, color=SOFT, linestyle="--", linewidth=0.8, label=name)
        axes.set_xticks(np.arange(len(groups)), groups)
        if log:
            _log(axes)
        _finish(axes, "", y_label)

    document.figure(y_label, height, draw)


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


def mean(values: Sequence[float | None]) -> float:
    """The mean of the known values; NaN without any."""
    known = [v for v in values if v is not None and np.isfinite(v)]
    return float(np.mean(known)) if known else float("nan")


def pooled_sd(lists: Sequence[Sequence[float]]) -> float:
    """Standard deviation of errors over all runs, about the mean of each run; NaN where no run has two."""
    arrays = [np.asarray(v, dtype=float) for v in lists if len(v) > 1]
    if not arrays:
        return float("nan")
    return float(np.sqrt(np.mean(np.concatenate([(a - a.mean()) ** 2 for a in arrays]))))


def pooled_rms(lists: Sequence[Sequence[float]]) -> float:
    """Root mean square of errors over all runs; NaN without any."""
    arrays = [np.asarray(v, dtype=float) for v in lists if len(v)]
    return float(np.sqrt(np.mean(np.concatenate(arrays) ** 2))) if arrays else float("nan")


_LOCAL = ("local reconstruction", "start values", "each camera alone", "pairs of cameras")


def local_and_global_s(results: Results) -> tuple[float, float]:
    """Processor s of the local stage (cameras, pairs, triples) and the rest: medians, as the first compiles."""
    parts = []
    for r in results:
        stages = r["seconds"]
        per_second = r["cpu_s"] / max(sum(stages.values()), 1e-9)
        local = per_second * sum(s for stage, s in stages.items() if stage in _LOCAL)
        parts.append((local, r["cpu_s"] - local))
    if not parts:
        return float("nan"), float("nan")
    local, rest = np.median(parts, axis=0)
    return float(local), float(rest)
