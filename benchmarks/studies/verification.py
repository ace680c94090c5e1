"""Verification of rig A with two bars: do the intervals hold the truth, and do faults lead to the right verdict?"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.report import Report
from spherecal.calibrate import calibrate
from spherecal.rig import Rig
from spherecal.session.model import Session
from spherecal.simulate.session import simulate_session
from spherecal.simulate.truth import CameraMove, SimulationOptions
from spherecal.verify.bars import VerifySettings, verify
from spherecal.verify.limit import LengthLimit
from spherecal.verify.verification import Verification

RUNS = 200
OPTIONS = SimulationOptions(targets=100, placements=4, bar_poses=8)
LIMIT = LengthLimit(0.1, 20_000.0)
LEAST, MOST = 0.93, 0.97
CERTIFICATE_MM, THERMOMETER_K = 0.15, 5.0
SHIFT_MM, TURN_DEG = 0.2, 0.02


@dataclass(frozen=True)
class Run:
    """One rig: its intact verification and those with faults, and the camera that was moved."""

    intact: Verification
    certificate: Verification
    thermometer: Verification
    drifted: Verification
    camera: str


def one_run(seed: int) -> Run:
    """A rig, ball and bars of their own, calibrated from the ball; bars, thermometer and noise err as stated."""
    session, truth = simulate_session("rigA", seed, OPTIONS)
    rig = calibrate(session).rig
    camera = session.cameras[seed % len(session.cameras)].id
    rng = np.random.default_rng([77, seed])
    move = CameraMove(
        camera, len(truth.placements), SHIFT_MM, float(np.deg2rad(TURN_DEG)), _unit(rng), _unit(rng)
    )  # fmt: skip
    moved, _ = simulate_session("rigA", seed, replace(OPTIONS, moved=move))
    return Run(
        _verified(session, rig), _verified(_wrong_certificate(session), rig), _verified(_warm(session), rig),
        _verified(moved, rig), camera,
    )  # fmt: skip


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
    means = [abs(x.mean_error_mm) <= x.expanded_uncertainty_mm for x in verification.lengths]
    assert verification.procedure is not None
    u = {budget.key: budget.expanded_mm for budget in verification.procedure.budgets}
    return means, [abs(m.error_mm) <= u[m.key] for m in verification.measured]


def verdict(verification: Verification) -> str | None:
    """Against the limit."""
    acceptance = verification.procedure.acceptance if verification.procedure else None
    return None if acceptance is None else acceptance.verdict


def named(verification: Verification, code: str) -> tuple[str, ...]:
    """Where the findings of a code point."""
    return tuple(place for f in verification.findings if f.code == code for place in f.where)


def doubts(verification: Verification) -> tuple[str, ...]:
    """What kept a pass from being one, or would have."""
    from spherecal.verify.doubts import DOUBTS

    return tuple(f.code for f in verification.findings if f.code in DOUBTS)


def report(runs: int | None = None) -> Report:
    """200 verifications of as many rigs."""
    runs = runs or RUNS
    page = Report("Verification with reference bars", "python3 dev.py studies verification")
    found = [one_run(seed) for seed in range(1, runs + 1)]
    _intervals(page, found)
    _verdicts(page, found)
    return page


def _intervals(page: Report, found: list[Run]) -> None:
    page.heading("Intervals")
    page.text(
        f"{len(found)} rigs A, each calibrated from {OPTIONS.placements} placements of its own ball, then verified "
        f"with two bars of four marks in {OPTIONS.bar_poses} poses each. Noise 0.04 px; certificates err by their "
        "stated uncertainty (U = 4 um, k = 2), thermometers by 0.05 K. A perfect rig's error is zero: counted is how "
        "often the interval (95.45 %) holds it. Lengths of one run err together, so the standard error comes from runs."
    )
    rows = []
    for i, name in enumerate(("mean of the poses of a length", "single length")):
        by_run = np.array([np.mean(covered(run.intact)[i]) for run in found])
        error = float(by_run.std(ddof=1) / np.sqrt(len(by_run))) if len(by_run) > 1 else float("nan")
        rows.append((name, float(by_run.mean()), error))
    page.table(("interval", "share that holds the truth", "standard error"), rows)
    for name, share, error in rows:
        page.verdict(
            f"{name}: 93 to 97 % hold the truth", LEAST <= share <= MOST, f"{100 * share:.1f} ± {100 * error:.1f} %"
        )
    page.text("")
    errors = np.array([x.mean_error_mm for run in found for x in run.intact.lengths if x.n])
    u = np.array([x.expanded_uncertainty_mm for run in found for x in run.intact.lengths if x.n])
    page.text(
        f"Mean errors: sd {errors.std():.4f} mm, largest {np.abs(errors).max():.4f} mm; U of a mean: median "
        f"{np.median(u):.4f} mm."
    )


def _verdicts(page: Report, found: list[Run]) -> None:
    n = len(found)
    page.heading("Verdicts")
    page.text(
        f"Limit {LIMIT.words()}, decided by ISO 14253-1. Faults, one at a time on the same rig: bar A's longest length "
        f"certified {CERTIFICATE_MM:g} mm too long; bar A's thermometer {THERMOMETER_K:g} K too warm; a camera shifted "
        f"by {SHIFT_MM:g} mm and turned by {TURN_DEG:g} degrees (any way) after the calibration."
    )
    cases = (
        ("nothing", [run.intact for run in found], sum(not doubts(run.intact) for run in found)),
        ("wrong certificate", [run.certificate for run in found],
         sum(named(run.certificate, "length-doubtful") == ("A",) for run in found)),
        ("thermometer", [run.thermometer for run in found],
         sum("A" in named(run.thermometer, "temperatures-differ") for run in found)),
        ("drifted camera", [run.drifted for run in found],
         sum(named(run.drifted, "camera-moved") == (run.camera,) for run in found)),
    )  # fmt: skip
    rows = []
    for name, verifications, right in cases:
        words = [verdict(one) for one in verifications]
        rows.append((name, n, words.count("pass"), words.count("cannot tell"), words.count("fail"), right))
    page.table(("fault", "runs", "pass", "cannot tell", "fail", "fault named, and nothing else of its kind"), rows)
    page.verdict("an intact rig passes in 95 % of the runs or more", rows[0][2] >= 0.95 * n, f"{rows[0][2]} of {n}")
    for name, _, passed, _, _, right in rows[1:]:
        page.verdict(f"{name}: never a pass", passed == 0, f"{passed} of {n} passed")
        page.verdict(f"{name}: named in 95 % of the runs or more", right >= 0.95 * n, f"{right} of {n}")
    page.text("")
