"""Twins of real networks and realistic recordings: what was asked for is what was simulated."""

import numpy as np
import pytest

from benchmarks.simulators.heavy_tails import heavy_noise
from benchmarks.simulators.lens_errors import TrueLens, random_field
from benchmarks.simulators.networks import simulate_network
from benchmarks.simulators.realistic import RealisticOptions, RealisticTruth, random_lengths, simulate_realistic
from spherecal.base.errors import InputError
from spherecal.data.observations import Observations
from spherecal.geometry.camera import project


@pytest.mark.parametrize(("kind", "views", "points", "marks"), [("targets", 113, 150, 9962), ("sheet", 21, 100, 0)])
def test_networks_have_the_size_of_the_real_ones(kind: str, views: int, points: int, marks: int) -> None:
    session, truth = simulate_network(kind, 3)
    o = session.observations
    assert o is not None
    assert len(session.cameras) == views == len(np.unique(o.camera))
    assert len(np.unique(o.target)) == points
    assert len(o) == (marks or len(o))
    x = np.einsum("nij,nj->ni", truth.rotation[o.camera], truth.points_mm[o.target - 1])
    off = o.uv - project(x + truth.translation_mm[o.camera], truth.intrinsics)
    good = off[~truth.wrong]
    assert np.sqrt((good**2).mean()) == pytest.approx(truth.noise_px, rel=0.1)
    assert truth.wrong.mean() == pytest.approx(0.01 if kind == "targets" else 0.0, abs=1e-3)
    assert (np.linalg.norm(off[truth.wrong], axis=1) > 7 * truth.noise_px).all()
    seen = np.bincount(o.camera, minlength=views)
    assert ((seen[truth.weak] >= 10) & (seen[truth.weak] <= 20)).all()
    assert (seen[~truth.weak] > 20).all()


def test_same_seed_same_network_and_an_unknown_one_is_refused() -> None:
    one, two = simulate_network("targets", 5)[0].observations, simulate_network("targets", 5)[0].observations
    assert one is not None and two is not None
    np.testing.assert_array_equal(one.uv, two.uv)
    with pytest.raises(InputError, match="no network"):
        simulate_network("barn", 1)


def test_heavy_noise_has_the_asked_size_and_heavy_tails() -> None:
    noise = heavy_noise(np.full(200_000, 0.1), np.random.default_rng(1))
    assert noise.std() == pytest.approx(0.1, rel=0.02)
    assert 5e-4 < (np.abs(noise) > 0.4).mean() < 5e-3  # 6e-5 for a normal distribution


def test_a_field_has_the_asked_size_and_is_no_turn_nor_shift() -> None:
    intrinsics = np.zeros(16)
    intrinsics[:4] = 2300.0, 2300.0, 1000.0, 750.0
    region = np.array([[-0.6, -0.8], [0.7, 0.5]])
    field = random_field((2000, 1500), intrinsics, region, 0.1, 0.3, np.random.default_rng(2))
    lens = TrueLens((2000, 1500), intrinsics, field, region)
    steps = [np.linspace(low, high, 40) for low, high in region.T]
    place = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    value = lens.field_at(place)
    assert np.sqrt((value**2).mean()) == pytest.approx(0.1, rel=0.15)  # the finer grid is another sample of it
    assert np.abs(value.mean(axis=0)).max() < 0.01
    around = place - place.mean(axis=0)
    assert abs((value * around).sum() / (around**2).sum()) < 0.02  # no change of focal length: px per half image


def stated_noise(o: Observations, truth: RealisticTruth) -> np.ndarray:
    """Standard deviations (n,) px: the camera's, more out of focus, more for dots of less than 12 px."""
    index = {key: i for i, key in enumerate(zip(truth.ball.dot_target, truth.ball.dot_point, strict=True))}
    out = np.ones(len(o))
    for row, (t, c, target, point) in enumerate(zip(o.placement, o.camera, o.target, o.point, strict=True)):
        if t < len(truth.placements):
            camera, lens = truth.rig.cameras[c], truth.lenses[c]
            place = truth.points_mm(t)[index[target, point]]
            depth = camera.rotation[2] @ place + camera.translation_mm[2]
            small = np.clip(np.sqrt(12.0 * depth / (3.0 * lens.intrinsics[0])), 0.7, 3.0)
            out[row] = truth.sigma_px[c] * lens.blur(np.array([depth]))[0] * small
    return out


def test_a_realistic_recording_follows_its_options() -> None:
    options = RealisticOptions(targets=80, few_cameras=1, wrong_share=0.02, misfit_px=0.05, bar_scale=True)
    session, truth = simulate_realistic(7, options)
    again = simulate_realistic(7, options)[0].observations
    o = session.observations
    assert o is not None and again is not None
    np.testing.assert_array_equal(o.uv, again.uv)
    on_ball = o.placement < len(truth.placements)
    assert truth.outlier.mean() == pytest.approx(0.02, abs=0.005)
    good = on_ball & ~truth.outlier
    normal = ((o.uv - truth.uv_true_px) / stated_noise(o, truth)[:, None])[good]
    assert np.sqrt((normal**2).mean()) == pytest.approx(1.0, rel=0.05)
    assert np.median(truth.sigma_px) == pytest.approx(options.noise_px, rel=0.5)  # lenses differ by a third
    count = np.bincount(o.camera[on_ball], minlength=len(truth.few))
    if truth.few.any():
        assert ((count[truth.few] >= 8) & (count[truth.few] <= 20)).all()
    ends = random_lengths(truth, 5, np.random.default_rng(1))
    low, high = truth.rig.volume_mm
    assert len(ends) == 5 and ((ends >= low) & (ends <= high)).all()


@pytest.mark.parametrize("options", [RealisticOptions(lenses="wide", targets=60), RealisticOptions(body="plane")])
def test_wide_lenses_and_planes_are_seen(options: RealisticOptions) -> None:
    session, truth = simulate_realistic(11, options)
    assert session.observations is not None
    seen = np.bincount(session.observations.camera, minlength=len(session.cameras))
    assert (seen[~truth.few] > 100).all()
    sizes = np.array([camera.image_size for camera in session.cameras])[session.observations.camera]
    assert ((session.observations.uv > -5) & (session.observations.uv < sizes + 5))[~truth.outlier].all()
