"""Ball profiles: a shape of the ball from one calibration used in another, from the file to the refusal."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from spherecal.adjust import engine
from spherecal.adjust.ball_model import ShapePrior, Stored, as_rigid
from spherecal.adjust.covariance import covariance
from spherecal.adjust.datum import Places
from spherecal.adjust.least_squares import minimise, normal_equations
from spherecal.adjust.levenberg import Settings
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.space_strain import STRAINS
from spherecal.ball.ball_shape import shape_cofactors
from spherecal.base.arrays import FloatArray
from spherecal.base.errors import InputError
from spherecal.calibrate import calibrate
from spherecal.data.rig import BallProfile, BallShape, Calibration, RigScale
from spherecal.data.session import Session
from spherecal.geometry.rotation import exp_rotation
from spherecal.geometry.transform import fit_similarity
from spherecal.steps.settings import CalibrationSettings
from spherecal_app.cli.main import main
from spherecal_files.ball_file import BALL, read_ball
from spherecal_files.write_result import write_result
from spherecal_sim.simulate_session import write_session
from spherecal_sim.truth import Truth
from tests.method.test_covariance import assert_matrices_agree, whole_by_brute_force, with_world
from tests.networks import codes, dense_equations, observed, one_thread, simulated, small_network

__all__ = ["one_thread"]

TARGETS = 80


def test_shape_cofactors_are_those_of_the_dots_among_themselves() -> None:
    problem, state, places = with_world(small_network(rigid=True, n_points=30, noise_px=0.0))
    found = covariance(problem, state, places)
    assert found is not None
    dots = np.arange(30)
    shape = shape_cofactors(found, state.points, dots)
    whole = whole_by_brute_force(problem, state, places)
    at_home = np.zeros((30, 3, whole.by_unknown.shape[2]))  # the dots where the world's own placement has them
    assert places is not None
    for f in range(len(places.point)):
        if places.placement[f] == 0:
            at_home[places.point[f]] = whole.by_unknown[f]
    flat = at_home.reshape(90, -1)
    x = state.points - state.points.mean(axis=0)
    turns = [np.cross(axis, x).ravel() for axis in np.eye(3)]
    strains = [(x @ strain).ravel() for strain in STRAINS]
    g = np.column_stack([np.tile(np.eye(3), (30, 1)), *turns, x.ravel(), *strains])
    free = np.eye(90) - g @ np.linalg.inv(g.T @ g) @ g.T
    expected: FloatArray = np.asarray(free @ flat @ whole.cofactors @ flat.T @ free.T, dtype=np.float64)
    for i in dots:
        own = slice(3 * i, 3 * i + 3)
        assert_matrices_agree(shape[i], expected[own, own])


def on_shape(sd_mm: float = 0.05):
    """A small network that stands on a stored shape of most dots: problem, true state, places; the world sees none."""
    net = small_network(rigid=True, n_points=24)
    problem, state = net.problem, net.truth
    turn = np.concatenate([np.eye(3)[None], state.placement_rotation])
    shift = np.concatenate([np.zeros((1, 3)), state.placement_translation])
    information = np.tile(np.eye(3) / sd_mm**2, (24, 1, 1))
    information[20:] = 0.0
    stored = state.points + sd_mm * np.random.default_rng(1).normal(size=(24, 3))
    problem = replace(
        problem,
        ball=Stored(
            problem.placement + 1,
            np.arange(4) > 0,
            shape=ShapePrior(np.where(np.arange(24)[:, None] < 20, stored, np.nan), information),
        ),
    )
    state = replace(state, placement_rotation=turn, placement_translation=shift, anchored=np.ones(24, dtype=bool))
    placement, point = np.divmod(np.arange(72), 24)
    return problem, state, Places(point, placement + 1)


def test_stored_dots_are_observations_of_the_shape() -> None:
    problem, state, _ = on_shape()
    normal = normal_equations(problem, state, engine.linear_model(problem, state, None), 0.0)
    assert isinstance(problem.ball, Stored)
    plain = replace(problem, ball=as_rigid(problem.ball))
    dense = dense_equations(plain, state)
    n, g = dense.jacobian.T @ dense.jacobian, dense.jacobian.T @ dense.residual
    for p in range(20):
        own = dense.point_column[p] + np.arange(3)
        n[np.ix_(own, own)] += problem.ball.shape.information[p]
        g[own] += problem.ball.shape.information[p] @ (state.points[p] - problem.ball.shape.places[p])
    kept = np.arange(len(n)) < dense.reduced
    first = dense.reduced - POSE * problem.n_placements
    kept[first : first + POSE] = False  # the world's own pose
    rest = np.arange(len(n)) >= dense.reduced
    carry = np.linalg.solve(n[np.ix_(rest, rest)], n[np.ix_(rest, kept)]).T
    expected = n[np.ix_(kept, kept)] - carry @ n[np.ix_(rest, kept)]
    unit = 1 / np.sqrt(normal.matrix.diagonal())
    found = (np.triu(normal.matrix) + np.triu(normal.matrix, 1).T) * unit * unit[:, None]
    np.testing.assert_allclose(found, expected * unit * unit[:, None], rtol=0, atol=1e-8)
    slope = (g[kept] - carry @ g[rest]) * unit
    np.testing.assert_allclose(normal.gradient * unit, slope, rtol=0, atol=1e-6 * np.abs(slope).max())


def test_the_shape_gives_the_size_and_the_datum_is_that_of_the_places() -> None:
    """Nothing sees shifts and turns of the whole; the covariance does not depend on the world's frame."""
    problem, state, places = on_shape()
    found = covariance(problem, state, places)
    assert found is not None
    turned = state.seen_from(2)
    np.testing.assert_allclose(turned.points, state.points)  # the shape keeps its frame
    again = covariance(problem, turned, places)
    assert again is not None
    np.testing.assert_allclose(again.cameras[:, 3, 3], found.cameras[:, 3, 3], rtol=1e-6)
    sizes = [np.linalg.norm(c.points, axis=(1, 2)) for c in (found, again)]
    np.testing.assert_allclose(sizes[0], sizes[1], rtol=1e-5)
    minimum = minimise(problem, state, Settings())
    assert minimum.converged
    alone = minimise(replace(problem, ball=as_rigid(problem.ball)), state, Settings())
    size, free = (fit_similarity(state.points, m.state.points).scale for m in (minimum, alone))
    assert abs(size - 1) < 2e-4
    assert abs(free - 1) >= 0.0
    weaker = covariance(*with_world(small_network(rigid=True, n_points=24))[:2], _of_world())
    assert weaker is not None
    assert np.median(found.cameras[:, 6, 6] / weaker.cameras[:, 6, 6]) < 0.8  # focal lengths are surer


