"""Faults put into simulated recordings: which are named, and what is named in recordings without a fault."""

from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from multiprocessing import get_context

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.studies.report import Report
from benchmarks.studies.simulated import RIGS
from spherecal.calibrate import calibrate
from spherecal.data.findings import Finding
from spherecal.data.observations import Observations
from spherecal.data.session import Session
from spherecal.steps.settings import CalibrationSettings, Method
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import CameraMove, SimulationOptions, Truth

RUNS = 50
CLEAN = 200  # recordings without a fault; fewer for a first look
PART, PROCESSES = 25, 2
FIRST_SEED = 501  # 1 to 50 served to find the faults of the method
NAMED, FALSE_ALARM = 0.95, 0.01
# told of every rig, whatever its state
ALWAYS = {"form-rigid", "form-free", "outliers-removed", "scale-uncertainty", "print-scale", "length-uncertainty"}


@dataclass(frozen=True)
class Case:
    """A recording with a fault: the session, the finding that must come, and ids that it must name."""

    session: Session
    code: str
    where: tuple[str, ...] = ()
    method: Method = "auto"

    def named(self, findings: Sequence[Finding]) -> bool:
        """Whether the finding came and names all that it must."""
        return any(f.code == self.code and set(self.where) <= set(f.where) for f in findings)


Make = Callable[[str, int, np.random.Generator], Case]


def _simulate(rig: str, seed: int, **options: object) -> tuple[Session, Truth]:
    chosen = SimulationOptions(**{"bar_poses": 0, **options})  # type: ignore[arg-type]
    return simulate_session(rig, seed, chosen)


def _camera(rig: str, rng: np.random.Generator) -> tuple[int, str]:
    index = int(rng.integers({"rigA": 10, "rigB": 12, "demo": 6}[rig]))
    return index, f"C{index + 1:02d}" if rig != "demo" else f"C{index + 1}"


def _direction(rng: np.random.Generator) -> tuple[float, float, float]:
    d = rng.normal(size=3)
    x, y, z = d / np.linalg.norm(d)
    return float(x), float(y), float(z)


def moved(shift_mm: float = 0.0, turn_rad: float = 0.0, **options: object) -> Make:
    """A camera that moves once, between any two placements."""

    def make(rig: str, seed: int, rng: np.random.Generator) -> Case:
        session, _ = _simulate(rig, seed)
        name = session.cameras[rng.integers(len(session.cameras))].id
        at = int(rng.integers(1, len(session.placements)))
        move = CameraMove(name, at, shift_mm, turn_rad, _direction(rng), _direction(rng))
        method = options.get("method", "auto")
        session, _ = _simulate(rig, seed, moved=move, **{k: v for k, v in options.items() if k != "method"})
        where = (name,) if method == "free" else (name, session.placements[at].id)
        return Case(session, "camera-moved", where, method)  # type: ignore[arg-type]

    return make


def blurred(sigma_px: float) -> Make:
    """A camera out of focus."""

    def make(rig: str, seed: int, rng: np.random.Generator) -> Case:
        session, _ = _simulate(rig, seed)
        name = session.cameras[rng.integers(len(session.cameras))].id
        return Case(_simulate(rig, seed, blurred={name: sigma_px})[0], "camera-noisy", (name,))

    return make


def shape(rms_mm: float, **options: object) -> Make:
    """A ball whose shape changes at all placements."""

    def make(rig: str, seed: int, rng: np.random.Generator) -> Case:
        return Case(_simulate(rig, seed, shape_change_mm=rms_mm, **options)[0], "ball-shape-changed")

    return make


def shape_at_one(rms_mm: float) -> Make:
    """A ball that has another shape at one placement."""

    def make(rig: str, seed: int, rng: np.random.Generator) -> Case:
        session, truth = _simulate(rig, seed)
        bent, _ = _simulate(rig, seed, shape_change_mm=rms_mm)
        assert session.observations is not None and bent.observations is not None
        if not _same_rows(session.observations, bent.observations):  # a dot came into or out of view
            return shape_at_one(rms_mm)(rig, seed + 1000, rng)
        at = int(rng.integers(len(truth.placements)))
        there = (session.observations.placement == at)[:, None]
        uv = np.where(there, bent.observations.uv, session.observations.uv)
        spoilt = replace(session, observations=replace(session.observations, uv=uv))
        return Case(spoilt, "ball-shape-changed", (truth.placements[at],))

    return make


def _same_rows(a: Observations, b: Observations) -> bool:
    names = ("placement", "camera", "target", "point")
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)


