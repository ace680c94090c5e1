"""Table II: spherical projection against displaced points, [Tao21] (22), on the paper's ten cameras."""

from collections.abc import Callable
from typing import Any

import numpy as np

from spherecal_study.displacement import PERCENT
from spherecal_study.executor import Trial
from spherecal_study.study_agreement import Judged, Results, always, estimate, never, share_interval
from spherecal_study.study_page import Document, Options, PaperComparison, paper_line

TITLE = "Spherical projection and displaced points (Table II)"
RUNS = 3
_RIG, _WIDE = "rigA", "rigB"
_FAR = (100,)  # %: beyond the paper's
_ENDS = (PERCENT[0], PERCENT[-1])  # of the identity, whose steps take most of the time
_WAYS = (("spo", "SPO"), ("none", "none-SPO"))
# The rig, how the adjustment is damped, and whether intrinsics are known before.
_CASES = (
    (_RIG, "identity", False, "identity in mm", "identity"),
    (_RIG, "identity", True, "identity in mm, known intrinsics", "identity, known"),
    (_RIG, "diagonal", False, "diagonal", "diagonal"),
    (_WIDE, "diagonal", False, "rig B, diagonal", "rig B"),
    (_WIDE, "diagonal", True, "rig B, diagonal, known intrinsics", "rig B, known"),
)


def trials(options: Options) -> list[Trial]:
    """All percentages with and without projection, by each damping, with nominal and with known intrinsics."""
    return [
        Trial(
            "displaced",
            {
                "preset": rig if rig == _WIDE else options.rig(_RIG),
                "sigma_px": options.sigma_px,
                "seed": s,
                "damping": damping,
                **({"known": True} if known else {}),
                **({"percents": list(percents)} if percents != PERCENT else {}),
            },
        )
        for rig, damping, known, *_ in _cases(options)
        for percents in (
            (_ENDS,) if damping == "identity" else (PERCENT, _FAR) if known == options.known else (PERCENT,)
        )
        for s in options.seeds
    ]


def _cases(options: Options) -> list[tuple[str, str, bool, str, str]]:
    """What is run: of another rig than the paper's, that rig alone."""
    alone = options.images or options.preset
    return [case for case in _CASES if (case[2] or not options.known) and not (alone and case[0] == _WIDE)]


_Cases = list[dict[str, Any]]
_USUAL_STEPS = 50


def page(listed: list[Trial], results: Results, options: Options) -> Document:
    """The study's page: which starts converge, final errors by camera, and the table paper / ours."""
    document = options.begin(TITLE, "noise", rig=options.rig_words(_RIG))
    both = [(t.settings, r) for t, r in zip(listed, results, strict=True)]

    def some(rig: str, damping: str, known: bool) -> Results:
        preset = rig if rig == _WIDE else options.rig(_RIG)
        of = [(s, r) for s, r in both if s["preset"] == preset and s["damping"] == damping]
        return [r for s, r in of if s.get("known", False) == known]

    def cases(rig: str, damping: str, known: bool, way: str, *percents: int) -> _Cases:
        every = [c for r in some(rig, damping, known) for c in r["cases"]]
        return [c for c in every if c["way"] == way and c["percent"] in (percents or PERCENT)]

    rows = []
    for rig, damping, known, text, _ in _cases(options):
        for way, name in _WAYS:
            percents = _ENDS if damping == "identity" else (*PERCENT, *_FAR) if known == options.known else PERCENT
            rows += [_row(f"{name}, {text}", p, cases(rig, damping, known, way, p)) for p in percents]
    heads = ("start and adjustment", "a", "converged", "95 %", "in 50 steps", "start px", "steps", "final px")
    document.table(heads, rows)
    series = {
        f"{name}, {short}": [_share(cases(rig, damping, known, way, p)) for p in _ENDS]
        for rig, damping, known, _, short in _cases(options)
        for way, name in _WAYS
    }
    document.columns([f"{p} %" for p in _ENDS], series, "converged, %")
    for known in (False, True):
        _by_camera(document, some(_RIG, "identity", known), known)
    return document.against_paper(_compared(cases, options), "tao2021")


def _row(name: str, percent: int, chosen: _Cases) -> list[str]:
    count, n = sum(c["converged"] for c in chosen), len(chosen)
    low, high = share_interval(count, n)
    steps, px = estimate([c["iterations"] for c in chosen]), estimate([c["mean_px"] for c in chosen])
    at = f"{percent} %"
    if not n:
        return [name, at, *"------"]
    start = f"{np.median([c['start_px'] for c in chosen]):.0f}"
    share, soon = f"{100 * low:.0f} to {100 * high:.0f} %", f"{sum(_is_soon(c) for c in chosen)} of {n}"
    return [name, at, f"{count} of {n}", share, soon, start, steps.words(1), px.words(4)]


