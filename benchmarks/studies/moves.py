"""Cameras that moved behind lenses that no model follows: found, blamed, repaired; and who is accused without a fault.

Rigs A and B in turns, each recording a rig of its own, scale from a bar, the whole of `calibrate` with its repairs.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.judged import Judged, calibrated_and_judged
from benchmarks.studies.realistic import ACCUSATIONS
from benchmarks.studies.report import Report
from benchmarks.studies.simulated import RIGS, reference
from benchmarks.studies.workers import Job, spread
from spherecal.data.session import Session
from spherecal.geometry.camera import project, undistort
from spherecal.geometry.rotation import exp_rotation
from spherecal_sim.rigs import random_rotations
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import CameraMove, SimulationOptions

RUNS = 5
FIRST_SEED = 701
MISFITS_PX = (0.0, 0.03, 0.1)
# shift mm, turn rad; a turn of 50 urad moves images by 0.1 to 0.2 px
MOVES = ((0.05, 0.0), (0.5, 0.0), (5.0, 0.0), (0.0, 50e-6), (0.0, 1e-3), (0.0, np.deg2rad(1.0)))
FAULTLESS = 100  # of each kind, fewer for a first look
NAMED, FALSE_ALARM = 0.95, 0.01
# Cameras turn steadily by up to so much in a recording (drawn log-uniformly), and by a quarter of it at random.
DRIFT_RAD = (5e-6, 2e-4)
PART = 10


@dataclass(frozen=True)
class Told:
    """What a calibration said of cameras: accusing codes, cameras named or repaired; and whether the rig is right."""

    seed: int
    codes: frozenset[str]
    blamed: frozenset[str]
    repaired: frozenset[str]
    verdict: str
    right: bool
    seconds: float
    moved: str = ""

    @property
    def only_blamed(self) -> bool:
        """Whether the camera that moved was named, and no other."""
        return self.blamed == {self.moved}

    @property
    def mended(self) -> bool:
        """Whether that camera alone was repaired, and the rig is usable and right."""
        return self.repaired == {self.moved} and self.verdict != "not-valid" and self.right


def _options(misfit_px: float, moved: CameraMove | None = None) -> SimulationOptions:
    return SimulationOptions(misfit_px=misfit_px, moved=moved, scale="bar", bar_poses=6)


def _told(judged: Judged, seed: int, ids: Sequence[str], moved: str = "") -> Told:
    # what its uncertainty covers is information: of a camera that moved it is a name, of others no accusation
    accusing = [f for f in judged.findings if f.code in ACCUSATIONS and (moved or f.severity != "info")]
    repaired = frozenset(r.value.partition("@")[0] for r in judged.rig.repairs) if judged.rig else frozenset()
    named = {name.partition("@")[0] for f in accusing for name in f.where} & set(ids)
    codes = frozenset(f.code for f in accusing) | {
        f"repaired: {r.option}" for r in (judged.rig.repairs if judged.rig else ())
    }
    return Told(
        seed, codes, frozenset(named) | repaired, repaired, judged.verdict, not judged.wrong and not judged.failure,
        judged.processor_s, moved,
    )  # fmt: skip


def knocked(first: int, runs: int, shift_mm: float, turn_rad: float, misfit_px: float) -> list[Told]:
    """Recordings in which one camera moves once, between any two placements."""
    out = []
    for seed in range(first, first + runs):
        rig, rng = RIGS[seed % 2], np.random.default_rng([seed, 7])
        still = simulate_session(rig, seed, _options(misfit_px))[1]
        name, at = still.cameras[rng.integers(len(still.cameras))].id, int(rng.integers(1, len(still.placements)))
        along, about = (tuple(map(float, r[0])) for r in random_rotations(2, rng))
        move = CameraMove(name, at, shift_mm, turn_rad, along, about)  # type: ignore[arg-type]
        session, truth = simulate_session(rig, seed, _options(misfit_px, move))
        ids = [c.id for c in truth.cameras]
        out.append(_told(calibrated_and_judged(session, reference(truth)), seed, ids, name))
    return out


def faultless(first: int, runs: int, drift: bool) -> list[Told]:
    """Recordings in which nothing was done: still cameras and perfect lenses, or cameras that drift behind 0.03 px."""
    out = []
    for seed in range(first, first + runs):
        session, truth = simulate_session(RIGS[seed % 2], seed, _options(0.03 if drift else 0.0))
        if drift:
            session = _drifting(session, np.random.default_rng([seed, 8]))
        judged = calibrated_and_judged(session, reference(truth))
        if drift:  # poses are those of no one moment
            judged = replace(judged, cameras=())
        out.append(_told(judged, seed, [c.id for c in truth.cameras]))
    return out


def _drifting(session: Session, rng: np.random.Generator) -> Session:
    """The session with cameras that turn about their centres from placement to placement."""
    o = session.observations
    assert o is not None
    size, count = np.exp(rng.uniform(*np.log(DRIFT_RAD))), len(session.placements)
    time = np.minimum(np.arange(len(o.placements)) / (count - 1), 1.0) - 0.5  # bars come after the last placement
    steady, random = rng.normal(size=(1, len(o.cameras), 3)), rng.normal(size=(len(o.placements), len(o.cameras), 3))
    turns = exp_rotation(((time[:, None, None] * steady + random / 4) * size / np.sqrt(3)).reshape(-1, 3))
    lenses = np.array([camera.prior for camera in session.cameras])[o.camera]
    ray = np.column_stack([undistort(o.uv, lenses)[0], np.ones(len(o))])
    turned = np.einsum("nij,nj->ni", turns[o.placement * len(o.cameras) + o.camera], ray)
    return replace(session, observations=replace(o, uv=o.uv + project(turned, lenses) - project(ray, lenses)))


def report(runs: int | None = None) -> Report:
    """The study's page."""
    runs = runs or RUNS
    count = min(FAULTLESS, FAULTLESS * runs // RUNS)
    page = Report("Cameras that moved, and lenses that no model follows", f"dev.py studies moves --runs {runs}")
    page.text(
        f"{runs} recordings (seeds {FIRST_SEED} on, rigs A and B in turns, four placements, ball turned, 0.04 px) of "
        "each move of one camera, before any placement but the first, behind fields of each size. Found: a moved "
        "camera or another fault of images was said or repaired. Blamed: the camera that moved, and no other. "
        "Repaired: it alone was split or left out, and the rig is usable and right. Right: nothing beyond 3 U (as in "
        "the study of realistic recordings), repaired or not. Drift: cameras turn steadily, each its own way, by an "
        "amount drawn for the recording, and by a quarter of it at random."
    )
    cases = [(shift, turn, misfit) for shift, turn in MOVES for misfit in MISFITS_PX]
    parts = [(drift, at) for drift in (False, True) for at in range(0, count, PART)]
    jobs = [Job(knocked, (FIRST_SEED, runs, *case)) for case in cases]
    jobs += [Job(faultless, (FIRST_SEED + at, min(PART, count - at), drift)) for drift, at in parts]
    done = spread(jobs)
    page.heading("Moves")
    rows, all_of = [], dict(zip(cases, done, strict=False))
    for (shift, turn, misfit), told in all_of.items():
        size = f"{shift:g} mm" if shift else f"{1e6 * turn:.0f} urad"
        missed = " ".join(str(t.seed) for t in told if not t.mended)
        figures = [sum(map(f, told)) for f in (lambda t: bool(t.codes), lambda t: t.only_blamed, lambda t: t.mended)]
        rows.append((size, f"{misfit:g}", *figures, sum(t.right for t in told), sum(t.verdict == "valid" for t in told),
                     sum(not t.right and t.verdict == "valid" for t in told), missed))  # fmt: skip
    page.table(
        ("move", "misfit px", "found", "blamed", "repaired", "right", "valid", "wrong and valid", "not: seeds"), rows
    )
    every = [t for told in all_of.values() for t in told]
    page.heading("Without a fault")
    rows, worst = [], {}
    for drift, name in (
        (False, "clean"),
        (True, f"drift of {1e6 * DRIFT_RAD[0]:g} to {1e6 * DRIFT_RAD[1]:g} urad, 0.03 px"),
    ):
        own = [t for (of, _), part in zip(parts, done[len(cases) :], strict=True) if of == drift for t in part]
        codes = Counter(code for t in own for code in t.codes)
        worst[name] = max(codes.values(), default=0)
        seeds = {code: [t.seed for t in own if code in t.codes] for code in codes}
        words = ", ".join(f"{code} {n} ({' '.join(map(str, seeds[code][:6]))})" for code, n in codes.most_common())
        verdicts = Counter(t.verdict for t in own)
        said = (verdicts[verdict] for verdict in ("valid", "use-with-care", "not-valid"))
        wrong = sum(not t.right and t.verdict == "valid" for t in own)
        rows.append((name, len(own), words or "none", *said, wrong))
    page.table(("recordings", "n", "accused or repaired", "valid", "with care", "not valid", "wrong and valid"), rows)
    page.text(
        f"Processor seconds of a calibration: {np.mean([t.seconds for part in done for t in part]):.1f} in the mean."
    )
    page.heading("Goals")
    for misfit in MISFITS_PX:
        own = [t for case, told in all_of.items() if case[2] == misfit for t in told]
        for word, f in (("blamed", lambda t: t.only_blamed), ("repaired", lambda t: t.mended)):
            n = sum(map(f, own))
            page.verdict(f"{misfit:g} px: {word} in at least {NAMED:.0%}", n >= NAMED * len(own), f"{n} of {len(own)}")
    wrong = sum(not t.right and t.verdict == "valid" for t in every)
    page.verdict("moved, wrong and valid: 0", not wrong, f"{wrong} of {len(every)}")
    for name, most in worst.items():
        page.verdict(
            f"{name}: no accusation in more than {FALSE_ALARM:.0%}", most <= FALSE_ALARM * count, f"{most} of {count}"
        )
    return page
