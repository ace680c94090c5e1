"""The product beside other programs on the same observations: bars, lengths, pixels, time and memory.

Unknown points (the ball): SphereCal whole, and adjustments from one start (poses chained by SphereCal, data-sheet
lenses, gross errors left out) by SphereCal, by Ceres, aniposelib and caliscope. A known board: SphereCal and OpenCV's
stereoCalibrate, chained. aniposelib and caliscope run in an environment of their own (`benchmarks/others.txt`), whose
Python the variable SPHERECAL_OTHERS names; without it their rows say so.
"""

import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.simulators.realistic import RealisticOptions, simulate_realistic
from benchmarks.starts import Start, start_of
from benchmarks.studies.others_run import PROGRAMS, forget_peak, peak_mb
from benchmarks.studies.realistic import reference_of
from benchmarks.studies.report import Report
from spherecal.adjust.state import State
from spherecal.calibrate import calibrate
from spherecal.data.observations import Observations
from spherecal.data.rig import Quality, Rig, RigCamera, RigScale
from spherecal.data.session import Recording, Session
from spherecal.geometry.camera import project
from spherecal.geometry.transform import PosedCameras
from spherecal.geometry.triangulation import triangulate
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.read_session import read_session
from spherecal_sim.simulate_session import simulate_session, study_bars
from spherecal_sim.simulated_boards import simulate_board
from spherecal_sim.truth import SimulationOptions
from spherecal_verify.verify_bars import verify

RUNS = 3
TILTS, BAR_POSES, REALISTIC_SEED, LEFT_OUT = 20, 20, 4001, 3
LIMIT_S = 1800.0
DOME = Path(os.environ.get("SPHERECAL_DATA", "../data")) / "dome15"
_BALL = {
    "spherecal": "SphereCal, whole", "adjustment": "SphereCal, adjustment alone", "ceres": "Ceres (pycolmap)",
    "aniposelib": "aniposelib", "caliscope": "caliscope",
}  # fmt: skip
_BOARD = {"spherecal-board": "SphereCal, board", "opencv-stereo": "OpenCV stereoCalibrate, chained"}
# opencv-multiview is in others_run.py and not on the page: on boards partly in view OpenCV 5.0.0's calibrateMultiview
# ended 50 mm off with good lenses and metres given, and whether that is our call or its doing is not known.
_OWN_ENVIRONMENT = ("aniposelib", "caliscope")


@dataclass(frozen=True)
class Case:
    """A recording: the session, its problem for others, and what is measured with the cameras that they find."""

    name: str
    seed: int
    ball: Session
    board: Session | None = None
    truth: Any = None
    left_out: Observations | None = None


@dataclass(frozen=True)
class Found:
    """The cameras that a program found, what it took, and why there are none."""

    cameras: State | None
    cpu_s: float
    wall_s: float
    mb: float
    failed: str = ""


@dataclass(frozen=True)
class Row:
    """One program on one recording; NaN where a figure is not to be had."""

    case: str
    program: str
    bars_sd_mm: float
    bars_mean_mm: float
    lengths_um: float
    px: float
    found: Found


def report(runs: int | None = None) -> Report:
    """The page; `runs` seeds of each simulated recording."""
    page = Report("The product beside other programs", f"python3 dev.py studies others --runs {runs or RUNS}")
    page.text(*_INTRODUCTION)
    kept = Path(os.environ.get("SPHERECAL_KEPT", tempfile.mkdtemp())) / "others"
    kept.mkdir(parents=True, exist_ok=True)
    rows = [row for case in cases(runs or RUNS) for row in measured(case, kept)]
    for name in dict.fromkeys(row.case for row in rows):
        page.heading(name)
        own = [row for row in rows if row.case == name]
        page.table(_HEADS, [_line(program, own) for program in dict.fromkeys(row.program for row in own)])
        for row in own:
            if row.found.failed:
                page.text(f"{row.program}: {row.found.failed}.")
    return page


_HEADS = ("program", "runs", "bars sd mm", "bars mean mm", "lengths um", "px", "CPU s", "MB added")
_INTRODUCTION = (
    "Bars: two reference bars in 20 poses with noise of their own (standard deviation about the mean of each length; "
    "size of the mean error). Lengths: 40 lengths with perfect images, after one common factor of scale: the geometry "
    "that the calibration alone gives. Real recording: no true lengths; px is the rms distance of points seen at three "
    "placements that the calibration never saw. Scale of the ball's rows: median distance of dots A and E of "
    "all stickers, their bend counted; of the board's its pitch. CPU s: processor seconds of the program's own call, "
    "set-up and compiling left out; MB: what that call added to its process at the peak. Means over runs +- standard "
    "error.",
)


