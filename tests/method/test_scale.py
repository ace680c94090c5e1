"""Millimetres: chords of arcs, what stickers and bars tell, and how sure they are."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from spherecal.adjust.covariance_factors import Covariance
from spherecal.base.arrays import BoolArray, FloatArray
from spherecal.calibrate import calibrate
from spherecal.data.observations import Features, Observations, find_features
from spherecal.data.session import Bar, BarLength, BarPose, Mark, Recording, Scale, Session
from spherecal.scale.bar_scale import scale_from_bars
from spherecal.scale.spacing import FoundScale, Located, Spacing, bend, scale_from_spacing
from spherecal.steps.settings import CalibrationSettings
from spherecal.targets.target_set import TargetSet
from tests.networks import calibrated, errors_of, one_thread, simulated

__all__ = ["one_thread"]

ARC, RADIUS = 22.0, 250.0


def chord(arc: float, radius: FloatArray) -> FloatArray:
    """The straight distance of two dots `arc` apart on the flat sticker, bent onto balls."""
    flat = np.tile([[-arc / 2, 0.0], [arc / 2, 0.0]], (len(radius), 1, 1))
    bent = bend(flat, radius)
    return np.linalg.norm(bent[:, 1] - bent[:, 0], axis=1)


@pytest.mark.parametrize("radius", [30.0, 96.0, 250.0, 1e4])
def test_chord_is_the_closed_form(radius: float) -> None:
    d = 20.0
    assert chord(d, np.array([radius]))[0] == pytest.approx(2 * radius * np.sin(d / 2 / radius), rel=1e-15)
    # the series: d (1 - d^2 / 24 R^2), the next term is d^4 / 1920 R^4
    series = d * (1 - d**2 / 24 / radius**2)
    assert chord(d, np.array([radius]))[0] == pytest.approx(series, rel=1.1 * (d / radius) ** 4 / 1920 + 1e-15)


def test_chord_without_a_ball_is_the_distance_itself() -> None:
    assert chord(20.0, np.array([np.nan, 0.0, 5.0, -250.0, np.inf])).tolist() == [20.0] * 5


def test_half_a_millimetre_in_three_metres_is_what_the_correction_is_worth() -> None:
    assert 1 - chord(ARC, np.array([RADIUS]))[0] / ARC == pytest.approx(3.2e-4, rel=0.01)


@cache
def turn_of(seed: int) -> FloatArray:
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]


def stickers(
    rng: np.random.Generator,
    n_targets: int = 40,
    n_placements: int = 3,
    arc: float = ARC,
    on_sphere: bool = True,
    print_sd: float = 0.0,
    print_scale: float = 1.0,
) -> tuple[Features, FloatArray, FloatArray]:
    """Features of stickers with two dots each on balls, their exact places (p, 3), the balls' radii (placements,)."""
    radius = RADIUS * (1 + 0.02 * np.arange(n_placements, dtype=float))
    rows = list(product(range(n_placements), range(1, n_targets + 1), (0, 1)))
    placement, target, point = np.array(rows).T
    distance = arc * print_scale + print_sd * rng.normal(size=n_targets)
    place = np.empty((len(rows), 3))
    for i, (p, t, k) in enumerate(rows):
        turn = turn_of(1000 * p + t)
        half = (k - 0.5) * distance[t - 1]
        if on_sphere:
            angle = half / radius[p]
            flat = radius[p] * np.array([np.sin(angle), 0.0, np.cos(angle)])
        else:
            flat = np.array([half, 0.0, radius[p]])
        place[i] = turn @ flat + 1000.0 * p
    return Features(placement, target, point, np.arange(len(rows))), place, radius


def by_spacing(
    spacing: Spacing, features: Features, points: FloatArray, radii: FloatArray, noise: Covariance, variance: float
) -> FoundScale | None:
    return scale_from_spacing(spacing, features, radii, Located(points, noise, variance))


def cofactors(n: int, sd: FloatArray | float = 1.0) -> Covariance:
    """A covariance of n points that is their own image noise alone: spheres of standard deviation `sd`."""
    noise = np.eye(3) * np.square(np.broadcast_to(sd, n))[:, None, None]

    class Alone:
        points, own_noise, point_of_feature = noise, noise, np.arange(n)

        @property
        def is_located(self) -> BoolArray:
            return np.isfinite(noise[:, 0, 0])

        def functional(self, gradient: FloatArray) -> float:
            return float(np.einsum("pi,pij,pj->", gradient, noise, gradient))

    return Alone()  # type: ignore[return-value]


