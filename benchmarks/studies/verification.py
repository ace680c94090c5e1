"""Verification with two bars: do the intervals hold the truth, and do faults lead to the right verdict?

The simulation errs as the budget says that things err: certificates normally with U / 2, thermometers evenly within
0.5 K (the same in all poses of a bar, for a mean does not average it), coefficients of expansion evenly within 10 %,
image points normally; every rig is calibrated anew from images of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.report import Report
from spherecal.calibrate import calibrate
from spherecal.data.rig import Rig
from spherecal.data.session import Session
from spherecal.scale.bar_temperature import EXPANSION_RELATIVE_SD, temperature_sd
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import CameraMove, SimulationOptions, Truth
from spherecal_verify.doubts import DOUBTS
from spherecal_verify.limit import LengthLimit
from spherecal_verify.verification import Verification
from spherecal_verify.verify_bars import VerifySettings, verify

RUNS = 200
OTHER_RIG, OTHER_RUNS = "rigB", 50
# The budget of a scale from printed targets holds their scatter: they are printed to 0.01 mm, as good printers do.
OPTIONS = SimulationOptions(targets=100, placements=4, bar_poses=8, print_sd_mm=0.01)
LIMIT = LengthLimit(0.1, 20_000.0)
LEAST, MOST = 0.93, 0.97
CERTIFICATE_MM, THERMOMETER_K = 0.15, 5.0
SHIFT_MM, TURN_DEG = 0.2, 0.02


# Half widths of what the budget takes as evenly distributed.
THERMOMETER_ERROR_K = float(np.sqrt(3.0)) * temperature_sd(20.0)
EXPANSION_ERROR = float(np.sqrt(3.0)) * EXPANSION_RELATIVE_SD
_READ_TO_K = 0.1


@dataclass(frozen=True)
class Terms:
    """Real errors of all lengths (n,) in mm, and the standard uncertainties (n,) that the budget states for them."""

    real: np.ndarray
    stated: np.ndarray


TERMS = ("image points", "cameras and scale", "certificate", "thermometer and expansion", "all together")


@dataclass(frozen=True)
class Run:
    """One rig's intact verification and its errors term by term (TERMS)."""

    intact: Verification
    terms: tuple[Terms, ...]


@dataclass(frozen=True)
class Faults:
    """The same rig verified with one fault each, and the camera that was moved."""

    certificate: Verification
    thermometer: Verification
    drifted: Verification
    camera: str


def intact_run(rig_name: str, seed: int) -> tuple[Run, Session, Truth, Rig]:
    """A rig, ball and bars of their own, calibrated from the ball and verified; all errs as the budget states."""
    session, truth = simulate_session(rig_name, seed, OPTIONS)
    session = as_stated(session, truth, np.random.default_rng([78, seed]))
    rig = calibrate(session).rig
    found = _verified(session, rig)
    assert session.observations is not None
    silent = replace(session, observations=replace(session.observations, uv=truth.uv_true_px))
    return Run(found, _terms(session, truth, found, _verified(silent, rig))), session, truth, rig


def as_stated(session: Session, truth: Truth, rng: np.random.Generator) -> Session:
    """The session with thermometers and coefficients of expansion that err as the budget says."""
    offset = {bar.id: rng.uniform(-THERMOMETER_ERROR_K, THERMOMETER_ERROR_K) for bar in session.bars}
    stretch = {bar.id: 1 + rng.uniform(-EXPANSION_ERROR, EXPANSION_ERROR) for bar in session.bars}
    true = {pose.id: pose.temperature_c for pose in truth.bar_poses}
    poses = tuple(
        replace(p, temperature_c=round((true[p.id] + offset[p.bar]) / _READ_TO_K) * _READ_TO_K)
        for p in session.bar_poses
    )
    bars = tuple(replace(b, expansion_per_kelvin=b.expansion_per_kelvin * stretch[b.id]) for b in session.bars)
    return replace(session, bars=bars, bar_poses=poses)


def _terms(session: Session, truth: Truth, found: Verification, silent: Verification) -> tuple[Terms, ...]:
    """What is behind each error: the noise, the rig (seen without noise), the certificate, the bar's temperature."""
    warm = {pose.id: pose.temperature_c for pose in truth.bar_poses}
    certified = {(b.id, x.from_mark, x.to_mark): x.length_mm for b in session.bars for x in b.lengths}
    rows = []
    for m, quiet in zip(found.measured, silent.measured, strict=True):
        bar = truth.bar(m.bar)
        place = dict(zip(bar.marks, bar.x_mm, strict=True))
        cold = float(place[m.to_mark] - place[m.from_mark])
        true = cold * (1 + bar.expansion_per_kelvin * (warm[m.pose] - bar.reference_temperature_c))
        wrong = certified[m.key] - cold
        u = m.budget
        rows.append(
            [
                (m.length_mm - quiet.length_mm, u.noise_mm),
                (quiet.length_mm - true, np.hypot(u.calibration_mm, u.scale_mm)),
                (-wrong, u.certificate_mm),
                (true + wrong - m.reference_mm, u.temperature_mm),
                (m.error_mm, u.combined_mm),
            ]
        )
    table = np.array(rows)
    return tuple(Terms(table[:, i, 0], table[:, i, 1]) for i in range(len(TERMS)))