def _line(program: str, rows: list[Row]) -> list[object]:
    own = [row for row in rows if row.program == program]

    def words(name: str, of: str = "") -> str:
        values = np.array([getattr(row.found if of else row, name) for row in own], dtype=float)
        values = values[np.isfinite(values)]
        if not len(values):
            return "-"
        error = f" +- {values.std(ddof=1) / np.sqrt(len(values)):.2g}" if len(values) > 1 else ""
        return f"{values.mean():.3g}{error}"

    figures = [words(name) for name in ("bars_sd_mm", "bars_mean_mm", "lengths_um", "px")]
    return [program, len(own), *figures, words("cpu_s", "found"), words("mb", "found")]


def cases(runs: int) -> list[Case]:
    """Rigs A and B with ball and board, realistic recordings, and the real dome where it is."""
    out = []
    for preset, name in (("rigA", "Rig A, simulated"), ("rigB", "Rig B, simulated")):
        for seed in range(1, runs + 1):
            session, truth = simulate_session(preset, seed, SimulationOptions(bar_poses=BAR_POSES))
            out.append(Case(name, seed, session, simulate_board(preset, seed, TILTS).session, truth))
    for seed in range(REALISTIC_SEED, REALISTIC_SEED + runs):
        options = RealisticOptions(lenses="usual", body="ball", placements=4, turned=True, few_cameras=0)
        session, truth = simulate_realistic(seed, options)
        out.append(Case("Realistic recording, simulated (drift, misfit, wrong codes)", seed, session, None, truth))
    if DOME.is_dir():
        out.append(_dome())
    return out


def _dome() -> Case:
    """The real dome, its last placements left out of the calibration."""
    session = read_session(DOME)
    o = session.observations
    assert o is not None
    first = len(session.placements) - LEFT_OUT
    names = (*o.placements[:first], *o.placements[len(session.placements) :])
    keep, last = o.placement < first, (o.placement >= first) & (o.placement < len(session.placements))
    used = replace(
        session, placements=session.placements[:first], observations=replace(o.select(keep), placements=names)
    )
    return Case("dome15, real photographs", 0, used, left_out=o.select(last))


def measured(case: Case, kept: Path) -> list[Row]:
    """Every program on a recording; results are kept, so that a study that was stopped goes on."""
    start = start_of(case.ball, case.name)
    programs = {**_BALL, **(_BOARD if case.board is not None else {})}
    rows = []
    for program, text in programs.items():
        path = kept / f"{case.name.split(',')[0].replace(' ', '-')}-{case.seed}-{program}.npz"
        if not path.is_file():
            _run(program, case, start, path)
        found = _read(path)
        scale_by_dots = program in _BALL and program != "spherecal"
        rows.append(_judged(case, text, found, start if scale_by_dots else None))
    return rows


def _run(program: str, case: Case, start: Start, path: Path) -> None:
    """A program in a process of its own."""
    python = os.environ.get("SPHERECAL_OTHERS", "") if program in _OWN_ENVIRONMENT else sys.executable
    if not python:
        return
    with tempfile.TemporaryDirectory() as folder:
        problem = Path(folder) / "problem.npz"
        if program in PROGRAMS:
            np.savez(problem, **(_board_problem(case) if program in _BOARD else _ball_problem(start, case)))
            # -P: numba imports `coverage`, which beside this file is a study
            script = ["-P", str(Path(__file__).with_name("others_run.py"))]
        else:
            import pickle

            problem = Path(folder) / "problem.pickle"
            problem.write_bytes(pickle.dumps((case.board if program in _BOARD else case.ball, start)))
            script = ["-m", "benchmarks.studies.others"]
        single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
        command = [python, *script, program, str(problem), str(path)]
        try:
            subprocess.run(command, env={**os.environ, **single}, check=True, timeout=20 * LIMIT_S, capture_output=True)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            said = (error.stderr or b"").decode(errors="replace").strip().splitlines()
            np.savez(path, cpu_s=np.nan, wall_s=np.nan, mb=np.nan, failed=said[-1] if said else str(error))


