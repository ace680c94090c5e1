"""A ball that bends between placements: which form is better, and whether the automatic choice finds it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.studies.compared import Measured, in_every_form, ratio_error, rmse_um
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import RIGS, make_bars, simulate
from benchmarks.studies.workers import Job, spread
from spherecal_sim.truth import SimulationOptions

RUNS = 8
FIRST_SEED, SEED_BARS = 401, 5
CHANGES_MM = (0.02, 0.05, 0.1)
TURNS = ("turned", "moved")
WORST_RATIO = 1.15


def study(
    rig: str, turns: str, change_mm: float, runs: int, options: SimulationOptions | None = None
) -> dict[str, list[Measured]]:
    """`runs` recordings, each of a rig of its own, by form."""
    out: dict[str, list[Measured]] = {"free": [], "soft": [], "rigid": [], "auto": []}
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        chosen = replace(options or SimulationOptions(), turns=turns, shape_change_mm=change_mm)  # type: ignore[arg-type]
        simulated = simulate(rig, seed, chosen)
        bars = make_bars(simulated.truth, SEED_BARS)
        noise = np.random.default_rng(seed).normal(size=bars.uv.shape)
        for form, found in in_every_form(
            simulated.session, simulated.truth, bars, noise, ("free", "soft", "rigid")
        ).items():
            out[form].append(found)
    return out


def report(runs: int | None, rigs: Sequence[str] = RIGS, options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("A ball that bends", f"dev.py studies shape --runs {runs}")
    page.text(
        f"{runs} recordings (seeds {FIRST_SEED} to {FIRST_SEED + runs - 1}, each a rig of its own), four placements, "
        "0.04 px, the whole of `calibrate`. The ball's dots are displaced anew at every placement by a smooth field of "
        "the given 3-D rms; it is turned by 30 to 60 degrees in between, or only moved. Bars as in the study of "
        "accuracy, lengths as measured. Ratio: variance of unit weight of the rigid form over the free one's. Play: "
        "the soft form's estimate, standard deviation per coordinate; pose and shape take a part of a smooth field.",
    )
    cases = [(rig, turns, change) for rig in rigs for turns in TURNS for change in CHANGES_MM]
    figures = dict(zip(cases, spread([Job(study, (*case, runs, options)) for case in cases]), strict=True))
    rows, goals = [], []
    for (rig, turns, change), found in figures.items():
        ratio = float(np.mean([r.chi2 / f.chi2 for r, f in zip(found["rigid"], found["free"], strict=True)]))
        chosen = ", ".join(
            f"{sum(m.form == form for m in found['auto'])} {form}"
            for form in ("free", "soft", "rigid")
            if any(m.form == form for m in found["auto"])
        )
        shape_sd = float(np.mean([m.shape_sd_mm or 0.0 for m in found["soft"]]))
        rmse = {form: rmse_um(found[form]) for form in found}
        better = min(("free", "rigid"), key=lambda form: rmse[form])
        against = rmse["auto"] / rmse[better]
        error = ratio_error(found["auto"], found[better])
        rows.append(
            (
                rig,
                turns,
                f"{change:g}",
                rmse["free"],
                rmse["soft"],
                rmse["rigid"],
                rmse["auto"],
                against,
                error,
                ratio,
                f"{shape_sd:.3f}",
                chosen,
            )
        )
        if change:
            goals.append((f"{rig} {turns} {change:g} mm", against, error))
    header = ("free um", "soft um", "rigid um", "auto um", "auto / better", "s.e.", "ratio", "play mm", "auto takes")
    page.table(("rig", "ball", "bends by mm", *header), rows)
    page.heading("Goals")
    for name, against, error in goals:
        page.verdict(
            f"{name}: auto <= {WORST_RATIO} x the better form", against <= WORST_RATIO, f"{against:.3f} +- {error:.3f}"
        )
    return page
