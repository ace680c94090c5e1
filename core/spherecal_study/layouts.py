"""Fig. 8: one to seven placements of the ball."""

from typing import Any

from spherecal.data.session import STANDARD_PLACEMENTS
from spherecal_study import study_page
from spherecal_study.executor import Trial
from spherecal_study.study_agreement import Estimate, all_errors, below, estimate, like

TITLE = "Number of placements (Fig. 8)"
RUNS = 5
_COUNTS = (1, 2, 4, 7)
_METHODS = ("free", "rigid")


def trials(options: study_page.Options) -> list[Trial]:
    """Calibrations with one, two, four and seven placements, free and (from two on) rigid."""
    return [
        Trial(
            "ball",
            {
                **options.plain("rigA"),
                "seed": s,
                "method": m,
                **({"placements": n} if n != STANDARD_PLACEMENTS else {}),
            },
        )
        for m in _METHODS
        for n in _COUNTS
        for s in options.seeds
        if m == "free" or n > 1
    ]


def page(listed: list[Trial], results: study_page.Results, options: study_page.Options) -> study_page.StudyPage:
    """The study's page: errors over the number of placements, and the table paper / ours."""
    document = study_page.begin(
        TITLE,
        options,
        [
            f"{options.rig_words('rigA')} is calibrated with the ball at one, two, four or seven places. "
            "Reprojection errors tell how well the model fits, errors of bars how well the rig measures: 20 poses "
            "each of two bars, three lengths each. Free: every dot at every placement is a point of its own, as in the "
            "paper. Rigid: the ball is one object."
        ],
    )
    px, bars, exact = {}, {}, {}
    for method in _METHODS:
        own = [(t.settings, r) for t, r in zip(listed, results, strict=True) if t.settings["method"] == method]
        counts = sorted({s.get("placements", STANDARD_PLACEMENTS) for s, _ in own})
        chosen = {n: [r for s, r in own if s.get("placements", STANDARD_PLACEMENTS) == n] for n in counts}
        px[method] = {n: estimate([r["mean_px"] for r in some]) for n, some in chosen.items()}
        bars[method] = {
            n: estimate([study_page.pooled_rms([all_errors(r)]) for r in some]) for n, some in chosen.items()
        }
        exact[method] = {
            n: estimate([study_page.pooled_rms([r["exact_errors_mm"]]) for r in some]) for n, some in chosen.items()
        }
    _curves(document, px, "mean reprojection error, px", lines={"paper: below": 0.2})
    _curves(document, bars, "rms error of bars, mm", log=True, lines={"paper: settles near": 0.1})
    _curves(document, exact, "by the calibration alone, mm", log=True)
    rows = [
        [f"{m}, {n}", found.n, found.words(4), bars[m][n].words(4), exact[m][n].words(4)]
        for m in _METHODS
        for n, found in px[m].items()
    ]
    heads = ("form, placements", "runs", "reprojection px", "bars, rms mm", "calibration alone mm")
    study_page.table(document, heads, rows)
    return _against_paper(document, px["free"], bars)


_ByCount = dict[int, Estimate]


def _curves(document: study_page.Document, found: dict[str, _ByCount], label: str, **more: Any) -> None:
    """Means over runs with their standard errors, over the number of placements."""
    series = {m: (list(own), [e.mean for e in own.values()]) for m, own in found.items()}
    errors = {m: [e.error for e in own.values()] for m, own in found.items()}
    study_page.curves(document, series, "placements", label, errors=errors, **more)


def _against_paper(document: study_page.Document, px: _ByCount, bars: dict[str, _ByCount]) -> study_page.StudyPage:
    free, rigid, none = bars["free"], bars["rigid"], estimate([])
    worst = max(px.values(), key=lambda e: e.mean, default=none)
    at = {n: free.get(n, none) for n in (1, STANDARD_PLACEMENTS, _COUNTS[-1])}
    levels = ", ".join(f"{e.words(3)} mm at {n}" for n, e in at.items())
    return study_page.paper_table(
        document,
        [
            study_page.PaperComparison(
                "reprojection error, 1 to 7 placements",
                "below 0.2 px in all",
                f"{worst.words(4)} px at most",
                below(worst, 0.2),
                "follows the image noise of 0.04 px a coordinate.",
                "limit",
                worst.n,
            ),
            study_page.PaperComparison(
                "bar error at 4 placements",
                "settles near 0.1 mm",
                f"{at[STANDARD_PLACEMENTS].words(4)} mm",
                like(at[STANDARD_PLACEMENTS], 0.1),
                "the simulation has no lens errors beyond the model, vibration or print errors.",
                "value",
                at[STANDARD_PLACEMENTS].n,
            ),
            study_page.PaperComparison(
                "bar error by number of placements",
                "from 1 to 4 placements, little gain beyond",
                levels,
                None,
                "where the grid lies in the volume, which differs for each number, matters as much as the number.",
                "",
                min(e.n for e in at.values()),
            ),
            study_page.PaperComparison(
                "the rigid form, 4 placements",
                "-",
                f"{rigid.get(STANDARD_PLACEMENTS, none).words(4)} mm",
                None,
                "at the placements of the second row.",
                "",
                rigid.get(STANDARD_PLACEMENTS, none).n,
                "rigid",
            ),
        ],
        "free",
    )
