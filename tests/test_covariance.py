"""The covariance of a network, against one large matrix bordered by its constraints and against repeated trials."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from spherecal.adjust.covariance import Covariance, covariance, datum_motions
from spherecal.adjust.levenberg import Engine, Settings, minimise
from spherecal.adjust.problem import POSE, LengthRows, Problem, State
from spherecal.arrays import FloatArray
from spherecal.geometry.rotation import cross_matrix, log_rotation
from spherecal.geometry.transform import fit_similarity
from tests.networks import Dense, dense_equations, one_thread, small_network

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


@dataclass(frozen=True)
class Whole:
    """A problem, its state, the dense equations and the cofactors of all unknowns by brute force."""

    problem: Problem
    state: State
    dense: Dense
    cofactors: FloatArray

    def camera(self, c: int) -> FloatArray:
        """The block of one camera in the problem's columns, zero where nothing is estimated."""
        problem, layout = self.problem, self.problem.layout
        width = POSE + len(problem.intrinsic_columns)
        columns = layout.column[layout.block_offset[c] : layout.block_offset[c] + width]
        padded = np.zeros((len(self.cofactors) + 1, len(self.cofactors) + 1))
        padded[:-1, :-1] = self.cofactors
        return padded[np.ix_(columns, columns)]

    def points(self) -> FloatArray:
        """Columns of all points in their order, (3p,)."""
        return (self.dense.point_column[:, None] + np.arange(3)).ravel()


def bordered(problem: Problem, state: State) -> Whole:
    """N bordered by the inner constraints on the points; without constraints where the network is held."""
    dense = dense_equations(problem, state)
    jacobian = dense.jacobian
    takes_part = np.bincount(problem.point, minlength=problem.n_points) > 0
    locked = int((~problem.free_pose).sum())
    centroid = state.points[takes_part].mean(axis=0)
    motions: list[FloatArray] = []
    if locked == 0:
        motions += [np.tile(axis, (problem.n_points, 1)) for axis in np.eye(3)]
        motions += [np.cross(axis, state.points - centroid) for axis in np.eye(3)]
    if problem.lengths is None and locked < 2:
        centre = centroid
        if locked:  # only a stretch about the locked camera keeps all views
            c = int(np.flatnonzero(~problem.free_pose)[0])
            centre = -state.rotation[c].T @ state.translation[c]
        motions.append(state.points - centre)
    used = np.flatnonzero(np.abs(jacobian).max(axis=0) > 0)
    border = np.zeros((jacobian.shape[1], len(motions)))
    for k, motion in enumerate(motions):
        border[(dense.point_column[:, None] + np.arange(3)).ravel(), k] = motion.ravel()
    unit = 1 / np.linalg.norm(jacobian[:, used], axis=0)
    scaled = jacobian[:, used] * unit
    g = border[used] * unit[:, None]
    g = g / np.linalg.norm(g, axis=0)
    top = np.hstack([scaled.T @ scaled, g])
    bottom = np.hstack([g.T, np.zeros((len(motions), len(motions)))])
    inverse = np.linalg.inv(np.vstack([top, bottom]))[: len(used), : len(used)] * unit * unit[:, None]
    cofactors = np.zeros((jacobian.shape[1],) * 2)
    cofactors[np.ix_(used, used)] = inverse
    return Whole(problem, state, dense, cofactors)


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[Whole, Covariance]:
    net = small_network(n_points=30, noise_px=0.0, **CASES[request.param])  # type: ignore[arg-type]
    found = covariance(net.problem, net.truth, "numpy")
    assert found is not None
    return bordered(net.problem, net.truth), found


def assert_matrices_agree(found: FloatArray, expected: FloatArray) -> None:
    """Equal to 1e-6 of the standard deviations."""
    sd = np.sqrt(np.maximum(expected.diagonal(), 0.0))
    assert (sd > 0).any()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * sd.max() ** 2)
    scale = np.where(sd > 0, sd, 1.0)
    np.testing.assert_allclose(found / scale / scale[:, None], expected / scale / scale[:, None], rtol=0, atol=1e-6)


