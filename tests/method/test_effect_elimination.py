"""The elimination of all other unknowns under the columns of effects, against dense equations of all of them."""

from typing import Any

import numpy as np
import pytest

from spherecal.adjust import corrections
from spherecal.adjust.effect_elimination import EffectSystem, effects_of
from spherecal.adjust.space_strain import STRAINS, strain_columns
from spherecal.base.arrays import FloatArray
from spherecal.calibrate import calibrate
from spherecal_sim.simulate_session import simulate_session
from spherecal_sim.truth import SimulationOptions


@pytest.fixture(scope="module")
def calls() -> list[tuple[tuple[Any, ...], EffectSystem]]:
    """What a calibration eliminates: fields and turns; in the rigid form also with the ball's bending."""
    seen: list[tuple[tuple[Any, ...], EffectSystem]] = []

    def spied(*given: Any) -> EffectSystem:
        seen.append((given, effects_of(*given)))
        return seen[-1][1]

    options = SimulationOptions(targets=40, misfit_px=0.2, scale="bar", bar_poses=3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(corrections, "effects_of", spied)
        calibrate(simulate_session("demo", 1, options)[0])
    return seen


def _dense(network, adjusted, design, system, *_) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives by the effects (2n,m) and by all other unknowns (2n,u), and residuals (2n,)."""
    problem, linear = adjusted.problem, system.linear.at(slice(None))
    n, width, rows = len(problem.camera), system.linear.width, np.arange(len(problem.camera))
    effects, columns = np.zeros((n, 2, design.count)), np.zeros((n, 2, problem.layout.expanded))
    points = np.zeros((n, 2, 3 * problem.n_points))
    image = design.images(problem.camera, network.placement[adjusted.rows])
    for k in rows:
        c, p = problem.camera[k], problem.point[k]
        for field in design.fields_of[int(c)]:
            values = field.basis.at(network.measured[adjusted.rows[k : k + 1]])[0]
            effects[k][:, field.columns] = values * problem.weight[k][:, None]
        if len(design.camera_of_image):
            effects[k][:, design.n_fields + 3 * image[k] + np.arange(3)] = linear.by_camera[k][:, :3]
        columns[k][:, c * width + np.arange(width)] = linear.by_camera[k]
        points[k][:, 3 * p + np.arange(3)] = linear.by_point[k]
        if problem.n_placements:
            t = problem.placement[k]
            columns[k][:, problem.n_cameras * width + 6 * t + np.arange(6)] = linear.by_placement[k]
            if design.bending is not None:
                first = design.n_of_cameras + t * design.bending.count
                moved = np.kron(linear.by_point[k], design.bending.values[p])
                effects[k][:, first + np.arange(design.bending.count)] = moved
    free = problem.layout.column >= 0
    others = np.concatenate([columns[:, :, free], points], axis=2)
    return effects.reshape(2 * n, -1), others.reshape(2 * n, -1), linear.residual.ravel()


@pytest.mark.parametrize(("form", "bent"), [("Free", False), ("Rigid", False), ("Rigid", True)])
def test_effects_are_eliminated_as_by_dense_equations(calls, form: str, bent: bool) -> None:
    of = [(a, s) for a, s in calls if type(a[0].ball).__name__ == form and (a[2].bending is not None) == bent]
    given, system = next((a, s) for a, s in of if not a[1].problem.has_lengths)
    effects, others, residual = _dense(*given)
    scale = np.linalg.norm(others, axis=0)
    basis, size, _ = np.linalg.svd(others[:, scale > 0] / scale[scale > 0], full_matrices=False)
    basis = basis[:, size > 1e-9 * size[0]]
    left = effects - basis @ (basis.T @ effects)
    expected = left.T @ left
    root = np.sqrt(np.diag(expected)).clip(min=1e-6 * np.sqrt(np.diag(expected)).max())
    found = system.quadratic
    assert np.abs((found.matrix - expected) / root[:, None] / root).max() < 1e-6
    start = np.zeros(given[2].count) if given[4] is None else given[4]
    assert (found.gradient + found.matrix @ start - left.T @ residual) / root == pytest.approx(0.0, abs=1e-5)


def test_a_strain_in_space_is_made_of_linear_changes_of_the_shape_at_every_placement(calls) -> None:
    _, adjusted, design, *_ = next(a for a, _ in calls if a[2].bending is not None)
    rotation, points = adjusted.state.placement_rotation, adjusted.state.points
    seen = np.flatnonzero(design.bending.values.any(axis=1))  # not the marks of a bar
    in_space = np.einsum("tji,kjl,tlm,pm->tpik", rotation, STRAINS, rotation, points[seen])
    for is_stored, common in ((False, in_space.mean(axis=0)), (True, 0.0)):
        columns = strain_columns(design, rotation, is_stored)[design.n_of_cameras :]
        columns = columns.reshape(len(rotation), 3, -1, len(STRAINS))
        moved = np.einsum("ps,tisk->tpik", design.bending.values[seen], columns)
        assert np.ptp(moved - (in_space - common), axis=1).max() < 1e-9 * np.abs(in_space).max()
    unturned = strain_columns(design, rotation[:1].repeat(len(rotation), axis=0), False)
    assert np.abs(unturned).max() < 1e-9 * np.abs(columns).max()