def _of_world() -> Places:
    placement, point = np.divmod(np.arange(72), 24)
    return Places(point, placement)


@dataclass(frozen=True)
class Story:
    session: Session
    truth: Truth
    calibration: Calibration
    profile: BallProfile
    later: Session


@pytest.fixture(scope="module")
def story() -> Story:
    """A calibration with four placements, its ball's profile, and a later session with two of them, newly observed.

    The profile's size counts as a bar's, which goes before the later session's printed distances.
    """
    session, truth = simulated("demo", 1, targets=TARGETS)
    calibration = calibrate(session)
    assert calibration.ball is not None
    relative = calibration.ball.scale.relative_uncertainty
    calibration = replace(calibration, ball=replace(calibration.ball, scale=RigScale("bar", relative)))
    assert calibration.ball is not None
    return Story(session, truth, calibration, BallProfile(calibration.ball), two_placements(session, truth, 7))


def two_placements(session: Session, truth: Truth, seed: int) -> Session:
    o = observed(session)
    uv = truth.uv_true_px + 0.04 * np.random.default_rng(seed).normal(size=truth.uv_true_px.shape)
    kept = replace(o, uv=uv).select(np.isin(o.placement, (2, 3)))
    kept = replace(kept, placement=kept.placement - 2, placements=o.placements[2:4])
    return replace(session, observations=kept, placements=session.placements[2:4], bar_poses=(), bars=())


