"""Weights by camera: the noise of a blurred one is found, clean data stay as they are, nobody is thrown away."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from benchmarks.studies.simulated import Simulated, simulate
from spherecal.adjust.bundle import Adjustment, refine
from spherecal.adjust.network import Network
from spherecal.adjust.weights import camera_noise, rough_noise, weighted
from spherecal.ball.rigid import align, share_shape
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context
from spherecal.calibrate import calibrate
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.truth import SimulationOptions
from tests.networks import errors_of, observed, one_thread, rms
from tests.reference_engine import reference_instead

__all__ = ["one_thread"]

BLURRED = 3  # index of C04


@dataclass(frozen=True)
class Weighed:
    """An adjustment before and after the weights, and the noise (c,) that was found."""

    plain: Adjustment
    network: Network
    adjusted: Adjustment

    @property
    def noise(self) -> FloatArray:
        return self.network.noise


def weigh(simulated: Simulated, rigid: bool = False, sigma: FloatArray | None = None) -> Weighed:
    """The truth adjusted to its observations and weighted."""
    placed = np.ones(len(simulated.network.group), dtype=bool)
    unit = np.ones_like(simulated.network.uv)
    network, start = simulated.network.with_sigma(unit if sigma is None else sigma), simulated.true
    if rigid:
        alignment = align(simulated.features, start.points, 4, 4)
        shared, start = share_shape(network, simulated.features, start, alignment)
        network = shared.network
    plain = refine(network, start, simulated.usable, placed, Context())
    return Weighed(plain, *weighted(network, plain, placed, Context()))


def noise_sd(adjusted: Adjustment, cameras: int) -> float:
    """How sure an estimate of a camera's noise can be, relative: its rows' share of the redundancy."""
    return float(1 / np.sqrt(2 * adjusted.redundancy / cameras))


@pytest.mark.parametrize("rigid", [False, True], ids=["free", "rigid"])
@pytest.mark.parametrize("blur", [0.15, 0.4, 1.0])
def test_the_noise_of_a_blurred_camera_is_found(blur: float, rigid: bool) -> None:
    simulated = simulate("rigA", 1, SimulationOptions(targets=100, blurred={"C04": blur}))
    found = weigh(simulated, rigid)
    noise = found.noise / np.median(np.delete(found.noise, BLURRED))
    assert noise[BLURRED] == pytest.approx(blur / 0.04, rel=0.1)
    np.testing.assert_allclose(np.delete(noise, BLURRED), 1.0, atol=0.12)
    assert np.sqrt(found.adjusted.variance) * np.median(found.noise) == pytest.approx(0.04, rel=0.05)
    of_it = found.adjusted.used & (simulated.network.camera == BLURRED)
    assert of_it.sum() > 0.9 * (simulated.usable & (simulated.network.camera == BLURRED)).sum()


@pytest.mark.parametrize("rigid", [False, True], ids=["free", "rigid"])
def test_clean_cameras_keep_their_weights(rigid: bool) -> None:
    found = weigh(simulate("rigA", 1, SimulationOptions(targets=100)), rigid)
    np.testing.assert_allclose(found.noise, 1.0, atol=4 * noise_sd(found.adjusted, 10))
    assert found.adjusted.variance == pytest.approx(found.plain.variance, rel=0.02)
    again = camera_noise(found.adjusted.problem, found.adjusted.state)
    np.testing.assert_allclose(again, 1.0, atol=0.03)  # it has settled


def test_weights_are_beside_the_stated_sigmas() -> None:
    """Sigmas that already say how blurred a camera is leave nothing to find."""
    simulated = simulate("rigA", 1, SimulationOptions(targets=100, blurred={"C04": 0.4}))
    sigma = np.repeat(simulated.truth.sigma_px[simulated.network.camera][:, None], 2, axis=1)
    found = weigh(simulated, sigma=sigma)
    np.testing.assert_allclose(found.noise, 1.0, atol=4 * noise_sd(found.adjusted, 10))
    assert found.adjusted.variance == pytest.approx(1.0, abs=0.06)
    wrong = weigh(simulated, sigma=np.where((simulated.network.camera == BLURRED)[:, None], sigma / 5, sigma))
    ratio = wrong.noise[BLURRED] / np.median(np.delete(wrong.noise, BLURRED))
    assert ratio == pytest.approx(5.0, rel=0.1)


def test_the_reference_finds_the_same_noise() -> None:
    simulated = simulate("rigA", 1, SimulationOptions(targets=40, blurred={"C04": 0.2}))
    placed = np.ones(10, dtype=bool)
    plain = refine(simulated.network, simulated.true, simulated.usable, placed, Context())
    one = camera_noise(plain.problem, plain.state)
    with reference_instead():
        other = camera_noise(plain.problem, plain.state)
    np.testing.assert_allclose(one, other, rtol=1e-9)


@pytest.mark.parametrize("observations", [4, 10])
def test_a_camera_with_few_observations_keeps_its_weight(observations: int) -> None:
    """What has hardly any redundancy says nothing of its own noise, however well it happens to fit."""
    simulated = simulate("rigA", 1, SimulationOptions(targets=100))
    network = simulated.network
    own = np.flatnonzero(simulated.usable & (network.camera == BLURRED))
    keep = np.ones(len(network.uv), dtype=bool)
    keep[own[observations:]] = False
    few = network.only(np.flatnonzero(keep))
    plain = refine(few, simulated.true, simulated.usable[keep], np.ones(10, dtype=bool), Context())
    noise = camera_noise(plain.problem, plain.state)
    assert (plain.used & (few.camera == BLURRED)).sum() == observations  # twice the rows, fifteen unknowns
    assert noise[BLURRED] == 1.0
    np.testing.assert_allclose(np.delete(noise, BLURRED), 1.0, atol=0.2)


def test_rough_noise_tells_only_what_sticks_out() -> None:
    """Before the first gate: clean cameras all 1, a blurred one near its blur; nothing where nothing is used."""
    options = SimulationOptions(targets=100)
    clean, blurred = (simulate("rigA", 1, replace(options, blurred=b)) for b in ({}, {"C04": 0.4}))
    np.testing.assert_array_equal(rough_noise(clean.network, clean.true, clean.usable), 1.0)
    found = rough_noise(blurred.network, blurred.true, blurred.usable)
    assert found[BLURRED] == pytest.approx(10.0, rel=0.2)
    np.testing.assert_array_equal(np.delete(found, BLURRED), 1.0)
    nothing = np.zeros(len(clean.usable), dtype=bool)
    np.testing.assert_array_equal(rough_noise(clean.network, clean.true, nothing), 1.0)


def test_without_noise_weights_stay_finite() -> None:
    found = weigh(simulate("rigA", 1, SimulationOptions(targets=40, sigma_px=0.0)))
    assert np.isfinite(found.noise).all()
    assert (found.noise > 0).all()
    assert found.adjusted.minimum.cost < 1e-6


def test_a_whole_calibration_bears_a_blurred_camera() -> None:
    """Its stated uncertainties grow, those of the others hardly; all of them hold."""
    options = SimulationOptions(targets=100, blurred={"C04": 0.4}, bar_poses=0)
    simulated = simulate("rigA", 2, options)
    blurred = calibrate(simulated.session, CalibrationSettings(method="free"))
    clean = calibrate(simulate("rigA", 2, replace(options, blurred={})).session, CalibrationSettings(method="free"))
    assert len(blurred.rig.cameras) == 10
    own = observed(simulated.session).camera == BLURRED
    assert (blurred.used & own).sum() > 0.9 * (simulated.usable & own).sum()
    errors = errors_of(blurred, simulated.truth)
    assert max(rms(errors.focal_score), rms(errors.centre_score), rms(errors.rotation_score)) < 3.0
    ratio = [
        b.sigma.intrinsics[0] / c.sigma.intrinsics[0]
        for b, c in zip(blurred.rig.cameras, clean.rig.cameras, strict=True)
        if b.sigma is not None and c.sigma is not None
    ]
    assert ratio[BLURRED] > 1.2
    assert ratio[BLURRED] > 1.1 * max(np.delete(ratio, BLURRED))