SPACING = Spacing(0, 1, ARC, True)


@pytest.mark.parametrize("unit", [1.0, 0.0037, 812.0])
@pytest.mark.parametrize("on_sphere", [True, False])
def test_perfect_stickers_give_the_exact_scale(unit: float, on_sphere: bool) -> None:
    """Millimetres over network units to 1e-9: the correction itself, the radii in network units as well."""
    features, place, radius = stickers(np.random.default_rng(0), on_sphere=on_sphere)
    noise = cofactors(len(place), 1e-6 * unit)
    spacing = replace(SPACING, on_sphere=on_sphere)
    found = by_spacing(spacing, features, place * unit, radius * unit, noise, 1.0)
    assert found is not None
    assert found.factor == pytest.approx(1 / unit, rel=1e-9)
    assert found.count == 40
    assert found.scatter < 1e-6
    # without the correction the answer is off by that of the chord
    wrong = by_spacing(replace(SPACING, on_sphere=not on_sphere), features, place * unit, radius * unit, noise, 1.0)
    assert wrong is not None
    expected = float(np.mean(chord(ARC, radius) / ARC))
    ratio = wrong.factor / found.factor
    assert ratio == pytest.approx(1 / expected if on_sphere else expected, rel=1e-6)


def test_a_scale_that_all_stickers_share_passes_unseen() -> None:
    """A printer's common error is in the result and in no statistic: that is what its finding warns of."""
    features, place, radius = stickers(np.random.default_rng(0), print_scale=1.003)
    found = by_spacing(SPACING, features, place, radius, cofactors(len(place), 1e-4), 1.0)
    assert found is not None
    assert found.factor == pytest.approx(1 / 1.003, rel=1e-5)
    assert found.scatter < 1e-5
    assert found.relative_uncertainty < 1e-5


# Of these the scatter is known to 7 %: an uncertainty that is a third too large or too small does not pass.
TRIALS = 100


@pytest.mark.parametrize("unit", [1.0, 0.0037])
@pytest.mark.parametrize("print_sd", [0.0, 0.02, 0.1])
def test_print_scatter_is_found_and_belongs_to_the_uncertainty(print_sd: float, unit: float) -> None:
    noise_sd = 0.01
    scatters, scores = [], []
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        features, place, radius = stickers(rng, print_sd=print_sd)
        noisy = unit * (place + noise_sd * rng.normal(size=place.shape))
        cofactor = cofactors(len(place), unit)
        found = by_spacing(SPACING, features, noisy, unit * radius, cofactor, noise_sd**2)
        assert found is not None
        scatters.append(found.scatter)
        scores.append((found.factor * unit - 1) / found.relative_uncertainty)
    # DerSimonian and Laird's estimate of the variance between stickers has no bias; noise of a sticker's mean matters
    between = np.sqrt(np.mean(np.square(scatters))) * ARC
    noise_of_mean = np.sqrt(2) * noise_sd / np.sqrt(3)
    if print_sd:
        assert between == pytest.approx(print_sd, rel=0.1)
    else:
        assert between < 0.5 * noise_of_mean
    assert np.sqrt(np.mean(np.square(scores))) == pytest.approx(1.0, abs=3 / np.sqrt(2 * TRIALS))


def test_more_placements_average_noise_but_no_print() -> None:
    def uncertainty(placements: int, print_sd: float) -> float:
        rng = np.random.default_rng(1)
        features, place, radius = stickers(rng, n_placements=placements, print_sd=print_sd)
        noisy = place + 0.01 * rng.normal(size=place.shape)
        found = by_spacing(SPACING, features, noisy, radius, cofactors(len(place)), 0.01**2)
        assert found is not None
        return found.relative_uncertainty

    assert uncertainty(9, 0.0) < 0.45 * uncertainty(1, 0.0)
    assert uncertainty(9, 0.2) > 0.8 * uncertainty(1, 0.2)
    assert uncertainty(1, 0.2) == pytest.approx(0.2 / ARC / np.sqrt(40), rel=0.3)


def test_noisy_stickers_count_little() -> None:
    rng = np.random.default_rng(2)
    features, place, radius = stickers(rng)
    sd = np.where(features.target % 2 == 0, 0.001, 1.0)
    noisy = place + sd[:, None] * rng.normal(size=place.shape)
    found = by_spacing(SPACING, features, noisy, radius, cofactors(len(place), sd), 1.0)
    assert found is not None
    assert found.factor == pytest.approx(1.0, abs=5e-5)
    # 20 stickers at 3 placements count, of two dots each
    assert found.relative_uncertainty == pytest.approx(np.sqrt(2) * 0.001 / ARC / np.sqrt(60), rel=0.2)