def test_the_shape_is_the_balls_and_as_sure_as_it_says(story: Story) -> None:
    ball, truth = story.profile.shape, story.truth.ball
    at = {(int(t), truth.points[p]): xyz for t, p, xyz in zip(truth.dot_target, truth.dot_point, truth.dots_mm)}  # noqa: B905
    true = np.array([at[int(t), name] for t, name in zip(ball.target, ball.point, strict=True)])
    motion = fit_similarity(ball.places_mm, true)
    error = (motion.apply(ball.places_mm) - true) @ motion.rotation
    score = np.einsum("di,dij,dj->d", error, np.linalg.inv(ball.covariance_mm2), error)
    assert score.mean() == pytest.approx(3.0, rel=0.2)
    assert ball.scale.relative_uncertainty is not None
    assert abs(motion.scale - 1) < 4 * ball.scale.relative_uncertainty
    np.testing.assert_allclose(np.linalg.norm(ball.places_mm, axis=1), 250.0, atol=3.0)  # centred in the ball


def test_two_placements_on_a_known_ball_are_as_good_as_four(story: Story) -> None:
    plain = calibrate(story.later)
    known = calibrate(story.later, CalibrationSettings(ball=story.profile))
    assert known.rig.form is not None and known.rig.form.name == "rigid"
    assert "ball profile" in known.rig.form.reason
    assert not {"ball-profile-refused", "ball-profile-scale"} & codes(known)
    assert known.rig.scale.source == "ball"
    assert known.rig.quality.sigma0 == pytest.approx(0.04, rel=0.1)
    gain = [
        a.sigma.intrinsics[0] / b.sigma.intrinsics[0]
        for a, b in zip(known.rig.cameras, plain.rig.cameras, strict=True)
        if a.sigma is not None and b.sigma is not None
    ]
    assert np.median(gain) < 0.7
    true = {camera.id: camera for camera in story.truth.cameras}
    score = [
        (c.intrinsics[0] - true[c.id].intrinsics[0]) / c.sigma.intrinsics[0]
        for c in known.rig.cameras
        if c.sigma is not None
    ]
    assert 0.3 < np.sqrt(np.mean(np.square(score))) < 2.0
    assert known.ball is None  # a shape that stands on another is none to be stored


def test_a_stored_shape_may_be_strained_where_it_is_used(story: Story) -> None:
    strained = replace(story.profile.shape, places_mm=story.profile.shape.places_mm @ (np.eye(3) + 1e-4 * STRAINS[1]))
    plain = calibrate(story.later, CalibrationSettings(ball=story.profile))
    found = calibrate(story.later, CalibrationSettings(ball=BallProfile(strained)))
    off = [
        (a.intrinsics[0] - b.intrinsics[0]) / a.sigma.intrinsics[0]
        for a, b in zip(found.rig.cameras, plain.rig.cameras, strict=True)
        if a.sigma is not None
    ]
    assert 0.1 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_a_ball_that_has_changed_is_told_and_its_profile_not_used(story: Story) -> None:
    session, truth = simulated("demo", 1, targets=TARGETS, shape_change_mm=0.1)
    bent = two_placements(session, truth, 7)
    found = calibrate(bent, CalibrationSettings(ball=story.profile))
    assert "ball-profile-refused" in codes(found)
    said = next(f for f in found.rig.quality.findings if f.code == "ball-profile-refused")
    assert "the ball has changed" in said.message
    without = calibrate(bent)
    for one, other in zip(found.rig.cameras, without.rig.cameras, strict=True):
        np.testing.assert_array_equal(one.intrinsics, other.intrinsics)