def _read(path: Path) -> Found:
    if not path.is_file():
        return Found(None, np.nan, np.nan, np.nan, "not run: SPHERECAL_OTHERS names no Python")
    with np.load(path) as a:
        failed = str(a["failed"])
        cameras = None if failed else State(a["rotation"], a["translation"], a["intrinsics"], np.zeros((0, 3)))
        return Found(cameras, float(a["cpu_s"]), float(a["wall_s"]), float(a["mb"]), failed)


def _ball_problem(start: Start, case: Case) -> dict[str, Any]:
    network, used = start.network, start.used
    return {
        "intrinsics": start.state.intrinsics,
        "rotation": start.state.rotation,
        "translation": start.state.translation,
        "start": start.state.points,
        "camera": network.camera[used],
        "point": network.feature[used],
        "uv": network.uv[used],
        "size": np.array([c.image_size for c in case.ball.cameras]),
    }


def _board_problem(case: Case) -> dict[str, Any]:
    assert case.board is not None and case.board.observations is not None and case.board.board is not None
    o = case.board.observations
    return {
        "intrinsics": np.array([c.prior for c in case.board.cameras]),
        "camera": o.camera,
        "point": o.target,
        "placement": o.placement,
        "uv": o.uv,
        "size": np.array([c.image_size for c in case.board.cameras]),
        "board": np.array([point.xyz_mm for point in case.board.board]),
    }


def rig_of(cameras: State, session: Session) -> Rig:
    """A rig without uncertainties of the cameras found."""
    made = tuple(
        RigCamera(
            spec.id,
            None,
            spec.image_size,
            cameras.intrinsics[c],
            cameras.rotation[c],
            cameras.translation[c],
            None,
            0,
            None,
        )
        for c, spec in enumerate(session.cameras)
        if np.isfinite(cameras.translation[c, 0])
    )
    return Rig(made[0].id, made, RigScale("none", None), Quality(True, None, None, None, ()), "")


def _judged(case: Case, program: str, found: Found, start: Start | None) -> Row:
    """Bars, lengths and pixels of the cameras found; `start`: whose dots give the scale."""
    nothing = Row(case.name, program, np.nan, np.nan, np.nan, np.nan, found)
    if found.cameras is None or not np.isfinite(found.cameras.translation).any():
        return nothing
    cameras = found.cameras
    if start is not None and case.truth is not None:
        cameras = cameras.scaled(_factor_by_dots(case, start, cameras))
    if case.left_out is not None:
        return replace(nothing, px=_px(case.left_out, cameras))
    sd, mean = _bars(case, cameras)
    return replace(nothing, bars_sd_mm=sd, bars_mean_mm=mean, lengths_um=_lengths_um(case, cameras))


def _factor_by_dots(case: Case, start: Start, cameras: State) -> float:
    """Millimetres per unit: the chord between dots A and E over their median distance."""
    o, network = Recording.of(case.ball).observations, start.network
    triangulated = network.triangulated(replace(cameras, points=np.zeros((network.n_features, 3))), start.used).points
    of = {name: o.points.index(name) for name in ("A", "E")}
    place: dict[tuple[int, int], dict[str, int]] = {}
    names = {index: name for name, index in of.items()}
    for row, feature in enumerate(network.feature):
        name = names.get(int(o.point[row]))
        if name is not None and o.placement[row] < len(case.ball.placements):
            place.setdefault((int(o.placement[row]), int(o.target[row])), {})[name] = int(feature)
    both = np.array([(p["A"], p["E"]) for p in place.values() if len(p) == 2])
    apart = np.linalg.norm(triangulated[both[:, 1]] - triangulated[both[:, 0]], axis=1)
    assert case.ball.scale is not None and case.ball.sphere_diameter_mm is not None
    printed, radius = _printed_mm(case.ball), case.ball.sphere_diameter_mm / 2
    return float(2 * radius * np.sin(printed / (2 * radius)) / np.nanmedian(apart))


def _printed_mm(session: Session) -> float:
    assert session.target_set is not None
    layout = next(iter(session.target_set.layouts.values()))
    return float(np.linalg.norm(np.subtract(layout["E"], layout["A"])))