def _is_soon(case: dict[str, Any]) -> bool:
    """Whether it converged and stopped by itself within the steps that programs of the paper's time have as a limit."""
    return case["converged"] and case["settled"] and case["iterations"] <= _USUAL_STEPS


def _share(chosen: _Cases) -> float:
    return 100 * sum(c["converged"] for c in chosen) / len(chosen) if chosen else float("nan")


def _by_camera(document: Document, some: Results, known: bool) -> None:
    """Final px of each camera at the largest displacement, with SPO and without."""
    if not some:
        return
    words = "known" if known else "nominal"
    document.begin_section(f"By camera, a = {PERCENT[-1]} %, identity in mm, {words} intrinsics")
    ids = some[0]["ids"]
    rows = []
    for number, camera in enumerate(ids):
        cells = [camera]
        for way, _ in _WAYS:
            own = [c for r in some for c in r["cases"] if c["way"] == way and c["percent"] == PERCENT[-1]]
            cells.append(estimate([c["camera_mean_px"][number] for c in own]).words(4))
        rows.append(cells)
    document.table(("camera", "SPO, final px", "none-SPO, final px"), rows)


def _compared(cases: Callable[..., _Cases], options: Options) -> list[PaperComparison]:
    def runs(rig: str, damping: str, known: bool, way: str, *percents: int) -> tuple[int, int]:
        """In how many runs all of the percentages converge, and of how many; cases of one run are not independent."""
        chosen, each = cases(rig, damping, known, way, *percents), len(percents or PERCENT)
        whole = [chosen[n : n + each] for n in range(0, len(chosen), each)]
        return sum(all(c["converged"] for c in one) for one in whole), len(whole)

    spo, n = runs(_RIG, "identity", options.known, "spo", *_ENDS)
    none, n_none = runs(_RIG, "identity", options.known, "none", _ENDS[-1])
    tried = {
        "the identity in millimetres": (none, n_none),
        "the same with known intrinsics": runs(_RIG, "identity", True, "none", _ENDS[-1]),
        "the diagonal": runs(_RIG, "diagonal", False, "none", 20, 25),
    }
    steps = {way: estimate([c["iterations"] for c in cases(_RIG, "identity", options.known, way)]) for way, _ in _WAYS}
    lost = [c for c in cases(_RIG, "identity", options.known, "none", _ENDS[-1]) if not c["converged"]]
    by_steps = sum(not c["settled"] for c in lost)
    within = []
    for way, name in _WAYS:
        for percent in _ENDS:
            found = cases(_RIG, "identity", options.known, way, percent)
            soon, late = sum(map(_is_soon, found)), sum(c["converged"] for c in found)
            paper = "does not converge" if (way, percent) == ("none", _ENDS[-1]) else "converges"
            figures = {"way": name, "percent": percent, "steps": _USUAL_STEPS, "soon": soon, "late": late}
            within.append(paper_line("noise", "within", Judged(len(found)), paper=paper, runs=len(found), **figures))
    wide = []
    for rig, known, percent in (
        (_WIDE, False, 25),
        (_WIDE, True, 25),
        *((rig, options.known, percent) for percent in _FAR for rig in (_RIG, _WIDE)),
    ):
        with_spo, without = (runs(rig, "diagonal", known, way, percent) for way in ("spo", "none"))
        if with_spo[1]:
            what = f"{rig}, {'known' if known else 'nominal'} intrinsics, {percent} %, diagonal, runs that converge"
            ours = f"{with_spo[0]} of {with_spo[1]} with SPO, {without[0]} of {without[1]} without"
            wide.append(PaperComparison(what, "-", ours, Judged(with_spo[1])))
    by_diagonal, n_diagonal = tried["the diagonal"]
    return [
        PaperComparison("with SPO, 10 and 25 %", "always converges", f"in {spo} of {n} runs", always(spo, n)),
        paper_line(
            "noise",
            "without",
            never(none, n_none),
            converged=none,
            runs=n_none,
            lost=len(lost),
            by_steps=by_steps,
            tried=", ".join(f"{what} {count} of {of}" for what, (count, of) in tried.items() if of),
        ),
        paper_line("noise", "diagonal", never(by_diagonal, n_diagonal), converged=by_diagonal, runs=n_diagonal),
        paper_line("noise", "steps", Judged(n), spo=steps["spo"].words(1), none=steps["none"].words(1)),
        *within,
        *wide,
    ]