def test_only_stickers_with_both_dots_count() -> None:
    features, place, radius = stickers(np.random.default_rng(0))
    noise = cofactors(len(place), 1e-3)
    unknown = (features.target > 10) & (features.point == 1)
    noise.points[unknown] = np.nan
    found = by_spacing(SPACING, features, place, radius, noise, 1.0)
    assert found is not None
    assert found.count == 10
    noise.points[features.point == 1] = np.nan
    assert by_spacing(SPACING, features, place, radius, noise, 1.0) is None
    assert by_spacing(Spacing(0, 7, ARC, True), features, place, radius, cofactors(len(place)), 1.0) is None


def test_one_sticker_is_enough_for_a_scale() -> None:
    features, place, radius = stickers(np.random.default_rng(0), n_targets=1, n_placements=1)
    found = by_spacing(SPACING, features, place * 2, radius * 2, cofactors(2, 1e-3), 1.0)
    assert found is not None
    assert found.factor == pytest.approx(0.5, rel=1e-9)
    assert found.scatter == 0.0
    assert np.isfinite(found.relative_uncertainty)


def bar_network(
    rng: np.random.Generator, flat_marks: bool, poses: int = 4, unit: float = 1.0
) -> tuple[Session, Observations, Features, FloatArray, FloatArray]:
    """A session with a scale bar of two marks (0 and 500 mm), its features and their exact places in network units."""
    layout = {name: rng.uniform(-12, 12, 2) for name in "ABCDE"}
    names = tuple(layout) if flat_marks else ("centre",)
    bar = Bar(
        "S",
        "scale",
        {"S1": Mark(901, "centre"), "S2": Mark(902, "centre")},
        (BarLength("S1", "S2", 500.0, 0.01, 2.0),),
        1.15e-5,
        20.0,
    )
    pose_list = tuple(BarPose(f"S-{i + 1}", "S", 20.0 + i) for i in range(poses))
    rows = list(product(range(poses), (901, 902), range(len(names))))
    placement, target, point = np.array(rows).T
    place = np.empty((len(rows), 3))
    for i, (p, t, k) in enumerate(rows):
        turn = np.linalg.qr(np.random.default_rng(p).normal(size=(3, 3)))[0]
        turn[:, 2] *= np.linalg.det(turn)
        along = (t - 901) * 500.0 * (1 + 1.15e-5 * p)  # the bar grows with its temperature
        flat = layout[names[k]] if flat_marks else np.zeros(2)
        place[i] = turn @ [along + flat[0], flat[1], 0.0] + 300.0 * p
    observations = Observations(
        tuple(p.id for p in pose_list),
        ("C1", "C2"),
        names,
        placement,
        np.zeros(len(rows), dtype=np.int64),
        target,
        point,
        np.zeros((len(rows), 2)),
    )
    base, _ = simulated("demo")
    session = replace(
        base,
        placements=(),
        bars=(bar,),
        bar_poses=pose_list,
        scale=Scale("bar", bar="S"),
        target_set=TargetSet("dots8", "light-on-dark", 28.0, 3.0, {901: layout, 902: layout}),
    )
    return session, observations, find_features(observations), place * unit, np.full(len(rows), 0.01 * unit)


def bar_scale(case: tuple[Session, Observations, Features, FloatArray, FloatArray], points: FloatArray) -> FoundScale:
    session, observations, features, _, sd = case
    found = scale_from_bars(
        Recording(session, observations, features), "S", Located(points, cofactors(len(sd), sd), 1.0)
    )
    assert found is not None
    return found


@pytest.mark.parametrize("unit", [1.0, 0.013])
@pytest.mark.parametrize("flat_marks", [False, True], ids=["marks are points", "marks are layouts"])
def test_bar_gives_the_exact_scale_at_its_temperature(flat_marks: bool, unit: float) -> None:
    case = bar_network(np.random.default_rng(0), flat_marks, unit=unit)
    found = bar_scale(case, case[3])
    assert found.factor == pytest.approx(1 / unit, rel=1e-9)
    assert found.count == 4


