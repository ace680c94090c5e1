"""Table II: spherical projection against displaced points, [Tao21] (22), on the paper's ten cameras."""

from typing import Any

from spherecal_study.displacement import PERCENT
from spherecal_study.document import Document
from spherecal_study.executor import Trial
from spherecal_study.study_agreement import Estimate, always, estimate, never, share_interval
from spherecal_study.study_page import (
    Options,
    PaperComparison,
    Results,
    StudyPage,
    begin,
    columns_by_group,
    paper_table,
    table,
)

TITLE = "Spherical projection and displaced points (Table II)"
RUNS = 3
_RIG = "rigA"
_WAYS = (("spo", "SPO"), ("none", "none-SPO"))
# How the adjustment is damped, and whether intrinsics are known before.
_CASES = (
    ("identity-mm", False, "identity in mm", "identity"),
    ("identity-mm", True, "identity in mm, known intrinsics", "identity, known"),
    ("diagonal", False, "diagonal", "diagonal"),
)


def trials(options: Options) -> list[Trial]:
    """All percentages with and without projection, by each damping, with nominal and with known intrinsics."""
    cases = [(d, known) for d, known, *_ in _CASES if known or not options.known]
    shared = {"preset": options.rig(_RIG), "sigma_px": options.sigma_px}
    return [
        Trial("displaced", {**shared, "seed": s, "damping": damping, **({"known": True} if known else {})})
        for damping, known in cases
        for s in options.seeds
    ]


_Cases = list[dict[str, Any]]


def page(listed: list[Trial], results: Results, options: Options) -> StudyPage:
    """The study's page: which starts converge, final errors by camera, and the table paper / ours."""
    document = begin(
        TITLE,
        options,
        [
            f"{options.rig_words(_RIG)}: start points are displaced by a % of the ball's radius times a normal number "
            "within (-1, 1) in every coordinate; with SPO they are then moved onto their placements' spheres. The "
            "adjustment is plain, all unknowns at once: damped by the identity with lengths in millimetres (Levenberg, "
            "as in programs of the paper's time, fifty steps at most), or by the diagonal (Marquardt, as this program "
            "does). Converged: the optimum's rms within 5 %.",
        ],
    )
    both = [(t.settings, r) for t, r in zip(listed, results, strict=True)]

    def some(damping: str, known: bool) -> Results:
        return [r for s, r in both if s["damping"] == damping and s.get("known", False) == known]

    def cases(damping: str, known: bool, way: str, *percents: int) -> _Cases:
        every = [c for r in some(damping, known) for c in r["cases"]]
        return [c for c in every if c["way"] == way and c["percent"] in (percents or PERCENT)]

    rows = []
    for damping, known, text, _ in _CASES:
        for way, name in _WAYS:
            rows += [_row(f"{name}, {text}", p, cases(damping, known, way, p)) for p in PERCENT]
    rows.append(_row("triangulated, diagonal", None, cases("diagonal", False, "triangulated", 0)))
    table(
        document,
        ("start and adjustment", "a", "converged", "95 %", "steps", "final px"),
        rows,
    )
    series = {
        f"{name}, {short}": [_share(cases(damping, known, way, p)) for p in PERCENT]
        for damping, known, _, short in _CASES
        for way, name in _WAYS
    }
    columns_by_group(document, [f"{p} %" for p in PERCENT], series, "converged, %")
    for known in (False, True):
        _by_camera(document, some("identity-mm", known), known)
    return _against_paper(document, cases, options)


def _row(name: str, percent: int | None, chosen: _Cases) -> list[str]:
    count, n = sum(c["converged"] for c in chosen), len(chosen)
    low, high = share_interval(count, n)
    steps, px = estimate([c["iterations"] for c in chosen]), estimate([c["mean_px"] for c in chosen])
    at = "-" if percent is None else f"{percent} %"
    if not n:
        return [name, at, "-", "-", "-", "-"]
    return [name, at, f"{count} of {n}", f"{100 * low:.0f} to {100 * high:.0f} %", steps.words(1), px.words(4)]


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
    table(document, ("camera", "SPO, final px", "none-SPO, final px"), rows)


def _against_paper(document: Document, cases: Any, options: Options) -> StudyPage:
    def runs(damping: str, known: bool, way: str, *percents: int) -> tuple[int, int]:
        """In how many runs all of the percentages converge, and of how many; cases of one run are not independent."""
        chosen, each = cases(damping, known, way, *percents), len(percents or PERCENT)
        whole = [chosen[n : n + each] for n in range(0, len(chosen), each)]
        return sum(all(c["converged"] for c in one) for one in whole), len(whole)

    spo, n = runs("identity-mm", options.known, "spo")
    none, n_none = runs("identity-mm", options.known, "none", 20, 25)
    tried = {
        "the identity in millimetres": (none, n_none),
        "the same with known intrinsics": runs("identity-mm", True, "none", 20, 25),
        "the diagonal": runs("diagonal", False, "none", 20, 25),
    }
    steps = {way: estimate([c["iterations"] for c in cases("identity-mm", options.known, way)]) for way, _ in _WAYS}
    lost = [c for c in cases("identity-mm", options.known, "none", 20, 25) if not c["converged"]]
    by_steps = sum(not c["settled"] for c in lost)
    return paper_table(
        document,
        [
            PaperComparison(
                "with SPO, 10 to 25 %",
                "always converges",
                f"in {spo} of {n} runs",
                always(spo, n),
                "",
                "share",
                n,
            ),
            PaperComparison(
                "without SPO, 20 and 25 %",
                "does not converge",
                f"converges in {none} of {n_none} runs",
                never(none, n_none),
                "tried one after the other: "
                + ", ".join(f"{what} {count} of {of}" for what, (count, of) in tried.items() if of)
                + f" runs converge without SPO; {by_steps} of {len(lost)} lost cases by the limit of fifty steps. "
                "SPO removes only the radial third of a displacement.",
                "share",
                n_none,
            ),
            PaperComparison(
                "damped by the diagonal, without SPO, 20 and 25 %",
                "does not converge",
                f"converges in {tried['the diagonal'][0]} of {tried['the diagonal'][1]} runs",
                never(*tried["the diagonal"]),
                "",
                "share",
                tried["the diagonal"][1],
            ),
            PaperComparison(
                "steps, SPO against none-SPO",
                "not in our record",
                f"{_words(steps['spo'])} with, {_words(steps['none'])} without",
                None,
                "",
                "",
                n,
            ),
        ],
    )


def _words(found: Estimate) -> str:
    return found.words(1)
