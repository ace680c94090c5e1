"""Measuring with a calibrated rig: places, uncertainties, values, bodies, contradictions, health."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from spherecal.base.errors import InputError
from spherecal.data.observations import Observations
from spherecal.data.rig import Rig
from spherecal.data.rig_camera import posed
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation, log_rotation
from spherecal.targets.centre import centre_by_point, target_centre
from spherecal_measuring.health import RigHealth, health_document
from spherecal_measuring.measured_sets import MeasuredSet, ObservedSet
from spherecal_measuring.measurer import Measurer, measure_sets
from spherecal_measuring.measuring_task import Body, BodyPoint, PointName, Ruler, Task, parse_point, parse_ruler
from spherecal_measuring.places import Layouts, _centres
from spherecal_measuring.rejection import reject_views
from spherecal_measuring.series_file import one_set, sets_of_session
from spherecal_rigs.check_rig import check
from spherecal_verify.consistency import CameraTest, Consistency
from spherecal_verify.outlying_views import CheckedPoints, Views
from spherecal_verify.verify_bars import verify
from tests.networks import calibrated, one_thread

__all__ = ["one_thread"]

NOISE_PX = 0.05


@pytest.fixture(scope="module")
def demo() -> tuple[Session, Rig]:
    calibration, session, _ = calibrated("demo", 1, bar_poses=4)
    return session, calibration.rig


@pytest.fixture(scope="module")
def sets(demo: tuple[Session, Rig]) -> list[ObservedSet]:
    return list(sets_of_session(*demo))


def measured(sets: list[ObservedSet], rig: Rig, task: Task) -> list[MeasuredSet]:
    return list(measure_sets(sets, Measurer(rig, task)))


def seen_points(
    rig: Rig,
    places: dict[PointName, np.ndarray],
    rng: np.random.Generator | None = None,
    number: int = 1,
    time_s: float | None = None,
    noise_px: float = NOISE_PX,
    moved: dict[str, np.ndarray] | None = None,
) -> ObservedSet:
    """A set in which all cameras see named points directly, with noise; `moved` shifts a camera's image points."""
    cameras = tuple(c.id for c in rig.cameras)
    points = tuple(sorted({name.point for name in places}))
    rows = [
        (c, name.target, points.index(name.point), camera.project(xyz) + (moved or {}).get(camera.id, 0.0))
        for c, camera in enumerate(rig.cameras)
        for name, xyz in places.items()
    ]
    uv = np.array([row[3] for row in rows])
    inside = np.asarray(np.isfinite(uv).all(axis=1))
    uv = uv + (0.0 if rng is None else rng.normal(0, noise_px, uv.shape))
    o = Observations(
        ("",),
        cameras,
        points,
        np.zeros(len(rows), int),
        np.array([r[0] for r in rows]),
        np.array([r[1] for r in rows]),
        np.array([r[2] for r in rows]),
        uv,
        np.full(uv.shape, noise_px),
    )
    return ObservedSet(number, "", o.select(inside), time_s)


def middle(rig: Rig) -> np.ndarray:
    """Where the cameras look at together: the point nearest to all axes."""
    across = [np.eye(3) - np.outer(c.rotation[2], c.rotation[2]) for c in rig.cameras]
    right = sum(a @ c.centre_mm for a, c in zip(across, rig.cameras, strict=True))
    return np.linalg.solve(sum(across), right)  # type: ignore[arg-type]


def cloud(rig: Rig, n: int, seed: int, size_mm: float = 150.0) -> dict[PointName, np.ndarray]:
    at = np.random.default_rng(seed).uniform(-size_mm, size_mm, (n, 3)) + middle(rig)
    return {PointName(i + 1, "centre"): xyz for i, xyz in enumerate(at)}


# --- names -----------------------------------------------------------------------------------------------------------


def test_points_and_rulers_are_read() -> None:
    assert parse_point(" 12 ") == PointName(12)
    assert parse_point("12/A") == PointName(12, "A")
    assert parse_ruler("12,14/B=400.05", 2) == Ruler((PointName(12), PointName(14, "B")), 400.05)
    assert parse_ruler("1,2,3", 3).kind == "angle"