def misfit(rms_px: float, method: Method = "auto") -> Make:
    """Lenses that the model cannot follow."""

    def make(rig: str, seed: int, rng: np.random.Generator) -> Case:
        return Case(_simulate(rig, seed, misfit_px=rms_px)[0], "lens-field", (), method)

    return make


def exchange(session: Session, a: int, b: int, placements: Sequence[int]) -> Session:
    """The session with the images of two cameras exchanged at some placements (all indices)."""
    o = session.observations
    assert o is not None
    there = np.isin(o.placement, placements)
    camera = o.camera.copy()
    camera[there & (o.camera == a)] = b
    camera[there & (o.camera == b)] = a
    return replace(session, observations=replace(o, camera=camera))


def swapped_once(rig: str, seed: int, rng: np.random.Generator) -> Case:
    """Two cameras' images exchanged at one placement."""
    session, _ = _simulate(rig, seed)
    a, b = rng.choice(len(session.cameras), 2, replace=False)
    at = int(rng.integers(len(session.placements)))
    names = (session.cameras[a].id, session.cameras[b].id, session.placements[at].id)
    return Case(exchange(session, a, b, [at]), "cameras-swapped", names)


def swapped(rig: str, seed: int, rng: np.random.Generator) -> Case:
    """Two cameras' images exchanged in all of a session whose intrinsics are known."""
    session, truth = _simulate(rig, seed)
    cameras = tuple(
        replace(camera, prior=true.intrinsics) for camera, true in zip(session.cameras, truth.cameras, strict=True)
    )
    a, b = rng.choice(len(cameras), 2, replace=False)
    both = exchange(replace(session, cameras=cameras), a, b, range(len(session.placements)))
    return Case(both, "cameras-swapped", (cameras[a].id, cameras[b].id))


def stale(rig: str, seed: int, rng: np.random.Generator) -> Case:
    """A camera's image of one placement stored for another one too."""
    session, _ = _simulate(rig, seed)
    o = session.observations
    assert o is not None
    c = int(rng.integers(len(session.cameras)))
    at, source = (int(t) for t in rng.choice(len(session.placements), 2, replace=False))
    keep = np.flatnonzero((o.camera != c) | (o.placement != at))
    again = np.flatnonzero((o.camera == c) & (o.placement == source))
    both = o.select(np.concatenate([keep, again]))
    both = replace(both, placement=np.where(np.arange(len(both)) < len(keep), both.placement, at))
    names = (session.cameras[c].id, session.placements[at].id, session.placements[source].id)
    return Case(replace(session, observations=both), "wrong-placement", names)


def focal(factor: float, everyone: bool = False) -> Make:
    """A wrong focal length in the prior of one camera, or of all."""

    def make(rig: str, seed: int, rng: np.random.Generator) -> Case:
        session, _ = _simulate(rig, seed)
        c = int(rng.integers(len(session.cameras)))
        cameras = tuple(
            replace(camera, prior=camera.prior * np.r_[factor, factor, np.ones(14)]) if everyone or i == c else camera
            for i, camera in enumerate(session.cameras)
        )
        return Case(replace(session, cameras=cameras), "prior-focal-length", (cameras[c].id,))

    return make


def twice_the_same(rig: str, seed: int, rng: np.random.Generator) -> Case:
    """Two stickers on the ball with one number; where an image shows both, the one found first."""
    session, _ = _simulate(rig, seed)
    o = session.observations
    assert o is not None
    images = o.placement * len(o.cameras) + o.camera
    often = [t for t in np.unique(o.target) if len(np.unique(images[o.target == t])) >= 6]
    while True:  # three images or more must show the second one alone
        a, b = (int(t) for t in rng.choice(often, 2, replace=False))
        both = np.intersect1d(images[o.target == a], images[o.target == b])
        if len(np.setdiff1d(images[o.target == b], both)) >= 3:
            break
    keep = (o.target != b) | ~np.isin(images, both)
    target = np.where(o.target == b, a, o.target)
    spoilt = replace(o, target=target).select(keep)
    return Case(replace(session, observations=spoilt), "target-contradicts", (str(a),))


def placed_badly(layout: str, code: str) -> Make:
    """Placements close together, or one behind the other."""

    def make(rig: str, seed: int, rng: np.random.Generator) -> Case:
        return Case(_simulate(rig, seed, layout=layout)[0], code)

    return make


