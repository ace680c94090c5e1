"""The rigid form by Ceres, as COLMAP sets up a rig: one rig of all cameras, a frame for every placement of the ball.

Camera model and settings as in `ceres_adjustment`. COLMAP's rig frame is its first camera, so the unknowns are those of
ours up to the datum: sensor_from_rig, rig_from_world (the ball is the world), points.
"""

import time
from typing import Any, cast

import numpy as np
import pyceres  # before the problem is asked for: it brings the Python type of Ceres' problems
import pycolmap
from ceres_adjustment import HELD, OFFSET, CeresRun, solver_options
from scipy.spatial.transform import Rotation

from spherecal.adjust.problem import Problem
from spherecal.adjust.state import State
from spherecal.base.arrays import FloatArray


def solve(problem: Problem, state: State, linear_solver: str) -> CeresRun:
    """Minimise with `SPARSE_SCHUR` or `DENSE_SCHUR` on one thread."""
    begin = time.perf_counter()
    network = _reconstruction(problem, state)
    config = pycolmap.BundleAdjustmentConfig()
    for image in network.images:
        config.add_image(image)
    options = solver_options(linear_solver)
    options.refine_sensor_from_rig = True
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, network)
    held = pyceres.SubsetManifold(12, HELD)
    posed = adjuster.problem  # must outlive the solution: it keeps the manifold alive
    for camera in network.cameras.values():
        posed.set_manifold(camera.params, held)
    built, cpu = time.perf_counter(), time.process_time()
    summary = cast(Any, adjuster.solve()).ceres_summary  # what its Ceres adds to the base class
    solved, cpu = time.perf_counter(), time.process_time() - cpu
    return CeresRun(
        cost=summary.final_cost,
        first_cost=summary.initial_cost,
        iterations=summary.num_successful_steps + summary.num_unsuccessful_steps - 1,  # the start counts as a step
        solve_s=solved - built,
        solve_cpu_s=cpu,
        build_s=built - begin,
        report=summary.FullReport(),
    )


def _pose(rotation: FloatArray, translation: FloatArray) -> pycolmap.Rigid3d:
    return pycolmap.Rigid3d(pycolmap.Rotation3d(Rotation.from_matrix(rotation).as_quat()), translation)


def _sensor(camera: int) -> pycolmap.sensor_t:
    return pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera + 1)


def _reconstruction(problem: Problem, state: State) -> pycolmap.Reconstruction:
    """COLMAP's data of a problem in the rigid form; weights must be 1."""
    assert (problem.weight == 1).all() and problem.n_placements and not problem.has_lengths
    n, placements = problem.n_cameras, problem.n_placements
    first, first_shift = state.rotation[0], state.translation[0]
    out, rig = pycolmap.Reconstruction(), pycolmap.Rig(rig_id=1)
    for c in range(n):
        params = state.intrinsics[c, :12].copy()
        params[2:4] += OFFSET
        camera = pycolmap.Camera(model="FULL_OPENCV", width=4000, height=4000, params=params, camera_id=c + 1)
        out.add_camera(camera)
        if c == 0:
            rig.add_ref_sensor(_sensor(c))
        else:
            turn = state.rotation[c] @ first.T
            rig.add_sensor(_sensor(c), _pose(turn, state.translation[c] - turn @ first_shift))
    out.add_rig(rig)
    within = np.empty(len(problem.camera), dtype=int)  # each observation's number in its image
    for t in range(placements):
        frame = pycolmap.Frame(frame_id=t + 1, rig_id=1)
        frame.rig_from_world = _pose(
            first @ state.placement_rotation[t], first @ state.placement_translation[t] + first_shift
        )
        for c in range(n):
            frame.add_data_id(pycolmap.data_t(_sensor(c), t * n + c + 1))
        out.add_frame(frame)
        for c in range(n):
            own = np.flatnonzero((problem.camera == c) & (problem.placement == t))
            within[own] = np.arange(len(own))
            image = pycolmap.Image(name=f"{t} {c}", camera_id=c + 1, image_id=t * n + c + 1)
            image.points2D = pycolmap.Point2DList([pycolmap.Point2D(uv) for uv in problem.uv[own] + OFFSET])
            image.frame_id = t + 1
            out.add_image(image)
    for t in range(placements):
        out.register_frame(t + 1)
    image_of = (problem.placement * n + problem.camera + 1).tolist()
    number, start = within.tolist(), problem.point_start.tolist()
    for p in np.flatnonzero(np.diff(problem.point_start)):
        rows = range(start[p], start[p + 1])
        out.add_point3D(state.points[p], pycolmap.Track([pycolmap.TrackElement(image_of[k], number[k]) for k in rows]))
    return out
