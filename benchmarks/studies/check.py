"""The quick check: false alarms, and the smallest motion of each camera that is named."""

import time
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.report import Report
from spherecal.calibrate import calibrate
from spherecal.data.rig import Rig
from spherecal.data.session import Session
from spherecal_rigs.check_rig import check
from spherecal_sim.simulate_session import observe_again, simulate_session
from spherecal_sim.truth import CameraMove, SimulationOptions, Truth

RIGS, CHECKS = 10, 20  # false alarms: 200 checks
REPEATS = 5
SHIFTS_MM = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12)
TURNS_DEG = (0.0005, 0.001, 0.002, 0.003, 0.005, 0.01)
OPTIONS = SimulationOptions(targets=100, placements=5, bar_poses=0)
_CALIBRATED = 4  # placements; the fifth is the check's


def calibrated(rig: str, seed: int) -> tuple[Session, Truth, Rig]:
    """A rig calibrated from four placements, and the session with its fifth."""
    session, truth = simulate_session(rig, seed, OPTIONS)
    return session, truth, calibrate(part(session, range(_CALIBRATED))).rig


def part(session: Session, which: range) -> Session:
    """Some placements of a session."""
    o = session.observations
    assert o is not None
    names = tuple(session.placements[i].id for i in which)
    index = np.array([names.index(name) if name in names else -1 for name in o.placements])
    o = o.select(index[o.placement] >= 0)
    return replace(
        session,
        placements=tuple(session.placements[i] for i in which),
        bar_poses=(),
        observations=replace(o, placements=names, placement=index[o.placement]),
    )


@dataclass(frozen=True)
class Alarms:
    """Checks of unchanged rigs: how many, verdicts other than OK, cameras named, seconds of the slowest."""

    checks: int
    not_ok: int
    cameras: int
    slowest_s: float


def false_alarms(rigs: int, checks: int, preset: str = "rigA") -> Alarms:
    """Unchanged rigs checked again and again with new noise."""
    not_ok = cameras = 0
    slowest = 0.0
    for seed in range(1, rigs + 1):
        session, truth, rig = calibrated(preset, seed)
        for number in range(checks):
            again, _ = observe_again(session, truth, np.random.default_rng([9, seed, number]))
            began = time.perf_counter()
            found = check(part(again, range(_CALIBRATED, _CALIBRATED + 1)), rig)
            slowest = max(slowest, time.perf_counter() - began)
            not_ok += found.verdict != "ok"
            cameras += len(found.to_repair)
    return Alarms(rigs * checks, not_ok, cameras, slowest)


@dataclass(frozen=True)
class Sensitivity:
    """Of one camera: for each shift and turn, the share of runs that named it and no other; verdict "recalibrate"."""

    camera: str
    shifts: tuple[float, ...]
    turns: tuple[float, ...]
    recalibrate_shift_mm: float | None
    recalibrate_turn_deg: float | None


def sensitivity(rig: Rig, preset: str, seed: int, camera: str, repeats: int) -> Sensitivity:
    """Moves in random directions."""
    shares, first = [], []
    for kind, sizes in (("shift", SHIFTS_MM), ("turn", TURNS_DEG)):
        named, least = [], None
        for size in sizes:
            hits = alarms = 0
            for repeat in range(repeats):
                rng = np.random.default_rng([5, seed, repeat, round(1e6 * size)])
                directions = [tuple((v / np.linalg.norm(v)).tolist()) for v in rng.normal(size=(2, 3))]
                shift, turn = (size, 0.0) if kind == "shift" else (0.0, float(np.deg2rad(size)))
                move = CameraMove(camera, _CALIBRATED, shift, turn, *directions)  # type: ignore[arg-type]
                session, truth = simulate_session(preset, seed, replace(OPTIONS, moved=move))
                again, _ = observe_again(session, truth, rng)
                found = check(part(again, range(_CALIBRATED, _CALIBRATED + 1)), rig)
                hits += found.to_repair == (camera,)
                alarms += found.verdict == "recalibrate"
            named.append(hits / repeats)
            least = size if least is None and alarms == repeats else least
        shares.append(tuple(named))
        first.append(least)
    return Sensitivity(camera, shares[0], shares[1], first[0], first[1])


def smallest(shares: tuple[float, ...], sizes: tuple[float, ...]) -> float | None:
    """The smallest size from which on every run named the camera."""
    found = None
    for share, size in zip(reversed(shares), reversed(sizes), strict=True):
        if share < 1.0:
            break
        found = size
    return found


def report(runs: int | None = None) -> Report:
    """200 checks of 10 unchanged rigs A; every camera of one rig moved in 12 ways, 5 times each."""
    page = Report("Quick check", "python3 dev.py studies check")
    rigs = RIGS if runs is None else max(1, runs // CHECKS)
    alarms = false_alarms(rigs, CHECKS if runs is None else max(runs // rigs, 1))
    page.heading("False alarms")
    page.text(
        "Rig A calibrated from four placements, nothing changed, checked with a fifth placement of the ball: "
        "100 targets, noise 0.04 px."
    )
    page.table(
        ("checks", "verdict not OK", "cameras named", "slowest check, s"),
        [(alarms.checks, alarms.not_ok, alarms.cameras, alarms.slowest_s)],
    )
    page.verdict(
        "false alarms in at most 2 % of the checks",
        alarms.not_ok <= max(0.02 * alarms.checks, 1),
        f"{alarms.not_ok} of {alarms.checks}",
    )
    page.verdict("a check takes less than 10 s", alarms.slowest_s < 10, f"{alarms.slowest_s:.2f} s")
    page.text("")
    _sensitivity(page, REPEATS if runs is None else min(REPEATS, max(1, runs // 10)), None if runs is None else runs)
    return page


def _sensitivity(page: Report, repeats: int, most: int | None) -> None:
    session, _, rig = calibrated("rigA", 1)
    cameras = [c.id for c in session.cameras][: None if most is None or most >= 50 else 3]
    found = [sensitivity(rig, "rigA", 1, camera, repeats) for camera in cameras]
    tolerance = rig.length_map.typical_mm if rig.length_map else None
    page.heading("Smallest motion that is named")
    page.text(
        f"One camera at a time is shifted or turned after the calibration, {repeats} times in random directions each: "
        "the smallest motion from which on it is named in every run, and no other camera with it; and that from "
        f"which on the verdict is always recalibrate (a point is measured wrong by more than {tolerance or 0:.3f} mm, "
        "the rig's uncertainty of 500 mm)."
    )
    rows = []
    for one in found:
        cells = (
            smallest(one.shifts, SHIFTS_MM),
            one.recalibrate_shift_mm,
            smallest(one.turns, TURNS_DEG),
            one.recalibrate_turn_deg,
        )
        rows.append((one.camera, *("above" if cell is None else cell for cell in cells)))
    page.table(("camera", "shift named, mm", "recalibrate, mm", "turn named, deg", "recalibrate, deg"), rows)
    largest = [(one.shifts[-1], one.turns[-1]) for one in found]
    page.verdict(
        f"every camera: {SHIFTS_MM[-1]:g} mm and {TURNS_DEG[-1]:g} deg are named in every run",
        all(share == 1.0 for pair in largest for share in pair),
        f"{sum(s == 1.0 for s, _ in largest)} and {sum(t == 1.0 for _, t in largest)} of {len(found)} cameras",
    )
    page.text("")
