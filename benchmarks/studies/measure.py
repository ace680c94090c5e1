"""Measuring with the calibrated rig: errors against stated uncertainties, knocks, false alarms, rate and latency."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.studies.measure_accuracy import COLUMNS, Errors, measure_motion
from benchmarks.studies.measure_latency import latency_rows
from benchmarks.studies.measured_world import Path, World, calibrated_world, facing, knocked
from benchmarks.studies.report import Report
from spherecal.base.arrays import FloatArray
from spherecal.geometry.rotation import exp_rotation
from spherecal_measuring.measured_sets import ObservedSet
from spherecal_measuring.measurer import Measurer
from spherecal_measuring.measuring_task import Task
from spherecal_sim.observe import lens_misfit

SEEDS = 6
SETS = 7  # along a path; velocities are known from the third on
SPEEDS_MM_S = (0.0, 100.0, 1000.0)
SKEW_S = 5e-3
# What is known of the cameras' moments: their skew, the task, whether the sets have times of exposure.
TIMINGS = (
    ("", 0.0, Task(exposure_sd_s=0.0), True),
    (", 5 ms, stated", SKEW_S, Task(), True),
    (", 5 ms, exact times", SKEW_S, Task(correct_exposure=True), True),
    (", 5 ms, no times", SKEW_S, Task(), False),
    (", 5 ms, said to be none", SKEW_S, Task(exposure_sd_s=0.0), True),
)
KNOCKS = (("turn", 0.001), ("turn", 0.003), ("turn", 0.01), ("shift", 0.05), ("shift", 0.1), ("shift", 0.3))
KNOCK_REPEATS = 5
QUIET_SETS = 9000  # of each of four kinds: an hour at 10 Hz


def straight(world: World, rotation: FloatArray, speed: float, rng: np.random.Generator) -> Path:
    """A straight way through the middle of the volume, along its floor plan."""
    angle = rng.uniform(0, 2 * np.pi)
    way, middle = np.array([np.cos(angle), np.sin(angle), 0.1]), world.middle()
    half = speed * (SETS - 1) / 10.0 / 2
    return lambda t: (rotation, middle + way * (speed * t - half))


def by_hand(world: World, rotation: FloatArray, rng: np.random.Generator) -> Path:
    """To and fro by 0.2 m with 1 m/s in the middle, turning meanwhile: a constant velocity is wrong by much."""
    angle = rng.uniform(0, 2 * np.pi)
    way, middle = np.array([np.cos(angle), np.sin(angle), 0.1]), world.middle()
    axis = rng.normal(size=3) / 3

    def path(t: float) -> tuple[FloatArray, FloatArray]:
        return exp_rotation(axis * np.sin(5 * t)) @ rotation, middle + way * 200.0 * np.sin(5.0 * t)

    return path


def accuracy(preset: str, seeds: int) -> list[tuple[object, ...]]:
    """Rows of the table: every motion with every skew."""
    gathered: dict[str, Errors] = {}
    for seed in range(1, seeds + 1):
        world = calibrated_world(preset, seed)
        rotation = facing(world, seed)
        _bent(world, rotation, seed, gathered.setdefault("at rest, stickers bent on the ball", Errors()))
        for speed in SPEEDS_MM_S:
            for name, skew, task, exposures in TIMINGS:
                if speed == 0.0 and name:
                    continue
                rng = np.random.default_rng([17, seed, round(speed)])
                label = f"{speed / 1000:g} m/s{name}" if speed else "at rest"
                path = straight(world, rotation, speed, rng)
                measure_motion(world, path, skew, task, SETS, rng, gathered.setdefault(label, Errors()), exposures)
        for name, skew, task, exposures in TIMINGS:
            rng = np.random.default_rng([18, seed])
            label = f"to and fro, up to 1 m/s{name}"
            path = by_hand(world, rotation, rng)
            measure_motion(world, path, skew, task, SETS, rng, gathered.setdefault(label, Errors()), exposures)
    rows = [(label, *errors.row()) for label, errors in gathered.items()]
    return [*rows[1:], rows[0]]


def _bent(world: World, rotation: FloatArray, seed: int, errors: Errors) -> None:
    """The ball itself: a bent sticker's centre depends a little on which of its dots are seen."""
    ball, rng = world.truth.ball, np.random.default_rng([17, seed, 0])
    itself = replace(world, dots_mm=ball.dots_mm, normals=ball.normals)
    measure_motion(itself, straight(itself, rotation, 0.0, rng), 0.0, Task(exposure_sd_s=0.0), SETS, rng, errors)


