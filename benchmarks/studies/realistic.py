"""Realistic recordings of random rigs, in which nothing was done wrong: how often is a rig wrong and says valid?"""

import sys
from collections import Counter
from dataclasses import dataclass

import numpy as np

from benchmarks.simulators.realistic import RealisticOptions, RealisticTruth, random_lengths, simulate_realistic
from benchmarks.studies.judged import Judged, Lengths, Reference, calibrated_and_judged, verdict_of, words
from benchmarks.studies.report import Report
from benchmarks.studies.workers import Job, spread
from spherecal.base.arrays import FloatArray
from spherecal.data.observations import Features, Observations

RUNS = 300
FIRST_SEED = 1483  # 1 to 1482 served whoever mends the engine
LENGTHS = 40
FALSE_ALARM = 0.01
PART = 10
# Findings that accuse something that was not done in any of these recordings.
ACCUSATIONS = frozenset(
    {
        "camera-moved", "cameras-moved", "camera-unsteady", "ball-moved", "cameras-swapped", "wrong-placement",
        "image-contradicts",
        "placements-contradict", "target-contradicts", "ball-shape-changed", "ball-changed", "ball-size", "mirrored",
        "scale-conflict", "fixed-intrinsics-contradicted", "stale-image", "identical-images", "recording-contradicts",
    }
)  # fmt: skip

__all__ = ["report", "verdict_of"]


@dataclass(frozen=True)
class Recording:
    """One recording: its seed, what it was, and the result against the truth."""

    seed: int
    what: str
    options: RealisticOptions
    judged: Judged

    @property
    def false_alarms(self) -> set[str]:
        """Codes that accuse something that was not done."""
        codes = set(self.judged.codes) & ACCUSATIONS
        if "prior-focal-length" in self.judged.codes and self.options.prior_focal_error < 0.1:
            codes.add("prior-focal-length")
        return codes


def reference_of(truth: RealisticTruth, count: int = LENGTHS) -> Reference:
    """The truth of a realistic recording, with lengths to measure."""
    cameras = truth.rig.cameras
    ends = random_lengths(truth, count, np.random.default_rng([truth.seed, 99]))
    camera, end, uv = truth.see(ends.reshape(-1, 3), None)
    keep = ~truth.few[camera]
    return Reference(
        tuple(c.id for c in cameras),
        np.array([c.rotation for c in cameras]),
        np.array([c.translation_mm for c in cameras]),
        lambda f, o: _places(truth, f, o),
        Lengths(ends, end[keep], camera[keep], uv[keep]),
    )


def _places(truth: RealisticTruth, features: Features, o: Observations) -> FloatArray:
    """Where the dots of the body are, (f, 3) mm; NaN for marks of the bar."""
    return dot_places(truth, len(truth.placements), features, o)


def dot_places(truth, count: int, features: Features, o: Observations) -> FloatArray:
    """Where the ball's dots are at `count` placements, (f, 3) mm, NaN for all else; truth has `ball`, `points_mm`."""
    ball = truth.ball
    names = np.array([o.points.index(name) for name in ball.points])
    highest = max(int(features.target.max()), int(ball.dot_target.max()))
    dot = np.full((highest + 1, len(o.points)), -1)
    dot[ball.dot_target, names[ball.dot_point]] = np.arange(len(ball.dot_target))
    places = np.full((len(features), 3), np.nan)
    every = np.stack([truth.points_mm(t) for t in range(count)])
    index = dot[features.target, features.point]
    known = (features.placement < count) & (index >= 0)
    places[known] = every[features.placement[known], index[known]]
    return places


def record(seed: int, options: RealisticOptions | None = None) -> Recording:
    """One recording, calibrated and judged."""
    session, truth = simulate_realistic(seed, options)
    o = truth.options
    what = (
        f"{len(truth.rig.cameras)} cameras, {truth.rig.arrangement}, {o.lenses} lenses, {o.body}, {o.placements} "
        f"placements{'' if o.turned else ' not turned'}, misfit {o.misfit_px:.2g} px, noise {o.noise_px:.2g} px, "
        f"wrong {100 * o.wrong_share:.1f} %, prior f {100 * o.prior_focal_error:.0f} %"
        + (f", {truth.few.sum()} with few points" if truth.few.any() else "")
    )
    return Recording(seed, what, o, calibrated_and_judged(session, reference_of(truth)))


def _records(first: int, count: int) -> list[Recording]:
    return [record(seed) for seed in range(first, first + count)]


