"""A bar that gives the scale as rows of the adjustment: its lengths, its certificate, and that check bars stay out."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from spherecal.base.arrays import FloatArray
from spherecal.calibrate import calibrate
from spherecal.data.observations import find_features
from spherecal.data.rig import Calibration
from spherecal.data.session import Bar, Recording, Session
from spherecal.scale.bar_scale import length_rows
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.truth import Truth
from tests.networks import calibrated, errors_of, observed, one_thread, rms, simulated

__all__ = ["one_thread"]

Form = Literal["free", "rigid"]
FORMS: tuple[Form, ...] = ("free", "rigid")
WITH_BAR = {"targets": 80, "bar_poses": 6, "scale": "bar"}


def only_the_longest(session: Session, error_mm: float = 0.0, expanded_mm: float = 0.004) -> Session:
    """Bar B with the certificate of its full length alone."""

    def changed(bar: Bar) -> Bar:
        if bar.id != "B":
            return bar
        longest = max(bar.lengths, key=lambda length: length.length_mm)
        value = longest.length_mm + error_mm
        return replace(bar, lengths=(replace(longest, length_mm=value, expanded_uncertainty_mm=expanded_mm),))

    return replace(session, bars=tuple(changed(bar) for bar in session.bars))


def true_points(truth: Truth, session: Session, bar_poses: bool = True) -> FloatArray:
    """Where the features of a calibration are in truth, marks of bars as points `centre`."""
    o = Recording.of(session).observations
    features = find_features(o)
    out = np.full((len(features), 3), np.nan)
    where = {
        (int(t), truth.ball.points[p]): i
        for i, (t, p) in enumerate(zip(truth.ball.dot_target, truth.ball.dot_point, strict=True))
    }
    for i, (placement, target, point) in enumerate(
        zip(features.placement, features.target, features.point, strict=True)
    ):
        if placement < len(truth.placements):
            out[i] = truth.points_mm(int(placement))[where[int(target), o.points[point]]]
        elif bar_poses:
            pose = truth.bar_poses[placement - len(truth.placements)]
            bar = truth.bar(pose.bar)
            stretch = 1 + bar.expansion_per_kelvin * (pose.temperature_c - bar.reference_temperature_c)
            along = bar.x_mm[bar.targets.index(int(target))] * stretch
            out[i] = pose.rotation[:, 0] * along + pose.place_mm
    return out


def test_rows_hold_at_the_truth() -> None:
    session, truth = simulated("demo", 1, **WITH_BAR)
    o = Recording.of(session).observations
    rows = length_rows(Recording(session, o, find_features(o)), "B", true_points(truth, session))
    assert rows is not None
    assert len(rows.length) == 3 * 6
    np.testing.assert_allclose(rows.coefficient.sum(axis=1), 0.0, atol=1e-12)
    difference = np.einsum("mk,mki->mi", rows.coefficient, true_points(truth, session)[rows.points])
    # certificates are off by 2 um (standard), thermometers by 0.05 K: 0.3 um
    np.testing.assert_allclose(np.linalg.norm(difference, axis=1), rows.length, atol=4 * 0.0021)


def test_marks_of_eight_dots_are_their_centres() -> None:
    session, truth = simulated("rigA", 1, targets=40, bar_poses=4, scale="bar", mark_points="dots")
    o = Recording.of(session).observations
    features = find_features(o)
    points = np.full((len(features), 3), np.nan)
    assert session.target_set is not None
    for pose_index, pose in enumerate(truth.bar_poses):
        bar = truth.bar(pose.bar)
        stretch = 1 + bar.expansion_per_kelvin * (pose.temperature_c - bar.reference_temperature_c)
        for row in np.flatnonzero(features.placement == len(truth.placements) + pose_index):
            flat = session.target_set.layouts[int(features.target[row])][o.points[features.point[row]]]
            at = np.array([bar.x_mm[bar.targets.index(int(features.target[row]))] * stretch + flat[0], flat[1], 0.0])
            points[row] = pose.rotation @ at + pose.place_mm
    rows = length_rows(Recording(session, o, features), "B", points)
    assert rows is not None
    assert rows.points.shape[1] == 16
    known = np.nan_to_num(points)
    difference = np.einsum("mk,mki->mi", rows.coefficient, known[rows.points])
    np.testing.assert_allclose(np.linalg.norm(difference, axis=1), rows.length, atol=4 * 0.0021)


def test_a_certificate_errs_alike_in_all_poses() -> None:
    session, truth = simulated("demo", 1, **WITH_BAR)
    o = Recording.of(session).observations
    rows = length_rows(Recording(session, o, find_features(o)), "B", true_points(truth, session))
    assert rows is not None
    sd = np.sqrt(rows.covariance.diagonal())
    correlation = rows.covariance / sd / sd[:, None]
    same = np.round(rows.length)[:, None] == np.round(rows.length)
    assert (correlation[same] > 0.8).all()  # the same length in another pose; temperatures are each their own
    alike = (rows.covariance / np.outer(rows.length, rows.length))[~same]
    np.testing.assert_allclose(alike, alike.mean(), rtol=0.3)  # by the thermometer alone, in proportion to the length
    assert (correlation[~same] < 0.5).all()
    np.testing.assert_allclose(np.sqrt(sd**2 - alike.mean() * rows.length**2), 0.002, atol=0.0005)


@pytest.mark.parametrize("method", FORMS)
def test_the_bar_gives_the_scale(method: Form) -> None:
    calibration, _, truth = calibrated("demo", 1, CalibrationSettings(method=method), **WITH_BAR)
    scale = calibration.rig.scale
    assert scale.source == "bar"
    assert scale.relative_uncertainty is not None
    assert 2e-6 < scale.relative_uncertainty < 5e-4
    errors = errors_of(calibration, truth)
    assert abs(errors.scale - 1) < 3 * scale.relative_uncertainty
    assert max(rms(errors.focal_score), rms(errors.centre_score), rms(errors.point_score)) < 3.0
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.1)


def measured_lengths(calibration: Calibration, session: Session) -> dict[str, list[float]]:
    """Lengths between the marks of bar B, of all its poses, by the calibrated points."""
    f, points = calibration.features, calibration.points_mm
    bar = next(b for b in session.bars if b.id == "B")
    out: dict[str, list[float]] = {}
    for i, pose in enumerate(session.bar_poses):
        if pose.bar != "B":
            continue
        own = f.placement == len(session.placements) + i
        at = {int(t): x for t, x in zip(f.target[own], points[own], strict=True)}
        for length in bar.lengths:
            first, last = (at[bar.marks[name].target] for name in (length.from_mark, length.to_mark))
            name = f"{length.from_mark}-{length.to_mark}"
            out.setdefault(name, []).append(float(np.linalg.norm(last - first)) - length.length_mm)
    return out


def test_rows_hold_the_bar_in_every_pose() -> None:
    """Inside, the lengths of the bar agree far better than free points would: each is known to micrometres."""
    calibration, session, _ = calibrated("demo", 1, CalibrationSettings(method="free"), **WITH_BAR)
    inside = np.concatenate(list(measured_lengths(calibration, session).values()))
    warm = 500 * 1.15e-5 * 3.0  # bars were warmer than the certificate by up to 3 K
    assert np.abs(inside).max() < 0.01 + warm


@pytest.mark.parametrize("method", FORMS)
def test_poses_of_a_bar_strengthen_the_network(method: Form) -> None:
    """More than its scale: ten poses halve the uncertainty of the free form's focal lengths."""
    bare = calibrated("demo", 1, CalibrationSettings(method=method), targets=80)[0]
    inside = calibrated("demo", 1, CalibrationSettings(method=method), **{**WITH_BAR, "bar_poses": 10})[0]
    ratio = [
        with_bar.sigma.intrinsics[0] / without.sigma.intrinsics[0]
        for with_bar, without in zip(inside.rig.cameras, bare.rig.cameras, strict=True)
        if with_bar.sigma is not None and without.sigma is not None
    ]
    assert np.median(ratio) < (0.8 if method == "free" else 1.0)


