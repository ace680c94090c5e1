"""The benchmark beside other programs: what it measures is right, and OpenCV's ways find a simulated rig."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.starts import start_of
from benchmarks.studies.others import Case, Found, _ball_problem, _board_problem, _judged
from benchmarks.studies.others_run import PROGRAMS
from spherecal.adjust.state import State
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.simulated_boards import simulate_board
from spherecal_sim.truth import SimulationOptions


@pytest.fixture(scope="module")
def case() -> Case:
    session, truth = simulate_session("demo", 1, SimulationOptions(targets=80, placements=3, bar_poses=3, sigma_px=0.0))
    return Case("demo", 1, session, simulate_board("demo", 1, 10, sigma_px=0.0).session, truth)


def true_cameras(case: Case) -> State:
    return State(
        np.array([c.rotation for c in case.truth.cameras]),
        np.array([c.translation_mm for c in case.truth.cameras]),
        np.array([c.intrinsics for c in case.truth.cameras]),
        np.zeros((0, 3)),
    )


def found(state: State) -> Found:
    return Found(state, 1.0, 1.0, 1.0)


def test_true_cameras_have_no_errors(case: Case) -> None:
    start = start_of(case.ball, "demo")
    row = _judged(case, "truth", found(true_cameras(case)), None)
    assert row.lengths_um < 1e-3
    assert row.bars_sd_mm < 1e-3  # no noise but the last digit of the thermometer
    half = _judged(case, "truth", found(true_cameras(case).scaled(0.5)), start)
    assert half.bars_mean_mm < 0.2  # stickers on a ball with bumps give the scale to some 1e-4
    off = true_cameras(case)
    off.translation[2] += 0.5
    assert _judged(case, "off", found(off), None).lengths_um > 10


def test_problems_for_others_hold_what_was_observed(case: Case) -> None:
    start = start_of(case.ball, "demo")
    problem = _ball_problem(start, case)
    assert len(problem["uv"]) == len(problem["camera"]) == len(problem["point"]) == int(start.used.sum())
    assert problem["intrinsics"].shape == (6, 16)
    assert np.isfinite(problem["start"][problem["point"]]).all()


def test_opencv_finds_the_rig_from_a_board(case: Case) -> None:
    done = PROGRAMS["opencv-stereo"](SimpleNamespace(**_board_problem(case)))()
    state = State(done["rotation"], done["translation"], done["intrinsics"], np.zeros((0, 3)))
    assert _judged(case, "opencv-stereo", found(state), None).lengths_um < 50