def table(page: Report, done: list[Recording]) -> None:
    """The counts, the false alarms and every recording that is wrong and usable."""
    n = len(done)
    counts = Counter((r.judged.wrong, r.judged.verdict) for r in done if not r.judged.failure)
    page.heading("Right, wrong, and what was said")
    page.table(
        ("", "valid", "use with care", "not valid"),
        [
            (name, *(counts[wrong, verdict] for verdict in ("valid", "use-with-care", "not-valid")))
            for name, wrong in (("right", False), ("**wrong**", True))
        ],
    )
    failed = [r for r in done if r.judged.failure]
    seconds = np.array([r.judged.processor_s for r in done])
    covered = np.array([r.judged.covered for r in done if r.judged.verdict != "not-valid"])
    wrong = [r.judged for r in done if r.judged.wrong and r.judged.verdict != "not-valid"]
    page.text(
        f"Of the wrong and usable ones {sum(j.lengths_wrong for j in wrong)} by lengths, "
        f"{sum(not j.lengths_wrong for j in wrong)} by poses of cameras alone (where the lens makes up for some of it: "
        f"median {np.median([c.miss_mm for j in wrong for c in j.cameras] or [0.0]):.3f} mm by which their rays miss)."
    )
    page.text(
        f"No result at all: {len(failed)} of {n}. Lengths within their U where usable: "
        f"{100 * np.nanmean(covered) if len(covered) else np.nan:.1f} %. Processor seconds: median "
        f"{np.median(seconds):.1f}, 95 % {np.quantile(seconds, 0.95):.1f}, worst {seconds.max():.1f}."
    )
    page.heading("By kind")
    kinds = {
        **{f"lenses {k}": (lambda r, k=k: r.options.lenses == k) for k in ("usual", "wide", "strong", "long")},
        **{f"body {k}": (lambda r, k=k: r.options.body == k) for k in ("ball", "half", "plane")},
        "turned": lambda r: r.options.turned,
        "only moved": lambda r: not r.options.turned,
        "misfit below 0.06 px": lambda r: r.options.misfit_px < 0.06,
        "misfit above 0.15 px": lambda r: r.options.misfit_px > 0.15,
        "prior f 10 % or more": lambda r: r.options.prior_focal_error >= 0.1,
        "cameras with few points": lambda r: r.options.few_cameras > 0,
    }
    rows = []
    for name, of in kinds.items():
        own = [r for r in done if of(r)]
        count = Counter((r.judged.wrong, r.judged.verdict) for r in own if not r.judged.failure)
        right = tuple(count[False, verdict] for verdict in ("valid", "use-with-care", "not-valid"))
        wrong = tuple(count[True, verdict] for verdict in ("valid", "use-with-care", "not-valid"))
        rows.append((name, len(own), *right, *wrong, sum(bool(r.judged.failure) for r in own)))
    page.table(
        ("", "n", "right valid", "right care", "right not valid", "**wrong valid**", "wrong care", "wrong not valid",
         "no result"), rows,
    )  # fmt: skip
    page.heading("False alarms")
    alarms: Counter[str] = Counter()
    seeds: dict[str, list[int]] = {}
    for r in done:
        alarms.update(r.false_alarms)
        for code in r.false_alarms:
            seeds.setdefault(code, []).append(r.seed)
    page.table(
        ("accuses what was not done", "recordings", "seeds"),
        [(c, f"{k} of {n}", " ".join(map(str, seeds[c][:12]))) for c, k in alarms.most_common()] or [("none", 0, "")],
    )
    others: Counter[str] = Counter()
    for r in done:
        others.update(set(r.judged.codes) - r.false_alarms)
    page.table(("other warnings and errors", "recordings"), [(c, f"{k} of {n}") for c, k in others.most_common()])
    page.heading("Wrong and usable, and no result")
    rows = [
        (
            r.seed,
            r.what,
            r.judged.failure or r.judged.verdict,
            len(r.judged.wrong_cameras),
            r.judged.worst_words(),
            words(r.judged.findings),
        )
        for r in done
        if r.judged.failure or (r.judged.wrong and r.judged.verdict != "not-valid")
    ]
    page.table(("seed", "recording", "said", "cameras wrong", "worst", "findings"), rows or [("none", *[""] * 5)])


def report(runs: int | None, first: int = FIRST_SEED, processes: int | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    page = Report("Realistic recordings", f"dev.py studies realistic --runs {runs}, seeds from {first}")
    page.text(
        "Random rigs of 4 to 16 cameras (mixed sensors, six arrangements, lenses from fisheyes of 100 degrees to long "
        "ones) before a ball of 100 to 300 mm radius, one with stickers on one half, or a plane; 3 to 6 placements, "
        "turned or only moved. Lenses have a field of 0.02 to 0.3 px that Brown's model cannot take up, coma and "
        "astigmatism that go with depth, focus that differs over the ball; noise has heavy tails and differs by camera "
        "and size of dot; poses and focal lengths drift and vibrate; up to 2 % of the observations are wrong; some "
        "cameras see 8 to 20 dots in all; focal priors are off by up to 30 %. Nothing else was done. A rig is wrong "
        f"where a camera's centre or angle, or one of {LENGTHS} lengths in the volume, is off by more than 3 times its "
        "stated expanded uncertainty (k = 2), lengths measured without noise of their own."
    )
    jobs = [Job(_records, (at, min(PART, first + runs - at))) for at in range(first, first + runs, PART)]
    done = [recording for part in spread(jobs, processes) for recording in part]
    table(page, done)
    page.heading("Goals")
    wrong = [r.seed for r in done if r.judged.wrong and r.judged.verdict == "valid"]
    page.verdict("wrong and valid: 0", not wrong, f"{len(wrong)} of {len(done)}")
    alarms: Counter[str] = Counter()
    for r in done:
        alarms.update(r.false_alarms)
    most = max(alarms.values(), default=0)
    goal = f"no accusation in more than {100 * FALSE_ALARM:.0f} %"
    page.verdict(goal, most <= max(FALSE_ALARM * len(done), 1), f"at most {most} of {len(done)}")
    failed = sum(bool(r.judged.failure) for r in done)
    page.verdict("every recording ends with a result", not failed, f"{failed} without")
    return page


if __name__ == "__main__":
    # single seeds: python -m benchmarks.studies.realistic 1007 1010
    for one in map(int, sys.argv[1:]):
        r = record(one)
        print(r.seed, r.what, r.judged.failure or r.judged.verdict, "WRONG" if r.judged.wrong else "right")
        print("   ", r.judged.worst_words(), f"rms {r.judged.rms_px:.3f} px, {r.judged.processor_s:.1f} s processor")
        print("   ", words(r.judged.findings, 20), flush=True)
