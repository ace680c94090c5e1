"""Which form of the network the data carry, and that the choice is told with its reason."""

from dataclasses import replace

import numpy as np
import pytest

from spherecal.ball import image_poses
from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.findings import Finding
from spherecal.data.observations import Observations, find_features
from spherecal.data.rig import Calibration
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.steps.settings import CalibrationSettings
from spherecal_sim.observe import look, observe
from spherecal_sim.truth import Truth
from tests.networks import calibrated, codes, errors_of, observed, one_thread, rms, simulated, with_observations

__all__ = ["one_thread"]

TARGETS = 80  # enough for the demo rig's six cameras; whole balls take three times as long


def form_of(calibration: Calibration) -> Finding:
    """The one finding that tells the form."""
    found = [f for f in calibration.rig.quality.findings if f.code.startswith("form-")]
    assert len(found) == 1
    return found[0]


def test_a_turned_ball_is_taken_as_rigid() -> None:
    calibration, _, truth = calibrated("demo", 1, targets=TARGETS)
    said = form_of(calibration)
    assert (said.code, said.severity) == ("form-rigid", "info")
    assert "turned by 45 degrees" in said.message
    assert "dots in common" in said.message
    assert "limit 1.15" in said.message
    free = calibrated("demo", 1, CalibrationSettings(method="free"), targets=TARGETS)[0]
    assert "requested" in form_of(free).message
    for one, other in zip(calibration.rig.cameras, free.rig.cameras, strict=True):
        assert one.sigma is not None and other.sigma is not None
        assert one.sigma.intrinsics[0] < 0.6 * other.sigma.intrinsics[0]
    scores = errors_of(calibration, truth)
    assert max(rms(scores.focal_score), rms(scores.centre_score), rms(scores.point_score)) < 3.0
    assert rms(scores.focal_score) > 0.2


def test_auto_gives_what_rigid_gives() -> None:
    auto = calibrated("demo", 1, targets=TARGETS)[0]
    rigid = calibrated("demo", 1, CalibrationSettings(method="rigid"), targets=TARGETS)[0]
    assert "requested" in form_of(rigid).message
    for one, other in zip(auto.rig.cameras, rigid.rig.cameras, strict=True):
        np.testing.assert_array_equal(one.intrinsics, other.intrinsics)
        np.testing.assert_array_equal(one.translation_mm, other.translation_mm)


def test_a_rigid_ball_has_the_same_shape_at_every_placement() -> None:
    calibration = calibrated("demo", 1, targets=TARGETS)[0]
    f, points = calibration.features, calibration.points_mm
    dot = f.target * 8 + f.point
    distances = []
    for t in (0, 1):
        rows = np.flatnonzero((f.placement == t) & np.isfinite(points[:, 0]))
        distances.append({int(dot[r]): points[r] for r in rows})
    shared = sorted(distances[0].keys() & distances[1].keys())
    assert len(shared) > 50
    one, other = (np.array([d[k] for k in shared]) for d in distances)
    between = [np.linalg.norm(x[1:] - x[:-1], axis=1) for x in (one, other)]
    np.testing.assert_allclose(between[0], between[1], atol=1e-9)
    assert calibration.views[np.isfinite(points[:, 0])].min() >= 1


def test_a_ball_that_is_only_moved_has_a_stricter_limit() -> None:
    calibration = calibrated("demo", 1, targets=TARGETS, turns="moved")[0]
    said = form_of(calibration)
    assert said.code == "form-rigid"
    assert "hardly turned" in said.message
    assert "limit 1.05" in said.message


@pytest.mark.parametrize(("turns", "change_mm"), [("turned", 0.4), ("moved", 0.1)])
def test_a_ball_that_bends_is_not_taken_as_rigid(turns: str, change_mm: float) -> None:
    calibration, session, _ = calibrated("demo", 1, targets=TARGETS, turns=turns, shape_change_mm=change_mm)
    said = form_of(calibration)
    assert (said.code, said.severity) == ("form-free", "info")
    assert "shape changed" in said.message
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.1)
    assert "degrees" in said.hint
    forced = calibrate(session, CalibrationSettings(method="rigid"))
    assert form_of(forced).code == "form-rigid"
    assert forced.rig.quality.sigma0 is not None
    assert forced.rig.quality.sigma0 > 1.3 * 0.04  # that it is wrong stays visible


