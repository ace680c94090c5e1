"""Fig. 8: one to seven placements of the ball."""

from spherecal_study.executor import Trial
from spherecal_study.measures import all_errors
from spherecal_study.page import (
    Compared,
    Options,
    Results,
    StudyPage,
    begin,
    curves,
    mean,
    paper_table,
    pooled_rms,
    table,
)

TITLE = "Number of placements (Fig. 8)"
RUNS = 5
_COUNTS = range(1, 8)
_METHODS = ("free", "rigid")


def trials(options: Options) -> list[Trial]:
    """Every number of placements, free and (from two on) rigid."""
    return [
        Trial(
            "ball",
            {"preset": options.rig("rigA"), "seed": s, "sigma_px": options.sigma_px, "placements": n, "method": m},
        )
        for m in _METHODS
        for n in _COUNTS
        for s in options.seeds
        if m == "free" or n > 1
    ]


def page(listed: list[Trial], results: Results, options: Options) -> StudyPage:
    """The study's page."""
    document = begin(
        TITLE,
        options,
        [
            f"{options.rig_words('rigA')} is calibrated with the ball at one to seven places, spread evenly. "
            "Reprojection errors tell how well the model fits, errors of bars how well the rig measures: 20 poses "
            "each of two bars, three lengths each. Free: every dot at every placement is a point of its own, as in the "
            "paper. Rigid: the ball is one object.",
        ],
    )
    px, bars, exact = {}, {}, {}
    for method in _METHODS:
        own = [(t.settings, r) for t, r in zip(listed, results, strict=True) if t.settings["method"] == method]
        counts = sorted({s["placements"] for s, _ in own})
        chosen = [[r for s, r in own if s["placements"] == n] for n in counts]
        px[method] = (counts, [mean([r["mean_px"] for r in some]) for some in chosen])
        bars[method] = (counts, [pooled_rms([all_errors(r) for r in some]) for some in chosen])
        exact[method] = (counts, [pooled_rms([r["exact_errors_mm"] for r in some]) for some in chosen])
    curves(document, px, "placements", "mean reprojection error, px", lines={"paper: below": 0.2})
    curves(document, bars, "placements", "rms error of bars, mm", log=True, lines={"paper: settles near": 0.1})
    curves(document, exact, "placements", "by the calibration alone, mm", log=True)
    rows = [[f"{m}, {n}", px[m][1][i], bars[m][1][i], exact[m][1][i]] for m in _METHODS for i, n in enumerate(px[m][0])]
    table(
        document,
        (("form, placements", 40), ("reprojection px", 30), ("bars, rms mm", 30), ("calibration alone mm", 34)),
        rows,
    )
    free, error = px["free"][1], bars["free"][1]
    knee = error[3] / error[-1]
    return paper_table(
        document,
        [
            Compared(
                "reprojection error, 1 to 7 placements",
                "below 0.2 px in all",
                f"{min(free):.3f} to {max(free):.3f} px",
                max(free) < 0.2,
                "",
            ),
            Compared(
                "bar error falls and settles",
                "near 0.1 mm",
                f"{error[0]:.2f} mm at 1, {error[3]:.3f} at 4, {error[-1]:.3f} at 7",
                error[-1] < 0.1,
                "the fall is the paper's; the level is lower, since the "
                "simulation has no lens errors beyond the model, no vibration and no errors of the print.",
            ),
            Compared(
                "four placements are enough",
                "little gain beyond",
                f"4 is {knee:.1f} times as bad as 7",
                knee < 2.5,
                "beyond the knee errors fall with the square root of the number of placements at best; how the "
                "grid lies in the volume, another one for every number, matters as much.",
            ),
            Compared(
                "the rigid form, 4 placements",
                "not in the paper",
                f"{bars['rigid'][1][2]:.3f} mm",
                None,
                f"against {error[3]:.3f} mm of the free form at the same placements.",
            ),
        ],
    )