@pytest.mark.parametrize("method", FORMS)
def test_more_poses_do_not_average_the_certificate(method: Form) -> None:
    """A certificate of 0.1 mm (standard) on 500 mm is 2e-4 of the scale, however often the bar is shown."""
    session, _ = simulated("demo", 1, **WITH_BAR)
    poor = calibrate(only_the_longest(session, expanded_mm=0.2), CalibrationSettings(method=method))
    assert poor.rig.scale.relative_uncertainty is not None
    assert 0.98 * 2e-4 < poor.rig.scale.relative_uncertainty < 4e-4
    good = calibrate(only_the_longest(session), CalibrationSettings(method=method))
    assert good.rig.scale.relative_uncertainty is not None
    apart = np.sqrt(poor.rig.scale.relative_uncertainty**2 - good.rig.scale.relative_uncertainty**2)
    assert apart == pytest.approx(2e-4, rel=0.1)


def test_an_error_of_the_certificate_is_an_error_of_the_scale() -> None:
    session, _ = simulated("demo", 1, **WITH_BAR)
    settings = CalibrationSettings(method="free")
    right, wrong = (calibrate(only_the_longest(session, error), settings) for error in (0.0, 0.05))
    baselines = [
        np.linalg.norm(np.diff([camera.centre_mm for camera in calibration.rig.cameras], axis=0), axis=1)
        for calibration in (right, wrong)
    ]
    np.testing.assert_allclose(baselines[1] / baselines[0], 1 + 0.05 / 500, atol=2e-6)
    for one, other in zip(right.rig.cameras, wrong.rig.cameras, strict=True):
        np.testing.assert_allclose(one.intrinsics, other.intrinsics, rtol=1e-6, atol=2e-3)


