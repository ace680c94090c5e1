"""What a verification says of rigs whose truth is known: do PASS, FAIL and INCONSISTENT keep their promised rates?

A rig is drawn from the covariance that it states, times a factor: right rigs, rigs 1.5, 3 and 10 times worse than they
say, rigs whose scale is wrong by 0.1 %. Two bars are measured with it, 6 to 48 lengths, whose certificates err
independently, or all alike as those of one laboratory do; one thermometer reads both.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.studies.report import Report
from benchmarks.studies.workers import Job, spread
from spherecal.calibrate import calibrate
from spherecal.data.rig import Rig, RigCamera
from spherecal.data.session import Certificate, Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.scale.bar_temperature import EXPANSION_RELATIVE_SD, temperature_sd
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions, Truth
from spherecal_verify.agreement import EACH_FALSE_ALARM, TOGETHER_FALSE_ALARM
from spherecal_verify.budget import CONFORMANCE
from spherecal_verify.limit import LengthLimit
from spherecal_verify.verify_bars import VerifySettings, verify

RUNS = 200
OPTIONS = SimulationOptions(targets=60, placements=4, bar_poses=8, scale="bar", print_sd_mm=0.01)
LIMIT = LengthLimit(0.03, 20_000.0)
WRONG_SCALE = 1e-3
POSES = (1, 2, 4, 8)  # of each of the two bars, three lengths each
CERTIFICATE_SD = 1e-5  # of a length: U = 10 um on 500 mm, k = 2
# (name, times the stated covariance's deviation, relative error of the scale)
KINDS = (("right", 1.0, 0.0), ("1.5 times", 1.5, 0.0), ("3 times", 3.0, 0.0), ("10 times", 10.0, 0.0),
         ("wrong scale", 1.0, WRONG_SCALE))  # fmt: skip


@dataclass(frozen=True)
class Said:
    """One verification: its kind, lengths, both verdicts, the largest true |E| over the limit, the errors' ratio."""

    kind: str
    correlated: bool
    lengths: int
    consistent: bool
    conformity: str | None
    worst_over_limit: float
    exceeding: int
    above_chi: bool


@cache
def _base(seed: int) -> tuple[Session, Truth, Rig]:
    session, truth = simulate_session("rigA", seed, OPTIONS)
    return session, truth, calibrate(session).rig


def drawn(rig: Rig, truth: Truth, factor: float, scale: float, rng: np.random.Generator) -> Rig:
    """The true cameras, displaced by what the rig's covariance (times a factor) allows, with what the rig states."""
    assert rig.covariance is not None
    matrix, columns = rig.covariance.matrix, rig.covariance.intrinsics
    values, axes = np.linalg.eigh(matrix)
    shift = axes @ (np.sqrt(np.maximum(values, 0.0)) * rng.normal(size=len(values))) * factor
    true = {camera.id: camera for camera in truth.cameras}
    cameras: list[RigCamera] = []
    for camera, own in zip(rig.cameras, shift.reshape(len(rig.cameras), -1), strict=True):
        turn = exp_rotation(own[:3])
        lens = true[camera.id].intrinsics.copy()
        lens[columns] += own[6:]
        place = (turn @ true[camera.id].translation_mm + own[3:6]) * (1 + scale)
        rotation = turn @ true[camera.id].rotation
        cameras.append(replace(camera, rotation=rotation, translation_mm=place, intrinsics=lens))
    return replace(rig, cameras=tuple(cameras))


def measured_bars(session: Session, truth: Truth, poses: int, alike: bool, rng: np.random.Generator) -> Session:
    """The session's bars with certificates, thermometer and expansion that err as stated, and new image noise."""
    bars = []
    common = rng.normal()
    thermometer = rng.uniform(-1, 1) * np.sqrt(3) * temperature_sd(20.0)
    for bar in session.bars:
        true = dict(zip(truth.bar(bar.id).marks, truth.bar(bar.id).x_mm, strict=True))
        lengths = []
        for one in bar.lengths:
            length = float(true[one.to_mark] - true[one.from_mark])
            error = CERTIFICATE_SD * length * (common if alike else rng.normal())
            u = 2 * CERTIFICATE_SD * length
            lengths.append(replace(one, length_mm=length + error, expanded_uncertainty_mm=u, coverage_factor=2.0))
        stretch = 1 + rng.uniform(-1, 1) * np.sqrt(3) * EXPANSION_RELATIVE_SD
        certificate = Certificate(f"K-{bar.id}", "Laboratory" if alike else f"Laboratory {bar.id}")
        expansion = bar.expansion_per_kelvin * stretch
        made = replace(bar, role="check", lengths=tuple(lengths), expansion_per_kelvin=expansion)
        bars.append(replace(made, certificate=certificate))
    true_c = {pose.id: pose.temperature_c for pose in truth.bar_poses}
    kept = [pose for bar in bars for pose in [p for p in session.bar_poses if p.bar == bar.id][:poses]]
    read = tuple(replace(pose, temperature_c=true_c[pose.id] + thermometer) for pose in kept)
    o = session.observations
    assert o is not None
    noise = rng.normal(size=o.uv.shape) * truth.sigma_px[o.camera, None]
    seen = replace(o, uv=truth.uv_true_px + noise)
    return replace(session, bars=tuple(bars), bar_poses=read, observations=seen)


