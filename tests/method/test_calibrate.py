"""Whole calibrations of simulated rigs: they find the truth, bear faults, and say where they cannot."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spherecal.adjust import corrections
from spherecal.base.arrays import FloatArray
from spherecal.base.context import Context, Progress
from spherecal.base.errors import Cancelled, InputError
from spherecal.calibrate import calibrate
from spherecal.data.observations import find_features
from spherecal.data.rig import Calibration
from spherecal.data.session import Recording, Session
from spherecal.geometry.rotation import log_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.steps.settings import CalibrationSettings
from spherecal_files.read_session import read_session
from spherecal_files.write_result import write_result
from spherecal_sim.simulate_session import simulate_session, write_session
from spherecal_sim.truth import CameraMove, SimulationOptions
from tests.networks import (
    calibrated,
    codes,
    errors_of,
    observed,
    one_thread,
    rms,
    session_of_points,
    simulated,
    unstrained,
    with_observations,
)
from tests.reference_engine import reference_instead

__all__ = ["one_thread", "unstrained"]

# Errors of one run are a few common modes of the whole rig: three standard deviations of one such mode.
MODE = 3.0


def redundancy(calibration: Calibration) -> int:
    """Of a calibration with nine intrinsics for every camera."""
    points = int((calibration.views >= 2).sum())
    return 2 * int(calibration.used.sum()) - 3 * points - 15 * len(calibration.rig.cameras) + 7


@pytest.mark.parametrize("preset", ["rigA", "rigB"])
def test_truth_is_found_within_the_noise(preset: str) -> None:
    calibration, session, truth = calibrated(preset, 3)
    quality = calibration.rig.quality
    assert quality.valid
    assert len(calibration.rig.cameras) == len(session.cameras)
    assert quality.sigma0 == pytest.approx(0.04, rel=4 / np.sqrt(2 * redundancy(calibration)))
    errors = errors_of(calibration, truth)
    assert rms(errors.centre_mm) < 1.0
    for scores in (errors.centre_score, errors.rotation_score, errors.focal_score, errors.point_score):
        assert rms(scores) < MODE
    used = np.linalg.norm(calibration.residuals_px[calibration.used], axis=1)
    assert quality.rms_px == pytest.approx(rms(used), rel=1e-9)
    assert quality.mean_px == pytest.approx(used.mean(), rel=1e-9)
    for sphere in calibration.spheres:
        assert sphere.radius_mm == pytest.approx(250.0, abs=1.0)  # the ball has bumps of +-1 mm
        assert 0.1 < sphere.radial_sd_mm < 0.6


@pytest.mark.parametrize(("scale", "most"), [({"scale": "bar", "bar_poses": 6}, 1.1), ({}, 1.5)])
def test_what_a_ball_may_be_strained_by_adds_little(
    monkeypatch: pytest.MonkeyPatch, scale: dict[str, Any], most: float
) -> None:
    """To uncertainties of centres, with a bar (1.006) and with stickers alone (1.35)."""
    session, _ = simulate_session("rigA", 3, SimulationOptions(**scale))
    whole = calibrate(session)
    monkeypatch.setattr(corrections, "strain_variance", lambda *_: np.zeros((5, 5)))
    with_it, without = (
        np.array([c.sigma.centre_mm for c in one.rig.cameras if c.sigma]) for one in (whole, calibrate(session))
    )
    assert 1.0 < np.median(with_it / without) < most


def test_stated_uncertainties_are_no_exaggeration(unstrained: None) -> None:
    """The errors have the size that is stated, neither far less nor more (over many rigs: benchmarks/studies)."""
    scores = []
    for preset, seed in (("rigA", 3), ("rigB", 3), ("demo", 1)):
        _, session, truth = calibrated(preset, seed)
        e = errors_of(calibrate(session), truth)
        scores.append([rms(s) for s in (e.centre_score, e.rotation_score, e.focal_score, e.point_score)])
    each = np.sqrt(np.mean(np.square(scores), axis=0))
    assert (each > 0.7).all()  # a half too large in all is 0.67
    assert (each < 1.4).all()


def test_given_sigmas_make_unit_weight_one() -> None:
    session, _ = simulated("rigA", 3)
    o = observed(session)
    weighted = calibrate(replace(session, observations=replace(o, sigma=np.full(o.uv.shape, 0.04))))
    plain = calibrated("rigA", 3)[0]
    assert weighted.rig.quality.sigma0 == pytest.approx(1.0, rel=4 / np.sqrt(2 * redundancy(weighted)))
    for one, other in zip(weighted.rig.cameras, plain.rig.cameras, strict=True):
        assert one.sigma is not None and other.sigma is not None
        np.testing.assert_allclose(one.intrinsics, other.intrinsics, rtol=1e-4, atol=1e-3)
        np.testing.assert_allclose(one.sigma.centre_mm, other.sigma.centre_mm, rtol=1e-3)
    assert weighted.rig.quality.rms_px == pytest.approx(plain.rig.quality.rms_px, rel=1e-4)


def test_sigmas_of_a_blurred_camera_are_used() -> None:
    session, truth = simulated("rigB", 3, blurred={"C05": 0.4})
    o = observed(session)
    sigma = np.repeat(np.where(o.camera == 4, 0.4, 0.04)[:, None], 2, axis=1)
    weighted = calibrate(replace(session, observations=replace(o, sigma=sigma)))
    assert weighted.rig.quality.sigma0 == pytest.approx(1.0, abs=0.05)
    camera = weighted.rig.camera("C05")
    assert camera is not None and camera.rms_px is not None
    assert camera.rms_px > 0.3
    assert rms(errors_of(weighted, truth).centre_score) < MODE


def test_without_noise_nothing_is_wrong() -> None:
    calibration, _, truth = calibrated("demo", 1, sigma_px=0.0, targets=60)
    assert calibration.rig.quality.valid
    assert (
        calibration.used.sum() >= calibrated("demo", 1, targets=60)[0].used.sum()
    )  # no chance loses a good observation
    assert calibration.rig.quality.rms_px is not None and calibration.rig.quality.rms_px < 1e-6
    errors = errors_of(calibration, truth)
    np.testing.assert_allclose(errors.centre_mm, 0.0, atol=1e-4)
    np.testing.assert_allclose(errors.points_mm, 0.0, atol=1e-4)
    # what remains is the ball's bumps, which bend its stickers a little more or less
    assert errors.scale == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(("preset", "fraction"), [("rigA", 0.05), ("rigB", 0.005)])
def test_outliers_lose_no_camera(preset: str, fraction: float) -> None:
    calibration, session, truth = calibrated(preset, 3, outlier_fraction=fraction)
    assert calibration.rig.quality.valid
    assert len(calibration.rig.cameras) == len(session.cameras)
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.05)
    assert {"outliers-removed"} <= codes(calibration)
    wrong = truth.outlier
    assert len(wrong) == len(calibration.used)
    assert calibration.used[wrong].sum() <= 0.02 * wrong.sum() + 2
    # good observations go with wrong partners only: those of the features without a wrong view stay
    features = find_features(observed(session)).of_observation
    clean = ~np.isin(features, features[wrong]) & (np.bincount(features)[features] >= 2)
    assert calibration.used[clean].mean() > 0.999
    without = errors_of(calibrated(preset, 3)[0], truth)
    errors = errors_of(calibration, truth)
    assert rms(errors.centre_mm) < 2.0 * rms(without.centre_mm) + 0.1
    assert rms(errors.centre_score) < MODE


OTHER_WAYS = {
    "own": CalibrationSettings(own_intrinsics=True),
    "seed": CalibrationSettings(seed=77),
}


@pytest.mark.parametrize("way", OTHER_WAYS)
def test_other_ways_end_in_the_same_minimum(way: str) -> None:
    assert_same_minimum(calibrated("rigB", 3, OTHER_WAYS[way], targets=60)[0], calibrated("rigB", 3, targets=60)[0])


def test_the_reference_ends_in_the_same_minimum() -> None:
    compiled, session, _ = calibrated("rigB", 3, targets=60)
    with reference_instead():
        assert_same_minimum(calibrate(session), compiled)


def assert_same_minimum(one: Calibration, other: Calibration) -> None:
    assert one.rig.quality.valid
    assert one.used.tolist() == other.used.tolist()
    assert one.rig.quality.sigma0 == pytest.approx(other.rig.quality.sigma0, rel=1e-6)
    assert one.rig.reference_camera == other.rig.reference_camera
    for a, b in zip(one.rig.cameras, other.rig.cameras, strict=True):
        assert a.sigma is not None
        assert np.abs((a.centre_mm - b.centre_mm) / np.maximum(a.sigma.centre_mm, 1e-12)).max() < 0.01
        assert abs(a.intrinsics[0] - b.intrinsics[0]) < 0.01 * a.sigma.intrinsics[0]


def test_the_papers_method_estimates_its_lens_terms() -> None:
    paper = calibrated("rigB", 3, CalibrationSettings(method="tao2021"), targets=200)[0]
    assert paper.method == "tao2021"
    tangential = [6, 7, 13, 15, 9, 10, 11]
    for camera in paper.rig.cameras:
        assert camera.sigma is not None
        assert (camera.intrinsics[tangential] == 0).all()
        assert (camera.sigma.intrinsics[tangential] == 0).all()
        assert (camera.sigma.intrinsics[[0, 1, 2, 3, 4, 5, 8, 12, 14]] > 0).all()
    # its prism terms stand for the tangential ones nearly as well
    sigma0 = calibrated("rigB", 3, targets=200)[0].rig.quality.sigma0
    assert paper.rig.quality.sigma0 == pytest.approx(sigma0, rel=0.02)
    assert "points-without-group" in {finding.code for finding in paper.rig.quality.findings}


def with_true_priors(session: Session, truth) -> Session:
    cameras = tuple(
        replace(spec, prior=camera.intrinsics) for spec, camera in zip(session.cameras, truth.cameras, strict=True)
    )
    return replace(session, cameras=cameras)


def test_fixed_intrinsics_stay_as_given() -> None:
    session, truth = simulated("rigA", 3)
    calibration = calibrate(with_true_priors(session, truth), CalibrationSettings(intrinsics="fixed"))
    assert calibration.rig.quality.valid
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.03)
    for camera, true in zip(calibration.rig.cameras, truth.cameras, strict=True):
        assert camera.sigma is not None
        np.testing.assert_array_equal(camera.intrinsics, true.intrinsics)
        np.testing.assert_array_equal(camera.sigma.intrinsics, 0.0)
    fixed, free = errors_of_without_focal(calibration, truth), rms(errors_of(calibrated("rigA", 3)[0], truth).centre_mm)
    assert fixed < 0.3 * free  # known intrinsics take away nearly all of the error


def errors_of_without_focal(calibration: Calibration, truth) -> float:
    true = np.array([next(t for t in truth.cameras if t.id == c.id).centre_mm for c in calibration.rig.cameras])
    found = np.array([c.centre_mm for c in calibration.rig.cameras])
    return rms(fit_similarity(found, true).apply(found) - true)


def test_shared_intrinsics_are_shared_and_own_ones_are_not() -> None:
    session, _ = simulated("demo", 2, targets=60)
    shared = replace(session, cameras=tuple(replace(c, intrinsics_group="one") for c in session.cameras))
    result = calibrate(shared)
    first = result.rig.cameras[0].intrinsics
    assert all(np.array_equal(c.intrinsics, first) for c in result.rig.cameras)
    own = calibrate(shared, CalibrationSettings(own_intrinsics=True))
    assert len({c.intrinsics[0] for c in own.rig.cameras}) == len(own.rig.cameras)
    # these lenses do differ, by 1.5 %: one set for all does not fit
    assert own.rig.quality.sigma0 is not None and result.rig.quality.sigma0 is not None
    assert result.rig.quality.sigma0 > 1.2 * own.rig.quality.sigma0
    assert result.rig.quality.verdict != "valid"


def test_rough_priors_end_in_the_same_minimum() -> None:
    rough, _, truth = calibrated("rigB", 3, prior_focal_error=0.1, prior_centre_error_px=100.0)
    exact = calibrated("rigB", 3)[0]
    assert len(rough.rig.cameras) == 12
    assert rough.rig.quality.sigma0 == pytest.approx(exact.rig.quality.sigma0, rel=1e-5)
    assert rms(errors_of(rough, truth).centre_score) < MODE


def groups_of(calibration: Calibration) -> list[str]:
    finding = next(f for f in calibration.rig.quality.findings if f.code == "cameras-unlinked")
    assert finding.severity == "error"
    return [group.strip() for group in finding.message.split("cannot be linked: ")[1].split(". ")[0].split("|")]


def test_groups_without_a_link_are_named_group_by_group() -> None:
    session, _ = simulated("rigA", 3)
    o = observed(session)
    left, right = [0, 1, 5, 6], [3, 4, 8, 9]  # both ends of the two rows, each with placements of its own
    apart = (np.isin(o.camera, left) & (o.placement < 2)) | (np.isin(o.camera, right) & (o.placement >= 2))
    calibration = calibrate(with_observations(session, apart))
    assert not calibration.rig.quality.valid
    groups = groups_of(calibration)
    names = [{f"C{c + 1:02d}" for c in group} for group in (left, right, [2], [7])]
    assert len(groups) == 4
    assert all(set(group.split()) in names for group in groups)
    placed = {c.id for c in calibration.rig.cameras}
    assert placed in names[:2]
    assert set(groups[0].split()) == placed  # the calibrated group comes first
    finding = next(f for f in calibration.rig.quality.findings if f.code == "cameras-unlinked")
    assert "at most 0 points in common with another group" in finding.message
    assert set(finding.where) == set(o.cameras)


def test_counts_that_were_missing_are_told() -> None:
    session, _ = simulated("rigA", 3)
    o = observed(session)
    few = np.flatnonzero(o.camera == 7)[:6:2]
    calibration = calibrate(with_observations(session, (o.camera != 7) | np.isin(np.arange(len(o)), few)))
    assert not calibration.rig.quality.valid
    assert {"C08"} == {c.id for c in session.cameras} - {c.id for c in calibration.rig.cameras}
    assert groups_of(calibration)[1] == "C08"
    finding = next(f for f in calibration.rig.quality.findings if f.code == "cameras-unlinked")
    count = int(finding.message.split("C08: at most ")[1].split()[0])
    assert 1 <= count <= 3


def test_camera_with_hardly_any_points_is_held_and_named() -> None:
    session, truth = simulated("rigA", 1)
    o = observed(session)
    for every in (20, 60):
        few = np.flatnonzero(o.camera == 7)[::every]
        calibration = calibrate(with_observations(session, (o.camera != 7) | np.isin(np.arange(len(o)), few)))
        assert calibration.rig.quality.valid
        assert len(calibration.rig.cameras) == 10
        held = next(f for f in calibration.rig.quality.findings if f.code == "intrinsics-held")
        assert held.where == ("C08",)
        errors = errors_of(calibration, truth)
        camera = calibration.rig.camera("C08")
        assert camera is not None and camera.sigma is not None
        # weighed as what it is, a prior of 1 % leaves to the data what they know better, and says what it does not know
        assert np.abs(errors.focal_score[7]) < 4
        assert np.abs(errors.centre_score[7]).max() < 4
        assert camera.sigma.intrinsics[0] <= 1.001 * 0.01 * session.cameras[7].prior[0]
        others = [i for i in range(10) if i != 7]
        assert rms(errors.centre_score[others]) < MODE


def test_camera_that_sees_nonsense_is_left_out_and_named() -> None:
    session, truth = simulated("rigA", 3)
    o = observed(session)
    own = np.flatnonzero(o.camera == 4)
    uv = o.uv.copy()
    uv[own] = uv[np.random.default_rng(0).permutation(own)]
    calibration = calibrate(with_observations(session, uv=uv))
    assert not calibration.rig.quality.valid
    assert calibration.rig.camera("C05") is None
    assert len(calibration.rig.cameras) == 9
    assert groups_of(calibration)[1] == "C05"
    assert not calibration.used[own].any()
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.03)
    assert rms(errors_of(calibration, truth).centre_score) < MODE
    # a point that only it and one other saw contradicts nobody
    assert "outliers-removed" not in codes(calibration)


def line(n: int) -> FloatArray:
    return np.linspace(-1, 1, n)[:, None] * np.array([250.0, 150.0, 100.0]) + [0.0, 0.0, 330.0]


def plane(n: int = 100) -> FloatArray:
    flat = np.random.default_rng(0).uniform([-300, -200, 0], [300, 200, 0], (n, 3))
    return flat + np.array([0.0, 0.0, 330.0])


def cloud(n: int) -> FloatArray:
    return np.random.default_rng(1).uniform([-300, -200, 150], [300, 200, 500], (n, 3))


NOTHING_TO_FIND: dict[str, Callable[[], FloatArray]] = {
    "collinear": lambda: line(50)[None],
    "collinear, one line four times": lambda: np.tile(line(25), (4, 1, 1)),
    "too few": lambda: cloud(15)[None],
    "one point": lambda: np.tile(cloud(1), (100, 1))[None],
}


@pytest.mark.parametrize("noise_px", [0.0, 0.04])
@pytest.mark.parametrize("name", NOTHING_TO_FIND)
def test_degenerate_points_are_no_valid_result(name: str, noise_px: float) -> None:
    check_is_refused(session_of_points("demo", NOTHING_TO_FIND[name](), noise_px)[0])


@pytest.mark.parametrize("points", [plane()[None], plane(400).reshape(4, 100, 3)], ids=["once", "four times"])
def test_one_plane_is_calibrated_with_care(points: FloatArray) -> None:
    """Its intrinsics are held near their priors, and poses and focal lengths are as good as stated."""
    session, truth = session_of_points("demo", points, 0.04)
    rig = calibrate(session).rig
    assert rig.quality.verdict == "use-with-care"
    assert "intrinsics-held" in {finding.code for finding in rig.quality.findings}
    true = {camera.id: camera for camera in truth.cameras}
    reference = true[rig.reference_camera or ""].rotation
    for camera in rig.cameras:
        assert camera.sigma is not None
        turn = camera.rotation @ (true[camera.id].rotation @ reference.T).T
        assert np.abs(np.rad2deg(log_rotation(turn))).max() < 0.5
        assert abs(camera.intrinsics[0] - true[camera.id].intrinsics[0]) < 5 * camera.sigma.intrinsics[0]


def test_degenerate_points_in_the_reference() -> None:
    with reference_instead():
        check_is_refused(session_of_points("demo", line(50)[None], 0.0)[0])


def check_is_refused(session: Session) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # it would stand in the user's way on the command line
        calibration = calibrate(session)
    quality = calibration.rig.quality
    assert not quality.valid
    assert any(finding.severity == "error" for finding in quality.findings)
    for value in (quality.rms_px, quality.mean_px, quality.sigma0):
        assert value is None or np.isfinite(value)
    if not calibration.used.any():
        assert quality.rms_px is quality.mean_px is quality.sigma0 is None


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_cameras_are_no_valid_result(count: int) -> None:
    session, _ = simulated("rigA", 3)
    for only in (False, True):
        part = with_observations(session, observed(session).camera < count)
        if only and count:
            o = observed(part)
            part = replace(part, cameras=session.cameras[:count], observations=replace(o, cameras=o.cameras[:count]))
        calibration = calibrate(part)
        assert not calibration.rig.quality.valid
        assert calibration.rig.cameras == ()
        assert calibration.rig.reference_camera is None
        assert "nothing-reconstructed" in codes(calibration)
        named = next(f for f in calibration.rig.quality.findings if f.code == "cameras-unlinked").where
        assert set(named) == {c.id for c in part.cameras}
        assert calibration.rig.scale.source == "none"


def test_three_cameras_are_enough() -> None:
    session, _ = simulated("rigA", 3)
    o = observed(session)
    some = [0, 1, 6]
    part = o.select(np.isin(o.camera, some))
    part = replace(part, camera=np.searchsorted(some, part.camera), cameras=tuple(o.cameras[c] for c in some))
    calibration = calibrate(replace(session, cameras=tuple(session.cameras[c] for c in some), observations=part))
    assert len(calibration.rig.cameras) == 3
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=4 / np.sqrt(2 * redundancy(calibration)))


def test_missing_scale_is_a_warning_and_lengths_are_arbitrary() -> None:
    session, _ = simulated("rigB", 3)
    without = calibrate(replace(session, scale=None))
    known = calibrated("rigB", 3)[0]
    assert without.rig.quality.valid
    assert without.rig.scale.source == "none" and without.rig.scale.relative_uncertainty is None
    finding = next(f for f in without.rig.quality.findings if f.code == "no-scale")
    assert finding.severity == "warning"
    ratio = fit_similarity(without.points_mm[without.views > 1], known.points_mm[known.views > 1])
    assert np.median([s.radius_mm for s in without.spheres]) == pytest.approx(250.0)  # the nominal diameter, no more
    for one, other in zip(without.rig.cameras, known.rig.cameras, strict=True):
        np.testing.assert_allclose(ratio.scale * one.translation_mm, other.translation_mm, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(one.rotation, other.rotation, atol=1e-9)


def test_scale_that_cannot_be_measured_is_an_error() -> None:
    session, _ = simulated("rigB", 3, scale="bar", bar_poses=6)
    o = observed(session)
    calibration = calibrate(with_observations(session, o.placement < len(session.placements)))
    assert not calibration.rig.quality.valid
    assert calibration.rig.scale.source == "none"
    finding = next(f for f in calibration.rig.quality.findings if f.code == "no-scale")
    assert finding.severity == "error"


def test_check_bars_never_enter() -> None:
    session, _ = simulated("rigB", 3, scale="bar", bar_poses=6)
    bars = {pose.id: pose.bar for pose in session.bar_poses}
    assert set(bars.values()) == {"A", "B"}
    used = Recording.of(session).observations
    names = {used.placements[p] for p in np.unique(used.placement)}
    assert {bars[name] for name in names if name in bars} == {"B"}
    by_spacing, _ = simulated("rigB", 3, bar_poses=6)
    o = Recording.of(by_spacing).observations
    assert (o.placement < len(by_spacing.placements)).all()


def test_knocked_camera_raises_the_noise() -> None:
    session = simulated("rigA", 3, moved=CameraMove("C03", 2, 0.5, 2e-4))[0]
    calibration = calibrate(session, CalibrationSettings(repair_by_itself=False))
    clean = calibrated("rigA", 3)[0]
    assert calibration.rig.quality.sigma0 is not None and clean.rig.quality.sigma0 is not None
    assert calibration.rig.quality.sigma0 > 1.1 * clean.rig.quality.sigma0 or "outliers-removed" in codes(calibration)


def test_session_without_observations_is_bad_input() -> None:
    session, _ = simulated("demo", 1)
    with pytest.raises(InputError, match="observations"):
        calibrate(replace(session, observations=None))


@pytest.fixture(scope="module")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("session") / "demo"
    write_session(*simulated("demo", 1, targets=40), folder)
    return folder


def test_same_input_and_seed_give_the_same_bytes(demo_folder: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_result(calibrate(read_session(demo_folder), CalibrationSettings(seed=5)), tmp_path / name, {"seed": 5})
    for file in ("rig.json", "points.csv", "residuals.csv", "spheres.csv"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_order_of_the_observations_does_not_matter() -> None:
    session, _ = simulated("demo", 1, targets=60)
    o = observed(session)
    mixed = calibrate(replace(session, observations=o.select(np.random.default_rng(0).permutation(len(o)))))
    plain = calibrated("demo", 1, targets=60)[0]
    assert mixed.rig.quality.sigma0 == pytest.approx(plain.rig.quality.sigma0, rel=1e-6)
    for a, b in zip(mixed.rig.cameras, plain.rig.cameras, strict=True):
        np.testing.assert_allclose(a.centre_mm, b.centre_mm, atol=1e-2)


class Stop:
    """Says no until it has been asked `after` times; counts on."""

    def __init__(self, after: int) -> None:
        self.after, self.asked = after, 0

    def __call__(self) -> bool:
        self.asked += 1
        return self.asked > self.after


def test_progress_names_the_stages_and_never_leaves_its_range() -> None:
    told: list[Progress] = []
    calibrate(simulated("demo", 1, targets=40)[0], context=Context(told.append))
    stages = list(dict.fromkeys(event.stage for event in told))
    assert {"two-view gate", "triples", "robust adjustment", "bundle adjustment", "uncertainty"} <= set(stages)
    assert all(0 <= event.fraction <= 1 for event in told)
    assert stages.index("two-view gate") < stages.index("triples") < stages.index("bundle adjustment")


def test_cancelling_stops_at_once_in_every_stage() -> None:
    session, _ = simulated("demo", 1, targets=40)
    never = Stop(10**9)
    calibrate(session, context=Context(is_cancelled=never))
    assert never.asked > 40  # asked all along
    for after in {0, 1, 10, never.asked // 3, never.asked // 2, 3 * never.asked // 4, never.asked - 1}:
        stop = Stop(after)
        told: list[Progress] = []
        with pytest.raises(Cancelled):
            calibrate(session, context=Context(told.append, stop))
        assert stop.asked == after + 1  # the first yes is obeyed


def test_cancelled_result_is_not_written(demo_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(Cancelled):
        write_result(calibrate(read_session(demo_folder), None, Context(is_cancelled=Stop(50))), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_long_chains_of_cameras_grow_ring_by_ring() -> None:
    calibration, session, truth = calibrated("hall16", 1, placements=10)
    assert len(calibration.rig.cameras) == len(session.cameras)
    assert calibration.rig.quality.valid
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.05)
    assert rms(errors_of(calibration, truth).centre_score) < MODE