def test_check_bars_never_enter() -> None:
    """Whatever the check bar's certificate and images say, the rig is the same to the last bit."""
    session, _ = simulated("demo", 1, **WITH_BAR)
    o = observed(session)
    poses = [len(session.placements) + i for i, pose in enumerate(session.bar_poses) if pose.bar == "A"]
    of_check_bar = np.isin(o.placement, poses)
    assert of_check_bar.any()
    assert not np.isin(Recording.of(session).observations.placement, poses).any()
    uv = np.where(of_check_bar[:, None], o.uv + 5.0, o.uv)
    lengths = {bar.id: bar.lengths for bar in session.bars}
    lengths["A"] = tuple(replace(length, length_mm=1.01 * length.length_mm) for length in lengths["A"])
    spoilt = replace(
        session,
        observations=replace(o, uv=uv),
        bars=tuple(replace(bar, lengths=lengths[bar.id]) for bar in session.bars),
    )
    settings = CalibrationSettings(method="free")
    one, other = calibrated("demo", 1, settings, **WITH_BAR)[0], calibrate(spoilt, settings)
    assert one.rig.scale == other.rig.scale
    for a, b in zip(one.rig.cameras, other.rig.cameras, strict=True):
        np.testing.assert_array_equal(a.intrinsics, b.intrinsics)
        np.testing.assert_array_equal(a.translation_mm, b.translation_mm)


def test_the_paper_takes_only_the_scale_from_a_bar() -> None:
    """`tao2021`: a wrong bar moves lengths, not the lenses."""
    session, _ = simulated("demo", 1, **WITH_BAR)
    settings = CalibrationSettings(method="tao2021")
    right, wrong = (calibrate(only_the_longest(session, error), settings) for error in (0.0, 0.05))
    for a, b in zip(right.rig.cameras, wrong.rig.cameras, strict=True):
        np.testing.assert_array_equal(a.intrinsics, b.intrinsics)
    ratio = np.linalg.norm(wrong.rig.cameras[1].centre_mm) / np.linalg.norm(right.rig.cameras[1].centre_mm)
    assert ratio == pytest.approx(1 + 0.05 / 500, abs=1e-6)


def test_a_bar_that_nobody_sees_gives_no_scale() -> None:
    session, _ = simulated("demo", 1, **WITH_BAR)
    o = observed(session)
    blind = replace(session, observations=o.select(o.placement < len(session.placements)))
    calibration = calibrate(blind, CalibrationSettings(method="free"))
    assert calibration.rig.scale.source == "none"
    assert "no-scale" in {finding.code for finding in calibration.rig.quality.findings}
