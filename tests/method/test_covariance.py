"""The covariance of a network, against one large matrix bordered by its constraints and against repeated trials."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from spherecal.adjust.covariance import camera_cofactors, covariance
from spherecal.adjust.covariance_factors import Covariance
from spherecal.adjust.datum import Places, datum_motions
from spherecal.adjust.least_squares import minimise
from spherecal.adjust.levenberg import Minimum, Settings
from spherecal.adjust.parameter_layout import POSE
from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray
from spherecal.diagnose.score import make_score_test
from spherecal.geometry.rotation import cross_matrix, exp_rotation, log_rotation
from spherecal.geometry.transform import fit_similarity
from tests.networks import Small, dense_equations, one_thread, small_network
from tests.reference_engine import reference_instead

__all__ = ["one_thread"]

CASES: dict[str, dict[str, object]] = {
    "own": {},
    "shared": {"intrinsics": "shared"},
    "partly": {"intrinsics": "partly", "n_cameras": 6},
    "fixed": {"intrinsics": "fixed"},
    "weights": {"sigma": True},
    "lengths": {"lengths": 4},
    "shared, lengths": {"intrinsics": "shared", "lengths": 4},
    "priors": {"priors": True, "sigma": True},
    "two cameras locked": {"locked": (0, 3)},
    "two locked, lengths": {"locked": (1, 2), "lengths": 3},
    "one camera locked": {"locked": (2,)},
    "one locked, lengths": {"locked": (2,), "lengths": 3},
}
RIGID_CASES: dict[str, dict[str, object]] = {
    "rigid": {},
    "rigid, shared": {"intrinsics": "shared"},
    "rigid, partly": {"intrinsics": "partly", "n_cameras": 6},
    "rigid, weights": {"sigma": True},
    "rigid, lengths": {"lengths": 4},
    "rigid, two cameras locked": {"locked": (0, 3)},
    "rigid, two locked, lengths": {"locked": (0, 3), "lengths": 3},
    "rigid, one locked": {"locked": (2,)},
    "rigid, one locked, lengths": {"locked": (2,), "lengths": 3},
}
CASES |= {name: {"rigid": True, **options} for name, options in RIGID_CASES.items()}


def with_world(net: Small) -> tuple[Problem, State, Places | None]:
    """A network whose placement 0, in the rigid form, is the world, as the product has it; and its features' places."""
    problem, state = net.problem, net.truth
    turn, shift = state.placement_rotation, state.placement_translation
    if not len(turn):
        return problem, state, None
    first, start = turn[0], shift[0]
    turn = turn @ first.T
    shift = shift - turn @ start
    state = replace(state, points=state.points @ first.T + start, placement_rotation=turn, placement_translation=shift)
    problem = replace(problem, ball=replace(problem.ball, free_placement=np.arange(len(turn)) > 0))
    placement, point = np.divmod(np.arange(len(turn) * problem.n_points), problem.n_points)
    return problem, state, Places(point, placement)


def places_of(state: State, places: Places | None) -> FloatArray:
    """Where the features are, (f,3)."""
    if places is None:
        return state.points
    assert state.placement_rotation is not None and state.placement_translation is not None
    turned = np.einsum("fij,fj->fi", state.placement_rotation[places.placement], state.points[places.point])
    return turned + state.placement_translation[places.placement]


@dataclass(frozen=True)
class Whole:
    """A problem, its state and by brute force the cofactors of all its unknowns.

    `expanded` (e,u) picks the unknown behind each expanded column of cameras, `by_unknown` (f,3,u) are the features'
    places by all unknowns. `open` are the cofactors (u,u) with what no observation sees held, `cofactors` those in the
    datum; `motions` (u,g) of all unknowns, `moved` (f,3,g) of the places.
    """

    problem: Problem
    state: State
    places: Places | None
    expanded: FloatArray
    by_unknown: FloatArray
    jacobian: FloatArray
    open: FloatArray
    cofactors: FloatArray
    motions: FloatArray
    moved: FloatArray

    def cameras(self) -> FloatArray:
        """Of all cameras' columns, zero where nothing is estimated."""
        return self.expanded @ self.cofactors @ self.expanded.T

    def of_places(self) -> FloatArray:
        """Of all features' places, (3f,3f)."""
        flat = self.by_unknown.reshape(-1, len(self.cofactors))
        return flat @ self.cofactors @ flat.T