def test_a_turned_ball_that_bends_a_little_is_soft() -> None:
    """Between the forms: surer than free, and the play told with where it comes from."""
    calibration, session, truth = calibrated("demo", 1, targets=TARGETS, shape_change_mm=0.05)
    said = form_of(calibration)
    assert (said.code, said.severity) == ("form-soft", "info")
    assert "shape changed" in said.message
    assert "estimated" in said.message
    form = calibration.rig.form
    assert form is not None and form.shape_sd_mm is not None
    assert form.name == "soft" and not form.stated
    # 0.05 mm in three dimensions is 0.029 mm per coordinate, of which pose and shape take a part
    assert 0.01 < form.shape_sd_mm < 0.035
    assert "ball-shape-changed" in codes(calibration)
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.1)
    free = calibrate(session, CalibrationSettings(method="free"))
    gain = [
        one.sigma.intrinsics[0] / other.sigma.intrinsics[0]
        for one, other in zip(calibration.rig.cameras, free.rig.cameras, strict=True)
        if one.sigma is not None and other.sigma is not None
    ]
    assert np.median(gain) < 0.9
    scores = errors_of(calibration, truth)
    assert max(rms(scores.focal_score), rms(scores.centre_score)) < 4.0


def test_a_stated_play_is_taken_and_told() -> None:
    session, _ = simulated("demo", 1, targets=TARGETS, shape_change_mm=0.1, shape_change="per-dot")
    stated = calibrate(session, CalibrationSettings(method="soft", shape_sd_mm=0.058))
    found = calibrate(session, CalibrationSettings(method="soft"))
    assert stated.rig.form is not None and found.rig.form is not None
    assert (stated.rig.form.shape_sd_mm, stated.rig.form.stated) == (pytest.approx(0.058), True)
    assert "as stated" in form_of(stated).message
    assert found.rig.form.shape_sd_mm == pytest.approx(0.058, rel=0.15)  # independent from dot to dot: all of it
    assert "requested" in form_of(found).message
    assert form_of(found).severity == "info"
    assert stated.rig.quality.sigma0 == pytest.approx(0.04, rel=0.1)


def test_a_stiff_ball_has_hardly_any_play_in_the_soft_form() -> None:
    session, _ = simulated("demo", 1, targets=TARGETS)
    soft = calibrate(session, CalibrationSettings(method="soft"))
    assert soft.rig.form is not None and soft.rig.form.shape_sd_mm is not None
    assert soft.rig.form.shape_sd_mm < 0.01
    rigid = calibrate(session, CalibrationSettings(method="rigid"))
    for one, other in zip(soft.rig.cameras, rigid.rig.cameras, strict=True):
        assert one.sigma is not None and other.sigma is not None
        assert abs(one.intrinsics[0] - other.intrinsics[0]) < other.sigma.intrinsics[0]


def test_a_bar_gives_the_scale_of_a_soft_ball() -> None:
    session, truth = simulated("demo", 1, targets=TARGETS, shape_change_mm=0.1, scale="bar", bar_poses=6)
    soft = calibrate(session, CalibrationSettings(method="soft"))
    assert soft.rig.scale.source == "bar"
    assert soft.rig.quality.valid
    scores = errors_of(soft, truth)
    assert rms(scores.centre_score) < 4.0


def other_targets_everywhere(session: Session) -> Session:
    """As if every placement had carried a ball of its own."""
    o = observed(session)
    return replace(session, observations=replace(o, target=o.target + 1000 * o.placement), target_set=None)


def test_other_targets_at_every_placement_are_free() -> None:
    session = other_targets_everywhere(simulated("demo", 1, targets=TARGETS)[0])
    said = form_of(calibrate(session))
    assert (said.code, said.severity) == ("form-free", "info")
    assert "no dot is seen at two placements" in said.message