def test_another_ball_is_told(story: Story) -> None:
    rng = np.random.default_rng(0)
    shape = story.profile.shape
    numbers = rng.permutation(np.unique(shape.target))  # the same numbers on other places of the ball
    renamed = numbers[np.searchsorted(np.unique(shape.target), shape.target)]
    other = replace(story.profile, shape=replace(shape, target=renamed))
    found = calibrate(story.later, CalibrationSettings(ball=other))
    said = next(f for f in found.rig.quality.findings if f.code == "ball-profile-refused")
    assert "another ball" in said.message
    foreign = replace(story.profile, shape=replace(shape, target=shape.target + 5000))
    assert "ball-profile-refused" in codes(calibrate(story.later, CalibrationSettings(ball=foreign)))


def test_the_surer_scale_is_taken_and_a_conflict_is_told(story: Story) -> None:
    for uncertainty, source in ((1e-2, "target_spacing"), (1e-6, "ball")):
        alike = replace(story.profile.shape, scale=RigScale("target_spacing", uncertainty))
        found = calibrate(story.later, CalibrationSettings(ball=replace(story.profile, shape=alike)))
        assert found.rig.scale.source == source
    shape = story.profile.shape
    longer = replace(shape, places_mm=shape.places_mm * 1.02, covariance_mm2=shape.covariance_mm2 * 1.02**2)
    found = calibrate(story.later, CalibrationSettings(ball=replace(story.profile, shape=longer)))
    assert "ball-profile-scale" in codes(found)


def test_other_methods_and_targets_are_refused(story: Story) -> None:
    with pytest.raises(InputError, match="cannot be used with --method free"):
        calibrate(story.later, CalibrationSettings(method="free", ball=story.profile))
    assert story.later.target_set is not None
    bigger = replace(story.profile, family=story.later.target_set.family, target_size_mm=40.0)
    with pytest.raises(InputError, match="of 40 mm"):
        calibrate(story.later, CalibrationSettings(ball=bigger))


def test_what_is_written_is_read_back(story: Story, tmp_path: Path) -> None:
    path = tmp_path / "ball.json"
    path.write_bytes(BALL.bytes(replace(story.profile, name="B500 no. 1", family="dots8", target_size_mm=28.0)))
    again = read_ball(path)
    assert (again.name, again.family, again.target_size_mm) == ("B500 no. 1", "dots8", 28.0)
    shape = story.profile.shape
    np.testing.assert_array_equal(again.shape.target, shape.target)
    assert again.shape.point == shape.point
    np.testing.assert_array_equal(again.shape.places_mm, shape.places_mm)
    np.testing.assert_array_equal(
        again.shape.covariance_mm2, np.triu(shape.covariance_mm2) + np.triu(shape.covariance_mm2, 1).transpose(0, 2, 1)
    )
    assert BALL.bytes(again) == path.read_bytes()


def small_file(tmp_path: Path, change: Callable[[dict], None]) -> Path:
    rng = np.random.default_rng(0)
    n = 20
    shape = BallShape(
        np.arange(n),
        ("A",) * n,
        rng.normal(size=(n, 3)) * 100,
        np.tile(np.eye(3) * 1e-4, (n, 1, 1)),
        RigScale("bar", 1e-5),
    )
    document = json.loads(BALL.bytes(BallProfile(shape)))
    change(document)
    path = tmp_path / "ball.json"
    path.write_text(json.dumps(document))
    return path