def whole_by_brute_force(problem: Problem, state: State, places: Places | None) -> Whole:
    """N bordered by conditions on the features' places, and an S-transformation where a length sees the stretch."""
    dense = dense_equations(problem, state)
    jacobian = dense.jacobian.copy()
    first_pose = dense.reduced - POSE * problem.n_placements - 3 * len(problem.kept_points)
    if places is not None:
        jacobian[:, first_pose : first_pose + POSE] = 0.0  # the world's own pose is none
    by_unknown = _places_by_unknown(problem, state, places, dense.point_column, first_pose, jacobian.shape[1])
    motions, moved = _motions(problem, state, places, dense.point_column, first_pose, jacobian.shape[1])
    takes_part = np.bincount(problem.point, minlength=problem.n_points) > 0
    moved[~(takes_part if places is None else takes_part[places.point])] = 0.0
    conditions = np.einsum("fiu,fig->ug", by_unknown, moved)
    unseen = motions.shape[1] - (problem.has_lengths and motions.shape[1] > 0)
    cofactors = _bordered_inverse(jacobian, conditions[:, :unseen])
    in_datum = cofactors
    if motions.shape[1]:
        taken = np.eye(len(cofactors)) - motions @ np.linalg.inv(conditions.T @ motions) @ conditions.T
        in_datum = taken @ cofactors @ taken.T
    column = problem.layout.column[: problem.n_cameras * (POSE + len(problem.intrinsic_columns))]
    expanded = np.zeros((len(column), len(cofactors)))
    expanded[np.flatnonzero(column >= 0), column[column >= 0]] = 1.0
    return Whole(problem, state, places, expanded, by_unknown, jacobian, cofactors, in_datum, motions, moved)


def _bordered_inverse(jacobian: FloatArray, conditions: FloatArray) -> FloatArray:
    used = np.flatnonzero(np.abs(jacobian).max(axis=0) > 0)
    unit = 1 / np.linalg.norm(jacobian[:, used], axis=0)
    scaled = jacobian[:, used] * unit
    g = conditions[used] * unit[:, None]
    g = g / np.linalg.norm(g, axis=0)
    corner = np.zeros((g.shape[1], g.shape[1]))
    inverse = np.linalg.inv(np.block([[scaled.T @ scaled, g], [g.T, corner]]))[: len(used), : len(used)]
    out = np.zeros((jacobian.shape[1],) * 2)
    out[np.ix_(used, used)] = inverse * unit * unit[:, None]
    return out


def _places_by_unknown(
    problem: Problem, state: State, places: Places | None, point_column: np.ndarray, first_pose: int, unknowns: int
) -> FloatArray:
    count = problem.n_points if places is None else len(places.point)
    out = np.zeros((count, 3, unknowns))
    for f in range(count):
        p = f if places is None else int(places.point[f])
        if places is None:
            out[f, :, point_column[p] + np.arange(3)] = np.eye(3)
            continue
        turn = state.placement_rotation[places.placement[f]]
        out[f, :, point_column[p] + np.arange(3)] = turn.T  # advanced indices come first: the transpose of R
        pose = first_pose + POSE * int(places.placement[f])
        out[f, :, pose : pose + 3] = -cross_matrix((turn @ state.points[p])[None])[0]
        out[f, :, pose + 3 : pose + POSE] = np.eye(3)
        if places.placement[f] == 0:
            out[f, :, pose : pose + POSE] = 0.0
    return out


