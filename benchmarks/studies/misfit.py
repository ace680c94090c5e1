"""What a lens that the model cannot follow does to the bars, in either form and with a bar inside the adjustment."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.studies.compared import Measured, in_every_form, measured, rmse_um
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import RIGS, make_bars, simulate
from benchmarks.studies.workers import Job, spread
from spherecal_sim.truth import SimulationOptions

RUNS = 8
FIRST_SEED, SEED_BARS = 301, 5
MISFITS_PX = (0.0, 0.01, 0.03, 0.1)
BAR_POSES = 10
GOAL_AT_PX, GOALS_UM = 0.03, {"rigA": 25.0, "rigB": 13.0}
WITH_BAR = "free, bar inside"


def study(rig: str, misfit_px: float, runs: int, options: SimulationOptions | None = None) -> dict[str, list[Measured]]:
    """`runs` recordings, each of a rig of its own, by form."""
    out: dict[str, list[Measured]] = {"free": [], "rigid": [], "auto": [], WITH_BAR: []}
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        chosen = replace(options or SimulationOptions(), misfit_px=misfit_px)
        simulated = simulate(rig, seed, chosen)
        bars = make_bars(simulated.truth, SEED_BARS)
        noise = np.random.default_rng(seed).normal(size=bars.uv.shape)
        for form, found in in_every_form(simulated.session, simulated.truth, bars, noise).items():
            out[form].append(found)
        inside = simulate(rig, seed, replace(chosen, scale="bar", bar_poses=BAR_POSES))
        out[WITH_BAR].append(measured(inside.session, inside.truth, bars, noise, "free"))
    return out


def report(runs: int | None, rigs: Sequence[str] = RIGS, options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("Lenses that the model cannot follow", f"dev.py studies misfit --runs {runs}")
    page.text(
        f"{runs} recordings (seeds {FIRST_SEED} to {FIRST_SEED + runs - 1}, each a rig of its own), four placements, "
        "ball turned by 30 to 60 degrees, 0.04 px, the whole of `calibrate`. Every camera's images are displaced by a "
        "smooth field of about one period per image, of the given rms per axis; the images of the bars too. Bars as in "
        "the study of accuracy. `rescaled`: after the scale that suits the bars best.",
        f"`{WITH_BAR}`: the free form with {BAR_POSES} poses of a bar (500 mm, certified to 5 um) as rows of the "
        "adjustment. chi2red is the variance of unit weight over the simulated noise.",
    )
    cases = [(rig, misfit) for rig in rigs for misfit in MISFITS_PX]
    figures = dict(zip(cases, spread([Job(study, (*case, runs, options)) for case in cases]), strict=True))
    rows = []
    for (rig, misfit), by_form in figures.items():
        chosen = sum(found.form == "rigid" for found in by_form["auto"])
        for form in ("free", "rigid", WITH_BAR):
            found = by_form[form]
            chi2 = float(np.mean([m.chi2 for m in found]))
            taken = f"{chosen} of {runs}" if form == "rigid" else ""
            rows.append((rig, f"{misfit:g}", form, rmse_um(found), rmse_um(found, "rescaled"), chi2, taken))
    page.table(("rig", "misfit px", "form", "RMSE um", "rescaled um", "chi2red", "taken by auto"), rows)
    page.heading("Goals")
    for rig in rigs:
        found = figures[rig, GOAL_AT_PX]["rigid"]
        for kind in ("rescaled", "measured"):
            rmse = rmse_um(found, kind)
            page.verdict(
                f"{rig}, {GOAL_AT_PX:g} px, rigid: bar RMSE ({kind}) <= {GOALS_UM[rig]:g} um",
                rmse <= GOALS_UM[rig],
                f"{rmse:.2f} um (free {rmse_um(figures[rig, GOAL_AT_PX]['free'], kind):.1f} um)",
            )
    return page