def wrong_bar(rig: str, seed: int, rng: np.random.Generator) -> Case:
    """A bar that gives the scale with certified lengths 2 % too large."""
    session, _ = _simulate(rig, seed, scale="bar", bar_poses=6)
    bars = tuple(
        replace(bar, lengths=tuple(replace(one, length_mm=1.02 * one.length_mm) for one in bar.lengths))
        for bar in session.bars
    )
    return Case(replace(session, bars=bars), "scale-conflict")


def thread(rig: str, seed: int, rng: np.random.Generator) -> Case:
    """A camera that alone holds two halves of the rig together: 15 points are left that both halves see."""
    session, truth = _simulate(rig, seed)
    o = session.observations
    assert o is not None
    along = np.argsort([camera.centre_mm[0] for camera in truth.cameras], kind="stable")
    middle = int(along[len(along) // 2 + int(rng.integers(-1, 1))])
    rest = along[along != middle]
    left = np.isin(o.camera, rest[: len(rest) // 2])
    right = np.isin(o.camera, rest[len(rest) // 2 :])
    seen = np.unique(np.stack([o.placement, o.target, o.point]), axis=1, return_inverse=True)[1].reshape(-1)
    both = np.intersect1d(seen[left], seen[right])
    hidden = rng.permutation(both)[15:]
    one, other = hidden[::2], hidden[1::2]
    keep = ~(left & np.isin(seen, one)) & ~(right & np.isin(seen, other))
    found = replace(session, observations=o.select(keep))
    return Case(found, "linked-by-a-thread", (session.cameras[middle].id,), "free")


FAULTS: dict[str, Make] = {
    "camera moved by 0.05 mm": moved(shift_mm=0.05),
    "camera moved by 50 urad": moved(turn_rad=50e-6),
    "camera moved by 0.05 mm, free form": moved(shift_mm=0.05, method="free"),
    "camera moved by 50 urad, free form": moved(turn_rad=50e-6, method="free"),
    "camera moved by 0.5 mm": moved(shift_mm=0.5),
    "camera moved by 20 mm and 10 mrad": moved(shift_mm=20.0, turn_rad=0.01),
    "camera moved by 50 mm and 50 mrad": moved(shift_mm=50.0, turn_rad=0.05),
    "camera moved by 0.5 mm, lenses misfit by 0.01 px": moved(shift_mm=0.5, misfit_px=0.01),
    "camera blurred, 0.15 px": blurred(0.15),
    "camera blurred, 1 px": blurred(1.0),
    "ball changes by 0.05 mm": shape(0.05),
    "ball changes by 0.05 mm, only moved": shape(0.05, turns="same"),
    "ball has another shape at one placement, 0.2 mm": shape_at_one(0.2),
    "lenses misfit by 0.03 px": misfit(0.03),
    "lenses misfit by 0.03 px, free form": misfit(0.03, "free"),
    "images of two cameras exchanged at one placement": swapped_once,
    "two cameras exchanged, intrinsics known": swapped,
    "image of another placement": stale,
    "focal length 10 % wrong in one prior": focal(1.1),
    "focal length half in one prior": focal(0.5),
    "focal length 50 % wrong in all priors": focal(1.5, everyone=True),
    "two stickers with one number": twice_the_same,
    "placements clustered": placed_badly("clustered", "placements-clustered"),
    "placements stacked": placed_badly("stacked", "placements-stacked"),
    "bar lengths 2 % wrong": wrong_bar,
    "camera linked by a thread": thread,
}


# Of rig B's points 60 % are seen by one pair of cameras only: free points take up most of a move of one of the two.
NO_GOAL = {"camera moved by 50 urad, free form": ("rigB",)}
# rig B looks from the sides: placements above each other are spread over its images
NO_FAULT_IN = {"placements stacked": ("rigB",)}


@dataclass
class Outcome:
    """How often the fault was named; other findings, and those that should not have come with it."""

    runs: int = 0
    named: int = 0
    others: Counter[str] = field(default_factory=Counter)
    missed: list[int] = field(default_factory=list)


def study(rig: str, fault: str, runs: int, first: int = FIRST_SEED) -> Outcome:
    """`runs` recordings with a fault, each of a rig of its own."""
    out = Outcome()
    for seed in range(first, first + runs):
        case = FAULTS[fault](rig, seed, np.random.default_rng([seed, 7]))
        settings = CalibrationSettings(method=case.method, repair_by_itself=False)
        findings = calibrate(case.session, settings).rig.quality.findings
        out.runs += 1
        hit = case.named(findings)
        out.named += hit
        if not hit:
            out.missed.append(seed)
        out.others.update({f.code for f in findings} - ALWAYS - {case.code})
    return out


def clean(rig: str, runs: int, first: int = FIRST_SEED) -> Counter[str]:
    """In how many of `runs` recordings without a fault each finding came; a bar gives the scale."""
    count: Counter[str] = Counter()
    for seed in range(first, first + runs):
        session, _ = _simulate(rig, seed, scale="bar", bar_poses=6)
        count.update({f.code for f in calibrate(session).rig.quality.findings} - ALWAYS)
    return count


def _work(task: tuple[str, str | None, int, int]) -> tuple[Outcome, Counter[str]]:
    """One fault, or recordings without one, for a process of its own."""
    rig, fault, runs, first = task
    with threadpool_limits(1):
        if fault is None:
            return Outcome(), clean(rig, runs, first)
        return study(rig, fault, runs, first), Counter()


def _all(tasks: list[tuple[str, str | None, int, int]], processes: int) -> list[tuple[Outcome, Counter[str]]]:
    if processes == 1:
        return [_work(task) for task in tasks]
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        return list(pool.map(_work, tasks))


def report(
    runs: int | None, rigs: Sequence[str] = RIGS, faults: Sequence[str] | None = None, processes: int = PROCESSES
) -> Report:
    """The study's page."""
    runs = runs or RUNS
    count = CLEAN if runs >= RUNS / 5 else CLEAN * runs // RUNS
    page = Report("Diagnosis", f"dev.py studies diagnosis --runs {runs}")
    page.text(
        f"{runs} recordings (seeds {FIRST_SEED} on, each a rig of its own, the ball turned at four placements, noise "
        "0.04 px) with each fault: how often the finding that belongs to it came and named the camera, placement or "
        "target. Camera, placement and direction of a fault are random. Other findings that came in more than a tenth "
        "of the runs are listed; a real fault has real consequences. In the free form a move is to be named with its "
        "camera only, and beside another one where two cannot be told apart: there P3 and P4 alone may be told from P3 "
        "on no longer. Of rig B's points most are seen by one pair of cameras, and free points take up what turns one "
        "of the two by 50 urad: no goal is set there. Then recordings without a fault."
    )
    cells = [(rig, fault) for fault in faults or FAULTS for rig in rigs if rig not in NO_FAULT_IN.get(fault, ())]
    parts = [(rig, first) for rig in rigs for first in range(FIRST_SEED, FIRST_SEED + count, PART)]
    last = FIRST_SEED + count
    tasks: list[tuple[str, str | None, int, int]] = [(rig, fault, runs, FIRST_SEED) for rig, fault in cells]
    tasks += [(rig, None, min(PART, last - first), first) for rig, first in parts]
    done = _all(tasks, processes)
    outcomes = dict(zip(cells, (outcome for outcome, _ in done), strict=False))
    false = {rig: Counter[str]() for rig in rigs}
    for (rig, _), (_, codes) in zip(parts, done[len(cells) :], strict=True):
        false[rig] += codes
    page.heading("Faults")
    rows = [(f, *(c for rig in rigs for c in _cells(outcomes.get((rig, f))))) for f in faults or FAULTS]
    page.table(("fault", *(h for rig in rigs for h in (f"{rig} named", f"{rig} beside it"))), rows)
    page.heading("Recordings without a fault")
    told = sorted(set().union(*false.values()))
    rows = [(code, *(f"{false[rig][code]} of {count}" for rig in rigs)) for code in told]
    page.table(("finding", *rigs), rows or [("none", *(f"0 of {count}" for _ in rigs))])
    page.heading("Goals")
    for (rig, fault), out in outcomes.items():
        if rig in NO_GOAL.get(fault, ()):
            continue
        goal = f"{rig}: {fault}: named in at least {100 * NAMED:.0f} %"
        page.verdict(goal, out.named >= NAMED * out.runs, f"{out.named} of {out.runs}")
    for rig in rigs:
        worst = max(false[rig].values(), default=0)
        goal = f"{rig}: no finding in more than {100 * FALSE_ALARM:.0f} % without its fault"
        page.verdict(goal, worst <= FALSE_ALARM * count, f"at most {worst} of {count}")
    return page


def _cells(out: Outcome | None) -> tuple[str, str]:
    if out is None:
        return "no fault there", ""
    others = ", ".join(f"{code} {n}" for code, n in out.others.most_common() if n > out.runs / 10)
    seeds = f" (not: seeds {', '.join(map(str, out.missed[:5]))})" if out.missed else ""
    return f"{out.named} of {out.runs}{seeds}", others