@dataclass
class Named:
    """Runs with one knock: sets until the camera was named (None: never), and runs that named another."""

    sets: list[int | None]
    others: int


def name_knocks(world: World, kind: str, size: float, repeats: int, moving: bool) -> Named:
    """One camera knocked after 20 sets, looked at for 100 more; the body at rest, or carried about."""
    found = Named([], 0)
    rotation = facing(world, 3)
    for repeat in range(repeats):
        rng = np.random.default_rng([5, repeat, round(1e6 * size)])
        camera = repeat % len(world.truth.cameras)
        way = rng.normal(size=3)
        way *= (size if kind == "shift" else np.deg2rad(size)) / np.linalg.norm(way)
        view = knocked(world, camera, *((way, np.zeros(3)) if kind == "shift" else (np.zeros(3), way)))
        path = by_hand(world, rotation, rng) if moving else straight(world, rotation, 0.0, rng)
        measurer = Measurer(world.rig, Task(world.session.target_set, exposure_sd_s=0.0))
        late, name, at = np.zeros(len(world.truth.cameras)), world.truth.cameras[camera].id, None
        others = False
        for number in range(1, 121):
            measurer.measure(world.seen(path, number, rng, late, view if number > 20 else None))
            moved = measurer.health.moved
            others |= bool(set(moved) - {name})
            if name in moved:
                at = number - 20
                break
        found.sets.append(at)
        found.others += others
    return found


def knock_rows(seed: int, repeats: int) -> list[tuple[object, ...]]:
    """Sets until named, for a ball of 100 targets at rest and a body of 8 carried about."""
    rows = []
    for label, targets, moving in (("100 targets at rest", None, False), ("8 targets, carried about", 8, True)):
        world = calibrated_world("rigA", seed, targets)
        for kind, size in KNOCKS:
            found = name_knocks(world, kind, size, repeats, moving)
            there = [one for one in found.sets if one is not None]
            amount = f"{size:g} {'mm' if kind == 'shift' else 'deg'}"
            spread = f"{float(np.median(there)):.0f} ({max(there)})" if there else "-"
            rows.append((label, f"{kind} {amount}", f"{len(there)} of {repeats}", spread, found.others))
    return rows


