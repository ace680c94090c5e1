"""Fig. 13: four to ten cameras of rig A."""

import numpy as np

from spherecal_study.executor import Trial
from spherecal_study.study_agreement import Estimate, Results, bar_sd, below, estimate, mean_px
from spherecal_study.study_page import Document, Options, PaperComparison, paper_line

TITLE = "Number of cameras (Fig. 13)"
RUNS = 5
_COUNTS = (4, 7)  # and all ten
_METHODS = {"free": "free", "auto": "rigid where possible"}
_BAR = "A3A4"


def trials(options: Options) -> list[Trial]:
    """Calibrations with the four or seven cameras nearest to the rig's middle and with all, free and as `auto` does."""
    return [
        Trial("ball", {**options.plain("rigA"), "seed": s, "method": m, **({"cameras": n} if n in _COUNTS else {})})
        for m in _METHODS
        for n in _counts(options)
        for s in options.seeds
    ]


def _counts(options: Options) -> list[int]:
    every = options.cameras("rigA")
    return [*(n for n in _COUNTS if n < every), every]


def page(listed: list[Trial], results: Results, options: Options) -> Document:
    """The study's page: errors over the number of cameras, and the table paper / ours."""
    document = options.begin(TITLE, "cameras", rig=options.rig_words("rigA"))
    both = [(t.settings, r) for t, r in zip(listed, results, strict=True)]
    px: dict[str, _ByCount] = {}
    sd: dict[str, _ByCount] = {}
    off: dict[str, _ByCount] = {}
    for m, name in _METHODS.items():
        every = options.cameras("rigA")
        own = [(s.get("cameras", every), r) for s, r in both if s["method"] == m]
        chosen = {n: [r for count, r in own if count == n] for n in _counts(options)}
        chosen = {n: some for n, some in chosen.items() if some}
        px[name] = {n: mean_px(some) for n, some in chosen.items()}
        sd[name] = {n: bar_sd(some, _BAR) for n, some in chosen.items()}
        errors = {n: [r["bars"].get(_BAR) for r in some] for n, some in chosen.items()}
        off[name] = {n: estimate([abs(float(np.mean(e))) if e else None for e in own]) for n, own in errors.items()}
    paper = {"paper: best": 0.0593, "paper: worst": 0.0875}
    document.curves(px, "cameras", "mean reprojection error, px", lines=paper)
    document.curves(sd, "cameras", "A3A4: standard deviation, mm", lines={"paper: below": 0.1})
    document.curves(off, "cameras", "A3A4: size of mean error, mm", lines={"paper: below": 0.05})
    rows = [
        [f"{name}, {n}", e.n, e.words(4), off[name][n].words(4), sd[name][n].words(4)]
        for name, own in px.items()
        for n, e in own.items()
    ]
    document.table(("form, cameras", "runs", "reprojection px", "A3A4 mean mm", "A3A4 sd mm"), rows)
    return document.against_paper(_compared(px["free"], off, sd), "free")


_ByCount = dict[int, Estimate]


_PIPELINES = {"free": "free", "rigid where possible": "auto"}


def _compared(px: _ByCount, off: dict[str, _ByCount], sd: dict[str, _ByCount]) -> list[PaperComparison]:
    def worst(found: _ByCount) -> tuple[Estimate, str]:
        n = max(found, key=lambda n: found[n].mean, default=0)
        return found.get(n, estimate([])), f"at {n} cameras"

    most, where = worst(px)
    rows = [paper_line("cameras", "pixels", below(most, 0.0875), px=most.words(4), where=where)]
    few = {"free": "few views at four placements determine the lenses poorly."}
    for name, means in off.items():
        for what, found, limit, why in (
            ("mean error", means, 0.05, ""),
            ("standard deviation", sd[name], 0.1, few.get(name, "")),
        ):
            figure, at = worst(found)
            paper, ours = f"below {limit:g} mm", f"{figure.words(4)} mm at most, {at}"
            judged = below(figure, limit)
            rows.append(PaperComparison(f"A3A4, {what}, {name}", paper, ours, judged, why, _PIPELINES[name]))
    return rows