def test_rigid_is_refused_where_nothing_is_shared() -> None:
    session = other_targets_everywhere(simulated("demo", 1, targets=TARGETS)[0])
    for form in ("rigid", "soft"):
        with pytest.raises(InputError, match=f"{form} form is not possible: no dot is seen at two placements"):
            calibrate(session, CalibrationSettings(method=form))  # type: ignore[arg-type]


def test_one_placement_is_free() -> None:
    session, _ = simulated("demo", 1, targets=TARGETS)
    o = observed(session)
    kept = o.select(o.placement == 0)
    alone = replace(kept, placements=o.placements[:1])
    session = replace(session, placements=session.placements[:1], observations=alone)
    assert "only one placement" in form_of(calibrate(session)).message
    with pytest.raises(InputError, match="only one placement"):
        calibrate(session, CalibrationSettings(method="rigid"))


def test_a_placement_that_shares_nothing_stands_for_itself() -> None:
    """Three placements of one ball and a fourth of another: those that share dots are one, the fourth is free."""
    session, truth = simulated("demo", 1, targets=TARGETS)
    o = observed(session)
    target = np.where(o.placement == 3, o.target + 1000, o.target)
    calibration = calibrate(replace(session, observations=replace(o, target=target), target_set=None))
    assert form_of(calibration).code == "form-rigid"
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.1)
    f = calibration.features
    assert np.isfinite(calibration.points_mm[f.placement == 3, 0]).mean() > 0.5
    as_simulated = replace(calibration, features=replace(f, target=f.target % 1000))
    errors = errors_of(as_simulated, truth)
    assert max(rms(errors.centre_score), rms(errors.rotation_score), rms(errors.point_score)) < 3.0


def two_sides(truth: Truth, session: Session, rotations: FloatArray) -> tuple[Session, Truth]:
    """The lower cameras of rig B, three facing three: no dot is seen from both sides at the same placement."""
    truth = replace(truth, ball_rotations=rotations)
    view, ball = look(truth.cameras), truth.ball
    seen = [
        observe(view, truth.points_mm(t), ball.normals @ turn.T, truth.options.view_limit_deg)
        for t, turn in enumerate(rotations)
    ]
    placement = np.concatenate([np.full(len(s.camera), t) for t, s in enumerate(seen)])
    camera, dot, uv = (np.concatenate([getattr(s, name) for s in seen]) for name in ("camera", "point", "uv"))
    o = observed(session)
    uv = uv + 0.04 * np.random.default_rng(0).normal(size=uv.shape)
    o = Observations(
        o.placements, o.cameras, o.points, placement, camera, ball.dot_target[dot], ball.dot_point[dot], uv
    )
    centres = np.array([c.centre_mm for c in truth.cameras])
    low = np.flatnonzero(centres[:, 2] < 495)
    front = centres[o.camera, 1] > 0
    feature = find_features(o).of_observation
    taking_part = np.isin(o.camera, low)
    from_behind = np.zeros(feature.max() + 1, dtype=bool)
    from_behind[feature[taking_part & ~front]] = True
    o = o.select(taking_part & ~(front & from_behind[feature]))
    number = np.searchsorted(low, o.camera)
    cameras = tuple(session.cameras[c] for c in low)
    o = replace(o, cameras=tuple(c.id for c in cameras), camera=number)
    return replace(session, cameras=cameras, observations=o), replace(
        truth, cameras=tuple(truth.cameras[c] for c in low)
    )