@pytest.mark.parametrize("flat_marks", [False, True], ids=["marks are points", "marks are layouts"])
def test_bar_scale_has_the_uncertainty_it_states(flat_marks: bool) -> None:
    rng = np.random.default_rng(0)
    case = bar_network(rng, flat_marks, poses=2)
    errors, stated = [], 0.0
    trials = 60 if flat_marks else 400  # a layout's derivatives are numerical and take their time
    for _ in range(trials):
        found = bar_scale(case, case[3] + 0.01 * rng.normal(size=case[3].shape))
        errors.append(found.factor - 1)
        stated = found.relative_uncertainty
    certificate = 0.01 / 2 / 500  # shared by all poses, not part of these trials
    assert np.std(errors) == pytest.approx(np.sqrt(stated**2 - certificate**2), rel=3 / np.sqrt(2 * trials))
    assert stated > certificate


def test_certificate_is_a_floor_that_no_number_of_poses_lowers() -> None:
    few, many = (
        bar_scale(case, case[3]) for case in (bar_network(np.random.default_rng(0), False, n) for n in (1, 40))
    )
    assert many.relative_uncertainty < few.relative_uncertainty
    assert many.relative_uncertainty > 0.01 / 2 / 500


def test_bar_that_nobody_sees_gives_no_scale() -> None:
    session, observations, features, place, sd = bar_network(np.random.default_rng(0), False)
    noise = cofactors(len(sd), sd)
    noise.points[features.target == 902] = np.nan
    assert scale_from_bars(Recording(session, observations, features), "S", Located(place, noise, 1.0)) is None
    three = bar_network(np.random.default_rng(0), True)
    noise = cofactors(len(three[4]), three[4])
    noise.points[three[2].point >= 3] = np.nan  # a layout needs four dots
    assert scale_from_bars(Recording(three[0], three[1], three[2]), "S", Located(three[3], noise, 1.0)) is None


@pytest.mark.parametrize("preset", ["rigA", "rigB"])
def test_scale_of_a_calibration_is_within_its_uncertainty(preset: str) -> None:
    calibration, session, truth = calibrated(preset, 3)
    assert calibration.rig.scale.source == "target_spacing"
    assert session.sphere_diameter_mm is not None and len(calibration.spheres) > 2
    assert all(s.radius_mm == pytest.approx(session.sphere_diameter_mm / 2, rel=0.01) for s in calibration.spheres)
    assert calibration.rig.scale.relative_uncertainty is not None
    assert abs(errors_of(calibration, truth).scale - 1) < 3.5 * calibration.rig.scale.relative_uncertainty


@pytest.mark.parametrize("marks", ["centre", "dots"])
def test_scale_of_a_calibration_by_bar(marks) -> None:
    calibration, _, truth = calibrated("rigB", 1, scale="bar", bar_poses=6, mark_points=marks, targets=60)
    assert calibration.rig.scale.source == "bar"
    u = calibration.rig.scale.relative_uncertainty
    assert u is not None and 4e-6 < u < 1e-4
    assert abs(errors_of(calibration, truth).scale - 1) < 3.5 * u
    assert all(s.radius_mm == pytest.approx(250.0, abs=0.5) for s in calibration.spheres)


def test_print_scatter_of_a_calibration() -> None:
    calibration, session, truth = calibrated("rigA", 2, print_sd_mm=0.1)
    assert session.scale is not None and session.scale.distance_mm is not None
    expected = np.sqrt(2) * 0.1 / session.scale.distance_mm
    finding = next(f for f in calibration.rig.quality.findings if f.code == "scale-uncertainty")
    stated = float(finding.message.split("scatter between stickers ")[1].split(" ppm")[0]) * 1e-6
    expected /= 1.58  # the eight dots of a sticker average their print errors
    assert stated == pytest.approx(expected, rel=0.25)
    u = calibration.rig.scale.relative_uncertainty
    assert u is not None
    assert u > 0.8 * expected / np.sqrt(200)
    assert abs(errors_of(calibration, truth).scale - 1) < 3.5 * u


def test_flat_surface_leaves_the_distance_as_it_is() -> None:
    session, _ = simulated("rigB", 3, targets=60)
    assert session.scale is not None and session.scale.distance_mm is not None
    flat = calibrate(replace(session, scale=replace(session.scale, surface="flat")), CalibrationSettings())
    arc = calibrated("rigB", 3, targets=60)[0]
    ratio = flat.spheres[0].radius_mm / arc.spheres[0].radius_mm
    d = session.scale.distance_mm
    # for the two farthest dots; the inner ones of a pattern bend less
    assert 0.5 < (ratio - 1) / (d**2 / 24 / 250**2) < 1.0