HOSTILE: dict[str, tuple[Callable[[dict], object], str]] = {
    "another file": (lambda d: d.update(format="spherecal/rig"), "is not a"),
    "from the future": (lambda d: d.update(version=2), "later version"),
    "few dots": (lambda d: d.update(dots=d["dots"][:5]), "at least 12"),
    "twice the same dot": (lambda d: d["dots"][1].update(target=0), "same dot"),
    "all in one place": (lambda d: [dot.update(xyz_mm=[1, 2, 3]) for dot in d["dots"]], "dots are on one line"),
    "perfect": (lambda d: d["dots"][0].update(covariance_mm2=[0] * 6), "dots[0].covariance_mm2"),
    "impossible": (lambda d: d["dots"][3].update(covariance_mm2=[1e-4, 1, 0, 1e-4, 0, 1e-4]), "dots[3]"),
    "huge": (lambda d: d["dots"][3].update(covariance_mm2=[1e308, 1e308, 0, 1e308, 0, 1e308]), "dots[3]"),
    "a text as place": (lambda d: d["dots"][2].update(xyz_mm=["a", 0, 0]), "must be a number"),
    "no date": (lambda d: d.update(calibrated="yesterday"), "calibrated must be a date"),
    "no scale": (lambda d: d["scale"].update(source="none"), "scale.source"),
    "unsure": (lambda d: d["scale"].update(relative_uncertainty=-1), "relative_uncertainty"),
    "misspelt": (lambda d: d.update(calibratd="2026-01-01", calibrated=None), "calibrated"),
    "dots no list": (lambda d: d.update(dots={}), "must be a list"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_with_their_place(name: str, tmp_path: Path) -> None:
    change, words = HOSTILE[name]
    path = small_file(tmp_path, change)  # type: ignore[arg-type]
    with pytest.raises(InputError) as refused:
        read_ball(path)
    assert words in str(refused.value)
    assert "ball.json" in str(refused.value)


def test_a_whole_story_on_the_command_line(story: Story, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result, profile, folder = tmp_path / "result", tmp_path / "ball.json", tmp_path / "later"
    write_result(story.calibration, result)
    write_session(story.session, story.truth, tmp_path / "first")
    arguments = ["ball", "export", result, "-o", profile, "--name", "B1", "--date", "2026-03-01"]
    assert main([str(a) for a in [*arguments, "--session", tmp_path / "first"]]) == 0
    assert "B1: " in capsys.readouterr().out
    assert main(["ball", "show", str(profile)]) == 0
    assert "calibrated on 2026-03-01" in capsys.readouterr().out
    write_session(story.later, story.truth, folder)
    done = ["calibrate", str(folder), "--ball", str(profile), "-o", str(tmp_path / "again"), "--json"]
    assert main(done) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["form"]["name"] == "rigid"
    assert "ball profile B1 of 2026-03-01" in summary["form"]["reason"]
    assert summary["scale"]["source"] == "ball"
    assert json.loads((tmp_path / "again" / "rig.json").read_text())["form"]["name"] == "rigid"
    assert main(["ball", "export", str(tmp_path / "again"), "-o", str(profile)]) == 2
    assert "has no shape of a ball" in capsys.readouterr().err
    assert main([*done[:2], "--ball", str(tmp_path / "none.json"), *done[4:]]) == 2
    assert "there is no such file" in capsys.readouterr().err
    assert main([*done, "--method", "free"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_turned_world_leaves_the_shape(story: Story) -> None:
    """The profile's frame is its own: turned and shifted it gives the same calibration."""
    shape = story.profile.shape
    turn = exp_rotation(np.array([[0.3, -1.0, 0.5]]))[0]
    moved = replace(
        shape, places_mm=shape.places_mm @ turn.T + 50.0, covariance_mm2=turn @ shape.covariance_mm2 @ turn.T
    )
    one, other = (calibrate(story.later, CalibrationSettings(ball=BallProfile(s))).rig.cameras for s in (shape, moved))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a.intrinsics[:4], b.intrinsics[:4], atol=1e-4)
        np.testing.assert_allclose(a.translation_mm, b.translation_mm, atol=1e-4)
