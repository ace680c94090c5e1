"""docs/conventions.md in numbers."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from spherecal.adjust import engine
from spherecal.adjust.network import free_network
from spherecal.adjust.problem import moved
from spherecal.data.rig import RigCamera
from spherecal.geometry.camera import (
    FISHEYE_MARK,
    FISHEYE_NAMES,
    INTRINSIC_NAMES,
    PRESETS,
    camera_matrix,
    estimated_mask,
    intrinsics_vector,
    project,
)
from spherecal.geometry.rotation import exp_rotation
from spherecal.targets.family import make_target_set
from spherecal_files.read_session import read_session
from spherecal_sim.observe import look
from spherecal_sim.simulated_ball import make_ball
from tests.example_session import OBSERVATIONS, make_session
from tests.networks import calibrated, observed, simulated, small_network

PAGE = (ROOT / "docs" / "conventions.md").read_text(encoding="utf-8")


def test_centred_principal_point_is_that_of_pixel_centres(tmp_path: Path) -> None:
    session = read_session(make_session(tmp_path))
    assert session.cameras[1].prior[2:4] == pytest.approx([(2064 - 1) / 2, (1544 - 1) / 2])


@pytest.mark.parametrize(("u", "v"), [(-0.5, -0.5), (2063.5, 1543.5), (0, 1543)])
def test_image_spans_half_a_pixel_more_than_the_pixel_centres(tmp_path: Path, u: float, v: float) -> None:
    lines = [*OBSERVATIONS[:1], f"P1,C01,1,A,{u},{v},0.04,0.04"]
    assert observed(read_session(make_session(tmp_path, lines=lines))).uv.tolist() == [[u, v]]


def test_camera_axes_are_right_down_forward() -> None:
    c = intrinsics_vector(np.array([[1000.0, 0, 500], [0, 1100, 400], [0, 0, 1]]), [])
    uv = project(np.array([[0, 0, 2.0], [1, 0, 2.0], [0, 1, 2.0], [0, 0, 7.0]]), c)
    np.testing.assert_allclose(uv, [[500, 400], [1000, 400], [500, 950], [500, 400]])
    np.testing.assert_allclose(camera_matrix(c), [[1000, 0, 500], [0, 1100, 400], [0, 0, 1]])


def test_pose_maps_world_to_camera_and_centre_follows() -> None:
    rotation, centre = exp_rotation(np.array([0.3, -1.2, 0.5])), np.array([10.0, 20.0, -30.0])
    camera = RigCamera("C", None, (10, 10), np.zeros(16), rotation, -rotation @ centre, None, 0, None)
    np.testing.assert_allclose(camera.centre_mm, centre, atol=1e-12)
    np.testing.assert_allclose(rotation @ centre + camera.translation_mm, 0.0, atol=1e-12)
    # the columns of R are the world's axes seen by the camera: a point ahead of the camera has z > 0 there
    ahead = centre + 5.0 * rotation[2]
    np.testing.assert_allclose(rotation @ ahead + camera.translation_mm, [0, 0, 5.0], atol=1e-12)


def test_simulated_cameras_keep_to_it() -> None:
    session, truth = simulated("demo", sigma_px=0.0)
    o = observed(session)
    view = look(truth.cameras)
    rows = np.flatnonzero(o.placement == 0)[::97]
    dot = {
        (int(t), truth.ball.points[p]): i
        for i, (t, p) in enumerate(zip(truth.ball.dot_target, truth.ball.dot_point, strict=True))
    }
    x = np.array([truth.points_mm(0)[dot[int(o.target[r]), o.points[o.point[r]]]] for r in rows])
    x_camera = np.einsum("nij,nj->ni", view.rotations[o.camera[rows]], x) + view.translations[o.camera[rows]]
    np.testing.assert_allclose(project(x_camera, view.intrinsics[o.camera[rows]]), o.uv[rows], atol=1e-9)
    assert (o.uv > -0.5).all()
    assert (o.uv < np.array([c.image_size for c in session.cameras])[o.camera] - 0.5).all()


def test_world_is_the_reference_camera() -> None:
    rig = calibrated("demo")[0].rig
    assert rig.reference_camera is not None
    reference = rig.camera(rig.reference_camera)
    assert reference is not None
    np.testing.assert_allclose(reference.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(reference.translation_mm, 0.0, atol=1e-9)


def test_residual_is_predicted_minus_observed() -> None:
    net = small_network(noise_px=0.0)
    shift = np.zeros_like(net.problem.uv)
    shift[3] = [2.0, -5.0]
    problem = replace(net.problem, uv=net.problem.uv + shift)
    np.testing.assert_allclose(engine.residuals(problem, net.truth), -shift, atol=1e-9)
    np.testing.assert_allclose(engine.linearise(problem, net.truth, None).residual, -shift, atol=1e-9)


def test_residuals_of_a_result_are_predicted_minus_observed() -> None:
    calibration = calibrated("demo")[0]
    rows = np.flatnonzero(calibration.used)[::211]
    o = calibration.observations
    for i in rows:
        camera = calibration.rig.camera(o.cameras[o.camera[i]])
        assert camera is not None
        x = calibration.points_mm[calibration.features.of_observation[i]]
        predicted = project((camera.rotation @ x + camera.translation_mm)[None], camera.intrinsics)[0]
        np.testing.assert_allclose(calibration.residuals_px[i], predicted - o.uv[i], atol=1e-6)


def test_weights_are_one_over_sigma_squared_and_one_pixel_where_none_is_given() -> None:
    plain, weighted = small_network(), small_network(sigma=True)
    assert (plain.problem.weight == 1.0).all()
    state = weighted.truth
    raw = engine.residuals(replace(weighted.problem, weight=np.ones_like(weighted.problem.uv)), state)
    w = weighted.problem.weight
    np.testing.assert_allclose(engine.residuals(weighted.problem, state) ** 2, raw**2 * w**2)
    # `weight` holds 1/sigma, the square root of P
    network = free_network(
        np.array([0, 0]), np.array([0, 1]), np.zeros((2, 2)), 1, np.zeros((2, 16), dtype=bool), np.array([0, 1])
    ).with_sigma(np.full((2, 2), 0.04))
    every, placed = np.ones(2, dtype=bool), np.ones(2, dtype=bool)
    assert network.problem(every, network.free, placed, weighted=True)[0].weight == pytest.approx(1 / 0.04)
    assert network.problem(every, network.free, placed, weighted=False)[0].weight == pytest.approx(1.0)


def test_target_plane_is_right_down_and_into_the_ball() -> None:
    targets = make_target_set(3)
    ball = make_ball(targets, (1, 2, 3), np.random.default_rng(0), bump_mm=0.0)
    for s in range(3):
        x, y = ball.frames[s, 0], ball.frames[s, 1]
        middle = ball.dots_mm[8 * s : 8 * s + 8].mean(axis=0)
        assert np.cross(x, y) @ middle < -0.9 * np.linalg.norm(middle)
    session, _ = simulated("demo", sigma_px=0.0)
    assert session.target_set is not None
    o = observed(session)
    key = (o.placement * len(o.cameras) + o.camera) * 1000 + o.target
    for image in np.unique(key)[::29]:
        rows = np.flatnonzero(key == image)
        if len(rows) < 8:
            continue
        layout = session.target_set.layouts[int(o.target[rows[0]])]
        flat = np.array([layout[o.points[p]] for p in o.point[rows]])
        affine = np.linalg.lstsq(np.column_stack([flat, np.ones(8)]), o.uv[rows], rcond=None)[0][:2]
        assert np.linalg.det(affine) > 0  # seen as printed, not mirrored


def test_lens_model_is_the_one_written_down() -> None:
    rng = np.random.default_rng(1)
    c = np.r_[1500.0, 1400.0, 640.0, 512.0, rng.normal(0, 0.1, 12)]
    fu, fv, u0, v0, k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = c
    X, Y, Z = rng.uniform(-1, 1, 20), rng.uniform(-1, 1, 20), rng.uniform(2, 3, 20)
    x, y = X / Z, Y / Z
    r2 = x**2 + y**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2) + s1 * r2 + s2 * r2**2
    yd = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y + s3 * r2 + s4 * r2**2
    expected = np.column_stack([fu * xd + u0, fv * yd + v0])
    np.testing.assert_allclose(project(np.column_stack([X, Y, Z]), c), expected, atol=1e-9)


def test_order_of_the_intrinsics_and_the_presets_are_those_of_the_page() -> None:
    order = re.search(r"^ +(fu fv u0 v0 \|.*)$", PAGE, re.MULTILINE)
    assert order is not None
    assert tuple(order.group(1).replace("|", " ").split()) == INTRINSIC_NAMES
    presets = re.findall(r"^\| `(\w+)`[^|]*\| (fu fv u0 v0[^(|]*)", PAGE, re.MULTILINE)
    assert {name: tuple(text.split()) for name, text in presets} == PRESETS
    for name, wanted in PRESETS.items():
        names = FISHEYE_NAMES if name == "fisheye" else INTRINSIC_NAMES
        assert [names[i] for i in np.flatnonzero(estimated_mask(name))] == list(wanted)


def test_fisheye_model_is_the_one_written_down() -> None:
    rng = np.random.default_rng(2)
    c = np.r_[900.0, 890.0, 640.0, 512.0, rng.normal(0, 0.02, 4), np.zeros(7), FISHEYE_MARK]
    fu, fv, u0, v0, k1, k2, k3, k4 = c[:8]
    X, Y, Z = rng.uniform(-3, 3, 20), rng.uniform(-3, 3, 20), rng.uniform(1, 3, 20)
    r = np.sqrt((X / Z) ** 2 + (Y / Z) ** 2)
    t = np.arctan(r)
    td = t * (1 + k1 * t**2 + k2 * t**4 + k3 * t**6 + k4 * t**8)
    expected = np.column_stack([fu * X / Z * td / r + u0, fv * Y / Z * td / r + v0])
    np.testing.assert_allclose(project(np.column_stack([X, Y, Z]), c), expected, atol=1e-9)


@pytest.mark.parametrize("count", [4, 5, 8, 12])
def test_shorter_distortions_are_filled_up_with_zeros(count: int) -> None:
    numbers = [0.1 * (i + 1) for i in range(count)]
    vector = intrinsics_vector(np.eye(3), numbers)
    assert vector[4:].tolist() == numbers + [0.0] * (12 - count)


def test_small_change_of_a_camera_turns_and_shifts_it_in_its_own_frame() -> None:
    net = small_network(n_cameras=3, n_points=12)
    problem, state = net.problem, net.truth
    w, d = np.array([1e-5, -2e-5, 3e-5]), np.array([0.01, 0.02, -0.03])
    step = np.zeros(problem.layout.size)
    second = 6 + 9  # pose before intrinsics, camera by camera
    step[second : second + 3], step[second + 3 : second + 6] = w, d  # rotation before translation
    new = moved(problem, state, step, np.zeros_like(state.points))
    x = np.random.default_rng(0).normal(0, 100, (5, 3))
    before = x @ state.rotation[1].T + state.translation[1]
    after = x @ new.rotation[1].T + new.translation[1]
    np.testing.assert_allclose(after, before @ exp_rotation(w).T + d, atol=1e-10)
    np.testing.assert_allclose(new.rotation[1], exp_rotation(w) @ state.rotation[1], atol=1e-15)
    np.testing.assert_allclose(new.translation[1], exp_rotation(w) @ state.translation[1] + d, atol=1e-12)
    for other in (0, 2):
        np.testing.assert_array_equal(new.rotation[other], state.rotation[other])
        np.testing.assert_array_equal(new.translation[other], state.translation[other])
    centre, new_centre = (-s.rotation[1].T @ s.translation[1] for s in (state, new))
    np.testing.assert_allclose(new_centre, centre - state.rotation[1].T @ d, atol=10 * np.abs(w).max() * 0.03)
    assert np.abs(new_centre - centre).max() > 0.01  # the shift is seen, the turn alone moves no centre
    step[second + 3 : second + 6] = 0.0
    turned = moved(problem, state, step, np.zeros_like(state.points))
    np.testing.assert_allclose(-turned.rotation[1].T @ turned.translation[1], centre, atol=1e-10)


def test_small_change_of_intrinsics_adds_to_them_in_their_order() -> None:
    net = small_network(n_cameras=2, n_points=12, intrinsics="all")
    step = np.zeros(net.problem.layout.size)
    step[6:22] = np.arange(1, 17)
    new = moved(net.problem, net.truth, step, np.zeros_like(net.truth.points))
    np.testing.assert_allclose(new.intrinsics[0] - net.truth.intrinsics[0], np.arange(1, 17))
    np.testing.assert_array_equal(new.intrinsics[1], net.truth.intrinsics[1])


def test_small_change_of_a_placement_turns_about_the_balls_origin() -> None:
    net = small_network(rigid=True, n_cameras=3, n_points=12)
    problem, state = net.problem, net.truth
    assert state.placement_rotation is not None and state.placement_translation is not None
    w, d = np.array([1e-3, -2e-3, 3e-3]), np.array([0.1, 0.2, -0.3])
    step = np.zeros(problem.layout.size)
    first = 3 * 15 + 6
    step[first : first + 3], step[first + 3 : first + 6] = w, d
    new = moved(problem, state, step, np.zeros_like(state.points))
    assert new.placement_rotation is not None and new.placement_translation is not None
    turned = state.points @ state.placement_rotation[1].T @ exp_rotation(w).T
    expected = turned + state.placement_translation[1] + d
    np.testing.assert_allclose(
        state.points @ new.placement_rotation[1].T + new.placement_translation[1], expected, atol=1e-10
    )
    np.testing.assert_array_equal(new.placement_translation[0], state.placement_translation[0])