def test_cameras_are_those_of_the_bordered_system(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    for c in range(whole.problem.n_cameras):
        if whole.problem.free_pose[c] or whole.problem.free_intrinsics[c].any():
            assert_matrices_agree(found.cameras[c], whole.camera(c))
        else:
            assert (found.cameras[c] == 0).all()


def test_points_are_those_of_the_bordered_system(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    for p in range(whole.problem.n_points):
        own = whole.dense.point_column[p] + np.arange(3)
        assert_matrices_agree(found.points[p], whole.cofactors[np.ix_(own, own)])


def test_functions_of_points_have_all_correlations(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    rng = np.random.default_rng(0)
    columns = whole.points()
    block = whole.cofactors[np.ix_(columns, columns)]
    for few in (True, False):
        for _ in range(5):
            gradient = rng.normal(size=(whole.problem.n_points, 3))
            if few:
                gradient[rng.permutation(whole.problem.n_points)[2:]] = 0.0
            flat = gradient.ravel()
            assert found.functional(gradient) == pytest.approx(flat @ block @ flat, rel=1e-6)


def test_function_of_one_coordinate_is_its_variance(case: tuple[Whole, Covariance]) -> None:
    _, found = case
    for p, axis in ((0, 0), (7, 1), (29, 2)):
        gradient = np.zeros((30, 3))
        gradient[p, axis] = 1.0
        assert found.functional(gradient) == pytest.approx(found.points[p, axis, axis], rel=1e-7)


def test_point_noise_is_the_part_of_the_images(case: tuple[Whole, Covariance]) -> None:
    whole, found = case
    n = whole.dense.jacobian[: 2 * len(whole.problem.uv)]
    for p in np.setdiff1d(np.arange(30), whole.problem.kept_points)[:5]:
        own = whole.dense.point_column[p] + np.arange(3)
        assert_matrices_agree(found.point_noise[p], np.linalg.inv(n[:, own].T @ n[:, own]))


@pytest.mark.parametrize("name", CASES)
def test_both_engines_give_the_same(name: str) -> None:
    net = small_network(**CASES[name])  # type: ignore[arg-type]
    one, other = (covariance(net.problem, net.truth, engine) for engine in ("numba", "numpy"))
    assert one is not None and other is not None
    sd = np.sqrt(np.maximum(np.einsum("cii->ci", other.cameras), 1e-300))
    np.testing.assert_allclose((one.cameras - other.cameras) / sd[:, None] / sd[:, :, None], 0.0, atol=1e-6)
    np.testing.assert_allclose(one.points, other.points, rtol=1e-6, atol=1e-9 * np.abs(other.points).max())


def test_datum_motions_are_seen_by_no_observation() -> None:
    for name, options in CASES.items():
        net = small_network(**options)  # type: ignore[arg-type]
        if name == "priors":
            continue
        cameras, points = datum_motions(net.problem, net.truth)
        dense = dense_equations(net.problem, net.truth)
        motions = np.zeros((dense.jacobian.shape[1], points.shape[2]))
        column = net.problem.layout.column
        motions[column[column >= 0]] = cameras[column >= 0]
        motions[dense.point_column[:, None] + np.arange(3)] = points
        seen = dense.jacobian @ motions
        size = np.linalg.norm(dense.jacobian, axis=0) @ np.abs(motions)
        assert (np.abs(seen).max(axis=0, initial=0.0) < 1e-10 * size).all(), name


def test_covariance_of_the_points_has_the_datum_of_all_of_them() -> None:
    """Inner constraints: a shift, turn or stretch of the whole has no variance."""
    net = small_network(n_points=30)
    found = covariance(net.problem, net.truth, "numba")
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
    found = covariance(problem, net.truth, "numba")
    assert found is not None
    assert np.isnan(found.points[4]).all()
    assert np.isfinite(np.delete(found.points, 4, axis=0)).all()
    whole = bordered(problem, net.truth)
    own = whole.dense.point_column[9] + np.arange(3)
    assert_matrices_agree(found.points[9], whole.cofactors[np.ix_(own, own)])


@pytest.mark.parametrize("engine", ["numpy", "numba"])
def test_singular_networks_have_none(engine: Engine) -> None:
    net = small_network(n_points=30)
    few = net.problem.select(net.problem.point < 3)  # nine numbers for a hundred unknowns
    assert covariance(few, net.truth, engine) is None
    level = replace(net.truth, points=net.truth.points * [1.0, 1.0, 0.0])
    rigid = small_network(rigid=True)
    with pytest.raises(ValueError, match="rigid form"):
        covariance(rigid.problem, rigid.truth, engine)
    weak = covariance(net.problem, level, engine)
    assert weak is None or np.isfinite(weak.cameras).all()


def test_stated_uncertainties_are_those_of_repeated_trials() -> None:
    """200 times new noise: errors over stated standard deviations, in the datum of the points, have size 1."""
    sigma = 0.002
    net = small_network(n_points=40, noise_px=0.0, lengths=0)
    found = covariance(net.problem, net.truth, "numba")
    assert found is not None
    rng = np.random.default_rng(0)
    scores: dict[str, list[FloatArray]] = {"turn": [], "shift": [], "intrinsics": [], "points": []}
    sd = np.sqrt(np.einsum("cii->ci", found.cameras)) * sigma
    points_sd = np.sqrt(np.einsum("pii->pi", found.points)) * sigma
    chi2 = []
    for _ in range(200):
        uv = net.perfect_uv + rng.normal(0, sigma, net.perfect_uv.shape)
        minimum = minimise(replace(net.problem, uv=uv), net.truth, Settings())
        assert minimum.converged
        state = minimum.state
        datum = fit_similarity(state.points, net.truth.points)
        rotation = state.rotation @ datum.rotation.T
        # x_camera scales with the datum: scale x_camera = R' x' + t' in the truth's frame
        translation = datum.scale * state.translation - rotation @ datum.translation
        turn = log_rotation(rotation @ net.truth.rotation.transpose(0, 2, 1))
        shift = translation - np.einsum(
            "cij,cj->ci", rotation @ net.truth.rotation.transpose(0, 2, 1), net.truth.translation
        )
        scores["turn"].append(turn / sd[:, :3])
        scores["shift"].append(shift / sd[:, 3:6])
        scores["intrinsics"].append(
            (state.intrinsics - net.truth.intrinsics)[:, net.problem.intrinsic_columns] / sd[:, 6:]
        )
        scores["points"].append((datum.apply(state.points) - net.truth.points) / points_sd)
        chi2.append(2 * minimum.cost / sigma**2)
    redundancy = net.problem.rows - net.problem.unknowns + 7
    assert np.mean(chi2) == pytest.approx(redundancy, abs=4 * np.sqrt(2 * redundancy / 200))
    for what, values in scores.items():
        each = np.sqrt(np.mean(np.square(values), axis=0))  # of each number over the trials
        assert np.sqrt(np.mean(each**2)) == pytest.approx(1.0, abs=0.1), what
        assert np.abs(each - 1).max() < 5 / np.sqrt(2 * 200), what


def test_lengths_take_the_scale_from_the_datum() -> None:
    """With lengths the size has the variance that they give it, and the datum takes it out of everything else."""
    net = small_network(n_points=30, lengths=5)
    assert net.problem.lengths is not None
    centred = net.truth.points - net.truth.points.mean(axis=0)
    gradient = centred / (centred**2).sum()
    found = covariance(net.problem, net.truth, "numba")
    assert found is not None
    assert found.stretch is not None
    rows = net.problem.lengths
    at_best = 1 / (rows.length**2 / rows.covariance.diagonal()).sum()
    assert found.stretch > at_best * (1 - 1e-9)
    assert found.functional(gradient) < 1e-9 * found.stretch
    tighter = replace(net.problem, lengths=replace(rows, covariance=rows.covariance / 100))
    better = covariance(tighter, net.truth, "numba")
    assert better is not None
    assert better.stretch is not None
    assert better.stretch < found.stretch