def _bars(case: Case, cameras: State) -> tuple[float, float]:
    """Standard deviation about each length's mean and the size of the mean errors, in mm; NaN without check bars."""
    check = {bar.id for bar in case.ball.bars if bar.role == "check"}
    if not any(pose.bar in check for pose in case.ball.bar_poses):
        return np.nan, np.nan
    errors: dict[str, list[float]] = {}
    for m in verify(case.ball, rig_of(cameras, case.ball)).measured:
        errors.setdefault(f"{m.from_mark}{m.to_mark}", []).append(float(m.error_mm))
    by_length = [np.array(e) for e in errors.values() if len(e) > 1]
    if not by_length:
        return np.nan, np.nan
    within = np.concatenate([e - e.mean() for e in by_length])
    return float(np.sqrt((within**2).mean())), float(np.mean([abs(e.mean()) for e in by_length]))


def _lengths_um(case: Case, cameras: State) -> float:
    """Root mean square error of 40 lengths with perfect images, after one factor for all."""
    if hasattr(case.truth, "rig"):  # a realistic recording
        lengths = reference_of(case.truth).lengths
        end, camera, uv, true = lengths.end, lengths.camera, lengths.uv, lengths.true_mm
    else:
        exact = study_bars(replace(case.truth, sigma_px=np.zeros(len(case.truth.cameras))), np.random.default_rng(99))
        o = exact.observations
        end, camera, uv, true = 2 * o.placement + o.target - 1, o.camera, o.uv, exact.lengths_mm
    placed = np.isfinite(cameras.translation[camera, 0])
    found = triangulate(
        end[placed],
        camera[placed],
        uv[placed],
        np.ones(int(placed.sum())),
        2 * len(true),
        PosedCameras(cameras.intrinsics, np.nan_to_num(cameras.rotation), np.nan_to_num(cameras.translation)),
    )
    ends = found.points.reshape(-1, 2, 3)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    known = np.isfinite(length)
    factor = (true[known] @ length[known]) / (length[known] @ length[known])
    return 1e3 * float(np.sqrt(np.mean((factor * length[known] - true[known]) ** 2)))


def _px(o: Observations, cameras: State) -> float:
    """Root mean square distance in px of points, seen twice and more, from where the cameras put them."""
    _, point = np.unique(np.stack([o.placement, o.target, o.point]), axis=1, return_inverse=True)
    point = point.reshape(-1)
    found = triangulate(
        point,
        o.camera,
        o.uv,
        np.ones(len(o)),
        int(point.max()) + 1,
        cameras.cameras,
    )
    twice = (np.bincount(point) >= 2)[point] & np.isfinite(found.points[point, 0])
    x = np.einsum("nij,nj->ni", cameras.rotation[o.camera], found.points[point]) + cameras.translation[o.camera]
    off = (project(x, cameras.intrinsics[o.camera]) - o.uv)[twice]
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def run_one(program: str, problem: Path, result: Path) -> None:
    """One of the programs that need SphereCal, in this process; a run to compile comes before the one measured."""
    import pickle

    session, start = pickle.loads(problem.read_bytes())

    def whole() -> State:
        method = "board" if program == "spherecal-board" else "auto"
        rig = calibrate(session, CalibrationSettings(method=method)).rig
        by_id = {camera.id: camera for camera in rig.cameras}
        empty = SimpleNamespace(
            rotation=np.full((3, 3), np.nan), translation_mm=np.full(3, np.nan), intrinsics=np.full(16, np.nan)
        )
        own = [by_id.get(spec.id, empty) for spec in session.cameras]
        return State(
            np.array([c.rotation for c in own]),
            np.array([c.translation_mm for c in own]),
            np.array([c.intrinsics for c in own]),
            np.zeros((0, 3)),
        )

    def adjustment() -> State:
        from spherecal.adjust.least_squares import minimise
        from spherecal.adjust.levenberg import Settings

        return minimise(start.problem(), start.state, Settings(max_iterations=200)).state

    def ceres() -> State:
        from benchmarks import ceres_adjustment

        return ceres_adjustment.solve(start.problem(), start.state, "SPARSE_SCHUR").state

    solve = {"adjustment": adjustment, "ceres": ceres}.get(program, whole)
    with threadpool_limits(1):
        if program != "ceres":
            solve()
            forget_peak()
        before, began, wall = peak_mb(), time.process_time(), time.perf_counter()
        state = solve()
        used, lasted = time.process_time() - began, time.perf_counter() - wall
    np.savez(
        result,
        cpu_s=used,
        wall_s=lasted,
        mb=max(peak_mb() - before, 0.0),
        failed="",
        rotation=state.rotation,
        translation=state.translation,
        intrinsics=state.intrinsics,
    )


if __name__ == "__main__":
    run_one(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
