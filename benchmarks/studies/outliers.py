"""What wrong observations do: exchanged ids, poor centres and points anywhere, against the same recording without."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.report import Report
from benchmarks.studies.simulated import RIGS, BarErrors, Bars, Simulated, bar_errors, make_bars, simulate
from spherecal.calibrate import calibrate
from spherecal.data.rig import Calibration
from spherecal_sim.truth import SimulationOptions

RUNS = 20
FIRST_SEED = 101  # 1 to 20 served to find faults of the method, which were then mended: they would flatter it
SEED_BARS = 5
SHARES = (0.005, 0.02, 0.05)
WORST_RATIO = 1.3
BAD_RATIO = 3.0  # a single run's RMSE to that of all clean runs: no play of the noise any more


@dataclass(frozen=True)
class Outcome:
    """One recording: cameras linked, wrong ones still used, good ones given up, the bars' errors.

    `clean` are those of the same recording without wrong observations; `worst_missed_px` is the largest
    displacement among the wrong ones still used.
    """

    linked: int
    cameras: int
    wrong: int
    missed: int
    worst_missed_px: float
    dropped: int
    bars: BarErrors
    clean: BarErrors


def study(rig: str, runs: int, options: SimulationOptions | None = None) -> dict[float, list[Outcome]]:
    """`runs` recordings, each of a rig of its own, for every share of wrong observations."""
    options = options or SimulationOptions()
    out: dict[float, list[Outcome]] = {share: [] for share in SHARES}
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        clean = simulate(rig, seed, options)
        bars = make_bars(clean.truth, SEED_BARS)
        reference = calibrate(clean.session)
        for share in SHARES:
            spoilt = simulate(rig, seed, replace(options, outlier_fraction=share))
            out[share].append(_compare(clean, reference, spoilt, bars, seed))
    return out


def _compare(clean: Simulated, reference: Calibration, spoilt: Simulated, bars: Bars, seed: int) -> Outcome:
    noise = np.random.default_rng(seed).normal(size=bars.uv.shape)
    result = calibrate(spoilt.session)
    wrong = spoilt.truth.outlier
    off = np.linalg.norm(spoilt.observations.uv - spoilt.truth.uv_true_px, axis=1)
    missed = wrong & result.used
    return Outcome(
        len(result.rig.cameras),
        len(clean.truth.cameras),
        int(wrong.sum()),
        int(missed.sum()),
        float(off[missed].max(initial=0.0)),
        int((reference.used & ~wrong & ~result.used).sum()),
        bar_errors(result, clean.truth, bars, noise),
        bar_errors(reference, clean.truth, bars, noise),
    )


def report(runs: int | None, rigs: Sequence[str] = RIGS, options: SimulationOptions | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("Outliers", f"dev.py studies outliers --runs {runs}")
    page.text(
        f"{runs} recordings (seeds {FIRST_SEED} to {FIRST_SEED + runs - 1}, each a rig of its own) for each rig and "
        "share. Of the wrong observations half are exchanged target ids, 30 % are 0.5 to 3 px off and 20 % lie "
        "anywhere. Bars as in the study of accuracy; the ratio compares with the same recordings, same noise, without "
        "wrong observations: with the lengths as measured, and after the scale that suits the bars best."
    )
    rows, goals = [], []
    for rig in rigs:
        for share, outcomes in study(rig, runs, options).items():
            f = Summary(outcomes)
            rows.append(
                (
                    rig,
                    f"{100 * share:g} %",
                    f"{f.linked} of {runs}",
                    f.rmse_um("clean"),
                    f.rmse_um("bars"),
                    f.ratio,
                    f.rescaled_ratio,
                    float(np.median(f.single_um)),
                    max(f.single_um),
                )
            )
            goals.append((f"{rig} {100 * share:g} %", f))
    header = ("clean RMSE um", "RMSE um", "ratio", "ratio rescaled", "median run um", "worst run um")
    page.table(("rig", "wrong", "all cameras linked", *header), rows)
    header = ("wrong ones", "still used", "farthest of these px", "good ones given up")
    page.table(("mean of a run", *header), [(name, *f.counts) for name, f in goals])
    page.heading("Goals")
    for name, f in goals:
        page.verdict(f"{name}: all cameras linked", f.linked == runs, f"{f.linked} of {runs}")
        bad = [str(FIRST_SEED + run) for run, rmse in enumerate(f.single_um) if rmse > BAD_RATIO * f.rmse_um("clean")]
        note = f"; runs beyond {BAD_RATIO:g} x: seed {', '.join(bad)}" if bad else ""
        page.verdict(f"{name}: bar RMSE <= {WORST_RATIO} x clean", f.ratio <= WORST_RATIO, f"{f.ratio:.3f}{note}")
    return page


@dataclass(frozen=True)
class Summary:
    """What the runs of one rig and share come to."""

    outcomes: list[Outcome]

    @property
    def linked(self) -> int:
        """Runs that placed all cameras."""
        return sum(o.linked == o.cameras for o in self.outcomes)

    def rmse_um(self, which: str, kind: str = "measured") -> float:
        """Over all bars and runs; `bars` or `clean`, `measured` or `rescaled`."""
        return 1e3 * float(np.sqrt(np.mean([getattr(getattr(o, which), kind) for o in self.outcomes])))

    @property
    def ratio(self) -> float:
        """RMSE to that of the clean runs."""
        return self.rmse_um("bars") / self.rmse_um("clean")

    @property
    def rescaled_ratio(self) -> float:
        """The same without the scale."""
        return self.rmse_um("bars", "rescaled") / self.rmse_um("clean", "rescaled")

    @property
    def single_um(self) -> list[float]:
        """The RMSE of every run."""
        return [1e3 * float(np.sqrt(o.bars.measured.mean())) for o in self.outcomes]

    @property
    def counts(self) -> tuple[float, float, float, float]:
        """Means of wrong, missed and dropped; the farthest missed one in between."""
        mean = {
            name: float(np.mean([getattr(o, name) for o in self.outcomes])) for name in ("wrong", "missed", "dropped")
        }
        return mean["wrong"], mean["missed"], max(o.worst_missed_px for o in self.outcomes), mean["dropped"]
