"""Fig. 8: one to seven placements of the ball."""

from spherecal.data.session import STANDARD_PLACEMENTS
from spherecal_study import study_agreement
from spherecal_study.executor import Trial
from spherecal_study.study_page import Document, Options, PaperComparison, paper_line

TITLE = "Number of placements (Fig. 8)"
RUNS = 5
_COUNTS = (1, 2, 4, 7)
_METHODS = ("free", "rigid")


def trials(options: Options) -> list[Trial]:
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


def page(listed: list[Trial], results: study_agreement.Results, options: Options) -> Document:
    """The study's page: errors over the number of placements, and the table paper / ours."""
    document = options.begin(TITLE, "layouts", rig=options.rig_words("rigA"))
    px, bars, exact = {}, {}, {}
    for method in _METHODS:
        own = [(t.settings, r) for t, r in zip(listed, results, strict=True) if t.settings["method"] == method]
        counts = sorted({s.get("placements", STANDARD_PLACEMENTS) for s, _ in own})
        chosen = {n: [r for s, r in own if s.get("placements", STANDARD_PLACEMENTS) == n] for n in counts}
        px[method] = {n: study_agreement.mean_px(some) for n, some in chosen.items()}
        bars[method] = {n: study_agreement.bars_rms(some) for n, some in chosen.items()}
        exact[method] = {n: study_agreement.alone_rms(some) for n, some in chosen.items()}
    document.curves(px, "placements", "mean reprojection error, px", lines={"paper: below": 0.2})
    document.curves(bars, "placements", "rms error of bars, mm", log=True, lines={"paper: settles near": 0.1})
    document.curves(exact, "placements", "by the calibration alone, mm", log=True)
    rows = [
        [f"{m}, {n}", found.n, found.words(4), bars[m][n].words(4), exact[m][n].words(4)]
        for m in _METHODS
        for n, found in px[m].items()
    ]
    heads = ("form, placements", "runs", "reprojection px", "bars, rms mm", "calibration alone mm")
    document.table(heads, rows)
    return document.against_paper(_compared(px["free"], bars), "free")


_ByCount = dict[int, study_agreement.Estimate]


def _compared(px: _ByCount, bars: dict[str, _ByCount]) -> list[PaperComparison]:
    free, rigid, none = bars["free"], bars["rigid"], study_agreement.estimate([])
    worst = max(px.values(), key=lambda e: e.mean, default=none)
    at = {n: free.get(n, none) for n in (1, STANDARD_PLACEMENTS, _COUNTS[-1])}
    levels = ", ".join(f"{e.words(3)} mm at {n}" for n, e in at.items())
    usual, usual_rigid = at[STANDARD_PLACEMENTS], rigid.get(STANDARD_PLACEMENTS, none)
    return [
        paper_line("layouts", "pixels", study_agreement.below(worst, 0.2), px=worst.words(4)),
        paper_line("layouts", "bars", study_agreement.like(usual, 0.1), mm=usual.words(4)),
        paper_line("layouts", "placements", study_agreement.Judged(min(e.n for e in at.values())), levels=levels),
        paper_line("layouts", "rigid", study_agreement.Judged(usual_rigid.n), mm=usual_rigid.words(4)),
    ]
