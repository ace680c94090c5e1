"""A ball that grows between placements, a print that is longer one way: found, taken into account, and stated."""

from functools import cache

import numpy as np
import pytest

from benchmarks.studies.judged import Judged, calibrated_and_judged
from benchmarks.studies.mischief import growing_ball, stretched_print
from benchmarks.studies.mischief_case import Make
from benchmarks.studies.mischief_motions import moved, warming
from benchmarks.studies.mischief_world import make_world
from spherecal.data.findings import Finding
from spherecal.diagnose.ball_changes import MOST_CHANGE
from tests.networks import one_thread

__all__ = ["one_thread"]

TARGETS = 120  # of the ball; with 200 each calibration takes half as long again


@cache
def done(make: Make, size: float, rig: str = "rigA", seed: int = 401, targets: int = TARGETS) -> Judged:
    case = make(make_world(rig, seed, targets), size, np.random.default_rng(seed))
    return calibrated_and_judged(case.session, case.reference, case.settings)


def found(judged: Judged, code: str) -> list[Finding]:
    return [finding for finding in judged.findings if finding.code == code]


def largest_mm(judged: Judged) -> float:
    return max(camera.centre_mm for camera in judged.cameras)


@pytest.mark.parametrize(("rig", "seed"), [("rigA", 401), ("rigB", 403), ("random", 404)])
def test_a_ball_that_keeps_its_size_is_not_said_to_change(rig: str, seed: int) -> None:
    clean = done(growing_ball, 0.0, rig, seed)
    assert not found(clean, "ball-size-changed") and not found(clean, "print-stretched")


@pytest.mark.parametrize(("rig", "seed", "ppm"), [("rigA", 401, 1500), ("rigB", 403, 150)])
def test_a_ball_that_grows_costs_nothing_but_certainty_of_the_scale(rig: str, seed: int, ppm: float) -> None:
    """Taken for one of fixed size, 200 ppm left a camera 0.31 mm off (rig A) and 0.21 mm (rig B)."""
    clean, grown = done(growing_ball, 0.0, rig, seed), done(growing_ball, ppm, rig, seed)
    (finding,) = found(grown, "ball-size-changed")
    assert finding.where == ("P1", "P4")
    assert finding.values["ppm"] == pytest.approx(ppm, abs=60)
    assert finding.severity == ("info" if 1e-6 * ppm < MOST_CHANGE else "warning")
    assert [f.code for f in grown.findings if f.code.startswith("form-")] == ["form-rigid"]
    assert largest_mm(grown) < 3 * largest_mm(clean) + 0.02
    assert not grown.wrong and grown.covered == 1.0


@pytest.mark.parametrize(
    ("make", "ppm", "seed", "targets"), [(growing_ball, 200, 201, TARGETS), (warming, 100, 314, 200)]
)
def test_sizes_that_are_not_certain_make_cameras_and_lengths_less_so(
    make: Make, ppm: float, seed: int, targets: int
) -> None:
    """In a hall cameras were up to 5.1 times their U off, and 75 % of the lengths within theirs; valid."""
    judged = done(make, ppm, "hall12", seed, targets)
    assert judged.verdict == "valid" and not judged.wrong
    assert judged.covered == 1.0 and np.median(judged.lengths_over_u) > 0.05


def test_a_camera_that_moved_is_no_ball_that_grew() -> None:
    judged = done(moved, 0.3)
    assert found(judged, "pose-split") and not found(judged, "ball-size-changed")


@pytest.mark.parametrize(("share", "verdict"), [(0.003, "valid"), (0.01, "use-with-care")])
def test_a_stretched_print_makes_the_scale_as_uncertain_as_it_is(share: float, verdict: str) -> None:
    """0.3 % one way made all lengths 0.15 % wrong, 19 times their U."""
    judged = done(stretched_print, share)
    (finding,) = found(judged, "print-stretched")
    assert finding.values["percent"] == pytest.approx(100 * share, rel=0.3)
    assert judged.verdict == verdict
    assert judged.covered == 1.0 and np.median(judged.lengths_over_u) > 0.2
