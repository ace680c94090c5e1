"""The page of the study of accuracy: its tables and goals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from benchmarks.studies.accuracy import Accuracy
    from benchmarks.studies.report import Report

# Weights by camera settle to 3 %, and another way to the same network ends with others within that: the plain sum of
# squares in px then differs by up to 1e-4, the bars by a few tenths of a micrometre.
SAME_MINIMUM = 1e-4
# Another observation or two moves a bar by less than this share of its error.
SAME_BARS = 1.0
# um, of all bars; numerics of the method at 0.04 px
GOALS = {
    ("rigA", "turned", "free"): 56.0,
    ("rigB", "turned", "free"): 42.0,
    ("rigA", "turned", "rigid"): 20.0,
    ("rigB", "turned", "rigid"): 10.5,
    ("rigA", "turned, 10 poses of a bar inside", "free"): 20.5,
    ("rigB", "turned, 10 poses of a bar inside", "free"): 11.0,
}


def write(page: Report, figures: list[Accuracy]) -> None:
    """All tables and verdicts."""
    _bar_tables(page, figures)
    _spread_tables(page, figures)
    _minimum_tables(page, figures)
    page.heading("Goals")
    for f in figures:
        _verdicts(page, f)


def _bar_tables(page: Report, figures: list[Accuracy]) -> None:
    page.heading("Bars")
    rows = []
    for f in figures:
        share = [1e3 * float(np.sqrt(v.mean())) for v in (f.bound.calibration, f.bound.own, f.bound.scale)]
        rows.append((f.name, f.observations, f.rmse_um, f.bound_um, *share, f.ratio, f.ratio_error))
    header = (
        "case",
        "observations",
        "RMSE um",
        "bound um",
        "cameras um",
        "own noise um",
        "scale um",
        "RMSE/bound",
        "s.e.",
    )
    page.table(header, rows)
    rows = []
    for f in figures:
        for length in np.unique(np.round(f.by_length)):
            own = np.round(f.by_length) == length
            rmse, bound = np.sqrt(f.bar_squares[:, own].mean()), np.sqrt(f.bound.total[own].mean())
            rows.append((f.name, int(length), 1e3 * float(rmse), 1e3 * float(bound), float(rmse / bound)))
    page.table(("case", "length mm", "RMSE um", "bound um", "ratio"), rows)


def _spread_tables(page: Report, figures: list[Accuracy]) -> None:
    page.heading("Empirical over predicted standard deviation")
    page.text(
        "Pooled over cameras or points; s.e. from the scatter between runs; lowest and highest ratio of a single "
        "camera's parameter (of a single length) beside it, which scatter more."
    )
    rows = [(f.name, name, n.ratio, n.standard_error, *n.extremes) for f in figures for name, n in f.normalised.items()]
    rows += [
        (f.name, f"rig.json ({len(f.whole)} whole runs)", n.ratio, n.standard_error, *n.extremes)
        for f in figures
        if (n := f.sigma_stated) is not None
    ]
    page.table(("case", "quantity", "ratio", "s.e.", "lowest", "highest"), rows)


def _minimum_tables(page: Report, figures: list[Accuracy]) -> None:
    page.heading("The variance of unit weight and the whole computation")
    rows = []
    for f in figures:
        z = (f.chi2.mean() - 1) / np.sqrt(2 / f.redundancy / len(f.chi2))
        expected = np.sqrt(2 / f.redundancy)
        rows.append(
            (
                f.name,
                float(f.chi2.mean()),
                float(z),
                float(f.chi2.std(ddof=1)),
                float(expected),
                float(f.chi2.min()),
                float(f.chi2.max()),
                f.redundancy,
            )
        )
    page.table(("case", "chi2red mean", "z", "sd of a run", "expected sd", "lowest", "highest", "redundancy"), rows)
    rows = []
    for f in figures:
        same = [w for w in f.whole if w.other_used == 0]
        rows.append(
            (
                f.name,
                len(f.whole),
                len(same),
                max((w.cost_difference for w in same), default=0.0),
                max((w.bar_difference_um for w in same), default=0.0),
                max((w.other_used for w in f.whole), default=0),
                max((w.bar_difference_um for w in f.whole), default=0.0),
            )
        )
    page.table(
        ("case", "whole runs", "with the same observations", "their cost differs by", "their bars by um",
         "most observations that differ", "bars then differ by um"), rows,
    )  # fmt: skip
    page.text(
        "The product's covariance at the truth differs from the dense one by at most "
        + ", ".join(f"{f.covariance_difference:.1e} ({f.name})" for f in figures)
        + " of a standard deviation (every camera parameter, every point coordinate)."
    )


def _same_minimum(page: Report, f: Accuracy) -> None:
    """The cost where the gate left both the same observations; where it never did, the bars of both."""
    same = [w for w in f.whole if w.other_used == 0]
    if same:
        worst = max(w.cost_difference for w in same)
        told = f"{len(same)} of {len(f.whole)} runs used the same observations, costs equal to {worst:.1e}"
        page.verdict(
            f"{f.name}: the whole computation ends in the same minimum to {SAME_MINIMUM:g}", worst <= SAME_MINIMUM, told
        )
        return
    apart = max((w.bar_difference_um for w in f.whole), default=np.inf)
    most, others = SAME_BARS * f.rmse_um, max((w.other_used for w in f.whole), default=0)
    page.verdict(
        f"{f.name}: the whole computation's bars differ by at most {most:.1f} um",
        apart <= most,
        f"{apart:.2f} um; no run used exactly the same observations (up to {others} others)",
    )


def _verdicts(page: Report, f: Accuracy) -> None:
    limit = 1.05 + 2 * f.ratio_error
    page.verdict(f"{f.name}: bar RMSE / bound <= 1.05 + 2 s.e.", f.ratio <= limit, f"{f.ratio:.3f} <= {limit:.3f}")
    goal = GOALS.get((f.rig, f.case, f.form))
    if goal is not None:
        page.verdict(f"{f.name}: bar RMSE <= {goal:g} um", f.rmse_um <= goal, f"{f.rmse_um:.2f} um")
    mean = float(f.chi2.mean())
    page.verdict(f"{f.name}: chi2red within 1 +- 0.05", abs(mean - 1) <= 0.05, f"{mean:.4f}")
    worst = max(f.normalised.items(), key=lambda item: abs(item[1].ratio - 1))
    inside = all(abs(n.ratio - 1) <= 0.10 for n in f.normalised.values())
    page.verdict(
        f"{f.name}: empirical sd within 10 % of the predicted",
        inside,
        f"farthest is {worst[0]}, {worst[1].ratio:.3f} +- {worst[1].standard_error:.3f}",
    )
    _same_minimum(page, f)
    page.verdict(
        f"{f.name}: covariance equals the dense one", f.covariance_difference < 1e-6, f"{f.covariance_difference:.1e}"
    )
