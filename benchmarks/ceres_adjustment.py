"""The same bundle adjustment by Ceres, as COLMAP sets it up: pycolmap builds the problem, its own Ceres solves it.

The camera model is FULL_OPENCV (fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6, own for each camera) with k4 k5 k6 held, so that
what is estimated is the preset `brown`. Poses are free (no gauge is fixed): Ceres' own Levenberg-Marquardt damping does
without, as ours does.
"""

import time
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pyceres  # before the problem is asked for: it brings the Python type of Ceres' problems
import pycolmap
import pycolmap.pyceres as options_of
from scipy.spatial.transform import Rotation

from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State

FUNCTION_TOLERANCE = 1e-9
MAX_ITERATIONS = 200
HELD = [9, 10, 11]  # k4 k5 k6 among FULL_OPENCV's parameters
OFFSET = 0.5  # COLMAP's pixel (0, 0) has its centre at (0.5, 0.5); shifting both sides changes no residual


@dataclass(frozen=True)
class CeresRun:
    """One solution: half the sum of squares, iterations, wall and CPU seconds of the solver, seconds of building."""

    cost: float
    first_cost: float
    iterations: int
    solve_s: float
    solve_cpu_s: float
    build_s: float
    report: str


@dataclass(frozen=True)
class CeresCameras(CeresRun):
    """A solution with its cameras; points are left out."""

    state: State


def solve(problem: Problem, state: State, linear_solver: str) -> CeresCameras:
    """Minimise with `SPARSE_SCHUR` or `DENSE_SCHUR` on one thread."""
    begin = time.perf_counter()
    network = _reconstruction(problem, state)
    config = pycolmap.BundleAdjustmentConfig()
    for image in network.images:
        config.add_image(image)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(solver_options(linear_solver), config, network)
    held = pyceres.SubsetManifold(12, HELD)
    posed = adjuster.problem  # must outlive the solution: it keeps the manifold alive
    for camera in network.cameras.values():
        posed.set_manifold(camera.params, held)
    built, cpu = time.perf_counter(), time.process_time()
    summary = cast(Any, adjuster.solve()).ceres_summary  # what its Ceres adds to the base class
    solved, cpu = time.perf_counter(), time.process_time() - cpu
    return CeresCameras(
        cost=summary.final_cost,
        first_cost=summary.initial_cost,
        iterations=summary.num_successful_steps + summary.num_unsuccessful_steps - 1,  # the start counts as a step
        solve_s=solved - built,
        solve_cpu_s=cpu,
        build_s=built - begin,
        report=summary.FullReport(),
        state=_state(network, state),
    )


def _state(network: pycolmap.Reconstruction, start: State) -> State:
    """The cameras of a solved network; points are left out."""
    n = len(start.translation)
    intrinsics, poses = start.intrinsics.copy(), np.tile(np.eye(3, 4), (n, 1, 1))
    poses[:, :, :3], poses[:, :, 3] = start.rotation, start.translation
    for image in network.images.values():
        c = image.camera_id - 1
        intrinsics[c, :12] = network.cameras[image.camera_id].params
        intrinsics[c, 2:4] -= OFFSET
        poses[c] = image.cam_from_world().matrix()
    return State(poses[:, :, :3], poses[:, :, 3], intrinsics, np.zeros((0, 3)))


def solver_options(linear_solver: str) -> pycolmap.BundleAdjustmentOptions:
    """COLMAP's bundle adjustment with everything but k4 k5 k6 free, on one thread, to the benchmark's tolerance."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    options.ceres.auto_select_solver_type = False
    solver = options.ceres.solver_options
    solver.linear_solver_type = getattr(options_of.LinearSolverType, linear_solver)
    solver.num_threads = 1
    solver.function_tolerance = FUNCTION_TOLERANCE
    solver.gradient_tolerance = solver.parameter_tolerance = 1e-300  # the cost alone decides, as it does with ours
    solver.max_num_iterations = MAX_ITERATIONS
    return options


def _reconstruction(problem: Problem, state: State) -> pycolmap.Reconstruction:
    """COLMAP's data of a problem; weights must be 1 and poses free."""
    assert (problem.weight == 1).all() and not problem.n_placements and not problem.has_lengths
    out = pycolmap.Reconstruction()
    quaternion = Rotation.from_matrix(state.rotation).as_quat()
    within = np.empty(len(problem.camera), dtype=int)  # each observation's number in its image
    for c in np.unique(problem.camera):
        own = np.flatnonzero(problem.camera == c)
        within[own] = np.arange(len(own))
        params = state.intrinsics[c, :12].copy()
        params[2:4] += OFFSET
        camera = pycolmap.Camera(model="FULL_OPENCV", width=4000, height=4000, params=params, camera_id=c + 1)
        out.add_camera_with_trivial_rig(camera)
        image = pycolmap.Image(name=str(c), camera_id=c + 1, image_id=c + 1)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(uv) for uv in problem.uv[own] + OFFSET])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(quaternion[c]), state.translation[c])
        out.add_image_with_trivial_frame(image, pose)
    camera, start = (problem.camera + 1).tolist(), problem.point_start.tolist()
    number = within.tolist()
    for p in np.flatnonzero(np.diff(problem.point_start)):
        rows = range(start[p], start[p + 1])
        out.add_point3D(state.points[p], pycolmap.Track([pycolmap.TrackElement(camera[k], number[k]) for k in rows]))
    return out