def _motions(
    problem: Problem, state: State, places: Places | None, point_column: np.ndarray, first_pose: int, unknowns: int
) -> tuple[FloatArray, FloatArray]:
    """Motions of all unknowns (u,g) and places (f,3,g) that the datum takes back, by differences."""
    locked = np.flatnonzero(~problem.free_pose)
    at = places_of(state, places)
    centre = at.mean(axis=0)
    if len(locked):
        centre = -state.rotation[locked[0]].T @ state.translation[locked[0]]
    kinds: list[tuple[FloatArray, FloatArray, float]] = []  # turn, shift, stretch
    if not len(locked):
        kinds += [(np.zeros(3), axis, 0.0) for axis in np.eye(3)] + [(axis, np.zeros(3), 0.0) for axis in np.eye(3)]
    if len(locked) < 2:
        kinds.append((np.zeros(3), np.zeros(3), 1.0))
    motions, moved = np.zeros((unknowns, len(kinds))), np.zeros((len(at), 3, len(kinds)))
    step = 1e-6
    for k, (turn, shift, stretch) in enumerate(kinds):
        ends = [similar(state, centre, s * turn, s * shift, 1 + s * stretch) for s in (-step, step)]
        moved[:, :, k] = (places_of(ends[1], places) - places_of(ends[0], places)) / (2 * step)
        points = (ends[1].points - ends[0].points) / (2 * step)
        motions[point_column[:, None] + np.arange(3), k] = points
        cameras = np.zeros((problem.n_cameras, POSE + len(problem.intrinsic_columns)))
        cameras[:, :POSE] = (_camera_steps(state, ends[1]) - _camera_steps(state, ends[0])) / (2 * step)
        column = problem.layout.column[: cameras.size]
        motions[column[column >= 0], k] = cameras.ravel()[column >= 0]
        if places is not None:
            poses = (_placement_steps(state, ends[1]) - _placement_steps(state, ends[0])) / (2 * step)
            motions[first_pose + POSE : first_pose + poses.size, k] = poses[1:].ravel()
    return motions, moved


def _camera_steps(state: State, end: State) -> FloatArray:
    """Steps (c,6) of the cameras' poses: a turn about the camera's axes and what the shift is more than turned."""
    turn = end.rotation @ state.rotation.transpose(0, 2, 1)
    return np.hstack([log_rotation(turn), end.translation - np.einsum("cij,cj->ci", turn, state.translation)])


def _placement_steps(state: State, end: State) -> FloatArray:
    """Steps (t,6) of the placements' poses: a turn about the ball's origin and the shift of it."""
    assert state.placement_rotation is not None and state.placement_translation is not None
    assert end.placement_rotation is not None and end.placement_translation is not None
    turn = end.placement_rotation @ state.placement_rotation.transpose(0, 2, 1)
    return np.hstack([log_rotation(turn), end.placement_translation - state.placement_translation])


def similar(state: State, centre: FloatArray, turn: FloatArray, shift: FloatArray, stretch: float) -> State:
    """The whole network after x' = stretch Q (x - centre) + centre + shift; all images stay as they are."""
    q = exp_rotation(turn[None])[0]

    def carried(x: FloatArray) -> FloatArray:
        return stretch * (x - centre) @ q.T + centre + shift

    rotation = state.rotation @ q.T
    translation = stretch * (state.translation + state.rotation @ centre) - rotation @ (centre + shift)
    new = replace(state, rotation=rotation, translation=translation, points=carried(state.points))
    if not len(state.placement_rotation):
        return new
    turned = q @ state.placement_rotation @ q.T
    of_centre = carried(state.placement_rotation @ centre + state.placement_translation)
    return replace(new, placement_rotation=turned, placement_translation=of_centre - turned @ (centre + shift))


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Whole, Covariance]:
    net = small_network(n_points=30, noise_px=0.0, **CASES[request.param])  # type: ignore[arg-type]
    problem, state, places = with_world(net)
    found = covariance(problem, state, places)
    assert found is not None
    return whole_by_brute_force(problem, state, places), found