def faulty_runs(rig_name: str, seed: int, session: Session, truth: Truth, rig: Rig) -> Faults:
    """The rig as calibrated, verified with a wrong certificate, with a wrong thermometer, with a camera moved."""
    camera = session.cameras[seed % len(session.cameras)].id
    rng = np.random.default_rng([77, seed])
    move = CameraMove(camera, len(truth.placements), SHIFT_MM, float(np.deg2rad(TURN_DEG)), _unit(rng), _unit(rng))
    moved, _ = simulate_session(rig_name, seed, replace(OPTIONS, moved=move))
    moved = replace(moved, bars=session.bars, bar_poses=session.bar_poses)
    return Faults(
        _verified(_wrong_certificate(session), rig), _verified(_warm(session), rig), _verified(moved, rig), camera
    )


def _unit(rng: np.random.Generator) -> tuple[float, float, float]:
    vector = rng.normal(size=3)
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return x, y, z


def _verified(session: Session, rig: Rig) -> Verification:
    return verify(session, rig, None, VerifySettings(LIMIT))


def _wrong_certificate(session: Session) -> Session:
    """Bar A's longest length is stated wrong."""
    bar = session.bars[0]
    longest = max(bar.lengths, key=lambda x: x.length_mm)
    lengths = tuple(replace(x, length_mm=x.length_mm + CERTIFICATE_MM * (x is longest)) for x in bar.lengths)
    return replace(session, bars=(replace(bar, lengths=lengths), *session.bars[1:]))


def _warm(session: Session) -> Session:
    """Bar A's thermometer reads too much."""
    poses = tuple(
        replace(p, temperature_c=(p.temperature_c or 0.0) + THERMOMETER_K) if p.bar == "A" else p
        for p in session.bar_poses
    )
    return replace(session, bar_poses=poses)


def covered(verification: Verification) -> tuple[list[bool], list[bool]]:
    """Whether the intervals hold zero, the error of a perfect rig: of means, and of single lengths."""
    assert verification.procedure is not None
    means = []
    for length in verification.lengths:
        assert length.mean_error_mm is not None and length.expanded_uncertainty_mm is not None
        means.append(abs(length.mean_error_mm) <= length.expanded_uncertainty_mm)
    return means, [abs(m.error_mm) <= 2 * m.budget.combined_mm for m in verification.measured]


def verdict(verification: Verification) -> str | None:
    """Against the limit."""
    acceptance = verification.procedure.acceptance if verification.procedure else None
    return None if acceptance is None else acceptance.verdict


def named(verification: Verification, code: str) -> tuple[str, ...]:
    """Where the findings of a code point."""
    return tuple(place for f in verification.findings if f.code == code for place in f.where)


def doubts(verification: Verification) -> tuple[str, ...]:
    """What kept a pass from being one, or would have."""
    return tuple(f.code for f in verification.findings if f.code in DOUBTS)