@pytest.mark.parametrize("text", ["", "A", "12/", "/A", "-1", "12/A/B", "1.5", "12/a,b", "9" * 30])
def test_what_is_no_point_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is not a point"):
        parse_point(text)


@pytest.mark.parametrize("text", ["1", "1,1", "1,2,3", "1,2=", "1,2=nan", "1,2=-4", "1,2=x"])
def test_what_is_no_distance_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_ruler(text, 2)


def test_two_bodies_of_one_name_are_refused() -> None:
    body = Body("tool", tuple(BodyPoint(PointName(i), (i, i * i, 0)) for i in range(3)))
    with pytest.raises(InputError, match="the same name"):
        Task(bodies=(body, body))


# --- places ----------------------------------------------------------------------------------------------------------


def test_bars_are_measured_as_verification_measures_them(demo: tuple[Session, Rig], sets: list[ObservedSet]) -> None:
    session, rig = demo
    bars = tuple(replace(bar, role="check") for bar in session.bars)
    there = {
        (m.pose, f"{m.bar}:{m.from_mark}-{m.to_mark}"): m for m in verify(replace(session, bars=bars), rig).measured
    }
    warm = {pose.id: pose.temperature_c for pose in session.bar_poses}
    compared = 0
    for one in sets:
        if one.id not in warm:
            continue
        task = Task(session.target_set, bars=bars, temperature_c=warm[one.id])
        for value in Measurer(rig, task).measure(one).values:
            known = there.pop((one.id, value.name), None)
            if known is None:
                continue
            assert value.value == pytest.approx(known.length_mm, abs=1e-6)
            assert value.deviation == pytest.approx(known.error_mm, abs=1e-6)
            assert value.u_deviation == pytest.approx(known.budget.combined_mm, rel=0.35)  # a set's own noise
            compared += 1
    assert compared > 10
    assert not there


def test_centres_are_those_of_the_interface_with_their_derivatives(demo: tuple[Session, Rig]) -> None:
    session, _ = demo
    targets = session.target_set
    assert targets is not None
    rng = np.random.default_rng(3)
    target, point, places = [], [], []
    names = ("A", "B", "C", "D", "E", "M1", "M2", "M3")
    chosen = sorted(targets.layouts)[:6]
    for n, one in enumerate(chosen):
        dots = names[: 8 - n % 4]
        flat = np.column_stack([targets.places(one, dots), np.zeros(len(dots))])
        turned = flat @ exp_rotation(rng.normal(size=3)).T + rng.normal(0, 300, 3)
        target += [one] * len(dots)
        point += [names.index(dot) for dot in dots]
        places.append(turned + rng.normal(0, 0.01, turned.shape))
    xyz, ids, index = np.concatenate(places), np.array(target), np.array(point)
    flat = Layouts(targets, names).of(ids, index)

    class Points:
        points = xyz
        covariance = np.broadcast_to(np.eye(3), (len(xyz), 3, 3))

    nothing = np.zeros(len(xyz), bool)
    checked = CheckedPoints(None, Points(), np.ones(1, bool), nothing, 1.0)  # type: ignore[arg-type]
    found = _centres(ids, flat, np.ones(len(xyz), bool), checked, Layouts(targets, names))
    assert found.target.tolist() == chosen
    for i, one in enumerate(chosen):
        mine = ids == one
        expected = target_centre(flat[mine], xyz[mine])
        assert expected is not None
        np.testing.assert_allclose(found.places_mm[i], expected, atol=1e-9)
        by_point = centre_by_point(flat[mine], xyz[mine])
        np.testing.assert_allclose(found.by_dot[i], by_point, atol=3e-3)  # first order: noise over the size, 1e-3


def test_dots_are_measured_where_they_are_asked_for(demo: tuple[Session, Rig], sets: list[ObservedSet]) -> None:
    session, rig = demo
    target = Measurer(rig, Task(session.target_set)).measure(sets[0]).names[0].target
    with_dot = Measurer(rig, Task(session.target_set, points=(PointName(target, "A"),))).measure(sets[0])
    assert PointName(target, "A") in with_dot.names
    assert with_dot.index(PointName(target, "B")) is None
    bare = Measurer(rig, Task(None)).measure(sets[0])  # no layouts: every dot is a point
    assert {name.point for name in bare.names} >= {"A", "B", "M3"}