def assert_matrices_agree(found: FloatArray, expected: FloatArray) -> None:
    """Equal to 1e-6 of the standard deviations."""
    sd = np.sqrt(np.maximum(expected.diagonal(), 0.0))
    assert (sd > 0).any()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * sd.max() ** 2)
    scale = np.where(sd > 0, sd, 1.0)
    np.testing.assert_allclose(found / scale / scale[:, None], expected / scale / scale[:, None], rtol=0, atol=1e-6)


def test_cameras_are_those_of_the_bordered_system(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    width = POSE + len(whole.problem.intrinsic_columns)
    expected = whole.cameras()
    for c in range(whole.problem.n_cameras):
        own = slice(c * width, (c + 1) * width)
        if whole.problem.free_pose[c] or whole.problem.free_intrinsics[c].any():
            assert_matrices_agree(found.cameras[c], expected[own, own])
        else:
            assert (found.cameras[c] == 0).all()


def test_all_cameras_have_their_correlations(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    together = found.all_cameras()
    assert_matrices_agree(together, whole.cameras())
    width = found.cameras.shape[1]
    for c, block in enumerate(found.cameras):
        own = slice(c * width, (c + 1) * width)
        np.testing.assert_array_equal(together[own, own], block)


def test_points_are_those_of_the_bordered_system(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    expected = whole.of_places()
    assert found.points.shape == (len(expected) // 3, 3, 3)
    for f, block in enumerate(found.points):
        own = slice(3 * f, 3 * f + 3)
        assert_matrices_agree(block, expected[own, own])


def _gradients(whole: Whole) -> list[FloatArray]:
    """Some that touch two features and some that touch all."""
    rng = np.random.default_rng(0)
    count = len(whole.by_unknown)
    many = rng.normal(size=(10, count, 3))
    for gradient in many[:5]:
        gradient[rng.permutation(count)[2:]] = 0.0
    return list(many)


def test_functions_of_points_have_all_correlations(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    block = whole.of_places()
    for gradient in _gradients(whole):
        flat = gradient.ravel()
        assert found.functional(gradient) == pytest.approx(flat @ block @ flat, rel=1e-6)


def test_cameras_are_correlated_with_functions_of_points(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    sd = np.sqrt(np.maximum(whole.cameras().diagonal(), 0.0))
    for gradient in _gradients(whole):
        by_unknown = np.einsum("fi,fiu->u", gradient, whole.by_unknown)
        expected = whole.expanded @ whole.cofactors @ by_unknown
        size = sd * np.sqrt(by_unknown @ whole.cofactors @ by_unknown)
        assert (np.abs(found.cameras_with(gradient) - expected) <= 1e-6 * size + 1e-9 * size.max()).all()


def test_function_of_one_coordinate_is_its_variance(case: tuple[Whole, Covariance]) -> None:
    _, found = case
    for f, axis in ((0, 0), (7, 1), (len(found.points) - 1, 2)):
        gradient = np.zeros((len(found.points), 3))
        gradient[f, axis] = 1.0
        assert found.functional(gradient) == pytest.approx(found.points[f, axis, axis], rel=1e-7)


def test_point_noise_is_the_part_of_the_images(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    images = whole.jacobian[: 2 * len(whole.problem.uv)]
    point = found.point_of_feature
    assert (point == (np.arange(30) if whole.places is None else whole.places.point)).all()
    for f in np.flatnonzero(~np.isin(point, whole.problem.kept_points))[::7]:
        by_point = whole.by_unknown[point == point[f]][0]  # a feature of this point
        own = np.flatnonzero(np.abs(by_point).max(axis=0) > 0)[-3:]  # the points' columns are the last ones
        noise = np.linalg.inv(images[:, own].T @ images[:, own])
        turn = whole.by_unknown[f][:, own]
        assert_matrices_agree(found.own_noise[f], turn @ noise @ turn.T)


def test_changes_by_residuals_of_some_rows_are_those_of_the_bordered_system(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    probe = make_score_test(whole.problem, whole.state, found, 1.0, 100)
    rows = np.flatnonzero(whole.problem.camera == 1)[::2]
    both = (2 * rows[:, None] + np.arange(2)).ravel()
    residuals = np.random.default_rng(1).normal(size=(len(both), 3))
    by_column, *by_point = found.by_scores(np.eye(len(whole.expanded)))
    force, by_points = probe.forces(rows, residuals)
    changes = force @ by_column + by_points @ by_point[0] @ by_point[1]
    expected = whole.expanded @ whole.cofactors @ (whole.jacobian[both].T @ residuals)
    sd = np.sqrt(np.maximum(whole.cameras().diagonal(), 0.0))
    assert (np.abs(changes.T - expected) <= 1e-6 * sd[:, None] + 1e-9 * sd.max()).all()
    assert np.abs(expected).max() > 0


def test_stretch_is_known_only_by_lengths(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    if not whole.problem.has_lengths or not whole.motions.shape[1]:
        assert found.stretch is None
        return
    flat = whole.moved.reshape(-1, whole.moved.shape[2])
    # the similarity that lies best under the places' displacements: its last number is the stretch
    fitted = np.linalg.lstsq(flat, whole.by_unknown.reshape(len(flat), -1), rcond=None)[0][-1]
    assert found.stretch == pytest.approx(fitted @ whole.open @ fitted, rel=1e-6)


def test_cameras_with_the_size_left_in(case: tuple[Whole, Covariance]) -> None:
    """Where lengths give the size its uncertainty stays: the datum then takes back shifts and turns alone."""
    whole, found = case
    sized = found.with_size().all_cameras()
    if found.stretch is None:
        np.testing.assert_array_equal(sized, found.all_cameras())
        return
    assert_matrices_agree(sized, whole.expanded @ whole.open @ whole.expanded.T)


def test_cameras_alone_are_the_same(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    alone = camera_cofactors(whole.problem, whole.state, whole.places)
    np.testing.assert_array_equal(alone, found.all_cameras())


@pytest.mark.parametrize("name", CASES)
def test_both_engines_give_the_same(name: str) -> None:
    problem, state, places = with_world(small_network(**CASES[name]))  # type: ignore[arg-type]
    one = covariance(problem, state, places)
    with reference_instead():
        other = covariance(problem, state, places)
    assert one is not None and other is not None
    sd = np.sqrt(np.maximum(np.einsum("cii->ci", other.cameras), 1e-300))
    np.testing.assert_allclose((one.cameras - other.cameras) / sd[:, None] / sd[:, :, None], 0.0, atol=1e-6)
    sd = np.sqrt(np.maximum(np.einsum("pii->pi", other.points), 1e-300))
    np.testing.assert_allclose((one.points - other.points) / sd[:, None] / sd[:, :, None], 0.0, atol=1e-6)


def test_datum_motions_are_similarities_that_no_observation_sees(case: tuple[Whole, Covariance]) -> None:
    whole, _ = case
    problem = whole.problem
    found = datum_motions(problem, whole.state, whole.places)
    first_turn = 3 if whole.motions.shape[1] == 7 else 0  # shifts come first, in mm; the rest is by `spread`
    unit = np.where(np.arange(whole.motions.shape[1]) < first_turn, 1.0, found.spread)
    np.testing.assert_allclose(found.places * unit, whole.moved, rtol=0, atol=1e-6)
    cameras = found.columns[: len(whole.expanded)] * unit
    used = whole.expanded.any(axis=1)
    np.testing.assert_allclose(cameras[used], (whole.expanded @ whole.motions)[used], rtol=0, atol=1e-6)
    assert found.unseen.sum() == whole.motions.shape[1] - (found.unseen.size > 0 and problem.has_lengths)
    seen = whole.jacobian[: 2 * len(problem.uv)] @ whole.motions
    size = np.linalg.norm(whole.jacobian, axis=0) @ np.abs(whole.motions)
    assert (np.abs(seen).max(axis=0, initial=0.0) < 1e-7 * size).all()


def test_covariance_of_the_points_has_the_datum_of_all_of_them() -> None:
    """Inner constraints: a shift, turn or stretch of the whole has no variance."""
    net = small_network(n_points=30)
    found = covariance(net.problem, net.truth)
    assert found is not None
    centred = net.truth.points - net.truth.points.mean(axis=0)
    typical = np.median(np.einsum("pii->p", found.points))
    for axis in np.eye(3):
        assert found.functional(np.tile(axis / 30, (30, 1))) < 1e-9 * typical
        turn = np.einsum("pij,j->pi", -cross_matrix(centred), axis)
        assert found.functional(turn / (centred**2).sum()) < 1e-9 * typical
    assert found.functional(centred / (centred**2).sum()) < 1e-9 * typical


def test_points_without_observations_have_no_covariance() -> None:
    net = small_network(n_points=30)
    problem = net.problem.select(net.problem.point != 4)
    found = covariance(problem, net.truth)
    assert found is not None
    assert np.isnan(found.points[4]).all()
    assert np.isfinite(np.delete(found.points, 4, axis=0)).all()
    whole = whole_by_brute_force(problem, net.truth, None)
    assert_matrices_agree(found.points[9], whole.of_places()[27:30, 27:30])


def test_dots_seen_by_nobody_have_no_places_at_any_placement() -> None:
    problem, state, places = with_world(small_network(n_points=30, rigid=True))
    assert places is not None
    problem = problem.select(problem.point != 4)
    state = replace(state, points=np.where(np.arange(30)[:, None] == 4, np.nan, state.points))
    found = covariance(problem, state, places)
    assert found is not None
    assert (np.isnan(found.points[:, 0, 0]) == (places.point == 4)).all()
    assert np.isfinite(found.cameras).all()


def test_a_camera_without_a_pose_leaves_the_functions_of_the_others_known() -> None:
    """One such camera made all of them NaN, and uncertainties that had to grow 3.4 to 5.9 times did not."""
    net = small_network(n_points=60, n_cameras=8)
    placed = np.arange(net.problem.n_cameras) != 1
    kept = placed[net.problem.camera]
    kept &= (np.bincount(net.problem.point, kept) >= 2)[net.problem.point]
    problem = net.problem.select(kept)
    problem = replace(
        problem, free_pose=problem.free_pose & placed, free_intrinsics=problem.free_intrinsics & placed[:, None]
    )
    state = replace(net.truth, translation=np.where(placed[:, None], net.truth.translation, np.nan))
    known = covariance(problem, net.truth)
    found = covariance(problem, state)
    assert known is not None and found is not None
    functional = np.random.default_rng(0).normal(size=(4, len(known.all_cameras())))
    functional.reshape(4, problem.n_cameras, -1)[:, 1] = 0.0
    for ours, others in zip(found.by_scores(functional), known.by_scores(functional), strict=True):
        np.testing.assert_allclose(ours, others, atol=1e-9 * np.abs(others).max())


@pytest.mark.usefixtures("either_engine")
def test_singular_networks_have_none() -> None:
    net = small_network(n_points=30)
    few = net.problem.select(net.problem.point < 3)  # nine numbers for a hundred unknowns
    assert covariance(few, net.truth) is None
    level = replace(net.truth, points=net.truth.points * [1.0, 1.0, 0.0])
    rigid = small_network(rigid=True)
    with pytest.raises(ValueError, match="rigid form"):
        covariance(rigid.problem, rigid.truth)
    weak = covariance(net.problem, level)
    assert weak is None or np.isfinite(weak.cameras).all()


TRIALS, TRIAL_PX = 200, 0.002  # so little noise that the network is linear within it


@dataclass(frozen=True)
class Trial:
    """An adjustment to new noise: what it found, and where the features' places truly were, (f,3)."""

    minimum: Minimum
    places: FloatArray


def assert_stated_is_found(problem: Problem, truth: State, places: Places | None, trials: Sequence[Trial]) -> None:
    """Errors of poses, lenses and places over their stated standard deviations have size 1, in the datum of the places.

    All together within 10 %, each number within five standard deviations of what so many trials tell; the cost is that
    of the redundancy.
    """
    found = covariance(problem, truth, places)
    assert found is not None
    sd = np.sqrt(np.einsum("cii->ci", found.cameras)) * TRIAL_PX
    places_sd = np.sqrt(np.einsum("pii->pi", found.points)) * TRIAL_PX
    back = truth.rotation.transpose(0, 2, 1)
    scores: dict[str, list[FloatArray]] = {"turn": [], "shift": [], "intrinsics": [], "places": []}
    for trial in trials:
        assert trial.minimum.converged
        state = trial.minimum.state
        at = places_of(state, places) + (state.shape_residual if len(state.shape_residual) else 0.0)
        datum = fit_similarity(at, trial.places)
        rotation = state.rotation @ datum.rotation.T
        # x_camera scales with the datum: scale x_camera = R' x' + t' in the truth's frame
        translation = datum.scale * state.translation - rotation @ datum.translation
        shift = translation - np.einsum("cij,cj->ci", rotation @ back, truth.translation)
        off = state.intrinsics - truth.intrinsics
        scores["turn"].append(log_rotation(rotation @ back) / sd[:, :3])
        scores["shift"].append(shift / sd[:, 3:6])
        scores["intrinsics"].append(off[:, problem.intrinsic_columns] / sd[:, 6:])
        scores["places"].append((datum.apply(at) - trial.places) / places_sd)
    chi2 = [2 * trial.minimum.cost / TRIAL_PX**2 for trial in trials]
    redundancy = problem.rows - problem.unknowns + 7
    assert np.mean(chi2) == pytest.approx(redundancy, abs=4 * np.sqrt(2 * redundancy / len(trials)))
    for what, values in scores.items():
        each = np.sqrt(np.mean(np.square(values), axis=0))  # of each number over the trials
        assert np.sqrt(np.mean(each**2)) == pytest.approx(1.0, abs=0.1), what
        assert np.abs(each - 1).max() < 5 / np.sqrt(2 * len(trials)), what


@pytest.mark.parametrize("rigid", [False, True], ids=["free", "rigid"])
def test_stated_uncertainties_are_those_of_repeated_trials(rigid: bool) -> None:
    """200 times new noise, the places of a rigid ball at three placements among the results."""
    net = small_network(rigid=rigid, n_points=24 if rigid else 40, noise_px=0.0)
    problem, truth, places = with_world(net)
    rng, trials = np.random.default_rng(0), []
    for _ in range(TRIALS):
        uv = net.perfect_uv + rng.normal(0, TRIAL_PX, net.perfect_uv.shape)
        trials.append(Trial(minimise(replace(problem, uv=uv), truth, Settings()), places_of(truth, places)))
    assert_stated_is_found(problem, truth, places, trials)


def test_lengths_take_the_scale_from_the_datum() -> None:
    """With lengths the size has the variance that they give it, and the datum takes it out of everything else."""
    net = small_network(n_points=30, lengths=5)
    assert net.problem.has_lengths
    centred = net.truth.points - net.truth.points.mean(axis=0)
    gradient = centred / (centred**2).sum()
    found = covariance(net.problem, net.truth)
    assert found is not None
    assert found.stretch is not None
    rows = net.problem.lengths
    at_best = 1 / (rows.length**2 / rows.covariance.diagonal()).sum()
    assert found.stretch > at_best * (1 - 1e-9)
    assert found.functional(gradient) < 1e-9 * found.stretch
    tighter = replace(net.problem, lengths=replace(rows, covariance=rows.covariance / 100))
    better = covariance(tighter, net.truth)
    assert better is not None
    assert better.stretch is not None
    assert better.stretch < found.stretch


def test_points_a_few_at_a_time_have_the_same_covariance(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, state, places = with_world(small_network())
    whole = covariance(problem, state, places)
    monkeypatch.setattr("spherecal.adjust.point_factors._MOST_PAIRS", 20)
    parts = covariance(problem, state, places)
    assert whole is not None and parts is not None
    np.testing.assert_allclose(parts.points, whole.points, rtol=1e-12)