@pytest.mark.parametrize(("step_deg", "tilt_deg"), [(90.0, 0.0), (90.0, 15.0)])
def test_cameras_without_a_common_view_are_linked_by_the_ball(step_deg: float, tilt_deg: float) -> None:
    """Three cameras that face three: what one side saw is turned before the other.

    Without a single dot seen from both sides at 50 degrees the trees of both sides stay apart: said, not linked.
    """
    session, truth = simulated("rigB", 1, turns="moved", targets=70)
    about_z = exp_rotation(np.deg2rad(step_deg) * np.arange(4)[:, None] * np.array([0.0, 0.0, 1.0]))
    tilt = exp_rotation(np.deg2rad(tilt_deg) * np.array([[0.0], [1.0], [-1.0], [0.0]]) * np.array([1.0, 0.0, 0.0]))
    about_z = tilt @ about_z
    session, truth = two_sides(truth, session, about_z @ truth.ball_rotations[0])
    o = observed(session)
    feature = find_features(o).of_observation
    assert not np.isin(feature[np.isin(o.camera, [0, 2, 4])], feature[np.isin(o.camera, [1, 3, 5])]).any()
    free = calibrate(session, CalibrationSettings(method="free"))
    assert len(free.rig.cameras) == 3
    assert "cameras-unlinked" in codes(free)
    calibration = calibrate(session)
    assert len(calibration.rig.cameras) == 6
    assert form_of(calibration).code == "form-rigid"
    assert calibration.rig.quality.sigma0 == pytest.approx(0.04, rel=0.1)
    errors = errors_of(calibration, truth)
    assert rms(errors.centre_mm) < 1.0
    assert max(rms(errors.centre_score), rms(errors.rotation_score), rms(errors.focal_score)) < 3.0


def test_fewer_observations_do_not_turn_the_form() -> None:
    """Every second observation is gone: still the same ball."""
    session, _ = simulated("demo", 1, targets=TARGETS)
    keep = np.random.default_rng(0).random(len(observed(session))) < 0.8
    assert form_of(calibrate(with_observations(session, keep=keep))).code == "form-rigid"


def in_pairs(session: Session, seed: int) -> Session:
    """The session with every dot of every placement seen by two cameras at most."""
    o, rng = observed(session), np.random.default_rng(seed)
    feature = find_features(o).of_observation
    order = np.lexsort((rng.random(len(feature)), feature))
    first = np.diff(feature[order], prepend=-1) != 0
    begins = np.maximum.accumulate(np.where(first, np.arange(len(feature)), 0))
    keep = np.zeros(len(feature), dtype=bool)
    keep[order] = np.arange(len(feature)) - begins < 2
    return with_observations(session, keep)


@pytest.mark.parametrize("rig", ["demo", "rigB"])
def test_a_rig_of_which_no_three_cameras_see_the_same_dots(rig: str) -> None:
    """As five cameras around a ball: the strongest pair starts, the turned ball links the others."""
    clean, session, truth = calibrated(rig, 2)
    done = calibrate(in_pairs(session, 2))
    assert done.rig.quality.verdict == "valid"
    assert len(done.rig.cameras) == len(session.cameras)
    errors = errors_of(done, truth)
    whole = errors_of(clean, truth)
    assert rms(errors.centre_score) < 2
    assert rms(errors.centre_mm) < 4 * rms(whole.centre_mm)


@pytest.mark.parametrize("seed", [1, 2])
def test_cameras_are_linked_by_some_of_many_placements(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """More images than are linked at a time: the placements with most dots link the cameras, the others follow."""
    session, truth = simulated("demo", seed, placements=6)
    session = in_pairs(session, 2)
    monkeypatch.setattr(image_poses, "MOST_LINKED", 3 * len(session.cameras))
    calibration = calibrate(session)
    assert len(calibration.rig.cameras) == len(session.cameras)
    assert "cameras-unlinked" not in codes(calibration)
    assert {sphere.placement for sphere in calibration.spheres} == {f"P{i}" for i in range(1, 7)}
    assert max(rms(errors_of(calibration, truth).centre_score), rms(errors_of(calibration, truth).focal_score)) < 2.0


def test_pairs_alone_do_not_link_cameras_without_a_turned_ball() -> None:
    """One placement: the scales of the pairs against each other are open."""
    session, _ = simulated("demo", 2)
    one = with_observations(in_pairs(session, 2), observed(in_pairs(session, 2)).placement == 0)
    done = calibrate(one)
    assert done.rig.quality.verdict == "not-valid"
    assert "cameras-unlinked" in codes(done)