def test_stated_covariance_holds_the_noise(demo: tuple[Session, Rig]) -> None:
    """Mahalanobis distances of 200 sets follow chi-square where the cameras are exact."""
    rig = exact(demo[1])
    places = cloud(rig, 5, 1)
    rng = np.random.default_rng(2)
    distances = []
    for _ in range(60):
        one = Measurer(rig).measure(seen_points(rig, places, rng))
        for name, xyz in places.items():
            i = one.index(name)
            assert i is not None
            off = one.points_mm[i] - xyz
            distances.append(off @ np.linalg.solve(one.covariance_mm2[i], off))
    assert np.mean(distances) == pytest.approx(3.0, abs=4 * np.sqrt(6 / len(distances)))


def exact(rig: Rig) -> Rig:
    """The rig as if its cameras were known exactly."""
    cameras = tuple(replace(c, sigma=None) for c in rig.cameras)
    return replace(rig, cameras=cameras, covariance=None)


def test_distances_and_angles_with_their_uncertainties(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    rig = replace(rig, scale=replace(rig.scale, relative_uncertainty=None))
    names = [PointName(i) for i in (1, 2, 3)]
    places = dict(zip(names, middle(rig) + np.array([[100.0, 0, 0], [0, 0, 0], [0, 80.0, 20.0]]), strict=True))
    task = Task(rulers=(Ruler((names[0], names[1]), 99.0), Ruler(tuple(names), 90.0)))
    rng = np.random.default_rng(5)
    scores: list[tuple[float, float]] = []
    for _ in range(150):
        distance, angle = Measurer(rig, task).measure(seen_points(rig, places, rng)).values
        assert (distance.unit, angle.unit) == ("mm", "deg")
        assert distance.deviation == pytest.approx(distance.value - 99.0)
        scores.append(((distance.value - 100.0) / distance.u, (angle.value - 90.0) / angle.u))
    for column in np.array(scores).T:
        assert np.mean(column**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(column)))


@pytest.mark.parametrize("known", [False, True], ids=["cameras exact", "covariance known"])
def test_the_scale_is_once_in_a_distances_uncertainty(demo: tuple[Session, Rig], known: bool) -> None:
    """Added where the cameras' covariance is not known; that holds the scale already."""
    rig = demo[1] if known else exact(demo[1])
    names = PointName(1), PointName(2)
    places = dict(zip(names, middle(rig) + np.array([[100.0, 0, 0], [-100.0, 0, 0]]), strict=True))

    def variance(relative: float | None) -> float:
        one = replace(rig, scale=replace(rig.scale, relative_uncertainty=relative))
        return Measurer(one, Task(rulers=(Ruler(names),))).measure(seen_points(one, places)).values[0].u ** 2

    assert variance(1e-3) - variance(None) == pytest.approx(0.0 if known else 0.2**2, rel=1e-6, abs=1e-12)


def test_what_two_points_have_in_common_does_not_blur_their_distance(demo: tuple[Session, Rig]) -> None:
    """Two near points move together with the cameras' errors."""
    _, rig = demo
    at = middle(rig)
    places = {PointName(1): at, PointName(2): at + np.array([5.0, 0, 0])}
    one = Measurer(rig, Task(rulers=(Ruler((PointName(1), PointName(2))),))).measure(seen_points(rig, places))
    apart = np.sqrt(sum(np.trace(c) for c in one.covariance_mm2))
    noise = Measurer(exact(rig), Task(rulers=(Ruler((PointName(1), PointName(2))),)))
    assert one.values[0].u < apart
    assert one.values[0].u < 1.5 * noise.measure(seen_points(rig, places)).values[0].u