def false_alarms(sets: int, seeds: Sequence[int]) -> list[tuple[object, ...]]:
    """Unchanged rigs: sets, and sets in which a camera counted as moved; also with lenses that the model misses."""
    rows = []
    kinds = (
        ("8 targets at rest", 8, False, 0.0), ("8 targets, carried about", 8, True, 0.0),
        ("8 targets, carried about, lens errors of 0.05 px", 8, True, 0.05),
        ("8 targets at rest, lens errors of 0.05 px", 8, False, 0.05),
    )  # fmt: skip
    for label, targets, moving, misfit in kinds:
        alarms = 0
        for seed in seeds:
            world = calibrated_world("rigA", seed, targets, misfit_px=misfit)
            errors = misfit_field(world, misfit)
            rng = np.random.default_rng([8, seed])
            rotation = facing(world, seed)
            path = by_hand(world, rotation, rng) if moving else straight(world, rotation, 0.0, rng)
            measurer = Measurer(world.rig, Task(world.session.target_set, exposure_sd_s=0.0))
            late = np.zeros(len(world.truth.cameras))
            for number in range(1, sets // len(seeds) + 1):
                measurer.measure(errors(world.seen(path, number, rng, late)))
                alarms += bool(measurer.health.moved)
        rows.append((label, sets // len(seeds) * len(seeds), alarms))
    return rows


def misfit_field(world: World, amplitude: float) -> Callable[[ObservedSet], ObservedSet]:
    """What the lens errors that the rig was calibrated with do to the image points of a set."""
    sizes = np.array([c.kind.image_size for c in world.truth.cameras], dtype=float)

    def spoilt(observed: ObservedSet) -> ObservedSet:
        o = observed.observations
        if not amplitude:
            return observed
        off = lens_misfit(o.uv, sizes[o.camera], world.truth.misfit_phases[o.camera], amplitude)
        return replace(observed, observations=replace(o, uv=o.uv + off))

    return spoilt


def report(runs: int | None = None) -> Report:
    """6 seeds of rigs A and B, 5 knocks of each size, an hour without any, and the times."""
    page = Report("Measuring", "python3 dev.py studies measure")
    seeds = SEEDS if runs is None else runs
    page.heading("Errors and stated uncertainties")
    page.text(
        f"Rigs calibrated from four placements of a ball of 100 targets, {seeds} seeds; then a body of 100 flat "
        f"targets of the ball's size is measured at 10 Hz, noise 0.04 px; {SETS - 2} sets of each motion. Skew: "
        "in every set each camera exposes at a moment of its own, even within 5 ms. What is known of it: the "
        "scatter of the cameras' times is stated as the uncertainty of each; or the times are exact; or the sets "
        "have none; or the cameras are said to expose together, and do not. Points are target centres, in the datum "
        "of the calibration; distances are those between ten targets; the pose is of a body of 60 targets. Held: "
        "the share within the 95 % limits of their own stated uncertainty; the errors of a calibration are common "
        "to all points of a seed, so that a few seeds decide it to some per cent only. rms values are those of "
        "the targets newly seen, whose velocity nobody knows yet."
    )
    for preset in ("rigA", "rigB"):
        page.text(f"**{preset}**")
        rows = accuracy(preset, seeds)
        page.table(COLUMNS, rows)
        rest = rows[0]
        page.verdict(
            f"{preset}, at rest: stated and actual error of a distance agree within 25 %",
            0.75 < float(str(rest[8])) / float(str(rest[7])) < 1.33,
            f"{rest[7]:.4f} and {rest[8]:.4f} mm",
        )
    page.heading("A camera is knocked while measuring")
    repeats = KNOCK_REPEATS if runs is None else min(KNOCK_REPEATS, max(runs, 1))
    page.text(
        f"Rig A at 10 Hz; after 20 sets one camera is turned or shifted in a random direction, {repeats} times, "
        "each time another camera. Sets until it is named, at most 100: median and largest; runs in which "
        "another one was."
    )
    rows = knock_rows(1, repeats)
    page.table(("seen", "knock", "named", "after sets", "others named"), rows)
    page.verdict(
        "no other camera is named", not any(row[4] for row in rows), f"{sum(int(str(r[4])) for r in rows)} runs"
    )
    quiet = QUIET_SETS if runs is None else min(QUIET_SETS, 200 * runs)
    page.heading("False alarms")
    rows = false_alarms(quiet, (1, 2, 3) if runs is None or runs >= 3 else (1,))
    page.text("Rig A unchanged, 10 Hz, three rigs; sets in which any camera counted as moved.")
    page.table(("seen", "sets", "with an alarm"), rows)
    page.verdict("no false alarm", not any(row[2] for row in rows), f"{sum(int(str(r[2])) for r in rows)} sets")
    page.heading("Rate and latency")
    latency_rows(page, quick=runs is not None)
    return page