def report(runs: int | None = None) -> Report:
    """200 verifications of as many rigs A, with faults; 50 of rigs B."""
    runs = runs or RUNS
    page = Report("Verification with reference bars", "python3 dev.py studies verification")
    found, faults = [], []
    for seed in range(1, runs + 1):
        run, session, truth, rig = intact_run("rigA", seed)
        found.append(run)
        faults.append(faulty_runs("rigA", seed, session, truth, rig))
    page.text(
        "Every run is a rig of its own, calibrated from four placements of its own ball (100 targets, noise 0.04 px, "
        f"scale from the spacing of dots printed to {OPTIONS.print_sd_mm:g} mm), then verified with two bars of four "
        f"marks, three certified lengths and {OPTIONS.bar_poses} poses each. What errs does so as the budget states: "
        "certificates normally "
        f"(U = 4 um, k = 2), thermometers evenly within {THERMOMETER_ERROR_K:g} K (alike in all poses of a bar), "
        f"coefficients of expansion evenly within {100 * EXPANSION_ERROR:g} %."
    )
    _intervals(page, "Intervals, rig A", found)
    _verdicts(page, found, faults)
    other = [intact_run(OTHER_RIG, seed)[0] for seed in range(1, max(1, runs * OTHER_RUNS // RUNS) + 1)]
    _intervals(page, "Intervals, rig B", other, judged=False)
    return page


def _intervals(page: Report, title: str, found: Sequence[Run], judged: bool = True) -> None:
    page.heading(title)
    page.text(
        f"{len(found)} runs. A perfect rig's error is zero: counted is how often the interval (95.45 %) holds it. "
        "Lengths of one run err together, so the standard error comes from runs."
    )
    rows = []
    for i, name in enumerate(("mean of the poses of a length", "single length")):
        by_run = np.array([np.mean(covered(run.intact)[i]) for run in found])
        error = float(by_run.std(ddof=1) / np.sqrt(len(by_run))) if len(by_run) > 1 else float("nan")
        rows.append((name, float(by_run.mean()), error))
    page.table(("interval", "share that holds the truth", "standard error"), rows)
    for name, share, error in rows if judged else ():
        page.verdict(
            f"{name}: 93 to 97 % hold the truth", LEAST <= share <= MOST, f"{100 * share:.1f} ± {100 * error:.1f} %"
        )
    page.text("", "Term by term: root mean squares of the real errors and of the standard uncertainties stated.")
    terms = []
    for i, name in enumerate(TERMS):
        by_run = np.array([np.mean(np.square(run.terms[i].real / run.terms[i].stated)) for run in found])
        ratio = float(np.sqrt(by_run.mean()))
        error = float(by_run.std(ddof=1) / np.sqrt(len(by_run)) / (2 * ratio)) if len(by_run) > 1 else float("nan")
        real, stated = (
            1e3 * float(np.sqrt(np.mean([np.mean(np.square(getattr(run.terms[i], one))) for run in found])))
            for one in ("real", "stated")
        )
        terms.append((name, real, stated, ratio, error))
    page.table(("term", "real um", "stated um", "real / stated", "standard error"), terms)
    alarms = sum(run.intact.decision.verdict != "consistent" for run in found)
    u = np.array([x.expanded_uncertainty_mm for run in found for x in run.intact.lengths if x.n])
    page.text(
        f"U of a mean: median {np.median(u):.4f} mm. Errors and uncertainties of all lengths together were called "
        f"inconsistent in {alarms} of {len(found)} runs (1 % or fewer are to be expected)."
    )


def _verdicts(page: Report, found: Sequence[Run], faults: Sequence[Faults]) -> None:
    n = len(found)
    page.heading("Verdicts, rig A")
    page.text(
        f"Limit {LIMIT.words()}, decided by ISO 14253-1:2017. Faults, one at a time on the same rig: bar A's longest "
        f"length certified {CERTIFICATE_MM:g} mm too long; bar A's thermometer {THERMOMETER_K:g} K too warm; a camera "
        f"shifted by {SHIFT_MM:g} mm and turned by {TURN_DEG:g} degrees (any way) after the calibration."
    )
    cases = (
        ("nothing", [run.intact for run in found], sum(not doubts(run.intact) for run in found)),
        (
            "wrong certificate",
            [run.certificate for run in faults],
            sum(named(run.certificate, "length-doubtful") == ("A",) for run in faults),
        ),
        (
            "thermometer",
            [run.thermometer for run in faults],
            sum("A" in named(run.thermometer, "temperatures-differ") for run in faults),
        ),
        (
            "drifted camera",
            [run.drifted for run in faults],
            sum(named(run.drifted, "camera-moved") == (run.camera,) for run in faults),
        ),
    )
    rows = []
    for name, verifications, right in cases:
        words = [verdict(one) for one in verifications]
        rows.append((name, n, words.count("pass"), words.count("cannot tell"), words.count("fail"), right))
    page.table(("fault", "runs", "pass", "cannot tell", "fail", "fault named, and nothing else of its kind"), rows)
    page.verdict("an intact rig passes in 95 % of the runs or more", rows[0][2] >= 0.95 * n, f"{rows[0][2]} of {n}")
    for name, _, passed, _, _, right in rows[1:]:
        page.verdict(f"{name}: never a pass", passed == 0, f"{passed} of {n} passed")
        page.verdict(f"{name}: named in 95 % of the runs or more", right >= 0.95 * n, f"{right} of {n}")
    for name, _, _, unsure, _, _ in rows[1:3]:
        page.verdict(
            f"{name}: no verdict on the rig (cannot tell) in 95 % of the runs or more",
            unsure >= 0.95 * n,
            f"{unsure} of {n}",
        )
    page.text("")