def test_missing_points_are_said(demo: tuple[Session, Rig]) -> None:
    rig = demo[1]
    at = middle(rig)
    line = {PointName(i): at + np.array([20.0 * i, 0, 0]) for i in (1, 2, 3)}
    names = tuple(line)
    task = Task(rulers=(Ruler((PointName(1), PointName(9))), Ruler(names)))
    found = Measurer(exact(rig), task).measure(seen_points(rig, line))
    assert dict(found.missing) == {"1-9": "9 not measured", "1-2-3": "the points are on one line"}
    assert found.values == ()


# --- bodies ----------------------------------------------------------------------------------------------------------


def a_body(rig: Rig, n: int = 6, seed: int = 4) -> tuple[Body, dict[PointName, np.ndarray], np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    own = rng.uniform(-80, 80, (n, 3))
    rotation, at = exp_rotation(rng.normal(size=3)), middle(rig)
    points = tuple(BodyPoint(PointName(i + 1), tuple(xyz.tolist())) for i, xyz in enumerate(own))
    return Body("tool", points), {p.name: rotation @ own[i] + at for i, p in enumerate(points)}, rotation, at


def test_a_bodys_pose_and_its_covariance(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    body, places, rotation, at = a_body(rig)
    rng = np.random.default_rng(6)
    scores = []
    for _ in range(100):
        (pose,) = Measurer(rig, Task(bodies=(body,))).measure(seen_points(rig, places, rng)).bodies
        assert pose.left_out == ()
        off = np.concatenate([log_rotation(rotation @ pose.rotation.T), at - pose.translation_mm])
        scores.append(off @ np.linalg.solve(pose.covariance, off))
    assert np.mean(scores) == pytest.approx(6.0, abs=4 * np.sqrt(12 / len(scores)))


def test_a_point_that_is_hardly_known_hardly_moves_its_body(demo: tuple[Session, Rig]) -> None:
    """Of six equal points one that is 0.6 mm off would take the body along by 0.1 mm; it is known to 1 mm only."""
    rig = exact(demo[1])
    body, places, rotation, at = a_body(rig)
    body = replace(body, points=(replace(body.points[0], sigma_mm=1.0), *body.points[1:]))
    places[body.points[0].name] = places[body.points[0].name] + [0.0, 0.6, 0.0]
    (pose,) = Measurer(rig, Task(bodies=(body,))).measure(seen_points(rig, places)).bodies
    assert pose.left_out == ()
    assert pose.translation_mm == pytest.approx(at, abs=0.01)
    assert log_rotation(rotation @ pose.rotation.T) == pytest.approx(np.zeros(3), abs=1e-4)


def test_a_wrong_point_of_a_body_is_left_out_and_named(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    body, places, _, at = a_body(rig)
    places[PointName(3)] = places[PointName(3)] + [0.0, 2.0, 0.0]
    (pose,) = Measurer(rig, Task(bodies=(body,))).measure(seen_points(rig, places, np.random.default_rng(1))).bodies
    assert pose.left_out == (PointName(3),)
    np.testing.assert_allclose(pose.translation_mm, at, atol=0.2)


def test_a_body_that_does_not_fit_or_is_not_seen_has_no_pose(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    body, places, _, _ = a_body(rig, 3)
    few = {name: xyz for name, xyz in places.items() if name.target < 3}
    task = Task(bodies=(body,))
    assert "2 of its 3" in dict(Measurer(rig, task).measure(seen_points(rig, few)).missing)["tool"]
    places[PointName(1)] = places[PointName(1)] + [0.0, 3.0, 0.0]
    found = Measurer(rig, task).measure(seen_points(rig, places))
    assert found.bodies == ()
    assert "do not fit" in dict(found.missing)["tool"]


# --- contradictions --------------------------------------------------------------------------------------------------


def test_a_contradicting_view_is_named(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    places = cloud(rig, 8, 2)
    one = seen_points(rig, places, np.random.default_rng(3))
    o = one.observations
    wrong = (o.camera == 2) & (o.target == 4)
    uv = np.where(wrong[:, None], o.uv + np.array([3.0, -2.0]), o.uv)
    found = Measurer(rig).measure(replace(one, observations=replace(o, uv=uv)))
    assert [(c.target, c.camera, c.views, c.of) for c in found.contradictions] == [(4, rig.cameras[2].id, 1, 1)]
    i = found.index(PointName(4))
    assert i is not None
    assert np.linalg.norm(found.points_mm[i] - places[PointName(4)]) < 0.5


def test_two_views_that_contradict_give_no_point(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    two = replace(rig, cameras=rig.cameras[:2])
    places = cloud(rig, 3, 2)
    across = np.array([20.0, 20.0])
    found = Measurer(two).measure(seen_points(two, places, moved={two.cameras[0].id: across}))
    assert found.names == ()
    assert {c.camera for c in found.contradictions} == {None}


def test_rejection_agrees_with_the_search_by_triangulation(demo: tuple[Session, Rig]) -> None:
    """The closed form finds the views that leaving out one after the other finds."""
    from spherecal_verify.outlying_views import triangulate_checked

    rig = exact(demo[1])
    rng = np.random.default_rng(8)
    o = seen_points(rig, cloud(rig, 60, 5), rng).observations
    wrong = rng.random(len(o)) < 0.04
    uv = o.uv + wrong[:, None] * rng.uniform(-6, 6, (len(o), 2))
    views = Views(o.target - 1, o.camera, uv, np.full(uv.shape, NOISE_PX), 60, posed(rig.cameras))
    ours, theirs = reject_views(views, 1.0), triangulate_checked(views, 1.0)
    differ = int((ours.kept != theirs.kept).sum())
    assert wrong.sum() > 5
    assert differ <= 1
    assert ours.kept[~wrong].mean() > 0.99


# --- motion ----------------------------------------------------------------------------------------------------------


def moving_sets(rig: Rig, speed: float, skew_s: float, n: int, rng: np.random.Generator) -> list[ObservedSet]:
    """Points that move along x, seen by cameras that expose at different moments."""
    places = cloud(rig, 6, 7, 60.0)
    even = rng.uniform(-skew_s / 2, skew_s / 2, len(rig.cameras))
    late = dict(zip((c.id for c in rig.cameras), (even - even.mean()).tolist(), strict=True))
    found = []
    for k in range(n):
        at = 0.1 * k
        per_camera = []
        for c in rig.cameras:
            own = {name: xyz + np.array([speed * (at + late[c.id]), 0, 0]) for name, xyz in places.items()}
            per_camera.append(seen_points(replace(rig, cameras=(c,)), own, rng).observations)
        o = Observations(
            ("",),
            tuple(c.id for c in rig.cameras),
            per_camera[0].points,
            np.concatenate([p.placement for p in per_camera]),
            np.concatenate([np.full(len(p), i) for i, p in enumerate(per_camera)]),
            np.concatenate([p.target for p in per_camera]),
            np.concatenate([p.point for p in per_camera]),
            np.concatenate([p.uv for p in per_camera]),
            np.concatenate([p.sigma for p in per_camera if p.sigma is not None]),
        )
        exposure = {name: at + value for name, value in late.items()}
        found.append(ObservedSet(k + 1, "", o, at, exposure))
    return found


def errors_and_sigmas(rig: Rig, task: Task, speed: float, skew_s: float, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    truth = cloud(rig, 6, 7, 60.0)
    errors, chi = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        measurer = Measurer(rig, task)
        for k, one in enumerate(moving_sets(rig, speed, skew_s, 3, rng)):
            found = measurer.measure(one)
            for i, name in enumerate(found.names if k == 2 else ()):
                off = found.points_mm[i] - truth[name] - [speed * 0.1 * k, 0, 0]
                errors.append(np.linalg.norm(off))
                chi.append(off @ np.linalg.solve(found.covariance_mm2[i], off))
    return np.array(errors), np.array(chi)


@pytest.mark.parametrize(
    "task",
    [Task(exposure_sd_s=5e-3 / np.sqrt(12)), Task(), Task(exposure_sd_s=0.0), Task(correct_exposure=True)],
    ids=["stated", "scatter", "wrongly none", "exact"],
)
def test_trigger_skew_is_found_and_taken_out(demo: tuple[Session, Rig], task: Task) -> None:
    """At 0.2 m/s and 5 ms image points are off by up to 1 mm, and each point was by 0.06 mm and more."""
    errors, chi = errors_and_sigmas(exact(demo[1]), task, 200.0, 5e-3, 8)
    assert len(errors) > 30
    assert np.median(errors) < 0.03
    assert 0.5 < np.mean(chi) / 3 < 2.0


def test_cameras_without_times_of_exposure_are_late_all_the_same(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    measurer = Measurer(rig)
    truth = cloud(rig, 6, 7, 60.0)
    for k, one in enumerate(moving_sets(rig, 200.0, 5e-3, 5, np.random.default_rng(3))):
        found = measurer.measure(replace(one, exposure_s=None))
        if k < 2:
            continue
        off = found.points_mm - [truth[name] + np.array([20.0 * k, 0, 0]) for name in found.names]
        assert len(off) == 6
        assert np.linalg.norm(off, axis=1).max() < 0.1


def test_a_target_newly_seen_may_move_as_fast_as_the_others(demo: tuple[Session, Rig]) -> None:
    """Of its velocity nothing is known yet: its uncertainty says so, and is small again with more cameras."""
    rig = exact(demo[1])
    measurer, truth = Measurer(rig, Task()), cloud(rig, 6, 7, 60.0)
    sigma = {}
    for k, one in enumerate(moving_sets(rig, 1000.0, 5e-3, 6, np.random.default_rng(4))):
        o = one.observations
        hidden = (o.target == 3) & ((k < 4) | ((k == 4) & (o.camera > 1)))  # two cameras say little of its velocity
        found = measurer.measure(replace(one, observations=o.select(~hidden)))
        i = found.index(PointName(3))
        if i is not None:
            off = found.points_mm[i] - truth[PointName(3)] - [100.0 * k, 0, 0]
            sigma[k] = float(np.linalg.norm(found.sigma_mm[i]))
            assert off @ np.linalg.solve(found.covariance_mm2[i], off) < 16.3  # of 3, once in 1000
    assert set(sigma) == {4, 5}
    assert sigma[4] > 3 * sigma[5]


def test_speed_is_measured(demo: tuple[Session, Rig]) -> None:
    rig = exact(demo[1])
    found = measured(moving_sets(rig, 200.0, 0.0, 3, np.random.default_rng(1)), rig, Task(exposure_sd_s=0.0))
    assert np.isnan(found[0].speed_mm_s).all()
    np.testing.assert_allclose(found[2].speed_mm_s, 200.0, rtol=0.01)


# --- health ----------------------------------------------------------------------------------------------------------


def test_a_camera_that_is_knocked_is_named_and_no_other(demo: tuple[Session, Rig]) -> None:
    rig = demo[1]
    rng = np.random.default_rng(3)
    measurer = Measurer(rig)
    knocked = rig.cameras[1].id
    places = cloud(rig, 20, 9)
    for k in range(1, 21):
        moved = {knocked: np.array([0.6, 0.3])} if k > 10 else None
        measurer.measure(seen_points(rig, places, rng, k, moved=moved))
        if k == 10:
            assert measurer.health.moved == ()
    assert measurer.health.moved == (knocked,)
    one = next(c for c in measurer.health.cameras if c.camera == knocked)
    assert one.named_at is not None and 11 <= one.named_at <= 15
    document = health_document(measurer.health, rig)
    assert document["verdict"] in ("watch", "recalibrate")
    assert knocked in str(document["sentence"])


def test_a_camera_that_was_named_stays_in_the_document_when_it_sees_nothing(demo: tuple[Session, Rig]) -> None:
    rig = demo[1]
    rng = np.random.default_rng(3)
    measurer = Measurer(rig)
    knocked, places = rig.cameras[1].id, cloud(rig, 20, 9)
    for k in range(1, 6):
        measurer.measure(seen_points(rig, places, rng, k, moved={knocked: np.array([0.6, 0.3])}))
    for k in range(6, 11):
        one = seen_points(rig, places, rng, k)
        measurer.measure(replace(one, observations=one.observations.select(one.observations.camera != 1)))
    assert measurer.health.moved == (knocked,)
    assert knocked in str(health_document(measurer.health, rig)["sentence"])


def test_the_health_is_judged_by_the_test_over_many_sets(demo: tuple[Session, Rig]) -> None:
    rig = demo[1]
    health = RigHealth(rig)
    names = [camera.id for camera in rig.cameras[:3]]

    def learn(kind: str, rms_px: float, cameras: list[str]) -> None:
        tests = (CameraTest(name, 50, rms_px, 0.0, np.zeros(3), np.zeros(3), 0.0, 0.5, False) for name in cameras)
        health._learn(1, kind, Consistency(tuple(tests), (), 1.0, 0))

    learn("fast", 0.3, names)
    assert [test.rms_px for test in health.state.tests] == [0.3, 0.3, 0.3]
    learn("slow", 0.1, names[:2])
    learn("fast", 0.2, names)
    assert [(test.id, test.rms_px) for test in health.state.tests] == list(zip(names, (0.1, 0.1, 0.2), strict=True))


def test_a_tiny_move_is_not_named_however_sure(demo: tuple[Session, Rig]) -> None:
    """Targets at rest show the same lens error in every set: that is no move."""
    rig = demo[1]
    rng = np.random.default_rng(3)
    measurer = Measurer(rig)
    places = cloud(rig, 40, 9)
    for k in range(1, 31):
        measurer.measure(seen_points(rig, places, rng, k, moved={rig.cameras[1].id: np.array([0.05, 0.0])}))
    assert measurer.health.moved == ()


def test_unchanged_cameras_are_not_named(demo: tuple[Session, Rig]) -> None:
    rig = demo[1]
    measurer = Measurer(rig)
    for k in range(1, 121):
        measurer.measure(seen_points(rig, cloud(rig, 10, k), np.random.default_rng(k), k))
    assert measurer.health.moved == ()
    assert measurer.health.sets == 120
    assert health_document(measurer.health, rig)["verdict"] == "ok"


# --- sessions --------------------------------------------------------------------------------------------------------


def test_every_placement_and_pose_is_a_set(demo: tuple[Session, Rig], sets: list[ObservedSet]) -> None:
    session, _ = demo
    o = session.observations
    assert o is not None
    assert [one.id for one in sets] == list(o.placements)
    assert sum(len(one.observations) for one in sets) == len(o)
    assert all(a.number + 1 == b.number for a, b in pairwise(sets))


def test_a_session_of_another_rig_is_refused(demo: tuple[Session, Rig]) -> None:
    session, rig = demo
    others = replace(rig, cameras=tuple(replace(c, id=f"X{i}") for i, c in enumerate(rig.cameras)))
    with pytest.raises(InputError, match="none of its cameras"):
        list(sets_of_session(session, others))
    larger = tuple(replace(c, image_size=(99, 99)) for c in rig.cameras)
    with pytest.raises(InputError, match="images of"):
        list(sets_of_session(session, replace(rig, cameras=larger)))


def test_the_same_sets_give_the_same_bits(demo: tuple[Session, Rig], sets: list[ObservedSet]) -> None:
    session, rig = demo
    task = Task(session.target_set, bars=session.bars)
    assert measured(sets[:6], rig, task) == measured(sets[:6], rig, task)


def test_a_set_in_which_nothing_is_seen(demo: tuple[Session, Rig], sets: list[ObservedSet]) -> None:
    session, rig = demo
    o = sets[0].observations
    empty = replace(sets[0], observations=one_set(o, np.zeros(len(o), bool)))
    found = Measurer(rig, Task(session.target_set, bars=session.bars)).measure(empty)
    assert found.points_mm.shape == (0, 3)
    assert found.missing
    alone = one_set(o, np.asarray(o.camera == 0))
    assert Measurer(rig, Task(session.target_set)).measure(replace(empty, observations=alone)).names == ()


def test_the_check_still_names_cameras(demo: tuple[Session, Rig]) -> None:
    assert check(*demo).verdict in ("ok", "watch")