def one_run(seed: int, runs: int) -> list[Said]:
    """All kinds with one calibrated rig's statement; `runs` rigs of each."""
    session, truth, rig = _base(seed)
    found = []
    for k, (kind, factor, scale) in enumerate(KINDS):
        for run in range(runs):
            rng = np.random.default_rng([seed, k, run])
            alike = bool(run % 2)
            bars = measured_bars(session, truth, POSES[run // 2 % len(POSES)], alike, rng)
            now = drawn(rig, truth, factor, scale, rng)
            done = verify(bars, now, None, VerifySettings(LIMIT))
            acceptance = done.procedure.acceptance if done.procedure else None
            d = done.decision
            above = (d.chi_square or 0.0) > (d.most_chi_square or np.inf)
            conformity = None if acceptance is None else acceptance.verdict
            worst = _worst(done, truth)
            consistent = d.verdict == "consistent"
            found.append(Said(kind, alike, len(done.measured), consistent, conformity, worst, len(d.exceeding), above))
    return found


def _worst(done, truth: Truth) -> float:
    """The largest true error of indication over its limit: against the bar's true length at its true temperature."""
    warm = {pose.id: pose.temperature_c for pose in truth.bar_poses}
    ratio = []
    for m in done.measured:
        bar = truth.bar(m.bar)
        place = dict(zip(bar.marks, bar.x_mm, strict=True))
        cold = float(place[m.to_mark] - place[m.from_mark])
        true = cold * (1 + bar.expansion_per_kelvin * (warm[m.pose] - bar.reference_temperature_c))
        ratio.append(abs(m.length_mm - true) / LIMIT.at(true))
    return max(ratio)


def report(runs: int | None = None) -> Report:
    """200 rigs of each kind, by the statements of eight calibrated rigs."""
    runs = runs or RUNS
    seeds = range(1, 9) if runs >= 64 else range(1, 3)
    each = max(1, round(runs / len(seeds)))
    found = [one for part in spread([Job(one_run, (seed, each)) for seed in seeds]) for one in part]
    page = Report("Verdicts of verifications", "python3 dev.py studies verdicts")
    page.text(
        f"{each * len(seeds)} rigs of each kind, drawn from the covariance that {len(seeds)} calibrated rigs A state "
        f"(four placements, scale by a bar), {6 * POSES[0]} to {6 * POSES[-1]} lengths of two bars. Certificates have "
        f"U = {2e6 * CERTIFICATE_SD:g} ppm (k = 2); in half of the runs all of them err alike, as those of one "
        "laboratory do. One thermometer reads both bars (evenly within 0.5 K), expansions err evenly by up to 10 %."
    )
    _agreement(page, found)
    _conformity(page, found)
    return page


def _agreement(page: Report, found: Sequence[Said]) -> None:
    page.heading("Do the errors agree with what the rig states?")
    rows = []
    for kind, *_ in KINDS:
        for alike in (False, True):
            own = [x for x in found if x.kind == kind and x.correlated == alike]
            n = len(own)
            rows.append(
                (kind, "one" if alike else "two", n, sum(x.consistent for x in own) / n,
                 sum(x.exceeding > 0 for x in own) / n, sum(x.above_chi for x in own) / n)
            )  # fmt: skip
    head = ("rig", "laboratories", "runs", "CONSISTENT", "single errors beyond k u", "chi-square beyond")
    page.table(head, rows)
    promised = EACH_FALSE_ALARM + TOGETHER_FALSE_ALARM
    right = [x for x in found if x.kind == "right"]
    wrong = sum(not x.consistent for x in right)
    most = promised * len(right) + 3 * np.sqrt(promised * len(right)) + 1
    page.verdict(
        f"a right rig is INCONSISTENT at most once in {1 / promised:g} times", wrong <= most, f"{wrong} of {len(right)}"
    )
    page.text("", "How often a wrong rig is told, by the number of its lengths:")
    rows = []
    for kind, *_ in KINDS:
        shares = []
        for poses in POSES:
            own = [x for x in found if x.kind == kind and 6 * (poses // 2) < x.lengths <= 6 * poses]
            shares.append(sum(not x.consistent for x in own) / len(own) if own else float("nan"))
        rows.append((kind, *shares))
    page.table(("INCONSISTENT", *(f"up to {6 * poses} lengths" for poses in POSES)), rows)


def _conformity(page: Report, found: Sequence[Said]) -> None:
    page.heading("Does the rig meet its limit?")
    page.text(
        f"{LIMIT.words()}, ISO 14253-1:2017 with the test value uncertainty (bar, temperature, marks). A rig meets it "
        "where every true error (measured minus true length) is within the limit."
    )
    rows = []
    for meets in (True, False):
        own = [x for x in found if (x.worst_over_limit <= 1) == meets]
        count = Counter(x.conformity for x in own)
        words = ("pass", "cannot tell", "fail")
        rows.append(("meets it" if meets else "does not meet it", len(own), *(count[word] for word in words)))
    page.table(("rig", "runs", "PASS", "cannot tell", "FAIL"), rows)
    for row, index, word in ((rows[0], 4, "FAIL"), (rows[1], 2, "PASS")):
        share, n = row[index], row[1]
        goal = f"{word} of a rig that {row[0]}: at most {100 - 100 * CONFORMANCE:g} %"
        page.verdict(goal, n == 0 or share <= (1 - CONFORMANCE) * n + 1, f"{share} of {n}")
    page.text("")
