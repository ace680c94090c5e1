"""Parts of a recording that do not agree as noise lets them: uncertainties grow before any single test is certain."""

import numpy as np
import pytest

from spherecal.data.rig import Calibration
from spherecal.diagnose.influence import BEYOND, DRAWS, _growth
from tests.networks import calibrated, codes, one_thread

__all__ = ["one_thread"]

TARGETS = 60


def expanded_mm(calibration: Calibration) -> float:
    lengths = calibration.rig.length_map
    assert lengths is not None and lengths.typical_mm is not None
    return lengths.typical_mm


@pytest.mark.parametrize(("preset", "seed"), [("demo", 1), ("demo", 2), ("rigB", 3)])
def test_parts_of_a_clean_recording_agree(preset: str, seed: int) -> None:
    """Three of them; benchmarks/studies/diagnosis.py counts what is said of many."""
    assert "parts-disagree" not in codes(calibrated(preset, seed, targets=TARGETS)[0])


def test_a_ball_that_bends_too_little_to_be_found_widens_the_uncertainties() -> None:
    """Bent by 0.02 mm the ball passes as rigid; lengths were up to 1.5 times, cameras 2.0 times their U off."""
    clean, bent = (calibrated("rigA", 5, targets=TARGETS, shape_change_mm=mm)[0] for mm in (0.0, 0.02))
    assert "parts-disagree" in codes(bent) and "ball-shape-changed" not in codes(bent)
    assert bent.rig.quality.verdict == "valid"
    assert 1.5 * expanded_mm(clean) < expanded_mm(bent) < 3 * expanded_mm(clean)
    for before, after in zip(clean.rig.cameras, bent.rig.cameras, strict=True):
        assert before.sigma is not None and after.sigma is not None
        assert (after.sigma.centre_mm > 1.4 * before.sigma.centre_mm).all()


def test_growth_is_judged_against_noise() -> None:
    noise = np.random.default_rng(0).normal(1.0, 0.1, DRAWS)
    edge = noise.mean() + BEYOND * noise.std()
    assert _growth(np.append(0.99 * edge, noise)) == 1.0
    assert _growth(np.append(4 * noise.mean(), noise)) == pytest.approx(2.0)
